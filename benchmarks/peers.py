"""Other ways to compute the FRF likelihood, as one would write them in NumPy; independent of the package's FRF code.

Each takes joint matrices K^J, shape (n, 2, 2), and returns ln L, shape (n,).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from jointbayes.inference import Problem
from jointbayes.structure import LossFactor, ModalDamping, Structure
from vibrecords import FrfData, quantity_factor

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
LogLikelihood = Callable[[Array], Array]

_LINES_AT_ONCE = 512  # keeps a block of dense matrices within a few megabytes


class Test:
    """What does not depend on the joint: matrices, selections, data and weights of a problem with one FRF."""

    def __init__(self, problem: Problem) -> None:
        measurement = problem.test.data
        assert isinstance(measurement, FrfData)
        frf = measurement.frf
        # the elements of the package's own forward model, so that likelihoods can be compared to rounding
        dofs = (*problem.test.joints.dofs, *problem.test.joints.against, *frf.outputs, *frf.inputs)
        structure = problem.test.structures.at(dofs, measurement.top_hz).certain()
        assert isinstance(structure, Structure)
        if frf.values[0].size != 1:
            raise ValueError(f"peers: found {frf.values[0].size} FRFs; expected one")
        self.omega = 2 * np.pi * np.asarray(frf.frequency_hz)
        factor = quantity_factor(frf.frequency_hz, frf.quantity)
        self.measured = frf.values[:, 0, 0] / factor
        self.variance = measurement.variance[:, 0, 0] / np.abs(factor) ** 2
        self.constant = -float(np.log(np.pi * measurement.variance).sum())
        self.structure = structure
        self.stiffness, self.mass, self.law = structure.stiffness, structure.mass, structure.damping
        self.joined = problem.test.joints.selection(structure)
        self.out, self.into = (np.eye(structure.n_dofs)[:, structure.index(d)] for d in (frf.outputs, frf.inputs))
        self.modes = structure.modes

    def log_likelihood(self, receptance: Complex) -> Array:
        """ln L of receptances, shape (..., lines)."""
        difference = receptance - self.measured
        value: Array = self.constant - ((difference.real**2 + difference.imag**2) / self.variance).sum(axis=-1)
        return value

    def static_and_viscous(self, matrix: Array | None) -> tuple[Complex, Array]:
        """K, complex with a loss factor, and C; with the joint K^J, shape (2, 2), or without any."""
        added = np.zeros_like(self.stiffness) if matrix is None else self.joined @ matrix @ self.joined.T
        stiffness = self.stiffness + added
        if isinstance(self.law, LossFactor):
            return stiffness + 1j * self.law.loss_factor * self.stiffness, np.zeros_like(stiffness)
        assert isinstance(self.law, ModalDamping)
        modes = self.modes(added)
        weighted = self.mass @ modes.shapes
        rate = 2 * self.law.per_mode(len(stiffness)) * np.sqrt(modes.eigenvalues)
        return stiffness.astype(complex), (weighted * rate) @ weighted.T

    def free(self) -> tuple[Complex, Complex, Complex]:
        """Receptances without the joint: A_jj (lines, 2, 2), A_jp (lines, 2, 2) and A_oi (lines,).

        The columns of A_jp are the input and the output; o is the output, i the input.
        """
        ports = np.hstack([self.joined, self.into, self.out])
        static, viscous = self.static_and_viscous(None)
        assert not viscous.any()
        blocks = []
        for start in range(0, self.omega.size, _LINES_AT_ONCE):
            w = self.omega[start : start + _LINES_AT_ONCE, None, None]
            z = static - w**2 * self.mass
            blocks.append(ports.T @ np.linalg.solve(z, ports.astype(complex)))
        a = np.concatenate(blocks)
        return a[:, :2, :2], a[:, :2, 2:], a[:, 3, 2]


def dense_loop(test: Test) -> LogLikelihood:
    """Assemble, and solve the dense dynamic stiffness line by line: what one writes first."""

    def log_likelihood(matrices: Array) -> Array:
        values = np.empty((len(matrices), test.omega.size), dtype=complex)
        for row, matrix in zip(values, matrices, strict=True):
            static, viscous = test.static_and_viscous(matrix)
            for i, w in enumerate(test.omega):
                z = static - w**2 * test.mass + 1j * w * viscous
                row[i] = (test.out.T @ np.linalg.solve(z, test.into))[0, 0]
        return test.log_likelihood(values)

    return log_likelihood


def dense_batched(test: Test) -> LogLikelihood:
    """Assemble, and solve the dense dynamic stiffness of many lines in one call of `numpy.linalg.solve`."""
    into = test.into.astype(complex)

    def log_likelihood(matrices: Array) -> Array:
        values = np.empty((len(matrices), test.omega.size), dtype=complex)
        for row, matrix in zip(values, matrices, strict=True):
            static, viscous = test.static_and_viscous(matrix)
            for start in range(0, test.omega.size, _LINES_AT_ONCE):
                w = test.omega[start : start + _LINES_AT_ONCE, None, None]
                z = static - w**2 * test.mass + 1j * w * viscous
                row[start : start + _LINES_AT_ONCE] = (test.out.T @ np.linalg.solve(z, into))[:, 0, 0]
        return test.log_likelihood(values)

    return log_likelihood


def modal_sum(test: Test, count: int | None = None) -> LogLikelihood:
    """Modal damping: eigensolution of the assembled matrices by SciPy, and the sum over all modes, or the lowest."""
    assert isinstance(test.law, ModalDamping)
    ratio = test.law.per_mode(len(test.mass))[:count]
    lowest = None if count is None else [0, count - 1]

    def log_likelihood(matrices: Array) -> Array:
        values = np.empty((len(matrices), test.omega.size), dtype=complex)
        for row, matrix in zip(values, matrices, strict=True):
            stiffness = test.stiffness + test.joined @ matrix @ test.joined.T
            squared, shapes = linalg.eigh(stiffness, test.mass, subset_by_index=lowest)
            constants = (test.out.T @ shapes)[0] * (test.into.T @ shapes)[0]
            natural = np.sqrt(np.maximum(squared, 0.0))
            denominator = squared[:, None] - test.omega**2 + 2j * (ratio * natural)[:, None] * test.omega
            row[:] = constants @ (1 / denominator)
        return test.log_likelihood(values)

    return log_likelihood


def batched_solve(test: Test) -> LogLikelihood:
    """Loss factor: low-rank coupling, its 2 × 2 systems of all lines and joints by `numpy.linalg.solve`."""
    a_jj, a_jp, a_oi = test.free()
    into, out = a_jp[:, :, :1], a_jp[:, :, 1]

    def log_likelihood(matrices: Array) -> Array:
        compliance = np.linalg.inv(matrices)
        at_joint = np.linalg.solve(compliance[:, None] + a_jj, np.broadcast_to(into, (len(matrices), *into.shape)))
        return test.log_likelihood(a_oi - (out * at_joint[..., 0]).sum(axis=-1))

    return log_likelihood


def closed_form(test: Test) -> LogLikelihood:
    """Loss factor: the 2 × 2 inverse written out, H = A − N/D, joint by joint so that a joint stays in the cache."""
    a_jj, a_jp, a_oi = test.free()
    a11, a12, a22 = (np.ascontiguousarray(a) for a in (a_jj[:, 0, 0], a_jj[:, 0, 1], a_jj[:, 1, 1]))
    in_1, in_2, out_1, out_2 = (np.ascontiguousarray(a_jp[:, i, k]) for k in (0, 1) for i in (0, 1))
    # N is linear in the compliance: one product for each of c11, c12 and c22
    from_11, from_12, from_22 = out_2 * in_2, -(out_1 * in_2 + out_2 * in_1), out_1 * in_1
    fixed = from_11 * a11 + from_12 * a12 + from_22 * a22

    def log_likelihood(matrices: Array) -> Array:
        result = np.empty(len(matrices))
        for i, ((c11, c12), (_, c22)) in enumerate(np.linalg.inv(matrices)):
            numerator = fixed + c11 * from_11 + c12 * from_12 + c22 * from_22
            mixed = c12 + a12
            result[i] = test.log_likelihood(a_oi - numerator / ((c11 + a11) * (c22 + a22) - mixed * mixed))
        return result

    return log_likelihood
