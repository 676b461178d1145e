"""The several solutions of a posterior: modes that are apart, and what each says."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from jointbayes.phrases import Because, Reason
from jointbayes.posterior.sampled import Sampled, once
from jointbayes.rounding import join_unit, rounded, rounded_interval
from jointbayes.sampling import INTERVAL, quantile_spread
from jointbayes.sampling.density import covariance_roots
from vibrecords.arrays import Array

#: A solution with less of the probability lies outside every 95 % interval.
LEAST_SHARE = 0.025
#: Between two solutions draws are this much sparser than in the sparser of the two: halves of one ridge are not.
_VALLEY = 0.3
_LEAST_CORRELATED = 1e-10  # eigenvalue of the correlations of a mode's covariance


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

    def __init__(self, posterior: Sampled) -> None:
        self._posterior, starts = posterior, posterior.estimate.starts_for_draws
        self._modes = [(place, covariance_roots(covariance, _LEAST_CORRELATED)) for place, covariance in starts]
        self._nearest = self.nearest(posterior.theta)
        #: Share of the draws of each mode.
        self.shares = np.bincount(self._nearest, minlength=len(starts)) / len(self._nearest)

    def nearest(self, theta: Array) -> NDArray[np.intp]:
        """Number of the mode nearest to each point θ, shape (n, d), in standard deviations about each."""
        if len(self._modes) == 1:
            return np.zeros(len(theta), dtype=np.intp)
        away = [np.linalg.solve(root, (theta - place).T) for place, root in self._modes]
        return np.asarray(np.argmin([(z**2).sum(axis=0) for z in away], axis=0))

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
    def distinct(self) -> list[list[int]]:
        """Modes that differ in no quantity together, the likeliest solution first."""
        groups: dict[tuple[int, ...], list[int]] = {}
        places = [{mode: i for i, modes in enumerate(self.values_of(name)) for mode in modes} for name in self.split]
        for mode in np.flatnonzero(self.shares >= LEAST_SHARE).tolist():
            groups.setdefault(tuple(place[mode] for place in places), []).append(mode)
        return sorted(groups.values(), key=lambda modes: -self.shares[modes].sum())

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


@once
def solutions_of(posterior: Sampled) -> Solutions:
    """Sort the draws of a posterior by its modes."""
    return Solutions(posterior)
