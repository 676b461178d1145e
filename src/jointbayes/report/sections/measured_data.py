"""What was measured, files and channels, and bodies of the structure that were measured instead of modelled."""

import numpy as np

from jointbayes.report.inputs import ReportInputs, TestInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Block, Callout, Paragraph, ReportSection, Table
from jointbayes.rounding import number, sentence_start
from vibrecords import MeasuredFile

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
    said = ((w.where, f"{sentence_start(w.sentence)}; {w.remedy}.") for w in p.warnings)
    blocks: list[Block] = [Callout("caution", f"**Check {foreign(at)}.** {foreign(what)}") for at, what in said]
    blocks.append(Paragraph(text))
    blocks.append(Table("Measurement files", ("File", "Bytes", "SHA-256"), tuple(map(_file_row, p.files))))
    more, shown = "", p.channels[:_MOST_CHANNELS]
    if len(p.channels) > _MOST_CHANNELS:
        more = f"The first {_MOST_CHANNELS} of {len(p.channels)}; summary.json has all."
    columns = {
        "Channel": [f"`{foreign(c.channel)}`{' (other direction)' if c.reversed_direction else ''}" for c in shown],
        "Used as": [str(c.role) for c in shown],
        "DOF": [foreign(c.dof) for c in shown],
        "Factor": [number(c.factor, 6) for c in shown],
        "Mass taken out (g)": [number(1e3 * c.accelerometer_mass) if c.accelerometer_mass else "–" for c in shown],
    }
    blocks.append(Table.of("Channels", columns, align="lllrr", note=more))
    blocks += [Paragraph(foreign(text)) for text in p.notes]
    if p.left_out:
        labels = ", ".join(f"`{foreign(label)}`" for label in p.left_out[:40])
        more = f" and {len(p.left_out) - 40} more" if len(p.left_out) > 40 else ""
        blocks.append(Paragraph(f"Channels left out, because the case does not map them: {labels}{more}."))
    return ReportSection("measurement", "Measurement", tuple(blocks))


def _file_row(file: MeasuredFile) -> tuple[str, ...]:
    return foreign(file.name), f"{file.size}", f"`{foreign(file.sha256)}`"


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
    note = (
        "Noise: standard deviation of the receptances over their size, median over lines and pairs. Reciprocity: mean "
        "square of the difference of FRFs when force and response change places over what their noise allows, 1 "
        "expected; a dash where no pair was measured both ways. Nothing is interpolated."
    )
    lines, relative = [body.frequency_hz for _, body in bodies], []
    for _, body in bodies:
        size = np.abs(body.receptance[:, *np.triu_indices(len(body.dofs))])
        sd = np.sqrt(np.diagonal(body.covariance, axis1=1, axis2=2))
        relative.append(float(np.median(sd[size > 0] / size[size > 0])))
    columns = {
        "Body": [foreign(name) for name, _ in bodies],
        "DOFs": [foreign(", ".join(body.dofs)) for _, body in bodies],
        "Lines": [f"{f.size}, {f[0]:g} to {f[-1]:g} Hz" for f in lines],
        "Noise, median (%)": [number(100 * noise, 2) for noise in relative],
        "Reciprocity": ["–" if body.discrepancy is None else number(body.discrepancy) for _, body in bodies],
    }
    table = Table.of("Measured bodies", columns, align="llrrr", note=note)
    files = tuple((foreign(name), *_file_row(file)) for name, body in bodies for file in body.files)
    listed = [Table("Files of the measured bodies", ("Body", "File", "Bytes", "SHA-256"), files)] if files else []
    return ReportSection("measured-bodies", "Measured bodies", (Paragraph(foreign(noise.sentence)), table, *listed))
