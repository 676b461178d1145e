"""Sections of a campaign's report: what became of the cases, the population, outliers, ranking, what needs a look."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from jointbayes.joint import Coordinate
from jointbayes.posterior.identifiability import NO_VALID_VALUE
from jointbayes.posterior.rounding import engineering, interval, number
from jointbayes.report.markup import foreign
from jointbayes.report.methods import references, report_text
from jointbayes.report.model import Block, Callout, Figure, Paragraph, ReportSection, Table
from jointbayes.studies.campaign.campaign_findings import FEWEST_JOINTS, CampaignFindings, PopulationFindings
from jointbayes.studies.campaign.charts import population_figure, ranking_figure
from jointbayes.studies.campaign.hierarchical import LEAST_EFFECTIVE, PopulationStiffness
from jointbayes.studies.campaign.index import DONE
from jointbayes.studies.campaign.joint_draws import OTHER_KIND
from jointbayes.studies.campaign.outliers import FALSE_ALARM, ComparedQuantity
from vibrecords.arrays import Array

_MOST_LOOKS = 40
_RANKED = 6  # from either end of a ranking
_MOST_JOINTS = 30  # in the table of joints
_MOVED = 15  # joints in it where there are more
_MOST_ROWS = 120  # in the table of every joint
_LONGEST = 160  # characters of a reason
_NOISY = 0.3  # Monte Carlo error in posterior sd that is said aloud
_MOST_NAMED = 12


def campaign_lead(findings: CampaignFindings) -> tuple[Block, ...]:
    """Verdict first: what became of the cases, what the population is, what to look at."""
    counts, joints = findings.counts, findings.joints
    whole = counts[DONE] == counts["cases"] and not counts["not converged"]
    not_done = Counter(row.status for row in findings.rows if row.status != DONE)
    parts = [f"{counts[DONE]} of {counts['cases']} cases are done"]
    parts += [f"{count} {foreign(status)}" for status, count in not_done.items()]
    if counts["not converged"]:
        parts.append(f"{counts['not converged']} of those done did not converge")
    blocks: list[Block] = [Callout("good" if whole else "caution", f"**{', '.join(parts)}.**")]
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
    return " ".join(f"Left out {_cases(count)}: {foreign(_cut(reason))}." for reason, count in reasons)


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
        (foreign(look.row.label), foreign(look.row.key), foreign(_cut("; ".join(look.reasons))))
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
    # stiffnesses whose coordinate has a scatter that the joints do not tell from none
    hidden = np.flatnonzero(joints.population.unresolved(joints.draws.draws))
    unresolved = {joints.draws.parametrisation.axes[i].quantity for i in hidden}
    head = ("Stiffness", "Unit", "Median of the population", "95 % of joints lie within", "Scatter")
    rows = []
    for k in joints.stiffness:
        (median, low, high, *between), unit = engineering((*k.median, k.low95[0], k.high95[0]), k.unit)
        scatter = _scatter_text(k, resolved=k.name not in unresolved)
        rows.append((k.name, unit, f"{median} ({low} to {high})", " to ".join(between), scatter))
    note = (
        f"From {len(joints.draws.rows)} joints, with the scatter of measurement taken out. In brackets: 95 % intervals."
        " Scatter is the standard deviation from joint to joint, in percent that of ln k."
    )
    if unresolved:
        note += " Where joints differ by less than the measurement error only an upper limit can be given (97.5 %)."
    return Table("The population of joints", head, tuple(rows), align="lllll", note=note)


def _scatter_text(k: PopulationStiffness, *, resolved: bool) -> str:
    if not k.logarithmic:
        middle, ends, most = k.scatter[0], interval(k.scatter[1:].tolist(), 2), k.scatter[2]
        return f"{number(middle, 2)} {k.unit} ({ends})" if resolved else f"below {number(most, 2)} {k.unit}"
    middle, low, high = (number(100 * value, 2) for value in k.scatter)
    return f"{middle} % ({low} … {high} %)" if resolved else f"below {high} %"


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
    note = "Scatter by medians, without what the joints' own errors add, in percent that of ln k. "
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
        f"{q.rank[i, 0]:.0f} … {q.rank[i, 2]:.0f}",
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
    return ReportSection("method", "How this was computed", (Paragraph(text), references(text)))
