"""The posterior mode (MAP) as a search leaves it: where it is, what led there, and what other modes there are."""

from dataclasses import dataclass

from jointbayes.arrays import Array
from jointbayes.identification.paper_iteration import IterationHistory

#: A further round of search that gains less than this in log density found no better mode.
GAIN = 0.5
#: A mode that fewer starts than this ended at may hide a better one.
LEAST_AGREEING = 3
_NAMED = 8  # starts in a sentence


@dataclass(frozen=True, slots=True)
class StartOutcome:
    """Where one start led: its first and last joint, shape (q,), log density, and whether that is the best mode."""

    name: str
    start: Array
    stiffness: Array
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

    theta: Array
    covariance: Array
    log_posterior: float
    inside: tuple[Array, Array] | None = None

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
        words = (
            f"The MAP does not explain the data: squared residuals are {self.squares:.3g} times the expected noise "
            f"(noise alone: up to {self.limit:.3g}). {self.agreeing} of {self.starts} starts end at it"
        )
        if self.rounds:
            rounds = f"{self.rounds} further round" + ("s" if self.rounds > 1 else "")
            words += f", after {rounds} of search that " + (
                f"gained {self.gain:.3g} in log density" if self.gain >= GAIN else "found no better mode"
            )
        if self.mode_missed:
            return words + (
                ". It is likelier that the search missed the mode than that the model is wrong: narrow the priors, or "
                "give a better first guess."
            )
        return words + ". It is likelier that the model is wrong than that the search missed the mode."


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
        The paper's iteration, whose end was one of the starts; None where it was not made.
    """

    theta: Array
    values: Array
    covariance: Array
    log_posterior: float
    starts: tuple[StartOutcome, ...]
    modes: tuple[LocalMode, ...] = ()
    effort: SearchEffort | None = None
    iteration: IterationHistory | None = None

    def __repr__(self) -> str:
        values = ", ".join(f"{k:.4g}" for k in self.values)
        reached = len(self.starts) - len(self.failed_starts)
        count = len(self.modes)
        return (
            f"MapEstimate(values [{values}], log posterior {self.log_posterior:.6g}, {reached} of "
            f"{len(self.starts)} starts reach it, {count} mode{'s' * (count != 1)})"
        )

    @property
    def starts_for_draws(self) -> tuple[tuple[Array, Array], ...]:
        """Place and covariance of every mode, the highest first; of one on an edge of the prior, a little inside."""
        return tuple(mode.start for mode in self.modes) or ((self.theta, self.covariance),)

    @property
    def failed_starts(self) -> tuple[str, ...]:
        """Names of the starts that ended elsewhere."""
        return tuple(s.name for s in self.starts if not s.reached_mode)

    @property
    def failed_text(self) -> str:
        """The same in words, no more than eight of them by name."""
        names = list(self.failed_starts)
        more = [f"and {len(names) - _NAMED} more"] if len(names) > _NAMED else []
        return ", ".join(names[:_NAMED] + more)

    @property
    def sentence(self) -> str:
        """What to think of a MAP that does not explain the data; empty where it does, or nobody looked."""
        return self.effort.sentence if self.effort is not None else ""
