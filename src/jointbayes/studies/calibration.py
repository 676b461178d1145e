"""Calibrate the analysis of one case by many data sets with known truths, analysed side by side, and report on it.

What is found is ranks and coverage of each quantity, judged together.
"""

import csv
import io
import os
import pickle
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure as Canvas

from jointbayes.case.case import Case, require_case
from jointbayes.errors import ModelError, SamplingError
from jointbayes.inference import Problem
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.report.canvas import panels, svg
from jointbayes.report.line_plot import SERIES_COLOURS
from jointbayes.report.methods import report_text
from jointbayes.report.model import Block, Callout, Figure, Kind, Paragraph, Report, ReportSection, Table
from jointbayes.report.run_directory import json_text
from jointbayes.rounding import in_lines, number
from jointbayes.sampling import SamplerSettings
from jointbayes.studies.data_sets import (
    DENSITY,
    DRAWS,
    DataSet,
    Job,
    QuantityCalibration,
    analyse_packed,
    judge,
    require_simulable,
)
from jointbayes.studies.study_directory import sketch_figure, write_study
from jointbayes.studies.workers import run_tasks
from jointbayes.workflow import Analysed, answered_case, sample
from vibrecords.arrays import Array

if TYPE_CHECKING:
    from distributed import Client


#: What the directory of a calibration holds.
A_CALIBRATION = "a calibration"
#: Share of right analyses that fail, at most: over all quantities together, each at this over their number.
FALSE_ALARM = 0.01
#: Below this the verdict says that a second seed should be looked at.
SUSPICIOUS = 0.05
_SHOWN = 3  # different errors in a summary


