"""The posterior mode (MAP) as a search leaves it: where it is, what led there, and what other modes there are."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from jointbayes.identification.paper_iteration import IterationHistory, listed_values
from jointbayes.inference import JointPrior
from jointbayes.stored_values import StoredArray
from vibrecords.arrays import Array
from vibrecords.notebook_view import paragraph_html, table_html

#: A further round of search that gains less than this in log density found no better mode.
GAIN = 0.5
#: A mode that fewer starts than this ended at may hide a better one.
LEAST_AGREEING = 3
_HALF_OF_95 = 1.959964  # standard deviations of a normal distribution, either way


@dataclass(frozen=True, slots=True)
class StartOutcome:
    """Where one start led: its first and last joint, shape (q,), log density, and whether that is the best mode."""

    name: str
    start: StoredArray
    stiffness: StoredArray
    log_posterior: float
    reached_mode: bool


@dataclass(frozen=True, slots=True)
class LocalMode:
    """A local maximum of the posterior density.

    Parameters
    ----------
    theta
        Coordinates, shape (d,).
    covariance
        Laplace covariance, shape (d, d).
    log_posterior
        Log density.
    inside
        Of a mode on an edge of the prior's support, a point nearby inside it and the Laplace covariance there.
    """

    theta: StoredArray
    covariance: StoredArray
    log_posterior: float
    inside: tuple[StoredArray, StoredArray] | None = None

    @property
    def start(self) -> tuple[Array, Array]:
        """Place and covariance from which to draw."""
        return self.inside or (self.theta, self.covariance)


@dataclass(frozen=True, slots=True)
class SearchEffort:
    """How far the search for the mode went, and whether its result explains the data.

    Parameters
    ----------
    squares, limit
        Mean squared residual at the MAP relative to the noise, 1 if all is right, and what noise alone hardly exceeds.
    starts, agreeing
        Starts that were climbed, and how many of them ended at the MAP.
    rounds
        Further rounds, with more starts, each begun on a flattened density.
    gain, last_gain
        Log density that all further rounds and the last of them gained.
    """

    squares: float
    limit: float
    starts: int
    agreeing: int
    rounds: int = 0
    gain: float = 0.0
    last_gain: float = 0.0

    @property
    def explains(self) -> bool:
        """Whether squared residuals at the MAP are no larger than the noise allows."""
        return not self.squares > self.limit

    @property
    def mode_missed(self) -> bool:
        """Whether a missed mode is likelier than a wrong model, where the MAP does not explain the data.

        So where hardly a start agrees with the best, or the last round still found a better mode.
        """
        return not self.explains and (self.agreeing < min(LEAST_AGREEING, self.starts) or self.last_gain >= GAIN)

    @property
    def sentence(self) -> str:
        """What to think of a MAP that does not explain the data; empty where it does."""
        if self.explains:
            return ""
        size, most = math.sqrt(self.squares), math.sqrt(self.limit)
        words = f"The best fit misses the data by {size:.3g} times their noise (noise alone: up to {most:.3g})."
        if not self.mode_missed:
            return f"{words} No better fit was found from {self.starts} starts: most likely the model is wrong."
        why = f"Only {self.agreeing} of {self.starts} starts lead to it"
        if self.agreeing >= min(LEAST_AGREEING, self.starts):
            why = f"Round {self.rounds} of the search still improved it"
        return f"{words} {why}: a better one may exist. Narrow the priors or give a better first guess."


@dataclass(frozen=True, slots=True)
class MapEstimate:
    """Mode of the posterior density over θ.

    Parameters
    ----------
    theta
        Coordinates of the mode, shape (d,).
    values
        Quantities of the joint at the mode, shape (q,).
    covariance
        Laplace covariance of θ, shape (d, d); never wider than the prior in any direction.
    log_posterior
        Log density at the mode, up to the evidence.
    starts
        How each start ended.
    modes
        Local modes that starts led to and that may matter, the highest first: none is more than 12 below it in log
        density.
    effort
        How far the search went and whether its result explains the data; None where that was not looked at.
    iteration
        The paper's iteration; None where it was not made.
    units
        Name and unit of each quantity; empty of a file that an older version wrote.
    others
        Value at the mode and unit of each uncertain quantity besides the joint, by name; empty of such a file too.
    """

    theta: StoredArray
    values: StoredArray
    covariance: StoredArray
    log_posterior: float
    starts: tuple[StartOutcome, ...]
    modes: tuple[LocalMode, ...] = ()
    effort: SearchEffort | None = None
    iteration: IterationHistory | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    others: Mapping[str, tuple[float, str]] = field(default_factory=dict)

    def __repr__(self) -> str:
        units = {**self.units, **{name: unit for name, (_, unit) in self.others.items()}}
        values = listed_values(units, np.array([*self.values, *(value for value, _ in self.others.values())]))
        return " ".join(filter(None, (f"MapEstimate({values}; {self._search})", self.sentence)))

    @property
    def _search(self) -> str:
        reached, count = len(self.starts) - len(self.failed_starts), len(self.modes)
        starts = f"{reached} of {len(self.starts)} starts reach it"
        return f"log posterior {self.log_posterior:.6g}, {starts}, {count} mode{'s' * (count != 1)}"

    def laplace_ends(self, prior: JointPrior) -> Array | None:
        """Ends of the 95 % interval of each quantity of the joint by the curvature at the mode, shape (2, q).

        Of one that cannot be negative on the logarithmic scale. None where the mode lies on an edge of the prior.

        Parameters
        ----------
        prior
            Of the problem.
        """
        if prior.coordinates_at_edge(self.theta):
            return None
        steps = 1e-4 * np.diag(self.covariance.diagonal() ** 0.5)
        above, below = prior.values(self.theta + steps), prior.values(self.theta - steps)
        slope = (above - below) / (2 * steps.diagonal()[:, None])
        half = _HALF_OF_95 * np.sqrt(np.einsum("dq,de,eq->q", slope, self.covariance, slope))
        factor = np.exp(half / np.abs(self.values))
        signed = np.array([quantity.may_be_negative for quantity in prior.parametrisation.quantities])
        return np.where(signed, [self.values - half, self.values + half], [self.values / factor, self.values * factor])

    def _repr_html_(self) -> str:
        named = zip(self.units.items() or [("", "")] * self.values.size, self.values, strict=True)
        rows = [(name, f"{value:.4g}", unit) for (name, unit), value in named]
        rows += [(name, f"{value:.4g}", unit) for name, (value, unit) in self.others.items()]
        after = paragraph_html(self.sentence)
        return table_html(f"MAP: {self._search}", ("Quantity", "Value", "Unit"), rows, after)

    @property
    def places(self) -> Array:
        """The mode and all other modes, shape (n, d), the highest first."""
        others = (mode.theta for mode in self.modes if not np.array_equal(mode.theta, self.theta))
        return np.array([self.theta, *others])

    @property
    def starts_for_draws(self) -> tuple[tuple[Array, Array], ...]:
        """Place and covariance of every mode, the highest first; of one on an edge of the prior, a little inside."""
        return tuple(mode.start for mode in self.modes) or ((self.theta, self.covariance),)

    @property
    def failed_starts(self) -> tuple[str, ...]:
        """Names of the starts that ended elsewhere."""
        return tuple(s.name for s in self.starts if not s.reached_mode)

    @property
    def sentence(self) -> str:
        """What to think of a MAP that does not explain the data; empty where it does, or that was not looked at."""
        return self.effort.sentence if self.effort is not None else ""
