"""Whether a symmetric matrix has a negative eigenvalue, whatever the units of its rows."""

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import ModelError

NOT_NEGATIVE = 1e-9  # part of the largest eigenvalue of a scaled matrix that rounding may leave below zero


def lowest_eigenvalue(matrix: Array, where: str) -> float:
    """Lowest eigenvalue of a symmetric matrix with its diagonal scaled to 1.

    Raises
    ------
    ModelError
        If entries are too far apart to be scaled; `where` begins the message.
    """
    diagonal = np.diag(matrix)
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    with np.errstate(all="ignore"):  # numbers at the ends of double precision
        scaled = matrix / np.outer(scale, scale)
    if not np.isfinite(scaled).all():
        raise ModelError(f"{where} whose entries are too far apart; expected one machine's; correct its units")
    return float(np.linalg.eigvalsh(scaled).min()) if scaled.size else 0.0
