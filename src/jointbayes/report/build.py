"""The report of a run: from a posterior to formatted text, tables and figures."""

import datetime
from dataclasses import dataclass
from functools import cached_property

from jointbayes.identification import IterationHistory
from jointbayes.inference import Problem
from jointbayes.measurement.provenance import Provenance
from jointbayes.posterior import Knowledge, Posterior, gather_knowledge, summarise
from jointbayes.posterior.summary import Summary
from jointbayes.report.model import Block, Callout, Report, Section
from jointbayes.report.paper_tables import audit
from jointbayes.report.sections import lead as sections
from jointbayes.report.sections import paper as paper_sections
from jointbayes.report.sections.frfs import fit_section
from jointbayes.report.sections.knowledge import knowledge_section, likelihood_section, nuisance_section
from jointbayes.report.sections.measurement import measurement_section, mode_table

__all__ = ["ReportInputs", "build_report"]


@dataclass(frozen=True)
class ReportInputs:
    """What a report is written from.

    Parameters
    ----------
    posterior
        Posterior.
    title
        Title of the case.
    initial
        First guess of (k11, k12, k22).
    history
        The paper's iteration, None where the data are natural frequencies.
    reference, reference_source
        Published (k11, k12, k22) and where they come from, if any.
    measured_frequencies_hz
        Measured natural frequencies, if any.
    freed
        The same problem with more quantities uncertain, to say what freeing them does.
    paper_tables
        Whether to compare the paper's tables with the results and audit them.
    provenance
        Where data from measurement files come from, None for other data.
    warnings
        What in the case is probably a slip.
    """

    posterior: Posterior
    title: str
    initial: tuple[float, float, float]
    history: IterationHistory | None = None
    reference: tuple[float, float, float] | None = None
    reference_source: str = ""
    measured_frequencies_hz: tuple[float, ...] | None = None
    freed: Problem | None = None
    paper_tables: bool = False
    provenance: Provenance | None = None
    warnings: tuple[str, ...] = ()

    @cached_property
    def summary(self) -> Summary:
        """The numbers of the run, as in ``summary.json``."""
        return summarise(self.posterior, self.initial, self.measured_frequencies_hz, self.knowledge, self.warnings)

    @cached_property
    def knowledge(self) -> Knowledge:
        """Check of the model, directions, profiles, and what freeing other quantities does."""
        return gather_knowledge(self.posterior, self.freed)


def build_report(inputs: ReportInputs, date: datetime.date) -> Report:
    """Build the report, verdict first."""
    posterior, summary, knowledge = inputs.posterior, inputs.summary, inputs.knowledge
    parts: list[Section] = [
        fit_section(posterior, inputs.initial, summary, knowledge),
        sections.frequency_section(posterior, summary),
        sections.posterior_section(posterior, inputs.reference, inputs.reference_source, summary),
        knowledge_section(posterior, knowledge, summary),
        sections.sampling_section(posterior, summary),
    ]
    others = nuisance_section(summary)
    if others is not None:
        parts.insert(3, others)
    missing = inputs.provenance.iteration if inputs.provenance else ""
    parts.append(sections.starts_section(posterior, inputs.history, inputs.reference, missing))
    modes: tuple[Block, ...] = ()
    if inputs.provenance is not None:
        modes = mode_table(posterior, inputs.provenance)
        parts.insert(0, measurement_section(inputs.provenance))
    if inputs.paper_tables:
        parts.append(paper_sections.paper_section(inputs.initial, summary))
        parts.append(paper_sections.audit_section(audit()))
    limits = likelihood_section(knowledge, summary)
    if limits is not None:
        parts.append(limits)
    parts.append(sections.settings_section(posterior, summary))
    notes = tuple(Callout("caution", f"**Check the case file.** {warning}.") for warning in inputs.warnings)
    synthetic = " — synthetic data" if summary.fit.synthetic_data else ""
    return Report(
        title=inputs.title,
        subtitle=f"Joint stiffness with uncertainty{synthetic}",
        lead=notes + modes + sections.lead(posterior, inputs.reference, inputs.reference_source, summary),
        sections=tuple(parts),
        date=date,
        version=posterior.record.versions["jointbayes"],
    )
