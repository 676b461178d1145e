"""Joint stiffness from vibration measurements, with uncertainty.

Names are loaded at first use, so that importing the package costs next to nothing. The one table of them is the stub
beside this file, which type checkers read as well.
"""

import re
from importlib import import_module
from pkgutil import get_data
from typing import Any

_STUB = (get_data(__name__, "__init__.pyi") or b"").decode()
_HOME_OF = {name: home for home, name in re.findall(r"^from (\S+) import (\w+) as \2", _STUB, re.MULTILINE)}

__all__ = [*_HOME_OF]

#: Public names of rooms that stood at the top once: who still asks for them here is told where they are.
_MOVED = {
    name: room
    for room, names in {
        "errors": "CheckpointError ReportError WorkerError WriteError",
        "inference": "GaussianNoise IntegratedScale ProportionalNoise ScaledNoise",
        "joint": "ElasticCentre Joints Rigid",
        "measurement.frf_variance": "mean_of_repeats",
        "measurement.formats": "iter_records write_records",
        "measurement.inspection": "Inspection",
        "measurement.provenance": "MeasuredMode MeasurementWarning",
        "measurement.records": "FrfRecord TimeRecord",
        "measurement.warnings.collector": "find_warnings",
        "posterior": "Knowledge PredictiveCheck gather_knowledge",
        "structure": "PointMass Rayleigh ViscousMatrix",
        "studies.campaign.campaign_report": "write_campaign_report",
    }.items()
    for name in names.split()
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 (any public name)
    if name == "__version__":
        from importlib.metadata import version

        return version("jointbayes")
    if name not in _HOME_OF:
        moved = f"; it is in jointbayes.{_MOVED[name]}" if name in _MOVED else ""
        raise AttributeError(f"module 'jointbayes' has no attribute {name!r}{moved}")
    return getattr(import_module(_HOME_OF[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
