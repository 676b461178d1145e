"""The report of a campaign and its numbers, each file whole, beside the cases that they are about."""

import csv
import io
import os
import unicodedata
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from jointbayes.joint import Coordinate
from jointbayes.posterior import package_versions
from jointbayes.posterior.identifiability import CERTAINTY, NO_VALID_VALUE
from jointbayes.report import Report
from jointbayes.report.canvas import legend_above, margin_labels, panels, svg
from jointbayes.report.line_plot import SERIES_COLOURS
from jointbayes.report.markup import foreign, format_numbers
from jointbayes.report.methods import report_text
from jointbayes.report.model import Block, Callout, Figure, Paragraph, ReportSection, Table
from jointbayes.report.run_directory import json_text, write_into
from jointbayes.rounding import engineering, interval, join_unit, json_ready, number
from jointbayes.studies.campaign.campaign_findings import (
    FALSE_ALARM,
    FEWEST_JOINTS,
    OTHER_KIND,
    CampaignFindings,
    ComparedQuantity,
    PopulationFindings,
    examine_campaign,
)
from jointbayes.studies.campaign.hierarchical import LEAST_EFFECTIVE, PopulationStiffness
from jointbayes.studies.campaign.index import DONE, CaseRow
from vibrecords.arrays import Array
from vibrecords.errors import printable

_MOST_LABELLED = 40  # joints that a figure names
_STRETCHES = 300  # of ranks, where there are more joints
_BINS = 40
_BLUE = SERIES_COLOURS[0]


def _value_axis(axis: Axis, set_scale: Callable[[str], None], quantity: ComparedQuantity) -> None:
    """An axis of values: logarithmic with plain labels at 1, 2 and 5 where the quantity is."""
    if not quantity.logarithmic:
        axis.set_major_locator(MaxNLocator(6))
        return
    set_scale("log")
    axis.set_major_locator(_RoundValues())
    axis.set_major_formatter(FuncFormatter(lambda value, _: format_numbers(number(value, 3))))
    axis.set_minor_formatter(NullFormatter())


