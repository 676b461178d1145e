"""Receptances by exact low-rank coupling of a joint to the structure without it.

H_ab = A_ab − A_aj (C + A_jj)⁻¹ A_jb with A the receptance without the joint and C = (K^J)⁻¹ (Woodbury),
written with K^J itself, A_aj K^J (1 + A_jj K^J)⁻¹ A_jb, so that an absent joint is as good as a stiff one.
An r × r problem per line, whatever the number of FE DOFs. Where the structure is itself uncertain, A is another one for
every draw, summed over the free modes.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf.direct import solve_lines
from jointbayes.frf.kernels.compiled import compiled
from jointbayes.frf.kernels.multi_dof import MultiDofCoupling
from jointbayes.frf.kernels.pair import PairCoupling
from jointbayes.frf.modal import AssembledModes
from jointbayes.frf.ports import Misfit, Ports, ReceptanceModel, as_batch, as_factors, split_along
from jointbayes.joint import AnyJoint
from jointbayes.structure import FreeModes, Structure, StructureFamily, as_family

__all__ = ["LowRankCoupling", "free_receptance", "receptance_model"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
_Coupling = PairCoupling | MultiDofCoupling

#: A structure of so few DOFs is solved line by line, refined to the last bits; a larger one is summed over its modes.
_SOLVED_LINE_BY_LINE = 50


@compiled
def _sum_modes(
    lam: Array, rows: Array, loss: float, alpha: float, beta: float, omega: Array, out: ComplexArray
) -> None:
    """Σ φ_a φ_b/(λ(1 + jη) − ω² + jω(α + βλ)) into `out` (lines, k, k), of modes (m,) and motions (k, m)."""
    k, m = rows.shape
    re, im = np.empty(m), np.empty(m)
    for line in range(len(omega)):
        w = omega[line]
        for s in range(m):
            a, b = lam[s] - w * w, lam[s] * loss + w * (alpha + beta * lam[s])
            d = 1.0 / (a * a + b * b)
            re[s], im[s] = a * d, -b * d
        for p in range(k):
            for q in range(p + 1):
                x, y = 0.0, 0.0
                for s in range(m):
                    c = rows[p, s] * rows[q, s]
                    x += c * re[s]
                    y += c * im[s]
                out[line, p, q] = complex(x, y)
                out[line, q, p] = out[line, p, q]


def free_receptance(
    family: StructureFamily, modes: FreeModes, factors: NDArray[np.float64], omega: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Receptance without the joint, shape (lines, k, k), between k motions.

    Summed over the free modes, in which a loss factor and Rayleigh's damping are diagonal:
    A = Σ φ φᵀ/(λ(1 + jη) − ω² + jω(α + βλ)).

    Parameters
    ----------
    family
        Structures with loss-factor or Rayleigh damping.
    modes
        Their free modes with the k motions.
    factors
        On the family's quantities, shape (q,).
    omega
        Lines, shape (lines,), rad/s.
    """
    (lam,), (rows,) = modes(factors[None])
    alpha, beta = family.nominal.damping.viscous
    (loss,) = family.loss_factors(factors[None])
    free = np.empty((omega.size, len(rows), len(rows)), dtype=complex)
    _sum_modes(lam, np.ascontiguousarray(rows), float(loss), alpha, beta, omega, free)
    return free


