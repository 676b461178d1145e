"""The forecast of a further measurement: how well a stiffness would then be known, and what the measurement costs."""

from dataclasses import dataclass

from jointbayes.phrases import WORKSHOP
from jointbayes.posterior.fisher import LARGEST, WORTH_SAYING, spread_in_words
from jointbayes.rounding import sentence_start

#: A measurement that makes the standard deviation less than so many times smaller is not worth its price.
_LEAST_GAIN = 1.15


@dataclass(frozen=True, slots=True)
class NextStep:
    """A forecast: a further measurement, and the standard deviation of ln of a stiffness before and after it.

    Parameters
    ----------
    quantity
        Name of the stiffness.
    words, price
        The measurement and what it costs, for a sentence.
    sd_before, sd_after
        Linearised.
    names
        Quantities that are uncertain in the forecast though the run takes them as exact; empty where there are none.
    """

    quantity: str
    words: str
    price: str
    sd_before: float
    sd_after: float
    names: tuple[str, ...] = ()

    @property
    def gain(self) -> float:
        """How many times smaller the standard deviation becomes; of what is unknown before, from 0.05 to 20 times."""
        return min(self.sd_before, LARGEST) / min(self.sd_after, LARGEST)

    @property
    def is_worth_it(self) -> bool:
        """Whether the stiffness is then known, and much better than before."""
        return self.sd_after <= WORTH_SAYING and self.sd_before > _LEAST_GAIN * self.sd_after

    @property
    def sentence(self) -> str:
        """The step with what it should bring, said to be an estimate, and its price."""
        rest = f" with {WORKSHOP}" if self.names else ""
        return (
            f"{sentence_start(self.words)} should give {self.quantity} to {spread_in_words(self.sd_after)}"
            f"{rest} (95 %, an estimate). It costs {self.price}; jointbayes plan ranks the others."
        )
