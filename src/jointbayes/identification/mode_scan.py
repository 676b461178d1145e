"""Where the data put the natural frequencies that a model is not trusted to predict."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.inference import LogPosterior
from jointbayes.structure import is_mode_frequency

__all__ = ["with_modes_on_data"]

Array = NDArray[np.float64]

_STEP = 0.005  # in ln f: a fraction of a resonance's width at the damping ratios of steel assemblies
_WIDEST = 3.0  # prior standard deviations to either side
_SWEEPS = 2  # each mode is looked for with the others where they were last found


def with_modes_on_data(log_posterior: LogPosterior, theta: Array) -> Array:
    """Move each error of a natural frequency, ``mode_frequency_1`` and so on, to its best place on a grid.

    A climb finds a resonance only from within its width, and an error of ten per cent is many widths.

    Parameters
    ----------
    log_posterior
        The density.
    theta
        A point inside the support, shape (d,).

    Returns
    -------
    ndarray, shape (d,)
        The same point where no such error is uncertain. The size of a model discrepancy is the largest possible
        during the scan, so that one resonance is found while the others are still off.
    """
    prior = log_posterior.prior
    columns = [i for i, name in enumerate(prior.names) if is_mode_frequency(name)]
    if not columns:
        return theta
    low, high = prior.support
    tolerant = np.array(theta)
    for i, name in enumerate(prior.names):
        if name == "discrepancy_scale":
            tolerant[i] = high[i] - 1e-6 * (high[i] - low[i])
    for _ in range(_SWEEPS):
        for i in columns:
            reach = min(_WIDEST * prior.sd[i], high[i], -low[i])
            grid = np.linspace(-reach, reach, 2 * int(np.ceil(reach / _STEP)) + 1)
            points = np.tile(tolerant, (grid.size, 1))
            points[:, i] = grid
            tolerant[i] = grid[np.argmax(log_posterior(points))]
    found = np.array(theta)
    found[columns] = tolerant[columns]
    return found
