"""A posterior as the functions beside it see it, and its several solutions.

Solutions are modes that are apart: what each says, and what measurement tells them apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from jointbayes.identification import MapEstimate
from jointbayes.inference import Problem
from jointbayes.phrases import Because, Reason, counted
from jointbayes.posterior.checks import PredictiveCheck
from jointbayes.posterior.compared_frfs import ComparedFrf
from jointbayes.posterior.diagnosis import Diagnosis
from jointbayes.posterior.identifiability import Verdict
from jointbayes.posterior.limits import LikelihoodRegion
from jointbayes.posterior.model_errors import InferredError, MeshCheck, NoiseOfBodies
from jointbayes.posterior.prediction import LeftOut, further_measurement
from jointbayes.posterior.run_record import RunRecord
from jointbayes.rounding import join_unit, rounded, rounded_interval
from jointbayes.sampling import INTERVAL, SeveralModes, quantile_spread
from jointbayes.verdict_rule import VerdictRule
from vibrecords.arrays import Array

#: A solution with less of the probability lies outside every 95 % interval.
LEAST_SHARE = 0.025
#: Between two solutions draws are this much sparser than in the sparser of the two: halves of one ridge are not.
_VALLEY = 0.3


@dataclass(frozen=True, slots=True)
class ModeSummary:
    """A mode of several: its share of the draws, height, and median and 95 % interval of each quantity by name."""

    share: float
    log_posterior: float
    values: Mapping[str, Mapping[str, float | tuple[float, float]]]


class Solutions:
    """Draws by the mode that is nearest to them.

    Parameters
    ----------
    posterior
        The posterior.
    """

    def __init__(self, posterior: "AnyPosterior") -> None:
        self._posterior, starts = posterior, posterior.estimate.starts_for_draws
        self._modes = SeveralModes.from_starts(starts) if len(starts) > 1 else None
        self._nearest = self.nearest(posterior.theta)
        #: Share of the draws of each mode.
        self.shares = np.bincount(self._nearest, minlength=len(starts)) / len(self._nearest)

    def nearest(self, theta: Array) -> NDArray[np.intp]:
        """Number of the mode nearest to each point θ, shape (n, d)."""
        return np.zeros(len(theta), dtype=np.intp) if self._modes is None else self._modes.nearest(theta)

    def _draws(self, name: str, modes: list[int]) -> Array:
        return self._posterior.values(name).ravel()[np.isin(self._nearest, modes)]

    def values_of(self, name: str) -> list[list[int]]:
        """Modes that give a quantity the same value, together: one list for each value, from low to high."""
        likely = np.flatnonzero(self.shares >= LEAST_SHARE).tolist()
        groups: list[list[int]] = []
        for mode in sorted(likely, key=lambda mode: float(np.median(self._draws(name, [mode])))):
            if groups and not _are_apart(self._draws(name, groups[-1]), self._draws(name, [mode])):
                groups[-1].append(mode)
            else:
                groups.append([mode])
        return groups

    @cached_property
    def split(self) -> tuple[str, ...]:
        """Names of the quantities to which the solutions give different values."""
        return tuple(name for name in self._posterior.stiffness_names if len(self.values_of(name)) > 1)

    def reason(self, name: str) -> Because | None:
        """Each value of such a quantity with its 95 % interval and probability; None of a quantity with one value."""
        posterior, groups = self._posterior, self.values_of(name)
        if len(groups) < 2:
            return None
        values = []
        for modes in groups:
            draws, share = self._draws(name, modes), float(self.shares[modes].sum())
            effective = max(1.0, share * min(map(float, posterior.record.sampler["ess"].values())))
            quantiles = [(float(np.quantile(draws, p)), quantile_spread(draws, p, effective)) for p in (0.5, *INTERVAL)]
            (median, error), low, high = quantiles
            interval = rounded_interval((low[0], high[0]), (low[1], high[1]))
            unit = posterior.unit(name)
            values.append((f"{join_unit(rounded(median, error), unit)} ({interval})", share))
        return Because(Reason.SOLUTIONS, {"solutions": tuple(values)})

    @cached_property
    def _distinct(self) -> list[list[int]]:
        """Modes that differ in no quantity together, the likeliest solution first."""
        groups: dict[tuple[int, ...], list[int]] = {}
        places = [{mode: i for i, modes in enumerate(self.values_of(name)) for mode in modes} for name in self.split]
        for mode in np.flatnonzero(self.shares >= LEAST_SHARE).tolist():
            groups.setdefault(tuple(place[mode] for place in places), []).append(mode)
        return sorted(groups.values(), key=lambda modes: -self.shares[modes].sum())

    @property
    def sentence(self) -> str:
        """What the solutions are and what measurement would tell them apart; empty where there is one."""
        return " ".join(self.sentences)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The same, sentence by sentence."""
        return tuple(filter(None, (self.description, self.advice)))

    @cached_property
    def advice(self) -> str:
        """What measurement would tell the solutions apart; empty where there is one, or nobody knows."""
        if not self.split:
            return ""
        theta = np.array([self._posterior.estimate.starts_for_draws[modes[0]][0] for modes in self._distinct])
        return further_measurement(self._posterior.problem, theta)

    @property
    def description(self) -> str:
        """How many solutions there are, and in what they differ; empty where there is one."""
        if not self.split:
            return ""
        shares = f"probability {', '.join(f'{self.shares[modes].sum():.2f}' for modes in self._distinct)}"
        if not self._posterior.converged:
            shares = "their probabilities are not settled, as the sampler has not converged"
        # of a model that does not explain the data the solutions only fit best
        fit = "explain the data" if self._posterior.check.explains else "fit the data best"
        return (
            f"{counted(len(self._distinct)).capitalize()} solutions {fit} ({shares}): "
            f"{', '.join(self.split)} differ between them."
        )

    def summaries(self) -> tuple[ModeSummary, ...]:
        """Every mode that has draws, where there are several."""
        names = [*self._posterior.stiffness_names, *(n.name for n in self._posterior.problem.prior.nuisances)]
        modes = np.flatnonzero(self.shares).tolist() if len(self.shares) > 1 else []
        summaries = []
        for mode in modes:
            values = {}
            for name in names:
                median, low, high = np.quantile(self._draws(name, [mode]), [0.5, *INTERVAL]).tolist()
                values[name] = {"median": median, "interval95": (low, high)}
            height = self._posterior.estimate.modes[mode].log_posterior
            summaries.append(ModeSummary(float(self.shares[mode]), height, values))
        return tuple(summaries)


