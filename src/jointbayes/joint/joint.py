"""Where joints act: DOFs of the structure, against others or ground."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.joint.quantities import DIRECTIONS, is_rotation
from vibrecords.arrays import Array, Indices, convert_fields
from vibrecords.labels import direction_of

_Vector = tuple[float, float, float]

_SAME_PLACE = 1e-6  # m
_NOWHERE = (0.0, 0.0, 0.0)
_ORTHONORMAL = 1e-6


class LabelledDofs(Protocol):
    """Anything that has DOFs with labels: a structure.

    Where its DOFs lie it may say by a method ``position(label)`` that gives x, y and z in m, or None.
    """

    @property
    def n_dofs(self) -> int:
        """Number of DOFs."""

    def index(self, labels: Sequence[str]) -> Indices:
        """Row numbers of DOF labels, shape (len(labels),)."""


@dataclass(frozen=True, slots=True)
class Joint:
    """Where a joint acts.

    Parameters
    ----------
    dofs
        Labels of the r DOFs on the structure's side, all of one point, e.g. ``("1:y", "1:rz")``; in the joint's own
        axes if it has any.
    against
        Labels of the r DOFs on the other side, of one point and in the same directions; empty means ground.
    name
        What its quantities are prefixed with: ``"clamp"`` for ``clamp.k11``; none by default.
    axes
        The joint's own x, y and z as rows, in the structure's axes; by default these themselves.
    offset_m
        From the DOFs' point to the joint's, in the structure's axes, by a rigid link.
    offset_against_m
        From the other side's point to the joint's.

    Raises
    ------
    ModelError
        If a DOF occurs twice, a side has DOFs of several points, the two sides differ in number or directions, or the
        axes are not at right angles to each other, or left-handed.
    """

    dofs: tuple[str, ...]
    against: tuple[str, ...] = ()
    name: str = ""
    axes: tuple[_Vector, _Vector, _Vector] | None = None
    offset_m: _Vector | None = None
    offset_against_m: _Vector | None = None

    def __post_init__(self) -> None:
        for labels in (self.dofs, self.against):
            if isinstance(labels, str):
                found = f'found the text "{labels}"'
                raise ModelError.of(f"{self._where}", (), found, "DOF labels in a tuple", f'write ("{labels}",)')
        convert_fields(self, tuple, "dofs", "against")
        both = self.dofs + self.against
        if not self.dofs or len(set(both)) != len(both):
            key = "dofs" if len(set(self.dofs)) < max(len(self.dofs), 1) else "against"
            found = f"found DOFs {', '.join(both) or 'of no name'}"
            raise self._error((key,), found, "one or more, each once", "correct the labels")
        if self.against and len(self.against) != len(self.dofs):
            found = f"found {len(self.dofs)} DOFs against {len(self.against)}"
            expected = "as many on both sides, or none (ground) on the other"
            raise self._error(("against",), found, expected, "correct the labels")
        for key, labels in (("dofs", self.dofs), ("against", self.against)):
            points = [label.rpartition(":")[0] for label in labels]
            other = next((i for i, point in enumerate(points) if point != points[0]), None)
            if other is not None:
                expected = f"DOFs of one point on each side, {points[0]}"
                found, remedy = f"found {labels[other]} beside {labels[0]}", "make it several joints, each with a name"
                raise self._error((key, other), found, expected, remedy)
        for i, (near, far) in enumerate(zip(self.dofs, self.against, strict=False)):
            if ":" in near and ":" in far and direction_of(near) != direction_of(far):
                expected = f"the same direction on both sides, {direction_of(near)}, in the same order"
                raise self._error(("against", i), f"found {far} against {near}", expected, "correct the labels")
        if self.axes is not None:
            turn = np.asarray(self.axes, dtype=float)
            if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), atol=_ORTHONORMAL):
                expected = "three unit vectors at right angles to each other, one a row"
                raise self._error(("axes",), f"found axes {self.axes}", expected, "correct them")
            if np.linalg.det(turn) < 0:
                found = f"found left-handed axes {self.axes}"
                raise self._error(("axes",), found, "z = x × y", "turn one of them round")
            object.__setattr__(self, "axes", tuple(map(tuple, turn.tolist())))
        for side in ("offset_m", "offset_against_m"):
            offset = getattr(self, side)
            if offset is None:
                continue
            if np.shape(offset) != (3,) or not np.isfinite(offset).all():
                raise self._error((side,), f"found {side} {offset}", "x, y and z in m", "correct it")
            object.__setattr__(self, side, tuple(map(float, offset)))

    def _error(self, key: tuple[str | int, ...], found: str, expected: str, remedy: str) -> ModelError:
        return ModelError.of(self._where, key, found, expected, remedy)

    def __str__(self) -> str:
        other_side = ", ".join(self.against) or "ground"
        return f"{self.name + ': ' if self.name else ''}{', '.join(self.dofs)} to {other_side}"

    @property
    def _where(self) -> str:
        return f"joint {self.name}" if self.name else "joint"

    @property
    def joints(self) -> "tuple[Joint, ...]":
        """Itself, as `Joints` have several."""
        return (self,)

    @property
    def size(self) -> int:
        """Number r of its DOFs, rows of its K^J."""
        return len(self.dofs)

    @property
    def directions(self) -> tuple[str, ...]:
        """Directions of its DOFs: ``("y", "rz")``."""
        return tuple(map(direction_of, self.dofs))

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of all DOFs of the structure that it moves with, those of its own side first."""
        sides = (self._motions(self.dofs, self.offset_m), self._motions(self.against, self.offset_against_m))
        return tuple(dict.fromkeys(label for side in sides for motion in side for label in motion))

    def deformations(self, labels: Sequence[str]) -> Array:
        """Matrix B, shape (len(labels), r), of the joint's deformation Bᵀx by the motion x of `labels`."""
        selection = np.zeros((len(labels), self.size))
        row = {label: i for i, label in enumerate(labels)}
        for sign, dofs, offset in ((1.0, self.dofs, self.offset_m), (-1.0, self.against, self.offset_against_m)):
            for column, motion in enumerate(self._motions(dofs, offset)):
                for label, share in motion.items():
                    selection[row[label], column] += sign * share
        return selection

    def selection(self, structure: LabelledDofs) -> Array:
        """Matrix B, shape (n, r), so that Bᵀx is the joint's deformation and B K^J Bᵀ its stiffness.

        Raises
        ------
        ModelError
            If a DOF does not exist in the structure, or the two sides of the joint do not meet.
        """
        self.require_one_place(getattr(structure, "position", lambda _: None))
        selection = np.zeros((structure.n_dofs, self.size))
        selection[structure.index(self.labels)] = self.deformations(self.labels)
        return selection

    def _motions(self, dofs: tuple[str, ...], offset: _Vector | None) -> list[dict[str, float]]:
        """Each motion of the joint on one side as a sum of DOFs of the structure."""
        if self.axes is None and offset is None:
            return [{label: 1.0} for label in dofs]
        turn, motions = np.eye(3) if self.axes is None else np.array(self.axes), []
        for label in dofs:
            node, _, direction = label.rpartition(":")
            if not node or direction not in DIRECTIONS:
                found = f"found DOF {label!r} of a joint with own axes or an offset"
                expected = f"a label such as '3:y' that ends with one of {', '.join(DIRECTIONS)}"
                raise self._error((), found, expected, "correct it")
            along = turn["xyz".index(direction[-1])]
            if is_rotation(direction):
                shares = dict(zip(DIRECTIONS[3:], along.tolist(), strict=True))
            else:
                # u + θ × a, so that along · (θ × a) = (a × along) · θ
                turned = np.cross(offset or _NOWHERE, along)
                shares = dict(zip(DIRECTIONS, [*along.tolist(), *turned.tolist()], strict=True))
            motions.append({f"{node}:{name}": share for name, share in shares.items() if share})
        return motions

    def require_one_place(self, position: Callable[[str], Sequence[float] | None]) -> None:
        """Refuse sides that do not meet.

        Parameters
        ----------
        position
            Gives x, y and z of a DOF's label in m; None where they are not known.

        Raises
        ------
        ModelError
            If the sides lie at different places, offsets counted in.
        """
        for near, far in zip(self.dofs, self.against, strict=False):  # none against ground
            here, there = position(near), position(far)
            if here is None or there is None:
                continue
            gap = np.subtract(there, here) + np.subtract(self.offset_against_m or _NOWHERE, self.offset_m or _NOWHERE)
            if np.abs(gap).max() > _SAME_PLACE:
                apart = ", ".join(f"{1e3 * component:g}" for component in gap)
                found, expected = f"found {near} and {far} at different places", "both sides of a joint at one place"
                remedy = f"add the way between them to its offset: offset_mm = [{apart}]"
                raise self._error(("against",), f"{found}, ({apart}) mm apart", expected, remedy)


