"""The one thing that this room knows of a posterior: its log-density."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import SamplingError

__all__ = ["Checked", "LogDensity"]

LogDensity = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Log of an unnormalised density: (n, d) points to (n,) values, −inf where the density is zero."""


@dataclass(frozen=True, slots=True)
class Checked:
    """A log-density whose values are looked at before the sampler may use them."""

    log_density: LogDensity

    def __call__(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values, shape (n,), at θ, shape (n, d), or a `SamplingError`."""
        values = np.asarray(self.log_density(theta), dtype=np.float64)
        if values.shape != theta.shape[:1]:
            raise SamplingError(
                f"log-density: found values of shape {values.shape} for {len(theta)} points, expected ({len(theta)},)"
            )
        # A NaN is no number and less than nothing: one comparison finds it and +inf.
        possible = values < np.inf
        if not possible.all():
            first = int(np.argmin(possible))
            raise SamplingError(
                f"log-density: found {values[first]} at θ = {theta[first].tolist()}, "
                "expected a finite number, or −inf where the density is zero"
            )
        return values