def _are_apart(left: Array, right: Array) -> bool:
    """Whether draws of two modes, the lower first, have a gap between them, and are not halves of one ridge."""
    (start, low), (high, end) = np.quantile(left, INTERVAL), np.quantile(right, INTERVAL)
    if not low < high:
        return False
    between = sum(int(((draws > low) & (draws < high)).sum()) for draws in (left, right)) / (high - low)
    sparser = 0.95 * min(
        len(draws) / max(width, np.finfo(float).tiny) for draws, width in ((left, low - start), (right, end - high))
    )
    return bool(between < _VALLEY * sparser)


class AnyPosterior(Protocol):
    """Draws with what is computed and found of them; each member is described by the class."""

    @property
    def problem(self) -> Problem:
        """Structure, joint, data and prior."""

    @property
    def estimate(self) -> MapEstimate:
        """MAP with Laplace covariance."""

    @property
    def mode_theta(self) -> Array:
        """The best draw refined, shape (d,)."""

    @property
    def record(self) -> RunRecord:
        """How the draws came about."""

    @property
    def converged(self) -> bool:
        """Whether the sampler met its stop rule."""

    @property
    def theta(self) -> Array:
        """All draws of θ, shape (n, d), chain after chain."""

    @property
    def stiffness_names(self) -> tuple[str, ...]:
        """Names of the joint's stiffnesses."""

    def values(self, name: str) -> Array:
        """All draws of one stiffness or other quantity, shape (chains, draws)."""

    def unit(self, name: str) -> str:
        """Unit of one stiffness or other quantity."""

    @property
    def check(self) -> PredictiveCheck:
        """Posterior predictive check of the data that were analysed."""

    @property
    def mode_log_density(self) -> float:
        """Log density of the best draw refined."""

    @property
    def mode(self) -> Mapping[str, float]:
        """Joint posterior mode (of the density over θ) in physical units, by name."""

    @property
    def mode_distance(self) -> float:
        """Largest distance of joint mode and MAP in Laplace standard deviations: 0 where they agree."""

    @property
    def mode_agrees(self) -> bool:
        """Whether joint mode and MAP are one point: within 0.01 standard deviations, or equal in density to 0.001."""

    @property
    def at_prior_edge(self) -> tuple[str, ...]:
        """Coordinates whose mode lies on an edge of the prior's support: there the prior decides, not the data."""

    @property
    def checks(self) -> tuple[PredictiveCheck, ...]:
        """The check of each test, at a level that allows for the tests of all."""

    @property
    def diagnosis(self) -> Diagnosis:
        """How far the MAP is from the data in an engineer's measure, and what its residuals point to."""

    @property
    def compared_frfs(self) -> Mapping[str, tuple[ComparedFrf, ...]]:
        """Each measured FRF and the predicted one, by test."""
        ...

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """The diagnosis of each test."""

    @property
    def model_error(self) -> InferredError | None:
        """The model's error in natural frequencies as it was inferred; None where there is no place for one."""

    @property
    def mesh(self) -> MeshCheck | None:
        """What the elements of the model do to the result; None where the structure is given by its matrices."""

    @property
    def noise_of_bodies(self) -> NoiseOfBodies | None:
        """What the errors of measured bodies do to the result; None where the structure is modelled throughout."""

    @property
    def solutions(self) -> Solutions:
        """What each of several modes says; of one mode itself."""

    @property
    def likelihood_region(self) -> LikelihoodRegion:
        """Joints that fit nearly as well as the best, for likelihood-ratio limits, which it keeps once found."""

    def prior_values(self, name: str) -> Array:
        """Draws of one stiffness from the prior, shape (1, draws)."""

    def by_ensemble(self, name: str) -> Array:
        """All draws of one quantity with walkers of an ensemble together, shape (ensembles, draws, walkers)."""

    def interval(self, name: str, probability: float = 0.95) -> tuple[float, float]:
        """Equal-tailed credible interval of one stiffness, in its unit."""

    def thinned(self, most: int) -> Array:
        """At most so many draws of θ, evenly spaced over all chains, shape (n, d)."""

    def predict_natural_frequencies(self, count: int = 3, max_draws: int = 4000, *, test: str | None = None) -> Array:
        """Natural frequencies of posterior draws, shape (draws, count), Hz."""

    def predict_left_out(self) -> tuple[LeftOut, ...]:
        """What was left out of the data, and what the draws predict a measurement of it to show."""

    def has_default_prior(self, name: str) -> bool:
        """Whether the range of a quantity is the default one, which the case does not state."""

    def rule(self, name: str) -> VerdictRule:
        """Thresholds by which a stiffness is judged."""

    def verdict(self, name: str) -> Verdict:
        """Median, 95 % interval with errors, verdict with its reason and what it takes as exact."""
