"""The last pages of the appendix: how the numbers came about, and what the terms mean."""

from jointbayes.report.guides import terms
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.methods import methods_text
from jointbayes.report.model import Paragraph, ReportSection, Table


def methods_section(inputs: ReportInputs) -> ReportSection:
    """A paragraph to paste into a paper; what it cites is in a file of the run directory."""
    return ReportSection("methods", "Methods", (Paragraph(methods_text(inputs)),), appendix=True)


def terms_section(text: str) -> ReportSection:
    """What the terms of a report mean, of those that its text has."""
    used = tuple(row for row in terms().items() if any(term in text for term in row[0].split(", ")))
    table = Table("Terms", ("Term", "Meaning"), used, align="ll")
    return ReportSection("terms", "Terms", (table,), appendix=True)
