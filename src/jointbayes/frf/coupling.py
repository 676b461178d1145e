"""Receptances by exact low-rank coupling of a joint to the structure without it.

H_ab = A_ab − A_aj (C + A_jj)⁻¹ A_jb with A the receptance without the joint and C = (K^J)⁻¹ (Woodbury),
written with K^J itself, A_aj K^J (1 + A_jj K^J)⁻¹ A_jb, so that an absent joint is as good as a stiff one.
An r × r problem per line, for any number of FE DOFs. Where the structure is itself uncertain, A is another one for
every draw, summed over the free modes.

H is a holomorphic function of the measured part of A, and dH_oi = p_oᵀ dA p_i with p the forces on a measured body's
DOFs when the assembled structure is driven by a unit force at a port. So errors that are complex circular stay so, and
to first order cov(H) = J Σ_A Jᴴ.
"""

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.frf.kernels.by_line import error_roots
from jointbayes.frf.kernels.compiled import compiled
from jointbayes.frf.kernels.multi_dof import MultiDofCoupling, MultiDofMisfit
from jointbayes.frf.kernels.pair import PairCoupling, PairMisfit
from jointbayes.frf.measured_body import AnyStructure, MeasuredBody, substructures
from jointbayes.frf.modal import AssembledModes, add_joint, chi2_of, compliance_by_line
from jointbayes.frf.ports import Ports, TakingPart, factors_batch
from jointbayes.joint import AnyJoint, AnyJointMatrix, JointMatrix, joint_matrix_of
from jointbayes.structure import Body, FreeModes
from vibrecords.arrays import Array, ComplexArray

_Coupling = PairCoupling | MultiDofCoupling

#: Receptances of so many structures are held in memory together.
_AT_ONCE = 16


@compiled
def _sum_modes(lam: Array, rate: Array, rows: Array, loss: float, omega: Array, out: ComplexArray) -> None:
    """Σ φ_a φ_b/(λ(1 + jη) − ω² + jωc) into `out` (lines, k, k), of modes λ, c (m,) and motions (k, m)."""
    k, m = rows.shape
    re, im = np.empty(m), np.empty(m)
    for line in range(len(omega)):
        w = omega[line]
        for s in range(m):
            a, b = lam[s] - w * w, lam[s] * loss + w * rate[s]
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
    body: Body, modes: FreeModes, factors: Array, omega: Array, *, hysteretic: bool = False
) -> ComplexArray:
    """Receptance without the joint, shape (n, lines, k, k), between k motions.

    Summed over the free modes, in which a loss factor and Rayleigh's damping are diagonal:
    A = Σ φ φᵀ/(λ(1 + jη) − ω² + jω(α + βλ)). Modal damping acts here in the free modes themselves, 2ζ√λ for
    α + βλ, the ratios those of the elastic modes in order.

    Parameters
    ----------
    body
        With any damping law but a matrix.
    modes
        Its free modes with the k motions.
    factors
        On the body's quantities, shape (n, q).
    omega
        Lines, shape (lines,), rad/s.
    hysteretic
        Whether the loss factor 2ζ of the first mode stands in for modal damping.
    """
    eigenvalues, motions = modes(factors)  # one for all where no factor changes them
    alpha, beta = body.damping.viscous
    # one row for all where no factor changes them
    ratios, losses = body.damping_ratios(factors, eigenvalues.shape[1]), body.loss_factors(factors)
    modal = body.damping.of_assembled_modes
    if modal and hysteretic:
        modal, losses = False, 2 * ratios[:, 0]
    ratios, losses = (np.broadcast_to(rows, (len(factors), *rows.shape[1:])) for rows in (ratios, losses))
    free = np.empty((len(factors), omega.size, motions.shape[1], motions.shape[1]), dtype=complex)
    for i, receptance in enumerate(free):
        lam = eigenvalues[min(i, len(eigenvalues) - 1)]
        rate = alpha + beta * lam
        if modal:
            elastic = np.flatnonzero(lam > 0)
            rate[elastic] = 2 * ratios[i, : elastic.size] * np.sqrt(lam[elastic])
        _sum_modes(
            lam, rate, np.ascontiguousarray(motions[min(i, len(motions) - 1)]), float(losses[i]), omega, receptance
        )
    return free