class LowRankCoupling:
    """Assembled receptance where damping belongs to the structure without the joint.

    Parameters
    ----------
    structure
        Structure with loss-factor or Rayleigh damping, or a family of such.
    joint
        Where the joint acts, r DOFs.
    ports
        Lines, outputs and inputs.

    Raises
    ------
    ModelError
        If the damping law is modal: its modes are those of the assembled structure, see `AssembledModes`.
    """

    def __init__(self, structure: Structure | StructureFamily, joint: AnyJoint, ports: Ports) -> None:
        self._family = family = as_family(structure)
        if family.nominal.damping.of_assembled_modes:
            raise ModelError(
                "low-rank coupling: found modal damping of the assembled structure; expected a loss factor or "
                "Rayleigh damping; use the modal sum instead"
            )
        joined, outputs, inputs = ports.selections(family.nominal, joint)
        self._along, rest = split_along(np.hstack([outputs, inputs]), joined)
        self._n_out, self._omega = len(ports.outputs), ports.omega
        driven = np.hstack([joined, rest])
        self._known: _Coupling | None = None
        small = family.nominal.n_dofs <= _SOLVED_LINE_BY_LINE
        if not family.names and (small or family.nominal.damping.matrix is not None):
            self._known = self._coupling(solve_lines(family.nominal, ports.omega, driven, driven))
            return
        forced = np.arange(driven.shape[1]) - joined.shape[1] >= len(ports.outputs)
        forced[: joined.shape[1]] = True
        self._modes = family.free_modes(driven, forced)
        if not family.names:
            self._known = self._at(np.empty(0))

    def receptance(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> ComplexArray:
        """Receptances (batch, lines, outputs, inputs), see `ReceptanceModel`."""
        if self._known is not None:
            return self._known.receptance(stiffness)
        matrices = as_batch(stiffness)
        known = as_factors(factors, len(matrices))
        return np.concatenate([self._at(row).receptance(k) for k, row in zip(matrices, known, strict=True)])

    def tangent(
        self, stiffness: ArrayLike, directions: ArrayLike, factors: ArrayLike | None = None
    ) -> tuple[ComplexArray, ComplexArray]:
        """Receptance and its derivative along changes of one joint matrix, see `ReceptanceModel`."""
        return (self._known or self._at(as_factors(factors, 1)[0])).tangent(stiffness, directions)

    def misfit(self, measured: ComplexArray, weight: Array) -> Misfit:
        """Weighted distance from measured receptances, see `ReceptanceModel`."""
        return self._known.misfit(measured, weight) if self._known else _UncertainMisfit(self, measured, weight)

    def _at(self, factors: Array) -> _Coupling:
        """Coupling of the structure at factors (q,)."""
        return self._coupling(free_receptance(self._family, self._modes, factors, self._omega))

    def _coupling(self, free: ComplexArray) -> _Coupling:
        # reciprocity holds to the last bits if it holds here
        free = (free + free.swapaxes(-1, -2)) / 2
        form = PairCoupling if len(self._along) <= 2 else MultiDofCoupling
        return form(free, self._along, self._n_out)


class _UncertainMisfit:
    """χ² = Σ |H − H^x|² w² as a function of joint and structure, one draw after the other."""

    def __init__(self, model: LowRankCoupling, measured: ComplexArray, weight: Array) -> None:
        self._model, self._measured, self._weight = model, measured, weight

    def chi2(self, stiffness: Array, factors: ArrayLike | None = None) -> Array:
        """χ², shape (batch,), see `Misfit`."""
        known = as_factors(factors, len(stiffness))
        return np.concatenate([self._at(row).chi2(k[None]) for k, row in zip(stiffness, known, strict=True)])

    def chi2_gradient(self, stiffness: Array, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """χ² and its gradient by the joint, see `Misfit`."""
        known = as_factors(factors, len(stiffness))
        each = [self._at(row).chi2_gradient(k[None]) for k, row in zip(stiffness, known, strict=True)]
        return np.concatenate([chi2 for chi2, _ in each]), np.concatenate([slope for _, slope in each])

    def _at(self, factors: Array) -> Misfit:
        return self._model._at(factors).misfit(self._measured, self._weight)


def receptance_model(structure: Structure | StructureFamily, joint: AnyJoint, ports: Ports) -> ReceptanceModel:
    """Return the exact low-rank forward model for the damping law of a structure or of a family of them.

    Raises
    ------
    ModelError
        If a DOF does not exist.
    """
    dofs = dict.fromkeys((*joint.labels, *ports.outputs, *ports.inputs))
    family = as_family(structure).at(dofs, float(np.max(ports.frequency_hz)))
    if family.nominal.damping.of_assembled_modes:
        return AssembledModes(family, joint, ports)
    return LowRankCoupling(family, joint, ports)
