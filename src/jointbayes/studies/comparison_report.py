"""What a comparison of joints found: evidence and cross-validation of each, the best of them, the report.

The numbers are those of ``compare.json``.
"""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import ArrayLike
from scipy import special

from jointbayes.errors import ModelError
from jointbayes.inference import Problem
from jointbayes.joint import COUPLED, RIGID, Quantity
from jointbayes.joint.quantities import split_hypothesis
from jointbayes.posterior import package_versions
from jointbayes.posterior.evidence import PARETO_LIMIT, Evidence
from jointbayes.posterior.storage import loo_pointwise
from jointbayes.report.canvas import margin_labels, panels, svg
from jointbayes.report.line_plot import SERIES_COLOURS
from jointbayes.report.markup import foreign
from jointbayes.report.methods import references, report_text
from jointbayes.report.model import Block, Callout, Figure, Kind, Paragraph, Report, ReportSection, Table
from jointbayes.report.run_directory import json_text
from jointbayes.rounding import json_ready, likelihood_ratio, number
from jointbayes.studies.study_directory import write_study
from vibrecords.arrays import Array

_FEWEST = 30  # values that a standard error of a sum can be taken from
_MOST_NUMBERS = 5_000_000  # log densities in memory at once
_FEWEST_DRAWS = 200


@dataclass(frozen=True, slots=True, eq=False)
class LeaveOneOut:
    """Expected log density of each measured value given all the others.

    Parameters
    ----------
    elpd_i
        ln p(value | others), shape (values,).
    pareto_k
        Shape of each value's importance weights, shape (values,): above about 0.7 its figure is not to be trusted.
    """

    elpd_i: Array
    pareto_k: Array

    @property
    def elpd(self) -> float:
        """Sum over the values: larger is better."""
        return float(self.elpd_i.sum())

    @property
    def se(self) -> float:
        """Standard error of the sum."""
        return _se_of_sum(self.elpd_i)

    def difference(self, other: "LeaveOneOut") -> tuple[float, float]:
        """Own sum less the other's, with the standard error of this difference, from the differences value by value."""
        each = self.elpd_i - other.elpd_i
        return float(each.sum()), _se_of_sum(each)