class LowRankCoupling:
    """Assembled receptance where damping belongs to the bodies without the joint.

    A of a measured body is what was measured; between two bodies it is zero.

    Parameters
    ----------
    structure
        Body with loss-factor or Rayleigh damping, or measured bodies next to a modelled one.
    joint
        Where the joint acts, r DOFs.
    ports
        Lines, outputs and inputs.

    Raises
    ------
    ModelError
        If the damping law is modal: its modes are those of the assembled structure, see `AssembledModes`; unless a body
        is measured. If a measured body lacks one of the lines. If quantities are uncertain with a damping matrix.
    """

    def __init__(self, structure: AnyStructure, joint: AnyJoint, ports: Ports) -> None:
        whole = substructures(structure)
        self._body = body = whole.modelled
        if body.damping.of_assembled_modes and not whole.measured:
            found, expected = "found modal damping of the assembled structure", "a loss factor or Rayleigh damping"
            raise ModelError.of("low-rank coupling", (), found, expected, "use the modal sum instead")
        if body.names and body.damping.matrix is not None:
            raise ModelError(
                f"low-rank coupling: found the uncertain quantities {', '.join(body.names)} with a damping matrix, "
                "which no modes diagonalise; expected another damping law, or nothing uncertain; change one of the two"
            )
        taking_part = TakingPart.of(whole, joint, ports.outputs + ports.inputs)
        #: Part of each output and input that is the joint's own motion, shape (r, outputs + inputs).
        self.along = taking_part.along
        #: Number of outputs; they come first.
        self.n_out = len(ports.outputs)
        #: Lines, shape (lines,), rad/s.
        self.omega = ports.omega
        driven, n = np.hstack([taking_part.joined, taking_part.rest]), body.n_dofs
        modelled = taking_part.dofs < n
        #: Measured bodies at the lines, each with the motion of its DOFs in the joint's motions and the ports'.
        self.bodies: list[tuple[MeasuredBody, Array]] = []
        for measured in whole.measured:
            of_body = np.zeros((len(measured.dofs), driven.shape[1]))
            rows = np.flatnonzero((taking_part.dofs >= n) & (taking_part.dofs < n + len(measured.dofs)))
            of_body[taking_part.dofs[rows] - n] = driven[rows]
            self.bodies.append((measured.at_lines(ports.frequency_hz), of_body))
            n += len(measured.dofs)
        dofs, driven, r = taking_part.dofs[modelled], driven[modelled], joint.size
        self._known: _Coupling | None = None
        self._free: ComplexArray | None = None
        solved = body.solved_receptance(dofs, driven, ports.omega)
        if solved is not None:
            self._free = self._coupled_to_bodies(solved)
        else:
            column = np.arange(driven.shape[1])
            self._modes = body.free_modes(dofs, driven, (column < r) | (column >= r + self.n_out))
            if not body.names:
                (self._free,) = self.free(np.empty((1, 0)))
        if self._free is not None:
            self._known = self._coupling(self._free)

    def free(self, factors: Array) -> ComplexArray:
        """Receptance without the joint, shape (n, lines, k, k), between the joint's r motions and the ports' rest.

        At factors on the structure's quantities, shape (n, q); (1, …) where they are the same for all.
        """
        if self._free is not None:
            return self._free[None]
        modelled = free_receptance(self._body, self._modes, factors, self.omega)
        return self._coupled_to_bodies(modelled) if self.bodies else modelled  # symmetric as it is

    def _coupled_to_bodies(self, modelled: ComplexArray) -> ComplexArray:
        for body, motions in self.bodies:
            modelled = modelled + motions.T @ body.receptance @ motions
        # reciprocity holds to the last bits if it holds here
        return (modelled + modelled.swapaxes(-1, -2)) / 2

    def receptance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> ComplexArray:
        """Receptances (batch, lines, outputs, inputs), see `AssembledModes`."""
        batch = joint_matrix_of(matrices).batch
        if self._known is None or batch.damped:
            return self._by_line(batch, factors)
        return self._known.receptance(batch.stiffness)

    def tangent(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[ComplexArray, ComplexArray]:
        """Receptance and its derivative along changes of one joint matrix, see `AssembledModes`."""
        joint, changes, factor_rows = joint_matrix_of(matrix), joint_matrix_of(directions), factors_batch(factors, 1)
        if not joint.damped:
            return (self._known or self._coupling_at(factor_rows[0])).tangent(joint.stiffness, changes.stiffness)
        (value,), (motion,) = add_joint(joint.batch, self.omega, self.free(factor_rows), self.along, self.n_out)
        # dH = −δ_oᵀ dD δ_i of the joint's motions δ, (r, lines, ports)
        delta = np.moveaxis(motion, 1, 0)
        at_outputs, at_inputs = delta[..., : self.n_out], delta[..., self.n_out :]
        slopes = np.empty((len(changes), *value.shape), dtype=complex)
        for i, slope in enumerate(slopes):  # of several joints each changes few rows
            change = changes[i]
            rows = np.flatnonzero(change.linked.any(axis=1))
            k, c, h = change[np.ix_(rows, rows)].sides
            dynamic = (k + 1j * h)[..., None] + 1j * c[..., None] * self.omega
            moved = np.einsum("pql,qli->pli", dynamic, at_inputs[rows])
            slope[:] = -np.einsum("plo,pli->loi", at_outputs[rows], moved)
        return value, slopes

    def misfit(self, measured: ComplexArray, weight: Array) -> "Misfit":
        """χ² against measured receptances (lines, outputs, inputs) with weights 1/σ, as a function of the joint."""
        undamped = self._known.misfit(measured, weight) if self._known else _UncertainMisfit(self, measured, weight)
        return Misfit(self, undamped, measured, weight)

    def _coupling_at(self, factors: Array) -> _Coupling:
        """Coupling of the structure at factors (q,)."""
        return self._coupling(self.free(factors[None])[0])

    def _by_line(self, matrices: JointMatrix, factors: ArrayLike | None) -> ComplexArray:
        """Receptances of a batch of joints, with damping or not, each solved at each line."""
        factor_rows, receptances = factors_batch(factors, len(matrices)), []
        for start in range(0, len(matrices), _AT_ONCE):
            batch = slice(start, start + _AT_ONCE)
            receptances.append(
                add_joint(matrices[batch], self.omega, self.free(factor_rows[batch]), self.along, self.n_out)[0]
            )
        return np.concatenate(receptances)

    def _coupling(self, free: ComplexArray) -> _Coupling:
        return (PairCoupling if len(self.along) <= 2 else MultiDofCoupling)(free, self.along, self.n_out)


class Misfit:
    """Weighted distance χ² = Σ |H − H^x|² w² of a forward model from measured receptances, as a function of the joint.

    It is fast for joints without damping, plain for joints with damping.
    """

    def __init__(
        self, model: LowRankCoupling, undamped: "_StiffnessMisfit", measured: ComplexArray, weight: Array
    ) -> None:
        self._model, self._undamped, self._measured, self._weight = model, undamped, measured, weight

    def chi2(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """χ², shape (batch,), of joint matrices, shape (batch, r, r), and factors on the structure, (batch, q).

        Not finite where a line is singular.
        """
        joints = joint_matrix_of(matrices)
        if not joints.damped:
            return self._undamped.chi2(joints.stiffness, factors)
        chi2, left = np.empty(len(joints)), np.arange(len(joints))
        if isinstance(self._undamped, MultiDofMisfit) and not self._model.along.any() and left.size:
            compliance, places, possible = compliance_by_line(joints, self._model.omega)
            chi2[possible] = self._undamped.yielding_chi2(compliance[possible], places)
            left = left[~possible]
        if left.size:
            row = factors_batch(factors, len(joints))[left]
            chi2[left] = chi2_of(self._model.receptance(joints[left], row), self._measured, self._weight)
        return chi2

    def chi2_gradient(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """χ² and its gradient S, shape (batch, r, r): dχ² = Σ S_ij dK_ij, of joints without damping."""
        return self._undamped.chi2_gradient(joint_matrix_of(matrices).stiffness, factors)


class _UncertainMisfit:
    """χ² = Σ |H − H^x|² w² as a function of joint and structure, both those of a draw."""

    def __init__(self, model: LowRankCoupling, measured: ComplexArray, weight: Array) -> None:
        self._model, self._measured, self._weight = model, measured, weight

    def chi2(self, stiffness: Array, factors: ArrayLike | None = None) -> Array:
        """χ², shape (batch,), see `Misfit`."""
        factor_rows = factors_batch(factors, len(stiffness))
        # a structure that serves one joint only is not worth what a coupling prepares for many
        batches = [slice(start, start + _AT_ONCE) for start in range(0, len(stiffness), _AT_ONCE)]
        values = (self._model._by_line(joint_matrix_of(stiffness[rows]), factor_rows[rows]) for rows in batches)
        return np.concatenate([np.empty(0), *(chi2_of(value, self._measured, self._weight) for value in values)])

    def chi2_gradient(self, stiffness: Array, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """χ² and its gradient by the joint, see `Misfit`."""
        factor_rows = factors_batch(factors, len(stiffness))
        terms = [self._coupling_at(row).chi2_gradient(k[None]) for k, row in zip(stiffness, factor_rows, strict=True)]
        return np.concatenate([chi2 for chi2, _ in terms]), np.concatenate([slope for _, slope in terms])

    def _coupling_at(self, factors: Array) -> PairMisfit | MultiDofMisfit:
        return self._model._coupling_at(factors).misfit(self._measured, self._weight)


_StiffnessMisfit = PairMisfit | MultiDofMisfit | _UncertainMisfit


ReceptanceModel = AssembledModes | LowRankCoupling
"""Receptance of a structure with its joint as a function of K^J."""


def receptance_model(structure: AnyStructure, joint: AnyJoint, ports: Ports) -> ReceptanceModel:
    """Return the exact low-rank forward model for the damping law of a structure, or for one with measured bodies.

    Raises
    ------
    ModelError
        If a DOF does not exist, or a measured body lacks one of the lines.
    """
    dofs = dict.fromkeys((*joint.labels, *ports.outputs, *ports.inputs))
    whole = substructures(structure).at(dofs, float(np.max(ports.frequency_hz)))
    if whole.modelled.damping.of_assembled_modes and not whole.measured:
        return AssembledModes(whole.modelled, joint, ports)
    return LowRankCoupling(whole, joint, ports)


class NoisePropagation:
    """Covariance of predicted receptances due to the errors of measured bodies, at each line.

    Parameters
    ----------
    model
        Forward model with measured bodies.
    """

    def __init__(self, model: LowRankCoupling) -> None:
        self._model = model
        bodies = [body for body, _ in model.bodies]
        self._motions = np.ascontiguousarray(np.concatenate([motions for _, motions in model.bodies]))
        sizes = [len(body.dofs) for body in bodies]
        starts = np.cumsum([0, *sizes[:-1]])
        # rows and columns of the measured receptances among the DOFs of all bodies, shape (2, E)
        self._entries = np.hstack(
            [start + np.array(np.triu_indices(m)) for start, m in zip(starts, sizes, strict=True)]
        )
        self._root = np.zeros((len(bodies[0].frequency_hz), self._entries.shape[1], self._entries.shape[1]))
        first = 0
        for root in map(_root, bodies):
            last = first + root.shape[-1]
            self._root[:, first:last, first:last] = root
            first = last

    def covariance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> ComplexArray:
        """E[δH δHᴴ], shape (batch, lines, pairs, pairs), of receptances in the order (outputs, inputs).

        For joint matrices (r, r) or (batch, r, r), and factors on the structure's quantities, (q,) or (batch, q).
        """
        roots = self.roots(matrices, factors)
        return roots @ roots.conj().swapaxes(-1, -2)

    def roots(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> ComplexArray:
        """R of which `covariance` is R Rᴴ, shape (batch, lines, pairs, measured receptances of all bodies)."""
        dynamic, model = self._dynamic(matrices), self._model
        free = self._model.free(factors_batch(factors, len(dynamic)))
        pairs = model.n_out * (model.along.shape[1] - model.n_out)
        roots = np.empty((len(dynamic), free.shape[1], pairs, self._entries.shape[1]), dtype=complex)
        with np.errstate(all="ignore"):  # a joint at which nothing is finite: its residuals are not either
            error_roots(dynamic, free, model.along, self._motions, self._entries, self._root, model.n_out, roots)
        return roots

    def relative_sd(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Standard deviation of det(1 + A_jj K) relative to itself, shape (batch, lines).

        The first order is not enough where it is no small number: near a resonance of the assembled structure.
        """
        k = self._dynamic(matrices)
        free, r = self._model.free(factors_batch(factors, len(k))), k.shape[-1]
        held = np.linalg.solve(np.eye(r) + k @ free[..., :r, :r], np.broadcast_to(k, (len(k), free.shape[1], r, r)))
        # d ln det(1 + A_jj K) = tr(K (1 + A_jj K)⁻¹ dA_jj)
        a, b = self._entries
        weight = (self._motions[:, :r] @ held @ self._motions[:, :r].T)[..., a, b] * np.where(a == b, 1.0, 2.0)
        variance = (np.abs((weight[..., None, :] @ self._root)[..., 0, :]) ** 2).sum(axis=-1)
        return np.asarray(np.sqrt(variance))

    def _dynamic(self, matrices: AnyJointMatrix) -> ComplexArray:
        """Dynamic stiffness of the joint, shape (batch, lines, r, r); (batch, 1, r, r) without damping."""
        batch = joint_matrix_of(matrices).batch
        if batch.damped:
            return batch.dynamic_stiffness(self._model.omega)
        return np.ascontiguousarray(batch.stiffness[:, None].astype(complex))


def _root(body: MeasuredBody) -> Array:
    """A matrix root of the covariance, which may be singular."""
    diagonal = np.diagonal(body.covariance, axis1=1, axis2=2)
    unit = np.eye(diagonal.shape[1])
    if not (body.covariance - diagonal[:, :, None] * unit).any():
        return np.sqrt(diagonal)[:, :, None] * unit
    # receptances of translations and rotations differ by orders of magnitude: scaled, the small ones keep their digits
    size = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(body.covariance / (size[:, :, None] * size[:, None, :]))
    return size[:, :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
