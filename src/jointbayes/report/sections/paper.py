"""The sections that only a case of Cao, Li and He has: their tables beside ours, and the audit."""

from jointbayes.posterior.rounding import interval, number
from jointbayes.posterior.setup_summary import NaturalFrequencies
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.model import Block, Paragraph, Section, Table
from jointbayes.report.paper_tables import TABLE_2, TABLE_3, TABLE_4, audit, clamped_frequencies_hz


def paper_section(inputs: ReportInputs) -> Section | None:
    """The paper's Tables 2, 3 and 4 beside ours."""
    if not inputs.paper_audit:
        return None
    summary, first_guess = inputs.summary, inputs.posterior.problem.first_guess
    rigid = clamped_frequencies_hz(0.383)
    table_2 = tuple(
        (str(i), f"{e:.0f}", f"{s:.0f}", f"{r:.1f}", f"{100 * (r / e - 1):+.1f}")
        for i, (e, s, r) in enumerate(zip(TABLE_2.experiment, TABLE_2.simulation, rigid, strict=True), 1)
    )
    table_3 = tuple(
        (name, number(guess), number(published), number(p.mode), interval(p.known.interval95), p.unit)
        for (name, p), guess, published in zip(summary.parameters.items(), first_guess, TABLE_3, strict=True)
    )
    return Section(
        "paper",
        "Comparison with the paper's tables",
        (
            Table(
                "Paper's Table 2: rigid clamp",
                (
                    "Mode",
                    "Experiment (Hz)",
                    "Paper's simulation (Hz)",
                    "Ours, Table 1's beam (Hz)",
                    "Ours, error (%)",
                ),
                table_2,
            ),
            Table(
                "Paper's Table 3: joint stiffness",
                ("Stiffness", "First guess", "Paper", "Our mode", "Our 95 % interval", "Unit"),
                table_3,
                note="The paper prints N/m for all three; the units here are those of the quantities.",
            ),
            Table(
                "Paper's Table 4: flexible clamp",
                ("Mode", "Experiment (Hz)", "Paper (Hz)", "Error (%)", "Our MAP (Hz)", "Our 95 % interval (Hz)"),
                _table_4(summary.natural_frequencies_hz),
                note="Errors recomputed from the printed frequencies.",
            ),
        ),
    )


def _table_4(ours: NaturalFrequencies) -> tuple[tuple[str, ...], ...]:
    # ours are as many as the case names measured ones
    columns = (TABLE_4.experiment, TABLE_4.simulation, TABLE_4.error, ours.map, ours.interval95)
    return tuple(
        (str(i), f"{e:.0f}", f"{s:.0f}", f"{error:+.1f}", f"{m:.1f}", f"{ends[0]:.1f} … {ends[1]:.1f}")
        for i, (e, s, error, m, ends) in enumerate(zip(*columns, strict=False), 1)
    )


def audit_section(inputs: ReportInputs) -> Section | None:
    """What in the paper does not add up."""
    if not inputs.paper_audit:
        return None
    blocks: list[Block] = [
        Paragraph("Computed in this run from the inputs that the paper prints; nothing here is copied from elsewhere.")
    ]
    for i, finding in enumerate(audit(), 1):
        blocks.append(Paragraph(f"**{i}. {finding.claim}** {finding.found}"))
        blocks.append(Table(f"Audit {i}", finding.head, finding.rows))
    return Section("audit", "Audit of the paper's tables", tuple(blocks))
