"""One data set of a calibration: a truth, data from it, their posterior, and the rank of the truth among its draws.

What a case takes from its measured values, the stated variance above all, stays as the case has it. A variance computed
anew from each simulated FRF would be a function of the truth that the analysis takes as given: it would tell it where
the resonances lie, and no prior knows of that.
"""

import pickle
import time
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import JointBayesError, MeasurementError, ModelError
from jointbayes.inference import Problem
from jointbayes.posterior.prediction import replace_values, simulated_values
from jointbayes.sampling import SamplerSettings
from jointbayes.studies.ranks import rank_statistic
from jointbayes.workflow import sample, sample_quickly
from vibrecords.arrays import Array

#: Draws among which a truth is ranked: few beside the effective ones, so that they are as good as independent.
DRAWS = 63

#: Ranked like a quantity: the density tells of errors that each quantity by itself does not show.
DENSITY = "log density"


@dataclass(frozen=True, slots=True)
class DataSet:
    """What became of one data set; truth, rank and ends of the 95 % interval are in the order of the quantities.

    Parameters
    ----------
    index
        Its number, from 0.
    seconds
        Processor time.
    truth, rank, low, high
        Of each quantity; empty where the analysis failed.
    converged
        Whether the sampler met its stop rule.
    mode_agrees
        Whether joint mode and MAP are one.
    ess
        Effective draws of the quantity that has the fewest.
    error
        Why there is no posterior; empty where there is one.
    """

    index: int
    seconds: float
    truth: tuple[float, ...] = ()
    rank: tuple[int, ...] = ()
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    converged: bool = False
    mode_agrees: bool = False
    ess: float = 0.0
    error: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """What all data sets of a calibration have in common.

    Parameters
    ----------
    analysis
        The problem whose posteriors are judged.
    source
        The problem that gives truths and data; the same one, or another whose data are measured alike.
    settings
        Of the sampler.
    seed
        Of the calibration.
    truths
        Near the data: the truth of each data set, shape (n, d), draws of the posterior of `source` from its own data.
        Each is then analysed from the data of `analysis` and the simulated ones. By default truths are from the prior.
    """

    analysis: Problem
    source: Problem
    settings: SamplerSettings
    seed: int
    truths: Array | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities that are ranked."""
        return quantity_names(self.analysis, self.source)


def quantity_names(analysis: Problem, source: Problem) -> tuple[str, ...]:
    """Quantities of which both problems have an opinion; the log density where both have the same coordinates."""
    theirs = _uncertain(source)
    shared = tuple(name for name in _uncertain(analysis) if name in theirs)
    same = analysis.names == source.names and analysis.parametrisation == source.parametrisation
    return (*shared, DENSITY) if same else shared


def _uncertain(problem: Problem) -> tuple[str, ...]:
    """Stiffnesses that the prior leaves open, other coordinates of the joint, and the nuisances."""
    some = problem.prior.values(problem.prior.sample(np.random.default_rng(0), 8))
    stiffnesses = [q.name for q, values in zip(problem.quantities, some.T, strict=True) if np.ptp(values) > 0]
    return (*stiffnesses, *(name for name in problem.names if name not in stiffnesses))


def _values(problem: Problem, theta: Array) -> dict[str, Array]:
    """Stiffnesses in their units, other coordinates and values of the nuisances, each (n,), at θ (n, d)."""
    prior = problem.prior
    coordinates = dict(zip(problem.parametrisation.names, prior.joint(theta).T, strict=True))
    stiffnesses = dict(zip((q.name for q in problem.quantities), prior.values(theta).T, strict=True))
    nuisances = dict(zip((n.name for n in prior.nuisances), prior.nuisance_values(theta).T, strict=True))
    return coordinates | stiffnesses | nuisances


def analyse(job: Job, index: int) -> DataSet:
    """Draw data set number `index` and analyse it: a pure function of the job and the number."""
    began = time.process_time()
    rng = np.random.default_rng(np.random.SeedSequence(job.seed, spawn_key=(index,)))
    try:
        theta = job.source.prior.sample(rng, 1) if job.truths is None else job.truths[[index]]
        problem = simulated_problem(job.analysis, job.source, theta[0], rng)
        if job.truths is not None:  # p(θ|y, y′) ∝ p(θ) p(y′|θ) p(y|θ)
            problem = replace(problem, extra_log_likelihood=job.analysis.log_posterior.log_likelihood)
        draw = sample_quickly if problem.premises.reason else sample  # as a run would
        posterior = draw(problem, seed=int(rng.integers(2**32)), settings=job.settings)
    except (JointBayesError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        return DataSet(index, time.process_time() - began, error=reason)
    names = job.names
    true, drawn = _values(job.source, theta), _values(problem, posterior.theta)
    if DENSITY in names:
        true[DENSITY], drawn[DENSITY] = problem.log_posterior(theta), posterior.log_density.ravel()
    truth = np.array([true[name][0] for name in names])
    draws = np.stack([drawn[name] for name in names], axis=-1)
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    return DataSet(
        index,
        time.process_time() - began,
        _numbers(truth),
        tuple(rank_statistic(truth, draws, DRAWS, rng).tolist()),
        _numbers(low),
        _numbers(high),
        posterior.converged,
        posterior.mode_agrees,
        float(min(posterior.record.sampler["ess"].values())),
    )


def _numbers(values: ArrayLike) -> tuple[float, ...]:
    return tuple(np.asarray(values, dtype=float).tolist())


def analyse_packed(packed: bytes, index: int) -> DataSet:
    """The same in a worker, from a pickled job, which each worker unpacks once."""
    return analyse(_unpacked(packed), index)


@lru_cache(maxsize=1)
def _unpacked(packed: bytes) -> Job:
    return pickle.loads(packed)


def require_simulable(analysis: Problem, source: Problem) -> None:
    """Refuse a problem whose data cannot be simulated, or another one whose data are not those that are analysed.

    Parameters
    ----------
    analysis
        The problem whose posteriors are judged.
    source
        The problem that gives truths and data; the same one, or another.

    Raises
    ------
    ModelError
        If the likelihood has a term that is a function of one's own, or a body is given by its FRFs.
    MeasurementError
        If the two measure other things: set-ups, lines, outputs, inputs, quantity or number of natural frequencies.
    """
    for problem in (analysis, source):
        if problem.extra_log_likelihood is not None:
            raise ModelError(
                f"calibrate: {problem.name} has a further term of the log likelihood, from which no data can be drawn; "
                "expected a problem without; state what it says as a prior instead"
            )
        bodies = [body.name for test in problem.tests for body in test.measured_bodies]
        if bodies:
            raise ModelError(
                f"calibrate: {problem.name} has the measured body {bodies[0]}, whose true FRFs "
                "nobody knows; expected a structure that is modelled throughout; calibrate with a model of it"
            )
    if source is analysis:
        return
    names = [[test.name for test in problem.tests] for problem in (analysis, source)]
    other = ["set-ups"] if names[0] != names[1] else []
    for analysed, simulated in zip(analysis.tests, source.tests, strict=False):
        here, there = analysed.data.layout, simulated.data.layout
        other += [name for name, value in here.items() if value != there.get(name)]
    if other:
        differing = " and ".join(dict.fromkeys(other))
        raise MeasurementError(
            f"calibrate: found that {source.name} has other {differing} than {analysis.name}; expected data "
            "that are measured alike; give both cases the same"
        )


def simulated_problem(analysis: Problem, source: Problem, theta: Array, rng: np.random.Generator) -> Problem:
    """A problem with the data that another one, or itself, gives at a truth, shape (d,): those of every set-up.

    Raises
    ------
    MeasurementError
        If there is no finite FRF, or natural frequencies are out of order.
    """
    shared = source.log_posterior.likelihood.draw_shared(source.prior.factors(theta[None]), rng)
    pairs = enumerate(zip(analysis.parts, source.parts, strict=True))
    simulated = [
        replace_values(part, simulated_values(its, theta, rng, shared.get(i))).test for i, (part, its) in pairs
    ]
    return replace(analysis, tests=tuple(simulated))
