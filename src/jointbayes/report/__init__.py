"""Reports: one model of formatted text, tables and figures, rendered as HTML and as PDF."""

from jointbayes.report.contents import build_report
from jointbayes.report.html import render_html
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.model import Figure, Report
from jointbayes.report.pdf import render_pdf
from jointbayes.report.sections.natural_frequencies import compared_section

__all__ = ["Figure", "Report", "ReportInputs", "build_report", "compared_section", "render_html", "render_pdf"]
