"""What a modal test states of the assembled structure: frequencies, damping, shapes, antiresonances."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.arrays import Array
from jointbayes.frf.modal import JoinedModes, LowestModes, NaturalFrequencies, turned_modes
from jointbayes.frf.ports import TakingPart, factors_batch
from jointbayes.joint import RIGID, AnyJoint, AnyJointMatrix, Joint, Joints, joint_matrix_of
from jointbayes.structure import Body


@dataclass(frozen=True, slots=True, eq=False)
class Modal:
    """The lowest modes, of a batch of joints or differentiated along changes of one.

    Parameters
    ----------
    frequency_hz
        Undamped natural frequencies, rising, shape (n, c), Hz.
    damping_ratio
        Shape (n, c).
    shapes
        In modes of unit modal mass, of either sign, shape (n, c, DOFs), 1/√kg (a rotation: rad/(m √kg)).
    """

    frequency_hz: Array
    damping_ratio: Array
    shapes: Array


class AssembledShapes(LowestModes):
    """The lowest modes of the structure with its joint; rigid-body motions of one that floats are none.

    Modal damping states the ratios of the assembled structure. Of other laws the ratio is that of the energy that a
    cycle loses, to first order: ζ = η s/(2λ) of a loss factor, ζ = (α + β s)/(2√λ) of Rayleigh damping and φᵀCφ/(2√λ)
    of a matrix C, with λ = ω² and s = φᵀKφ the part of it that the structure stores without the joint. A joint with
    damping of its own, dashpots C and imaginary stiffness H, adds φᵀCφ/(2√λ) + φᵀHφ/(2λ).

    Parameters as of `LowestModes`; shapes are wanted at `dofs`.

    References
    ----------
    Ungar, E. E., Kerwin, E. M. (1962). Loss factors of viscoelastic systems in terms of energy concepts. Journal of the
    Acoustical Society of America 34(7), 954-957. DOI 10.1121/1.1918227
    """

    def _assemble(self, body: Body, joint: AnyJoint, dofs: Sequence[str]) -> None:
        signs, at, strokes = body.dampers()
        taking_part = TakingPart.of(body, joint, dofs, (at, strokes))
        self._body, self._signs, self._along, self._seen = body, signs, taking_part.along, len(dofs)
        self._modes = JoinedModes(body, taking_part, np.zeros(self._along.shape[1], dtype=bool))

    def modes(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Modal:
        """Modes for joint matrices (r, r) or (batch, r, r) and factors on the body's quantities, (q,) or (batch, q)."""
        sides = tuple(map(np.ascontiguousarray, joint_matrix_of(matrices).batch.sides))
        factor_rows = factors_batch(factors, len(sides[0]))
        eigenvalues, rows, springs = self._modes.solve(sides[0], factor_rows)
        r, counted = self._along.shape[0], self._counted
        at_joint = np.linalg.solve(springs.swapaxes(1, 2), rows[:, :r, counted])
        motions = rows[:, r:, counted] + self._along.T @ at_joint
        lam = np.maximum(eigenvalues[:, counted], 0.0)
        held, viscous, hysteretic = (np.einsum("bim,bij,bjm->bm", at_joint, side, at_joint) for side in sides)
        safe = np.maximum(lam, np.finfo(float).tiny)
        viscous = viscous + np.einsum("d,bdm->bm", self._signs, motions[:, self._seen :] ** 2)
        ratio = self._ratios(factor_rows, lam, lam - held) + viscous / (2 * np.sqrt(safe)) + hysteretic / (2 * safe)
        return Modal(np.sqrt(lam) / (2 * np.pi), ratio, motions[:, : self._seen].swapaxes(1, 2))

    def _ratios(self, factor_rows: Array, lam: Array, stored: Array) -> Array:
        """Damping ratios, shape (n, c), of modes with eigenvalues λ and strain energies of the structure alone."""
        law = self._body.damping
        if law.of_assembled_modes:
            return np.broadcast_to(self._body.damping_ratios(factor_rows, lam.shape[1]), lam.shape)
        safe = np.maximum(lam, np.finfo(float).tiny)
        alpha, beta = law.viscous
        viscous = (alpha + beta * stored) / (2 * np.sqrt(safe))
        return self._body.loss_factors(factor_rows)[:, None] * stored / (2 * safe) + viscous

    def tangent(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Modal, Modal]:
        """Modes of one joint, all shapes with n = 1, and their exact derivative along changes dK^J (p, r, r), n = p.

        References
        ----------
        Fox, R. L., Kapoor, M. P. (1968). Rates of change of eigenvalues and eigenvectors. AIAA Journal
        6(12), 2426-2429. DOI 10.2514/3.5008
        """
        factor_rows, here = factors_batch(factors, 1), self.modes(matrix, factors)
        sides, changes = joint_matrix_of(matrix).batch.sides, joint_matrix_of(directions).sides
        (eigenvalues,), (rows,), (springs,) = self._modes.solve(sides[0], factor_rows)
        r, counted = self._along.shape[0], self._counted
        at_joint = np.linalg.solve(springs.T, rows[:r])
        change, _, turn = turned_modes(eigenvalues, at_joint, changes[0])
        motions = rows[r:] + self._along.T @ at_joint
        d_motions = motions @ turn[:, :, counted]
        slope = np.diagonal(change, axis1=1, axis2=2)[:, counted]
        first, moved = at_joint[:, counted], at_joint @ turn[:, :, counted]
        held, viscous, hysteretic = (np.einsum("im,ij,jm->m", first, side[0], first) for side in sides)
        d_held, d_viscous, d_hysteretic = (
            np.einsum("im,pij,jm->pm", first, moves, first) + 2 * np.einsum("pim,ij,jm->pm", moved, side[0], first)
            for side, moves in zip(sides, changes, strict=True)
        )
        strokes, d_strokes = motions[self._seen :, counted], d_motions[:, self._seen :]
        viscous = viscous + self._signs @ strokes**2
        d_viscous = d_viscous + 2 * np.einsum("d,dm,pdm->pm", self._signs, strokes, d_strokes)
        lam = np.maximum(eigenvalues[counted], np.finfo(float).tiny)
        ratio = self._ratio_slopes(factor_rows, lam, lam - held, slope, slope - d_held)
        ratio = ratio + (d_viscous - viscous * slope / (2 * lam)) / (2 * np.sqrt(lam))
        ratio = ratio + (d_hysteretic - hysteretic * slope / lam) / (2 * lam)
        frequency = slope / (4 * np.pi * np.sqrt(lam))
        return here, Modal(frequency, ratio, d_motions[:, : self._seen].swapaxes(1, 2))

    def _ratio_slopes(self, factor_rows: Array, lam: Array, stored: Array, d_lam: Array, d_stored: Array) -> Array:
        """Derivatives of `_ratios`, shape (p, c)."""
        law = self._body.damping
        if law.of_assembled_modes:
            return np.zeros_like(d_lam)
        alpha, beta = law.viscous
        share = (d_stored - stored * d_lam / lam) / (2 * lam)
        viscous = (beta * d_stored - (alpha + beta * stored) * d_lam / (2 * lam)) / (2 * np.sqrt(lam))
        return self._body.loss_factors(factor_rows)[0] * share + viscous


