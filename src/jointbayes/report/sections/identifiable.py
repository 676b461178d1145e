"""What the data determine and what it assumes: the posterior in numbers and figures, combinations, uncertain inputs."""

import math
from collections.abc import Iterable

import numpy as np

from jointbayes.phrases import NO_VALID_VALUE, Reason, listed, published_values
from jointbayes.posterior import Knowledge, Posterior
from jointbayes.posterior.decision import premises_of
from jointbayes.posterior.fisher import spread_in_words
from jointbayes.posterior.identifiability import LIMIT_LEVEL, limit_in_words
from jointbayes.posterior.knowledge import UncertainInputsRow
from jointbayes.posterior.posterior import region_level
from jointbayes.posterior.sampled import prior_stiffness
from jointbayes.posterior.summary import Summary
from jointbayes.posterior.what_decides import WhatDecides
from jointbayes.report import drawing
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import coordinate_labels, foreign, kind_of, readable
from jointbayes.report.model import Block, Figure, Paragraph, ReportSection, Table
from jointbayes.rounding import contraction, factor, fixed, interval, number, rounded_interval
from jointbayes.sampling import END_TOLERANCE
from vibrecords.arrays import Array

_MOST_IN_CORNER = 6  # coordinates of a figure in which each can be read


def posterior_section(inputs: ReportInputs) -> ReportSection:
    """Marginals, pairs, prior and the full table."""
    posterior, reference = inputs.posterior, inputs.reference
    blocks = list[Block]()
    labels, draws, prior, published, mode = corner_values(posterior)
    widest = np.sort(np.argsort(-draws.std(axis=0))[:_MOST_IN_CORNER])
    point = None if published is None else published[widest]
    of_widest = ([labels[i] for i in widest], draws[:, widest], prior[:, widest], point, mode[widest])
    svg = drawing.corner_plot(*of_widest)
    marks = f", reference values (green, dashed; {inputs.reference_source})" if published is not None else ""
    few = f" The {len(widest)} of {len(labels)} that are known least." if len(widest) < len(labels) else ""
    caption = "Posterior of the logarithms: marginals and pairs with contours of 39, 68 and 95 % of the draws; "
    caption += f"prior (grey, dotted), mode (orange, solid){marks}.{few}"
    alt = "Corner plot of the posterior of the joint stiffnesses with prior density, mode and reference values."
    blocks.append(Figure("corner", caption, alt, svg))
    blocks.append(Paragraph(verdict_sentences(inputs.summary, beside=inputs.knowledge.workshop is None)))
    if reference is not None:
        level = region_level(posterior, reference)
        blocks.append(Paragraph(f"The reference values {published_values(level)}."))
    return ReportSection("posterior", "Posterior", tuple(blocks))


def corner_values(posterior: Posterior) -> tuple[list[str], Array, Array, Array | None, Array]:
    """Labels of the joint's coordinates, and draws, prior draws, published values and mode in their terms."""
    parametrisation = posterior.problem.parametrisation
    scale = np.array([axis.axis_scale for axis in parametrisation.axes])
    draws, prior = (parametrisation.coordinates(k) * scale for k in (posterior.stiffness, prior_stiffness(posterior)))
    point, reference = None, None if posterior.case is None else posterior.case.reference
    if reference is not None and parametrisation.describes(reference):
        point = parametrisation.coordinates(reference) * scale
    mode = posterior.problem.prior.joint(posterior.best.theta) * scale
    return [axis.axis_label for axis in parametrisation.axes], draws, prior, point, mode


