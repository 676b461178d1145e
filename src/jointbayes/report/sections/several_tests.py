"""Several tests: a table of all, what is said of the data of each, and quantities over their levels."""

import math
from collections.abc import Sequence
from dataclasses import replace

from jointbayes.posterior.curves import Curve, curves_of
from jointbayes.report import drawing
from jointbayes.report.inputs import ReportInputs, TestInputs
from jointbayes.report.markup import foreign, kind_of
from jointbayes.report.model import Block, Figure, Paragraph, ReportSection, Table
from jointbayes.rounding import interval, number
from vibrecords.arrays import Array

_OF_NOISE = "Standard deviations are those of the noise, of the fit of the modes or as stated for them."


def overview_section(inputs: ReportInputs) -> ReportSection | None:
    """A row for each test: its data, and whether the model explains them; None of a lone test."""
    if len(inputs.tests) == 1:
        return None
    levels = [test.summary.level for test in inputs.tests if test.summary.level is not None]
    rows = []
    for test in inputs.tests:
        fit, check = test.summary.fit, test.summary.check
        data = test.problem.test.data.in_short(foreign)
        data += "" if test.problem.test.joints.size else "; nothing joined"
        row = [foreign(test.problem.test.name), data, str(fit.n_data), number(math.sqrt(fit.chi2_per_line))]
        row.append("yes" if check.explains else "no")
        if levels:
            level = test.summary.level
            row.insert(1, "–" if level is None else number(level.value))
        rows.append(tuple(row))
    head = ["Test", "Data", "Values", "Misfit over noise", "Explained"]
    if levels:
        unit = f" ({levels[0].unit})" if levels[0].unit else ""
        head.insert(1, foreign(f"{levels[0].name.capitalize()}{unit}"))
    note = (
        "Misfit over noise: of the best fit to all tests, about 1 expected. Explained: whether the model explains "
        "its data. A quantity whose name begins with a test's is its own; all others are one for all."
    )
    kinds = tuple("" if test.summary.check.explains else "bad" for test in inputs.tests)
    table = Table("Tests", tuple(head), tuple(rows), note=note, row_kinds=kinds)
    return ReportSection("tests", "Tests", (table, *_equality(inputs)))


def _equality(inputs: ReportInputs) -> list[Block]:
    """Whether tests of one structure measured the same, and how far each mode moves."""
    blocks: list[Block] = []
    for each in inputs.summary.homogeneity:
        blocks.append(Paragraph(foreign(each.sentence)))
        rows = tuple(
            (
                number(mode.frequency_hz, 5),
                f"{mode.frequency_percent:+.2g}",
                number(mode.frequency_percent_sd, 2),
                *((number(100 * ratio) for ratio in mode.damping_ratio) if mode.damping_ratio else ("–", "–")),
                number(mode.damping_factor),
                number(mode.damping_percent_sd, 2),
            )
            for mode in each.modes
        )
        if rows:
            head = ("Mode (Hz)", "Moves by (%)", "sd (%)", "Damping ratio (%)", "then (%)", "Factor", "sd (%)")
            title = foreign(f"Modes of {each.first}, and how far they move to {each.second}")
            blocks.append(Table(title, head, rows, note=_OF_NOISE))
    return blocks


def section_of_test(place: int, inputs: TestInputs, sections: Sequence[ReportSection]) -> ReportSection:
    """What the sections on the data say of one test, one after the other."""
    blocks: list[Block] = []
    for section in sections:
        blocks.append(Paragraph(f"**{section.title}.**"))
        blocks += (
            replace(b, identifier=f"test-{place}-{b.identifier}") if isinstance(b, Figure) else b
            for b in section.blocks
        )
    return ReportSection(f"test-{place}", f"Test {foreign(inputs.problem.test.name)}", tuple(blocks))


def curve_section(inputs: ReportInputs) -> ReportSection | None:
    """A table and a figure for each quantity that is each test's own; None where tests have no levels."""
    curves = curves_of(inputs.posterior)
    if not curves:
        return None
    of = curves[0].of
    blocks: list[Block] = []
    for i, curve in enumerate(curves, 1):
        blocks.append(Paragraph(foreign(curve.sentence)))
        blocks += [_table(inputs, curve), _figure(i, curve)]
    damping = inputs.posterior.problem.parametrisation.damped
    what = "Stiffness and damping" if damping else "Stiffness"
    return ReportSection("curve", foreign(f"{what} over the {of.name}"), tuple(blocks))


def _axis(curve: Curve) -> str:
    return foreign(f"{curve.of.name.capitalize()}{f' ({curve.of.unit})' if curve.of.unit else ''}")


def _table(inputs: ReportInputs, curve: Curve) -> Table:
    rows, kinds = [], []
    for i, (test, name) in enumerate(zip(curve.tests, curve.quantities, strict=True)):
        assessment = inputs.summary.parameters[name].known
        verdict = assessment.words
        ends = interval((curve.low[i], curve.high[i]))
        rows.append((number(curve.level[i]), foreign(test), number(curve.median[i]), ends, curve.unit, verdict))
        kinds.append(kind_of(verdict))
    head = (_axis(curve), "Test", "Median", "95 % credible interval", "Unit", "Verdict")
    return Table(foreign(f"{curve.name} at each level"), head, tuple(rows), row_kinds=tuple(kinds))


def _figure(place: int, curve: Curve) -> Figure:
    caption = f"{curve.name} over the {curve.of.name}: median and 95 % credible interval at each level."
    ends = [number(curve.median[0]), number(curve.median[-1])]
    alt = f"{curve.name} from {ends[0]} at the lowest level to {ends[1]} at the highest."
    svg = drawing.draw_alone(drawing.draw_level_curve, *curve_values(curve), height=3.0)
    return Figure(f"curve-{place}", foreign(caption), foreign(alt), svg)


def curve_values(curve: Curve) -> tuple[Array, Array, Array, Array, str, str]:
    """Levels, median and interval at each, and the labels of both axes."""
    unit = "" if curve.unit == "1" else f" ({curve.unit})"
    return curve.level, curve.median, curve.low, curve.high, _axis(curve), f"{curve.name}{unit}"
