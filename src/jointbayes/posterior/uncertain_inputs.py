"""What is known of the joint when other quantities are uncertain, or are not: each row from draws of its own.

The first row is the run itself. Every further one belongs to the same density with other quantities free, those left
out held at their stated values. It is sampled by importance from a proposal fitted to it, or where the weights cannot
be trusted by a short run of the ensemble sampler. Where neither settles it nothing is said.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import JointBayesError
from jointbayes.inference import JointPrior, Problem
from jointbayes.posterior.coordinates import compliance_and_scores
from jointbayes.posterior.evidence import PARETO_LIMIT
from jointbayes.posterior.fisher import fisher_information
from jointbayes.posterior.identifiability import Identifiability, Verdict, assess
from jointbayes.posterior.solutions import LEAST_SHARE
from jointbayes.posterior.verdicts import JudgedPosterior, judge_with_wider_priors
from jointbayes.posterior.widened import WidenedPosterior, replace_prior, widen
from jointbayes.sampling import (
    INTERVAL,
    Coordinates,
    Proposal,
    SamplerSettings,
    WeightedDraws,
    drawn_without_replacement,
    fit_each_mode,
    fit_proposal,
    quantile_spread,
    run_ensembles,
    truncated,
)
from jointbayes.sampling.diagnostics import pareto_k
from jointbayes.structure import is_mode_frequency

Source = Literal["this run", "importance sampling", "short run", "none"]
#: Draws, where they come from, and how many independent ones they are worth.
_Sample = tuple[Array | None, Source, float]

_DRAWS = 8000
#: Effective draws below which the ends of a 95 % interval are not worth printing.
_LEAST_EFFECTIVE = 400
#: Efficiency of a proposal that will do: twice `_LEAST_EFFECTIVE` of the draws, or a start for a short run. A better
#: one takes longer to find than the longer run that makes up for it.
_ENOUGH = 0.1
#: Draws of the run among which a first point is looked for.
_TRIED = 200
#: A short run: long enough to tell a factor of 3 from one of 1.25, not for an end's second digit.
_SHORT = SamplerSettings(walkers=24, max_steps=300)
#: It is trusted if R̂ over its ensembles stays below this, with so many effective draws.
_SHORT_R_HAT, _SHORT_EFFECTIVE = 1.05, 150


@dataclass(frozen=True, slots=True)
class UncertainInputsRow:
    """What is known of the stiffnesses while some quantities are uncertain and the others exactly known.

    Parameters
    ----------
    uncertain
        Names of the uncertain quantities; empty where all are exactly known.
    source
        Where the draws come from; ``"none"`` where there are none that can be trusted.
    known
        What the draws say of each stiffness, by name; empty where there are none.
    """

    uncertain: tuple[str, ...]
    source: Source
    known: Mapping[str, Identifiability]

    @property
    def verdict(self) -> dict[str, Verdict]:
        """Verdict on each stiffness."""
        return {name: assessment.verdict for name, assessment in self.known.items()}


def uncertain_quantities(problem: Problem) -> tuple[str, ...]:
    """Uncertain quantities on which the prediction depends; parameters of the noise are none."""
    count = len(problem.prior.nuisances) - problem.log_posterior.likelihood.hyper_count
    return tuple(n.name for n in problem.prior.nuisances[:count])


def effect_of_uncertain_inputs(
    posterior: JudgedPosterior, freed: Problem | None = None
) -> tuple[UncertainInputsRow, ...]:
    """What the verdicts rest on: the run, then other sets of uncertain quantities.

    Parameters
    ----------
    posterior
        The run, which is the first row. Where it has uncertain quantities, there is one with none uncertain.
    freed
        The same problem with more quantities uncertain. Where the run takes any of them as exactly known, the last row
        is that with all uncertain.

    Returns
    -------
    tuple of UncertainInputsRow
        Empty where there is nothing to free, where the run allows no verdict, and where the natural frequencies
        themselves are uncertain: they are one quantity for each mode.
    """
    present = uncertain_quantities(posterior.problem)
    more = () if freed is None else uncertain_quantities(freed)
    problem = freed if freed is not None and set(more) > set(present) else posterior.problem
    every = uncertain_quantities(problem)
    if not every or any(is_mode_frequency(name) for name in every):
        return ()
    run = UncertainInputsRow(present, "this run", {n: posterior.identifiability(n) for n in posterior.stiffness_names})
    if "no verdict" in map(str, run.verdict.values()):
        return ()
    rng = np.random.default_rng([posterior.record.seed, 3])
    sets: list[tuple[str, ...]] = [()] if present else []
    sets += [every] if set(every) > set(present) else []
    return run, *(_row(posterior, problem, names, rng) for names in sets)


def _row(
    posterior: JudgedPosterior, problem: Problem, uncertain: tuple[str, ...], rng: np.random.Generator
) -> UncertainInputsRow:
    """Draws of the problem with only these quantities uncertain, and what they say, by the rule of a run."""
    theta, source, effective = _sampled(posterior, problem, uncertain, rng)
    if theta is None:
        return UncertainInputsRow(uncertain, "none", {})
    (random,) = rng.spawn(1)  # the rows that follow do not depend on whether a bound is within reach

    def drawn_anew(wide: JointPrior) -> tuple[Array, float, bool]:
        draws, _, worth = _sampled(posterior, replace_prior(problem, wide), uncertain, random)
        return wide.sample(random, _DRAWS) if draws is None else draws, worth, draws is not None

    wider = widen(problem.prior, theta, lambda: effective, random, drawn_anew)
    assessments = {}
    for quantity, values in zip(problem.quantities, problem.prior.values(theta).T, strict=True):
        assessment = _judged(posterior, quantity.name, values, effective, wider)
        conditional = not posterior.check.explains and assessment.verdict != "not identified"
        assessments[quantity.name] = replace(assessment, unit=quantity.unit, if_model_right=conditional)
    return UncertainInputsRow(uncertain, source, assessments)


def _sampled(
    posterior: JudgedPosterior, problem: Problem, uncertain: tuple[str, ...], rng: np.random.Generator
) -> _Sample:
    """Draws of all coordinates, shape (n, d), where they come from, and how many independent ones they are worth."""
    held = _Part(problem, uncertain)
    try:
        starts = [(start, held.covariance(start)) for start in held.starts(posterior)]
        systems = held.coordinate_systems()
        if len(starts) > 1:
            proposal = fit_each_mode(held.log_density, systems, starts, None, rng)
        else:
            proposal = fit_proposal(held.log_density, systems, starts, rng, enough=_ENOUGH)
        draws, source, effective = _draws(held.log_density, proposal, rng)
    except (JointBayesError, np.linalg.LinAlgError):
        return None, "none", 0.0
    return None if draws is None else held.whole(draws), source, effective


def _judged(
    posterior: JudgedPosterior, name: str, values: Array, effective: float, wider: WidenedPosterior | None
) -> Identifiability:
    """One stiffness by its draws and those under wider priors."""

    def error(probability: float) -> float:
        return quantile_spread(values, probability, effective)

    assessment = assess(values, posterior.prior_values(name).ravel())
    assessment = replace(assessment, interval95_error=(error(INTERVAL[0]), error(INTERVAL[1])))
    if name in posterior.solutions.split:
        return replace(assessment, verdict="not identified", verdict_reason="several solutions")
    return assessment if wider is None else judge_with_wider_priors(posterior, wider, name, assessment, values, error)


class _Part:
    """The density of a problem with some of its uncertain quantities held at their stated values."""

    def __init__(self, problem: Problem, uncertain: tuple[str, ...]) -> None:
        self._problem = problem
        held = set(uncertain_quantities(problem)) - set(uncertain)
        self._free = np.array([i for i, name in enumerate(problem.names) if name not in held])
        low, high = np.array([m.support for m in problem.prior.all_marginals]).reshape(-1, 2).T
        self._low, self._high = low[self._free], high[self._free]

    def whole(self, theta: Array) -> Array:
        """All coordinates, shape (n, d), of the free ones, shape (n, f)."""
        points = np.zeros((len(theta), len(self._problem.names)))
        points[:, self._free] = theta
        return points

    def log_density(self, theta: Array) -> Array:
        """Log density, shape (n,), of the free coordinates, shape (n, f)."""
        return self._problem.log_posterior(self.whole(theta))

    def coordinate_systems(self) -> tuple[Coordinates, ...]:
        """Compliance of the joint, and normal scores of all."""
        return compliance_and_scores(self._problem.parametrisation, self._low, self._high)

    def starts(self, posterior: JudgedPosterior) -> list[Array]:
        """The likeliest point, shape (f,), among draws of each solution with what is held put at its stated value."""
        candidates = np.vstack([posterior.estimate.theta, posterior.thinned(_TRIED)])
        nearest = posterior.solutions.nearest(candidates)
        names = posterior.problem.names
        tried = np.zeros((len(candidates), len(self._problem.names)))
        for i, name in enumerate(self._problem.names):
            if name in names:
                tried[:, i] = candidates[:, names.index(name)]
        points = tried[:, self._free]
        density = self.log_density(points)
        likely = [mode for mode in np.unique(nearest) if posterior.solutions.shares[mode] >= LEAST_SHARE]
        best = [int(np.argmax(np.where(nearest == mode, density, -np.inf))) for mode in likely]
        return [points[i] for i in sorted(best, key=lambda i: -density[i])]

    def covariance(self, theta: Array) -> Array:
        """Rough covariance there, shape (f, f), no wider than the prior in any direction of a coordinate."""
        prior: JointPrior = self._problem.prior
        names = [self._problem.names[i] for i in self._free]
        covariance = fisher_information(self._problem, self.whole(theta[None])[0]).covariance(names)
        sd = prior.sd[self._free]
        variance = np.where(np.isfinite(np.diag(covariance)), np.diag(covariance), sd**2)
        finite = np.where(np.isfinite(covariance), covariance, 0.0)
        np.fill_diagonal(finite, variance)
        shrink = np.minimum(1.0, sd / np.sqrt(variance))
        return finite * np.outer(shrink, shrink)


def _draws(log_density: Callable[[Array], Array], proposal: Proposal, rng: np.random.Generator) -> _Sample:
    """Equally weighted draws, shape (n, f), where they come from, and how many independent ones they are worth.

    None where none can be trusted.
    """
    theta, log_weight = proposal.weighted_draws(log_density, rng, _DRAWS)
    if not len(theta):
        return None, "none", 0.0
    weighted = WeightedDraws(theta, log_weight)
    if weighted.effective >= _LEAST_EFFECTIVE and pareto_k(log_weight) <= PARETO_LIMIT:
        return weighted.resample(rng, _DRAWS), "importance sampling", weighted.effective
    count = _SHORT.ensembles * _SHORT.walkers
    chosen = drawn_without_replacement(truncated(log_weight, _DRAWS), count, rng)
    if len(chosen) < count:
        return None, "none", 0.0
    start = theta[chosen].reshape(_SHORT.ensembles, _SHORT.walkers, -1)
    coordinates = proposal.likeliest.coordinates
    chains = run_ensembles(log_density, start, rng, _SHORT, coordinates=coordinates, proposal=proposal)
    if not (chains.r_hat.max() < _SHORT_R_HAT and chains.ess.min() >= _SHORT_EFFECTIVE):
        return None, "none", 0.0
    draws: Array = chains.draws().theta.reshape(-1, theta.shape[1])
    return draws, "short run", float(chains.ess.min())
