"""Likelihood of modes: what a modal test shows of the assembled structure, matched and compared value by value."""

import math
from collections.abc import Sequence
from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from jointbayes.errors import ModelError
from jointbayes.frf import AssembledShapes, Modal, NaturalFrequencies, rigid_body_modes
from jointbayes.frf.ports import factors_batch
from jointbayes.inference.likelihood_base import STEP, Likelihood, moved_factors
from jointbayes.inference.noise.base import NoiseModel, residuals_of_values, values_of_residuals
from jointbayes.inference.noise.gaussian import GaussianNoise
from jointbayes.inference.test import Test, likelihood_of
from jointbayes.joint import AnyJoint, AnyJointMatrix, joint_matrix_of, symmetric_changes
from jointbayes.structure import Body
from vibrecords import ModalData, ModeData
from vibrecords.arrays import Array, Indices


@singledispatch
def modal_model(data: ModalData, family: Body, joint: AnyJoint) -> "NaturalFrequencies | ModePrediction":
    """The model that predicts what was measured: natural frequencies, where the kind of data registers no other.

    Raises
    ------
    ModelError
        If a measured DOF does not exist, or the structure has fewer modes.
    """
    return NaturalFrequencies(family, joint, data.frequency_hz.size)


def mac(measured: Array, predicted: Array) -> Array:
    """Modal assurance criterion of shapes, (n, p) and (..., c, p), shape (..., n, c): 1 where proportional.

    NaN is a component that was not measured; those predicted in its place do not count.

    References
    ----------
    Allemang, R. J. (2003). The modal assurance criterion: twenty years of use and abuse. Sound and Vibration 37(8),
    14-23.
    """
    measured_here, turned = ~np.isnan(measured), np.swapaxes(predicted, -1, -2)
    seen = np.where(measured_here, measured, 0.0)
    size = (seen**2).sum(axis=-1)[:, None] * (measured_here.astype(float) @ turned**2)
    return (seen @ turned) ** 2 / np.maximum(size, np.finfo(float).tiny)


