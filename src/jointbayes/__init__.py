"""Joint stiffness from vibration measurements, with uncertainty.

Names are loaded at first use, so that importing the package costs next to nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jointbayes.case.case import Case, case_from_text, load_case
    from jointbayes.case.simulation import simulate
    from jointbayes.errors import (
        CaseError,
        JointBayesError,
        MeasurementError,
        ModelError,
        ReportError,
        SamplingError,
        WriteError,
    )
    from jointbayes.frf import FrfSet, Ports
    from jointbayes.identification import IterationHistory, MapEstimate
    from jointbayes.inference import Problem
    from jointbayes.measurement.formats import iter_records, read_frf, write_frf, write_records
    from jointbayes.measurement.inspection.inspection import Inspection, inspect_file
    from jointbayes.measurement.modal.fit import identify_modes
    from jointbayes.measurement.provenance import MeasuredMode, MeasurementWarning
    from jointbayes.measurement.records import FrfRecord, TimeRecord
    from jointbayes.measurement.warnings.warnings import find_warnings
    from jointbayes.posterior import Knowledge, Posterior, PredictiveCheck, gather_knowledge, summarise
    from jointbayes.report.run_directory import write_report
    from jointbayes.sampling import SamplerSettings
    from jointbayes.studies.comparison.compare import compare
    from jointbayes.studies.comparison.result import Comparison
    from jointbayes.studies.planning.directory import write_plan
    from jointbayes.studies.planning.plan import Plan, plan
    from jointbayes.studies.reference_check import check_posterior
    from jointbayes.workflow import find_map, identify, load_posterior, sample

_HOMES = {
    "jointbayes.case.case": ("Case", "case_from_text", "load_case"),
    "jointbayes.studies.reference_check": ("check_posterior",),
    "jointbayes.studies.comparison.compare": ("compare",),
    "jointbayes.studies.comparison.result": ("Comparison",),
    "jointbayes.errors": (
        "CaseError",
        "JointBayesError",
        "MeasurementError",
        "ModelError",
        "ReportError",
        "SamplingError",
        "WriteError",
    ),
    "jointbayes.frf": ("FrfSet", "Ports"),
    "jointbayes.identification": ("IterationHistory", "MapEstimate"),
    "jointbayes.inference": ("Problem",),
    "jointbayes.measurement.inspection.inspection": ("Inspection", "inspect_file"),
    "jointbayes.measurement.warnings.warnings": ("find_warnings",),
    "jointbayes.measurement.formats": ("iter_records", "read_frf", "write_frf", "write_records"),
    "jointbayes.measurement.modal.fit": ("identify_modes",),
    "jointbayes.measurement.provenance": ("MeasuredMode", "MeasurementWarning"),
    "jointbayes.measurement.records": ("FrfRecord", "TimeRecord"),
    "jointbayes.studies.planning.directory": ("write_plan",),
    "jointbayes.studies.planning.plan": ("Plan", "plan"),
    "jointbayes.posterior": ("Knowledge", "Posterior", "PredictiveCheck", "gather_knowledge", "summarise"),
    "jointbayes.report.run_directory": ("write_report",),
    "jointbayes.sampling": ("SamplerSettings",),
    "jointbayes.case.simulation": ("simulate",),
    "jointbayes.workflow": ("find_map", "identify", "load_posterior", "sample"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    # cases
    "Case",
    "case_from_text",
    "load_case",
    # steps of a run
    "check_posterior",
    "compare",
    "find_map",
    "gather_knowledge",
    "identify",
    "load_posterior",
    "plan",
    "sample",
    "summarise",
    "write_plan",
    "write_report",
    # measurement files
    "find_warnings",
    "identify_modes",
    "inspect_file",
    "iter_records",
    "read_frf",
    "simulate",
    "write_frf",
    "write_records",
    # results and parts
    "Comparison",
    "MeasurementWarning",
    "FrfRecord",
    "FrfSet",
    "Inspection",
    "IterationHistory",
    "Knowledge",
    "MapEstimate",
    "MeasuredMode",
    "Plan",
    "Ports",
    "Posterior",
    "PredictiveCheck",
    "Problem",
    "SamplerSettings",
    "TimeRecord",
    # errors
    "CaseError",
    "JointBayesError",
    "MeasurementError",
    "ModelError",
    "ReportError",
    "SamplingError",
    "WriteError",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401 (any public name)
    if name == "__version__":
        from importlib.metadata import version

        return version("jointbayes")
    if name not in _HOME_OF:
        raise AttributeError(f"module 'jointbayes' has no attribute {name!r}")
    return getattr(import_module(_HOME_OF[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
