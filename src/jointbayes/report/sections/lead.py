"""Page one: what was tested, the answer, whether it can be trusted, what limits it and what to do next."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jointbayes.inference import Problem, Test
from jointbayes.phrases import NO_VERDICT_NO_USE, WORKSHOP, Reason, listed, taken_as_exact
from jointbayes.posterior.compared_frfs import sentences_of_faults
from jointbayes.posterior.decision import unseen_inputs
from jointbayes.posterior.identifiability import LIMIT_NOTE, RANK, Verdict, ratio_of
from jointbayes.posterior.knowledge import quantities_taken_as_exact, uncertain_quantities
from jointbayes.posterior.prediction import sentence_of_left_out
from jointbayes.posterior.summary import OF_A_TEST, Summary, TestSummary
from jointbayes.posterior.verdicts import default_priors, describe_solutions, mode_agrees, mode_distance
from jointbayes.report.inputs import ReportInputs, explained
from jointbayes.report.markup import foreign, kind_of, listed_names, readable
from jointbayes.report.model import Block, Callout, Figure, Kind, Light, Lights, Paragraph, ReportSection, Table
from jointbayes.report.structure_sketch import dof_words, sketch
from jointbayes.rounding import number, percent, sentence_start
from jointbayes.structure.frame_recipe import BeamRecipe, FrameRecipe
from jointbayes.structure.imported.imported_body import ImportedRecipe
from vibrecords import FrfData

_LONGEST = 180  # characters of a doubt
#: What may be found of calculation, model and data, and the colour of the light then.
FINDINGS: dict[str, tuple[str, Kind]] = {
    "not settled": ("Calculation", "bad"), "best fit missed": ("Calculation", "bad"),
    "edge of a stated prior": ("Calculation", "caution"), "coarse mesh": ("Calculation", "caution"),
    "settled": ("Calculation", "good"),
    "misfit": ("Model", "bad"), "noise of bodies ignored": ("Model", "bad"),
    "no model of this structure": ("Model", "bad"), "noise of bodies": ("Model", "caution"),
    "noise overstated": ("Model", "caution"), "large error": ("Model", "caution"),
    "usual error": ("Model", "good"), "explained": ("Model", "good"),
    "doubts": ("Data", "caution"), "computed": ("Data", "caution"), "measured": ("Data", "good"),
}  # fmt: skip


def lights_of(inputs: ReportInputs) -> Lights:
    """Calculation, model and data."""
    found = (_calculation(inputs), _model(inputs), _data(inputs))
    return Lights(tuple(Light(*FINDINGS[finding], text, finding) for finding, text in found))


def _calculation(inputs: ReportInputs) -> tuple[str, str]:
    """Finding on the calculation, and its sentence."""
    posterior, summary = inputs.posterior, inputs.summary
    if not posterior.converged:
        how = f"Run it longer ([sampling] {posterior.record.limit_to_raise})."
        return "not settled", f"Not converged: {NO_VERDICT_NO_USE}. {how}"
    if not mode_agrees(posterior):
        away = number(mode_distance(posterior), 2)
        return "best fit missed", f"The search missed the best fit: it lies {away} standard deviations away."
    # A default range is no statement of the user, so no one is asked to widen it.
    at_edge, default = posterior.problem.prior.coordinates_at_edge(posterior.best.theta), default_priors(posterior)
    edges = [name for name in at_edge if name not in default]
    if edges and not posterior.problem.premises.of_modes:
        text = f"The best fit lies on the edge of the prior of {foreign(', '.join(edges))}: widen it."
        return "edge of a stated prior", text
    if summary.mesh is not None and not summary.mesh.within:
        return "coarse mesh", foreign(summary.mesh.sentence)
    return "settled", posterior.record.state


def _model(inputs: ReportInputs) -> tuple[str, str]:
    """Finding on the model, and its sentence."""
    summary = inputs.summary
    worst = worst_test(summary)
    of_test = f" of test {foreign(worst.check.test)}" if worst.check.test else ""
    bodies, error = summary.measured_bodies, summary.model_error
    if bodies is not None and not bodies.within:
        return "noise of bodies ignored" if bodies.ignored else "noise of bodies", foreign(bodies.sentence)
    of_all = {1: "", 2: " of both tests"}.get(len(summary.tests), f" of all {len(summary.tests)} tests")
    if error is None or not worst.check.explains or worst.check.finding == "noise overstated":
        text = sentence_start(explained(worst.check, (of_all or of_test) if worst.check.explains else of_test))
        if worst.check.explains:
            return worst.check.finding, text
        suspect = f" Check the sensor of FRF {foreign(worst.diagnosis.sensor)}." if worst.diagnosis.sensor else ""
        return "misfit", f"{text} {worst.diagnosis.measure}{suspect}".rstrip()
    # The size of an inferred error says how good the model is: residuals are small next to any such size.
    if error.grade == "negligible":
        return "explained", f"Explains the modes{of_all}."
    if error.grade == "usual":
        text = f"Explains the modes{of_all}. Its natural frequencies are off by {error.words}, as is usual."
        return "usual error", text
    found = " and ".join(error.findings)
    if error.grade == "large":
        return "large error", f"More than usual: {found}. {error.causes}"
    return "no model of this structure", f"It is no model of this structure: {found}. {error.causes}"


def worst_test(summary: Summary) -> TestSummary:
    """The test that the model explains worst."""
    return min(summary.tests.values(), key=lambda test: test.check.smallest_p_value)


def _data(inputs: ReportInputs) -> tuple[str, str]:
    """Finding on the data, and its sentence."""
    summary = inputs.summary
    doubts = [text for test, frfs in summary.compared_frfs.items() for text in sentences_of_faults(frfs, test)]
    doubts += [
        f"Check {warning.where}: {warning.sentence}" for test in inputs.tests
        for warning in getattr(test.problem.test.data.provenance, "warnings", ())
    ]  # fmt: skip
    doubts += [f"Check {warning}" for warning in summary.warnings]
    if doubts:
        more = f" And {len(doubts) - 1} more, see below." if len(doubts) > 1 else ""
        first = doubts[0].rstrip(".")  # to its full stop, or as far as there is room
        first = f"{first}." if len(first) < _LONGEST else f"{first[: _LONGEST - 1].rstrip(' .,')} …"
        return "doubts", f"{foreign(first)}{more}"
    if inputs.computed:
        return "computed", f"Computed from {inputs.computed}, not measured."
    return "measured", f"{summary.fit.n_data} measured values; nothing in them looks doubtful."


#: Stiffnesses that all have a row on page one, of more so many that are known least; and reasons it has room for.
_MOST_NAMED, _FEW, _MOST_REASONS = 6, 4, 3
_MOST_TESTS = 4  # of which each has its sentence
_MOST_DOFS = 3  # that are named on one side
_WORKSHOP = sentence_start(WORKSHOP)
#: What a stiffness resists, by its unit; k11 of a coupled pair is across the structure.
_MEANING = {"N/m": "pushing", "N·m/rad": "turning", "N": "coupling", "N·s/m": "damping", "N·m·s/rad": "damping"}


@dataclass(frozen=True, slots=True)
class _Answer:
    """What is known of each stiffness under one assumption on everything else."""

    title: str
    known: Mapping[str, Verdict]


def lead(inputs: ReportInputs, *, alone: bool = False) -> tuple[Block, ...]:
    """Return page one, in the order in which it is asked.

    A page that stands alone says in a table who tested what, when and with which instruments, also where the case does
    not say it. It does not say what limits the answer.
    """
    answers = _answers(inputs)
    about, words = inputs.summary.about, "not stated"
    cells = tuple(foreign(about[key]) if key in about else words for key in OF_A_TEST)
    head = Table("The test", tuple(OF_A_TEST.values()), (cells,), align="llll")
    said = [Paragraph(f"{inputs.specimen}.")] if inputs.specimen else []
    # What forbids the use of the numbers stands above everything
    posterior, summary, stops = inputs.posterior, inputs.summary, list[Block]()
    if not posterior.converged:
        lost = [name for name, each in summary.parameters.items() if each.known.cls == "no verdict"]
        settled = "**The calculation has not converged.** Its Monte Carlo error changes no verdict."
        text = f"**Do not use {_more(lost)}.**" if lost else settled
        stops = [Callout("bad" if lost else "caution", f"{text} {sentence_start(posterior.reason)}.")]
    elif summary.no_verdict:
        stops = [Callout("bad", f"**No stiffness can be stated**: {'; '.join(summary.no_verdict)}.")]
    blocks = (
        *stops,
        *([head] if alone else said),
        *blocks_on_tests(inputs),
        _answer_table(inputs, answers, _MOST_NAMED),
        Paragraph(f"**Rests on.** {_premises(inputs, answers)}"),
        Paragraph(f"**Next.** {foreign(inputs.knowledge.advice)}"),
        lights_of(inputs),
    )
    return blocks if alone else (*blocks, Paragraph(f"**What limits the answer.** {_limits(inputs, answers)}"))


def answer_section(inputs: ReportInputs) -> ReportSection | None:
    """The answer on every stiffness; None where page one has them all."""
    names = inputs.posterior.stiffness_names
    if len(names) <= _MOST_NAMED:
        return None
    return ReportSection("answer", "Answer", (_answer_table(inputs, _answers(inputs), len(names)),))


def blocks_on_tests(inputs: ReportInputs) -> tuple[Block, ...]:
    """Return the sketch, only of a structure whose shape is known, and a sentence on what was measured."""
    problem = inputs.posterior.problem
    parts = problem.parts
    structures = [_structure(part) for part in parts]
    differ = len(set(structures)) > 1
    told = zip(parts[:_MOST_TESTS], structures, strict=False)
    text = " ".join(_sentence(part, structure if differ else "") for part, structure in told)
    if len(parts) > _MOST_TESTS:
        text += f" In all {len(parts)} tests, see below."
    joints = next(part.test.joints for part in parts if part.test.joints.size)  # a free part has none
    names = ", ".join(joint.name for joint in joints.joints)
    several = len(joints.joints) > 1
    joint = f"{len(joints.joints)} joints: {foreign(names)}." if several else f"Joint: {foreign(str(joints))}."
    tested = Paragraph(f"**Tested.** {text if differ else f'{structures[0]}: {text}'} {joint}")
    drawings = {sketch(part): part for part in reversed(parts[:_MOST_TESTS])}  # each picture once
    drawn = tuple(drawings.values())[::-1]
    drawing = sketch(*drawn) if len(drawn) > 1 else next(iter(drawings))
    if not drawing:
        return (tested,)
    tests = f"test {listed_names([foreign(part.test.name) for part in drawn])}"
    which = f"{tests if len(parts) > 1 else 'the structure'} with joints, ground, forces and responses."
    return tested, Figure("structure", f"What was tested: {which}", f"Drawing of {which}", drawing)


def _structure(part: Problem) -> str:
    """The structure in words."""
    recipe = getattr(part.test.structures, "recipe", None)
    if isinstance(recipe, BeamRecipe):
        size = " × ".join(f"{1e3 * dimension:g}" for dimension in recipe.section.dimensions if dimension)
        shape = "circle" if recipe.section.shape == "tube" and "×" not in size else recipe.section.shape
        return f"Beam, {1e3 * recipe.length:g} mm long, section {shape} {size} mm"
    if isinstance(recipe, FrameRecipe):
        names = [foreign(name) for name, _ in recipe.bodies if name]
        return f"Frame of {', '.join(names)}" if names else "Frame"
    if isinstance(recipe, ImportedRecipe):
        return f"Imported model, {recipe.in_words}"
    return "Structure"


def _sentence(part: Problem, structure: str) -> str:
    """One test: its structure, data, lines and band, averages and noise."""
    test = part.test
    name = f"{foreign(test.name)} ({structure}): " if structure else f"{foreign(test.name)}: " if test.name else ""
    frfs, modes = test.data.shown_frfs, test.data.modes
    if frfs is not None:
        seen = "" if modes is None else f"; analysed by the {modes.frequency_hz.size} modes that they show"
        return f"{name}{_frfs(test, frfs)}{seen}."
    if modes is not None:
        spread = float(np.median(modes.sd_hz / modes.frequency_hz))
        low, high = modes.band_hz
        band = f"{low:.5g} to {high:.5g} Hz" if high > low else f"{low:.5g} Hz"
        what = foreign(test.data.in_short())
        return f"{name}{what}, {band}, each known to {percent(spread)} (standard deviation)."
    return f"{name}{foreign(test.data.in_short())}."


def _frfs(test: Test, data: FrfData) -> str:
    frf, provenance = data.frf, data.provenance
    count = len(frf.outputs) * len(frf.inputs)
    averages = f", {provenance.averages} averages" if provenance is not None and provenance.averages else ""
    size = np.abs(frf.values)
    noise = float(np.median(np.sqrt(data.variance[size > 0]) / size[size > 0]))
    return (
        f"{count} {'computed ' if data.synthetic else ''}{frf.quantity} FRF{'s' if count > 1 else ''} "
        f"({_where(test, frf.outputs, frf.inputs)}), {frf.n_lines} lines from "
        f"{frf.frequency_hz[0]:g} to {frf.frequency_hz[-1]:g} Hz{averages}, noise {percent(noise)} of |H| (median)"
    )


def _where(test: Test, outputs: tuple[str, ...], inputs: tuple[str, ...]) -> str:
    """Where responses and forces are, by the names that people use."""
    sides = {"force and response": inputs} if outputs == inputs else {"response": outputs, "force": inputs}
    return ", ".join(f"{side} at {_listed(test, dofs)}" for side, dofs in sides.items())


def _listed(test: Test, dofs: tuple[str, ...]) -> str:
    more = f" and {len(dofs) - _MOST_DOFS} more" if len(dofs) > _MOST_DOFS else ""
    names = (words if (words := dof_words(test, dof)) == dof else f"{words} ({dof})" for dof in dofs[:_MOST_DOFS])
    return foreign("; ".join(names)) + more


def _answers(inputs: ReportInputs) -> list[_Answer]:
    """The answer as the run has it and, where it takes anything as exact, with all else as in a workshop."""
    problem = inputs.posterior.problem
    stated = "Inputs as stated" if uncertain_quantities(problem) else "Inputs exact"
    title = _WORKSHOP if problem.premises.assumed else stated
    run = _Answer(title, {name: p.known for name, p in inputs.summary.parameters.items()})
    workshop = inputs.knowledge.workshop
    if workshop is None:
        return [run]
    freed = _Answer(_WORKSHOP, workshop)
    # with measured data all else is not known exactly, so that the workshop's is the answer and comes first
    return [run, freed] if inputs.summary.fit.synthetic_data else [freed, run]


def _answer_table(inputs: ReportInputs, answers: Sequence[_Answer], most: int) -> Table:
    """A row for each stiffness, of more than so many of those that are known least; the assumptions side by side."""
    unit_of, names = inputs.posterior.unit, inputs.posterior.stiffness_names
    if len(names) > most:
        most = _FEW
        first = answers[0].known
        by_need = sorted(names, key=lambda n: (-RANK.get(first[n].cls, 9), -ratio_of(first[n].interval)))
        names = tuple(name for name in names if name in by_need[:most])
    rows, kinds, bars = [], [], []
    for name in names:
        known = [answer.known[name] for answer in answers]
        what = "sideways" if name == "k11" else _MEANING.get(unit_of(name))
        cells = [f"{each.value}\n{each.plain_words}" for each in known]
        bars.append([_bar(each, inputs.summary.parameters[name].prior_interval95) for each in known])
        shares = "; ".join(percent(max(high - low, 0.001)) for low, _, high in bars[-1])
        rows.append((f"**{foreign(name)}**, {what}" if what else f"**{foreign(name)}**", *cells, shares))
        of_row = {kind_of(each.plain_words) for each in known}
        kinds.append(of_row.pop() if len(of_row) == 1 else "")  # no colour for two verdicts that differ
    every = len(inputs.posterior.stiffness_names)
    damped = inputs.posterior.problem.parametrisation.damped
    note = "Median, in brackets the 95 % interval. Bars and per cent: what is left of the prior's range."
    if any(math.isfinite(each.limit) for answer in answers for each in answer.known.values()):
        note += f" {LIMIT_NOTE}"
    if every > most:
        best_first = sorted(answers[0].known.values(), key=lambda each: RANK.get(each.cls, 9))
        counts = Counter(each.plain_words for each in best_first)
        counted = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
        note += f" The {most} known least of {every}: {counted}; the section on stiffness has all."
    title = "Stiffness and damping of the joint" if damped else "Stiffness of the joint"
    head = ("Quantity" if damped else "Stiffness", *(answer.title for answer in answers), "Of the prior")
    drawn: dict[str, Any] = {"row_kinds": tuple(kinds), "bars": tuple(map(tuple, bars))}
    return Table(title, head, tuple(rows), "l" * len(head), note, **drawn)


def _bar(known: Verdict, prior95: tuple[float, float]) -> tuple[float, float, float]:
    """Lower end, median and upper end of an interval as shares of the prior's; of what is positive by logarithms."""
    low, high = known.interval
    if math.isfinite(known.limit):
        low, high = (known.limit, math.inf) if known.cls == "bounded below" else (0.0, known.limit)
    ends = np.clip([low, known.median, high], *prior95)
    first, *places, last = (np.log if prior95[0] > 0 else np.asarray)([prior95[0], *ends, prior95[1]])
    low, median, high = ((place - first) / (last - first) for place in places)
    return float(low), float(median), float(high)


