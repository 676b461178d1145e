"""Receptances by exact low-rank coupling of a joint to the structure without it.

H_ab = A_ab − A_aj (C + A_jj)⁻¹ A_jb with A the receptance without the joint and C = (K^J)⁻¹ (Woodbury),
written with K^J itself, A_aj K^J (1 + A_jj K^J)⁻¹ A_jb, so that an absent joint is as good as a stiff one.
An r × r problem per line, whatever the number of FE DOFs.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf.direct import solve_lines
from jointbayes.frf.kernels.compiled import compiled
from jointbayes.frf.kernels.multi_dof import MultiDofCoupling
from jointbayes.frf.kernels.pair import PairCoupling
from jointbayes.frf.ports import Misfit, Ports, split_along
from jointbayes.joint import Joint
from jointbayes.structure import FreeModes, Structure, StructureFamily, as_family

__all__ = ["LowRankCoupling", "free_receptance"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

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
        Structure with loss-factor or Rayleigh damping.
    joint
        Where the joint acts, r DOFs.
    ports
        Lines, outputs and inputs.

    Raises
    ------
    ModelError
        If the damping law is modal: its modes are those of the assembled structure, see `AssembledModes`.
    """

    def __init__(self, structure: Structure | StructureFamily, joint: Joint, ports: Ports) -> None:
        family = as_family(structure)
        if family.nominal.damping.of_assembled_modes:
            raise ModelError(
                "low-rank coupling: found modal damping of the assembled structure; expected a loss factor or "
                "Rayleigh damping; use the modal sum instead"
            )
        joined, outputs, inputs = ports.selections(family.nominal, joint)
        along, rest = split_along(np.hstack([outputs, inputs]), joined)
        driven = np.hstack([joined, rest])
        if family.nominal.n_dofs <= _SOLVED_LINE_BY_LINE:
            free = solve_lines(family.nominal, ports.omega, driven, driven)
        else:
            free = free_receptance(family, family.free_modes(driven), np.empty(0), ports.omega)
        # reciprocity holds to the last bits if it holds here
        free = (free + free.swapaxes(-1, -2)) / 2
        form = PairCoupling if joined.shape[1] <= 2 else MultiDofCoupling
        self._form: PairCoupling | MultiDofCoupling = form(free, along, len(ports.outputs))

    def receptance(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> NDArray[np.complex128]:
        """Receptances for joint matrices of shape (r, r) or (batch, r, r): shape (batch, lines, outputs, inputs).

        The structure is exactly known here: `factors` have no columns.
        """
        return self._form.receptance(stiffness)

    def tangent(
        self, stiffness: ArrayLike, directions: ArrayLike, factors: ArrayLike | None = None
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Receptance and its derivative along p changes of one joint matrix.

        Parameters
        ----------
        stiffness
            K^J, shape (r, r).
        directions
            Changes dK^J, shape (p, r, r).

        Returns
        -------
        receptance, derivative : ndarray, shapes (lines, outputs, inputs) and (p, lines, outputs, inputs)
        """
        return self._form.tangent(stiffness, directions)

    def misfit(self, measured: NDArray[np.complex128], weight: NDArray[np.float64]) -> Misfit:
        """Weighted distance from measured receptances, Σ |H − H^x|² w², as a function of the joint.

        Parameters
        ----------
        measured
            H^x, shape (lines, outputs, inputs), m/N and so on.
        weight
            1/σ, same shape.
        """
        return self._form.misfit(measured, weight)
