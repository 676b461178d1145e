"""What a modal test states of the assembled structure: frequencies, damping, shapes, antiresonances."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.frf.kernels.secular import held_still
from jointbayes.frf.modal import JoinedModes, LowestModes, least_reach_hz, rigid_body_modes, turned_modes
from jointbayes.frf.ports import TakingPart, factors_batch
from jointbayes.joint import AnyJoint, AnyJointMatrix, Joint, Joints, joint_matrix_of
from jointbayes.structure import Body
from vibrecords.arrays import Array


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
    zeros_hz
        Antiresonances, shape (n, z), Hz.
    """

    frequency_hz: Array
    damping_ratio: Array
    shapes: Array
    zeros_hz: Array


class AssembledShapes(LowestModes):
    """The lowest modes of the structure with its joint; rigid-body motions of one that floats are none.

    Modal damping states the ratios of the assembled structure. Of other laws the ratio is of the energy that a
    cycle loses, to first order: ζ = η s/(2λ) of a loss factor, ζ = (α + β s)/(2√λ) of Rayleigh damping and φᵀCφ/(2√λ)
    of a matrix C, with λ = ω² and s = φᵀKφ the part of it that the structure stores without the joint. A joint with
    damping of its own, dashpots C and imaginary stiffness H, adds φᵀCφ/(2√λ) + φᵀHφ/(2λ).

    Where a structure does not move although it is excited there, it vibrates as if that DOF were held still: its
    antiresonances are the roots of Σ φ²/(λ − ω²) = 0 over all modes, one rigid spring more. Rigid-body motions that the
    joint and that DOF leave are not counted.

    Parameters
    ----------
    body, joint, count
        See `LowestModes`.
    dofs
        Labels of the DOFs at which shapes are wanted.
    zeros
        Antiresonances: the DOF that is held, and the number among those with it held, from 1, of each.

    Raises
    ------
    ModelError
        If a DOF does not exist, or the body has fewer modes or antiresonances.

    References
    ----------
    Ungar, E. E., Kerwin, E. M. (1962). Loss factors of viscoelastic systems in terms of energy concepts. Journal of the
    Acoustical Society of America 34(7), 954-957. DOI 10.1121/1.1918227
    """

    def __init__(
        self, body: Body, joint: AnyJoint, count: int, dofs: Sequence[str] = (), zeros: Sequence[tuple[str, int]] = ()
    ) -> None:
        labels = [label for label, _ in zeros]
        self._seen, self._zeros = len(dofs), {label: [n - 1 for dof, n in zeros if dof == label] for label in labels}
        #: Where each antiresonance stands among those of one DOF after the other.
        self._order = np.argsort(np.argsort([list(self._zeros).index(label) for label in labels], kind="stable"))
        held = {label: held_at(joint, label) for label in self._zeros}
        tops = [least_reach_hz(body, also, max(self._zeros[label]) + 1) for label, also in held.items()]
        top_hz = max(least_reach_hz(body, joint, count), *tops) if tops else None
        super().__init__(body, joint, count, (*dofs, *self._zeros), top_hz)
        self._rigid = {label: rigid_body_modes(self._body, also) for label, also in held.items()}
        for label, rigid in self._rigid.items():
            n, found = self._body.n_dofs - rigid - 1, sorted(self._zeros[label])
            if not 0 <= found[0] <= found[-1] < n:
                numbers = ", ".join(str(number + 1) for number in found)
                raise ModelError.of(f"antiresonances of {label}", (), f"found numbers {numbers}", f"1 to {n}")

    def _assemble(self, body: Body, joint: AnyJoint, dofs: Sequence[str]) -> None:
        signs, at, strokes = body.dampers()
        taking_part = TakingPart.of(body, joint, dofs, (at, strokes))
        self._body, self._signs, self._along = body, signs, taking_part.along
        forced = np.arange(self._along.shape[1])
        self._modes = JoinedModes(body, taking_part, (forced >= self._seen) & (forced < len(dofs)))

    def modes(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Modal:
        """Modes for joint matrices (r, r) or (batch, r, r) and factors on the body's quantities, (q,) or (batch, q)."""
        sides = tuple(map(np.ascontiguousarray, joint_matrix_of(matrices).batch.sides))
        factor_rows = factors_batch(factors, len(sides[0]))
        r, counted = self._along.shape[0], self._counted
        every = None if self._zeros else counted.stop
        eigenvalues, rows, springs = self._modes.solve(sides[0], factor_rows, every)
        beyond = ~np.isfinite(springs).all(axis=(1, 2))  # of a stiffness that no number holds nothing is known
        springs[beyond], eigenvalues[beyond] = np.eye(r), np.nan
        at_joint = np.linalg.solve(springs.swapaxes(1, 2), rows[:, :r])
        motions = rows[:, r:] + self._along.T @ at_joint
        zeros_hz = self._antiresonances(eigenvalues, motions, rows[:, :0])[0]
        at_joint, motions = at_joint[:, :, counted], motions[:, :, counted]
        lam = np.maximum(eigenvalues[:, counted], 0.0)
        held, viscous, hysteretic = (np.einsum("bim,bij,bjm->bm", at_joint, side, at_joint) for side in sides)
        safe = np.maximum(lam, np.finfo(float).tiny)
        strokes = motions[:, self._seen + len(self._zeros) :]
        viscous = viscous + np.einsum("d,bdm->bm", self._signs, strokes**2)
        ratio = self._ratios(factor_rows, lam, lam - held) + viscous / (2 * np.sqrt(safe)) + hysteretic / (2 * safe)
        return Modal(np.sqrt(lam) / (2 * np.pi), ratio, motions[:, : self._seen].swapaxes(1, 2), zeros_hz)

    def _antiresonances(self, eigenvalues: Array, motions: Array, rest: Array) -> tuple[Array, Array]:
        """Antiresonances (n, z), Hz, from all modes, and other motions, shape (n, q, m), in each of them, (n, q, z)."""
        held_hz, moved = [np.empty((len(eigenvalues), 0))], [np.empty((*rest.shape[:2], 0))]
        for place, (label, numbers) in enumerate(self._zeros.items(), self._seen):
            wanted = [self._rigid[label] + number for number in numbers]
            lam, rows = held_still(eigenvalues, motions[:, place], rest, self._body.shift, max(wanted) + 1)
            held_hz.append(np.sqrt(np.maximum(lam[:, wanted], 0.0)) / (2 * np.pi))
            moved.append(rows[:, :, wanted])
        return np.hstack(held_hz)[:, self._order], np.concatenate(moved, axis=2)[:, :, self._order]

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
        first_stroke = self._seen + len(self._zeros)
        strokes, d_strokes = motions[first_stroke:, counted], d_motions[:, first_stroke:]
        viscous = viscous + self._signs @ strokes**2
        d_viscous = d_viscous + 2 * np.einsum("d,dm,pdm->pm", self._signs, strokes, d_strokes)
        lam = np.maximum(eigenvalues[counted], np.finfo(float).tiny)
        law, stored, d_stored = self._body.damping, lam - held, slope - d_held
        ratio = np.zeros_like(slope)
        if not law.of_assembled_modes:
            alpha, beta = law.viscous
            share = (d_stored - stored * slope / lam) / (2 * lam)
            of_law = (beta * d_stored - (alpha + beta * stored) * slope / (2 * lam)) / (2 * np.sqrt(lam))
            ratio = self._body.loss_factors(factor_rows)[0] * share + of_law
        ratio = ratio + (d_viscous - viscous * slope / (2 * lam)) / (2 * np.sqrt(lam))
        ratio = ratio + (d_hysteretic - hysteretic * slope / lam) / (2 * lam)
        frequency = slope / (4 * np.pi * np.sqrt(lam))
        zeros_hz, held = self._antiresonances(eigenvalues[None], motions[None], at_joint[None])
        d_zeros = np.einsum("iz,pij,jz->pz", held[0], changes[0], held[0])
        d_zeros = d_zeros / (8 * np.pi**2 * np.maximum(zeros_hz, np.finfo(float).tiny))
        return here, Modal(frequency, ratio, d_motions[:, : self._seen].swapaxes(1, 2), d_zeros)


def held_at(joint: AnyJoint, label: str) -> Joints:
    """The joint, and one DOF more that it holds, after its own."""
    named = [replace(each, name=f"{place}") for place, each in enumerate(joint.joints)]
    return Joints((*named, Joint((label,), name="held")))
