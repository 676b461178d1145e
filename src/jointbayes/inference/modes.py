"""What a modal test shows of the assembled structure: its modes, matched with the measured ones, value by value."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from jointbayes.arrays import Array
from jointbayes.frf import AssembledShapes, Modal, NaturalFrequencies, rigid_body_modes
from jointbayes.joint import AnyJoint, AnyJointMatrix
from jointbayes.measurement import ModalMeasurement, ModeMeasurement
from jointbayes.structure import StructureFamily


class ModalModel(Protocol):
    """Predicts the values of a `ModalMeasurement` as a function of K^J."""

    def modal_frequencies(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Natural frequencies of the modes that the measured ones are compared with, shape (batch, n), Hz."""
        ...

    def modal_values(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Predicted values, shape (batch, m), of joint matrices (batch, r, r) and factors (batch, f)."""
        ...

    def modal_tangent(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Predicted values (m,) of one joint and their derivative (p, m) along changes dK^J (p, r, r)."""
        ...


def modal_model(family: StructureFamily, joint: AnyJoint, measurement: ModalMeasurement) -> ModalModel:
    """The model that predicts what was measured.

    Raises
    ------
    ModelError
        If a measured DOF does not exist, or the structure has fewer modes.
    """
    if isinstance(measurement, ModeMeasurement):
        return ModePrediction(family, joint, measurement)
    return NaturalFrequencies(family, joint, measurement.frequency_hz.size)


def mac(measured: Array, predicted: Array) -> Array:
    """Modal assurance criterion of shapes, (n, p) and (..., c, p), shape (..., n, c): 1 where proportional.

    NaN is a component that was not measured; those predicted in its place do not count.

    References
    ----------
    Allemang, R. J. (2003). The modal assurance criterion: twenty years of use and abuse. Sound and Vibration 37(8),
    14-23.
    """
    known, turned = ~np.isnan(measured), np.swapaxes(predicted, -1, -2)
    seen = np.where(known, measured, 0.0)
    size = (seen**2).sum(axis=-1)[:, None] * (known.astype(float) @ turned**2)
    return (seen @ turned) ** 2 / np.maximum(size, np.finfo(float).tiny)


class ModePrediction:
    """Predicts the values of a `ModeMeasurement`.

    Each measured mode is compared with the predicted one of its number; or, matched by shape, all together with those
    different ones among the lowest (three more than the highest number stated) whose shapes resemble the measured ones
    most, in the sum of the modal assurance criteria. Where another joint changes the partner, the density has a step.

    Parameters
    ----------
    family, joint
        Structures without the joint, and where it acts.
    measurement
        The measured modes.

    Raises
    ------
    ModelError
        If a DOF does not exist, or the structure has fewer modes than the highest number stated.
    """

    def __init__(self, family: StructureFamily, joint: AnyJoint, measurement: ModeMeasurement) -> None:
        self._numbers = np.array(measurement.numbers) - 1
        self._dofs = measurement.dofs
        least, self._by_shape = max(measurement.numbers), measurement.match == "shape"
        free = family.at(joint.labels, family.reach_hz(least)).nominal
        rigid = rigid_body_modes(free, joint)
        count = max(least, min(measurement.most_modes, free.n_dofs - rigid - joint.size))
        self._model = AssembledShapes(family, joint, self._dofs, count)
        self._eigenvalues = measurement.eigenvalues
        place = {label: i for i, label in enumerate(self._dofs)}
        shapes = measurement.shapes
        self._shown = np.array([place[label] for label in shapes.dofs] if shapes else [], dtype=np.intp)
        self._reference = np.array([place[label] for label in measurement.references], dtype=np.intp)
        #: Measured shapes at the DOFs of `ModeMeasurement.dofs`, NaN where unknown, shape (n, DOFs).
        self.measured_shapes = _whole_shapes(measurement)
        #: Place of each measured value among the predicted ones of all modes: frequencies, ratios, components.
        n, p = len(self._numbers), len(self._shown)
        first = {"frequency": 0, "eigenvalue": 0, "damping": n, "shape": 2 * n}
        self._place = np.array(
            [
                first[v.quantity] + (v.mode * p + v.dof if v.quantity == "shape" else v.mode)
                for v in measurement.observed
            ],
            dtype=np.intp,
        )

    def modal_frequencies(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Natural frequencies of the modes that the measured ones are compared with, shape (batch, n), Hz."""
        return self.matched(matrices, factors)[0].frequency_hz

    def modal_values(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Predicted values, shape (batch, m), of joint matrices (batch, r, r) and factors (batch, f).

        Infinite where a mode does not move at its reference DOF.
        """
        modal, _ = self.matched(matrices, factors)
        return self._table(modal)[:, self._place]

    def matched(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Modal, NDArray[np.intp]]:
        """The partners of the measured modes, shapes (batch, n, …), and their places among all, from 0, (batch, n)."""
        modal = self._model.modes(matrices, factors)
        places = self._partners(modal)
        return _taken(modal, places), places

    def modal_tangent(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Predicted values (m,) of one joint and their derivative (p, m) along changes dK^J (p, r, r)."""
        modal, slope = self._model.tangent(matrix, directions, factors)
        places = self._partners(modal)
        here, moved = _taken(modal, places), _taken(slope, np.repeat(places, len(slope.frequency_hz), axis=0))
        frequency = moved.frequency_hz
        if self._eigenvalues:
            frequency = 8 * np.pi**2 * here.frequency_hz * frequency
        parts = [frequency, moved.damping_ratio]
        if self._shown.size:
            value, change = here.shapes, moved.shapes
            reference, d_reference = self._at_reference(value), self._at_reference(change)
            ratio = value[:, :, self._shown] / reference
            parts.append(_in_rows((change[:, :, self._shown] - ratio * d_reference) / reference))
        return self._table(here)[0, self._place], np.hstack(parts)[:, self._place]

    def _partners(self, modal: Modal) -> NDArray[np.intp]:
        """Places of the predicted modes that are compared with the measured ones, shape (batch, n)."""
        if not self._by_shape:
            return np.tile(self._numbers, (len(modal.frequency_hz), 1))
        likeness = mac(self.measured_shapes, modal.shapes)
        places = np.empty((len(likeness), len(self._numbers)), dtype=np.intp)
        for row, one in zip(places, likeness, strict=True):
            row[:] = linear_sum_assignment(one, maximize=True)[1]
        return places

    def _table(self, modal: Modal) -> Array:
        """Frequencies or eigenvalues, damping ratios and relative components of modes, shape (batch, 2n + n·p)."""
        frequency = (2 * np.pi * modal.frequency_hz) ** 2 if self._eigenvalues else modal.frequency_hz
        parts = [frequency, modal.damping_ratio]
        if self._shown.size:
            parts.append(_in_rows(self.components(modal)))
        return np.hstack(parts)

    def components(self, modal: Modal) -> Array:
        """Components of matched modes relative to that at their reference DOF, shape (batch, n, p)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(modal.shapes[:, :, self._shown] / self._at_reference(modal.shapes))

    def _at_reference(self, shapes: Array) -> Array:
        """Components at the reference DOF of each mode, shape (batch, n, 1)."""
        return np.take_along_axis(shapes, self._reference[None, :, None], axis=2)


def _in_rows(components: Array) -> Array:
    """Components of all modes in one row, shape (batch, n·p), of shape (batch, n, p); the batch may be empty."""
    return components.reshape(len(components), components.shape[1] * components.shape[2])


def _taken(modal: Modal, places: NDArray[np.intp]) -> Modal:
    """The modes of each of a batch at some places, (batch, n)."""
    return Modal(
        np.take_along_axis(modal.frequency_hz, places, axis=1),
        np.take_along_axis(modal.damping_ratio, places, axis=1),
        np.take_along_axis(modal.shapes, places[:, :, None], axis=1),
    )


def _whole_shapes(measurement: ModeMeasurement) -> Array:
    """Measured shapes at all DOFs, 1 at the reference, means over repetitions, NaN where unknown: shape (n, DOFs)."""
    if measurement.shapes is None:
        return np.empty((len(measurement.numbers), 0))
    place = {label: i for i, label in enumerate(measurement.dofs)}
    whole = np.full((len(measurement.numbers), len(place)), np.nan)
    mean, _ = measurement.shapes.components.mean()
    for i, label in enumerate(measurement.shapes.dofs):
        whole[:, place[label]] = mean[:, i]
    for mode, label in enumerate(measurement.references):
        whole[mode, place[label]] = 1.0
    return whole
