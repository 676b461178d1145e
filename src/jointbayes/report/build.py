"""The report of a run: from a posterior to formatted text, tables and figures."""

import datetime

from jointbayes.report.inputs import ReportInputs
from jointbayes.report.model import Report
from jointbayes.report.sections.fit import fit_section
from jointbayes.report.sections.frequencies import frequency_section
from jointbayes.report.sections.joint_in_modes import joint_in_modes_section
from jointbayes.report.sections.knowledge import knowledge_section
from jointbayes.report.sections.lead import lead
from jointbayes.report.sections.likelihood import likelihood_section
from jointbayes.report.sections.measured_bodies import measured_bodies_section
from jointbayes.report.sections.measurement import measurement_section
from jointbayes.report.sections.modes import modes_section
from jointbayes.report.sections.nuisances import nuisance_section
from jointbayes.report.sections.paper import audit_section, paper_section
from jointbayes.report.sections.posterior import posterior_section
from jointbayes.report.sections.sampling import sampling_section
from jointbayes.report.sections.settings import settings_section
from jointbayes.report.sections.starts import starts_section

__all__ = ["SECTIONS", "build_report"]

#: In the order of the report. Each takes `ReportInputs` and returns None where it has nothing to say.
SECTIONS = (
    measurement_section,
    measured_bodies_section,
    fit_section,
    frequency_section,
    modes_section,
    joint_in_modes_section,
    posterior_section,
    nuisance_section,
    knowledge_section,
    sampling_section,
    starts_section,
    paper_section,
    audit_section,
    likelihood_section,
    settings_section,
)


def build_report(inputs: ReportInputs, date: datetime.date) -> Report:
    """Build the report, verdict first."""
    synthetic = " — synthetic data" if inputs.summary.fit.synthetic_data else ""
    return Report(
        title=inputs.title,
        subtitle=f"Joint stiffness with uncertainty{synthetic}",
        lead=lead(inputs),
        sections=tuple(written for section in SECTIONS if (written := section(inputs)) is not None),
        date=date,
        version=inputs.posterior.record.versions["jointbayes"],
    )