class _RoundValues(MaxNLocator):
    """Round values on an axis: on a logarithmic one 1, 2, 5 of each decade, evenly spaced ones within less than 5."""

    def __init__(self, logarithmic: bool = True, most: int | None = None) -> None:
        super().__init__(5 if most is None else most - 1)
        self._logarithmic, self._most = logarithmic, most

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        low, high = sorted((vmin, vmax))
        if not self._logarithmic or low <= 0 or high / low < 5:
            return list(super().tick_values(low, high))
        decades = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
        steps = [1.0, 2.0, 5.0] if len(decades) < 5 else [1.0]
        ticks = [float(10.0**decade * step) for decade in decades for step in steps]
        if self._most is None:
            return ticks
        inside = [tick for tick in ticks if low <= tick <= high]
        return inside[:: max(1, -(-len(inside) // self._most))]


def ranking_figure(quantity: ComparedQuantity, labels: Sequence[str]) -> str:
    """All joints from the softest up, each given all the others, with its 95 % interval; named where they have room."""
    order = np.argsort(quantity.shrunken[:, 1])
    ends = quantity.shrunken[order]
    if len(order) > _MOST_LABELLED:
        return _ranked_curve(quantity, ends)

    def draw(canvas: Canvas) -> None:
        named, margin = margin_labels([labels[i] for i in order])
        axes = panels(canvas, left=margin)[0, 0]
        place = np.arange(len(order))
        axes.hlines(place, ends[:, 0], ends[:, 2], color=_BLUE, lw=1.2)
        axes.plot(ends[:, 1], place, "o", ms=4, color=_BLUE)
        axes.set_yticks(place, named, fontsize=7)
        axes.set_ylim(-0.6, len(order) - 0.4)
        _value_axis(axes.xaxis, axes.set_xscale, quantity)
        axes.set_xlabel(quantity.label + quantity.in_unit)

    return svg(draw, 7.2, 0.8 + 0.16 * len(order))


def _ranked_curve(quantity: ComparedQuantity, ends: Array) -> str:
    def draw(canvas: Canvas) -> None:
        axes = panels(canvas, left=1.05, top=0.3)[0, 0]
        groups = np.array_split(np.arange(len(ends)), min(_STRETCHES, len(ends)))
        place = [group.mean() + 1 for group in groups]
        low, middle, high = np.array([ends[group].mean(axis=0) for group in groups]).T
        axes.fill_between(place, low, high, color=_BLUE, alpha=0.25, lw=0, label="95 % interval")
        axes.plot(place, middle, color=_BLUE, lw=1.2, label="median given all joints")
        axes.set_xlim(1, len(ends))
        axes.set_xlabel("Rank of the median")
        _value_axis(axes.yaxis, axes.set_yscale, quantity)
        axes.set_ylabel(quantity.label + quantity.in_unit)
        legend_above(axes)

    return svg(draw, 7.2, 2.4)


def population_figure(
    quantities: Sequence[ComparedQuantity], curves: Sequence[tuple[Array, Array, Array, Array]]
) -> str:
    """Estimates of the joints by themselves, and the population's density with its 95 % band, side by side.

    Each curve is abscissa on the scale of the spread and lower, middle and upper density there.
    """

    def draw(canvas: Canvas) -> None:
        row = panels(canvas, columns=len(quantities), left=0.35, top=0.3, apart=(0.1, 0.25))[0]
        for axes, quantity, (x, low, middle, high) in zip(row, quantities, curves, strict=True):
            value = quantity.spread.value
            edges = np.linspace(x[0], x[-1], min(_BINS, max(8, int(2 * np.sqrt(len(value)))) + 1))
            count, _ = np.histogram(np.clip(value, x[0], x[-1]), edges)
            height = count / (len(value) * (edges[1] - edges[0]))
            for (left, right), top in zip(pairwise(quantity.value_in_unit(edges)), height, strict=True):
                axes.fill([left, left, right, right], [0, top, top, 0], color="0.8", lw=0)
            at = quantity.value_in_unit(x)
            axes.fill_between(at, low, high, color=_BLUE, alpha=0.3, lw=0)
            axes.plot(at, middle, color=_BLUE, lw=1.2)
            _value_axis(axes.xaxis, axes.set_xscale, quantity)
            axes.xaxis.set_major_locator(_RoundValues(quantity.logarithmic, 4))
            axes.set_xlim(at[0], at[-1])
            axes.set_ylim(0, 1.4 * max(float(height.max()), float(middle.max())))
            axes.set_yticks([])
            axes.set_xlabel(quantity.label + quantity.in_unit)
        row[0].fill([], [], color="0.8", label="joints by themselves")
        row[0].plot([], [], color=_BLUE, label="population")
        row[0].legend(ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)

    return svg(draw, 7.4, 2.4)


_MOST_LOOKS = 40
_RANKED = 6  # from either end of a ranking
_MOST_JOINTS = 30  # in the table of joints
_MOVED = 15  # joints in it where there are more
_MOST_ROWS = 120  # in the table of every joint
_LONGEST = 160  # characters of a label
_NOISY = 0.3  # Monte Carlo error in posterior sd that is said aloud
_MOST_NAMED = 12
_MOST_SAID = 3  # stiffnesses in the first sentence


def campaign_lead(findings: CampaignFindings) -> tuple[Block, ...]:
    """Verdict first: what became of the cases, what the population is, what to look at."""
    counts, joints = findings.counts, findings.joints
    whole = counts[DONE] == counts["cases"] and not counts["not converged"]
    not_done = Counter(row.status for row in findings.rows if row.status != DONE)
    parts = [f"{counts[DONE]} of {counts['cases']} cases are done"]
    parts += [f"{count} {foreign(status)}" for status, count in not_done.items()]
    if counts["not converged"]:
        parts.append(f"{counts['not converged']} of those done did not converge")
    answer = campaign_answer(findings)
    blocks: list[Block] = [Callout("good" if whole else "caution", f"**{foreign(answer)}** {', '.join(parts)}.")]
    if counts["do not explain their data"]:
        blocks.append(
            Callout(
                "caution" if 2 * counts["do not explain their data"] < counts[DONE] else "bad",
                f"**In {counts['do not explain their data']} of {counts[DONE]} cases the model does not explain the "
                "data.** They are part of the population; their own intervals have no valid value.",
            )
        )
    blocks += _every_joint(findings)
    if joints is None:
        return (*blocks, Callout("caution", _why_no_population(findings)))
    if OTHER_KIND in findings.left_out.values():
        blocks.append(Callout("caution", f"**Not in the population.** {_left_out(findings)}"))
    if not joints.population.converged:
        worth = f"worth {joints.population.effective_populations:.0f} independent draws"
        text = f"by {joints.population.how}, {worth}. What is said of the single joints holds"
        head = "**The population has NOT converged, do not use its numbers**, nor those of joints given all the others:"
        blocks.append(Callout("bad", f"{head} {text}."))
    blocks.append(_population_table(joints))
    named = [f"{q.name}: {_named(joints, q.outlier)}" for q in joints.quantities if q.outlier.any()]
    if named:
        blocks.append(Callout("caution", f"**Outliers.** {'; '.join(named)}. They are part of the population."))
    noisy = float(joints.population.monte_carlo.max())
    if noisy > _NOISY:
        blocks.append(
            Callout(
                "caution",
                "**The population is known less well than its intervals say:** with so few draws of each joint its "
                f"numbers scatter by {number(noisy, 2)} of their standard deviation. Keep more draws of each case.",
            )
        )
    return tuple(blocks)


def campaign_answer(findings: CampaignFindings) -> str:
    """How stiff the joints are, how far they scatter and which stand out, in a sentence or two."""
    joints = findings.joints
    if joints is None or not joints.population.converged:
        known = [row for row in findings.rows if row.stiffness and row.status == DONE]
        said = [_range_of(name, known) for name in dict.fromkeys(name for row in known for name in row.stiffness)]
        more = [f"and {len(said) - _MOST_SAID} more stiffnesses"] if len(said) > _MOST_SAID else []
        return f"{len(known)} joints, each by itself: {', '.join([*said[:_MOST_SAID], *more]) or 'nothing is known'}."
    unresolved, said = {axis.quantity for axis in joints.unresolved}, []
    for k in joints.stiffness[:_MOST_SAID]:
        (median, low, high), unit = engineering(k.median.tolist(), k.unit)
        scatter = _scatter_text(k, resolved=k.name not in unresolved)
        said.append(f"{k.name} {median} ({low} to {high}) {unit}, scatter {scatter}")
    odd = dict.fromkeys(_named(joints, q.outlier) for q in joints.quantities if q.outlier.any())
    outliers = f"Outliers: {', '.join(odd)}." if odd else "No joint stands out."
    return f"{len(joints.draws.rows)} joints: {'; '.join(said)}. {outliers}"


def _range_of(name: str, rows: Sequence[CaseRow]) -> str:
    """Medians of one stiffness from the smallest to the largest, of joints that know it; what is known else."""
    estimates = [row.stiffness[name] for row in rows if name in row.stiffness]
    known = sorted(e.median for e in estimates if e.verdict in CERTAINTY)
    if not known:
        return f"{name} known of none of them"
    (_, *ends), unit = engineering((known[-1], known[0], known[-1]), estimates[0].unit)
    span = join_unit(" to ".join(dict.fromkeys(ends)), unit)
    return f"{name} {span}{'' if len(known) == len(estimates) else f' (known of {len(known)})'}"


def campaign_sections(findings: CampaignFindings) -> tuple[ReportSection, ...]:
    """The body of the report."""
    joints = findings.joints
    if joints is None:
        return (_look_section(findings),)
    of_joints = (_population_section, _outlier_section, _ranking_section, _joint_section, _method_section)
    return (_look_section(findings), *(section(joints) for section in of_joints))


def _every_joint(findings: CampaignFindings) -> tuple[Table, ...]:
    """Each stiffness of each joint by itself, as its own report prints it; none where no case is done."""
    rows, kinds, known = [], [], [row for row in findings.rows if row.stiffness and row.status == DONE]
    shown = known[: max(1, _MOST_ROWS // max((len(row.stiffness) for row in known), default=1))]
    for row in shown:
        for name, estimate in row.stiffness.items():
            median, between, unit = estimate.row
            right = row.explains is not False or estimate.verdict in ("not identified", "no verdict")
            verdict = (estimate.words or estimate.verdict) if right else NO_VALID_VALUE
            rows.append((foreign(_cut(row.label)), foreign(name), median, between, unit, verdict))
            kinds.append("" if row.converged and right else "bad")
    if not rows:
        return ()
    more = f"The first {len(shown)} of {len(known)}; `joints.csv` has all. " if len(shown) < len(known) else ""
    note = f"{more}Each joint from its own test alone, in the order of the table."
    caption = "Stiffness of every joint" if not more else "Stiffness of the joints"
    head = ("Joint", "Stiffness", "Median", "95 % interval", "Unit", "Verdict")
    return (Table(caption, head, tuple(rows), align="llrlll", note=note, row_kinds=tuple(kinds)),)


def _why_no_population(findings: CampaignFindings) -> str:
    """Which cases are left out of the population and why, and how many it needs."""
    counts = findings.counts
    fit = counts[DONE] - counts["not converged"] - len(findings.left_out)
    text = f"**No population of these joints.** It needs {FEWEST_JOINTS} joints that are done and converged"
    return f"{text}; found {fit}. {_left_out(findings)}".strip()


def _left_out(findings: CampaignFindings) -> str:
    """Reasons with which cases have no part in the population, and how many have each."""
    reasons = Counter(findings.left_out.values()).most_common(_MOST_NAMED)
    return " ".join(f"Left out {_cases(count)}: {foreign(reason)}." for reason, count in reasons)


def _cases(count: int) -> str:
    return f"{count} case{'s' if count > 1 else ''}"


def _named(joints: PopulationFindings, chosen: NDArray[np.bool_]) -> str:
    labels = [foreign(_cut(joints.draws.rows[i].label)) for i in np.flatnonzero(chosen)]
    more = f" and {len(labels) - _MOST_NAMED} more" if len(labels) > _MOST_NAMED else ""
    return f"{', '.join(labels[:_MOST_NAMED])}{more}"


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


def _look_section(findings: CampaignFindings) -> ReportSection:
    looks = findings.look
    if not looks:
        return ReportSection("look", "Cases that need a look", (Paragraph("None."),))
    rows = tuple(
        (foreign(look.row.label), foreign(look.row.key), foreign("; ".join(look.reasons)))
        for look in looks[:_MOST_LOOKS]
    )
    kinds = tuple(
        "bad" if look.gravity <= 3 else "caution" if look.gravity <= 6 else "" for look in looks[:_MOST_LOOKS]
    )
    more = len(looks) - len(rows)
    note = "The gravest first. What holds for most cases is no reason here."
    if more > 0:
        note += f" {more} more are in `joints.csv`."
    table = Table("Cases that need a look", ("Joint", "Case", "Why"), rows, align="lll", note=note, row_kinds=kinds)
    return ReportSection("look", "Cases that need a look", (table,))


def _population_table(joints: PopulationFindings) -> Table:
    unresolved = {axis.quantity for axis in joints.unresolved}
    head = ("Stiffness", "Unit", "Median of the population", "95 % of joints lie within", "Scatter")
    rows = []
    for k in joints.stiffness:
        (median, low, high, *between), unit = engineering((*k.median, k.low95[0], k.high95[0]), k.unit)
        scatter = _scatter_text(k, resolved=k.name not in unresolved)
        rows.append((k.name, unit, f"{median} ({low} to {high})", " to ".join(between), scatter))
    note = (
        f"From {len(joints.draws.rows)} joints, with the scatter of measurement taken out. In brackets: 95 % intervals."
        " Scatter is the standard deviation from joint to joint, in percent of ln k."
    )
    if unresolved:
        note += " Where joints differ by less than the measurement error only an upper limit can be given (97.5 %)."
    return Table("The population of joints", head, tuple(rows), align="lllll", note=note)


def _scatter_text(k: PopulationStiffness, *, resolved: bool) -> str:
    if not k.logarithmic:
        middle, ends, most = k.scatter[0], interval(k.scatter[1:].tolist(), 2), k.scatter[2]
        return f"{number(middle, 2)} {k.unit} ({ends})" if resolved else f"below {number(most, 2)} {k.unit}"
    middle, low, high = (number(100 * value, 2) for value in k.scatter)
    return f"{middle} % ({low} to {high} %)" if resolved else f"below {high} %"


def _population_section(joints: PopulationFindings) -> ReportSection:
    names = joints.draws.parametrisation.names
    shown = [q for q in joints.quantities if q.name in names]
    figure = Figure(
        "population",
        "Estimates of the joints, each by itself (grey), and the population (line with its 95 % band). Grey is wider "
        "than the line by what the estimates' own errors add.",
        f"Distribution of {len(joints.draws.rows)} joints over {', '.join(q.label for q in shown)}.",
        population_figure(shown, [_density(joints, q) for q in shown]),
    )
    head = ("Coordinate", "Mean", "Scatter", "Prior of the mean", "Prior of the scatter", "Monte Carlo error")
    rows = tuple(_coordinate_row(joints, i, axis) for i, axis in enumerate(joints.draws.parametrisation.axes))
    table = Table("Coordinates", head, rows, note=report_text("coordinates"))
    return ReportSection("population-section", "The population", (figure, table))


def _coordinate_row(joints: PopulationFindings, i: int, axis: Coordinate) -> tuple[str, ...]:
    population, prior = joints.population, joints.prior
    mean, scatter = (np.quantile(values[:, i], [0.5, 0.025, 0.975]) for values in (population.mean, population.scatter))
    return (
        axis.label,
        f"{number(mean[0], 5)} ({interval(mean[1:].tolist(), 5)})",
        f"{number(scatter[0])} ({interval(scatter[1:].tolist())})",
        f"{number(prior.mean[i])} ± {number(prior.sd[i])}",
        f"0 ± {number(prior.scale[i])}",
        f"{number(population.monte_carlo[0, i], 2)}, {number(population.monte_carlo[1, i], 2)}",
    )


def _density(joints: PopulationFindings, quantity: ComparedQuantity) -> tuple[Array, Array, Array, Array]:
    """Abscissa on the scale of the spread and the population's density there: 2.5, 50 and 97.5 %."""
    i = joints.draws.parametrisation.names.index(quantity.name)
    mean, scatter = joints.population.mean[:, i], joints.population.scatter[:, i]
    value = quantity.spread.value
    middle, reach = float(np.median(mean)), 4 * float(np.median(scatter))
    low, high = np.quantile(value, [0.005, 0.995])
    low, high = min(low, middle - reach), max(high, middle + reach)
    x = np.linspace(low, high, 121)
    z = (x - mean[:, None]) / scatter[:, None]
    density = np.exp(-0.5 * z**2) / (scatter[:, None] * np.sqrt(2 * np.pi))
    return (x, *np.quantile(density, [0.025, 0.5, 0.975], axis=0))


def _outlier_section(joints: PopulationFindings) -> ReportSection:
    head = ("Quantity", "Median of the joints", "Scatter", "Outliers")
    rows = []
    for q in joints.quantities:
        centre = f"{number(float(q.value_in_unit(np.array(q.spread.centre))))}{'' if q.unit == '1' else f' {q.unit}'}"
        scatter = f"{number(100 * q.spread.scatter, 2)} %" if q.logarithmic else number(q.spread.scatter, 2)
        rows.append((q.label, centre, scatter, str(int(q.outlier.sum()))))
    limit = joints.quantities[0].outlier_limit
    note = "Scatter by medians, without what the joints' own errors add, in percent of ln k. "
    if np.isfinite(limit):
        note += report_text("outliers", limit=limit, count=len(joints.draws.rows), share=100 * FALSE_ALARM)
    else:
        note += "There are too few joints to call one of them an outlier."
    return ReportSection("outliers", "Outliers", (Table("Outliers", head, tuple(rows), note=note),))


def _ranking_section(joints: PopulationFindings) -> ReportSection:
    labels = [row.label for row in joints.draws.rows]
    count = len(labels)
    blocks: list[Block] = [
        Paragraph(
            "Every joint given all the others, from the softest up. Where intervals of neighbours overlap their order "
            "is not known: the rank has a 95 % credible interval of its own."
        )
    ]
    for q in joints.quantities:
        order = np.argsort(q.shrunken[:, 1])
        chosen = order if count <= 2 * _RANKED + 1 else np.concatenate([order[:_RANKED], order[-_RANKED:]])
        rows = tuple(_rank_row(q, labels[i], i, int(np.flatnonzero(order == i)[0]) + 1) for i in chosen)
        head = ("Place", "Joint", f"{q.name}{q.in_unit}", "95 % credible interval", "Rank, 95 %")
        shown = "" if len(chosen) == count else f": the {_RANKED} lowest and the {_RANKED} highest of {count}"
        ends = [foreign(_cut(labels[order[i]])) for i in (0, -1)]
        figure = Figure(
            f"ranking-{q.name}",
            f"Joints by {q.label}, each given all the others, with 95 % credible intervals.",
            f"{count} joints by {q.label}, from {ends[0]} to {ends[1]}.",
            ranking_figure(q, labels),
        )
        blocks += [figure, Table(f"Ranking by {q.label}{shown}", head, rows, align="rlrrr")]
    return ReportSection("ranking", "Ranking", tuple(blocks))


def _rank_row(q: ComparedQuantity, label: str, i: int, place: int) -> tuple[str, ...]:
    low, median, high = q.shrunken[i]
    return (
        str(place),
        foreign(_cut(label)),
        number(median),
        interval((low, high)),
        f"{q.rank[i, 0]:.0f} to {q.rank[i, 2]:.0f}",
    )


def _joint_section(joints: PopulationFindings) -> ReportSection:
    """Estimates with and without the others: of all joints, or of those that the others move the most."""
    count, rows = len(joints.draws.rows), joints.draws.rows
    moved = np.max([np.abs(_moved(q)) for q in joints.quantities], axis=0)
    whole = count <= _MOST_JOINTS
    chosen = np.arange(count) if whole else np.argsort(-moved)[:_MOVED]
    head, cells = ["Joint"], [[foreign(_cut(rows[i].label)) for i in chosen]]
    for q in joints.quantities:
        head += [f"{q.name}{q.in_unit} by itself", "given all"]
        for ends in (q.unpooled, q.shrunken):
            cells.append([f"{number(ends[i, 1])} ({interval((ends[i, 0], ends[i, 2]))})" for i in chosen])
    head.append("Effective draws")
    cells.append([f"{joints.population.effective[i]:.0f}" for i in chosen])
    shown = "" if whole else f" that the others move the most, {_MOVED} of {count}"
    note = report_text("joints", least=LEAST_EFFECTIVE)
    note += "" if whole else "Every joint stands in `joints.csv`."
    kinds = tuple("" if joints.population.trusted[i] else "caution" for i in chosen)
    table = Table(f"Joints{shown}", tuple(head), tuple(zip(*cells, strict=True)), note=note, row_kinds=kinds)
    blocks: list[Block] = [table]
    untrusted = ~joints.population.trusted
    if untrusted.any():
        text = (
            f"**Reweighting is not to be trusted for {int(untrusted.sum())} of {count} joints**: too few of their "
            f"draws lie where the population is. {_named(joints, untrusted)}. More draws of these cases help."
        )
        blocks.insert(0, Callout("caution", text))
    return ReportSection("joints", "Joints with and without the others", tuple(blocks))


def _moved(q: ComparedQuantity) -> Array:
    """How far the others move a joint's median, in its own standard deviations."""
    scale = np.log if q.logarithmic else np.asarray
    return np.asarray((scale(q.shrunken[:, 1]) - q.spread.value) / q.spread.sd)


def _method_section(joints: PopulationFindings) -> ReportSection:
    axes = ", ".join(axis.label for axis in joints.draws.parametrisation.axes)
    text = report_text("campaign", axes=axes, how=joints.population.how, worth=joints.population.effective_populations)
    return ReportSection("method", "How this was computed", (Paragraph(text),))


#: Raised when a reader of the older form would misread the newer one.
SCHEMA_VERSION = 1
_INTERVAL = ("median", "low95", "high95")


def campaign_summary(name: str, findings: CampaignFindings) -> dict[str, Any]:
    """What ``summary.json`` of a campaign holds: no NaN or infinity, None where a number does not exist."""
    joints = findings.joints
    return json_ready(
        {
            "schema_version": SCHEMA_VERSION,
            "campaign": name,
            "answer": campaign_answer(findings),
            "counts": dict(findings.counts),
            "population": None if joints is None else _population(joints),
            "outliers": {} if joints is None else {q.name: _outliers(joints, q) for q in joints.quantities},
            "left_out": dict(findings.left_out),
            "need_a_look": [
                {"key": look.row.key, "serial": look.row.serial, "status": look.row.status, "reasons": look.reasons}
                for look in findings.look
            ],
            "versions": package_versions(),
        }
    )


def _population(joints: PopulationFindings) -> dict[str, Any]:
    population, prior, names = joints.population, joints.prior, joints.draws.parametrisation.names
    mean, scatter = (
        np.quantile(values, [0.5, 0.025, 0.975], axis=0).T for values in (population.mean, population.scatter)
    )
    return {
        "joints": len(joints.draws.rows),
        "parametrisation": joints.draws.parametrisation.key,
        "how": population.how,
        "converged": population.converged,
        "effective_draws": population.effective_populations,
        "stiffness": {k.name: _stiffness(k) for k in joints.stiffness},
        "coordinates": {
            name: {
                "mean": dict(zip(_INTERVAL, mean[i], strict=True)),
                "scatter": dict(zip(_INTERVAL, scatter[i], strict=True)),
                "monte_carlo_error_of_mean_sd": population.monte_carlo[0, i],
                "monte_carlo_error_of_log_scatter_sd": population.monte_carlo[1, i],
                "prior_of_mean": {"mean": prior.mean[i], "sd": prior.sd[i]},
                "prior_of_scatter_half_normal": prior.scale[i],
            }
            for i, name in enumerate(names)
        },
        "scatter_not_resolved": [axis.name for axis in joints.unresolved],
        "least_effective_draws": LEAST_EFFECTIVE,
        "not_trusted": [row.key for row, good in zip(joints.draws.rows, population.trusted, strict=True) if not good],
    }


def _stiffness(k: PopulationStiffness) -> dict[str, Any]:
    return {
        "unit": k.unit,
        "median": dict(zip(_INTERVAL, k.median, strict=True)),
        "low_end_of_95_percent_of_joints": dict(zip(_INTERVAL, k.low95, strict=True)),
        "high_end_of_95_percent_of_joints": dict(zip(_INTERVAL, k.high95, strict=True)),
        "scatter_of": "ln k" if k.logarithmic else k.unit,
        "scatter": dict(zip(_INTERVAL, k.scatter, strict=True)),
    }


def _outliers(joints: PopulationFindings, quantity: ComparedQuantity) -> dict[str, Any]:
    spread, keys = quantity.spread, [row.key for row in joints.draws.rows]
    return {
        "scale": f"ln {quantity.name}" if quantity.logarithmic else quantity.name,
        "unit": quantity.unit,
        "centre": float(quantity.value_in_unit(np.array(spread.centre))),
        "scatter": spread.scatter,
        "limit_in_sd": quantity.outlier_limit,
        "probability_of_a_false_outlier_in_the_campaign": FALSE_ALARM,
        "outliers": [
            {"key": keys[i], "score": float(spread.score[i])}
            for i in np.flatnonzero(quantity.outlier)[np.argsort(-np.abs(spread.score[quantity.outlier]))]
        ],
    }


def joints_csv(findings: CampaignFindings) -> str:
    """One line for each case, in the order of the table; numbers that do not exist are empty."""
    joints = findings.joints
    place = {} if joints is None else {row.key: i for i, row in enumerate(joints.draws.rows)}
    quantities = () if joints is None else joints.quantities
    head = ["key", "serial", "date", "status", "converged", "explains", "need_a_look", "effective_draws"]
    found = {(name, k.unit): None for row in findings.rows for name, k in row.stiffness.items()}
    alone = [q for q in quantities if (q.name, q.unit) not in found]  # coordinates that are no stiffness
    for name, unit in found:
        in_unit = "" if unit == "1" else f" ({unit})"
        head += [*(f"{name}.{field}{in_unit}" for field in _INTERVAL), f"{name}.verdict"]
    head += [f"{q.name}.{field}{q.in_unit}" for q in alone for field in _INTERVAL]
    for q in quantities:
        head += [f"{q.name}.given_all.{field}{q.in_unit}" for field in _INTERVAL]
        head += [f"{q.name}.{field}" for field in ("score", "rank", "rank_low95", "rank_high95")]
    looks = {look.row.key: "; ".join(look.reasons) for look in findings.look}
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    for row in findings.rows:
        date = "" if row.date is None else row.date.isoformat(sep=" ")
        explains = "" if row.explains is None else str(row.explains).lower()
        converged = str(row.converged).lower() if row.status == DONE else ""
        line = [_no_formula(row.key), _no_formula(row.serial or ""), date, row.status, converged, explains]
        line.append(_no_formula(looks.get(row.key, "")))
        i = place.get(row.key)
        line.append("" if joints is None or i is None else f"{joints.population.effective[i]:.1f}")
        for name, unit in found:
            k = row.stiffness.get(name) if row.converged else None
            if k is None or k.unit != unit:
                line += [""] * 4
            else:
                line += [*(f"{value:.6g}" for value in (k.median, k.low95, k.high95)), k.verdict]
        if i is None:
            writer.writerow([*line, *[""] * (len(head) - len(line))])
            continue
        line += [f"{q.unpooled[i, k]:.6g}" for q in alone for k in (1, 0, 2)]
        for q in quantities:
            ends = (*q.shrunken[i, [1, 0, 2]], q.spread.score[i], *q.rank[i, [1, 0, 2]])
            line += [f"{value:.6g}" for value in ends]
        writer.writerow(line)
    return stream.getvalue()


def _no_formula(text: str) -> str:
    """Text that a spreadsheet shows and does not compute: behind an apostrophe where it begins as a formula does.

    Compatible forms count as the sign, such as the full-width ＝, and marks that do not print are escaped.
    """
    text = printable(text)
    return f"'{text}" if unicodedata.normalize("NFKC", text).lstrip().startswith(("=", "+", "-", "@")) else text


_OURS = ("population", "control-", "ranking-")  # figures of an earlier report have such names


def build_campaign_report(name: str, findings: CampaignFindings) -> Report:
    """Build the report of a campaign of this name, verdict first, from what `examine_campaign` found."""
    return Report(
        title=foreign(name) if name.casefold().startswith("campaign") else f"Campaign {foreign(name)}",
        subtitle="Stiffness of many joints, and of the population they come from",
        lead=campaign_lead(findings),
        sections=campaign_sections(findings),
    )


def write_campaign_report(directory: str | os.PathLike[str], seed: int = 1) -> Path:
    """Write the report of a campaign into its directory.

    Everything is made before the first file is replaced, and each file is whole or as it was: a campaign that is
    restarted replaces its report, one that is cut off keeps the last.

    Parameters
    ----------
    directory
        Of the campaign: ``index.jsonl`` and ``cases/*.nc``, as `jointbayes campaign` leaves them.
    seed
        Of the random numbers that the population is drawn with.

    Returns
    -------
    Path
        The directory, now with ``report.html``, ``report.pdf``, ``summary.json``, ``joints.csv`` and
        ``figures/*.svg``.

    Raises
    ------
    MeasurementError
        If there is no campaign in the directory.
    WriteError
        If a file cannot be written.
    """
    target = Path(directory)
    findings = examine_campaign(target, seed)
    name = target.resolve().name or "campaign"
    report = build_campaign_report(name, findings)
    files = {"joints.csv": joints_csv(findings), "summary.json": json_text(campaign_summary(name, findings))}
    write_into(target, report, files)
    drawn = {f"{block.identifier}.svg" for block in report.blocks() if isinstance(block, Figure)}
    for old in (target / "figures").glob("*.svg"):
        if old.name not in drawn and old.name.startswith(_OURS):
            old.unlink()
    return target
