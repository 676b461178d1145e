"""One data set of a calibration: a truth, data from it, their posterior, and the rank of the truth among its draws.

What a case takes from its measured values, the stated variance above all, stays as the case has it. A variance computed
anew from each simulated FRF would be a function of the truth that the analysis takes as given: it would tell it where
the resonances lie, and no prior knows of that.

Ranks of truths, bands for their distribution and coverage of intervals say whether an analysis is calibrated: if truths
come from the prior and data from the likelihood, the rank of a truth among independent draws of its posterior is
uniform, whatever the prior, the likelihood and the data: anything else is an error in one of the three, or in the
sampler.

References
----------
Talts, S. et al. (2018). Validating Bayesian inference algorithms with simulation-based calibration. arXiv:1804.06788
Säilynoja, T., Bürkner, P.-C., Vehtari, A. (2022). Graphical test for discrete uniformity and its applications in
goodness-of-fit evaluation and multiple sample comparison. Statistics and Computing 32, 32.
DOI 10.1007/s11222-022-10090-6
"""

import math
import pickle
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats

from jointbayes.errors import JointBayesError, MeasurementError, ModelError
from jointbayes.inference import Problem
from jointbayes.posterior.prediction import replace_values, simulated_values
from jointbayes.sampling import SamplerSettings
from jointbayes.workflow import sample, sample_quickly
from vibrecords.arrays import Array

IntArray = NDArray[np.int64]

_BISECTIONS = 40


def rank_statistic(truth: ArrayLike, draws: ArrayLike, kept: int, rng: np.random.Generator) -> IntArray:
    """Rank of the truth of each parameter among so many draws that are nearly independent, 0 to `kept`.

    The draws are picked at random, without replacement, from all of them. Two that are picked correlate as two draws
    do on average, 1/ESS: with `kept` well below the effective sample size they are as good as independent.

    Parameters
    ----------
    truth
        True values, shape (d,).
    draws
        Draws of the posterior in any order, shape (n, d), n at least `kept`.
    kept
        How many draws to compare with.
    rng
        Picks the draws, and parts ties.

    Returns
    -------
    ndarray of int, shape (d,)

    Raises
    ------
    ModelError
        If the shapes do not fit, there are too few draws, or a number is not finite.

    Examples
    --------
    >>> rank_statistic([0.0], np.arange(-2.0, 3.0)[:, None] + 0.5, 5, np.random.default_rng(1)).tolist()
    [2]
    """
    true, values = np.asarray(truth, dtype=float), np.asarray(draws, dtype=float)
    if true.ndim != 1 or values.ndim != 2 or values.shape[1] != true.size or not 0 < kept <= len(values):
        raise ModelError(
            f"rank: found a truth of shape {true.shape} and draws of shape {values.shape}; expected (d,) and at least "
            f"{kept} draws of shape (n, d)"
        )
    if not (np.isfinite(true).all() and np.isfinite(values).all()):
        raise ModelError("rank: found a truth or a draw that is not finite; expected numbers; correct them")
    picked = values[rng.choice(len(values), kept, replace=False)]
    below, ties = (picked < true).sum(axis=0), (picked == true).sum(axis=0)
    return below + rng.integers(0, ties + 1)


@dataclass(frozen=True, slots=True, eq=False)
class EcdfBand:
    """Simultaneous band for the empirical distribution of uniform ranks.

    Parameters
    ----------
    position
        Values of u = (rank + 1)/(draws + 1) at which it is looked at, shape (points,), between 0 and 1.
    low, high
        Least and largest share of ranks up to there, shape (points,).
    probability
        Probability that n uniform ranks lie inside at all points: at least what was asked for.
    pointwise
        Probability with which each point by itself lies outside: γ of Säilynoja et al.
    """

    position: Array
    low: Array
    high: Array
    probability: float
    pointwise: float


@lru_cache(maxsize=32)
def ecdf_band(n: int, draws: int, probability: float = 0.95) -> EcdfBand:
    """Band that contains the empirical distribution of n uniform ranks, 0 to `draws`, with a given probability.

    At each point the count of ranks is binomial, and the band is its central interval of one probability 1 − γ for
    all points. γ is as large as the simultaneous probability allows. That probability is computed exactly: from point
    to point the counts are a Markov chain of binomial steps.

    Parameters
    ----------
    n
        Number of ranks, that is of data sets.
    draws
        Number of draws among which each truth was ranked.
    probability
        Simultaneous probability.

    References
    ----------
    Säilynoja et al. (2022), section 2.2, DOI 10.1007/s11222-022-10090-6
    """
    position = np.arange(1, draws + 1) / (draws + 1)
    least, most = 0.0, 1 - probability  # one point alone has as much
    for _ in range(_BISECTIONS):
        middle = (least + most) / 2
        inside = _inside_probability(n, position, *_limits(n, position, middle))
        least, most = (middle, most) if inside >= probability else (least, middle)
    low, high = _limits(n, position, least)
    return EcdfBand(position, low / n, high / n, _inside_probability(n, position, low, high), least)


