"""Several set-ups: a table of all, and what is said of the data of each."""

from collections.abc import Sequence
from dataclasses import replace

from jointbayes.measurement import FrfMeasurement, Measurement
from jointbayes.posterior.rounding import number
from jointbayes.report.inputs import ReportInputs, SetupInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Block, Figure, Paragraph, Section, Table
from jointbayes.report.sections.measurement import mode_table

_MOST_DOFS = 6  # of the outputs and inputs of a set-up, in a table


def overview_section(inputs: ReportInputs) -> Section:
    """A row for each set-up: its data, and whether the model explains them."""
    levels = [one.said.level for one in inputs.setups if one.said.level is not None]
    rows = []
    for one in inputs.setups:
        fit, check = one.said.fit, one.said.check
        row = [foreign(one.part.setup), _data(one.part.measurement), str(fit.n_data), number(fit.chi2_per_line, 4)]
        row.append("yes" if check.explains else "no")
        if levels:
            level = one.said.level
            row.insert(1, "–" if level is None else number(level.value))
        rows.append(tuple(row))
    head = ["Set-up", "Data", "Values", "Squared residual", "Explained"]
    if levels:
        unit = f" ({levels[0].unit})" if levels[0].unit else ""
        head.insert(1, foreign(f"{levels[0].name.capitalize()}{unit}"))
    note = (
        "Squared residual: at the MAP, over what the stated noise predicts, 1 expected. Explained: whether the "
        "posterior predictive check of its data is passed. A quantity whose name begins with that of a set-up is its "
        "own; all others are one for all."
    )
    kinds = tuple("" if one.said.check.explains else "bad" for one in inputs.setups)
    table = Table("Set-ups", tuple(head), tuple(rows), note=note, row_kinds=kinds)
    return Section("setups", "Set-ups", (table,))


def _data(measured: Measurement) -> str:
    if not isinstance(measured, FrfMeasurement):
        return f"{measured.frequency_hz.size} natural frequencies"
    frf, f = measured.frf, measured.frf.frequency_hz
    pairs = f"{_dofs(frf.outputs)} / {_dofs(frf.inputs)}"
    return f"{frf.quantity} {foreign(pairs)}, {f.size} lines to {f[-1]:g} Hz"


def _dofs(labels: Sequence[str]) -> str:
    more = f" and {len(labels) - _MOST_DOFS} more" if len(labels) > _MOST_DOFS else ""
    return ", ".join(labels[:_MOST_DOFS]) + more


def setup_section(place: int, inputs: SetupInputs, sections: Sequence[Section]) -> Section:
    """What the sections on the data say of one set-up, one after the other."""
    blocks: list[Block] = list(mode_table(inputs))
    for section in sections:
        blocks.append(Paragraph(f"**{section.title}.**"))
        blocks += (_of_setup(place, block) for block in section.blocks)
    return Section(f"setup-{place}", f"Set-up {foreign(inputs.part.setup)}", tuple(blocks))


def _of_setup(place: int, block: Block) -> Block:
    """A block whose figure has a name of its own."""
    return replace(block, identifier=f"setup-{place}-{block.identifier}") if isinstance(block, Figure) else block
