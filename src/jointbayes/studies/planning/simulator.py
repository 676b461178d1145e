"""Further measurements simulated, and the posterior that each would leave: nested Monte Carlo.

A truth is drawn from the present posterior, the further measurement is made there with noise, and the posterior of the
data in hand together with the simulated ones is found: by reweighting draws of the present posterior with the
likelihood of the new data where enough of them stay effective, and otherwise by importance sampling from a Student-t
fit about the truth, in coordinates in which the posterior is near Gaussian.

References
----------
Ryan, E. G. et al. (2016). A review of modern computational algorithms for Bayesian optimal design. International
Statistical Review 84(1), 128-154. DOI 10.1111/insr.12107
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import CaseError, JointBayesError, ModelError
from jointbayes.inference import Problem
from jointbayes.inference.climb import PosteriorSquares, climb_all
from jointbayes.posterior.candidate import Candidate
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.posterior.evidence import PARETO_LIMIT
from jointbayes.posterior.first_look import WithOwn, measurement_information, own_of
from jointbayes.posterior.identifiability import assess
from jointbayes.posterior.run_record import sha256_of
from jointbayes.sampling import Coordinates, Start, WeightedDraws, fit_proposal
from jointbayes.sampling.diagnostics import pareto_k
from jointbayes.studies.planning.simulation import Method, SimulatedPosterior
from vibrecords.arrays import Array

#: Fewer effective draws than this say too little about a standard deviation: 5 % of it at this number.
LEAST_EFFECTIVE = 200.0
#: Draws of the present posterior that are reweighted: first a few, then as many as these promise to be enough.
_FEW, _ALL = 2000, 40_000
#: So many times the draws that would just leave enough of them effective, by the first few.
_SPARE = 1.3
#: Present draws are no independent ones: so many times the effective number must be left of them.
_CORRELATED = 2.0
#: Where neither way leaves enough, so many will do for a figure to 10 %; rather that than leaving out the posteriors
#: of awkward shape, which need not be like the others.
_ROUGH = 50.0
#: Efficiency at which a fit ends, and importance draws from it: a Student-t, a mixture, the best mixture there is.
_FITS: tuple[tuple[float | None, int], ...] = ((0.1, 4000), (0.4, 4000), (None, 8000))
_RESAMPLED = 4000
_STEPS = 100  # of the climb to an assumed truth


class WithFurther:
    """ln p(θ | present data, further data) up to the evidence: measurements independent given θ.

    Parameters
    ----------
    present
        Log posterior density of the measurement in hand, (n, d) → (n,).
    further
        Problems over the same parameters, of whose densities only the likelihood is added.
    """

    def __init__(self, present: Callable[[Array], Array], further: Sequence[Problem]) -> None:
        self._present, self._further = present, [problem.log_posterior for problem in further]

    def __call__(self, theta: ArrayLike) -> Array:
        """Log density, shape (n,), of θ, shape (n, d)."""
        t = np.atleast_2d(np.asarray(theta, dtype=float))
        log_density = self._present(t)
        inside = np.isfinite(log_density)
        if inside.any():
            log_density[inside] += self.new_log_likelihood(t[inside])
        return log_density

    def new_log_likelihood(self, theta: Array) -> Array:
        """ln L of the further data alone, shape (n,), of θ, shape (n, d), inside the prior's support."""
        return sum((problem.log_likelihood(theta) for problem in self._further), np.zeros(len(theta)))