def _premises(inputs: ReportInputs, answers: Sequence[_Answer]) -> str:
    """What the answer takes for granted, and what is left of it where that is not so."""
    problem, knowledge = inputs.posterior.problem, inputs.knowledge
    assumed, taken = problem.premises.assumed, quantities_taken_as_exact(knowledge.freed)
    if len(answers) == 2 and taken:
        run, workshop = sorted(answers, key=lambda answer: answer.title == _WORKSHOP)
        worse = [n for n, k in run.known.items() if RANK[workshop.known[n].cls] > RANK[k.cls]]
        left = (
            f"{_more(worse)} {'is' if len(worse) == 1 else 'are'} known less well" if worse else "no verdict is worse"
        )
        if all(known.cls == "not identified" for known in workshop.known.values()):
            left = "this test determines none of the stiffnesses"
        usual = f"{WORKSHOP} ({', '.join(knowledge.assumed)})"
        exact = sentence_start(taken_as_exact(listed(taken), len(taken)))
        return f"{exact}. With {usual}, {left}."
    uncertain = [readable(name) for name in uncertain_quantities(problem)]
    stated = [name for name in uncertain if not any(word.startswith(f"{name} to ") for word in assumed)]
    words = [f"{_WORKSHOP}: {', '.join(assumed)}; the case does not state them."] if assumed else []
    if stated:
        words.append(f"Uncertain as the case states: {listed(stated)}.")
    elif not assumed:
        words.append(f"{taken_as_exact('All else, such as material, dimensions and masses,', 1)}.")
    return " ".join(words)