@dataclass(frozen=True, slots=True)
class Joints:
    """Several joints, side by side; none of a structure that is joined to nothing.

    Parameters
    ----------
    joints
        In order.

    Raises
    ------
    ModelError
        If one of several has no name, or the name of another.
    """

    joints: tuple[Joint, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", tuple(self.joints))
        names = [joint.name for joint in self.joints]
        if len(set(names)) != len(names) or (len(names) > 1 and "" in names):
            found = f"found names {', '.join(map(repr, names))}"
            raise ModelError.of("joints", (), found, "a name of its own for each", "name them")

    def __str__(self) -> str:
        return "; ".join(map(str, self.joints)) or "none"

    @property
    def size(self) -> int:
        """Number R of DOFs of all joints, rows of K^J."""
        return sum(joint.size for joint in self.joints)

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of all DOFs of the structure that they move with."""
        return tuple(dict.fromkeys(label for joint in self.joints for label in joint.labels))

    def deformations(self, labels: Sequence[str]) -> Array:
        """Matrix B, shape (len(labels), R), of all deformations Bᵀx by the motion x of `labels`."""
        whole = np.zeros((len(labels), self.size))
        row, column = {label: i for i, label in enumerate(labels)}, 0
        for joint in self.joints:
            rows = [row[label] for label in joint.labels]
            whole[rows, column : column + joint.size] = joint.deformations(joint.labels)
            column += joint.size
        return whole

    def require_one_place(self, position: Callable[[str], Sequence[float] | None]) -> None:
        """Refuse joints whose sides do not meet."""
        for joint in self.joints:
            joint.require_one_place(position)

    def selection(self, structure: LabelledDofs) -> Array:
        """Matrix B, shape (n, R), so that Bᵀx is the deformation of all joints and B K^J Bᵀ their stiffness."""
        return np.hstack([np.empty((structure.n_dofs, 0)), *(joint.selection(structure) for joint in self.joints)])


#: One joint, or several side by side: whoever asks for joints, DOFs, size or selection need not know which.
AnyJoint = Joint | Joints


def joints_of(given: AnyJoint | Iterable[Joint] | Sequence[str]) -> AnyJoint:
    """A joint or several as they are given, several in a sequence, or one to ground by the labels of its DOFs."""
    if isinstance(given, Joint | Joints):
        return given
    each: tuple[Any, ...] = (given,) if isinstance(given, str) else tuple(given)
    return Joint(each) if each and all(isinstance(label, str) for label in each) else Joints(each)
