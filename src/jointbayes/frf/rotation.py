"""Rotational FRFs from translational ones by finite differences, with their covariance.

References
----------
Duarte, M. L. M., Ewins, D. J. (2000). Rotational degrees of freedom for structural coupling analysis via
finite-difference technique with residual compensation. Mechanical Systems and Signal Processing 14(2),
205-227. DOI 10.1006/mssp.1999.1241
Schmitz, T. L., Smith, K. S. (2012). Mechanical Vibrations. Springer. DOI 10.1007/978-1-4614-0460-6
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import MeasurementError
from jointbayes.frf.frf_set import FrfSet

__all__ = ["DifferenceScheme", "Transform", "rotation_from_translations", "transform_frf"]

DifferenceScheme = Literal["first order", "second order, end", "second order, centre"]

# weights over the stations, times the station spacing s; and the station whose motion is kept as translation
_SCHEMES: dict[str, tuple[tuple[float, ...], int]] = {
    "first order": ((-1.0, 1.0), 0),
    "second order, end": ((-1.5, 2.0, -0.5), 0),
    "second order, centre": ((-0.5, 0.0, 0.5), 1),
}


@dataclass(frozen=True, slots=True)
class Transform:
    """Linear map T from measured DOFs to new ones: rows `to`, columns `since`."""

    since: tuple[str, ...]
    to: tuple[str, ...]
    matrix: NDArray[np.float64]


def rotation_from_translations(
    stations: tuple[str, ...], spacing: float, scheme: DifferenceScheme, rotation: str
) -> Transform:
    """Difference scheme that gives a translation and the rotation at the same point.

    Parameters
    ----------
    stations
        Translational DOF labels in order along the structure: two for ``"first order"``, else three.
    spacing
        Distance s between neighbouring stations along the positive axis, m (negative where the stations run
        backwards, as at the far end of a beam).
    scheme
        ``"first order"`` (x1 − x0)/s at x0, ``"second order, end"`` (−3x0 + 4x1 − x2)/2s at x0, or
        ``"second order, centre"`` (x2 − x0)/2s at x1.
    rotation
        Label of the rotation that results, e.g. ``"11:rz"``.

    Returns
    -------
    Transform
        From the stations to (translation, rotation).

    Raises
    ------
    MeasurementError
        If the number of stations does not fit the scheme or the spacing is zero.

    Notes
    -----
    For equal independent errors σ at the stations the rotation's error is √2 σ/s, √26 σ/2s and σ/(√2 s). At a
    free end, where curvature and its slope vanish, first order has *less* bias than second order.
    """
    if scheme not in _SCHEMES:
        raise MeasurementError(f"rotation: found scheme {scheme!r}; expected one of {', '.join(_SCHEMES)}")
    weights, at = _SCHEMES[scheme]
    if len(stations) != len(weights) or not np.isfinite(spacing) or spacing == 0.0:
        raise MeasurementError(
            f"rotation: found {len(stations)} stations {spacing:g} m apart; expected {len(weights)} stations a "
            f"non-zero distance apart for scheme {scheme!r}; correct the stations or the scheme"
        )
    keep = np.eye(len(weights))[at]
    return Transform(stations, (stations[at], rotation), np.array([keep, np.array(weights) / spacing]))


def transform_frf(
    frf: FrfSet,
    covariance: NDArray[np.complex128],
    outputs: Transform | None = None,
    inputs: Transform | None = None,
) -> tuple[FrfSet, NDArray[np.complex128]]:
    """FRFs H' = T H Uᵀ at transformed DOFs, and their covariance.

    Parameters
    ----------
    frf
        Measured FRFs; its outputs (inputs) must be the transform's `since` where one is given.
    covariance
        Covariance of the FRFs at each line with pairs in row-major order, shape (lines, outputs·inputs,
        outputs·inputs); for independent errors a diagonal of σ².
    outputs, inputs
        Transforms T and U; None keeps the DOFs.

    Returns
    -------
    frf : FrfSet
        Without coherence, which does not survive a linear combination.
    covariance : ndarray, shape (lines, new pairs, new pairs)
        (T ⊗ U) Σ (T ⊗ U)ᴴ.

    Raises
    ------
    MeasurementError
        If labels or shapes do not fit.

    Notes
    -----
    FRFs derived from the same stations are correlated: the off-diagonal terms matter, and a rotation derived
    from translations adds no independent data.
    """
    t = _matrix(outputs, frf.outputs)
    u = _matrix(inputs, frf.inputs)
    pairs = len(frf.outputs) * len(frf.inputs)
    if covariance.shape != (frf.n_lines, pairs, pairs):
        raise MeasurementError(
            f"rotation: found a covariance of shape {covariance.shape}; expected {(frf.n_lines, pairs, pairs)}"
        )
    both = np.kron(t, u)
    moved = replace(
        frf,
        values=t @ frf.values @ u.T,
        outputs=outputs.to if outputs else frf.outputs,
        inputs=inputs.to if inputs else frf.inputs,
        coherence=None,
    )
    return moved, both @ covariance @ both.T


def _matrix(transform: Transform | None, labels: tuple[str, ...]) -> NDArray[np.float64]:
    if transform is None:
        return np.eye(len(labels))
    if transform.since != labels:
        raise MeasurementError(f"rotation: found DOFs {labels}; expected {transform.since}; select them first")
    return transform.matrix