@dataclass(frozen=True, eq=False)
class Calibration:
    """Ranks of truths over many simulated data sets of one case, and whether they are what they should be.

    Parameters
    ----------
    name
        Of the case whose analysis was calibrated.
    source
        Name of the case that gave truths and data, where it is another; empty where it is the same.
    seed
        Of the calibration.
    names
        Quantities that were ranked.
    data_sets
        All of them, in order; those whose analysis failed as well.
    title, case_text
        Of the case, where a case file states it.
    near
        Whether truths are from the posterior of the measured data, not from the prior.
    tested
        The test whose structure the report shows; none where it shows no sketch.

    Raises
    ------
    ModelError
        If not one data set has a posterior.
    """

    name: str
    source: str
    seed: int
    names: tuple[str, ...]
    data_sets: tuple[DataSet, ...]
    title: str = ""
    case_text: str = ""
    near: bool = False
    tested: Problem | None = None

    def __post_init__(self) -> None:
        if not self.analysed:
            why = f": {self.errors[0]}" if self.errors else ""
            raise ModelError(
                f"calibrate: found that not one of {len(self.data_sets)} data sets of {self.name} could be analysed"
                f"{why}; expected posteriors; run the case itself first"
            )

    def __repr__(self) -> str:
        return "\n".join(in_lines(f"Calibration of {self.name!r}, {len(self.data_sets)} data sets: {self.verdict}", 0))

    @cached_property
    def analysed(self) -> tuple[DataSet, ...]:
        """Data sets that have a posterior, converged or not."""
        return tuple(data_set for data_set in self.data_sets if not data_set.error)

    @property
    def failed(self) -> int:
        """Data sets whose analysis ended in an error."""
        return len(self.data_sets) - len(self.analysed)

    @property
    def errors(self) -> tuple[str, ...]:
        """The different errors."""
        return tuple(dict.fromkeys(data_set.error for data_set in self.data_sets if data_set.error))

    @property
    def not_converged(self) -> int:
        """Data sets whose sampler did not meet its stop rule; they are ranked as the others."""
        return sum(not data_set.converged for data_set in self.analysed)

    @cached_property
    def quantities(self) -> tuple[QuantityCalibration, ...]:
        """Each quantity with its band, which all of them keep together in 99 % of right analyses at least."""
        each = range(len(self.names))
        return judge(
            {self.names[i]: self._column("rank", i) for i in each},
            {self.names[i]: np.stack([self._column("low", i), self._column("high", i)], axis=-1) for i in each},
            {self.names[i]: self._column("truth", i) for i in each},
            DRAWS,
            1 - FALSE_ALARM / len(self.names),
            self.failed,
        )

    def _column(self, field: str, i: int) -> Array:
        return np.array([getattr(data_set, field)[i] for data_set in self.analysed])

    @property
    def p_value(self) -> float:
        """Probability, at most, that a right analysis looks as bad in its worst quantity: Bonferroni's bound."""
        return min(1.0, len(self.quantities) * min(quantity.p_value for quantity in self.quantities))

    @property
    def outside(self) -> tuple[QuantityCalibration, ...]:
        """Quantities whose ranks leave their band."""
        return tuple(quantity for quantity in self.quantities if not quantity.inside_band)

    @property
    def passed(self) -> bool:
        """Whether the ranks of all quantities stay inside their bands."""
        return not self.outside

    @property
    def verdict(self) -> str:
        """The outcome in a sentence."""
        count, of = len(self.data_sets), f" of {self.source}" if self.source else ""
        where = " near the data" if self.near else ""
        if self.passed:
            near = f" That is below {SUSPICIOUS:g}: look at another seed, or at more data sets."
            return (
                f"Calibrated{where}: over {count} data sets{of} the ranks of all {len(self.names)} quantities stay "
                f"inside their bands (p = {self.p_value:.2g}).{near if self.p_value < SUSPICIOUS else ''}"
            )
        findings = "; ".join(f"{quantity.name}: {quantity.finding}" for quantity in self.outside[:_SHOWN])
        return (
            f"NOT CALIBRATED{where}: over {count} data sets{of} the ranks of {len(self.outside)} of {len(self.names)} "
            f"quantities leave their bands (p = {self.p_value:.2g}). {findings}."
        )

    @property
    def answer(self) -> str:
        """Whether intervals of this analysis can be trusted, and how often they held the truth."""
        held = [f"{q.name} {100 * q.coverage.share:.3g} %" for q in self.quantities]
        more = f" and {len(held) - _SHOWN} more" if len(held) > _SHOWN else ""
        where = " near these data" if self.near else ""
        held_by = (
            f"of {len(self.data_sets)} data sets the 95 % interval held the truth for {', '.join(held[:_SHOWN])}{more}"
        )
        said = "Nothing speaks against the intervals" if self.passed else "The intervals can NOT be trusted"
        return f"{said}{where}: {held_by}."

    @property
    def notes(self) -> tuple[str, ...]:
        """What else has to be known of it, in sentences."""
        notes = []
        if self.failed:
            notes.append(
                f"{self.failed} of {len(self.data_sets)} analyses failed, and count as intervals that missed, with "
                "ranks at the end that looks worse."
            )
            notes += [f"{error}." for error in self.errors[:_SHOWN]]
        if self.not_converged:
            notes.append(
                f"{self.not_converged} of {len(self.data_sets)} samplers did not converge. Their ranks count as the "
                "others: leaving them out would leave out certain truths."
            )
        return tuple(notes)

    def write(self, directory: str | os.PathLike[str]) -> Path:
        """Write what was found into a directory, each file whole or absent.

        Returns
        -------
        Path
            The directory: ``report.html``, ``report.pdf``, ``summary.json``, ``ranks.csv``, ``case.toml`` of a case,
            and ``figures/ranks.svg``.

        Raises
        ------
        WriteError
            If a file cannot be written, the directory holds something else, or another process is at work in it.
        """
        files = {"ranks.csv": ranks_csv(self)} | ({"case.toml": self.case_text} if self.case_text else {})
        files["summary.json"] = json_text(self.summary())
        return write_study(directory, A_CALIBRATION, build_calibration_report(self), files)

    def summary(self) -> dict[str, Any]:
        """The numbers as JSON: what ``summary.json`` of a calibration holds."""
        analysed: Sequence[DataSet] = self.analysed
        return {
            "schema_version": 1,
            "case": self.name,
            "data_from": self.source or None,
            "truths_from": "posterior" if self.near else "prior",
            "seed": self.seed,
            "data_sets": len(self.data_sets),
            "failed": self.failed,
            "errors": list(self.errors[:_SHOWN]),
            "converged": len(analysed) - self.not_converged,
            "mode_agrees": sum(data_set.mode_agrees for data_set in analysed),
            "median_ess": float(np.median([data_set.ess for data_set in analysed])),
            "median_seconds": float(np.median([data_set.seconds for data_set in self.data_sets])),
            "total_seconds": float(np.sum([data_set.seconds for data_set in self.data_sets])),
            "ranked_among": DRAWS,
            "passed": self.passed,
            "p_value": self.p_value,
            "false_alarm": FALSE_ALARM,
            "answer": self.answer,
            "verdict": self.verdict,
            "notes": list(self.notes),
            "quantities": {quantity.name: _entry(quantity) for quantity in self.quantities},
        }


