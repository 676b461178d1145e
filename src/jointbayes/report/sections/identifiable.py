"""What the data determine and what it assumes: combinations, correlations, uncertain inputs, likelihood limits."""

import math

import numpy as np

from jointbayes.phrases import NO_VALID_VALUE, Reason, listed
from jointbayes.posterior import Knowledge, Posterior
from jointbayes.posterior.decision import premises_of
from jointbayes.posterior.fisher import spread_in_words
from jointbayes.posterior.identifiability import LIMIT_LEVEL, limit_in_words
from jointbayes.posterior.knowledge import UncertainInputsRow
from jointbayes.posterior.what_decides import WhatDecides
from jointbayes.report import drawing
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import coordinate_labels, foreign, kind_of, readable
from jointbayes.report.model import Block, Figure, Paragraph, ReportSection, Table
from jointbayes.rounding import factor, interval, number, rounded_interval
from jointbayes.sampling import END_TOLERANCE

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
    dash = (
        f"A dash: draws of both signs, or a one-sided limit at {LIMIT_LEVEL}."
        if any("–" in row for row in rows)
        else ""
    )
    ratio = "rho = k12/√(k11 k22). " if any("rho" in d.quantity for d in knowledge.directions) else ""
    blocks.append(
        Table(
            "Combinations of the stiffnesses that are determined independently",
            ("Combination", "95 % interval (SI)", "Upper/lower end", "sd of its logarithm", "Verdict"),
            tuple(rows),
            note=f"Computed from the draws, best known first, with the verdicts of single stiffnesses. {ratio}{dash}",
            row_kinds=tuple(map(kind_of, verdicts)),
        )
    )
    blocks.append(_correlations(inputs.posterior))
    return ReportSection("known", "What is known, and what it assumes", tuple(blocks))


def _correlations(posterior: Posterior) -> Table:
    """Correlation of the draws, the joint's coordinates against all."""
    labels = coordinate_labels(posterior.problem)
    matrix = np.atleast_2d(np.corrcoef(posterior.theta.T))
    joint = labels[: len(posterior.problem.parametrisation.names)]
    rows = tuple((label, *(f"{matrix[i, j]:.2f}" for j in range(len(joint)))) for i, label in enumerate(labels))
    return Table(
        "Correlation of the draws",
        ("", *joint),
        rows,
        note="Near 1 or −1 the data determine a combination of the two, not each by itself.",
    )


def freed_blocks(knowledge: Knowledge) -> list[Block]:
    """The effect of uncertain inputs: a sentence and the table, whose first row is the run."""
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
    """Each uncertain input alone: which matters most, and a table, the spread of each stiffness with it."""
    rows = [("none", decides.exact), *((readable(name), sd) for name, sd in decides.alone.items())]
    rows += [("all of these", decides.together)]
    names = tuple(decides.exact)
    table = Table(
        "Effect of one uncertain input at a time",
        ("Uncertain besides the joint", *(f"{name} known to" for name in names)),
        tuple((what, *(spread_in_words(sd[name]) for name in names)) for what, sd in rows),
        note="95 %, linearised at the mode by Fisher information; the input that matters most first.",
        align="l" * (1 + len(names)),
    )
    return [Paragraph(decides.sentence), table]


def range_sentences(knowledge: Knowledge) -> tuple[str, ...]:
    """Where the range of a prior decides a verdict, and by how much: as the run has it, and of the last row."""
    found = {}
    for row in knowledge.freed[:1] + knowledge.freed[-1:]:
        for name, known in row.known.items():
            if known.cls != "no verdict" and any(because.reason in _OF_RANGE for because in known.reasons):
                where = f"With {listed(row.uncertain)} uncertain" if row.uncertain else "With all else certain"
                found[where, name] = f"{where} the prior decides on {name}: {known.because}."
    return (" ".join(found.values()),) if found else ()


def likelihood_section(inputs: ReportInputs) -> ReportSection | None:
    """Likelihood-ratio limits, which are no credible intervals; None where no residual depends on a coordinate."""
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
    blocks: tuple[Block, ...] = (
        Paragraph(
            "The data can still be fitted up to these confidence limits with all else adjusted, however few joints fit "
            f"so well. One end alone is a limit at {LIMIT_LEVEL}."
        ),
        Table(
            "Likelihood-ratio limits at 95 %",
            ("Parameter", "Lower limit", "Upper limit", "95 % credible interval (draws)"),
            tuple(rows),
            note=f"{none}Units as above{units}.",
        ),
        Figure(
            "profiles",
            "Profile likelihood: the best fit for each value of a parameter, as ln of its ratio to the best of all; "
            "dashed, the limit at 95 %.",
            f"Profile likelihood of {', '.join(p.name for p in knowledge.profiles)}.",
            drawing.in_rows(drawing.draw_profiles, [p.on_axis for p in knowledge.profiles], **drawing.PROFILES),
        ),
    )
    return ReportSection("likelihood", "Likelihood-ratio limits", blocks)
