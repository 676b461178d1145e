"""Page one: what was tested, the answer, whether it can be trusted, what limits it and what to do next."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from jointbayes.posterior import Posterior
from jointbayes.posterior.identifiability import (
    IDENTIFIED_RATIO,
    IF_MODEL_RIGHT,
    WEAK_RATIO,
    Identifiability,
    Verdict,
    listed,
    ratio_of,
)
from jointbayes.posterior.knowledge import RANK, quantities_taken_as_exact, uncertain_quantities
from jointbayes.posterior.prediction import sentence_of_left_out
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign, kind_of, listed_names, readable
from jointbayes.report.model import Block, Callout, Paragraph, ReportSection, Table
from jointbayes.report.sections.tested import blocks_on_tests
from jointbayes.report.sections.trust import lights_of, worst_setup
from jointbayes.rounding import engineering, factor, join_unit, number

#: Stiffnesses that are named in one sentence, of more their number is told; and reasons that page one has room for.
_MOST_NAMED, _MOST_REASONS = 6, 3
#: Ratio of an interval's ends up to which it is told as ± so many per cent.
_PERCENT_RATIO = 1.5
_WORKSHOP = "As in a workshop"
#: Verdicts as the headline has them, best first.
_SAID: dict[Verdict, str] = {
    "identified": "known", "weakly identified": "roughly known", "bounded below": "known from below",
    "bounded above": "known from above", "not identified": "not identified", "no verdict": "no value for",
}  # fmt: skip
#: What a stiffness resists, by its unit.
_MEANING = {"N/m": "deflection", "N·m/rad": "rotation", "N": "coupling", "N·s/m": "damping", "N·m·s/rad": "damping"}


@dataclass(frozen=True, slots=True)
class _Answer:
    """What is known of each stiffness under one assumption on everything else."""

    title: str
    known: Mapping[str, Identifiability]


def lead(inputs: ReportInputs) -> tuple[Block, ...]:
    """Page one, in the order in which it is asked."""
    answers = _answers(inputs)
    return (
        *_stops(inputs),
        *blocks_on_tests(inputs),
        Paragraph(f"**{_headline(answers)}**"),
        _answer_table(inputs, answers, _MOST_NAMED),
        lights_of(inputs),
        Paragraph(f"**What limits the answer.** {_limits(inputs, answers)}"),
        Paragraph(f"**Next.** {_next(inputs)}"),
    )


def answer_section(inputs: ReportInputs) -> ReportSection | None:
    """The answer on every stiffness; None where page one has them all."""
    names = inputs.posterior.stiffness_names
    if len(names) <= _MOST_NAMED:
        return None
    return ReportSection("answer", "Answer", (_answer_table(inputs, _answers(inputs), len(names)),))


def _stops(inputs: ReportInputs) -> list[Block]:
    """What forbids the use of the numbers: it stands above everything."""
    posterior, summary = inputs.posterior, inputs.summary
    if not posterior.converged:
        reason = posterior.reason.removeprefix("not converged ")
        return [Callout("bad", f"**Do not use these numbers: the calculation has not settled.** {reason}.")]
    if summary.no_verdict:
        return [Callout("bad", f"**No stiffness can be stated**: {'; '.join(summary.no_verdict)}.")]
    return []


def _answers(inputs: ReportInputs) -> list[_Answer]:
    """The answer as the run has it and, where it takes anything as exact, with all else as in a workshop."""
    problem = inputs.posterior.problem
    stated = "All else as stated" if uncertain_quantities(problem) else "All else exact"
    title = _WORKSHOP if problem.premises.assumed else stated
    run = _Answer(title, {name: p.known for name, p in inputs.summary.parameters.items()})
    workshop = inputs.knowledge.workshop
    if workshop is None:
        return [run]
    freed = _Answer(_WORKSHOP, workshop)
    # of what was measured nobody knows all else exactly, so that the workshop's is the answer and comes first
    return [run, freed] if inputs.summary.fit.synthetic_data else [freed, run]


def _headline(answers: Sequence[_Answer]) -> str:
    """Which stiffnesses are known, in one sentence for each assumption."""
    return " ".join(f"{answer.title}: {_which(answer.known)}." for answer in answers)


def _which(known: Mapping[str, Identifiability]) -> str:
    groups: dict[Verdict, list[str]] = {verdict: [] for verdict in _SAID}
    for name, each in known.items():
        certain = each.verdict in ("identified", "weakly identified") and not each.if_model_right
        verdict: Verdict = "no verdict" if each.if_model_right else each.verdict
        groups[verdict].append(f"{foreign(name)} ({_accuracy(each)})" if certain else foreign(name))
    said = [(_SAID[verdict], names) for verdict, names in groups.items() if names]
    if len(known) > _MOST_NAMED:
        return ", ".join(f"{len(names)} of {len(known)} {words}" for words, names in said)
    return "; ".join(f"{words} {listed_names(names)}" for words, names in said)


def _accuracy(known: Identifiability) -> str:
    """Half the width of the interval in per cent, or the factor that it spans."""
    ratio = ratio_of(known.ends[0])
    if ratio <= _PERCENT_RATIO:
        return f"±{number(100 * (math.sqrt(ratio) - 1), 2)} %"
    return f"its interval spans a factor of {factor(ratio)}"


def _answer_table(inputs: ReportInputs, answers: Sequence[_Answer], most: int) -> Table:
    """A row for each stiffness, of more than so many of those that are known least; the assumptions side by side."""
    unit_of, names = inputs.posterior.unit, inputs.posterior.stiffness_names
    if len(names) > most:
        first = answers[0].known
        by_need = sorted(names, key=lambda n: (-RANK.get(first[n].verdict, 9), -ratio_of(first[n].ends[0])))
        names = tuple(name for name in names if name in by_need[:most])
    rows, kinds = [], []
    for name in names:
        row = [f"**{foreign(name)}**, {_MEANING[unit]}" if (unit := unit_of(name)) in _MEANING else f"**{name}**"]
        for answer in answers:
            known = answer.known[name]
            row += [known.value, known.plain_words]
        rows.append(tuple(row))
        of_row = {kind_of(verdict) for verdict in row[2::2]}
        kinds.append(of_row.pop() if len(of_row) == 1 else "")  # no colour for two verdicts that differ
    every = len(inputs.posterior.stiffness_names)
    more = f" The {most} known least of {every}; the section on stiffness has all." if every > most else ""
    damped = inputs.posterior.problem.parametrisation.damped
    head = ["Quantity" if damped else "Stiffness"]
    for answer in answers:
        head += [answer.title, "Verdict"]
    return Table(
        "Stiffness and damping of the joint" if damped else "Stiffness of the joint",
        tuple(head),
        tuple(rows),
        note=_note(inputs, answers) + more,
        row_kinds=tuple(kinds),
        align="l" * len(head),
    )


def _note(inputs: ReportInputs, answers: Sequence[_Answer]) -> str:
    problem, knowledge = inputs.posterior.problem, inputs.knowledge
    premises = problem.premises
    words = ["Median, in brackets the 95 % interval."]
    if any(any(known.printed_by_likelihood) for answer in answers for known in answer.known.values()):
        where = ", in a workshop where it is one-sided" * (len(answers) > 1)
        words.append(f"An end that rests on the prior is given by likelihood ratio{where}.")
    assumed = premises.assumed or (knowledge.assumed if knowledge.workshop else ())
    if assumed:
        words.append(f"As in a workshop: {', '.join(assumed)}, assumed as nobody stated them.")
    uncertain = [readable(name) for name in uncertain_quantities(problem)]
    if stated := [name for name in uncertain if not any(word.startswith(f"{name} to ") for word in premises.assumed)]:
        words.append(f"Uncertain as the case states: {listed(stated)}.")
    elif len(answers) == 1 and not assumed:
        words.append("All else, such as material, dimensions and masses, is taken as exact.")
    return " ".join(words)


def _limits(inputs: ReportInputs, answers: Sequence[_Answer]) -> str:
    """What keeps the answer from being better, the most important first."""
    summary, premises = inputs.summary, inputs.posterior.problem.premises
    if not inputs.posterior.converged:
        return "The calculation: nothing can be said before it has settled."
    parts, exonerated = [], ""
    if premises.reason:
        parts.append(f"{premises.decision[0].upper()}{premises.decision[1:]}.")
    parts += [premises.asked] if premises.asked else []
    parts += inputs.posterior.unseen_inputs
    if summary.no_verdict:
        parts.append("The model: intervals of a model that misses the data are too narrow.")
    if len(answers) == 2 and (taken := quantities_taken_as_exact(inputs.knowledge.freed)):
        run, workshop = sorted(answers, key=lambda answer: answer.title == _WORKSHOP)
        worse = [n for n, k in run.known.items() if RANK[workshop.known[n].verdict] > RANK[k.verdict]]
        if worse:
            verb = "is" if len(worse) == 1 else "are"
            parts.append(f"What else is uncertain: {_more(worse)} {verb} that good only with {listed(taken)} exact.")
        else:
            exonerated = f" Not what else is uncertain: with {listed(taken)} as in a workshop no verdict is worse."
    if solutions := inputs.posterior.solutions.description:
        parts.append(foreign(solutions))
    parts += _reasons(answers[0].known, inputs.posterior)
    if summary.left_out:
        parts.append(foreign(sentence_of_left_out(summary.left_out)))
    limits = " ".join(parts) or "The noise of the measurement: more averages would narrow every interval."
    return f"{limits}{exonerated}"


def _more(names: Sequence[str]) -> str:
    return listed_names([foreign(name) for name in names[:_MOST_NAMED]]) + (" …" if len(names) > _MOST_NAMED else "")


def _reasons(known: Mapping[str, Identifiability], posterior: Posterior) -> list[str]:
    """Why stiffnesses are no better known, those of one reason together, the first few reasons."""
    by_reason: dict[str, list[str]] = {}
    for name, each in known.items():
        if each.verdict not in ("identified", "no verdict"):
            by_reason.setdefault(_reason(each, posterior.unit(name)), []).append(name)
    sentences = [f"{_more(names)}: {reason}." for reason, names in by_reason.items()]
    more = [f"And {len(sentences) - _MOST_REASONS} more."] if len(sentences) > _MOST_REASONS else []
    return [*sentences[:_MOST_REASONS], *more]


def _reason(known: Identifiability, unit: str) -> str:
    """What the verdict says, or what keeps a weakly identified stiffness from better, in engineering units."""
    reason = known.verdict_reason.removeprefix(f"{IF_MODEL_RIGHT}: ")
    if known.verdict == "weakly identified":
        reason = reason.replace(f"at most {WEAK_RATIO:g}", f"more than {IDENTIFIED_RATIO:g}")

    def in_engineering_units(found: re.Match[str]) -> str:
        (text,), prefixed = engineering((float(found[1]),), unit)
        return join_unit(text, prefixed)

    return re.sub(rf"([\d.]+(?:e\d+)?) {re.escape(unit)}(?![\w·])", in_engineering_units, reason)


def _next(inputs: ReportInputs) -> str:
    """The one step that helps most."""
    worst = worst_setup(inputs.summary)
    if not inputs.posterior.converged:
        return f"Raise `{inputs.posterior.record.limit_to_raise}` in `[sampling]` and run again."
    if not worst.check.explains:
        return foreign(" ".join(worst.diagnosis.advice))
    if inputs.posterior.solutions.advice:
        return foreign(inputs.posterior.solutions.advice)
    step = inputs.knowledge.next_step
    if step is None and inputs.posterior.problem.premises.of_modes:
        return (
            "Natural frequencies and antiresonances beyond those measured, by a wider band or by a force and a sensor "
            "at a second point. Two more modes, one more sensor or two antiresonances alone would not tell much more."
        )
    if step is None:
        return (
            "None of what was looked at, one more sensor, more averages or further modes, would tell much more. "
            "`jointbayes plan` looks at more kinds of measurement."
        )
    return step.sentence
