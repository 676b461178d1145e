"""A plan: what to measure next, in a sentence, as the numbers of `plan.json`, and as a report."""

import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure as Canvas

from jointbayes.inference import Problem
from jointbayes.posterior.first_look import Candidate, Linearised, Names
from jointbayes.posterior.identifiability import Verdict
from jointbayes.posterior.next_step import spread_in_words
from jointbayes.report.canvas import legend_above, margin_labels, panels, svg
from jointbayes.report.line_plot import SERIES_COLOURS
from jointbayes.report.markup import foreign
from jointbayes.report.methods import report_text
from jointbayes.report.model import Callout, Figure, Kind, Paragraph, Report, ReportSection, Table
from jointbayes.report.run_directory import json_text
from jointbayes.rounding import in_lines, json_ready, number
from jointbayes.studies.study_directory import sketch_figure, write_study
from vibrecords.arrays import Array

Method = Literal["reweighting", "importance sampling"]

#: A candidate of which more than this share of the simulated posteriors was not found is not ranked.
MOST_LOST = 0.15
#: Probability of a forecast's range.
RANGE = 0.8


@dataclass(frozen=True, slots=True)
class SimulatedPosterior:
    """What one simulated measurement leaves.

    Parameters
    ----------
    sd
        Posterior standard deviation of ln |k| of the wanted stiffness.
    verdict
        On that stiffness, by the rule of `jointbayes.posterior.identifiability.assess`.
    effective
        Effective number of draws behind both.
    method
        How they were found.
    """

    sd: float
    verdict: Verdict
    effective: float
    method: Method


@dataclass(frozen=True, slots=True)
class Simulation:
    """What simulated measurements say of one set of candidates.

    Parameters
    ----------
    posteriors
        One for each truth, in the order of the truths; None where it was not found.
    """

    posteriors: tuple[SimulatedPosterior | None, ...]

    @property
    def found(self) -> tuple[SimulatedPosterior, ...]:
        """Those that were found."""
        return tuple(posterior for posterior in self.posteriors if posterior is not None)

    @property
    def sds(self) -> Array:
        """Standard deviation of ln |k| by truth, shape (truths,); NaN where the posterior was not found."""
        return np.array([math.nan if posterior is None else posterior.sd for posterior in self.posteriors])

    @property
    def lost(self) -> int:
        """Simulated measurements whose posterior was not found."""
        return len(self.posteriors) - len(self.found)

    @property
    def valid(self) -> bool:
        """Whether nearly all simulated posteriors were found: the lost ones need not be like the others."""
        return len(self.found) >= 2 and self.lost <= MOST_LOST * len(self.posteriors)

    @property
    def median(self) -> float:
        """Median of the standard deviations found."""
        return float(np.median([posterior.sd for posterior in self.found])) if self.found else math.nan

    @property
    def range80(self) -> tuple[float, float]:
        """10th and 90th percentile of the standard deviations found, see `predictive_range`."""
        return predictive_range([posterior.sd for posterior in self.found])

    @property
    def verdict(self) -> Verdict:
        """The most frequent verdict; of equally frequent ones that of the wider posterior."""
        counts = Counter(posterior.verdict for posterior in sorted(self.found, key=lambda posterior: -posterior.sd))
        return counts.most_common(1)[0][0]

    @property
    def agreeing(self) -> int:
        """How many simulated posteriors have the most frequent verdict."""
        return sum(posterior.verdict == self.verdict for posterior in self.found)

    @property
    def reweighted(self) -> int:
        """How many posteriors were found by reweighting draws of the present one."""
        return sum(posterior.method == "reweighting" for posterior in self.found)


def predictive_range(values: Sequence[float]) -> tuple[float, float]:
    """10th and 90th percentile such that a further value lies between them with a probability of 80 %.

    With n values the p-quantile is at place p(n + 1) among them: exact for any continuous distribution from n = 9 on,
    where it is from the least to the greatest; the usual place 1 + p(n − 1) would hold only 64 % there.

    References
    ----------
    Hyndman, R. J., Fan, Y. (1996). Sample quantiles in statistical packages. The American Statistician 50(4), 361-365.
    DOI 10.2307/2684934 (definition 6)

    Examples
    --------
    >>> low, high = predictive_range([float(i) for i in range(1, 20)])
    >>> round(low, 9), round(high, 9)
    (2.0, 18.0)
    """
    if not len(values):
        return math.nan, math.nan
    tail = (1 - RANGE) / 2
    low, high = np.quantile(values, [tail, 1 - tail], method="weibull")
    return float(low), float(high)


