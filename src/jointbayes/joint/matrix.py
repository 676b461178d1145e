"""The matrix K^J of a joint: made of its stiffnesses, changed, and positive semidefinite.

References
----------
Cao, H., Li, B., He, Z. A joint stiffness identification method based on finite element modeling and
frequency response functions, section 3 (K^J with k11, k12, k22 at one translation and one rotation).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError, array_of

__all__ = [
    "STIFFNESS_PATTERN",
    "check_positive_semidefinite",
    "is_positive_semidefinite",
    "joint_matrix",
    "symmetric_changes",
]

Array = NDArray[np.float64]


#: ∂K^J/∂(k11, k12, k22), the paper's K_i, shape (3, 2, 2).
STIFFNESS_PATTERN = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]])
STIFFNESS_PATTERN.setflags(write=False)


def joint_matrix(stiffness: ArrayLike) -> Array:
    """K^J, shape (..., 2, 2), from (k11, k12, k22), shape (..., 3).

    Examples
    --------
    >>> joint_matrix([3.0, 1.0, 2.0]).tolist()
    [[3.0, 1.0], [1.0, 2.0]]
    """
    k = np.asarray(stiffness, dtype=float)
    return k[..., [0, 1, 1, 2]].reshape(*k.shape[:-1], 2, 2)


def symmetric_changes(r: int) -> Array:
    """Symmetric change dK^J for each entry in turn, shape (r², r, r): one on the diagonal, two halves off it."""
    unit = np.eye(r * r).reshape(-1, r, r)
    return (unit + unit.swapaxes(1, 2)) / 2


_MOST = 1e150  # of a stiffness: its square stays finite


def is_positive_semidefinite(stiffness: ArrayLike) -> NDArray[np.bool_]:
    """Whether a joint (k11, k12, k22), shape (..., 3), is positive semidefinite, shape (...)."""
    k11, k12, k22 = np.moveaxis(np.asarray(stiffness, dtype=float), -1, 0)
    return (k11 >= 0) & (k22 >= 0) & (k12**2 <= k11 * k22)


def check_positive_semidefinite(stiffness: ArrayLike) -> None:
    """Refuse a joint that could give off energy.

    Parameters
    ----------
    stiffness
        (k11, k12, k22), shape (3,).

    Raises
    ------
    ModelError
        If a number is not finite, k11 or k22 is negative, or k12² > k11 k22.
    """
    given = array_of(stiffness, float, "joint", ModelError)
    if given.shape != (3,):
        raise ModelError(f"joint: found stiffnesses of shape {given.shape}; expected k11, k12 and k22: shape (3,)")
    k11, k12, k22 = given.tolist()
    if not (np.abs([k11, k12, k22]) < _MOST).all():
        raise ModelError(f"joint: found k11 = {k11:g}, k12 = {k12:g}, k22 = {k22:g}; expected finite numbers")
    if not is_positive_semidefinite(stiffness):
        raise ModelError(
            f"joint: found k11 = {k11:g} N/m, k12 = {k12:g} N, k22 = {k22:g} N·m/rad; expected a positive "
            f"semidefinite matrix (k11 >= 0, k22 >= 0, k12² <= k11·k22 = {k11 * k22:g}); lower |k12| or raise k11, k22"
        )
