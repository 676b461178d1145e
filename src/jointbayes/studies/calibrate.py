"""Calibrate the analysis of one case: many data sets with known truths, analysed side by side."""

import pickle
import time
from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from jointbayes.case.case import Case, require_case
from jointbayes.errors import ModelError, SamplingError
from jointbayes.inference import Problem
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.sampling import SamplerSettings
from jointbayes.studies.calibration import Calibration
from jointbayes.studies.data_sets import DENSITY, DataSet, Job, analyse_packed, require_simulable
from jointbayes.studies.workers import run_tasks
from jointbayes.workflow import Analysed, answered_case, sample
from vibrecords.arrays import Array

if TYPE_CHECKING:
    from distributed import Client


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
    other = "" if job.source is job.analysis else job.source.name
    title, text = ("", "") if isinstance(case, Problem) else (case.title, case.text)
    data_sets = tuple(done[i] for i in range(n))
    return Calibration(job.analysis.name, other, job.seed, job.names, data_sets, title, text, near)


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