class Simulator:
    """Simulates further measurements and finds the posteriors that they leave.

    Parameters
    ----------
    problem
        The problem in hand.
    quantity
        Name of the wanted stiffness.
    draws
        Draws of θ from the present posterior, shape (n, d), equally weighted.
    systems
        Coordinates in which the posterior may be near Gaussian, the likeliest first.
    rng
        Chooses the truths among the draws, and seeds all noise.
    truths
        Number of truths.
    assumed
        θ that is the truth of every simulated measurement, shape (d,); by default truths are drawn from `draws`.

    Raises
    ------
    ModelError
        If there are too few draws, or no truth is asked for.
    """

    def __init__(
        self,
        problem: Problem,
        quantity: str,
        draws: Array,
        systems: Sequence[Coordinates],
        rng: np.random.Generator,
        *,
        truths: int,
        assumed: Array | None = None,
    ) -> None:
        if truths < 1 or len(draws) < 2 * truths:
            raise ModelError(
                f"planning: found {truths} simulations and {len(draws)} draws of the present posterior; expected at "
                "least one simulation and twice as many draws"
            )
        order = rng.permutation(len(draws))
        #: θ of each simulated truth, shape (truths, d).
        self.truths: Array = draws[order[:truths]] if assumed is None else np.repeat(assumed[None], truths, axis=0)
        # a truth must not be among the draws that are reweighted
        self._draws: Array = draws[order[truths : truths + _ALL]]
        self._draw_sd = draws.std(axis=0)
        self._problem = problem
        self._systems: dict[tuple[str, ...], Sequence[Coordinates]] = {(): tuple(systems)}
        self._column = problem.parametrisation.stiffness_names.index(quantity)
        self._prior_values = self._values(problem.prior.sample(rng, _RESAMPLED))
        self._seed = int(rng.integers(2**32))
        #: What is known now.
        self.now = self._posterior(WeightedDraws(draws.copy(), np.zeros(len(draws))), rng, "reweighting")

    @property
    def digest(self) -> str:
        """Of truths, draws and seed: where it is the same, so is what is simulated of a candidate."""
        return sha256_of([self.truths, self._draws, np.array(self._seed)])[:16]

    def posterior_after(self, candidates: Sequence[Candidate], truth: int) -> SimulatedPosterior | None:
        """Posterior after a set of further measurements of truth number `truth`; None where it is not found.

        A candidate has the same noise for the same truth, alone and in every set.
        """
        whole = WithOwn(self._problem, own_of(candidates))
        names = tuple(nuisance.name for nuisance in whole.own_nuisances)
        own_values = [
            nuisance.prior.sample(self._generator(truth, nuisance.name), 1) for nuisance in whole.own_nuisances
        ]
        theta = whole.joined(self.truths[truth][None], np.reshape(own_values, (1, -1)))[0]
        further = [c.problem(whole.problem, theta, self.noise(truth, c)) for c in candidates]
        density = WithFurther(whole.log_density, further)
        rng = self._generator(truth, *(c.name for c in candidates), "draws")
        # with nothing of its own no random number is taken, and the draws are the present ones
        draws = whole.drawn(self._draws, rng)
        few, needed = draws[:_FEW].copy(), _CORRELATED * LEAST_EFFECTIVE
        first = WeightedDraws(few, density.new_log_likelihood(few))
        wanted = math.ceil(_SPARE * needed / max(first.effective, 1.0) * len(first.theta))
        if wanted <= len(draws):
            present = _reweighted(density, draws, first, wanted)
            if _trusted(present, needed):
                return self._posterior(present, rng, "reweighting")
        best: Array = first.theta[int(np.argmax(first.log_weight))]
        starts = (self._start(whole, candidates, theta), self._start(whole, candidates, best))
        if names not in self._systems:
            self._systems[names] = coordinate_systems(whole.problem)
        about_truth = _importance(density, self._systems[names], starts, rng)
        if about_truth is not None and _trusted(about_truth, LEAST_EFFECTIVE):
            return self._posterior(about_truth, rng, "importance sampling")
        present = _reweighted(density, draws, first, len(draws))
        # what leaves more effective draws where neither leaves enough; nothing where too few for a rough figure
        effective = present.effective / _CORRELATED
        other = 0.0 if about_truth is None else about_truth.effective
        if max(effective, other) < _ROUGH:
            return None
        if about_truth is not None and other > effective:
            return self._posterior(about_truth, rng, "importance sampling")
        return self._posterior(present, rng, "reweighting")

    def _start(self, whole: WithOwn, candidates: Sequence[Candidate], theta: Array) -> Start:
        """A point, and the linearised covariance there, no wider than the present posterior in any coordinate."""
        fisher = whole.fisher(theta)
        added = sum((measurement_information(c, whole.problem, theta) for c in candidates), np.zeros_like(fisher.data))
        covariance = replace(fisher, data=fisher.data + added).covariance()
        widest = fisher.prior_sd.copy()
        widest[whole.present_columns] = np.minimum(widest[whole.present_columns], self._draw_sd)
        variance = np.diag(covariance)
        finite = np.isfinite(variance)
        shrink = np.minimum(1.0, widest / np.sqrt(np.where(finite, variance, widest**2)))
        bounded = np.where(np.isfinite(covariance), covariance, 0.0) * np.outer(shrink, shrink)
        bounded[~finite, ~finite] = widest[~finite] ** 2
        return theta, bounded

    def _posterior(self, draws: WeightedDraws, rng: np.random.Generator, method: Method) -> SimulatedPosterior:
        weight, values = draws.weight, self._values(draws.theta)
        with np.errstate(divide="ignore"):
            logs = np.log(np.abs(values))
        sd = math.sqrt(float(weight @ (logs - weight @ logs) ** 2))
        verdict = assess(self._values(draws.resample(rng, _RESAMPLED)), self._prior_values).verdict
        return SimulatedPosterior(sd, verdict, draws.effective, method)

    def noise(self, truth: int, candidate: Candidate) -> np.random.Generator:
        """Generator, at its beginning, of the noise with which a candidate measures truth number `truth`."""
        return self._generator(truth, candidate.name)

    def _generator(self, truth: int, *names: str) -> np.random.Generator:
        return np.random.default_rng([self._seed, truth, *" + ".join(names).encode()])

    def _values(self, theta: Array) -> Array:
        return self._problem.prior.values(theta)[:, self._column]


