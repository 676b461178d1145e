"""Which joint, and which case, explains the data best: the evidence of each hypothesis, and the report."""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from jointbayes.case.case import AnyCase, Case, require_case
from jointbayes.errors import CaseError, JointBayesError, ModelError, went
from jointbayes.identification import MapEstimate
from jointbayes.inference import Problem, hypothesis_problem
from jointbayes.joint import COUPLED, HYPOTHESES, RIGID, USUAL_HYPOTHESES, Quantity
from jointbayes.joint.quantities import split_hypothesis
from jointbayes.phrases import listed
from jointbayes.posterior import Posterior, data_sha256, package_versions
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.posterior.decision import only_modes
from jointbayes.posterior.evidence import (
    LARGEST_ERROR,
    OUT_OF_QUESTION,
    Evidence,
    constant_evidence,
    evidence,
    laplace_evidence,
    nested_evidence,
)
from jointbayes.posterior.evidence_table import VERY_STRONG, EvidenceTable, bayes_factor_words, is_close, odds
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.report.markup import foreign
from jointbayes.report.methods import report_text
from jointbayes.report.model import Block, Callout, Kind, Paragraph, Report, ReportSection, Table
from jointbayes.report.run_directory import json_text
from jointbayes.reproducibility import one_blas_thread
from jointbayes.rounding import in_lines, json_ready, number, sentence_start
from jointbayes.studies.study_directory import settings_section, sketch_figure, write_study
from jointbayes.workflow import answered_case, draws_of, find_map
from vibrecords.arrays import Array


@dataclass(frozen=True, slots=True)
class PriorEdge:
    """A prior's edge that the posterior piles up on.

    Parameters
    ----------
    name
        Coordinate.
    side
        ``"low"`` or ``"high"``.
    probability
        Posterior probability of the outer 5 % of the prior's interval.
    """

    name: str
    side: str
    probability: float


@dataclass(frozen=True, slots=True, eq=False)
class WeighedModel:
    """One hypothesis about the joint in one case.

    Parameters
    ----------
    case, title
        Name and title of the case.
    hypothesis
        One of `HYPOTHESES`.
    names
        Coordinates, including the nuisances.
    stiffness
        Quantities of the joint at the posterior mode, shape (q,); `jointbayes.joint.RIGID` stands for a motion that is
        held.
    evidence
        ln Z of the data with its error, and how it was found.
    at_edge
        Edges of the prior that the posterior piles up on: there ln Z depends on where the prior ends.
    quantities
        What the numbers of `stiffness` are.
    converged
        Whether the draws met their stop rule.
    """

    case: str
    title: str
    hypothesis: str
    names: tuple[str, ...]
    stiffness: Array
    evidence: Evidence
    at_edge: tuple[PriorEdge, ...]
    quantities: tuple[Quantity, ...] = COUPLED
    converged: bool = True

    @property
    def label(self) -> str:
        """Hypothesis and case in words."""
        return f"{self.hypothesis} in {self.case}"

    @property
    def trusted(self) -> bool:
        """Whether the stated error of the evidence may be believed."""
        return self.converged and self.evidence.trusted


Row = dict[str, Any]

#: Tables and keys of a case on which no evidence depends.
_MOVES_NO_EVIDENCE = {"reference", "title", "about", "identification"}
#: Endings of keys and their units, where a case differs from another by one number.
_UNITS = {"_mm": "mm", "_gpa": "GPa", "_kg_m3": "kg/m³", "_g": "g", "_kg": "kg", "_percent": "%"}
_IN_SHORT = {
    "rigid": "a rigid joint", "translation": "springs in translation only", "rotation": "springs in rotation only",
    "springs": "springs without coupling", "full": "springs with coupling", "coupled": "springs with further coupling",
}  # fmt: skip