def numbers_section(inputs: ReportInputs) -> ReportSection:
    """How the numbers came out: prior, contraction and how well the chains know each."""
    stiffnesses, others = inputs.summary.parameters, inputs.summary.nuisances
    # 1. Of stiffnesses everything.
    of = stiffnesses.values()
    columns = {
        "Damping or stiffness" if inputs.posterior.problem.parametrisation.damped else "Stiffness": stiffnesses,
        "Joint mode": [number(p.mode, 4) for p in of],
        "MAP": [number(p.map, 4) for p in of],
        "Mean": [number(p.mean, 4) for p in of],
        "sd of ln k": [number(p.known.sd_log) for p in of],
        "Prior 95 %": [interval(p.prior_interval95, 2) for p in of],
        "Contraction": [contraction(p.known.contraction, 4) for p in of],
        "R̂": [fixed(p.r_hat, 4) for p in of],
        "ESS bulk": [fixed(p.ess_bulk, 0) for p in of],
        "ESS tail": [fixed(p.ess_tail, 0) for p in of],
    }
    note = "Joint mode, MAP and mean in the stiffness's unit."
    tables = [Table.of("Posterior in numbers", columns, note=f"{note} {_what_contraction_is(columns['Contraction'])}")]
    # 2. Of all else how it was drawn.
    if others:
        columns = {
            "Quantity": [foreign(readable(name)) for name in others],
            "Contraction": [contraction(n.contraction, 2) for n in others.values()],
            "R̂": [fixed(n.r_hat, 4) for n in others.values()],
            "ESS bulk": [fixed(n.ess_bulk, 0) for n in others.values()],
            "ESS tail": [fixed(n.ess_tail, 0) for n in others.values()],
        }
        note = _what_contraction_is(columns["Contraction"])
        tables.append(Table.of("Other uncertain quantities, drawn", columns, note=note))
    return ReportSection("numbers", "Posterior in numbers", tuple(tables))


def _what_contraction_is(shown: Iterable[str]) -> str:
    none = "; none where the posterior is as wide as the prior or wider" if "none" in shown else ""
    return f"Contraction: 1, all from the test; 0, all from the prior{none}."


def nuisance_section(inputs: ReportInputs) -> ReportSection | None:
    """Prior and posterior of all else that is uncertain; None where nothing is."""
    nuisances = inputs.summary.nuisances
    if not nuisances:
        return None
    of = nuisances.values()
    columns = {
        "Quantity": [foreign(readable(name)) for name in nuisances],
        "Stated": [number(n.nominal, 4) for n in of],
        "Prior 95 %": [interval(n.prior_interval95, 4) for n in of],
        "Median": [number(n.median, 4) for n in of],
        "Posterior 95 %": [interval(n.interval95, 4) for n in of],
        "Unit": [foreign(n.unit) for n in of],
    }
    table = Table.of("Other uncertain quantities", columns)
    return ReportSection("nuisances", "What else was uncertain", (table,))


def verdict_sentences(summary: Summary, *, beside: bool = True) -> str:
    """Return a sentence on each stiffness: verdict and reasons; with `beside` also the answer without exact inputs."""
    sentences = []
    for name, p in summary.parameters.items():
        reasons = [*map(str, p.known.reasons), *([p.known.next_to_it] if beside and p.known.next_to_it else [])]
        sentences.append(f"**{name}**: {p.known.words} ({'; '.join(reasons)}).")
    return " ".join(sentences)


_MOST_COLUMNS = 4
#: Reasons of a verdict where the prior decides.
_OF_RANGE = {Reason.OPEN, Reason.OPEN_BOTH, Reason.AT_BOUND}
_ROWS_OF_PAGE_ONE = 2  # the run, and everything uncertain: both answers stand there


