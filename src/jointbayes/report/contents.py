"""The report of a run: from a posterior to formatted text, tables and figures."""

import datetime
from collections.abc import Callable, Iterable
from typing import TypeVar

from jointbayes.report.inputs import ReportInputs
from jointbayes.report.model import Report, ReportSection
from jointbayes.report.sections.fit_to_data import fit_section
from jointbayes.report.sections.identifiable import knowledge_section, likelihood_section
from jointbayes.report.sections.intervals import nuisance_section, posterior_section
from jointbayes.report.sections.joint_in_modes import joint_in_modes_section
from jointbayes.report.sections.lead import lead
from jointbayes.report.sections.left_out import left_out_section
from jointbayes.report.sections.measured_data import measured_bodies_section, measurement_section
from jointbayes.report.sections.natural_frequencies import frequency_section, own_section
from jointbayes.report.sections.run_details import sampling_section, settings_section, starts_section
from jointbayes.report.sections.several_setups import (
    assembly_section,
    curve_section,
    overview_section,
    setup_section,
)

Inputs = TypeVar("Inputs")

#: On the data of one set-up, in the order of the report. Each takes `SetupInputs`, returns None with nothing to say.
SECTIONS_OF_DATA = (
    measurement_section,
    fit_section,
    frequency_section,
    own_section,
    joint_in_modes_section,
)
#: On all set-ups together. Each takes `ReportInputs`.
SECTIONS = (
    measured_bodies_section,
    curve_section,
    assembly_section,
    left_out_section,
    posterior_section,
    nuisance_section,
    knowledge_section,
    sampling_section,
    starts_section,
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
        sections=(*_data_sections(inputs), *_written(SECTIONS, inputs)),
        date=date,
        version=inputs.posterior.record.versions["jointbayes"],
    )


def _data_sections(inputs: ReportInputs) -> list[ReportSection]:
    """The sections on the data; of several set-ups a table of all, and one section for each."""
    if len(inputs.setups) == 1:
        return _written(SECTIONS_OF_DATA, inputs.setups[0])
    each = enumerate(inputs.setups, 1)
    return [
        overview_section(inputs),
        *(setup_section(n, setup, _written(SECTIONS_OF_DATA, setup)) for n, setup in each),
    ]


def _written(sections: Iterable[Callable[[Inputs], ReportSection | None]], inputs: Inputs) -> list[ReportSection]:
    return [written for section in sections if (written := section(inputs)) is not None]
