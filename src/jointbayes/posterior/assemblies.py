"""What draws say of the scatter of a joint between its assemblies, and of the usual one at a level."""

import math
from dataclasses import dataclass

import numpy as np

from jointbayes.inference import AssemblyScatter
from jointbayes.posterior.draws import PosteriorDraws
from jointbayes.posterior.rounding import number
from vibrecords.arrays import Array

_STREAM = 11  # of random numbers, beside the seed


@dataclass(frozen=True, slots=True)
class ScatterSummary:
    """Standard deviation of ln k between assemblies.

    Parameters
    ----------
    quantity, assemblies
        What scatters, and the number of assemblies.
    median, interval95, prior_interval95
        Of the standard deviation; its 95 % interval before the data.
    """

    quantity: str
    assemblies: int
    median: float
    interval95: tuple[float, float]
    prior_interval95: tuple[float, float]

    @property
    def sentence(self) -> str:
        """How much it scatters, in per cent."""
        middle, low, high = (number(100 * value, 2) for value in (self.median, *self.interval95))
        interval = f"95 % credible interval {low} to {high} %"
        return f"Between {self.assemblies} assemblies {self.quantity} scatters by {middle} % ({interval})."


def assembly_scatters(posterior: PosteriorDraws) -> tuple[ScatterSummary, ...]:
    """How much each quantity scatters between assemblies; empty where the prior knows of none."""
    summaries = []
    for scatter in posterior.problem.prior.scatters:
        low, middle, high = np.quantile(_drawn(posterior, scatter), [0.025, 0.5, 0.975]).tolist()
        before = tuple(scatter.median * scatter.factor**score for score in (-1.96, 1.96))
        summaries.append(ScatterSummary(scatter.quantity, scatter.count, middle, (low, high), (before[0], before[1])))
    return tuple(summaries)


def usual_assemblies(posterior: PosteriorDraws, name: str, values: Array, level: Array) -> Array | None:
    """Quantity of the usual assembly at each level, drawn from N(mean of ln k there, τ²/n); None where none scatters.

    Parameters
    ----------
    posterior
        Of the draws.
    name
        The quantity as a set-up calls it.
    values, level
        At each draw of each set-up, shape (draws, n), and the level of each, shape (n,).
    """
    scatter = next((each for each in posterior.problem.prior.scatters if each.quantity == name), None)
    if scatter is None:
        return None
    spread, usual = _drawn(posterior, scatter), np.empty(values.shape)
    rng = np.random.default_rng([posterior.record.seed, _STREAM, 1])
    for at in np.unique(level):
        here = level == at
        middle = np.log(values[:, here]).mean(axis=1)
        usual[:, here] = np.exp(middle + spread / math.sqrt(here.sum()) * rng.standard_normal(len(values)))[:, None]
    return usual


def _drawn(posterior: PosteriorDraws, scatter: AssemblyScatter) -> Array:
    """The standard deviation at each draw, shape (draws,)."""
    rng = np.random.default_rng([posterior.record.seed, _STREAM])
    return scatter.draw_scatter(posterior.theta, posterior.problem.prior.names, rng)