def _entry(quantity: QuantityCalibration) -> dict[str, Any]:
    return {
        "inside_band": quantity.inside_band,
        "p_value": quantity.p_value,
        "largest_deviation": quantity.largest_deviation,
        "finding": None if quantity.inside_band else quantity.finding,
        "coverage95": quantity.coverage.share,
        "covered": quantity.coverage.inside,
        "coverage_interval95": list(quantity.coverage.interval95),
    }


_COLUMNS = 4
_FIGURE = "ranks"


def calibration_table(calibration: Calibration) -> Table:
    """Each quantity: whether its ranks stay inside the band, and how often its intervals held the truth."""
    rows = tuple(
        (
            quantity.name,
            "inside" if quantity.inside_band else f"OUTSIDE: {quantity.finding}",
            f"{quantity.p_value:.2g}",
            f"{quantity.largest_deviation:+.3f}",
            f"{100 * quantity.coverage.share:.1f} % ({100 * low:.1f} to {100 * high:.1f})",
        )
        for quantity in calibration.quantities
        for low, high in [quantity.coverage.interval95]
    )
    return Table(
        "Ranks of the truths, and 95 % intervals that held them",
        ("Quantity", "Ranks and band", "p", "Largest deviation", "Intervals that held the truth"),
        rows,
        align="llrrr",
        note="In brackets what so many data sets can tell of the share (95 %). A deviation above 0: draws lie above "
        f"the truths. The bands are for {len(rows)} quantities together, p is for each by itself.",
        row_kinds=tuple("good" if quantity.inside_band else "bad" for quantity in calibration.quantities),
    )


def calibration_lines(calibration: Calibration) -> list[str]:
    """A calibration as lines for the terminal."""
    first = (calibration.answer, calibration.verdict, *calibration.notes)
    return [*first, "", *calibration_table(calibration).lines()]


def build_calibration_report(calibration: Calibration) -> Report:
    """Build the report, the verdict first."""
    suspicious = calibration.p_value < SUSPICIOUS or bool(calibration.notes)
    kind: Kind = "bad" if not calibration.passed else "caution" if suspicious else "good"
    sections = (
        ReportSection("quantities", "Ranks and coverage", (calibration_table(calibration),)),
        ReportSection("data-sets", "Data sets", (_data_sets(calibration),)),
        ReportSection("method", "How this was computed", _method(calibration)),
    )
    source = f", by data of {calibration.source}" if calibration.source else ""
    near = " near its data" if calibration.near else ""
    return Report(
        title=calibration.title or calibration.name,
        subtitle=f"Calibration of the analysis of {calibration.name}{near}{source}",
        lead=(
            Callout(kind, f"**{calibration.answer}** {calibration.verdict}"),
            *(Callout("caution", note) for note in calibration.notes),
            *sketch_figure(calibration.tested),
            _figure(calibration),
        ),
        sections=sections,
    )


def _method(calibration: Calibration) -> tuple[Block, ...]:
    source = calibration.source or "the case"
    prior = f"the priors of {source}, of the joint and of all else that is uncertain"
    truths = f"the posterior that the data of {source} leave" if calibration.near else prior
    texts = (
        report_text("calibration", truths=truths),
        *((report_text("calibration_near"),) if calibration.near else ()),
        report_text(
            "calibration_ranks",
            draws=DRAWS,
            level=f"{FALSE_ALARM:g}/{len(calibration.names)}",
            held=100 * (1 - FALSE_ALARM),
            seed=calibration.seed,
        ),
    )
    return tuple(map(Paragraph, texts))


def _data_sets(calibration: Calibration) -> Table:
    summary = calibration.summary()
    rows = (
        ("analysed", str(len(calibration.analysed))),
        ("failed", str(calibration.failed)),
        ("sampler not converged", str(calibration.not_converged)),
        ("joint mode and MAP agree", str(summary["mode_agrees"])),
        ("effective draws, median", number(summary["median_ess"])),
        ("processor time of each, median", f"{summary['median_seconds']:.2g} s"),
        ("processor time of all", f"{summary['total_seconds'] / 60:.3g} min"),
    )
    return Table(f"Results of {len(calibration.data_sets)} data sets", ("", "Data sets"), rows, align="lr")