def knowledge_section(inputs: ReportInputs) -> ReportSection:
    """Which combinations are known, correlations, and what the verdicts rest on: all of it from draws."""
    knowledge = inputs.knowledge
    blocks: list[Block] = freed_blocks(knowledge) if knowledge.freed else []
    blocks += _decides_blocks(knowledge.decides) if knowledge.decides else []
    blocks += [Paragraph(foreign(text)) for text in range_sentences(knowledge)]
    if premises := premises_of(inputs.posterior):
        blocks.insert(0, Paragraph(foreign(" ".join(premises))))
    if knowledge.bounds_sentence:
        blocks.append(Paragraph(f"**{knowledge.bounds_sentence}**"))
    blocks.append(Paragraph(f"**{knowledge.directions_sentence}**"))
    verdicts, rows = [], []
    for named in knowledge.directions:
        # what is not known is not known under any condition, as on page one; of what is bounded only the limit is said
        known = knowledge.check.explains or named.verdict in ("not identified", "no verdict")
        verdicts.append(named.verdict if known else NO_VALID_VALUE)
        cells = (limit_in_words(named.verdict, named.limit, named.unit), "–", "–")
        if not math.isfinite(named.limit):
            ends = rounded_interval(named.interval95, named.interval95_error)
            cells = (ends, factor(named.ratio), number(named.sd_log))
        rows.append((named.quantity, *cells, verdicts[-1]))
    dash = f"A dash: draws of both signs, or a one-sided limit at {LIMIT_LEVEL}." * any("–" in row for row in rows)
    ratio = "rho = k12/√(k11 k22). " if any("rho" in d.quantity for d in knowledge.directions) else ""
    title = "Combinations of the stiffnesses that are determined independently"
    head = ("Combination", "95 % interval (SI)", "Upper/lower end", "sd of its logarithm", "Verdict")
    note = f"Computed from the draws, best known first, with the verdicts of single stiffnesses. {ratio}{dash}"
    blocks.append(Table(title, head, tuple(rows), note=note, row_kinds=tuple(map(kind_of, verdicts))))
    blocks.append(_correlations(inputs.posterior))
    return ReportSection("known", "What is known, and what it assumes", tuple(blocks))


def _correlations(posterior: Posterior) -> Table:
    """Correlate the draws of the joint's coordinates with all coordinates."""
    labels = coordinate_labels(posterior.problem)
    matrix = np.atleast_2d(np.corrcoef(posterior.theta.T))
    joint = labels[: len(posterior.problem.parametrisation.names)]
    rows = tuple((label, *(f"{matrix[i, j]:.2f}" for j in range(len(joint)))) for i, label in enumerate(labels))
    note = "Near 1 or −1 the data determine a combination of the two, not each by itself."
    return Table("Correlation of the draws", ("", *joint), rows, note=note)


def freed_blocks(knowledge: Knowledge) -> list[Block]:
    """Show the effect of uncertain inputs: a sentence, and a table whose first row is the run."""
    if knowledge.workshop is not None and len(knowledge.freed) <= _ROWS_OF_PAGE_ONE:
        return []
    names = tuple(knowledge.freed[0].known)
    head = ("Uncertain besides the joint", *(f"{name}, 95 % interval" for name in names), "Verdicts", "Source")
    rows = tuple(_freed_row(row, names) for row in knowledge.freed)
    if len(names) > _MOST_COLUMNS:  # of stiffnesses side by side: then each has a row
        head, *turned = zip(head, *rows, strict=True)
        rows = tuple(turned)
    note = (
        "Each is sampled with only these quantities uncertain and all others at their stated values, until each "
        f"interval end is known to {100 * END_TOLERANCE:g} % of the interval's width, or the 2.5 % beyond it to a "
        "tenth. A dash: the draws did not converge."
    )
    lead = knowledge.freed_sentence
    if knowledge.assumed:
        lead = (
            "This case assumes that everything but the joint is exactly known. The effect of usual uncertainties "
            f"({', '.join(knowledge.assumed)}): {lead[0].lower()}{lead[1:]}"
        )
        note += " These uncertainties are assumed; state your own in [uncertain] to include them in the result."
    table = Table("Effect of uncertain inputs", head, rows, note=note, align=None)
    return [Paragraph(lead), *([table] if len(knowledge.freed) > _ROWS_OF_PAGE_ONE else [])]