def evidence_table(summary: dict[str, Any]) -> Table:
    """All candidates, the best first, with how ln Z was found."""
    head = ("Joint", "Case", "ln Z", "Method", "2 ln B", "Evidence against it", "Probability", "Mark")
    rows, kinds = [], []
    for row in _ranked(summary):
        best, error = row["words"] == "best", f" ± {number(row['log_z_error'], 1)}"
        marks = ["best"] * best + ["error unreliable"] * (not row["trusted"])
        marks += [f"{edge['name']} at its {edge['side']} edge" for edge in row["at_prior_edge"]]
        log_z = f"{row['log_z']:.2f}".replace("-", "−") + ("" if row["method"] in ("exact", "Laplace") else error)
        case, against = foreign(row["case"]), "–" if best else row["words"]
        cells = case, log_z, row["method"], f"{row['two_log_b']:.1f}", against, number(row["probability"], 2)
        rows.append((row["hypothesis"], *cells, ", ".join(marks)))
        kinds.append("good" if best else "bad" if not row["trusted"] else "caution" if row["at_prior_edge"] else "")
    note = report_text("evidence", limit=LARGEST_ERROR)
    return Table("Evidence", head, tuple(rows), note=note, row_kinds=tuple(kinds))


def build_comparison_report(summary: dict[str, Any], tested: Problem | None = None) -> Report:
    """Build the report of a comparison from the numbers of ``compare.json`` and the test to sketch."""
    candidates = summary["candidates"]
    # 1. What was found
    kind: Kind = "good" if summary["trusted"] and summary["decided"] else "caution"
    lead: list[Block] = [Callout(kind, f"**{foreign(summary['finding'])}**")]
    if not summary["trusted"]:
        names = ", ".join(f"{row['hypothesis']} in {foreign(row['case'])}" for row in candidates if not row["trusted"])
        lead.append(Callout("bad", f"**The error of the evidence is unreliable for: {names}.**"))
    # 2. The best joint of each candidate
    units = {name: unit for row in candidates for name, unit in row["units"].items()}
    joints = []
    for row in _ranked(summary):
        values = {name: number(value).replace("-", "−", 1) for name, value in row["map"].items() if value is not None}
        values |= dict.fromkeys(row["rigid"], "rigid")
        joints.append((row["hypothesis"], foreign(row["case"]), *(values.get(name, "–") for name in units)))
    head = ("Joint", "Case", *(f"{foreign(name)} ({unit})" for name, unit in units.items()))
    # 3. How to read it
    present = dict.fromkeys(row["hypothesis"] for row in candidates)
    texts = ["; ".join(f"**{name}**: {_meaning(name)}" for name in present) + ".", report_text("comparison")]
    texts += [report_text("nested")] if any(row["method"] == "nested sampling" for row in candidates) else []
    best = Table("Stiffness at the posterior mode", head, tuple(joints))
    return Report(
        title="Comparison of joints",
        subtitle=" against ".join(dict.fromkeys(foreign(row["title"]) for row in candidates)),
        lead=(*lead, *sketch_figure(tested)),
        sections=(
            ReportSection("evidence", "Evidence", (evidence_table(summary),)),
            ReportSection("joints", "Best joint of each candidate", (best,)),
            ReportSection("reading", "How to read this", tuple(map(Paragraph, texts))),
            settings_section(("Seed", str(summary["seed"])), ("Data (SHA-256)", summary["data_sha256"])),
        ),
    )


def _ranked(summary: dict[str, Any]) -> list[Row]:
    return sorted(summary["candidates"], key=lambda row: -float(row["log_z"]))


def _won(first: str, second: str, two_log_b: float) -> str:
    """Say which of the two it is, or that the data cannot tell."""
    same = first.rpartition(" ")[0].rpartition(" ")[0]
    second = second.removeprefix(f"{same} ") if same else second  # "length 360 mm, not 383 mm"
    if is_close(two_log_b):
        return f"Cannot decide between {first} and {second}: odds {odds(two_log_b)}."
    words = bayes_factor_words(two_log_b)
    return f"{sentence_start(first)}, not {second}: odds {odds(two_log_b)}, {words} evidence."