def _figure(calibration: Calibration) -> Figure:
    quantities = calibration.quantities
    words = "; ".join(f"{quantity.name} {'inside' if quantity.inside_band else 'outside'}" for quantity in quantities)
    caption = (
        "Empirical distribution of the ranks less the uniform one, with its simultaneous band. Above 0 throughout: "
        "draws lie above the truths. Above 0 on the left and below on the right: posteriors are too narrow."
    )
    return Figure(_FIGURE, caption, f"Ranks of the truths and their bands: {words}.", ranks_figure(quantities))


def ranks_figure(quantities: Sequence[QuantityCalibration]) -> str:
    """SVG text: for each quantity the distribution of its ranks less the uniform one, in its band."""
    columns = min(_COLUMNS, len(quantities))
    rows = -(-len(quantities) // columns)

    def draw(canvas: Canvas) -> None:
        axes = panels(canvas, rows, columns, top=0.25, apart=(0.3, 0.15), sharex=True, sharey=True)
        for ax, quantity in zip(axes.ravel(), quantities, strict=False):
            u, colour = quantity.band.position, SERIES_COLOURS[0 if quantity.inside_band else 1]
            ax.fill_between(u, quantity.band.low - u, quantity.band.high - u, step="post", color="0.85", lw=0)
            ax.step(u, quantity.shares - u, where="post", lw=1.0, color=colour)
            ax.set_title(quantity.name if quantity.inside_band else f"{quantity.name}: outside", fontsize=8)
        for ax in axes.ravel()[len(quantities) :]:
            ax.set_axis_off()
        for ax in axes[:, 0]:
            ax.set_ylabel("ECDF − uniform")
        for ax in axes.ravel()[len(quantities) - columns : len(quantities)]:
            ax.set_xlabel("rank / draws")
            ax.tick_params(labelbottom=True)

    return svg(draw, 1.0 + 1.8 * columns, 0.6 + 1.7 * rows)


def ranks_csv(calibration: Calibration) -> str:
    """One row for each data set: what became of it, and truth, rank and interval of each quantity."""
    names = calibration.names
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    each = [f"{name}.{field}" for name in names for field in ("rank", "truth", "low95", "high95")]
    table.writerow(["data_set", "status", "converged", "ess", "seconds", "error", *each])
    for data_set in calibration.data_sets:
        seconds = round(data_set.seconds, 3)
        if data_set.error:
            table.writerow([data_set.index, "failed", "", "", seconds, data_set.error, *[""] * len(each)])
            continue
        fields = zip(data_set.rank, data_set.truth, data_set.low, data_set.high, strict=True)
        converged, ess = str(data_set.converged).lower(), round(data_set.ess, 1)
        table.writerow([data_set.index, "done", converged, ess, seconds, "", *chain.from_iterable(fields)])
    return stream.getvalue()


def calibrate(
    case: Analysed,
    n: int = 1000,
    *,
    data_from: Analysed | None = None,
    near: bool = False,
    settings: SamplerSettings | None = None,
    seed: int | None = None,
    workers: int | None = None,
    scheduler: "str | Client | None" = None,
    executor: Executor | None = None,
    progress: ProgressCallback | bool | None = None,
) -> Calibration:
    """Judge the whole analysis of a case by simulated data whose truths are known.

    Truths are drawn from the case's own priors, of the joint and of all else that is uncertain, and data from its own
    likelihood at its own lines; each data set is analysed as the case's would be, from the search for the mode to the
    draws, and the truth is ranked among the draws. If prior, likelihood and sampler are right the ranks are uniform,
    for every quantity, whatever the data. Where a run answers by the modes of measured FRFs, or with errors of the
    model, so does each data set.

    Parameters
    ----------
    case
        The case, the path of its file, or the problem.
    n
        Number of data sets.
    seed
        By default the case's, 1 of a problem. Data set i is a function of seed and i alone.
    data_from
        Another case, or problem, that is measured alike: truths and data are its own, and `case` analyses them. So it
        shows what an analysis is worth where another model is the right one.
    near
        Whether truths are drawn from the posterior that the measured data leave, not from the prior, and each data set
        is analysed together with the measured ones: the analysis is judged where the joint at hand is. Errors of the
        model are drawn anew for each data set, as stated.
    settings
        Of the sampler; by default `SamplerSettings.for_one_of_many` of the case's: truths are ranked among 63 draws.
    workers, scheduler, executor
        On what data sets are analysed: see `run_tasks`. By default one process for each processor.
    progress
        Called at the beginning and after each data set.

    Returns
    -------
    Calibration
        ``.passed``, ``.verdict``, ``.quantities`` with ranks, bands and coverage, ``.summary()``.

    Raises
    ------
    ModelError
        If no data can be drawn from the likelihood, nothing is uncertain, or not one data set could be analysed.
    MeasurementError
        If the other case measures other things.
    SamplingError
        If the posterior of which truths are drawn has not converged.

    References
    ----------
    Talts, S. et al. (2018). Validating Bayesian inference algorithms with simulation-based calibration.
    arXiv:1804.06788

    Säilynoja, T., Schmitt, M., Bürkner, P.-C., Vehtari, A. (2025). Posterior SBC: simulation-based calibration checking
    conditional on data. arXiv:2502.03279
    """
    if n < 1:
        raise ModelError(f"calibrate: found n = {n}; expected one data set at least; correct it")
    case = case if isinstance(case, Problem) else require_case(case, "a case, a problem")
    if data_from is not None and not isinstance(data_from, Problem):
        data_from = require_case(data_from, "a case, a problem")
    source = case if data_from is None else data_from
    tell = callback_of(progress)
    job = _job(case, data_from, settings, seed, tell)
    if near:
        job = replace(job, truths=_truths_near(source, n, job.seed, tell))
    done = _done(job, n, tell, {"workers": workers, "scheduler": scheduler, "executor": executor})
    of, other = job.analysis, "" if job.source is job.analysis else job.source.name
    title, text = ("", "") if isinstance(case, Problem) else (case.title, case.text)
    data_sets = tuple(done[i] for i in range(n))
    return Calibration(of.name, other, job.seed, job.names, data_sets, title, text, near, of.parts[0])


def _done(job: Job, n: int, tell: ProgressCallback, engine: dict[str, Any]) -> dict[int, DataSet]:
    """The first n data sets by number; one that cost its workers their life counts as an analysis that failed."""
    done: dict[int, DataSet] = {}
    start = Progress("calibrating", done=0, total=n, unit="data sets")
    tell(start)
    began = time.monotonic()
    packed = _packed(job)
    tasks = ((str(i), (packed, i)) for i in range(n))
    for outcome in run_tasks(analyse_packed, tasks, preload=[analyse_packed.__module__], **engine):
        i = int(outcome.key)
        done[i] = outcome.value if outcome.error is None else DataSet(i, 0.0, error=outcome.error)
        tell(replace(start, done=len(done), elapsed_seconds=time.monotonic() - began))
    return done


def _job(
    case: Case | Problem,
    data_from: Case | Problem | None,
    settings: SamplerSettings | None,
    seed: int | None,
    tell: ProgressCallback,
) -> Job:
    stated, sampler, own_seed = _parts(case)
    require_simulable(stated, stated if data_from is None else _parts(data_from)[0])
    seed = own_seed if seed is None else seed
    # without what was computed from them so far, which every worker would be sent
    analysis = replace(answered_case(case, seed, tell))
    source = analysis if data_from is None else replace(answered_case(data_from, seed, tell))
    require_simulable(analysis, source)  # once more: by which modes two measured FRFs are analysed may differ
    job = Job(analysis, source, settings or sampler.for_one_of_many(), seed)
    if not set(job.names) - {DENSITY}:
        raise ModelError(
            f"calibrate: found no quantity that {analysis.name} leaves open{'' if data_from is None else ' in both'}; "
            "expected one at least; give it a prior"
        )
    return job


def _truths_near(case: Analysed, n: int, seed: int, tell: ProgressCallback) -> Array:
    """Draws θ (n, d) of the posterior of a case as it is run; the first of them are the same for every n."""
    posterior = sample(case, seed=seed, progress=tell)
    if not posterior.converged:
        raise SamplingError(
            f"calibrate: found that the posterior of {posterior.problem.name}, of which truths are drawn, has not "
            f"converged ({posterior.reason}); expected draws of it; run the case, and do what its report says"
        )
    return posterior.theta[np.resize(np.random.default_rng(seed).permutation(len(posterior.theta)), n)]


def _parts(case: Case | Problem) -> tuple[Problem, SamplerSettings, int]:
    if isinstance(case, Problem):
        return case, SamplerSettings().for_dimension(len(case.prior.names)), 1
    return case.problem, case.sampler, case.spec.sampling.seed


def _packed(job: Job) -> bytes:
    try:
        return pickle.dumps(job)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ModelError(
            f"calibrate: found a problem that cannot be sent to another process ({error}); expected priors and noise "
            "models whose classes are defined at the top of a module; move them there"
        ) from error