def _freed_row(row: UncertainInputsRow, names: tuple[str, ...]) -> tuple[str, ...]:
    uncertain = ", ".join(readable(name) for name in row.uncertain) or "none"
    if not row.known:
        return (uncertain, *("–" for _ in names), "–", "–")
    assessments = row.known
    intervals = (assessments[name].value for name in names)
    verdicts = "; ".join(f"{name} {assessments[name].plain_words}" for name in names)
    return (uncertain, *intervals, verdicts, row.source)


def _decides_blocks(decides: WhatDecides) -> list[Block]:
    """Say which uncertain input matters most, with a table of the spread that each causes alone."""
    rows = [("none", decides.exact), *((readable(name), sd) for name, sd in decides.alone.items())]
    rows += [("all of these", decides.together)]
    names = tuple(decides.exact)
    head = ("Uncertain besides the joint", *(f"{name} known to" for name in names))
    cells = tuple((what, *(spread_in_words(sd[name]) for name in names)) for what, sd in rows)
    note = "95 %, linearised at the mode by Fisher information; the input that matters most first."
    table = Table("Effect of one uncertain input at a time", head, cells, note=note, align="l" * len(head))
    return [Paragraph(decides.sentence), table]


def range_sentences(knowledge: Knowledge) -> tuple[str, ...]:
    """Where the range of a prior decides a verdict, and by how much: as the run has it, and with most uncertain.

    A row in which the run's uncertain inputs are exact says nothing here: where they are wrong no joint fits as well.
    """
    found = {}
    for row in knowledge.freed[:1] + tuple(row for row in knowledge.freed[1:][-1:] if row.uncertain):
        for name, known in row.known.items():
            if known.cls != "no verdict" and any(because.reason in _OF_RANGE for because in known.reasons):
                where = f"With {listed(row.uncertain)} uncertain" if row.uncertain else "With all else certain"
                found[where, name] = f"{where} the prior decides on {name}: {known.because}."
    return (" ".join(found.values()),) if found else ()


def likelihood_section(inputs: ReportInputs) -> ReportSection | None:
    """Show likelihood-ratio limits, which are no credible intervals; None if no residual depends on a coordinate."""
    knowledge, summary = inputs.knowledge, inputs.summary
    if not knowledge.profiles:
        return None
    rows = []
    for profile in knowledge.profiles:
        low, high = map(profile.coordinate.value, profile.interval)
        ends = ("none" if profile.open_below else number(low), "none" if profile.open_above else number(high))
        parameter = summary.parameters.get(profile.name)
        rows.append((profile.name, *ends, interval(parameter.known.interval) if parameter else "–"))
    others = [p.coordinate for p in knowledge.profiles if p.name not in summary.parameters]
    units = "".join(f"; {axis.name} {'has none' if axis.unit == '1' else f'in {axis.unit}'}" for axis in others)
    none = "None: the data set no limit within the prior's bounds. " if any("none" in row for row in rows) else ""
    text = "The data can still be fitted up to these confidence limits with all else adjusted, however few joints fit "
    text += f"so well. One end alone is a limit at {LIMIT_LEVEL}."
    head = ("Parameter", "Lower limit", "Upper limit", "95 % credible interval (draws)")
    table = Table("Likelihood-ratio limits at 95 %", head, tuple(rows), note=f"{none}Units as above{units}.")
    caption = "Profile likelihood: the best fit for each value of a parameter, as ln of its ratio to the best of all; "
    caption += "dashed, the limit at 95 %."
    alt = f"Profile likelihood of {', '.join(p.name for p in knowledge.profiles)}."
    svg = drawing.in_rows(drawing.draw_profiles, [p.on_axis for p in knowledge.profiles], **drawing.PROFILES)
    blocks = (Paragraph(text), table, Figure("profiles", caption, alt, svg))
    return ReportSection("likelihood", "Likelihood-ratio limits", blocks)