def _limits(n: int, position: Array, gamma: float) -> tuple[IntArray, IntArray]:
    """Least and largest count at each point of a central interval of probability at least 1 − γ."""
    low: IntArray = np.maximum(stats.binom.ppf(gamma / 2, n, position), 0).astype(np.int64)
    high: IntArray = np.asarray(stats.binom.isf(gamma / 2, n, position)).astype(np.int64)
    return low, high


def _inside_probability(n: int, position: Array, low: IntArray, high: IntArray) -> float:
    """Probability that the counts of n uniform numbers up to each position lie within the limits at all of them."""
    log_factorial = special.gammaln(np.arange(n + 1) + 1.0)
    counts, chance, before = np.zeros(1, dtype=np.int64), np.ones(1), 0.0
    for at, least, most in zip(position, low, high, strict=True):
        following = np.arange(least, most + 1)
        # of those not counted so far each lies before this point with the same probability: a binomial step
        share, left = (at - before) / (1 - before), n - counts[:, None]
        step = following - counts[:, None]
        possible = step >= 0
        step = np.where(possible, step, 0)
        log_pmf = log_factorial[left] - log_factorial[step] - log_factorial[left - step]
        log_pmf += step * math.log(share) + (left - step) * math.log1p(-share)
        counts, chance, before = following, chance @ np.where(possible, np.exp(log_pmf), 0.0), at
    return float(chance.sum())


def ecdf(ranks: ArrayLike, draws: int) -> Array:
    """Share of ranks, shape (n,), at or below 0, 1, …, draws − 1, shape (draws,): at the positions of the band."""
    counts = np.bincount(np.asarray(ranks, dtype=np.int64), minlength=draws + 1)
    return np.cumsum(counts)[:draws] / counts.sum()


@dataclass(frozen=True, slots=True)
class Coverage:
    """How often intervals held the truth.

    Parameters
    ----------
    inside, total
        Intervals that held it, and all of them.
    interval95
        95 % interval of the probability (Clopper and Pearson): what so many data sets can tell.
    """

    inside: int
    total: int
    interval95: tuple[float, float]

    @property
    def share(self) -> float:
        """Share that held it."""
        return self.inside / self.total


def coverage(intervals: ArrayLike, truths: ArrayLike, missing: int = 0) -> Coverage:
    """Count how often intervals, shape (n, 2), hold truths, shape (n,); so many missing ones hold none.

    References
    ----------
    Clopper, C. J., Pearson, E. S. (1934). The use of confidence or fiducial limits illustrated in the case of the
    binomial. Biometrika 26(4), 404-413. DOI 10.1093/biomet/26.4.404

    Examples
    --------
    >>> coverage([[0.0, 1.0], [0.0, 1.0]], [0.5, 2.0]).share
    0.5
    """
    ends, true = np.asarray(intervals, dtype=float), np.asarray(truths, dtype=float)
    inside = int(((ends[:, 0] <= true) & (true <= ends[:, 1])).sum())
    total = true.size + missing
    exact = stats.binomtest(inside, total).proportion_ci(0.95, method="exact")
    return Coverage(inside, total, (float(exact.low), float(exact.high)))


