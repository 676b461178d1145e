"""Virtual points: the DOFs of a rigid face from the sensors on it, by least squares.

Each sensor of a face that is rigid measures d·(t + θ × r), with its direction d, its place r relative to the point, and
the point's translation t and rotation θ. So u = R q, with a row (d, r × d) for each sensor, and q = R⁺u. What R q does
not explain of u checks that the face is rigid and that each sensor is where, and points as, it is said. Hits on the
face become forces and moments at the point in the same way.

References
----------
van der Seijs, M. V., van den Bosch, D. D., Rixen, D. J., de Klerk, D. (2013). An improved methodology for the virtual
point transformation of measured frequency response functions in dynamic substructuring. COMPDYN 2013, 4334-4347.
Allen, M. S., Rixen, D., van der Seijs, M., Tiso, P., Abrahamsson, T., Mayes, R. L. (2020). Substructuring in
Engineering Dynamics. Springer. DOI 10.1007/978-3-030-25532-9
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrecords.arrays import Array
from vibrecords.data import FrfData
from vibrecords.errors import MeasurementError
from vibrecords.provenance import MeasurementWarning
from vibrecords.warnings.kinds import warn

SIX = ("x", "y", "z", "rx", "ry", "rz")
_ROUNDING = 1e-6  # of a unit motion: what sensors do not see, and what they leave over
_LARGE, _NOISE = 0.1, 3.0  # a residual is large above this fraction of the motion and so many times its own noise
_FEW_LINES = 0.05  # fraction of the lines on which a residual may be large without a warning
_TURNED = 0.3  # a sensor points the other way if turning its sign leaves less than this of the residual

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class VirtualPoint:
    """A point of a rigid face.

    Parameters
    ----------
    name
        Label of the point: its DOFs are ``"11:x"`` and so on.
    dofs
        Those of ``"x"``, ``"y"``, ``"z"``, ``"rx"``, ``"ry"``, ``"rz"`` that are wanted.
    place
        Where the point is, m.
    sensors
        Place, m, and direction, of any length, of each sensor or hit, by the label that its channel is mapped to.
    """

    name: str
    dofs: tuple[str, ...]
    place: Vector
    sensors: Mapping[str, tuple[Vector, Vector]]

    def motions(self, labels: Sequence[str]) -> Array:
        """R: what each of these sensors measures of unit translations, m, and rotations, rad; shape (labels, 6)."""
        places, directions = (np.array(rows) for rows in zip(*(self.sensors[label] for label in labels), strict=True))
        directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return np.hstack([directions, np.cross(places - np.array(self.place), directions)])

    def weights(self, labels: Sequence[str], what: str) -> tuple[Array, Array]:
        """Weights of sensors in each wanted DOF, shape (dofs, labels), and P = R R⁺, shape (labels, labels).

        Raises
        ------
        MeasurementError
            If these sensors do not see a DOF that is wanted, naming all that they do see.
        """
        motions = self.motions(labels)
        size = np.abs(motions[:, 3:]).max() or 1.0  # in rotations by a unit at the edge of the face, to tell rank
        scale = np.array([1.0] * 3 + [1 / size] * 3)
        _, share, modes = np.linalg.svd(motions * scale)
        seen = modes[: int((share > _ROUNDING * share[0]).sum())]
        unseen = np.linalg.norm(np.eye(6) - seen.T @ seen, axis=0) > _ROUNDING
        if lacking := [dof for dof in self.dofs if unseen[SIX.index(dof)]]:
            found = (
                f"found {len(labels)} {what}, {len(seen)} of them independent, which do not see {', '.join(lacking)}"
            )
            several = [dof for dof, not_seen in zip(SIX, unseen, strict=True) if not not_seen]
            remedy = f"add {what} elsewhere on the face, or ask for fewer dofs"
            key = ("virtual_points", self.name, "dofs")
            raise MeasurementError.of("virtual point", key, found, f"some of {', '.join(several) or 'none'}", remedy)
        inverse = scale[:, None] * np.linalg.pinv(motions * scale, rcond=_ROUNDING)
        return inverse[[SIX.index(dof) for dof in self.dofs]], motions @ inverse


def at_virtual_points(
    measured: FrfData, points: Sequence[VirtualPoint]
) -> tuple[FrfData, tuple[MeasurementWarning, ...], tuple[str, ...]]:
    """FRFs with the DOFs of virtual points in place of their sensors and hits; warnings; notes.

    Variances are those of T u, without the covariances between DOFs of one point.

    Raises
    ------
    MeasurementError
        If a point has no sensor among the outputs, its sensors do not see a DOF that is wanted, or that was measured.
    """
    warnings, notes = [], []
    for point in points:
        for side, what in (("outputs", "sensors"), ("inputs", "hits")):
            frf, axis = measured.frf, 1 if side == "outputs" else 2
            labels: tuple[str, ...] = getattr(frf, side)
            rows = [i for i, label in enumerate(labels) if label in point.sensors]
            if not rows and side == "inputs":  # the face itself was not hit
                continue
            made, own = tuple(f"{point.name}:{dof}" for dof in point.dofs), [labels[i] for i in rows]
            twice = [dof for dof in made if dof in labels]
            if twice or not rows:
                found = f"found {twice[0]} measured" if twice else "found no FRF of its sensors"
                key, expected = ("virtual_points", point.name), "it from the sensors of the face alone"
                raise MeasurementError.of("virtual point", key, found, expected, "correct [data.channels]")
            # 1. the DOFs in place of the sensors, all else as it is
            weights, explained = point.weights(own, what)
            kept = [i for i in range(len(labels)) if i not in rows]
            values, variance = (np.moveaxis(array, axis, -1) for array in (frf.values, measured.variance))
            u, noise = values[..., rows], variance[..., rows]
            joined = np.concatenate([values[..., kept], u @ weights.T], axis=-1)
            spread = np.concatenate([variance[..., kept], noise @ (weights**2).T], axis=-1)
            now = (*(labels[i] for i in kept), *made)
            outputs, inputs = (now, frf.inputs) if axis == 1 else (frf.outputs, now)
            moved = replace(frf, values=np.moveaxis(joined, -1, axis), outputs=outputs, inputs=inputs, coherence=None)
            measured = replace(measured, frf=moved, variance=np.moveaxis(spread, -1, axis))
            # 2. what is left over of the motion of the sensors, on each line
            left = np.eye(len(own)) - explained
            where = f"virtual point {point.name}"
            if np.trace(left) < _ROUNDING:
                notes.append(f"The {what} at {where} are as many as their motions: nothing checks that it is rigid.")
                continue
            rest, size = (np.sqrt((np.abs(a) ** 2).sum(axis=(1, 2))) for a in (u @ left, u))
            by_noise = np.sqrt((noise @ (left**2).T).sum(axis=(1, 2)))
            large = (rest > _LARGE * size) & (rest > _NOISE * by_noise)
            share = 100 * float(np.sqrt((rest**2).sum() / (size**2).sum()))
            notes.append(f"The rigid motion of {where} leaves {share:.2g} % of what its {len(own)} {what} measured.")
            if large.mean() <= _FEW_LINES:
                continue
            # 3. the one to blame: without it the residual falls most
            free = np.diagonal(left) > _ROUNDING
            fall = (np.abs(u @ left) ** 2).sum(axis=(0, 1))[free] / np.diagonal(left)[free]
            worst = int(np.flatnonzero(free)[fall.argmax()])
            sign = np.where(np.arange(len(own)) == worst, -1.0, 1.0)
            turned = np.linalg.norm((u * sign) @ left) < _TURNED * np.linalg.norm(u @ left)
            first, count, sensor, most = frf.frequency_hz[large][0], large.sum(), own[worst], 100 * _LARGE
            warning = warn(
                "virtual_point_turned" if turned else "virtual_point",
                percent=most,
                count=count,
                all=large.size,
                first=first,
                sensor=sensor,
            )
            warnings.append(replace(warning, key="virtual_point", where=where))
    return measured, tuple(warnings), tuple(notes)
