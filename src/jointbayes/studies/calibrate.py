"""Calibrate the analysis of one case: many data sets with known truths, analysed side by side."""

import hashlib
import json
import os
import pickle
import time
from collections.abc import Mapping
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jointbayes.case.case import Case, require_case
from jointbayes.errors import ModelError, SamplingError
from jointbayes.inference import Problem
from jointbayes.posterior.stored_problem import run_fingerprint
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.sampling import SamplerSettings
from jointbayes.studies.calibration import A_CALIBRATION, Calibration
from jointbayes.studies.data_sets import DENSITY, DRAWS, DataSet, Job, analyse_packed, require_simulable
from jointbayes.studies.study_directory import append_line, kept_lines
from jointbayes.studies.workers import run_tasks
from jointbayes.workflow import Analysed, answered_case, sample
from vibrecords.arrays import Array
from vibrecords.own_directory import OwnDirectory

if TYPE_CHECKING:
    from distributed import Client


#: File of data sets that are done.
KEPT = "data_sets.jsonl"


def calibrate(
    case: Analysed,
    n: int = 1000,
    *,
    data_from: Analysed | None = None,
    near: bool = False,
    settings: SamplerSettings | None = None,
    seed: int | None = None,
    directory: str | os.PathLike[str] | None = None,
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
    directory
        Where data sets that are done are kept: a calibration that was cut off goes on where it was. By default nowhere.
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
    CaseError
        If the directory holds data sets of another calibration.
    ModelError
        If no data can be drawn from the likelihood, nothing is uncertain, or not one data set could be analysed.
    MeasurementError
        If the other case measures other things.
    SamplingError
        If the posterior of which truths are drawn has not converged.
    WriteError
        If the directory holds something else, or another process is at work in it.

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
    engine = {"workers": workers, "scheduler": scheduler, "executor": executor}
    head = {} if directory is None else fingerprint(case, source, job.settings, job.seed, near=near)
    with nullcontext() if directory is None else OwnDirectory(directory, A_CALIBRATION) as locked:
        file = None if locked is None else locked.path / KEPT
        kept = kept_data_sets(file, head, len(job.names))
        done = _done(job, n, file, {i: kept[i] for i in kept if i < n}, tell, engine, source if near else None)
    other = "" if job.source is job.analysis else job.source.name
    title, text = ("", "") if isinstance(case, Problem) else (case.title, case.text)
    data_sets = tuple(done[i] for i in range(n))
    return Calibration(job.analysis.name, other, job.seed, job.names, data_sets, title, text, near)


def _done(
    job: Job,
    n: int,
    file: Path | None,
    done: dict[int, DataSet],
    tell: ProgressCallback,
    engine: dict[str, Any],
    near: Analysed | None,
) -> dict[int, DataSet]:
    """The first n data sets by number: those that are done, and the others, kept in a file as they come.

    Near the data truths are those of the posterior of `near`.
    """
    if near is not None and len(done) < n:
        job = replace(job, truths=_truths_near(near, n, job.seed, tell))
    start = Progress("calibrating", done=len(done), total=n, unit="data sets", earlier=len(done))
    tell(start)
    began = time.monotonic()
    packed = _packed(job)
    tasks = ((str(i), (packed, i)) for i in range(n) if i not in done)
    for outcome in run_tasks(analyse_packed, tasks, preload=[analyse_packed.__module__], **engine):
        i = int(outcome.key)
        if outcome.error is None:
            done[i] = outcome.value
            if file is not None:
                append_line(file, asdict(outcome.value))
        else:  # not kept: a worker may have died of something else, and is given another chance next time
            done[i] = DataSet(i, 0.0, error=outcome.error)
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
    analysis = replace(_answered(case, seed, tell))
    source = analysis if data_from is None else replace(_answered(data_from, seed, tell))
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


def _answered(case: Case | Problem, seed: int, tell: ProgressCallback) -> Problem:
    """What a run would answer by: of a problem itself."""
    return case if isinstance(case, Problem) else answered_case(case, seed, tell)


def _packed(job: Job) -> bytes:
    try:
        return pickle.dumps(job)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ModelError(
            f"calibrate: found a problem that cannot be sent to another process ({error}); expected priors and noise "
            "models whose classes are defined at the top of a module; move them there"
        ) from error


def kept_data_sets(file: Path | None, head: Mapping[str, str], quantities: int) -> dict[int, DataSet]:
    """Data sets that are done by their number, one line of a file each; one that was cut off is done again.

    Parameters
    ----------
    file
        The file; its first line says what all data sets depend on. Nothing is kept in None.
    head
        What that is, as `fingerprint` has it.
    quantities
        How many quantities are ranked.

    Raises
    ------
    CaseError
        If the file holds data sets that depend on something else: what differs.
    """
    done = {}
    for kept in kept_lines(file, head, DataSet, "data sets", "calibration"):
        ranked = (kept.truth, kept.rank, kept.low, kept.high)
        if kept.error or all(len(values) == quantities for values in ranked):
            done[kept.index] = kept
    return done


def fingerprint(
    analysis: Case | Problem, source: Case | Problem, settings: SamplerSettings, seed: int, *, near: bool = False
) -> dict[str, str]:
    """What data sets depend on, part by part, in words of a message; `source` gives truths and data."""
    parts = {**_run_parts(analysis, settings, seed), "number of ranked draws": str(DRAWS)}
    if near:
        parts["source of truths"] = "posterior"
    if source is analysis:
        return parts
    whole = json.dumps(_run_parts(source, settings, seed), sort_keys=True)
    return {**parts, "source of data": hashlib.sha256(whole.encode()).hexdigest()[:16]}


def _run_parts(case: Case | Problem, settings: SamplerSettings, seed: int) -> dict[str, str]:
    problem, stated = (case, None) if isinstance(case, Problem) else (case.problem, case)
    return run_fingerprint(problem, stated, seed, settings)