@dataclass(frozen=True, slots=True, eq=False)
class QuantityCalibration:
    """What the ranks of one quantity over many data sets say.

    Parameters
    ----------
    name
        Of the quantity.
    ranks
        Rank of the truth in each data set that has a posterior, shape (n,).
    draws
        Number of draws among which it was ranked.
    missing
        Number of data sets without a posterior.
    band
        Simultaneous band of uniform ranks.
    shares
        Empirical distribution at the positions of the band, shape (points,). Ranks that are missing count as all the
        lowest or all the highest, whichever is the less probable.
    p_value
        Probability that uniform ranks come as near to the edge of such a band at some point, exact: ranks are inside
        the 95 % band where it is above 0.05. Of several quantities one may well lie below.
    coverage
        Of the intervals of the posteriors; a missing one did not hold its truth.
    """

    name: str
    ranks: IntArray
    draws: int
    missing: int
    band: EcdfBand
    shares: Array
    p_value: float
    coverage: Coverage

    @property
    def inside_band(self) -> bool:
        """Whether the empirical distribution stays in the band."""
        return bool(((self.shares >= self.band.low) & (self.shares <= self.band.high)).all())

    @property
    def largest_deviation(self) -> float:
        """Largest distance of the empirical distribution from the uniform one, with its sign.

        Above 0: more low ranks than there should be, draws lie above the truths.
        """
        difference = self.shares - self.band.position
        return float(difference[np.abs(difference).argmax()])

    @property
    def finding(self) -> str:
        """How the ranks differ most from uniform ones, in words: for a quantity that leaves its band."""
        u = (self.ranks + 0.5) / (self.draws + 1)
        # of uniform ranks mean and mean square about the middle have known standard errors, here in units of these
        shift = (u.mean() - 0.5) * np.sqrt(12 * u.size)
        spread = (np.mean((u - 0.5) ** 2) - 1 / 12) * np.sqrt(180 * u.size)
        if abs(shift) >= abs(spread):
            return "draws lie above the truths" if shift < 0 else "draws lie below the truths"
        return "posteriors are too narrow" if spread > 0 else "posteriors are too wide"


def judge(
    ranks: Mapping[str, ArrayLike],
    intervals: Mapping[str, ArrayLike],
    truths: Mapping[str, ArrayLike],
    draws: int,
    probability: float = 0.95,
    missing: int = 0,
) -> tuple[QuantityCalibration, ...]:
    """Judge every quantity from ranks (n,), posterior intervals (n, 2) and truths (n,) by its name.

    Parameters
    ----------
    ranks, intervals, truths
        By name of the quantity; one row for each data set that has a posterior.
    draws
        Number of draws among which truths were ranked.
    probability
        Of the band of each quantity by itself.
    missing
        Number of data sets whose analysis failed. Leaving them out would judge the others alone, which may well be
        those with easy truths: they count as outside their intervals, and at the end of the ranks that looks worse.
    """
    results = []
    for name, values in ranks.items():
        counts = np.asarray(values, dtype=np.int64)
        band = ecdf_band(counts.size + missing, draws, probability)
        p_value, shares = min(
            (_p_value_and_shares(counts, draws, missing, at) for at in (0, draws)[: 1 + (missing > 0)]),
            key=lambda pair: pair[0],
        )
        covered = coverage(intervals[name], truths[name], missing)
        results.append(QuantityCalibration(name, counts, draws, missing, band, shares, p_value, covered))
    return tuple(results)


def _p_value_and_shares(counts: IntArray, draws: int, missing: int, at: int) -> tuple[float, Array]:
    """The p-value, and the empirical distribution, with the missing ranks put at one place.

    It is the probability that uniform ranks are at some point as improbable as these are at their least probable one.
    """
    shares = ecdf(np.append(counts, np.full(missing, at, dtype=np.int64)), draws)
    n, position = counts.size + missing, np.arange(1, draws + 1) / (draws + 1)
    reached = np.rint(shares * n)
    tail = np.minimum(stats.binom.cdf(reached, n, position), stats.binom.sf(reached - 1, n, position))
    least = float(tail.min())
    # counts whose tail probability, to their own side, is above that
    low: Array = np.array(stats.binom.ppf(least, n, position), dtype=float)
    low += stats.binom.cdf(low, n, position) <= least * (1 + 1e-9)
    high: Array = np.array(stats.binom.isf(least, n, position), dtype=float)
    high -= stats.binom.sf(high - 1, n, position) <= least * (1 + 1e-9)
    if (low > high).any():
        return 1.0, shares
    return 1 - _inside_probability(n, position, low.astype(np.int64), high.astype(np.int64)), shares


#: Draws among which a truth is ranked: few beside the effective ones, so that they are as good as independent.
DRAWS = 63

#: Ranked like a quantity: the density tells of errors that each quantity by itself does not show.
DENSITY = "log density"


@dataclass(frozen=True, slots=True)
class DataSet:
    """Result of one data set; truth, rank and ends of the 95 % interval are in the order of the quantities.

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
        If the two measure other things: tests, lines, outputs, inputs, quantity or number of natural frequencies.
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
    other = ["tests"] if names[0] != names[1] else []
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
    """A problem with the data that another one, or itself, gives at a truth, shape (d,): those of every test.

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