Entry = Mapping[str, Any]

#: What the directory of a plan holds.
A_PLAN = "a plan"
#: A measurement helps if it leaves at most this share of the present standard deviation, in the median.
HELPS = 0.9
#: Another is about as good as the first if it did better for at least this share of the truths.
AS_GOOD = 1 / 3


@dataclass(frozen=True, slots=True)
class PlannedMeasurement:
    """A candidate, or a set of them, and what is forecast of it.

    Parameters
    ----------
    candidates
        The measurements to be made together.
    linearised
        First look by Fisher information about draws of the present posterior.
    simulation
        What simulated measurements say; None where none was made.
    """

    candidates: tuple[Candidate, ...]
    linearised: Linearised
    simulation: Simulation | None = None

    @property
    def names(self) -> Names:
        """Names of the candidates."""
        return tuple(candidate.name for candidate in self.candidates)

    @property
    def label(self) -> str:
        """The names in one."""
        return " + ".join(self.names)

    @property
    def words(self) -> str:
        """The candidates for a sentence."""
        words = [candidate.words for candidate in self.candidates]
        return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"

    @property
    def ranked(self) -> bool:
        """Whether simulations stand behind it, so that it may be recommended."""
        return self.simulation is not None and self.simulation.valid

    @property
    def sd_after(self) -> float:
        """Median simulated standard deviation; NaN where it is not ranked."""
        return self.simulation.median if self.simulation is not None and self.simulation.valid else math.nan

    @property
    def rank(self) -> tuple[bool, float]:
        """What measurements are sorted by: simulated ones by their simulations, then the others by the first look."""
        return (not self.ranked, self.sd_after if self.ranked else self.linearised.median)

    def as_json(self) -> dict[str, Any]:
        """One entry of `plan.json`."""
        return {
            "names": list(self.names),
            "words": self.words,
            "positions": [candidate.position for candidate in self.candidates],
            "simulated": None if self.simulation is None else _simulated(self.simulation),
            "linearised": {"median": self.linearised.median, "range": self.linearised.ends},
        }


def _simulated(simulation: Simulation) -> dict[str, Any]:
    return {
        "valid": simulation.valid,
        "sd_median": simulation.median,
        "sd_range80": simulation.range80,
        "sds": simulation.sds.tolist(),
        "verdict": simulation.verdict if simulation.found else None,
        "verdict_count": simulation.agreeing if simulation.found else 0,
        "truths": len(simulation.posteriors),
        "lost": simulation.lost,
        "reweighted": simulation.reweighted,
        "least_effective": min((draws.effective for draws in simulation.found), default=None),
    }


