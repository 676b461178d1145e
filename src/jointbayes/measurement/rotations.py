"""Rotations from translations at neighbouring stations, each measurement counted once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet
from jointbayes.frf.rotation import DifferenceScheme, Transform, rotation_from_translations

__all__ = ["Rotation", "at_joint", "with_rotations"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Rotation:
    """A rotation by differences of translations.

    Parameters
    ----------
    dof
        Label of the rotation, ``"1:rz"``.
    stations
        Translational DOFs in order along the structure: two for ``"first order"``, else three.
    spacing
        Distance of neighbouring stations along the positive axis, m.
    scheme
        See `jointbayes.frf.rotation.rotation_from_translations`.
    in_likelihood
        Whether the rotation, not its stations, is what the likelihood sees.
    """

    dof: str
    stations: tuple[str, ...]
    spacing: float
    scheme: DifferenceScheme
    in_likelihood: bool = False

    @property
    def transform(self) -> Transform:
        """From the stations to the rotation alone."""
        both = rotation_from_translations(self.stations, self.spacing, self.scheme, self.dof)
        return Transform(both.since, (self.dof,), both.matrix[1:])

    def of(self, frf: FrfSet) -> FrfSet:
        """FRFs of the rotation from those of its stations."""
        transform = self.transform
        chosen = frf.select(self.stations, frf.inputs)
        return replace(chosen, values=transform.matrix @ chosen.values, outputs=(self.dof,), coherence=None)


def with_rotations(frf: FrfSet, variance: Array, rotations: Sequence[Rotation]) -> tuple[FrfSet, Array]:
    """Rotations in the place of their stations, with variances T Σ Tᵀ: what a likelihood of independent errors may see.

    A station that a rotation was made from is taken out, because its error is also that of the rotation: counted
    side by side the two would be one measurement counted twice. A station of weight 0 stays.

    Parameters
    ----------
    frf, variance
        Measured FRFs and σ², shape (lines, outputs, inputs); errors of different FRFs independent.
    rotations
        Those whose `in_likelihood` is not set are left alone.

    Raises
    ------
    MeasurementError
        If a station was not measured, two rotations share one, or the rotation itself was measured.
    """
    used: dict[str, str] = {}
    outputs, values, variances = list(frf.outputs), [], []
    for rotation in (r for r in rotations if r.in_likelihood):
        _require(frf, rotation)
        weights = rotation.transform.matrix[0]
        for station in (s for s, w in zip(rotation.stations, weights, strict=True) if w != 0):
            if station in used:
                raise MeasurementError(
                    f"rotation {rotation.dof}: found station {station} in {used[station]} as well; expected each "
                    "station once in the likelihood, since rotations from one station are not independent; leave the "
                    "stations themselves in the likelihood instead (in_likelihood = false)"
                )
            used[station] = rotation.dof
        rows = [frf.outputs.index(s) for s in rotation.stations]
        values.append(rotation.of(frf).values)
        variances.append(np.einsum("s,lsi->li", weights**2, variance[:, rows])[:, None])
    kept = [i for i, output in enumerate(outputs) if output not in used]
    labels = (*(outputs[i] for i in kept), *(r.dof for r in rotations if r.in_likelihood))
    if not used:
        return frf, variance
    moved = replace(frf, values=np.concatenate([frf.values[:, kept], *values], axis=1), outputs=labels, coherence=None)
    return moved, np.concatenate([variance[:, kept], *variances], axis=1)


def at_joint(
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
            columns.append(by_dof[dof].of(frf).values)
        else:
            remedy = f'state its stations in [data.rotations."{dof}"]' if ":r" in dof else "measure it"
            raise MeasurementError(
                f"paper's iteration: found no FRF of {dof}, a DOF of the joint; expected the motion of the joint "
                f"itself under every force; {remedy}"
            )
    return replace(frf, values=np.concatenate(columns, axis=1), outputs=wanted, coherence=None)


def _require(frf: FrfSet, rotation: Rotation) -> None:
    if rotation.dof in frf.outputs:
        raise MeasurementError(
            f"rotation {rotation.dof}: found it among the measured DOFs; expected it from stations or from a sensor of "
            "its own, not from both; remove one of the two"
        )
    for station in rotation.stations:
        if station not in frf.outputs:
            raise MeasurementError(
                f"rotation {rotation.dof}: found no FRF of station {station}; expected one of "
                f"{', '.join(frf.outputs)}; map its channel or correct the station"
            )
