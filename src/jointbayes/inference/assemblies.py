"""Assemblies of one joint: how much a stiffness scatters from one to the next, as a layer of the prior.

A joint that is taken apart and put together again is not the same joint. Of n assemblies ln k scatters about their mean
by N(0, τ²), and τ itself is unknown, log-normal. The prior that is stated of each assembly is then that of their mean:

    p(x₁ … xₙ) = π(x̄) n^(−1/2) ∫ p(τ) Π_j N(y_j; 0, τ²) dτ,

x = ln k, y_j the n − 1 orthonormal contrasts of x, whose squares sum up to Σ (x_i − x̄)². Assemblies at several levels
have a mean each and τ in common. τ is integrated out over a grid, so that nothing more is sampled and there is no
funnel, and drawn afterwards from its conditional density given the stiffnesses, which is exact.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.inference.marginals import Marginal
from vibrecords.arrays import Array

#: ln τ over its prior's standard deviations, from the median.
_NODES = np.linspace(-6.0, 6.0, 193)
_LOG_WEIGHTS = -0.5 * _NODES**2 - math.log(np.exp(-0.5 * _NODES**2).sum())


@dataclass(frozen=True, slots=True)
class AssemblyScatter:
    """Scatter of ln k of one quantity of a joint between assemblies.

    Parameters
    ----------
    quantity
        As each set-up calls it: ``"k22"``.
    groups
        Names of the coordinates ln k of assemblies that have a mean in common, at least two each: one group for each
        level.
    median, factor
        Of the log-normal prior of the standard deviation τ: its median, and the factor of one standard deviation.

    Raises
    ------
    ModelError
        If there is a group of one, or a number is impossible.
    """

    quantity: str
    groups: tuple[tuple[str, ...], ...]
    median: float = 0.1
    factor: float = 3.0

    def __post_init__(self) -> None:
        if not self.groups or min(map(len, self.groups)) < 2:
            raise ModelError(
                f"assemblies of {self.quantity}: found {self.groups}; expected two assemblies at least; name them"
            )
        if not (0 < self.median < math.inf and 1 < self.factor < math.inf):
            raise ModelError(
                f"assemblies of {self.quantity}: found a scatter of {self.median:g} times {self.factor:g} or over it; "
                "expected a median above 0 and a factor above 1; correct them"
            )

    @property
    def count(self) -> int:
        """Number of assemblies."""
        return sum(map(len, self.groups))

    @property
    def freedom(self) -> int:
        """Number of contrasts: assemblies less means."""
        return self.count - len(self.groups)

    @property
    def _scatters(self) -> Array:
        return self.median * self.factor**_NODES

    def columns(self, names: Sequence[str]) -> list[list[int]]:
        """Places of the coordinates of each group among those of a prior.

        Raises
        ------
        ModelError
            If one is not there.
        """
        missing = [name for group in self.groups for name in group if name not in names]
        if missing:
            raise ModelError(
                f"assemblies of {self.quantity}: found no prior of {', '.join(missing)}; expected one of each of "
                f"{', '.join(names)}; correct the names"
            )
        return [[names.index(name) for name in group] for group in self.groups]

    def log_ratio(self, theta: Array, names: Sequence[str], marginals: Sequence[Marginal]) -> Array:
        """ln of the density over that of independent marginals, shape (n,), of θ inside these, shape (n, d)."""
        total = self._log_given_scatter(theta, names)
        top = total.max(axis=1)
        ratio = top + np.log(np.exp(total - top[:, None]).sum(axis=1))
        for group in self.columns(names):
            x = theta[:, group]
            ratio += marginals[group[0]].log_density(x.mean(axis=1)) - math.log(len(group)) / 2
            ratio -= sum(marginals[i].log_density(theta[:, i]) for i in group)
        return np.asarray(ratio)

    def _log_given_scatter(self, theta: Array, names: Sequence[str]) -> Array:
        """ln of the weight of each τ times the density of the contrasts under it, shape (n, nodes)."""
        squares = sum(((theta[:, g] - theta[:, g].mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
                      for g in self.columns(names))  # fmt: skip
        of_each = -0.5 * self.freedom * np.log(2 * np.pi * self._scatters**2)
        return np.asarray(_LOG_WEIGHTS + of_each - 0.5 * np.asarray(squares)[:, None] / self._scatters**2)

    def draw_scatter(self, theta: Array, names: Sequence[str], rng: np.random.Generator) -> Array:
        """Draw τ from its conditional density given θ, shape (n, d), one for each: shape (n,)."""
        total = self._log_given_scatter(theta, names)
        reached = np.cumsum(np.exp(total - total.max(axis=1, keepdims=True)), axis=1)
        asked = rng.random(len(theta)) * reached[:, -1]
        # each node has the cell of half a step to either side
        place = [np.interp(a, steps, _NODES + np.diff(_NODES)[0] / 2) for a, steps in zip(asked, reached, strict=True)]
        return np.asarray(self.median * self.factor ** np.array(place))

    def scattered(self, theta: Array, names: Sequence[str], rng: np.random.Generator) -> Array:
        """θ of independent draws, shape (n, d), with assemblies scattered about that of each group's first."""
        scattered = theta.copy()
        scatter = self.median * self.factor ** rng.standard_normal(len(theta))
        for group in self.columns(names):
            away = scatter[:, None] * rng.standard_normal((len(theta), len(group)))
            scattered[:, group] = theta[:, [group[0]]] + away - away.mean(axis=1, keepdims=True)
        return scattered
