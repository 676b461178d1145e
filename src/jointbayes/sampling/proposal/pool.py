"""All draws of a search for a proposal, in whatever coordinates they were made, as one weighted sample."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from jointbayes.sampling.coordinates.chart import Chart
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.proposal.weights import importance_efficiency

__all__ = ["Distribution", "Pool", "theta_draws"]

Array = NDArray[np.float64]


class Distribution(Protocol):
    """A distribution over φ to draw from."""

    def draw(self, random: "np.random.Generator | np.random.RandomState", n: int) -> Array:
        """Independent draws, shape (n, d)."""
        ...

    def log_density(self, x: Array) -> Array:
        """Log of the normalised density, shape (n,), at x, shape (n, d)."""
        ...


def theta_draws(
    log_density: LogDensity, density: Distribution, chart: Chart, rng: np.random.Generator, n: int
) -> tuple[Array, Array, Array, int]:
    """Draws that lie in the chart's region, with the log-density and the log of the proposal's there.

    Returns
    -------
    theta, value, log_proposal : ndarray, shapes (m, d), (m,), (m,)
        m ≤ n; both logs are of densities over θ; the value is −inf where the density is zero.
    left : int
        How many draws left the region.
    """
    phi = density.draw(rng, n)
    theta, inside = chart.inverse(phi)
    theta, phi = theta[inside], phi[inside]
    value = log_density(theta) if len(theta) else np.zeros(0)
    log_proposal = density.log_density(phi)
    finite = np.isfinite(value)
    log_proposal[finite] -= chart.log_volume(theta[finite])
    # rounding at the very edge of the region may leave a volume that is no number
    value = np.where(np.isfinite(log_proposal), value, -np.inf)
    return theta, value, log_proposal, n - len(theta)


class Pool:
    """Draws from several proposals, each weighted as if it came from their mixture.

    References
    ----------
    J.-M. Cornuet et al., Adaptive multiple importance sampling (2012), DOI 10.1111/j.1467-9469.2011.00756.x.
    """

    def __init__(self, log_density: LogDensity, dimension: int) -> None:
        self._log_density = log_density
        self._sources: list[tuple[Distribution, Chart, int]] = []
        self._log_mixture = np.zeros(0)
        self._value = np.zeros(0)
        self.theta = np.zeros((0, dimension))
        self.evaluations = 0

    def extend(self, density: Distribution, chart: Chart, rng: np.random.Generator, n: int) -> float:
        """Add draws from a proposal; return its efficiency."""
        theta, value, log_proposal, left = theta_draws(self._log_density, density, chart, rng, n)
        self.evaluations += len(theta)
        alive = np.isfinite(value)
        log_weight = np.concatenate([value[alive] - log_proposal[alive], np.full(left + int((~alive).sum()), -np.inf)])
        self.add(density, chart, theta[alive], value[alive], n)
        return importance_efficiency(log_weight)

    def add(self, density: Distribution, chart: Chart, theta: Array, value: Array, n: int) -> None:
        """Add those of n draws from a proposal at which the density is above zero."""
        old = np.log(n) + _over_theta(density, chart, self.theta)
        new = [np.log(m) + _over_theta(q, c, theta) for q, c, m in (*self._sources, (density, chart, n))]
        self._sources.append((density, chart, n))
        before = np.logaddexp(self._log_mixture, old) if len(self._sources) > 1 else old
        self._log_mixture = np.concatenate([before, np.logaddexp.reduce(np.stack(new), axis=0)])
        self.theta = np.concatenate([self.theta, theta])
        self._value = np.concatenate([self._value, value])

    @property
    def log_weight(self) -> Array:
        """ln of the importance weight of each draw, up to a constant, shape (n,)."""
        weight: Array = self._value - self._log_mixture
        return weight


def _over_theta(density: Distribution, chart: Chart, theta: Array) -> Array:
    """Log of a proposal's density over θ."""
    value = density.log_density(chart.forward(theta)) - chart.log_volume(theta)
    return np.where(np.isfinite(value), value, -np.inf)
