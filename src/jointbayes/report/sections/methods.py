"""The last pages of the appendix: how the numbers came about, what to cite for it, and what the terms mean."""

from jointbayes.report.guides import terms
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.methods import methods_text, references
from jointbayes.report.model import Paragraph, ReportSection, Table


def methods_section(inputs: ReportInputs) -> ReportSection:
    """A paragraph to paste into a paper, and the BibTeX of what it cites."""
    text = methods_text(inputs)
    return ReportSection("methods", "Methods and references", (Paragraph(text), references(text)), appendix=True)


def terms_section(_: object) -> ReportSection:
    """What the terms mean, the same in each report."""
    table = Table("Terms", ("Term", "Meaning"), tuple(terms().items()), align="ll")
    return ReportSection("terms", "Terms", (table,), appendix=True)