def _reweighted(density: WithFurther, draws: Array, first: WeightedDraws, count: int) -> WeightedDraws:
    """So many draws of the present posterior, weighted by the likelihood of the new data as the first few are."""
    rest = draws[len(first.theta) : count]
    if not len(rest):
        return first
    whole = np.concatenate([first.log_weight, density.new_log_likelihood(rest)])
    return WeightedDraws(draws[: len(whole)].copy(), whole)


def _importance(
    density: WithFurther, systems: Sequence[Coordinates], starts: tuple[Start, Start], rng: np.random.Generator
) -> WeightedDraws | None:
    """Weighted draws from a Student-t about the truth, or a mixture where its tails are too light; None if none.

    The mixtures start from the second point as well, the likeliest of the present draws, which may lie at another mode.
    """
    best: WeightedDraws | None = None
    begun: tuple[Start, ...] = starts[:1]
    for enough, count in _FITS:
        if enough is None and best is not None and best.effective >= _ROUGH:
            break  # a rough figure is there: the best mixture would cost seconds more
        try:
            proposal = fit_proposal(density, systems, begun, rng, enough=enough)
        except JointBayesError:
            continue  # a start at the very edge of the coordinates
        drawn = WeightedDraws(*proposal.weighted_draws(density, rng, count))
        if _trusted(drawn, LEAST_EFFECTIVE):
            return drawn
        if best is None or drawn.effective > best.effective:
            best = drawn
        begun = starts
    return best


def _trusted(weighted: WeightedDraws, effective: float) -> bool:
    """Whether weighted draws leave so many effective ones, in a tail that can be trusted."""
    return weighted.effective >= effective and pareto_k(weighted.log_weight) <= PARETO_LIMIT


def stated_joint(where: str, problem: Problem, assume: Mapping[str, float]) -> list[float]:
    """Quantities of an assumed joint, given by their names, in the order of the problem."""
    names = [quantity.name for quantity in problem.prior.parametrisation.quantities]
    if set(assume) != set(names):
        raise CaseError(
            f"{where}: found an assumed joint of {', '.join(map(str, assume))}; expected a value for each of "
            f"{', '.join(names)}; state all of them"
        )
    return [float(assume[name]) for name in names]


def assumed_truth(problem: Problem, theta: Array, stiffness: ArrayLike) -> Array:
    """θ, shape (d,), of an assumed joint, all else as the present data have it, given that joint.

    Parameters
    ----------
    problem
        The problem in hand.
    theta
        Mode of its posterior, shape (d,), from which the other quantities start.
    stiffness
        Quantities of the joint, shape (q,).

    Raises
    ------
    ModelError
        If the prior thinks that joint impossible.
    """
    prior, log_posterior = problem.prior, problem.log_posterior
    joint = prior.parametrisation.coordinates(stiffness)
    low, high = prior.support
    start = np.concatenate([joint, theta[joint.size :]])
    if not (prior.feasible(start) and (start >= low).all() and (start <= high).all()):
        given = ", ".join(f"{k:g}" for k in np.asarray(stiffness, dtype=float))
        raise ModelError(f"planning: found an assumed joint ({given}) outside the prior; expected one inside it")
    others = np.arange(joint.size, start.size - log_posterior.likelihood.hyper_count)
    (theta,), _ = climb_all(PosteriorSquares(log_posterior, columns=others, exact=True), start[None], _STEPS, fine=True)
    return theta