class HeldFrequencies:
    """Natural frequencies of a body with its joint and one DOF held still by one rigid spring more.

    Where a structure does not move although it is excited there, it vibrates as if it were held. Rigid-body motions
    that the joint and that DOF leave are not counted.

    Parameters
    ----------
    body, joint
        Body without the joint, and where the joint acts.
    dofs, numbers
        Label of the DOF that is held, and number of the frequency among those with it held, from 1, for each of n.

    Raises
    ------
    ModelError
        If a DOF does not exist, or the body has fewer frequencies.
    """

    def __init__(self, body: Body, joint: AnyJoint, dofs: Sequence[str], numbers: Sequence[int]) -> None:
        joints = joint.joints if isinstance(joint, Joints) else (joint,)
        named = [replace(each, name=f"{i}") for i, each in enumerate(joints)]
        self._models: list[tuple[NaturalFrequencies, list[int]]] = []
        places: list[int] = []
        for label in dict.fromkeys(dofs):
            at = [i for i, dof in enumerate(dofs) if dof == label]
            held, count = Joints((*named, Joint((label,), name="held"))), max(numbers[i] for i in at)
            model = NaturalFrequencies(body, held, count)
            self._models.append((model, [numbers[i] - 1 for i in at]))
            places += at
        #: Where each of the n stands among those of one DOF after the other.
        self._order = np.argsort(places)

    def frequency_hz(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Frequencies, shape (batch, n), Hz, as `NaturalFrequencies.frequency_hz`."""
        held = _with_rigid(joint_matrix_of(matrices).batch.stiffness, RIGID)
        factor_rows = factors_batch(factors, len(held))
        each = [model.frequency_hz(held, factor_rows)[:, numbers] for model, numbers in self._models]
        return np.hstack(each)[:, self._order]

    def slope(self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Derivative (p, n) of the frequencies of one joint along changes dK^J (p, r, r)."""
        held = _with_rigid(joint_matrix_of(matrix).batch.stiffness, RIGID)
        changes = _with_rigid(joint_matrix_of(directions).stiffness, 0.0)
        factor_rows = factors_batch(factors, 1)
        each = [model.tangent(held, changes, factor_rows)[1][:, numbers] for model, numbers in self._models]
        return np.hstack(each)[:, self._order]


def _with_rigid(stiffness: Array, held: float) -> Array:
    """Matrices (batch, r, r) with one row and column more, and its own stiffness, shape (batch, r + 1, r + 1)."""
    whole = np.pad(stiffness, ((0, 0), (0, 1), (0, 1)))
    whole[:, -1, -1] = held
    return whole
