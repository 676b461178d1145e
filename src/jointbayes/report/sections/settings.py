"""Everything needed to repeat the run."""

from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Code, Paragraph, Section, Table


def settings_section(inputs: ReportInputs) -> Section:
    """Everything needed to repeat the run."""
    summary = inputs.summary
    versions = tuple((foreign(name), foreign(version)) for name, version in summary.record.versions.items())
    return Section(
        "settings",
        "Settings and versions",
        (
            *([] if summary.mesh is None else [Paragraph(summary.mesh.sentence)]),
            Paragraph(f"Fingerprint of the data (SHA-256): `{summary.data_sha256}`."),
            Table("Versions", ("Package", "Version"), versions, align="ll"),
            Code(inputs.case_text, "toml") if inputs.case_text else Code(str(inputs.posterior.problem), "text"),
        ),
    )
