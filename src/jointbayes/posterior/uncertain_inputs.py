"""What is known of the joint when other quantities are uncertain, or are not: each row from draws of its own.

The first row is the run itself. Every further one belongs to the same density with other quantities free, those left
out held at their stated values. It is sampled by importance until the ends of its intervals are known to
`END_TOLERANCE` of their width: where quantities are freed that the run takes as exact from the run's draws, letting
them go step by step, else from a proposal fitted about its modes. Where this does not settle nothing is said.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import JointBayesError, ModelError, require_probability
from jointbayes.inference import JointPrior, Normal, Nuisance, Problem
from jointbayes.posterior.coordinates import by_names, compliance_and_scores, judged_quantities
from jointbayes.posterior.fisher import fisher_information
from jointbayes.posterior.identifiability import Identifiability, Verdict, assess
from jointbayes.posterior.solutions import LEAST_SHARE
from jointbayes.posterior.verdicts import JudgedPosterior, judge_with_wider_priors
from jointbayes.posterior.widened import WidenedPosterior, replace_prior, widen
from jointbayes.sampling import (
    INTERVAL,
    Coordinates,
    Proposal,
    Quantities,
    Restraint,
    fit_each_mode,
    fit_proposal,
    quantile_spread,
    released_draws,
)

Source = Literal["this run", "importance sampling", "short run", "none"]  # a short run: in files of before
_DRAWS = 8000
_PILOT = 2000
_KEPT = 2000  # draws of a row, with the run
#: Coordinates up to which those that the run takes as exact are let go step by step.
_MOST_RELEASED = 10
#: Efficiency of a proposal that will do to start from.
_ENOUGH = 0.1
#: Draws of the run among which a first point is looked for.
_TRIED = 200


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
    draws
        Independent draws of the stiffnesses, in the order of `known` and their units, shape (n, q), at most 2000; those
        of the run itself are the posterior's.
    """

    uncertain: tuple[str, ...]
    source: Source
    known: Mapping[str, Identifiability]
    draws: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False, compare=False)

    def interval(self, name: str, probability: float = 0.95) -> tuple[float, float]:
        """Equal-tailed credible interval of a stiffness, in its unit.

        Raises
        ------
        ModelError
            If there is no such stiffness, or the row has no draws of its own.
        """
        require_probability(probability, "under: found")
        if name not in self.known or not self.draws.size:
            raise ModelError(
                f"under: found no draws of {name!r}; expected one of {', '.join(self.known) or 'none'}, of a row that "
                "settled; correct the name"
            )
        tail = (1 - probability) / 2
        low, high = np.quantile(self.draws[:, list(self.known).index(name)], [tail, 1 - tail])
        return float(low), float(high)

    @property
    def verdict(self) -> dict[str, Verdict]:
        """Verdict on each stiffness."""
        return {name: assessment.verdict for name, assessment in self.known.items()}


def uncertain_quantities(problem: Problem) -> tuple[str, ...]:
    """Uncertain quantities on which the prediction depends; parameters of the noise are none."""
    count = len(problem.prior.nuisances) - problem.log_posterior.likelihood.hyper_count
    return tuple(n.name for n in problem.prior.nuisances[:count])


