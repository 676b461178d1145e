"""Rotations from translations at neighbouring stations, each measurement counted once.

References
----------
Duarte, M. L. M., Ewins, D. J. (2000). Rotational degrees of freedom for structural coupling analysis via
finite-difference technique with residual compensation. Mechanical Systems and Signal Processing 14(2),
205-227. DOI 10.1006/mssp.1999.1241
Schmitz, T. L., Smith, K. S. (2012). Mechanical Vibrations. Springer. DOI 10.1007/978-1-4614-0460-6
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vibrecords.arrays import Array
from vibrecords.data import FrfData
from vibrecords.errors import MeasurementError, refusal, require_one_of
from vibrecords.frf_set import FrfSet
from vibrecords.labels import direction_of, rotation_sign

DifferenceScheme = Literal["first order", "second order, end", "second order, centre"]

#: Weights over the stations, times the station spacing.
_SCHEMES: dict[str, tuple[float, ...]] = {
    "first order": (-1.0, 1.0),
    "second order, end": (-1.5, 2.0, -0.5),
    "second order, centre": (-0.5, 0.0, 0.5),
}


@dataclass(frozen=True, slots=True)
class Rotation:
    """A rotation by differences of translations.

    Parameters
    ----------
    dof
        Label of the rotation, ``"1:rz"``.
    stations
        Translational DOFs in order along the structure, in one direction: two for ``"first order"``, else three.
    spacing
        Distance s of neighbouring stations along the positive axis, m; negative where the stations run backwards, as at
        the far end of a beam.
    scheme
        ``"first order"`` (x1 − x0)/s at x0, ``"second order, end"`` (−3x0 + 4x1 − x2)/2s at x0, or
        ``"second order, centre"`` (x2 − x0)/2s at x1.
    in_likelihood
        Whether the rotation, not its stations, is what the likelihood sees.
    axis
        Axis along which the stations lie, ``"x"``, ``"y"`` or ``"z"``: it is its positive direction that the spacing
        counts in.

    Raises
    ------
    MeasurementError
        If the number of stations does not fit the scheme, the spacing is zero, or the rotation does not move points of
        the axis in the direction of the stations.

    Notes
    -----
    For equal independent errors σ at the stations the rotation's error is √2 σ/s, √26 σ/2s and σ/(√2 s). At a
    free end, where curvature and its slope vanish, first order has *less* bias than second order.

    By the right-hand rule a line along x has θz = ∂v/∂x and θy = −∂w/∂x, one along y has θz = −∂u/∂y.
    """

    dof: str
    stations: tuple[str, ...]
    spacing: float
    scheme: DifferenceScheme
    in_likelihood: bool = False
    axis: str = "x"

    def __post_init__(self) -> None:
        require_one_of(_SCHEMES, self.scheme, "rotation", "scheme ")
        count = len(_SCHEMES[self.scheme])
        where = f"rotation {self.dof}"
        if ":r" not in self.dof:
            expected = "a rotation"
            raise MeasurementError.of(where, ("dof",), f'found "{self.dof}"', expected, 'write for example "1:rz"')
        if len(self.stations) != count:
            expected, remedy = f'{count} stations for scheme "{self.scheme}"', "correct the stations or the scheme"
            raise MeasurementError.of(where, ("stations",), f"found {len(self.stations)} stations", expected, remedy)
        if not np.isfinite(self.spacing) or self.spacing == 0.0:
            found = f"found stations {self.spacing:g} m apart"
            raise MeasurementError.of(where, ("spacing",), found, "a distance other than 0", "correct it")
        if not self._sign:
            turn, directions = direction_of(self.dof), dict.fromkeys(map(direction_of, self.stations))
            found = f"found stations along {self.axis} that move in {' and '.join(directions)} for {turn}"
            fitting = next((way for way in "xyz" if rotation_sign(turn, way, self.axis)), "")
            expected = f"all of them in {fitting}" if fitting else "stations along an axis that the rotation turns"
            raise MeasurementError.of(where, ("stations",), found, expected, "correct them, the rotation or the axis")

    @property
    def _sign(self) -> int:
        signs = {rotation_sign(direction_of(self.dof), direction_of(station), self.axis) for station in self.stations}
        return signs.pop() if len(signs) == 1 else 0

    @property
    def weights(self) -> Array:
        """Of the stations' translations, 1/m, shape (stations,)."""
        return self._sign * np.array(_SCHEMES[self.scheme]) / self.spacing

    def compute_frf(self, frf: FrfSet) -> FrfSet:
        """Compute the FRFs of a rotation from the FRFs of its stations."""
        chosen = frf.select(self.stations, frf.inputs)
        return replace(chosen, values=self.weights[None] @ chosen.values, outputs=(self.dof,), coherence=None)


