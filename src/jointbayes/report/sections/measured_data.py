"""What was measured, files and channels, and bodies of the structure that were measured instead of modelled."""

import numpy as np

from jointbayes.frf import MeasuredBody
from jointbayes.report.inputs import ReportInputs, TestInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Block, Callout, Paragraph, ReportSection, Table
from jointbayes.rounding import number, sentence_start
from vibrecords import MeasuredFile
from vibrecords.provenance import ChannelUse, MeasurementWarning

_MOST_CHANNELS = 40  # in the table


def measured_modes_section(inputs: TestInputs) -> ReportSection | None:
    """Natural frequencies and damping ratios that the FRFs show; None where none were found."""
    provenance = inputs.problem.test.data.provenance
    if provenance is None or not provenance.modes:
        return None
    columns = {
        "Mode": [str(i) for i, _ in enumerate(provenance.modes, 1)],
        "Frequency (Hz)": [f"{mode.frequency_hz:.2f}" for mode in provenance.modes],
        "sd (Hz)": [number(mode.frequency_sd_hz, 2) for mode in provenance.modes],
        "Damping (%)": [f"{100 * mode.damping_ratio:.3f}" for mode in provenance.modes],
        "Its sd (%)": [number(100 * mode.damping_sd, 2) for mode in provenance.modes],
    }
    note = (
        "From a modal fit of the measured FRFs, without the model of the structure. Frequency: undamped. Damping: "
        "ratio to the critical one."
    )
    table = Table.of("Measured natural frequencies and damping", columns, note=note)
    return ReportSection("measured-modes", "Measured modes", (table,))


def case_warnings_section(inputs: ReportInputs) -> ReportSection | None:
    """What in the case file is probably a slip; None where nothing is."""
    warnings = inputs.summary.warnings
    callouts = tuple(Callout("caution", f"**Check the case file.** {foreign(str(warning))}.") for warning in warnings)
    return ReportSection("warnings", "Warnings", callouts) if callouts else None


def measurement_section(inputs: TestInputs) -> ReportSection | None:
    """Files, channels, variance, what was changed, and what is doubtful."""
    p = inputs.problem.test.data.provenance
    if p is None:
        return None
    averages = f", {p.averages} averages" if p.averages else ""
    quantity = foreign(p.quantity.capitalize())
    text = (
        f"**{quantity}**, {p.lines} lines from {p.band_hz[0]:g} to {p.band_hz[1]:g} Hz{averages}. "
        f"Variance: {foreign(p.variance)}."
    )
    if p.variance_dof is not None:
        text += (
            f" It is itself an estimate, with {p.variance_dof} degrees of freedom at each line, so the standardised "
            "residuals follow Student's t distribution with as many, unless [noise] states another."
        )
    blocks: list[Block] = [Callout("caution", f"**Check {foreign(w.where)}.** {_sentence(w)}") for w in p.warnings]
    blocks.append(Paragraph(text))
    blocks.append(Table("Measurement files", ("File", "Bytes", "SHA-256"), tuple(map(_file_row, p.files))))
    head = ("Channel", "Used as", "DOF", "Factor", "Mass taken out (g)")
    more = ""
    if len(p.channels) > _MOST_CHANNELS:
        more = f"The first {_MOST_CHANNELS} of {len(p.channels)}; summary.json has all."
    rows = tuple(_channel_row(use) for use in p.channels[:_MOST_CHANNELS])
    blocks.append(Table("Channels", head, rows, align="lllrr", note=more))
    blocks += [Paragraph(foreign(text)) for text in p.notes]
    if p.left_out:
        shown = ", ".join(f"`{foreign(label)}`" for label in p.left_out[:40])
        more = f" and {len(p.left_out) - 40} more" if len(p.left_out) > 40 else ""
        blocks.append(Paragraph(f"Channels left out, because the case does not map them: {shown}{more}."))
    return ReportSection("measurement", "Measurement", tuple(blocks))


def _sentence(warning: MeasurementWarning) -> str:
    return foreign(f"{sentence_start(warning.sentence)}; {warning.remedy}.")


def _file_row(file: MeasuredFile) -> tuple[str, ...]:
    return foreign(file.name), f"{file.size}", f"`{foreign(file.sha256)}`"


def _channel_row(use: ChannelUse) -> tuple[str, ...]:
    turned = " (other direction)" if use.reversed_direction else ""
    mass = number(1e3 * use.accelerometer_mass) if use.accelerometer_mass else "–"
    return (f"`{foreign(use.channel)}`{turned}", use.role, foreign(use.dof), number(use.factor, 6), mass)


def measured_bodies_section(inputs: ReportInputs) -> ReportSection | None:
    """A row for each body; None where the structure is modelled throughout."""
    noise = inputs.summary.measured_bodies
    if noise is None:
        return None
    bodies = [
        (f"{body.name} in test {part.test.name}" if part.test.name else body.name, body)
        for part in inputs.posterior.problem.parts
        for body in part.test.measured_bodies
    ]
    head = ("Body", "DOFs", "Lines", "Noise, median (%)", "Reciprocity")
    note = (
        "Noise: standard deviation of the receptances over their size, median over lines and pairs. Reciprocity: mean "
        "square of the difference of FRFs when force and response change places over what their noise allows, 1 "
        "expected; a dash where no pair was measured both ways. Nothing is interpolated."
    )
    rows = tuple(_body_row(name, body) for name, body in bodies)
    table = Table("Measured bodies", head, rows, align="llrrr", note=note)
    files = tuple((foreign(name), *_file_row(file)) for name, body in bodies for file in body.files)
    listed = [Table("Files of the measured bodies", ("Body", "File", "Bytes", "SHA-256"), files)] if files else []
    return ReportSection("measured-bodies", "Measured bodies", (Paragraph(foreign(noise.sentence)), table, *listed))


def _body_row(name: str, body: MeasuredBody) -> tuple[str, ...]:
    a, b = np.triu_indices(len(body.dofs))
    size = np.abs(body.receptance[:, a, b])
    sd = np.sqrt(np.diagonal(body.covariance, axis1=1, axis2=2))
    relative = float(np.median(sd[size > 0] / size[size > 0]))
    f = body.frequency_hz
    return (
        foreign(name),
        foreign(", ".join(body.dofs)),
        f"{f.size}, {f[0]:g} to {f[-1]:g} Hz",
        number(100 * relative, 2),
        "–" if body.discrepancy is None else number(body.discrepancy),
    )