def taken_as_exact(problem: Problem, freed: Problem | None) -> str:
    """What is uncertain in a workshop and not in the problem, for a sentence; empty where nothing is."""
    stated, names = uncertain_quantities(problem), () if freed is None else uncertain_quantities(freed)
    return listed([name for name in names if name not in stated])


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
        Empty where there is nothing to free, and where the run allows no verdict.
    """
    present = uncertain_quantities(posterior.problem)
    more = () if freed is None else uncertain_quantities(freed)
    problem = freed if freed is not None and set(more) > set(present) else posterior.problem
    every = uncertain_quantities(problem)
    if not every:
        return ()
    run = UncertainInputsRow(present, "this run", {n: posterior.verdict(n) for n in posterior.stiffness_names})
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
    part, modes = _Part(problem, uncertain), int((posterior.solutions.shares >= LEAST_SHARE).sum())
    try:
        sample = part.draws(posterior, modes, rng)
    except (JointBayesError, np.linalg.LinAlgError):
        sample = None
    if sample is None:
        return UncertainInputsRow(uncertain, "none", {})
    theta, effective = sample
    (random,) = rng.spawn(1)  # the rows that follow do not depend on whether a bound is within reach

    def drawn_anew(wide: JointPrior) -> tuple[Array, float, bool]:
        anew = _Part(replace_prior(problem, wide), uncertain).sample(part.free(theta), modes, random)
        return (wide.sample(random, _DRAWS), 0.0, False) if anew is None else (*anew, True)

    wider = widen(problem.prior, theta, lambda: effective, random, drawn_anew)
    assessments = {}
    for quantity, values in zip(problem.quantities, problem.prior.values(theta).T, strict=True):
        assessment = _judged(posterior, quantity.name, values, effective, wider)
        conditional = not posterior.check.explains and assessment.verdict != "not identified"
        assessments[quantity.name] = replace(assessment, unit=quantity.unit, if_model_right=conditional)
    kept = problem.prior.values(theta[:: -(-len(theta) // _KEPT)])
    return UncertainInputsRow(uncertain, "importance sampling", assessments, kept)


def _judged(
    posterior: JudgedPosterior, name: str, values: Array, effective: float, wider: WidenedPosterior | None
) -> Identifiability:
    """One stiffness by its draws and those under wider priors."""

    def error(probability: float) -> float:
        return quantile_spread(values, probability, effective)

    assessment = assess(values, posterior.prior_values(name).ravel())
    assessment = replace(assessment, median_error=error(0.5), interval95_error=(error(INTERVAL[0]), error(INTERVAL[1])))
    if name in posterior.solutions.split:
        return replace(assessment, verdict="not identified", verdict_reason="several solutions")
    return assessment if wider is None else judge_with_wider_priors(posterior, wider, name, assessment, values, error)


class _Part:
    """The density of a problem with some of its uncertain quantities held at their stated values."""

    def __init__(self, problem: Problem, uncertain: tuple[str, ...]) -> None:
        self._problem = problem
        held = set(uncertain_quantities(problem)) - set(uncertain)
        self._free = np.array([i for i, name in enumerate(problem.names) if name not in held])
        self._names = [problem.names[i] for i in self._free]
        low, high = np.array([m.support for m in problem.prior.all_marginals]).reshape(-1, 2).T
        self._low, self._high = low[self._free], high[self._free]

    def whole(self, theta: Array) -> Array:
        """All coordinates, shape (n, d), of the free ones, shape (n, f)."""
        points = np.zeros((len(theta), len(self._problem.names)))
        points[:, self._free] = theta
        return points

    def free(self, theta: Array) -> Array:
        """The free ones, shape (n, f), of all coordinates, shape (n, d)."""
        return theta[:, self._free]

    def log_density(self, theta: Array) -> Array:
        """Log density, shape (n,), of the free coordinates, shape (n, f)."""
        return self._problem.log_posterior(self.whole(theta))

    def coordinate_systems(self) -> tuple[Coordinates, ...]:
        """Compliance of the joint, and normal scores of all."""
        return compliance_and_scores(self._problem.parametrisation, self._low, self._high)

    def sample(
        self,
        theta: Array,
        modes: int,
        rng: np.random.Generator,
        *,
        restraint: Restraint | None = None,
        proposal: Proposal | None = None,
    ) -> tuple[Array, float] | None:
        """As `released_draws` of the free coordinates, but draws of all coordinates."""
        judged, systems = judged_quantities(self._problem.prior), self.coordinate_systems()
        quantities = Quantities(judged.names, lambda theta: judged.values(self.whole(theta)))
        sample = released_draws(
            self.log_density, systems, theta, rng, quantities, restraint=restraint, proposal=proposal, modes=modes
        )
        return None if sample is None else (self.whole(sample[0]), sample[1])

    def draws(self, posterior: JudgedPosterior, modes: int, rng: np.random.Generator) -> tuple[Array, float] | None:
        """Draws of all coordinates, and how many independent ones they are worth; None where they do not settle.

        Where the run takes any of the coordinates as exact from its draws; else, and of several modes or many
        coordinates, to which a Student-t cannot be fitted step by step, from a proposal about its modes.
        """
        freed = np.flatnonzero([name not in posterior.problem.names for name in self._names])
        if freed.size and modes == 1 and len(self._names) <= _MOST_RELEASED:
            restraint = Restraint(freed, self._problem.prior.sd[self._free[freed]])
            drawn = by_names(posterior.thinned(_PILOT), posterior.problem.names, self._names)
            return self.sample(drawn, modes, rng, restraint=restraint)
        starts = [(start, self.covariance(start)) for start in self.starts(posterior)]
        systems = self.coordinate_systems()
        if len(starts) > 1:
            proposal = fit_each_mode(self.log_density, systems, starts, None, rng)
        else:
            proposal = fit_proposal(self.log_density, systems, starts, rng, enough=_ENOUGH)
        return self.sample(np.zeros((0, len(self._names))), modes, rng, proposal=proposal)

    def starts(self, posterior: JudgedPosterior) -> list[Array]:
        """The likeliest point, shape (f,), among draws of each solution with what is held put at its stated value."""
        candidates = np.vstack([posterior.estimate.theta, posterior.thinned(_TRIED)])
        nearest = posterior.solutions.nearest(candidates)
        points = by_names(candidates, posterior.problem.names, self._names)
        density = self.log_density(points)
        likely = [mode for mode in np.unique(nearest) if posterior.solutions.shares[mode] >= LEAST_SHARE]
        best = [int(np.argmax(np.where(nearest == mode, density, -np.inf))) for mode in likely]
        return [points[i] for i in sorted(best, key=lambda i: -density[i])]

    def covariance(self, theta: Array) -> Array:
        """Rough covariance there, shape (f, f), no wider than the prior in any direction of a coordinate."""
        prior: JointPrior = self._problem.prior
        covariance = fisher_information(self._problem, self.whole(theta[None])[0]).covariance(self._names)
        sd = prior.sd[self._free]
        variance = np.where(np.isfinite(np.diag(covariance)), np.diag(covariance), sd**2)
        finite = np.where(np.isfinite(covariance), covariance, 0.0)
        np.fill_diagonal(finite, variance)
        shrink = np.minimum(1.0, sd / np.sqrt(variance))
        return finite * np.outer(shrink, shrink)


def assumed_beyond(problem: Problem, freed: Problem | None) -> tuple[str, ...]:
    """The words of `assumed_words` for what is uncertain in `freed` alone."""
    if freed is None:
        return ()
    already_uncertain = uncertain_quantities(problem)
    words = zip(uncertain_quantities(freed), assumed_words(freed), strict=True)
    return tuple(word for name, word in words if name not in already_uncertain)


def assumed_words(freed: Problem) -> tuple[str, ...]:
    """How well each quantity is taken to be known, in words, from the very priors that were used."""
    names = uncertain_quantities(freed)
    return tuple(_prior_words(n) for n in freed.prior.nuisances if n.name in names)


def _prior_words(nuisance: Nuisance) -> str:
    name = listed((nuisance.name,))
    if nuisance.additive:
        ends = nuisance.value(nuisance.range)
        sd = float(nuisance.value(nuisance.prior.sd))
        spread = f"±{sd:g}" if isinstance(nuisance.prior, Normal) else f"between {ends[0]:.3g} and {ends[1]:.3g}"
        return f"{name} to {spread} {nuisance.unit}"
    if isinstance(nuisance.prior, Normal):
        return f"{name} to {100 * nuisance.prior.sd:g} %"
    low, high = (math.exp(end) for end in nuisance.prior.support)
    return f"{name} to between {low:.3g} and {high:.3g} times the stated"


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: ``"density, length and gain"``."""
    readable = [name.replace("youngs", "Young's").replace("_", " ") for name in names]
    return "".join(readable) if len(readable) < 2 else f"{', '.join(readable[:-1])} and {readable[-1]}"