def replace_stations(measured: FrfData, rotations: Sequence[Rotation]) -> FrfData:
    """Rotations in the place of their stations, with variances T Σ Tᵀ: what a likelihood of independent errors may see.

    A station that a rotation was made from is taken out, because its error is also that of the rotation: counted
    side by side the two would be one measurement counted twice. A station of weight 0 stays.

    Parameters
    ----------
    measured
        FRFs whose errors are independent of each other.
    rotations
        Those whose `in_likelihood` is not set are left alone.

    Raises
    ------
    MeasurementError
        If a station was not measured, two rotations share one, or the rotation itself was measured.
    """
    frf, variance = measured.frf, measured.variance
    used: dict[str, str] = {}
    values, variances = [], []
    derived = [rotation for rotation in rotations if rotation.in_likelihood]
    for rotation in derived:
        _require(frf, rotation)
        for station in (s for s, w in zip(rotation.stations, rotation.weights, strict=True) if w != 0):
            if station in used:
                found = f"station {station} in {used[station]} as well"
                expected = "each station once in the likelihood, since rotations from one station are not independent"
                remedy = "leave the stations themselves in the likelihood instead (in_likelihood = false)"
                raise refusal(f"rotation {rotation.dof}", found, expected, remedy)
            used[station] = rotation.dof
        rows = [frf.outputs.index(s) for s in rotation.stations]
        values.append(rotation.compute_frf(frf).values)
        variances.append(np.einsum("s,lsi->li", rotation.weights**2, variance[:, rows])[:, None])
    if not used:
        return measured
    kept = [i for i, output in enumerate(frf.outputs) if output not in used]
    labels = (*(frf.outputs[i] for i in kept), *(rotation.dof for rotation in derived))
    values = [frf.values[:, kept], *values]
    moved = replace(frf, values=np.concatenate(values, axis=1), outputs=labels, coherence=None)
    return replace(measured, frf=moved, variance=np.concatenate([variance[:, kept], *variances], axis=1))


def joint_frf_set(
    frf: FrfSet, rotations: Sequence[Rotation], outputs: tuple[str, ...], joint_dofs: tuple[str, ...]
) -> FrfSet:
    """FRFs at some outputs and at every DOF of the joint, as the paper's iteration takes them.

    Parameters
    ----------
    frf
        All that was measured, stations included.
    rotations
        How rotations follow from stations.
    outputs
        Outputs of the likelihood.
    joint_dofs
        DOFs of the joint, on both of its sides.

    Raises
    ------
    MeasurementError
        If a DOF was neither measured nor follows from stations.
    """
    by_dof = {rotation.dof: rotation for rotation in rotations}
    wanted = tuple(dict.fromkeys(outputs + joint_dofs))
    columns = []
    for dof in wanted:
        if dof in frf.outputs:
            columns.append(frf.select((dof,), frf.inputs).values)
        elif dof in by_dof:
            _require(frf, by_dof[dof])
            columns.append(by_dof[dof].compute_frf(frf).values)
        else:
            found = f"no FRF of {dof}, a DOF of the joint"
            remedy = f'state its stations in [data.rotations."{dof}"]' if ":r" in dof else "measure it"
            raise refusal("paper's iteration", found, "the motion of the joint itself under every force", remedy)
    return replace(frf, values=np.concatenate(columns, axis=1), outputs=wanted, coherence=None)


def _require(frf: FrfSet, rotation: Rotation) -> None:
    if rotation.dof in frf.outputs:
        expected = "it from stations or from a sensor of its own, not from both"
        raise refusal(f"rotation {rotation.dof}", "it among the measured DOFs", expected, "remove one of the two")
    for station in rotation.stations:
        if station not in frf.outputs:
            found, expected = f"no FRF of station {station}", f"one of {', '.join(frf.outputs)}"
            raise refusal(f"rotation {rotation.dof}", found, expected, "map its channel or correct the station")
