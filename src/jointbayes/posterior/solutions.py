"""Several solutions: modes of a posterior that are apart, what each says, and what measurement tells them apart."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import JointBayesError
from jointbayes.frf import Ports
from jointbayes.inference import Problem
from jointbayes.joint.quantities import is_rotation
from jointbayes.posterior.checks import PredictiveCheck
from jointbayes.posterior.prediction import frfs_as_measured
from jointbayes.posterior.run_record import AnyDraws
from jointbayes.rounding import join_unit, number, rounded, rounded_interval
from jointbayes.sampling import INTERVAL, SeveralModes, quantile_spread
from vibrecords.arrays import Array

#: A solution with less of the probability lies outside every 95 % interval.
LEAST_SHARE = 0.025
#: Between two solutions draws are this much sparser than in the sparser of the two: halves of one ridge are not.
_VALLEY = 0.3
_WORDS = {2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}
_LINES = 200  # at which FRFs of the solutions are compared
_MOST_PLACES = 1000  # of further sensors that are compared
_ALIKE = 1e-3  # of |H|: FRFs that differ by less are equal
_SHALLOWEST = 0.1  # of the median |H|: smaller values lie below the noise of other lines


class CheckedDraws(AnyDraws, Protocol):
    """Draws with the check of the data."""

    @property
    def check(self) -> PredictiveCheck:
        """Posterior predictive check of the data that were analysed."""


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

    def __init__(self, posterior: CheckedDraws) -> None:
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

    def reason(self, name: str) -> str:
        """Why such a quantity is not identified: each value with its 95 % interval and probability; or empty."""
        posterior, groups = self._posterior, self.values_of(name)
        if len(groups) < 2:
            return ""
        values = []
        for modes in groups:
            draws, share = self._draws(name, modes), float(self.shares[modes].sum())
            effective = max(1.0, share * min(map(float, posterior.record.sampler["ess"].values())))
            quantiles = [(float(np.quantile(draws, p)), quantile_spread(draws, p, effective)) for p in (0.5, *INTERVAL)]
            (median, error), low, high = quantiles
            interval = rounded_interval((low[0], high[0]), (low[1], high[1]))
            unit = posterior.unit(name)
            values.append(f"{join_unit(rounded(median, error), unit)} ({interval}) with probability {share:.2f}")
        return f"{_count(len(groups))} solutions: {' or '.join(values)}"

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
            f"{_count(len(self._distinct)).capitalize()} solutions {fit} ({shares}): "
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


def further_measurement(problem: Problem, theta: Array) -> str:
    """At which DOF the FRFs of several solutions, θ of shape (m, d), differ the most, in a sentence; or empty.

    Of the translations of the model's points that are not measured, with the force where it is, that at which the two
    solutions that differ the least differ the most, as the root of the mean square over the lines relative to |H|. Of
    modes as data force and sensor are at one point.
    """
    part = ([part for part in problem.parts if part.test.data.frfs] or list(problem.parts))[0]
    measured = part.test.data.frfs
    labels = part.test.structures_of_data.labels
    evenly = labels[:: -(-len(labels) // _MOST_PLACES)]
    candidates = tuple(dof for dof in evenly if dof.rpartition(":")[0].isalnum() and not is_rotation(dof))
    if measured is not None:
        candidates = tuple(label for label in candidates if label not in measured.frf.outputs)
        lines, inputs = measured.frf.frequency_hz, measured.frf.inputs[:1]
        noise = float(np.median(np.sqrt(measured.variance) / np.abs(measured.frf.values)))
    else:
        lines, inputs, noise = np.linspace(0.5, 1.2, _LINES) * part.test.data.top_hz, candidates, 0.0
    if not (candidates and part.test.data.top_hz):  # of a static test nobody knows the band of a further one
        return ""
    lines = lines[np.linspace(0, len(lines) - 1, min(len(lines), _LINES)).round().astype(int)]
    prior = problem.prior
    try:
        ports = Ports(lines, candidates, inputs)
        frf = frfs_as_measured(part, ports, "receptance", prior.values(theta), prior.factors(theta))
    except JointBayesError:  # a body given by its FRFs has them at its measured DOFs alone
        return ""
    frf = frf[..., 0] if measured is not None else np.diagonal(frf, axis1=2, axis2=3)
    size = np.abs(frf).mean(axis=0)
    size = np.maximum(size, _SHALLOWEST * np.median(size, axis=0))
    pairs = [np.abs((frf[i] - frf[j]) / size) for i, j in combinations(range(len(theta)), 2)]
    difference = np.sqrt(np.mean(np.square(pairs), axis=1)).min(axis=0)
    best = int(np.argmax(difference))
    if not difference[best] > max(noise, _ALIKE):
        return "No single sensor at another point of the model would tell them apart."
    place = candidates[best]
    where = f"A sensor at {place} with the force at {inputs[0]}" if noise else f"An FRF at {place}"
    text = f"{where} would tell them apart: there their FRFs differ by {100 * difference[best]:.0f} % of |H|"
    return f"{text}, {number(difference[best] / noise, 2)} times the noise." if noise else f"{text}."


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


def _count(count: int) -> str:
    return _WORDS.get(count, str(count))