@dataclass(frozen=True, slots=True)
class Compared:
    """A problem that is compared, with its case if there is one; `drawn` where it is the problem of a posterior."""

    problem: Problem
    name: str
    title: str
    hypotheses: Sequence[str] = USUAL_HYPOTHESES
    case: Case | None = None
    drawn: bool = False

    @classmethod
    def of(cls, given: AnyCase | Problem | Posterior) -> "Compared":
        """Take what is given; a path is read."""
        drawn = isinstance(given, Posterior)
        if isinstance(given, Problem) or (isinstance(given, Posterior) and not isinstance(given.case, Case)):
            problem = given if isinstance(given, Problem) else given.problem
            return cls(problem, problem.name, problem.name, drawn=drawn)
        case = given.case if isinstance(given, Posterior) else require_case(given, "a case, a problem, a posterior")
        assert isinstance(case, Case)
        return cls(case.problem, case.name, case.title, case.spec.compare.hypotheses, case, drawn)


def what_differs(cases: Sequence[Case]) -> dict[str, str]:
    """Return for each case, by its name, the one number in which it differs from the others, or its name."""
    stated = [dict(_leaves(case.spec.model_dump(exclude=_MOVES_NO_EVIDENCE))) for case in cases]
    keys = [k for k in dict.fromkeys(k for each in stated for k in each) if len({repr(e.get(k)) for e in stated}) > 1]
    values = [each.get(keys[0]) for each in stated] if len(keys) == 1 else []
    if not values or not all(isinstance(value, float | int) for value in values):
        return {case.name: case.name for case in cases}
    words = keys[0].rpartition(".")[2]
    unit = next((unit for ending, unit in _UNITS.items() if words.endswith(ending)), "")
    words = words.removesuffix(next((ending for ending in _UNITS if words.endswith(ending)), ""))
    text = f"{listed((words,))} {{:g}} {unit}"
    return {case.name: text.format(value).strip() for case, value in zip(cases, values, strict=True)}


def _leaves(stated: Any, path: str = "") -> Iterator[tuple[str, Any]]:  # noqa: ANN401 (anything a case holds)
    if not isinstance(stated, dict):
        yield path, stated
        return
    for name, value in stated.items():
        yield from _leaves(value, f"{path}.{name}")


def _meaning(hypothesis: str) -> str:
    undamped, joint = split_hypothesis(hypothesis)
    return f"{report_text(joint)}{', without damping' if undamped else ''}"


#: What the directory of a comparison holds.
A_COMPARISON = "a comparison"