@modal_model.register(ModeData)
class ModePrediction:
    """Predicts the values of a `ModeData`.

    Each measured mode is compared with the predicted one of its number; or, matched by shape, all together with those
    different ones among the lowest (three more than the highest number stated) whose shapes resemble the measured ones
    most, in the sum of the modal assurance criteria. Where another joint changes the partner, the density has a step.

    Parameters
    ----------
    data
        The measured modes.
    family, joint
        Structures without the joint, and where it acts.

    Raises
    ------
    ModelError
        If a DOF does not exist, or the structure has fewer modes than the highest number stated.
    """

    def __init__(self, data: ModeData, family: Body, joint: AnyJoint) -> None:
        self._numbers = np.array(data.numbers) - 1
        self._dofs = data.dofs_of_modes
        least, self._by_shape = max(data.numbers), data.match == "shape"
        free = family.at(joint.labels, family.reach_hz(least))
        rigid = rigid_body_modes(free, joint)
        count = max(least, min(data.most_modes, free.n_dofs - rigid - joint.size))
        zeros = data.zeros
        of_zeros = list(zip(zeros.dofs, zeros.numbers, strict=True)) if zeros else []
        self._model = AssembledShapes(family, joint, count, self._dofs, of_zeros)
        self._eigenvalues = data.eigenvalues
        place = {label: i for i, label in enumerate(self._dofs)}
        shapes, constants = data.shapes, data.constants
        self._shown = np.array([place[label] for label in shapes.dofs] if shapes else [], dtype=np.intp)
        self._reference = np.array([place[label] for label in data.references], dtype=np.intp)
        pairs = [(place[output], place[input_]) for output, input_ in constants.pairs] if constants else []
        self._pairs = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
        n, p, q = len(self._numbers), len(self._shown), len(pairs)
        #: Measured shapes at the DOFs of `ModeData.dofs_of_modes`, shape (n, DOFs): means over repetitions, 1 at the
        #: reference, NaN where unknown.
        self.measured_shapes = np.full((n, len(place) if shapes else 0), np.nan)
        if shapes:
            self.measured_shapes[:, self._shown] = shapes.components.mean()[0]
            self.measured_shapes[np.arange(n), self._reference] = 1.0
        #: Place of each measured value among the predicted ones of all modes: frequencies, ratios and so on.
        width = {"shape": p, "constant": q}
        first = {"frequency": 0, "eigenvalue": 0, "damping": n, "shape": 2 * n, "constant": (2 + p) * n}
        first["zero"] = (2 + p + q) * n
        self._place = np.array(
            [first[v.quantity] + v.mode * width.get(v.quantity, 1) + v.dof for v in data.observed], dtype=np.intp
        )

    def modal_frequencies(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Natural frequencies of the modes that the measured ones are compared with, shape (batch, n), Hz."""
        return self.matched(matrices, factors)[0].frequency_hz

    def predicted_values(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Predicted values, shape (batch, m), of joint matrices (batch, r, r) and factors (batch, f).

        Infinite where a mode does not move at its reference DOF.
        """
        modal, _ = self.matched(matrices, factors)
        return self._table(modal)[:, self._place]

    def matched(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Modal, Indices]:
        """The partners of the measured modes, shapes (batch, n, …), and their places among all, from 0, (batch, n)."""
        modal = self._model.modes(matrices, factors)
        places = self._partners(modal)
        return _taken(modal, places), places

    def tangent(
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
            reference, d_reference = self._reference_components(value), self._reference_components(change)
            ratio = value[:, :, self._shown] / reference
            parts.append(_flattened((change[:, :, self._shown] - ratio * d_reference) / reference))
        if self._pairs.size:
            output, input_ = self._pairs
            change, value = moved.shapes, here.shapes
            parts.append(
                _flattened(change[:, :, output] * value[:, :, input_] + value[:, :, output] * change[:, :, input_])
            )
        return self._table(here)[0, self._place], np.hstack([*parts, moved.zeros_hz])[:, self._place]

    def _partners(self, modal: Modal) -> Indices:
        """Places of the predicted modes that are compared with the measured ones, shape (batch, n)."""
        if not self._by_shape:
            return np.tile(self._numbers, (len(modal.frequency_hz), 1))
        likeness = mac(self.measured_shapes, modal.shapes)
        places = np.empty((len(likeness), len(self._numbers)), dtype=np.intp)
        for row, mac_of_joint in zip(places, likeness, strict=True):
            row[:] = linear_sum_assignment(mac_of_joint, maximize=True)[1]
        return places

    def _table(self, modal: Modal) -> Array:
        """All that is predicted, one kind after the other, shape (batch, 2n + n·p + n·q + z)."""
        frequency = (2 * np.pi * modal.frequency_hz) ** 2 if self._eigenvalues else modal.frequency_hz
        parts = [frequency, modal.damping_ratio]
        if self._shown.size:
            parts.append(_flattened(self.components(modal)))
        if self._pairs.size:
            parts.append(_flattened(self.constants(modal)))
        return np.hstack([*parts, modal.zeros_hz])

    def constants(self, modal: Modal) -> Array:
        """Modal constants of matched modes, shape (batch, n, q), 1/kg."""
        output, input_ = self._pairs
        return modal.shapes[:, :, output] * modal.shapes[:, :, input_]

    def components(self, modal: Modal) -> Array:
        """Components of matched modes relative to that at their reference DOF, shape (batch, n, p)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(modal.shapes[:, :, self._shown] / self._reference_components(modal.shapes))

    def _reference_components(self, shapes: Array) -> Array:
        """Components at the reference DOF of each mode, shape (batch, n, 1)."""
        return np.take_along_axis(shapes, self._reference[None, :, None], axis=2)


def _flattened(components: Array) -> Array:
    """Components of all modes in one row, shape (batch, n·p), of shape (batch, n, p); the batch may be empty."""
    return components.reshape(len(components), components.shape[1] * components.shape[2])


def _taken(modal: Modal, places: Indices) -> Modal:
    """The modes of each of a batch at some places, (batch, n)."""
    return Modal(
        np.take_along_axis(modal.frequency_hz, places, axis=1),
        np.take_along_axis(modal.damping_ratio, places, axis=1),
        np.take_along_axis(modal.shapes, places[:, :, None], axis=1),
        modal.zeros_hz,
    )


class GaussianLikelihood(Likelihood):
    """Independent Gaussian likelihood of real values that a model predicts: natural frequencies, and more of modes.

    Parameters
    ----------
    model
        Predicts as many values as were measured.
    values, sd
        Measured values and their standard deviations, shape (n,).
    names
        Uncertain quantities of the structure, in the order in which factors come; those of the noise follow.
    noise
        Noise model of real residuals; Gaussian of known size by default.

    Raises
    ------
    ModelError
        If the noise model is one of complex residuals, or for FRFs.
    """

    def __init__(
        self,
        model: NaturalFrequencies | ModePrediction,
        values: Array,
        sd: Array,
        names: Sequence[str] = (),
        noise: NoiseModel | None = None,
    ) -> None:
        self._model, self._measured, self._sd = model, values, sd
        noise = noise or GaussianNoise(1)
        if noise.parts != 1 and not noise.needs_chi2_only:
            raise ModelError.of("natural frequencies", (), f"found {type(noise).__name__}", "Gaussian noise")
        constant = -float(np.log(self._sd * math.sqrt(2 * math.pi)).sum())
        super().__init__((*names, *noise.names), noise, constant, self._measured.size)

    def log_likelihood(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q)."""
        joints = joint_matrix_of(matrices)
        factor_rows = factors_batch(factors, len(joints))
        if not self.noise.needs_chi2_only:
            z = residuals_of_values(self.standardised(joints, factor_rows))
            return self.constant + self.noise.log_likelihood(z, self.hyper(factor_rows))
        chi2 = 0.5 * (self.standardised(joints, factor_rows) ** 2).sum(axis=-1)
        chi2[np.isnan(chi2)] = np.inf  # a shape relative to a DOF at rest
        return self.constant + self.noise.log_likelihood_of_chi2(chi2, self.n_data, self.hyper(factor_rows))

    def standardised(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Residuals over their standard deviation, shape (batch, n)."""
        return (self.predicted(matrices, factors) - self._measured) / self._sd

    def variance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Squared standard deviations as stated, shape (batch, n)."""
        return np.broadcast_to(self._sd**2, (len(joint_matrix_of(matrices)), self._sd.size))

    def add_noise(self, predicted: Array, z: NDArray[Any]) -> Array:
        """What would be measured: predicted values of one joint and noise z, both shape (n,)."""
        return predicted + math.sqrt(2) * self._sd * z.real  # z = r/(√2 sd), as noise models have it

    def white(self, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Residuals over their standard deviation and its factor, shape (batch, n)."""
        z = self.standardised(matrices, factors)
        if not self.noise.needs_chi2_only:
            return values_of_residuals(self.noise.scores(residuals_of_values(z), self.hyper(factors)))
        return z / self.hyper(factors) if self.hyper_count else z

    def predicted(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Natural frequencies in Hz, and what else was measured, shape (batch, n)."""
        joints = joint_matrix_of(matrices)
        return self._model.predicted_values(joints, self._structural(factors_batch(factors, len(joints))))

    def pointwise(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L value by value, shape (batch, n).

        Raises
        ------
        ModelError
            If the values depend on each other.
        """
        if not self.noise.needs_chi2_only:
            self.noise.pointwise(np.empty((0, self.n_data, 1)), np.empty((0, self.hyper_count)))
        factor_rows = factors_batch(factors, len(joint_matrix_of(matrices)))
        values = -0.5 * self.white(matrices, factor_rows) ** 2 + self.constant / self.n_data
        return values - np.log(self.hyper(factor_rows)) if self.hyper_count else values

    def _structural(self, factors: Array) -> Array:
        return factors[:, : factors.shape[1] - self.hyper_count]

    def gradient(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r) by the joint: d ln L = Σ S_ij dK_ij for symmetric dK."""
        stiffness = joint_matrix_of(matrices).stiffness
        factor_rows = factors_batch(factors, len(stiffness))
        slope = np.empty_like(stiffness)
        changes = symmetric_changes(stiffness.shape[-1])
        for joint, row, gradient in zip(stiffness, factor_rows, slope, strict=True):
            residual, jacobian = self.residuals(joint, changes, row)
            gradient[:] = -(residual @ jacobian[:, : len(changes)]).reshape(joint.shape)
        return self.log_likelihood(stiffness, factor_rows), slope

    def residuals(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint."""
        hyper = self.hyper(factors_batch(factors, 1))[0]
        if self.noise.needs_chi2_only:
            rows = self.plain_residuals(matrix, directions, factors, *hyper)
        else:
            z = residuals_of_values(self.plain_residuals(matrix, directions, factors))
            rows = values_of_residuals(self.noise.whiten(z, hyper))
        return rows[0], rows[1:].T

    def plain_residuals(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None, scale: float = 1.0
    ) -> Array:
        """Residuals over `scale` times their stated deviations, and derivatives, (1 + p + q, m), for one joint."""
        joint, factor_rows = joint_matrix_of(matrix), factors_batch(factors, 1)
        structural = self._structural(factor_rows)
        value, derivative = self._model.tangent(joint, directions, structural)
        moved = moved_factors(structural)
        up, down = np.split(self._model.predicted_values(joint.repeated(len(moved)), moved), 2)
        slopes = [derivative, (up - down) / (2 * STEP), np.zeros((self.hyper_count, value.size))]
        return np.concatenate([(value - self._measured)[None], *slopes]) / (scale * self._sd)


@likelihood_of.register
def _modal_likelihood(data: ModalData, test: Test, *, gain: bool = False) -> GaussianLikelihood:
    if test.measured_bodies:
        found = "found natural frequencies as data"
        expected = "FRFs, since a body given by its FRFs has no modes to be compared with"
        raise ModelError.of(f"measured body {test.measured_bodies[0].name}", (), found, expected, "use the FRFs")
    model = modal_model(data, test.structures, test.joints)
    return GaussianLikelihood(model, data.values, data.sd, test.structures.names, test.noise)
