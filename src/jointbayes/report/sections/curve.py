"""Stiffness over the levels of the set-ups."""

from jointbayes.posterior.curve import Curve, curves_of
from jointbayes.posterior.rounding import interval, number
from jointbayes.posterior.verdicts import verdict_text
from jointbayes.report import figures
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign, kind_of
from jointbayes.report.model import Block, Figure, Paragraph, Section, Table


def curve_section(inputs: ReportInputs) -> Section | None:
    """A table and a figure for each quantity that is each set-up's own; None where set-ups have no levels."""
    curves = curves_of(inputs.posterior)
    if not curves:
        return None
    of = curves[0].of
    blocks: list[Block] = []
    for i, curve in enumerate(curves, 1):
        blocks.append(Paragraph(foreign(curve.sentence)))
        blocks += [_table(inputs, curve), _figure(i, curve)]
    return Section("curve", foreign(f"Stiffness over the {of.name}"), tuple(blocks))


def _axis(curve: Curve) -> str:
    return foreign(f"{curve.of.name.capitalize()}{f' ({curve.of.unit})' if curve.of.unit else ''}")


def _table(inputs: ReportInputs, curve: Curve) -> Table:
    rows, kinds = [], []
    for i, (setup, name) in enumerate(zip(curve.setups, curve.quantities, strict=True)):
        known = inputs.summary.parameters[name].known
        verdict = verdict_text(known.verdict, if_model_right=known.if_model_right)
        ends = interval((curve.low[i], curve.high[i]))
        rows.append((number(curve.level[i]), foreign(setup), number(curve.median[i]), ends, curve.unit, verdict))
        kinds.append(kind_of(verdict))
    head = (_axis(curve), "Set-up", "Median", "95 % credible interval", "Unit", "Verdict")
    return Table(foreign(f"{curve.name} at each level"), head, tuple(rows), row_kinds=tuple(kinds))


def _figure(place: int, curve: Curve) -> Figure:
    caption = f"{curve.name} over the {curve.of.name}: median and 95 % credible interval at each level."
    ends = [number(curve.median[0]), number(curve.median[-1])]
    alt = f"{curve.name} from {ends[0]} at the lowest level to {ends[1]} at the highest."
    unit = "" if curve.unit == "1" else f" ({curve.unit})"
    drawn = figures.level_curve(curve.level, curve.median, curve.low, curve.high, _axis(curve), f"{curve.name}{unit}")
    return Figure(f"curve-{place}", foreign(caption), foreign(alt), drawn)
