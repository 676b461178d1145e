"""The stated noise, and an error in proportion to |H| whose size is inferred."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.inference.marginals import Nuisance
from jointbayes.inference.noise.base import GaussianSpread, NoiseChoice, NoiseModel, Residuals, log_uniform, rows_of
from vibrecords import Data, FrfData
from vibrecords.arrays import Array
from vibrecords.errors import read_only

#: Sizes of the error, as fractions of |H|, between which every order of magnitude is equally probable.
RANGE = 1e-4, 0.3


def noise_of(choice: NoiseChoice, parts: int, data: Data) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """The noise model that a case chooses, and the priors of its hyperparameters."""
    if data.frfs is None:
        raise ModelError.of("proportional noise", (), f"found {data.words}", "FRFs", "use Gaussian noise")
    noise = ProportionalNoise.of(data.frfs, choice.scale == "sampled")
    return noise, (*choice.parameters, log_uniform("proportional_error", "× |H|", *RANGE))


@dataclass(frozen=True, eq=False)
class ProportionalNoise(GaussianSpread):
    """Independent Gaussian noise as stated, plus an error that is a fraction of |H|: v = s² + ε²/ε₀².

    Coherence and repeated runs see what changes from average to average. They do not see what is the same in all of
    them and yet differs from line to line: a nonlinear clamp, leakage, windows, a cable that pulls. That error grows
    with |H|. Its size, the standard deviation `proportional_error` ε of each part as a fraction of |Hˣ|, is inferred:
    lines at resonances then count for no more than they agree with each other, and lines in the noise stay as stated.

    Parameters
    ----------
    parts
        2: residuals are complex.
    stated
        ε₀, standard deviation of each part as a fraction of |Hˣ| by the stated noise, shape (lines, pairs).
    scaled
        Whether the stated noise has an unknown factor s, `noise_scale`.
    """

    parts: int
    stated: Array
    scaled: bool = False
    takes_white_residuals: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "stated", read_only(self.stated))

    @classmethod
    def of(cls, data: FrfData, scaled: bool = False) -> Self:
        """The model of a measurement."""
        with np.errstate(divide="ignore"):  # a measured zero has no error in proportion to it
            variance = data.variance / (2 * np.abs(data.frf.values) ** 2)
        return cls(2, np.sqrt(variance).reshape(len(variance), -1), scaled)

    def fitted_to(self, data: FrfData, parts: int) -> Self:
        """The same law for the lines and values of another measurement."""
        return type(self).of(data, self.scaled)

    def words(self, values: Mapping[str, float], z: Residuals) -> tuple[str, ...]:
        """What of the noise was inferred, in sentences."""
        error = f"{values['proportional_error']:.2g} times |H|"
        return (*super().words(values, z), f"Beside the stated noise an error of {error} in each part was inferred.")

    @property
    def names(self) -> tuple[str, ...]:
        """Hyperparameters, in order."""
        return (*(("noise_scale",) if self.scaled else ()), "proportional_error")

    def spread(self, hyper: ArrayLike, n: int) -> Array:
        """Standard deviation over the stated one, shape (n, lines, pairs)."""
        rows = rows_of(hyper, n, self.names)
        scale = rows[:, 0] if self.scaled else np.ones(n)
        return np.hypot(scale[:, None, None], rows[:, -1, None, None] / self.stated)
