"""Starts for many unknowns: forces and motions of the joints are reconstructed from the data.

The paper's iteration is linear in the stiffness because it takes the joints' motion from measurement. Here nobody
measured it. With A the receptance without the joints, forces f in them leave the data H^x = A_oi − A_oj f and move them
by δ = A_ji − A_jj f; a joint with the dynamic stiffness D has f = D δ. At each line the f is taken that makes the
squares of both least, (H^x − A_oi + A_oj f)/σ and e = (K + K_0)⁻¹ (f − D δ) over a tolerance: for a given f this is
linear in the springs' rigidity k/(k + k_0), and no resonance of the model stands between a start and the mode. With
the tolerance going to zero it becomes the misfit of the FRFs.

References
----------
van Leeuwen, T., Herrmann, F. J. (2013). Mitigating local minima in full-waveform inversion by expanding the search
space. Geophysical Journal International 195(1), 661-667. DOI 10.1093/gji/ggt258
Golub, G. H., Pereyra, V. (2003). Separable nonlinear least squares: the variable projection method and its
applications. Inverse Problems 19(2), R1-R26. DOI 10.1088/0266-5611/19/2/201
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any

import numpy as np
import scipy  # its parts load at first use
from numpy.typing import NDArray

from jointbayes.frf import AnyStructure, LowRankCoupling, Ports
from jointbayes.frf.coupling import free_receptance
from jointbayes.frf.measured_body import substructures
from jointbayes.inference import JointPrior, Problem
from jointbayes.inference.climb import MANY_UNKNOWNS
from jointbayes.joint import AnyJoint, JointMatrix
from vibrecords import FrfData, quantity_factor
from vibrecords.arrays import Array, ComplexArray, Indices


def measured_receptances(
    structure: AnyStructure, joint: AnyJoint, data: FrfData
) -> "tuple[ComplexArray, Array, FreeReceptance]":
    """Measured receptances and their σ, each (lines, outputs, inputs), and those of the structure without the joint.

    Parameters
    ----------
    structure, joint
        Structure without the joints, and where these act. Modal damping of the assembled structure has no counterpart
        without them; the loss factor 2ζ of its first mode stands in.
    data
        FRFs with variances.
    """
    frf = data.frf.converted("receptance")
    sigma = np.sqrt(data.variance) / np.abs(quantity_factor(frf.frequency_hz, data.frf.quantity)[:, None, None])
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    whole = substructures(structure).at((*joint.labels, *frf.outputs, *frf.inputs), float(frf.frequency_hz[-1]))
    if whole.measured:  # next to a modelled body, whose uncertain quantities are as stated
        model, r = LowRankCoupling(whole, joint, ports), joint.size
        motions = np.vstack([model.along, np.eye(model.along.shape[1])])
        (free,) = model.free(np.ones((1, len(whole.modelled.names))))
        driven = free @ motions
        outputs, inputs = slice(None, model.n_out), slice(model.n_out, None)
        oj, ji = driven[:, :r, outputs].swapaxes(1, 2), driven[:, :r, inputs]
        blocks = FreeReceptance(free[:, :r, :r], oj, ji, motions[:, outputs].T @ driven[:, :, inputs])
        return frf.values, sigma, blocks
    # the joint's DOFs stand first among outputs and inputs
    body, sides = whole.modelled.certain(), joint.labels
    of_outputs, of_inputs = (tuple(dict.fromkeys(sides + labels)) for labels in (frf.outputs, frf.inputs))
    # summed over free modes: a dense solution of every line would cost more than the whole search
    places = body.index(of_outputs + of_inputs)
    dofs, k, n, at = np.unique(places), len(of_outputs), len(sides), np.arange(len(places))
    modes = body.free_modes(dofs, (dofs[:, None] == places).astype(float), (at < n) | (at >= k))
    free = free_receptance(body, modes, np.empty((1, 0)), ports.omega, hysteretic=True)[0, :, :k, k:]
    relative = joint.deformations(sides).T
    rows = [of_outputs.index(label) for label in frf.outputs]
    columns = [of_inputs.index(label) for label in frf.inputs]
    jj, oj = relative @ free[:, :n, :n] @ relative.T, free[:, rows, :n] @ relative.T
    return frf.values, sigma, FreeReceptance(jj, oj, relative @ free[:, :n, columns], free[:, rows][:, :, columns])


@dataclass(frozen=True, slots=True)
class FreeReceptance:
    """Receptance without the joint, cut into the blocks between joint, outputs and inputs, at each line."""

    jj: ComplexArray
    oj: ComplexArray
    ji: ComplexArray
    oi: ComplexArray


_LINES = 80  # looked at, equally spaced: what resonates between them does not matter under the first tolerance
_MODEL_ERROR = 0.03  # of an FRF, in addition to its noise
#: Of e, in units of the motion that unit forces at the inputs give the joints without stiffness; the first that counts.
_FIRST, _LATER = 3.0, (1.0, 0.1, 0.01)
_POINTS, _KEPT = 16, 3  # of the prior, and ends of their climbs that go on
_NEARLY_RIGID = 0.97
_STEPS = 15
_FARTHEST = 0.3  # of one step in any coordinate, which all run from 0 to 1
_DAMPING = np.array([1e-2, 0.3, 10.0, 1e3])  # factors on the damping of a step: all are tried
_GAIN = 0.02  # of what is left of the misfit: a climb that gains less has arrived
_PLACES = (0.03, 0.15, 0.35, 0.6, 0.85, 0.99)  # of one coordinate with the others as they are
_ELSEWHERE, _TRIED, _ROUNDS = 0.08, 4, 12
_SETS = 66  # of coordinates that are moved together: all pairs of twelve
_SAME = 0.05
_NEARLY_NONE = 1e-12  # of the structure's own stiffness: so much has any joint
_WIDE = 4.0  # prior standard deviations, where a prior has no ends
_AT_ONCE = 3_000_000  # complex numbers held in memory together


def reconstructed_starts(problem: Problem, rng: np.random.Generator, effort: int = 1) -> Array:
    """Points from which to climb the posterior, shape (n, d).

    None where few coordinates are unknown, or the data are no FRFs. Nearly rigid joints and sixteen Sobol points of
    the prior climb with the first tolerance; from the three best ends single coordinates are moved elsewhere and climb
    again, as long as that gains; then the tolerance falls. What is uncertain besides the joints stays at the mean of
    its prior. Where two springs must change together no single one gains: with more effort pairs are moved as well, of
    more than twelve unknowns some pairs drawn at random.

    Parameters
    ----------
    problem
        The problem.
    rng
        Scrambles the points of the prior.
    effort
        How many times as many points, a power of 2; above 1 twice as many ends.
    """
    count = len(problem.parametrisation.names)
    with_frfs = [part for part in problem.parts if part.test.data.frfs and part.test.joints.size]
    if count < MANY_UNKNOWNS or not with_frfs:
        return np.empty((0, len(problem.names)))
    misfit = _Misfit(problem, [_TestData.from_problem(part) for part in with_frfs])
    starts = misfit.inside(scipy.stats.qmc.Sobol(count, seed=rng).random(effort * _POINTS))
    starts = [misfit.nearly_rigid(), *starts]
    ends = sorted((misfit.climb(x, _FIRST) for x in starts), key=lambda end: end[1])
    chosen: list[tuple[Array, float]] = []
    for x, value in ends:
        if all(np.abs(x - elsewhere).max() > _SAME for elsewhere, _ in chosen) and np.isfinite(value):
            chosen.append((x, value))
    chosen = [_moved_elsewhere(misfit, *end, 1) for end in chosen[: min(effort, 2) * _KEPT]]
    chosen.sort(key=lambda end: end[1])
    if effort > 1:
        chosen[:_KEPT] = [_moved_elsewhere(misfit, *end, 2, rng) for end in chosen[:_KEPT]]
    thetas = []
    for x, _ in chosen:
        for tolerance in _LATER:
            x, _ = misfit.climb(x, tolerance)
        thetas.append(misfit.theta(x))
    return np.array(thetas).reshape(-1, len(problem.names))


def _moved_elsewhere(
    misfit: "_Misfit", x: Array, value: float, together: int, rng: np.random.Generator | None = None
) -> tuple[Array, float]:
    """A better end of a climb from points that differ from x in so many coordinates, and so on from there."""
    sets = np.array(list(combinations(range(x.size), together)))
    if rng is not None and len(sets) > _SETS:
        sets = rng.permutation(sets)[:_SETS]
    steps = np.array(list(product(_PLACES, repeat=together)))
    rows = np.arange(len(sets))
    for _ in range(_ROUNDS // together**2):
        places = np.tile(x, (len(sets), len(steps), 1))
        for column, values in zip(sets.T, steps.T, strict=True):
            places[rows, :, column] = values
        places = misfit.clipped(places)
        values = misfit.values_near(x, places, _FIRST)
        values[np.abs(places - x).max(axis=-1) < _ELSEWHERE] = np.inf
        best = np.argmin(values, axis=1)
        first = np.argsort(values[rows, best])[: together * _TRIED]
        ends = [misfit.climb(places[i, best[i]], _FIRST) for i in first if np.isfinite(values[i, best[i]])]
        if not ends:
            break
        end = min(ends, key=lambda end: end[1])
        if not end[1] < (1 - _GAIN) * value:
            break
        x, value = end
    return x, value


@dataclass(frozen=True, slots=True, eq=False)
class _TestData:
    """Data of one test at some lines, and its structure without the joints."""

    prior: JointPrior
    omega: Array
    free: FreeReceptance
    off: ComplexArray
    """Data less the receptance without the joints, shape (lines, outputs, inputs)."""
    variance: Array
    """Of these, shape (lines, outputs)."""
    body_stiffness: Array
    """Stiffness of the structure at each DOF of the joints, shape (R,)."""
    size: Array
    """Motion of these under unit forces at the inputs, shape (R,)."""

    @classmethod
    def from_problem(cls, part: Problem) -> "_TestData":
        data = part.test.data.frfs
        assert data is not None
        measured, sigma, free = measured_receptances(part.test.structure, part.test.joints, data)
        lines = data.frf.frequency_hz
        some = slice(None, None, max(1, lines.size // _LINES))
        free = FreeReceptance(free.jj[some], free.oj[some], free.ji[some], free.oi[some])
        variance = (sigma[some] ** 2 + (_MODEL_ERROR * np.abs(measured[some])) ** 2).mean(axis=2)
        stiffness = 1 / np.median(np.abs(np.einsum("lrr->lr", free.jj)), axis=0)
        size = np.median(np.abs(free.ji), axis=0).mean(axis=1)
        # a port on a joint's own DOF may be nowhere else
        size = np.where(size > 0, size, np.finfo(float).tiny)
        return cls(part.prior, 2 * np.pi * lines[some], free, measured[some] - free.oi, variance, stiffness, size)

    def value(self, theta: Array, tolerance: float) -> Array:
        """Least squares, shape (n,), at θ, shape (n, d)."""
        compliance, softness = self._softness(self.prior.matrix(theta))
        along = self._along(compliance)
        return self._squares(self.off + along @ self.free.ji, _product(along, softness), tolerance)

    def values_near(self, theta: Array, moved: Array, tolerance: float) -> Array:
        """Least squares, shape (sets, n), at points (sets, n, d): each set moves few of the joints away from θ (d,).

        The inverse at θ serves for all: what changes has the rank of the joints that move.
        """
        base = self.prior.matrix(theta[None])
        compliance, softness = self._softness(base)
        inverse = np.linalg.inv(compliance[0] + self.free.jj)
        along, yielding = self.free.oj @ inverse, _product(inverse[None], softness)[0]
        off, motion = self.off + along @ self.free.ji, inverse @ self.free.ji
        spread, linked = _product(along[None], softness)[0], (compliance != 0).any(axis=(0, 1))
        values = np.empty(moved.shape[:2])
        for value, points in zip(values, moved, strict=True):
            joints = self.prior.matrix(points)
            rows = np.flatnonzero(linked[:, joints.moved(base, -1.0).linked.any(axis=0)].any(axis=1))
            block = rows[:, None], rows
            stiffer, softer = self._softness(joints[:, *block], rows)
            change, own = stiffer - compliance[..., *block], inverse[:, *block]
            # (M + dC)⁻¹ = Z − Z dC (1 + Z dC)⁻¹ Z of Z = M⁻¹, at the rows that change
            factor = _from_the_right(along[..., rows] @ change, np.eye(rows.size) + own @ change)
            spreads = spread - factor @ yielding[:, rows]
            spreads[..., rows] += (along[..., rows] - factor @ own) @ (softer - softness[..., *block])
            value[:] = self._squares(off - factor @ motion[:, rows], spreads, tolerance)
        return values

    def linearised(self, theta: Array, tolerance: float) -> tuple[Array, Array]:
        """Residuals, shape (m,), and their derivative by the joints' coordinates, (m, count), for fixed forces."""
        compliance, softness = self._softness(self.prior.matrix(theta[None]))
        along = self._along(compliance)
        spread = _product(along, softness)[0]
        off, root = self.off + along[0] @ self.free.ji, self._root(spread[None], tolerance)[0]
        residual = np.linalg.solve(root, off)
        weighed = np.linalg.solve(root.conj().swapaxes(-1, -2), residual)
        error = -((tolerance * self.size[:, None]) ** 2) * (spread.conj().swapaxes(-1, -2) @ weighed)
        force = np.linalg.solve(compliance[0] + self.free.jj, self.free.ji + softness[0] @ error)
        motion = self.free.ji - self.free.jj @ force
        # G de = A_oj (1 + D A_jj)⁻¹ (dK e + dD δ) by coordinates, shape (lines, outputs, inputs, count)
        changes = self.prior.parametrisation.changes(self.prior.joint(theta))
        rows, columns = np.nonzero(changes.linked)  # of several joints each coordinate changes few entries
        k, c, h = (side[:, rows, columns].T for side in changes.sides)
        outputs = _product(along, compliance)[0][:, :, None, rows]

        def at_entries(values: ComplexArray) -> ComplexArray:
            return outputs * values[:, columns].swapaxes(1, 2)[:, None]

        moved = at_entries(error + motion) @ k
        if changes.damped:
            damped = at_entries(motion)
            moved = moved + 1j * (damped @ h) + 1j * self.omega[:, None, None, None] * (damped @ c)
        slope = np.linalg.solve(root, moved.reshape(*root.shape[:2], -1)).reshape(-1, moved.shape[-1])
        residual = residual.ravel()
        return np.concatenate([residual.real, residual.imag]), np.concatenate([slope.real, slope.imag])

    def _softness(
        self, matrices: JointMatrix, rows: Indices | slice = slice(None)
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """C = D⁻¹, shape (n, lines, R, R) or (n, 1, R, R) where it is the same at all, and C (K + K_0)."""
        own = np.diag(self.body_stiffness[rows])
        _, viscous, hysteretic = matrices.sides
        if viscous.any():
            dynamic: NDArray[Any] = matrices.dynamic_stiffness(self.omega)
        else:
            dynamic = matrices.stiffness[:, None] + (1j * hysteretic[:, None] if matrices.damped else 0.0)
        compliance = np.linalg.inv(dynamic + _NEARLY_NONE * own)  # of a joint without any stiffness as well
        return compliance, compliance @ (matrices.stiffness + own)[:, None]

    def _along(self, compliance: NDArray[Any]) -> ComplexArray:
        """A_oj (C + A_jj)⁻¹, shape (n, lines, outputs, R)."""
        return _from_the_right(self.free.oj, compliance + self.free.jj)

    def _root(self, spread: ComplexArray, tolerance: float) -> ComplexArray:
        """Cholesky factor of the covariance of the data less the model, (n, lines, outputs, outputs)."""
        scaled = spread * (tolerance * self.size)
        covariance = scaled @ scaled.conj().swapaxes(-1, -2)
        outputs = np.arange(covariance.shape[-1])
        covariance[..., outputs, outputs] += self.variance
        return np.asarray(np.linalg.cholesky(covariance), dtype=complex)

    def _squares(self, off: ComplexArray, spread: ComplexArray, tolerance: float) -> Array:
        """Least squares, shape (n,), of the data less the model, (n, lines, outputs, inputs), and −G."""
        white = np.linalg.solve(self._root(spread, tolerance), off)
        return np.asarray((white.real**2 + white.imag**2).sum(axis=(1, 2, 3)))


def _product(left: ComplexArray, right: NDArray[Any]) -> ComplexArray:
    """Matrix products (n, lines, m, R) @ (n, lines or 1, R, R): of one for all lines a single product for each n."""
    if right.shape[1] > 1:
        return left @ right
    n, lines, m, r = left.shape
    return np.asarray((left.reshape(n, lines * m, r) @ right[:, 0]).reshape(left.shape))


def _from_the_right(left: NDArray[Any], matrix: NDArray[Any]) -> ComplexArray:
    """left @ matrix⁻¹."""
    return np.asarray(np.linalg.solve(matrix.swapaxes(-1, -2), left.swapaxes(-1, -2)).swapaxes(-1, -2))


class _Misfit:
    """The squares of all tests as a function of coordinates x that run from 0 to 1.

    Of the logarithm of a stiffness x is its rigidity k/(k + k_0), with k_0 the structure's own stiffness there: as x
    it moves the FRFs at both ends, where its logarithm hardly does. Any other coordinate is x of its prior's width.
    """

    def __init__(self, problem: Problem, parts: Sequence[_TestData]) -> None:
        self._prior, self._parts = problem.prior, parts
        self._count = count = len(problem.parametrisation.names)
        low, high = (end[:count] for end in problem.prior.support)
        mean, sd = problem.prior.mean[:count], problem.prior.sd[:count]
        self._low = np.where(np.isfinite(low), low, mean - _WIDE * sd)
        self._high = np.where(np.isfinite(high), high, mean + _WIDE * sd)
        self._own = np.full(count, np.nan)  # ln k_0
        for data in parts:
            quantities = {q.name: q for q in data.prior.parametrisation.quantities}
            for i, axis in enumerate(data.prior.parametrisation.axes):
                quantity = quantities[axis.quantity]
                if axis.logarithmic and quantity.role == "stiffness" and quantity.places and np.isnan(self._own[i]):
                    row, column = quantity.places[0]
                    self._own[i] = np.log(data.body_stiffness[row] * data.body_stiffness[column]) / 2
        self._springs = np.isfinite(self._own)
        self._ends = self._unit_coordinates(self._low), self._unit_coordinates(self._high)

    def _unit_coordinates(self, joint: Array) -> Array:
        x = (joint - self._low) / (self._high - self._low)
        return np.where(self._springs, 1 / (1 + np.exp(np.where(self._springs, self._own - joint, 0.0))), x)

    def theta(self, x: Array) -> Array:
        """θ, shape (…, d), of x, shape (…, count)."""
        inner = np.clip(x, 1e-12, 1 - 1e-12)
        rigid = np.where(self._springs, self._own, 0.0) + np.log(inner) - np.log1p(-inner)
        joint = np.where(self._springs, rigid, self._low + x * (self._high - self._low))
        margin = 1e-6 * (self._high - self._low)
        joint = np.clip(joint, self._low + margin, self._high - margin)
        rest = np.broadcast_to(self._prior.mean[self._count :], (*x.shape[:-1], self._prior.mean.size - self._count))
        return np.concatenate([joint, rest], axis=-1)

    def clipped(self, x: Array) -> Array:
        """The nearest x within the prior's ends."""
        return np.clip(x, *self._ends)

    def inside(self, unit: Array) -> list[Array]:
        """Points of the prior, each shape (count,), for points of the unit cube, shape (n, count)."""
        whole = np.full((len(unit), self._prior.mean.size), 0.5)
        whole[:, : self._count] = unit
        return list(self.clipped(self._unit_coordinates(self._prior.joint(self._prior.transform(whole)))))

    def nearly_rigid(self) -> Array:
        """All springs nearly rigid, everything else in the middle, shape (count,)."""
        return self.clipped(np.where(self._springs, _NEARLY_RIGID, 0.5))

    def value(self, x: Array, tolerance: float) -> Array:
        """Squares, shape (n,), at x, shape (n, count); infinite where there is no joint."""
        theta = self.theta(x)
        squares = np.full(len(x), np.inf)
        inside = np.flatnonzero(self._prior.feasible(theta))
        size = max(data.free.jj.size for data in self._parts)
        for few in np.array_split(inside, max(1, -(-inside.size * size // _AT_ONCE))):
            if few.size:
                squares[few] = sum(data.value(theta[few], tolerance) for data in self._parts)
        return np.where(np.isnan(squares), np.inf, squares)

    def values_near(self, x: Array, places: Array, tolerance: float) -> Array:
        """The same, shape (sets, n), at places (sets, n, count), each set with few coordinates that differ from x."""
        theta, moved = self.theta(x), self.theta(places)
        inside = self._prior.feasible(moved)
        moved = np.where(inside[..., None], moved, theta)
        values = np.array([data.values_near(theta, moved, tolerance) for data in self._parts]).sum(axis=0)
        return np.where(inside & ~np.isnan(values), values, np.inf)

    def climb(self, x: Array, tolerance: float) -> tuple[Array, float]:
        """End of a climb by damped Gauss-Newton steps, shape (count,), and its squares."""
        value, damping = float(self.value(x[None], tolerance)[0]), 0.01
        for _ in range(_STEPS if np.isfinite(value) else 0):
            theta = self.theta(x)
            slope = np.where(self._springs, 1 / (x * (1 - x) + 1e-12), self._high - self._low)
            gradient, normal = np.zeros(x.size), np.zeros((x.size, x.size))
            for data in self._parts:
                residual, jacobian = data.linearised(theta, tolerance)
                jacobian = jacobian * slope
                gradient += jacobian.T @ residual
                normal += jacobian.T @ jacobian
            low, high = self._ends
            held = ((x <= low) & (gradient > 0)) | ((x >= high) & (gradient < 0))
            gradient[held] = 0.0
            normal[held], normal[:, held] = 0.0, 0.0
            size = np.diag(normal) + 1e-6 * np.diag(normal).max() + held
            damped = normal + (damping * _DAMPING[:, None] * size + held)[:, :, None] * np.eye(x.size)
            steps = -np.linalg.solve(damped, np.tile(gradient, (len(_DAMPING), 1))[..., None])[..., 0]
            steps *= _FARTHEST / np.maximum(np.abs(steps).max(axis=1, keepdims=True), _FARTHEST)
            trials = self.clipped(x + steps)
            values = self.value(trials, tolerance)
            best = int(np.argmin(values))
            gain = value - values[best]
            if not gain > 0:
                break
            x, value = trials[best], float(values[best])
            damping = max(damping * _DAMPING[best], 1e-8)
            if gain < 1e-4 * value:
                break
        return x, value
