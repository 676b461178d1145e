"""Receptances and natural frequencies from the modes of the assembled structure, rigid-body motions counted apart.

Joints with damping of their own have another complex matrix at every line, D = K + jωC + jH. With A the receptance
without the joint H_ab = A_ab − A_aj D (1 + A_jj D)⁻¹ A_jb. Where damping belongs to the assembled modes these are those
with K, and D = jωC + jH is added to them alike.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy  # its parts load at first use
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf.kernels.by_line import add_joints
from jointbayes.frf.kernels.modal_sum import ModalSum
from jointbayes.frf.kernels.secular import add_springs, springs, workspace
from jointbayes.frf.ports import Ports, TakingPart, factors_batch
from jointbayes.joint import AnyJoint, AnyJointMatrix, JointMatrix, joint_matrix_of, symmetric_changes
from jointbayes.structure import Body
from jointbayes.structure.body import MOST_HELD
from vibrecords.arrays import Array, ComplexArray, Flags

#: Largest diagonal of the inverse of K, scaled to a unit diagonal, for which digits enough are left.
_STIFFEST = 1e4


def compliance_by_line(matrices: JointMatrix, omega: Array) -> tuple[ComplexArray, NDArray[np.int64], Flags]:
    """Inverse of K + jωC + jH at each line, joint by joint of those that stand side by side; without C at one for all.

    Parameters
    ----------
    matrices
        Of a batch of joints, with damping.
    omega
        Lines, shape (lines,), rad/s.

    Returns
    -------
    compliance, places, possible_joints : ndarray, shapes (batch, entries, lines or 1), (entries, 2) and (batch,)
        Entries in the upper triangle, their rows and columns, and for which of the batch they are numbers.
    """
    if not matrices.sides[1].any():
        omega = omega[:1]
    count, label = scipy.sparse.csgraph.connected_components(matrices.linked, directed=False)
    possible_joints = np.ones(len(matrices), dtype=bool)
    values, places = [], []
    for block in range(count):
        rows = np.flatnonzero(label == block)
        yielding = matrices[:, rows[:, None], rows]
        elastic, dynamic = yielding.stiffness, yielding.dynamic_stiffness(omega)
        size = np.diagonal(dynamic, axis1=-2, axis2=-1)
        possible = (size != 0).all(axis=(1, 2)) & np.isfinite(dynamic).all(axis=(1, 2, 3))
        if rows.size > 1:  # of one row there is nothing to lose
            root = np.sqrt(np.maximum(np.diagonal(elastic, axis1=-2, axis2=-1), np.finfo(float).tiny))
            least = np.linalg.eigvalsh(elastic / root[:, :, None] / root[:, None, :])[:, 0]
            possible &= least > 1 / _STIFFEST
        possible_joints &= possible
        dynamic[~possible] = np.eye(rows.size)
        inverse = np.linalg.inv(dynamic) if rows.size > 1 else 1 / dynamic
        upper = np.triu_indices(rows.size)
        values.append(inverse[..., upper[0], upper[1]].swapaxes(1, 2))
        places.append(np.stack([rows[upper[0]], rows[upper[1]]], axis=1))
    return np.concatenate(values, axis=1), np.concatenate(places).astype(np.int64), possible_joints


def add_joint(
    matrices: JointMatrix, omega: Array, free: ComplexArray, along: Array, n_out: int
) -> tuple[ComplexArray, ComplexArray]:
    """Receptance between ports once a joint is added, and motion of the joint under load at each port.

    Parameters
    ----------
    matrices
        Of a batch of joints, with damping.
    omega
        Lines, shape (lines,), rad/s.
    free
        Receptance without the joint between its r motions and the q ports' other motions, of each joint or of all,
        shape (batch or 1, lines, r + q, r + q).
    along
        Part of each port's motion that is the joint's own, shape (r, q).
    n_out
        The first so many ports are outputs, the others inputs.

    Returns
    -------
    receptance, motion : ndarray, shapes (batch, lines, outputs, inputs) and (batch, lines, r, q)
    """
    batch, lines, (r, q) = len(matrices), len(omega), along.shape
    value = np.empty((batch, lines, n_out, q - n_out), dtype=np.complex128)
    motion = np.empty((batch, lines, r, q), dtype=np.complex128)
    every = np.ascontiguousarray(free)
    with np.errstate(all="ignore"):  # a joint at which nothing is finite: its receptances are not either
        k, c, h = map(np.ascontiguousarray, matrices.sides)
        add_joints(k, c, h, omega, every, np.ascontiguousarray(along), n_out, value, motion)
    return value, motion


def chi2_of(values: ComplexArray, measured: ComplexArray, weight: Array) -> Array:
    """Σ |H − H^x|² w², shape (batch,), of receptances (batch, lines, outputs, inputs)."""
    apart = (values - measured) * weight
    return np.asarray((apart.real**2 + apart.imag**2).sum(axis=(1, 2, 3)))


#: Motions of a joint below this share of the largest of their kind are rounding: a rigid-body motion has the error
#: of eigenvectors, up to 1e-6 where a fine mesh has eigenvalues of 10¹⁵.
_AT_REST = 1e-5


def rigid_body_modes(body: Body, joint: AnyJoint) -> int:
    """Number of rigid-body motions that a body has with its joint, for any stiffness of the joint.

    Examples
    --------
    >>> from jointbayes.joint import Joint
    >>> from jointbayes.structure import ModalDamping, chain
    >>> two = chain([1.0, 2.0], (), ModalDamping((0.01,))).structure()
    >>> rigid_body_modes(two, Joint(("2:x",), ("1:x",))), rigid_body_modes(two, Joint(("1:x",)))
    (1, 1)
    """
    return _left_free(body, TakingPart.of(body, joint))


def least_reach_hz(body: Body, joint: AnyJoint, count: int) -> float:
    """A frequency above the first `count` elastic modes of a body with its joint, Hz: no more than that takes.

    Held at r DOFs a body has no natural frequency above the one that was r places later: what is higher is none of
    the modes, and its own changes with uncertain quantities are the least smooth.
    """
    return body.reach_hz(max(1, count + rigid_body_modes(body, joint) + joint.size - MOST_HELD))


def _left_free(body: Body, taking_part: TakingPart) -> int:
    """Number of rigid-body motions in which the joint does not move."""
    free = body.rigid_motions(taking_part.dofs)
    # translations and rotations have different units
    size = np.abs(free).max(axis=1, keepdims=True, initial=0.0)
    rigid = taking_part.joined.T @ free
    scale = np.abs(taking_part.joined).T @ size
    held = np.linalg.svd(rigid / np.where(scale > 0, scale, 1.0), compute_uv=False)
    return free.shape[1] - int((held > _AT_REST).sum())


#: Eigenvalues closer than this (relative) share one mode plane: their divided difference is the derivative.
_DEGENERATE = 1e-9
_STEP = 1e-5  # of a coordinate, in differences
_FEW_DOFS = 5  # of a joint: sums over its entries one by one cost no more there


class JoinedModes:
    """Assembled eigenvalues, and motions in the assembled modes, for any joint matrix from absent to rigid.

    In the free modes (eigenvalues Λ, shapes φ_j at the joint) the assembled eigenproblem is Λ + φ_jᵀ K^J φ_j: diagonal
    plus rank r, with as many rows as modes kept and no FE matrix in sight. It is solved spring by spring.

    Parameters
    ----------
    body
        Body without the joint.
    taking_part
        The joint's motions, r of them, and what else to know of each mode, q other ones without what is the joint's.
    forced
        At which of these forces act, shape (q,), in addition to those of the joint; by default at all.
    """

    def __init__(self, body: Body, taking_part: TakingPart, forced: Flags | None = None) -> None:
        self._shift, self._r = body.shift, taking_part.joined.shape[1]
        forces = None if forced is None else np.concatenate([np.ones(self._r, dtype=bool), forced])
        self._free = body.free_modes(taking_part.dofs, np.hstack([taking_part.joined, taking_part.rest]), forces)
        #: Rigid-body motions that the joint leaves: the first modes, which are not counted.
        self.rigid = _left_free(body, taking_part)

    def solve(
        self, matrices: Array, factors: ArrayLike | None = None, wanted: int | None = None
    ) -> tuple[Array, Array, Array]:
        """Assembled modes for joint matrices (batch, r, r), symmetric, and factors on the structure (batch, f).

        The first `wanted` of them, by default all m.

        Returns
        -------
        eigenvalues, rows, directions : ndarray, shapes (batch, m), (batch, r + q, m), (batch, r, r)
            Eigenvalues rising; in each mode of unit modal mass the stretch δ of each of the joint's springs and the q
            motions; and the directions L of the springs, δ = Lᵀx with x the joint's motion.
        """
        directions, stiffness = springs(matrices)
        free, motions = self._free(factors_batch(factors, len(matrices)))
        joined, rest = np.ascontiguousarray(motions[:, : self._r]), np.ascontiguousarray(motions[:, self._r :])
        batch, m = len(matrices), free.shape[1]
        lam = np.empty((batch, m))
        rows = np.empty((batch, motions.shape[1], m))
        work, w = workspace(m, rows.shape[1])
        wanted = min(wanted or m, m)
        add_springs(free, joined, rest, directions, stiffness, self._shift, wanted, lam, rows, work, w)
        if (released := np.flatnonzero((stiffness < 0).any(axis=1))).size:
            # a joint that releases energy is met on the way to another one only: the plain eigenproblem will do
            own = released if len(free) > 1 else np.zeros_like(released)
            held = joined[own]
            dense = np.eye(m) * free[own, None] + held.swapaxes(1, 2) @ matrices[released] @ held
            lam[released], vectors = np.linalg.eigh(dense)
            stretches = directions[released].swapaxes(1, 2) @ held
            rows[released] = np.concatenate([stretches, rest[own]], axis=1) @ vectors
        return lam[:, :wanted], rows[:, :, :wanted], directions


class LowestModes:
    """The lowest modes of a body with its joint; rigid-body motions of one that floats are none.

    Parameters
    ----------
    body, joint
        Body without the joint, and where the joint acts.
    count
        How many modes, from the lowest.
    dofs
        Labels of further DOFs that take part.
    top_hz
        Frequency up to which they are wanted; by default so high that all of them are exact. Those above are not, and
        may be fewer than `count`.

    Raises
    ------
    ModelError
        If a DOF does not exist, or the body has fewer DOFs than that.
    """

    def __init__(
        self, body: Body, joint: AnyJoint, count: int, dofs: Sequence[str] = (), top_hz: float | None = None
    ) -> None:
        top_hz = least_reach_hz(body, joint, count) if top_hz is None else top_hz
        self._assemble(body.at(dict.fromkeys((*joint.labels, *dofs)), top_hz), joint, dofs)
        n = self._body.n_dofs - self._modes.rigid
        if not 1 <= count <= n:
            raise ModelError.of("modes", (), f"found a count of {count}", f"1 to {n}")
        self._counted = slice(self._modes.rigid, self._modes.rigid + count)

    def _assemble(self, body: Body, joint: AnyJoint, dofs: Sequence[str]) -> None:
        self._body, self._modes = body, JoinedModes(body, TakingPart.of(body, joint))


class NaturalFrequencies(LowestModes):
    """Undamped natural frequencies of a body with its joint, see `LowestModes`."""

    def frequency_hz(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Frequencies, shape (batch, count), Hz.

        For joint matrices of shape (r, r) or (batch, r, r) and factors on the body's quantities, (q,) or (batch, q).
        """
        stiffness = np.ascontiguousarray(joint_matrix_of(matrices).batch.stiffness)
        eigenvalues, _, _ = self._modes.solve(stiffness, factors, self._counted.stop)
        return np.sqrt(np.maximum(eigenvalues[:, self._counted], 0.0)) / (2 * np.pi)

    def tangent(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Frequencies (count,) in Hz and their derivative (p, count) along changes dK^J (p, r, r)."""
        factor_rows = factors_batch(factors, 1)
        stiffness = joint_matrix_of(matrix).batch.stiffness
        (eigenvalues,), (rows,), (springs,) = self._modes.solve(stiffness, factor_rows, self._counted.stop)
        shapes = np.linalg.solve(springs.T, rows)[:, self._counted]
        frequency = np.sqrt(np.maximum(eigenvalues[self._counted], 0.0)) / (2 * np.pi)
        slope = np.einsum("ir,pij,jr->pr", shapes, joint_matrix_of(directions).stiffness, shapes)
        return frequency, slope / (8 * np.pi**2 * np.maximum(frequency, np.finfo(float).tiny))

    # as data of modes they are all there is
    modal_frequencies = predicted_values = frequency_hz


class AssembledModes:
    """Assembled receptance by the modal sum H_ab = Σ φ_ar φ_br / (ω_r² − ω² + 2jζ_r ω_r ω).

    Parameters
    ----------
    body
        Body with modal damping (of the assembled structure).
    joint
        Where the joint acts, r DOFs.
    ports
        Lines, outputs and inputs.

    Raises
    ------
    ModelError
        If the damping law is not modal: see `LowRankCoupling`.
    """

    def __init__(self, body: Body, joint: AnyJoint, ports: Ports) -> None:
        if not body.damping.of_assembled_modes:
            found = "found a loss factor or Rayleigh damping"
            raise ModelError.of("modal sum", (), found, "modal damping ratios", "use the low-rank coupling instead")
        taking_part = TakingPart.of(body, joint, ports.outputs + ports.inputs)
        self._along = taking_part.along
        forced = np.arange(self._along.shape[1]) >= len(ports.outputs)
        self._body, self._modes = body, JoinedModes(body, taking_part, forced)
        self._n_out, self._omega = len(ports.outputs), ports.omega
        self._sum = ModalSum(self._omega, self._n_out)

    def receptance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> ComplexArray:
        """Receptances, shape (batch, lines, outputs, inputs).

        For joint matrices of shape (r, r) or (batch, r, r) and factors on the body's quantities, (q,) or (batch, q).
        """
        batch = joint_matrix_of(matrices).batch
        if batch.damped:
            return self._damped(batch, factors)
        return self._sum.receptance(*self._assembled(batch.stiffness, factors))

    def _damped(self, matrices: JointMatrix, factors: ArrayLike | None) -> ComplexArray:
        """Receptances of a batch of joints with damping."""
        factor_rows, (r, q) = factors_batch(factors, len(matrices)), self._along.shape
        eigenvalues, rows, springs = self._modes.solve(np.ascontiguousarray(matrices.stiffness), factor_rows)
        ratios = self._ratios(factor_rows, eigenvalues.shape[1])
        # between the joint's own motions and the ports' others, as outputs and as inputs
        rows[:, :r] = np.linalg.solve(springs.swapaxes(1, 2), rows[:, :r])
        ratios = np.broadcast_to(ratios, eigenvalues.shape)
        receptance = np.empty((len(matrices), self._omega.size, self._n_out, q - self._n_out), dtype=np.complex128)
        for i, values in enumerate(receptance):  # one joint after the other: all motions at all lines fill the memory
            shapes = np.concatenate([rows[i], rows[i]])[None]
            row = np.ascontiguousarray(ratios[i : i + 1])
            every = self._sum_of_all.receptance(eigenvalues[i : i + 1], shapes, row)
            values[:] = add_joint(matrices[i : i + 1].dissipative, self._omega, every, self._along, self._n_out)[0][0]
        return receptance

    @cached_property
    def _sum_of_all(self) -> ModalSum:
        """Modal sum between the joint's motions and the ports'."""
        return ModalSum(self._omega, sum(self._along.shape))

    def misfit(self, measured: ComplexArray, weight: Array) -> "AssembledMisfit":
        """χ² against measured receptances (lines, outputs, inputs) with weights 1/σ, as a function of the joint."""
        return AssembledMisfit(self, measured, weight)

    def _assembled(self, matrices: Array, factors: ArrayLike | None) -> tuple[Array, Array, Array]:
        """Assembled eigenvalues (batch, m), shapes at outputs and inputs (batch, outputs + inputs, m), and ζ."""
        factor_rows = factors_batch(factors, len(matrices))
        eigenvalues, rows, springs = self._modes.solve(matrices, factor_rows)
        r = self._along.shape[0]
        shapes = rows[:, r:]
        if self._along.any():
            shapes = shapes + np.linalg.solve(springs, self._along[None]).swapaxes(1, 2) @ rows[:, :r]
        return eigenvalues, np.ascontiguousarray(shapes), self._ratios(factor_rows, eigenvalues.shape[1])

    def _ratios(self, factor_rows: Array, count: int) -> Array:
        """Damping ratios of the first modes, shape (n, count), 0 of rigid-body motions."""
        elastic = self._body.damping_ratios(factor_rows, count - self._modes.rigid)
        return np.ascontiguousarray(np.hstack([np.zeros((len(elastic), self._modes.rigid)), elastic]))

    def tangent(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[ComplexArray, ComplexArray]:
        """Receptance and its exact derivative along p changes of one joint matrix.

        Parameters
        ----------
        matrix
            Of one joint, r DOFs.
        directions
            Its changes, a batch of p.
        factors
            On the body's quantities, shape (q,).

        Returns
        -------
        receptance, derivative : ndarray, shapes (lines, outputs, inputs) and (p, lines, outputs, inputs)

        References
        ----------
        Fox, R. L., Kapoor, M. P. (1968). Rates of change of eigenvalues and eigenvectors. AIAA Journal
        6(12), 2426-2429. DOI 10.2514/3.5008
        """
        joint, changes, factor_rows = joint_matrix_of(matrix), joint_matrix_of(directions), factors_batch(factors, 1)
        if joint.damped:  # by differences: with the stiffness the modes change, and with them the structure's damping
            up, down = (self._damped(joint.moved(changes, step), factor_rows) for step in (_STEP, -_STEP))
            return self._damped(joint.batch, factor_rows)[0], (up - down) / (2 * _STEP)
        lam, at_joint, at_outputs, at_inputs = self._modes_at(joint, factor_rows)
        change, same, turn = turned_modes(lam, at_joint, changes.stiffness)
        d_out, d_in = at_outputs @ turn, at_inputs @ turn
        constants = at_outputs[:, None, :] * at_inputs[None, :, :]
        d_constants = d_out[:, :, None, :] * at_inputs + at_outputs[:, None, :] * d_in[:, None, :, :]
        # modes in one plane: f[λ_r, λ_s] = f'(λ_r), the diagonal r = s among them
        shared = np.einsum("or,prs,is->poir", at_outputs, np.where(same, change, 0.0), at_inputs)

        pairs = constants.shape[0] * constants.shape[1]
        rows = np.concatenate([constants[None], d_constants]).reshape(-1, pairs, lam.size)
        ratio = self._ratios(factor_rows, lam.size)[0]
        summed = self._sum.spread(lam, ratio, rows, shared.reshape(-1, pairs, lam.size))
        spread = summed.reshape(-1, self._omega.size, *constants.shape[:2])
        return spread[0], spread[1:]

    def chi2_slope(self, matrix: JointMatrix, measured: ComplexArray, weight: Array, factors: Array) -> Array:
        """Gradient S, shape (r, r), of Σ |H − H^x|² w²: dχ² = Σ S_ij dK_ij, of a joint without damping.

        That of each mode first, of which there are fewer than entries of the joint: see `tangent`.
        """
        lam, at_joint, at_outputs, at_inputs = self._modes_at(matrix, factors)
        unit, none = np.eye(lam.size)[:, None], np.zeros((lam.size, 1, lam.size))
        each = np.concatenate([unit[:1], unit, none]), np.concatenate([none, unit])
        value, rate = np.split(self._sum.spread(lam, self._ratios(factors, lam.size)[0], *each)[1:, :, 0], 2)
        constants = at_outputs[:, None, :] * at_inputs[None, :, :]
        weighed = 2 * ((np.einsum("ois,sl->loi", constants, value) - measured) * weight**2).conj()
        by_value = np.einsum("loi,sl->ois", weighed, value).real
        by_rate = np.einsum("loi,sl->ois", weighed, rate).real
        turned = at_outputs.T @ np.einsum("ois,is->os", by_value, at_inputs)
        turned += at_inputs.T @ np.einsum("ois,os->is", by_value, at_outputs)
        shared = np.einsum("or,oir->ri", at_outputs, by_rate) @ at_inputs
        same, gap = _gaps(lam)
        slope: Array = at_joint @ np.where(same, shared, turned / gap) @ at_joint.T
        return (slope + slope.T) / 2

    def _modes_at(self, matrix: JointMatrix, factor_rows: Array) -> tuple[Array, Array, Array, Array]:
        """Eigenvalues (m,) with one joint, and motions of unit modal mass at it, at the outputs and at the inputs."""
        (lam,), (rows,), (springs,) = self._modes.solve(matrix.batch.stiffness, factor_rows)
        r = self._along.shape[0]
        at_joint = np.linalg.solve(springs.T, rows[:r])
        shapes = rows[r:] + self._along.T @ at_joint
        return lam, at_joint, shapes[: self._n_out], shapes[self._n_out :]


def turned_modes(eigenvalues: Array, at_joint: Array, directions: Array) -> tuple[Array, Flags, Array]:
    """How modes turn into each other along changes of the joint.

    Parameters
    ----------
    eigenvalues
        Assembled eigenvalues, shape (m,).
    at_joint
        Motions of the joint in these modes, of unit modal mass, shape (r, m).
    directions
        Changes dK^J, shape (p, r, r).

    Returns
    -------
    change, same, turn : ndarray, shapes (p, m, m), (m, m), (p, m, m)
        φᵀ dK^J φ, whose diagonal are the derivatives of the eigenvalues; which modes have the same eigenvalue; and the
        matrix of dΦ = Φ turn, without the turn of modes of the same eigenvalue among themselves.
    """
    if len(at_joint) <= _FEW_DOFS:
        change = np.einsum("ir,pij,js->prs", at_joint, directions, at_joint)
    else:
        change = at_joint.T @ directions @ at_joint
    same, gap = _gaps(eigenvalues)
    return change, same, np.where(same, 0.0, change / gap)


def _gaps(eigenvalues: Array) -> tuple[Flags, Array]:
    """Which modes have the same eigenvalue, shape (m, m), and λ_s − λ_r in row r, 1 where they are the same."""
    lam = np.abs(eigenvalues)
    gap = eigenvalues[None, :] - eigenvalues[:, None]
    same = np.abs(gap) <= _DEGENERATE * np.maximum(lam[None, :], lam[:, None])
    return same, np.where(same, 1.0, gap)


class AssembledMisfit:
    """χ² = Σ |H − H^x|² w² as a function of the joint; `ModalSum` does the work on the lines."""

    def __init__(self, model: AssembledModes, measured: ComplexArray, weight: Array) -> None:
        self._model, self._measured, self._weight = model, measured, weight
        self._lines = model._sum.lines(measured, weight)

    def chi2(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """χ², shape (batch,), see `Misfit`."""
        joints = joint_matrix_of(matrices)
        if joints.damped:
            return chi2_of(self._model.receptance(joints, factors), self._measured, self._weight)
        return self._model._sum.chi2(*self._model._assembled(joints.stiffness, factors), self._lines)

    def chi2_gradient(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """χ² and its gradient by the joint, see `Misfit`."""
        stiffness = joint_matrix_of(matrices).stiffness
        factor_rows, gradient = factors_batch(factors, len(stiffness)), np.empty_like(stiffness)
        if stiffness.shape[-1] > _FEW_DOFS:
            for matrix, row, slope in zip(stiffness, factor_rows, gradient, strict=True):
                joint = joint_matrix_of(matrix)
                slope[:] = self._model.chi2_slope(joint, self._measured, self._weight, row[None])
            return self.chi2(stiffness, factor_rows), gradient
        changes = symmetric_changes(stiffness.shape[-1])
        for matrix, row, slope in zip(stiffness, factor_rows, gradient, strict=True):
            value, derivative = self._model.tangent(matrix, changes, row)
            residual = (value - self._measured) * self._weight**2
            slope[:] = 2 * np.einsum("loi,ploi->p", residual.conj(), derivative).real.reshape(matrix.shape)
        return self.chi2(stiffness, factor_rows), gradient
