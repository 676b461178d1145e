"""Bodies given by their measured FRFs: what was measured, how well, and what their noise does to the result."""

import numpy as np

from jointbayes.frf import MeasuredBody
from jointbayes.posterior.rounding import number
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Paragraph, Section, Table


def measured_bodies_section(inputs: ReportInputs) -> Section | None:
    """A row for each body; None where the structure is modelled throughout."""
    found = inputs.summary.measured_bodies
    if found is None:
        return None
    bodies = [
        (f"{body.name} in set-up {part.setup}" if part.setup else body.name, body)
        for part in inputs.posterior.problem.parts
        for body in part.measured_bodies
    ]
    head = ("Body", "DOFs", "Lines", "Noise, median (%)", "Reciprocity")
    note = (
        "Noise: standard deviation of the receptances over their size, median over lines and pairs. Reciprocity: mean "
        "square of the difference of FRFs when force and response change places over what their noise allows, 1 "
        "expected; a dash where no pair was measured both ways. Nothing is interpolated."
    )
    rows = tuple(_row(name, body) for name, body in bodies)
    table = Table("Measured bodies", head, rows, align="llrrr", note=note)
    files = tuple(
        (foreign(name), foreign(file.name), f"{file.size}", f"`{foreign(file.sha256)}`")
        for name, body in bodies
        for file in body.files
    )
    listed = [Table("Files of the measured bodies", ("Body", "File", "Bytes", "SHA-256"), files)] if files else []
    return Section("measured-bodies", "Measured bodies", (Paragraph(foreign(found.sentence)), table, *listed))


def _row(name: str, body: MeasuredBody) -> tuple[str, ...]:
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
