"""One data set of a calibration: a truth, data from it, their posterior, and the rank of the truth among its draws."""

import pickle
import time
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.arrays import Array
from jointbayes.errors import JointBayesError
from jointbayes.inference import Problem
from jointbayes.sampling import SamplerSettings
from jointbayes.studies.calibration.ranks import rank_statistic
from jointbayes.studies.calibration.simulation import simulated_problem
from jointbayes.workflow import sample

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
    """

    analysis: Problem
    source: Problem
    settings: SamplerSettings
    seed: int

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
    some = problem.prior.stiffness(problem.prior.sample(np.random.default_rng(0), 8))
    stiffnesses = [q.name for q, values in zip(problem.quantities, some.T, strict=True) if np.ptp(values) > 0]
    return (*stiffnesses, *(name for name in problem.names if name not in stiffnesses))


def _values(problem: Problem, theta: Array) -> dict[str, Array]:
    """Stiffnesses in their units, other coordinates and values of the nuisances, each (n,), at θ (n, d)."""
    prior = problem.prior
    coordinates = dict(zip(problem.parametrisation.names, prior.joint(theta).T, strict=True))
    stiffnesses = dict(zip((q.name for q in problem.quantities), prior.stiffness(theta).T, strict=True))
    nuisances = dict(zip((n.name for n in prior.nuisances), prior.nuisance_values(theta).T, strict=True))
    return coordinates | stiffnesses | nuisances


def analyse(job: Job, index: int) -> DataSet:
    """Draw data set number `index` and analyse it: a pure function of the job and the number."""
    began = time.process_time()
    rng = np.random.default_rng(np.random.SeedSequence(job.seed, spawn_key=(index,)))
    try:
        theta = job.source.prior.sample(rng, 1)
        problem = simulated_problem(job.analysis, job.source, theta[0], rng)
        posterior = sample(problem, seed=int(rng.integers(2**32)), settings=job.settings)
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
    job: Job = pickle.loads(packed)
    return job
