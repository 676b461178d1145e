"""Low-rank coupling where the structure without the joint is itself uncertain.

Its receptance A is then another one for every draw, summed over the free modes and coupled as ever.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf.coupling import free_receptance
from jointbayes.frf.kernels.multi_dof import MultiDofCoupling
from jointbayes.frf.kernels.pair import PairCoupling
from jointbayes.frf.ports import Misfit, Ports, as_batch, as_factors, split_along
from jointbayes.joint import Joint
from jointbayes.structure import StructureFamily

__all__ = ["UncertainCoupling"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class UncertainCoupling:
    """Assembled receptance of a family of structures with loss-factor or Rayleigh damping.

    Parameters
    ----------
    family
        Structures without the joint.
    joint
        Where the joint acts, r DOFs.
    ports
        Lines, outputs and inputs.
    """

    def __init__(self, family: StructureFamily, joint: Joint, ports: Ports) -> None:
        joined, outputs, inputs = ports.selections(family.nominal, joint)
        self._along, rest = split_along(np.hstack([outputs, inputs]), joined)
        self._family, self._modes = family, family.free_modes(np.hstack([joined, rest]))
        self._n_out, self._omega = len(ports.outputs), ports.omega
        self._pair = joined.shape[1] <= 2

    def receptance(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> ComplexArray:
        """Receptances (batch, lines, outputs, inputs), see `ReceptanceModel`."""
        matrices = as_batch(stiffness)
        known = as_factors(factors, len(matrices))
        return np.concatenate([self._coupled(row).receptance(k) for k, row in zip(matrices, known, strict=True)])

    def tangent(
        self, stiffness: ArrayLike, directions: ArrayLike, factors: ArrayLike | None = None
    ) -> tuple[ComplexArray, ComplexArray]:
        """Receptance and its derivative along changes of one joint matrix, see `ReceptanceModel`."""
        return self._coupled(as_factors(factors, 1)[0]).tangent(stiffness, directions)

    def misfit(self, measured: ComplexArray, weight: Array) -> "UncertainMisfit":
        """Weighted distance from measured receptances, see `Misfit`."""
        return UncertainMisfit(self, measured, weight)

    def _coupled(self, factors: Array) -> PairCoupling | MultiDofCoupling:
        """Coupling of the structure at factors (q,)."""
        free = free_receptance(self._family, self._modes, factors, self._omega)
        form = PairCoupling if self._pair else MultiDofCoupling
        return form(free, self._along, self._n_out)


class UncertainMisfit:
    """χ² = Σ |H − H^x|² w² as a function of joint and structure, one draw after the other."""

    def __init__(self, model: UncertainCoupling, measured: ComplexArray, weight: Array) -> None:
        self._model, self._measured, self._weight = model, measured, weight

    def chi2(self, stiffness: Array, factors: ArrayLike | None = None) -> Array:
        """χ², shape (batch,), see `Misfit`."""
        known = as_factors(factors, len(stiffness))
        each = zip(stiffness, known, strict=True)
        return np.concatenate([self._one(row).chi2(k[None]) for k, row in each])

    def chi2_gradient(self, stiffness: Array, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """χ² and its gradient by the joint, see `Misfit`."""
        known = as_factors(factors, len(stiffness))
        found = [self._one(row).chi2_gradient(k[None]) for k, row in zip(stiffness, known, strict=True)]
        return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])

    def _one(self, factors: Array) -> Misfit:
        return self._model._coupled(factors).misfit(self._measured, self._weight)