@dataclass(frozen=True, slots=True)
class Comparison:
    """Candidates for the same data.

    Parameters
    ----------
    candidates
        One for each case and hypothesis, in the order of the cases.
    seed
        Seed of all random numbers.
    data_sha256
        Fingerprint of the data that all share.
    case_texts
        Text of each case by its name.
    labels
        Of each case by its name what tells it from the others: ``"length 360 mm"``.
    tested
        The test whose structure the report shows; none where it shows no sketch.
    """

    candidates: tuple[WeighedModel, ...]
    seed: int
    data_sha256: str
    case_texts: Mapping[str, str] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    tested: Problem | None = None

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 (of names that went)
        raise went(self, name)

    def __repr__(self) -> str:
        return "\n".join(in_lines(f"Comparison of {len(self.candidates)} joints: {self.finding}", 0))

    @property
    def best(self) -> WeighedModel:
        """The candidate of the largest evidence."""
        return max(self.candidates, key=lambda c: c.evidence.log_z)

    @property
    def ranking(self) -> tuple[WeighedModel, ...]:
        """All candidates, the best first."""
        return tuple(sorted(self.candidates, key=lambda c: -c.evidence.log_z))

    @property
    def table(self) -> EvidenceTable[tuple[str, str]]:
        """ln evidence by case and hypothesis."""
        return EvidenceTable({(c.case, c.hypothesis): c.evidence.log_z for c in self.candidates})

    @property
    def probabilities(self) -> Array:
        """Posterior probability of each candidate, shape (candidates,), if all were equally probable before."""
        return np.array([*self.table.probabilities.values()])

    @property
    def trusted(self) -> bool:
        """Whether every evidence's error may be believed."""
        return all(c.trusted for c in self.candidates)

    def two_log_b(self, candidate: WeighedModel) -> float:
        """2 ln B of the best against a candidate: 0 for the best itself."""
        return self.table.two_log_b((candidate.case, candidate.hypothesis))

    def words(self, candidate: WeighedModel) -> str:
        """Evidence for the best against a candidate in the words of Kass and Raftery; ``"best"`` for itself."""
        return "best" if candidate is self.best else bayes_factor_words(self.two_log_b(candidate))

    @property
    def by_case(self) -> dict[str, float]:
        """ln of the evidence of each case, its hypotheses as probable as each other before; the best first."""
        return self.table.pooled(lambda name: name[0]).ranking

    @property
    def by_joint(self) -> dict[str, float]:
        """ln of the evidence of each hypothesis over all cases that weigh it, each as probable; the best first."""
        return self.table.pooled(lambda name: name[1]).ranking

    @property
    def _cases(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(c.case for c in self.candidates))

    @property
    def decided(self) -> bool:
        """Whether what was asked has an answer: which case of several, or which joint in one."""
        if len(self._cases) > 1:
            first, second, *_ = self.by_case.values()
            return not is_close(2 * (first - second))
        _, *others = self.ranking
        return not others or not is_close(self.two_log_b(others[0]))

    @property
    def finding(self) -> str:
        """What was asked, answered in words: which of several cases, and which joint."""
        return " ".join(self.sentences)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The same, sentence by sentence."""
        sentences = []
        if len(self._cases) > 1:
            (first, best), (second, next_best), *_ = self.by_case.items()
            first, second = self.labels.get(first, first), self.labels.get(second, second)
            sentences.append(_won(first, second, 2 * (best - next_best)))
        # over all cases: a joint that is out of the question in the best case may still explain the data in another
        each = map(split_hypothesis, self.by_joint)
        joints = [f"{_IN_SHORT[joint]}{', undamped' if undamped else ''}" for undamped, joint in each]
        best, *others = self.by_joint.values()
        twice = [2 * (best - log_z) for log_z in others]
        if others:
            sentences.append(_won(joints[0], joints[1], twice[0]))
        elif len(self._cases) == 1:
            sentences.append(f"Nothing was compared: {joints[0]} is the only joint.")
        if excluded := [(j, t) for j, t in zip(joints[2:], twice[1:], strict=True) if t > VERY_STRONG]:
            everywhere = " in every case" if len(self._cases) > 1 else ""
            told = ", ".join(f"{joint} (odds {odds(t)})" for joint, t in excluded)
            sentences.append(f"Excluded{everywhere}: {told}.")
        if self.best.at_edge:
            edges = ", ".join(dict.fromkeys(edge.name for edge in self.best.at_edge))
            sentences.append(f"Draws pile up at an edge of the prior of {edges}: the prior has a say in this.")
        return tuple(sentences)

    def summary(self) -> dict[str, Any]:
        """The numbers, as in ``compare.json``."""
        rows = zip(self.candidates, self.probabilities, strict=True)
        return json_ready(
            {
                "finding": self.finding,
                "decided": self.decided,
                "cases": self.by_case,
                "trusted": self.trusted,
                "seed": self.seed,
                "data_sha256": self.data_sha256,
                "best": {"case": self.best.case, "hypothesis": self.best.hypothesis},
                "candidates": [self._row(candidate, float(probability)) for candidate, probability in rows],
                "versions": package_versions(),
            }
        )

    def _row(self, candidate: WeighedModel, probability: float) -> dict[str, Any]:
        z = candidate.evidence
        held = [bool(k == RIGID) for k in candidate.stiffness]
        names = [quantity.name for quantity in candidate.quantities]
        stiffness = zip(names, candidate.stiffness.tolist(), held, strict=True)
        return {
            "case": candidate.case,
            "title": candidate.title,
            "hypothesis": candidate.hypothesis,
            "parameters": list(candidate.names),
            "map": {name: None if rigid else value for name, value, rigid in stiffness},
            "rigid": [name for name, rigid in zip(names, held, strict=True) if rigid],
            "units": {quantity.name: quantity.unit for quantity in candidate.quantities},
            "log_z": z.log_z,
            "log_z_error": z.error,
            "method": z.method,
            "evaluations": z.evaluations,
            "trusted": candidate.trusted,
            "two_log_b": self.two_log_b(candidate),
            "words": self.words(candidate),
            "probability": probability,
            "at_prior_edge": [asdict(edge) for edge in candidate.at_edge],
        }

    def write(self, directory: str | os.PathLike[str]) -> Path:
        """Write the comparison into a new directory, or one of another comparison; each file is whole or absent.

        Returns
        -------
        Path
            The directory: ``report.html``, ``report.pdf``, ``compare.json``, ``cases/*.toml``.

        Raises
        ------
        WriteError
            If a file cannot be written, the directory holds something else, or another process is at work in it.
        """
        summary = self.summary()
        files = {f"cases/{name}.toml": text for name, text in self.case_texts.items()}
        files["compare.json"] = json_text(summary)
        return write_study(directory, A_COMPARISON, build_comparison_report(summary, self.tested), files)


_EDGE = 0.05  # of a prior's interval
_PILED = 2.0  # times the prior's probability in that strip


@one_blas_thread()
def compare(
    cases: Sequence[AnyCase | Problem | Posterior],
    *,
    seed: int | None = None,
    progress: ProgressCallback | bool | None = None,
    nested: bool = False,
) -> Comparison:
    """Weigh the hypotheses of cases that hold the same data against each other.

    They are weighed by what a run of each case is analysed as, see `jointbayes.sample`: measured FRFs by the modes that
    they show, with the error of the model; of several cases by the modes that all of them have a place for.

    Parameters
    ----------
    cases
        Cases, or paths of their files, each with its list of hypotheses; problems and posteriors, with the usual
        hypotheses where they have no case.
    seed
        Seed of all random numbers; by default the first case's, 1 of a problem.
    progress
        Called as each stage of each candidate begins, and as it goes on.
    nested
        Find ln Z by nested sampling, which is slow, in place of the draws.

    Returns
    -------
    Comparison
        ``.best``, ``.finding``, ``.candidates``, ``.summary()``.

    Raises
    ------
    CaseError
        If there is no case, two have the same name, or they do not hold the same data.

    References
    ----------
    Kass, R. E., Raftery, A. E. (1995). Bayes factors. Journal of the American Statistical Association 90(430),
    773-795. DOI 10.1080/01621459.1995.10476572
    """
    given = [Compared.of(case) for case in cases]
    require_same_data(given)
    if seed is None:
        seed = 1 if given[0].case is None else given[0].case.spec.sampling.seed
    tell = callback_of(progress)
    answered = _answered(given, seed, tell)
    candidates: list[WeighedModel] = []
    for case in given:
        try:
            candidates += _weighed(case, answered[case.name], seed, tell, nested=nested)
        except CaseError:
            raise
        except JointBayesError as error:
            raise CaseError(f"{case.name}: {error}") from error
    whole, problem = [each.case for each in given if each.case is not None], given[0].problem
    labels, texts = what_differs(whole) if len(whole) == len(given) else {}, {case.name: case.text for case in whole}
    return Comparison(tuple(candidates), seed, data_sha256(problem), texts, labels, problem.parts[0])


def require_same_data(cases: Sequence[Case | Compared]) -> None:
    """Refuse cases whose evidences could not be compared.

    Raises
    ------
    CaseError
        If there is no case, two have the same name, or they do not hold the same data.
    """
    if not cases:
        raise CaseError("compare: found no case; expected one or more; name them")
    names = [case.name for case in cases]
    for i, case in enumerate(cases):
        if case.name in names[:i]:
            raise CaseError(f"compare: found two cases named {case.name}; expected each once; rename one of the files")
        if _data_of(case.problem) != _data_of(cases[0].problem):
            raise CaseError(
                f"compare: found other data in {case.name} than in {cases[0].name}; expected the same, because "
                "evidences of different data cannot be compared; give both the same [data]"
            )


def _data_of(problem: Problem) -> tuple[object, ...]:
    layouts = ((test.name, test.data.shown_frfs and test.data.shown_frfs.layout) for test in problem.tests)
    return data_sha256(problem), *layouts


def _answered(cases: Sequence[Compared], seed: int, tell: ProgressCallback) -> dict[str, Problem]:
    """What each case is analysed as, by its name: of measured FRFs the modes that all cases have a place for."""
    answered = {
        each.name: each.problem if each.drawn else answered_case(each.case or each.problem, seed, tell)
        for each in cases
    }
    each = [{mode.resonance for mode in problem.premises.modes} for problem in answered.values()]
    if len({bool(used) for used in each}) > 1:
        by = ", ".join(f"{name} by {'modes' if p.premises.of_modes else 'its FRFs'}" for name, p in answered.items())
        raise CaseError(
            f"compare: found cases that are analysed by other data: {by}; expected the same, because evidences of "
            "different data cannot be compared; state the same [uncertain.model_error] in all"
        )
    shared = set.intersection(*each)
    return {name: problem if used == shared else only_modes(problem, shared)
            for (name, problem), used in zip(answered.items(), each, strict=True)}  # fmt: skip


def _weighed(
    case: Compared, answered: Problem, seed: int, tell: ProgressCallback, *, nested: bool
) -> Iterator[WeighedModel]:
    """The hypotheses of a case, in their order.

    1. Search for the mode of each: first of the case's own joint, then from the one with the most coordinates down.
       Each search starts from the modes found before. It ends early where the case's own joint is far more probable.
    2. Draw from those that Laplace's approximation does not put out of the question.
    3. Bridge the draws to a fitted mixture; nested sampling only where asked.
    """
    hypotheses = case.hypotheses
    problems = {name: hypothesis_problem(answered, name) for name in hypotheses}
    # 1. search
    own, rough, found = answered.parametrisation, dict[str, Evidence](), dict[str, MapEstimate]()
    known, best = answered, -math.inf
    for name in sorted(hypotheses, key=lambda n: (problems[n].parametrisation != own, -len(problems[n].names))):
        problem = replace(problems[name], known_modes=known.known_modes)
        if not problem.names:
            rough[name] = constant_evidence(problem.log_posterior)
            continue
        tell(Progress("weighing", f"{name} in {case.name}"))
        estimate = found[name] = find_map(problem, seed=seed, progress=tell, floor=best - OUT_OF_QUESTION)
        known = known.with_known_modes(problem.prior, estimate.places)
        rough[name] = laplace_evidence(estimate.starts_for_draws[0], estimate.log_posterior)
        best = max(best, rough[name].log_z)
    for name in hypotheses:
        problem, weighed, converged, edges = problems[name], rough[name], True, tuple[PriorEdge, ...]()
        if not np.isfinite(weighed.log_z):
            raise ModelError(
                "found a likelihood of zero everywhere; expected a joint that the data allow; leave it out"
            )
        if weighed.method == "Laplace" and weighed.log_z >= best - OUT_OF_QUESTION:
            # 2. draw, from one stream for each candidate, the same with any others
            rng = np.random.default_rng([seed, *case.name.encode(), 256 + list(HYPOTHESES).index(name)])
            chains = draws_of(problem, found[name], seed, tell)
            draws, converged, density = chains.draws(), chains.converged, problem.log_posterior
            prior = problem.prior
            low, high = prior.support
            of_each = enumerate(zip(prior.names, prior.all_marginals, draws.theta.reshape(-1, len(low)).T, strict=True))
            for i, (coordinate, marginal, values) in of_each:
                if not np.isfinite(marginal.support).all():
                    continue
                place = (values - low[i]) / (high[i] - low[i])
                below, within = marginal.cdf(low[i] + np.array([_EDGE, 1 - _EDGE]) * (high[i] - low[i])).tolist()
                for side, near, before in ("low", place < _EDGE, below), ("high", place > 1 - _EDGE, 1 - within):
                    if (share := float(near.mean())) > _PILED * max(before, _EDGE):
                        edges = (*edges, PriorEdge(coordinate, side, share))
            # 3. weigh
            if nested:
                weighed = nested_evidence(density.log_likelihood, prior.transform, len(prior.names), rng, tell=tell)
            else:
                weighed = evidence(density, coordinate_systems(problem), draws, rng)
        stiffness = problem.prior.values(found[name].theta if name in found else np.empty(0))
        yield WeighedModel(
            case.name, case.title, name, problem.names, stiffness, weighed, edges, problem.quantities, converged
        )