@dataclass(frozen=True, eq=False)
class Plan:
    """Further measurements of a case, ranked by simulation.

    Parameters
    ----------
    case_name, title
        Of the case.
    seed
        Seed of the one random generator.
    parameter
        The stiffness to be known best.
    now
        What the present posterior says of it.
    measurements
        Candidates and sets: simulated ones first, by their median standard deviation; then the others, by their
        linearised one.
    converged, reason
        Whether the sampler of the present posterior converged, and why it stopped.
    assumed
        Whether the joint of the simulated measurements was stated, rather than drawn from the present posterior.
    left_out
        Sets that could come first by their linearised range and were not simulated, for there are too many.
    case_text
        Of the case file.
    exact
        Modulus, density, length and damping, or those of them that the case takes as exact, for a sentence.
    tested
        The test whose structure the report shows; none where it shows no sketch.
    """

    case_name: str
    title: str
    seed: int
    parameter: str
    now: SimulatedPosterior
    measurements: tuple[PlannedMeasurement, ...]
    converged: bool
    reason: str
    assumed: bool = False
    left_out: int = 0
    case_text: str = ""
    exact: str = ""
    tested: Problem | None = None

    def __repr__(self) -> str:
        text = f"Plan for {self.case_name}, {len(self.measurements)} measurements: {self.sentence}"
        return "\n".join(in_lines(text, 0))

    @property
    def ranked(self) -> tuple[PlannedMeasurement, ...]:
        """Measurements with simulations behind them, the best first."""
        return tuple(data for data in self.measurements if data.ranked)

    @property
    def recommended(self) -> PlannedMeasurement | None:
        """The measurement to make next.

        That of the least median simulated standard deviation, if it leaves at most nine tenths of the present one.
        None if no simulation stands behind any, or if the present posterior had not converged.
        """
        best = next(iter(self.ranked), None)
        if best is None or not self.converged or best.sd_after > HELPS * self.now.sd:
            return None
        return best

    @property
    def as_good(self) -> tuple[PlannedMeasurement, ...]:
        """Measurements that did better than the recommended one for a third of the same truths or more."""
        best = self.recommended
        if best is None:
            return ()
        return tuple(data for data in self.ranked[1:] if _share_better(data, best) >= AS_GOOD)

    @property
    def sentence(self) -> str:
        """The recommendation in plain words, with what would do about as well."""
        return " ".join(self.sentences)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The same, sentence by sentence."""
        more = [f"About as good: {', '.join(data.label for data in self.as_good)}."] if self.as_good else []
        return (self._advice, *more)

    @property
    def _advice(self) -> str:
        if not self.converged:
            return "No recommendation: the calculation for the data in hand has not settled."
        if not self.ranked:
            return "No recommendation: every simulation failed."
        best = self.recommended
        now = f"{spread_in_words(self.now.sd)} ({self.now.verdict})"
        if best is None:
            first = self.ranked[0]
            return (
                f"None of the {len(self.ranked)} simulated measurements would narrow {self.parameter} much: it is now "
                f"known to {now}, and after the best, {first.words}, to {spread_in_words(first.sd_after)}."
            )
        assert best.simulation is not None
        between = " and ".join(map(spread_in_words, best.simulation.range80))
        return (
            f"Measure next: {best.words}. Forecast: {self.parameter} known to {spread_in_words(best.sd_after)} "
            f"({best.simulation.verdict}; in 80 % of simulations between {between}); now {now}."
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What the reader must know to trust the plan."""
        notes = []
        if self.assumed:
            notes.append("The measurements were simulated for a stated joint, not for what the present data allow.")
        lost = [data.label for data in self.measurements if data.simulation is not None and not data.simulation.valid]
        if lost:
            notes.append(f"Not ranked, because too many simulations failed: {', '.join(lost)}.")
        if self.left_out:
            notes.append(
                f"{self.left_out} further sets that could rank first by the linearised estimate were not simulated."
            )
        if self.exact:
            notes.append(f"This plan takes {self.exact} as exact: where that is not so, less will be known.")
        return tuple(notes)

    def write(self, directory: str | os.PathLike[str]) -> Path:
        """Write the plan into the directory that `plan` was given, or any other; each file is whole or absent.

        Returns
        -------
        Path
            The directory: ``report.html``, ``report.pdf``, ``plan.json``, ``case.toml``, ``figures/plan.svg``.

        Raises
        ------
        WriteError
            If a file cannot be written, the directory holds something else, or another process is at work in it.
        """
        summary = self.summary()
        files = {"case.toml": self.case_text, "plan.json": json_text(summary)}
        return write_study(directory, A_PLAN, build_plan_report(summary, self.tested), files)

    def summary(self) -> dict[str, Any]:
        """The plan as one JSON-ready dictionary: `plan.json`, described in docs/planning.md."""
        best = self.recommended
        return json_ready(
            {
                "schema_version": 2,
                "case": self.case_name,
                "title": self.title,
                "seed": self.seed,
                "parameter": self.parameter,
                "assumed": self.assumed,
                "converged": self.converged,
                "reason": self.reason,
                "now": {"sd": self.now.sd, "verdict": self.now.verdict},
                "measurements": [data.as_json() for data in self.measurements],
                "recommended": None if best is None else list(best.names),
                "as_good": [list(data.names) for data in self.as_good],
                "sentence": self.sentence,
                "notes": list(self.notes),
            }
        )


def _share_better(data: PlannedMeasurement, best: PlannedMeasurement) -> float:
    """Share of the truths that both were simulated for in which the first leaves less than the second."""
    assert data.simulation is not None
    assert best.simulation is not None
    count = min(len(data.simulation.sds), len(best.simulation.sds))
    mine, other = data.simulation.sds[:count], best.simulation.sds[:count]
    both = np.isfinite(mine) & np.isfinite(other)
    return float((mine < other)[both].mean()) if both.any() else 0.0


def candidate_table(summary: Mapping[str, Any]) -> Table:
    """Each measurement: simulated ones by their median standard deviation, then those that were not simulated."""
    parameter, now = summary["parameter"], summary["now"]
    rows = [_row(entry, summary["recommended"]) for entry in summary["measurements"]]
    present = ("(now)", "", spread_in_words(now["sd"]), "", now["verdict"], "present posterior")
    return Table(
        f"Further measurements and how well {parameter} would then be known",
        (
            "Measurement",
            "Position",
            f"{parameter} known to",
            "In 80 % of simulations between",
            "Verdict then",
            "Based on",
        ),
        (*rows, present),
        align="llllll",
        note="95 % interval over its median, by the median simulation. About: by Fisher information alone, and never "
        "recommended.",
    )


