"""Where a structure is excited, observed and joined."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError, shown
from jointbayes.joint import AnyJoint
from jointbayes.joint.joint import LabelledDofs
from vibrecords.arrays import Array, Indices
from vibrecords.errors import array_of


@dataclass(frozen=True, slots=True)
class Ports:
    """Frequency lines and DOFs between which receptances are wanted.

    Parameters
    ----------
    frequency_hz
        Frequency lines, shape (lines,), Hz.
    outputs, inputs
        DOF labels of responses and of excitations.

    Raises
    ------
    ModelError
        If lines are no numbers, or labels no sequence of texts.
    """

    frequency_hz: Array
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]

    def __post_init__(self) -> None:
        lines = array_of(self.frequency_hz, float, "ports: lines in Hz", ModelError)
        object.__setattr__(self, "frequency_hz", np.atleast_1d(lines))
        for what, labels in (("outputs", self.outputs), ("inputs", self.inputs)):
            expected = 'labels of DOFs in a sequence, such as ("11:y",); correct it'
            if not isinstance(labels, tuple | list) or not all(isinstance(label, str) for label in labels):
                raise ModelError.of("ports", (), f"found as {what} {shown(labels)}", f"{expected}")

    @property
    def omega(self) -> Array:
        """ω = 2πf, shape (lines,), rad/s."""
        return 2 * np.pi * np.asarray(self.frequency_hz, dtype=float)


@dataclass(frozen=True, slots=True, eq=False)
class TakingPart:
    """The DOFs of a body that take part: those that a joint moves with, and others where something acts or is seen.

    Motion of the joint itself vanishes as the joint becomes rigid. Computed as a difference of large numbers it
    would be rounding error; with its part along the joint kept apart it is not.

    Parameters
    ----------
    dofs
        Their indices, rising, shape (p,).
    joined
        The joint's motions as forms on them, shape (p, r).
    along, rest
        The q other motions as a sum joined @ along + rest, shapes (r, q) and (p, q).
    """

    dofs: Indices
    joined: Array
    along: Array
    rest: Array

    @classmethod
    def of(
        cls, body: LabelledDofs, joint: AnyJoint, labels: Sequence[str] = (), forms: tuple[Indices, Array] | None = None
    ) -> "TakingPart":
        """Of a joint, motions of labelled DOFs, and further ones as forms (p, d) on DOFs (p,).

        Raises
        ------
        ModelError
            If a DOF does not exist in the body, or the two sides of the joint do not meet.
        """
        joined = joint.selection(body)
        at = body.index(labels)
        on, further = (np.empty(0, dtype=np.intp), np.empty((0, 0))) if forms is None else forms
        dofs = np.unique(np.concatenate([np.flatnonzero(joined.any(axis=1)), at, on]))
        motions = np.zeros((len(dofs), len(at) + further.shape[1]))
        motions[np.searchsorted(dofs, at), np.arange(len(at))] = 1.0
        motions[np.searchsorted(dofs, on), len(at) :] = further
        along = np.asarray(np.linalg.pinv(joined)[:, dofs] @ motions)
        return cls(dofs, joined[dofs], along, motions - joined[dofs] @ along)


def stiffness_batch(stiffness: ArrayLike) -> Array:
    """Stiffness matrices with a leading batch axis, shape (batch, r, r)."""
    matrices = np.asarray(stiffness, dtype=float)
    return matrices[None] if matrices.ndim == 2 else matrices


def factors_batch(factors: ArrayLike | None, batch: int) -> Array:
    """Factors on a structure's uncertain quantities for each of a batch, shape (batch, q); (batch, 0) without any."""
    if factors is None:
        return np.empty((batch, 0))
    rows = np.atleast_2d(np.asarray(factors, dtype=float))
    return rows if len(rows) == batch else np.repeat(rows, batch, axis=0)
