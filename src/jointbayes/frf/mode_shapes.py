"""Modes of the assembled structure as a modal test states them: frequency, damping ratio and shape at some DOFs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf.modal import JoinedModes, first_factors, turned_modes
from jointbayes.frf.ports import as_batch, as_factors, split_along
from jointbayes.joint import AnyJoint
from jointbayes.structure import Structure, StructureFamily, as_family
from jointbayes.structure.family import MOST_HELD

__all__ = ["AssembledShapes", "Modal"]

Array = NDArray[np.float64]


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


class AssembledShapes:
    """The lowest modes of the structure with its joint.

    Modal damping states the ratios of the assembled structure. Of other laws the ratio is that of the energy that a
    cycle loses, to first order: ζ = η s/(2λ) of a loss factor and ζ = (α + β s)/(2√λ) of Rayleigh damping, with λ = ω²
    and s = φᵀKφ the part of it that the structure stores without the joint, which itself has no damping.

    Parameters
    ----------
    structure, joint
        Structure without the joint, or a family of them, and where the joint acts.
    dofs
        Labels of the DOFs at which shapes are wanted.
    count
        How many modes, from the lowest.

    Raises
    ------
    ModelError
        If a DOF does not exist, or the structure has fewer DOFs than that.

    References
    ----------
    Ungar, E. E., Kerwin, E. M. (1962). Loss factors of viscoelastic systems in terms of energy concepts. Journal of the
    Acoustical Society of America 34(7), 954-957. DOI 10.1121/1.1918227
    """

    def __init__(
        self, structure: Structure | StructureFamily, joint: AnyJoint, dofs: Sequence[str], count: int
    ) -> None:
        family = as_family(structure)
        reach = family.reach_hz(count + max(0, joint.size - MOST_HELD))
        self._family = family.at(dict.fromkeys((*joint.labels, *dofs)), reach)
        nominal = self._family.nominal
        if not 1 <= count <= nominal.n_dofs:
            raise ModelError(f"modes: found a count of {count}; expected 1 to {nominal.n_dofs}")
        seen = np.eye(nominal.n_dofs)[:, nominal.index(tuple(dofs))]
        self._along, rest = split_along(seen, joint.selection(nominal))
        self._modes, self._count = JoinedModes(self._family, joint, rest, np.zeros(len(dofs), dtype=bool)), count

    def modes(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Modal:
        """Modes for joint matrices (r, r) or (batch, r, r) and factors on a family's quantities, (q,) or (batch, q)."""
        matrices = as_batch(stiffness)
        known = as_factors(factors, len(matrices))
        eigenvalues, rows, springs = self._modes.solve(matrices, known)
        r, c = self._along.shape[0], self._count
        at_joint = np.linalg.solve(springs.swapaxes(1, 2), rows[:, :r, :c])
        shapes = rows[:, r:, :c] + self._along.T @ at_joint
        lam = np.maximum(eigenvalues[:, :c], 0.0)
        held = np.einsum("bim,bij,bjm->bm", at_joint, matrices, at_joint)
        off = first_factors(self._family.frequency_factors(known), c)
        ratio = self._ratios(known, lam, lam - held)
        return Modal(off * np.sqrt(lam) / (2 * np.pi), ratio, shapes.swapaxes(1, 2))

    def _ratios(self, known: Array, lam: Array, stored: Array) -> Array:
        """Damping ratios, shape (n, c), of modes with eigenvalues λ and strain energies of the structure alone."""
        law = self._family.nominal.damping
        if law.of_assembled_modes:
            given = self._family.damping_ratios(known)[:, : self._count]
            return np.broadcast_to(given, lam.shape)
        safe = np.maximum(lam, np.finfo(float).tiny)
        alpha, beta = law.viscous
        viscous = (alpha + beta * stored) / (2 * np.sqrt(safe))
        return self._family.loss_factors(known)[:, None] * stored / (2 * safe) + viscous

    def tangent(
        self, stiffness: ArrayLike, directions: ArrayLike, factors: ArrayLike | None = None
    ) -> tuple[Modal, Modal]:
        """Modes of one joint, all shapes with n = 1, and their exact derivative along changes dK^J (p, r, r), n = p.

        References
        ----------
        Fox, R. L., Kapoor, M. P. (1968). Rates of change of eigenvalues and eigenvectors. AIAA Journal
        6(12), 2426-2429. DOI 10.2514/3.5008
        """
        matrices, known = as_batch(stiffness), as_factors(factors, 1)
        here = self.modes(matrices, known)
        (eigenvalues,), (rows,), (springs,) = self._modes.solve(matrices, known)
        r, c = self._along.shape[0], self._count
        changes = np.asarray(directions, dtype=float)
        at_joint = np.linalg.solve(springs.T, rows[:r])
        change, _, turn = turned_modes(eigenvalues, at_joint, changes)
        shapes = (rows[r:] + self._along.T @ at_joint) @ turn[:, :, :c]
        slope = np.diagonal(change, axis1=1, axis2=2)[:, :c]
        first = at_joint[:, :c]
        moved = at_joint @ turn[:, :, :c]
        held = np.einsum("im,ij,jm->m", first, matrices[0], first)
        d_held = np.einsum("im,pij,jm->pm", first, changes, first)
        d_held += 2 * np.einsum("pim,ij,jm->pm", moved, matrices[0], first)
        lam = np.maximum(eigenvalues[:c], np.finfo(float).tiny)
        off = first_factors(self._family.frequency_factors(known), c)
        ratio = self._ratio_slopes(known, lam, lam - held, slope, slope - d_held)
        frequency = off * slope / (4 * np.pi * np.sqrt(lam))
        return here, Modal(frequency, ratio, shapes.swapaxes(1, 2))

    def _ratio_slopes(self, known: Array, lam: Array, stored: Array, d_lam: Array, d_stored: Array) -> Array:
        """Derivatives of `_ratios`, shape (p, c)."""
        law = self._family.nominal.damping
        if law.of_assembled_modes:
            return np.zeros_like(d_lam)
        alpha, beta = law.viscous
        share = (d_stored - stored * d_lam / lam) / (2 * lam)
        viscous = (beta * d_stored - (alpha + beta * stored) * d_lam / (2 * lam)) / (2 * np.sqrt(lam))
        return self._family.loss_factors(known)[0] * share + viscous