def _limits(inputs: ReportInputs, answers: Sequence[_Answer]) -> str:
    """What keeps the answer from being better, the most important first."""
    summary, premises = inputs.summary, inputs.posterior.problem.premises
    if Reason.NOT_CONVERGED in {because.reason for p in summary.parameters.values() for because in p.known.reasons}:
        return "The calculation: nothing can be said before it has converged."
    parts = []
    if premises.reason:
        parts.append(f"{sentence_start(premises.decision)}.")
    parts += [premises.asked] if premises.asked else []
    parts += unseen_inputs(inputs.posterior.problem)
    if summary.no_verdict:
        parts.append("The model misses the data: intervals from such a fit are too narrow.")
    if solutions := describe_solutions(inputs.posterior):
        parts.append(foreign(solutions))
    # those of one reason together, the first few reasons
    by_reason: dict[str, list[str]] = {}
    for name, each in answers[0].known.items():
        if each.cls not in ("identified", "no verdict"):
            by_reason.setdefault(each.because, []).append(name)
    parts += [f"{_more(names)}: {reason}." for reason, names in by_reason.items()][:_MOST_REASONS]
    parts += [f"And {len(by_reason) - _MOST_REASONS} more."] if len(by_reason) > _MOST_REASONS else []
    if summary.left_out:
        parts.append(foreign(sentence_of_left_out(summary.left_out)))
    return " ".join(parts) or "The noise of the measurement: more averages would narrow every interval."


def _more(names: Sequence[str]) -> str:
    return listed_names([foreign(name) for name in names[:_MOST_NAMED]]) + (" …" if len(names) > _MOST_NAMED else "")