def leave_one_out(problem: Problem, theta: Array, efficiency: float) -> LeaveOneOut:
    """Cross-validate from posterior draws by Pareto-smoothed importance sampling (ArviZ).

    Each complex value of each line and FRF counts as one.

    Parameters
    ----------
    problem
        The problem.
    theta
        Posterior draws, shape (n, d); those beyond what fits into memory are left out evenly.
    efficiency
        Effective draws over draws, above 0 and at most 1.

    Raises
    ------
    ModelError
        Where values are too few, or not independent given the joint: the message says which.

    References
    ----------
    Vehtari, A., Gelman, A., Gabry, J. (2017). Practical Bayesian model evaluation using leave-one-out cross-validation
    and WAIC. Statistics and Computing 27(5), 1413-1432. DOI 10.1007/s11222-016-9696-4
    """
    likelihood = problem.log_posterior.likelihood
    others = [test.data.words for test in problem.tests if test.data.frfs is None]
    if others or likelihood.n_data < _FEWEST:
        mixed = [f"values, {words} among them" if len(problem.tests) > 1 else words for words in others]
        kind = mixed[0] if others else "values of FRFs"
        raise ModelError(f"it needs {_FEWEST} values of FRFs; there are {likelihood.n_data} {kind}")
    most = max(_FEWEST_DRAWS, _MOST_NUMBERS // likelihood.n_data)
    chosen = theta[np.linspace(0, len(theta) - 1, min(most, len(theta))).round().astype(int)]
    flat = problem.log_posterior.pointwise(chosen).reshape(len(chosen), -1)
    if (flat == flat[0]).all():  # nothing is uncertain: leaving a value out changes nothing
        return LeaveOneOut(flat[0], np.zeros(flat.shape[1]))
    return LeaveOneOut(*loo_pointwise(flat, efficiency))


def _se_of_sum(each: Array) -> float:
    return float(math.sqrt(each.size) * each.std())


#: Ends of 2 ln B, and evidence up to there in the words of Kass and Raftery.
GRADES = (
    (2.0, "not worth more than a bare mention"),
    (6.0, "positive"),
    (10.0, "strong"),
)
_STRONGEST = "very strong"


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
        Coordinates, those of nuisances included.
    stiffness
        Quantities of the joint at the posterior mode, shape (q,); `jointbayes.joint.RIGID` stands for a motion that is
        held.
    evidence
        ln Z of the data with its error, and how it was found.
    at_edge
        Edges of the prior that the posterior piles up on: there ln Z depends on where the prior ends.
    loo
        Cross-validation; None where it makes no sense, and `loo_note` says why.
    quantities
        What the numbers of `stiffness` are.
    """

    case: str
    title: str
    hypothesis: str
    names: tuple[str, ...]
    stiffness: Array
    evidence: Evidence
    at_edge: tuple[PriorEdge, ...]
    loo: LeaveOneOut | None
    loo_note: str
    quantities: tuple[Quantity, ...] = COUPLED

    @property
    def label(self) -> str:
        """Hypothesis and case in words."""
        return f"{self.hypothesis} in {self.case}"

    @property
    def trusted(self) -> bool:
        """Whether the stated error of the evidence may be believed."""
        return not self.evidence.pareto_k > PARETO_LIMIT  # without importance weights k is no number


def bayes_factor_words(two_log_b: float) -> str:
    """Grade of the evidence for the better of two models, from twice the natural logarithm of the Bayes factor.

    Parameters
    ----------
    two_log_b
        2 ln B = 2 (ln Z of the better − ln Z of the other), not negative.

    References
    ----------
    Kass, R. E., Raftery, A. E. (1995). Bayes factors. Journal of the American Statistical Association 90(430),
    773-795, section 3.2. DOI 10.1080/01621459.1995.10476572

    Examples
    --------
    >>> bayes_factor_words(0.6), bayes_factor_words(7.2)
    ('not worth more than a bare mention', 'strong')
    """
    return next((words for limit, words in GRADES if two_log_b <= limit), _STRONGEST)


def model_probabilities(log_z: ArrayLike) -> Array:
    """Posterior probability of each model under equal prior probability, shape (n,), from ln Z, shape (n,).

    Examples
    --------
    >>> model_probabilities(np.log([3.0, 1.0])).round(3).tolist()
    [0.75, 0.25]
    """
    return np.asarray(special.softmax(np.asarray(log_z, dtype=float)))


Row = dict[str, Any]

_METHOD_HEAD = ("Method", "Pareto k")
_REACH = 12.0  # of ln Z below the best that the figure shows


def evidence_table(summary: dict[str, Any], *, method: bool = False) -> Table:
    """All candidates, the best first; on request with how ln Z was found."""
    head = ["Joint", "Case", "ln Z", "2 ln B", "Evidence against it", "Probability", "Mark"]
    rows = [list(_evidence_row(row)) for row in _ranked(summary)]
    if method:
        head[3:3] = _METHOD_HEAD
        for cells, row in zip(rows, _ranked(summary), strict=True):
            cells[3:3] = _method_cells(row)
    kinds = tuple(
        "good" if row["words"] == "best" else "bad" if not row["trusted"] else "caution" if row["at_prior_edge"] else ""
        for row in _ranked(summary)
    )
    return Table("Evidence", tuple(head), tuple(map(tuple, rows)), note=report_text("evidence"), row_kinds=kinds)


def build_comparison_report(summary: dict[str, Any]) -> Report:
    """Build the report of a comparison, verdict first, from the numbers of ``compare.json``."""
    return Report(
        title="Comparison of joints",
        subtitle=" against ".join(dict.fromkeys(foreign(row["title"]) for row in summary["candidates"])),
        lead=_lead(summary),
        sections=(
            ReportSection("evidence", "Evidence", (evidence_table(summary), _figure(summary), _method_table(summary))),
            ReportSection("joints", "Best joint of each candidate", (_joint_table(summary),)),
            ReportSection("cross-validation", "Cross-validation", _loo_blocks(summary)),
            ReportSection("reading", "How to read this", _reading(summary)),
            ReportSection("settings", "Settings", (_settings(summary),)),
        ),
    )


def _ranked(summary: dict[str, Any]) -> list[Row]:
    return sorted(summary["candidates"], key=lambda row: -float(row["log_z"]))


def _signed(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace("-", "−")


def _evidence_row(row: Row) -> tuple[str, ...]:
    error = "" if row["method"] == "exact" else f" ± {number(row['log_z_error'], 1)}"
    marks = ["best"] * (row["words"] == "best") + ["error unreliable"] * (not row["trusted"])
    marks += [f"{edge['name']} at its {edge['side']} edge" for edge in row["at_prior_edge"]]
    return (
        row["hypothesis"],
        foreign(row["case"]),
        _signed(row["log_z"], 2) + error,
        f"{row['two_log_b']:.1f}",
        "–" if row["words"] == "best" else row["words"],
        number(row["probability"], 2),
        ", ".join(marks),
    )


def _method_cells(row: Row) -> tuple[str, str]:
    return row["method"], number(row["pareto_k"], 2).replace("-", "−")


def _lead(summary: dict[str, Any]) -> tuple[Block, ...]:
    told_apart = not any(row["words"] == GRADES[0][1] for row in summary["candidates"])
    kind: Kind = "good" if summary["trusted"] and told_apart else "caution"
    blocks: list[Block] = [Callout(kind, f"**{foreign(summary['verdict'])}**")]
    if not summary["trusted"]:
        names = ", ".join(
            f"{r['hypothesis']} in {foreign(r['case'])}" for r in summary["candidates"] if not r["trusted"]
        )
        blocks.append(Callout("bad", f"**The error of the evidence is unreliable for: {names}.**"))
    return tuple(blocks)


def _figure(summary: dict[str, Any]) -> Figure:
    rows = _ranked(summary)
    log_z, error = (np.array([float(row[key]) for row in rows]) for key in ("log_z", "log_z_error"))
    labels = [f"{row['hypothesis']}, {row['case']}" for row in rows]
    return Figure(
        "evidence-plot",
        "Evidence of each candidate with twice its standard error. Dashed lines, by 2 ln B against the best: the ends "
        f"of evidence that is {'; '.join(f'{words} ({end:g})' for end, words in GRADES)}. An arrow marks a candidate "
        "further down.",
        f"Evidence of {len(rows)} candidates; the best is {foreign(labels[0])} with ln Z {log_z[0]:.2f}.",
        _evidences(labels, log_z, error),
    )


def _evidences(labels: Sequence[str], log_z: Array, error: Array) -> str:
    """ln Z of candidates from the best down, with twice its error; an arrow for what lies far below.

    Lines mark the ends of grades of evidence against the best.
    """

    def draw(canvas: Canvas) -> None:
        short, margin = margin_labels(labels)
        axes = panels(canvas, left=margin, top=0.3)[0, 0]
        blue, orange = SERIES_COLOURS[:2]
        best, place = log_z.max(), np.arange(log_z.size)
        seen = log_z >= best - _REACH
        axes.errorbar(log_z[seen], place[seen], xerr=2 * error[seen], fmt="o", ms=5, lw=1.2, capsize=3, color=blue)
        for y in place[~seen]:
            axes.annotate(
                f"ln Z = {log_z[y]:.1f}".replace("-", "−"), (best - _REACH, y), (best - 0.8 * _REACH, y), va="center",
                fontsize=8, color=orange, arrowprops={"arrowstyle": "->", "color": orange},
            )  # fmt: skip
        for end, _ in GRADES:
            axes.axvline(best - end / 2, color="0.4", lw=0.8, ls="--")
            axes.annotate(f"{end:g}", (best - end / 2, 1.0), xycoords=("data", "axes fraction"), ha="center",
                          va="bottom", fontsize=8, color="0.4")  # fmt: skip
        axes.set_xlim(best - 1.05 * _REACH, best + 0.08 * _REACH)
        axes.set_yticks(place, short)
        axes.set_ylim(log_z.size - 0.5, -0.5)
        axes.set_xlabel("ln Z; dashed: 2 ln B against the best")

    return svg(draw, 7.2, 1.0 + 0.3 * len(labels))


def _method_table(summary: dict[str, Any]) -> Table:
    head = ("Joint", "Case", *_METHOD_HEAD, "Effective draws", "Evaluations")
    rows = tuple(
        (row["hypothesis"], foreign(row["case"]), *_method_cells(row), f"{row['ess']:.0f}", str(row["evaluations"]))
        for row in _ranked(summary)
    )
    return Table("How ln Z was computed", head, rows, note=report_text("pareto", limit=PARETO_LIMIT))


def _joint_table(summary: dict[str, Any]) -> Table:
    units = {name: unit for row in summary["candidates"] for name, unit in row["units"].items()}
    head = ("Joint", "Case", *(f"{foreign(name)} ({unit})" for name, unit in units.items()))
    rows = tuple(
        (row["hypothesis"], foreign(row["case"]), *(_stiffness_cell(row, name) for name in units))
        for row in _ranked(summary)
    )
    return Table("Stiffness at the posterior mode", head, rows)


def _stiffness_cell(row: Row, name: str) -> str:
    if name in row["rigid"]:
        return "rigid"
    return number(row["map"][name]).replace("-", "−", 1) if name in row["map"] else "–"


def _loo_blocks(summary: dict[str, Any]) -> tuple[Block, ...]:
    rows = [row for row in summary["candidates"] if row["loo"]]
    notes = dict.fromkeys(row["loo_note"] for row in summary["candidates"] if row["loo_note"])
    blocks: list[Block] = [Paragraph(f"No cross-validation: {foreign(note)}.") for note in notes]
    if rows:
        rows.sort(key=lambda row: -float(row["loo"]["elpd"]))
        head = ("Joint", "Case", "elpd", "Less than the best", "Largest Pareto k", f"Pareto k above {PARETO_LIMIT:g}")
        cells = tuple(
            (
                row["hypothesis"],
                foreign(row["case"]),
                f"{_signed(row['loo']['elpd'], 1)} ± {row['loo']['se']:.1f}",
                f"{_signed(row['loo']['difference'], 1)} ± {row['loo']['difference_se']:.1f}",
                number(row["loo"]["pareto_k_max"], 2),
                str(row["loo"]["pareto_k_above_0.7"]),
            )
            for row in rows
        )
        blocks.append(Table("Cross-validation", head, cells, note=report_text("elpd")))
    return tuple(blocks)


def _reading(summary: dict[str, Any]) -> tuple[Block, ...]:
    present = dict.fromkeys(row["hypothesis"] for row in summary["candidates"])
    texts = ["; ".join(f"**{name}**: {_meaning(name)}" for name in present) + ".", report_text("comparison")]
    texts += [report_text("nested")] if any(row["method"] == "nested sampling" for row in summary["candidates"]) else []
    texts += [report_text("loo")] if any(row["loo"] for row in summary["candidates"]) else []
    return (*map(Paragraph, texts), references(*texts))


def _meaning(hypothesis: str) -> str:
    undamped, joint = split_hypothesis(hypothesis)
    return f"{report_text(joint)}{', without damping' if undamped else ''}"


def _settings(summary: dict[str, Any]) -> Table:
    rows = [("Seed", str(summary["seed"])), ("Data (SHA-256)", summary["data_sha256"])]
    rows += [(foreign(name), foreign(str(version))) for name, version in summary["versions"].items()]
    return Table("Settings and versions", ("Item", "Value"), tuple(rows), align="ll")


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
    """

    candidates: tuple[WeighedModel, ...]
    seed: int
    data_sha256: str
    case_texts: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"Comparison of {len(self.candidates)} joints: {self.verdict}"

    @property
    def best(self) -> WeighedModel:
        """The candidate of the largest evidence."""
        return max(self.candidates, key=lambda c: c.evidence.log_z)

    @property
    def ranking(self) -> tuple[WeighedModel, ...]:
        """All candidates, the best first."""
        return tuple(sorted(self.candidates, key=lambda c: -c.evidence.log_z))

    @property
    def probabilities(self) -> Array:
        """Posterior probability of each candidate, shape (candidates,), if all were equally probable before."""
        return model_probabilities([c.evidence.log_z for c in self.candidates])

    @property
    def trusted(self) -> bool:
        """Whether every evidence's error may be believed."""
        return all(c.trusted for c in self.candidates)

    def two_log_b(self, candidate: WeighedModel) -> float:
        """2 ln B of the best against a candidate: 0 for the best itself."""
        return 2 * (self.best.evidence.log_z - candidate.evidence.log_z)

    def words(self, candidate: WeighedModel) -> str:
        """Evidence for the best against a candidate in the words of Kass and Raftery; ``"best"`` for itself."""
        return "best" if candidate is self.best else bayes_factor_words(self.two_log_b(candidate))

    @property
    def verdict(self) -> str:
        """One plain sentence, or two, that name the winner."""
        best, *others = self.ranking
        if not others:
            text = f"Nothing was compared: {best.label} is the only joint."
        else:
            two_log_b = self.two_log_b(others[0])
            odds, words = f"odds {likelihood_ratio(two_log_b)} to 1", bayes_factor_words(two_log_b)
            text = f"The data favour {best.label} over {others[0].label}: the evidence is {words}, {odds}."
            if words == GRADES[0][1]:
                text = f"The data cannot tell {best.label} from {others[0].label} ({odds})."
        if best.at_edge:
            edges = ", ".join(dict.fromkeys(edge.name for edge in best.at_edge))
            text += f" Draws pile up at an edge of the prior of {edges}: the prior has a say in this."
        return text

    def summary(self) -> dict[str, Any]:
        """The numbers, as in ``compare.json``."""
        rows = zip(self.candidates, self.probabilities, strict=True)
        return json_ready(
            {
                "verdict": self.verdict,
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
            "pareto_k": z.pareto_k,
            "ess": z.ess,
            "evaluations": z.evaluations,
            "trusted": candidate.trusted,
            "two_log_b": self.two_log_b(candidate),
            "words": self.words(candidate),
            "probability": probability,
            "at_prior_edge": [asdict(edge) for edge in candidate.at_edge],
            "loo": self._loo(candidate),
            "loo_note": candidate.loo_note,
        }

    def _loo(self, candidate: WeighedModel) -> dict[str, Any] | None:
        if candidate.loo is None:
            return None
        best = max([c.loo for c in self.candidates if c.loo is not None], key=lambda loo: loo.elpd)
        difference, se = candidate.loo.difference(best)
        return {
            "elpd": candidate.loo.elpd,
            "se": candidate.loo.se,
            "difference": difference,
            "difference_se": se,
            "pareto_k_max": candidate.loo.pareto_k.max(),
            "pareto_k_above_0.7": int((candidate.loo.pareto_k > PARETO_LIMIT).sum()),
        }

    def write(self, directory: str | os.PathLike[str]) -> Path:
        """Write the comparison into a new directory, or one of another comparison; each file is whole or absent.

        Returns
        -------
        Path
            The directory: ``report.html``, ``report.pdf``, ``compare.json``, ``cases/*.toml``, ``figures/*.svg``.

        Raises
        ------
        WriteError
            If a file cannot be written, the directory holds something else, or another process is at work in it.
        """
        summary = self.summary()
        files = {f"cases/{name}.toml": text for name, text in self.case_texts.items()}
        files["compare.json"] = json_text(summary)
        return write_study(directory, A_COMPARISON, build_comparison_report(summary), files)