def plan_lines(plan: Plan) -> list[str]:
    """A plan as lines for the terminal: the table, the recommendation and notes."""
    table = candidate_table(plan.summary())
    return [*plan.sentences, *plan.notes, "", *table.lines(), table.note]


def _row(entry: Entry, recommended: Sequence[str] | None) -> tuple[str, ...]:
    names = foreign(" + ".join(entry["names"])) + (" (recommended)" if entry["names"] == recommended else "")
    where = foreign(" + ".join(place for place in entry["positions"] if place))
    simulated = entry["simulated"]
    if simulated is None:
        sd = entry["linearised"]["median"]
        return names, where, "–" if sd is None else f"about {spread_in_words(sd)}", "–", "–", "not simulated"
    if not simulated["valid"]:
        return names, where, "–", "–", "–", f"{simulated['lost']} of {simulated['truths']} simulations failed"
    between = " and ".join(map(spread_in_words, simulated["sd_range80"]))
    count = simulated["truths"] - simulated["lost"]
    return names, where, spread_in_words(simulated["sd_median"]), between, simulated["verdict"], f"{count} simulations"


def build_plan_report(summary: Mapping[str, Any], tested: Problem | None = None) -> Report:
    """Build the report of a plan from its summary and the test to sketch, the recommendation first."""
    parameter = summary["parameter"]
    entries: Sequence[Entry] = summary["measurements"]
    source = "the stated joint" if summary["assumed"] else "joints drawn from the present posterior"
    figure = _figure(entries, parameter, summary["now"])
    sections = (
        ReportSection("candidates", "Candidates", (candidate_table(summary),)),
        ReportSection("method", "How this was computed", (Paragraph(report_text("plan", source=source)),)),
    )
    kind: Kind = "bad" if not summary["converged"] else "caution" if summary["recommended"] is None else "good"
    return Report(
        title=foreign(summary["title"]),
        subtitle=f"What to measure next to know {parameter}",
        lead=(
            Callout(kind, foreign(summary["sentence"])),
            *(Callout("caution", foreign(note)) for note in summary["notes"]),
            *sketch_figure(tested),
            figure,
        ),
        sections=sections,
    )


def _figure(entries: Sequence[Entry], parameter: str, now: Entry) -> Figure:
    simulated = [e for e in entries if e["simulated"] is not None and e["simulated"]["valid"]]
    alt = f"Standard deviation of ln {parameter} after each simulated measurement: " + ", ".join(
        f"{foreign(' + '.join(e['names']))} {number(e['simulated']['sd_median'])}" for e in simulated
    )
    return Figure("plan", report_text("plan_figure", parameter=parameter), alt, _ranges(entries, parameter, now))


def _ranges(entries: Sequence[Entry], parameter: str, now: Entry) -> str:
    """One line for each measurement, best on top, on a logarithmic axis."""

    def draw(canvas: Canvas) -> None:
        labels, margin = margin_labels([" + ".join(e["names"]) for e in entries])
        axes = panels(canvas, left=margin, top=0.3)[0, 0]
        place = np.arange(len(entries))[::-1]
        colour = SERIES_COLOURS[0]
        for y, entry in zip(place, entries, strict=True):
            simulated = entry["simulated"]
            if simulated is not None and simulated["valid"]:
                sds = [sd for sd in simulated["sds"] if sd is not None]
                axes.hlines(y, *simulated["sd_range80"], color=colour, lw=2)
                axes.plot(sds, np.full(len(sds), y), "o", ms=2.5, color=SERIES_COLOURS[1], alpha=0.6)
                axes.plot(simulated["sd_median"], y, "o", ms=6, color=colour)
            elif simulated is None and entry["linearised"]["median"] is not None:
                axes.plot(entry["linearised"]["median"], y, "x", ms=6, color="0.4")
        axes.axvline(now["sd"], color="0.4", ls="--", lw=1, label="now")
        axes.set_xscale("log")
        axes.set_yticks(place, labels)
        axes.set_ylim(-0.6, len(entries) - 0.4)
        axes.set_xlabel(f"Standard deviation of ln {parameter}")
        legend_above(axes)

    return svg(draw, 6.2, 1.1 + 0.22 * len(entries))  # with the sketch on one page
