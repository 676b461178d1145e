"""Set-ups: what was tested in which state, and their likelihoods together."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.frf import AnyStructure, MeasuredBody
from jointbayes.frf.measured_body import substructures
from jointbayes.inference.likelihood_base import Likelihood, ResidualKind
from jointbayes.inference.noise.base import NoiseModel
from jointbayes.joint import (
    AnyJoint,
    AnyJointMatrix,
    Block,
    Blocks,
    Joint,
    JointMatrix,
    Joints,
    Parametrisation,
    as_joint_matrix,
    as_joints,
)
from jointbayes.joint.quantities import prefixed
from jointbayes.measurement import Measurement


@dataclass(frozen=True, slots=True)
class Level:
    """What a set-up was made at: a torque, a drive level, a temperature.

    Parameters
    ----------
    value
        The number.
    name, unit
        What it is, in words, and its unit.

    Raises
    ------
    ModelError
        If it is no finite number.
    """

    value: float
    name: str = "level"
    unit: str = ""

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise ModelError(f"level: found {self.value:g}; expected a finite number; correct it")


@dataclass(frozen=True, eq=False)
class Setup:
    """One test of several on the same joints: its own structure, data and noise.

    A quantity of the prior belongs to one set-up where its name begins with the set-up's, ``"long.length"`` or
    ``"loud.clamp.k22"``, and to all others where it does not: ``"length"``, ``"clamp.k22"``.

    Parameters
    ----------
    name
        Short name.
    structure
        Structure without the joints as it was in this test, or a family of them.
    joint
        Where the joints act; several in a sequence, each with a name.
    measurement
        FRFs or natural frequencies with their noise.
    noise, residual_kind
        As of `Problem`.
    level
        What it was made at, for the curve of a joint whose quantities are its own in each set-up.
    """

    name: str
    structure: AnyStructure
    joint: AnyJoint | Sequence[Joint]
    measurement: Measurement
    noise: NoiseModel | None = None
    residual_kind: ResidualKind = "complex"
    level: Level | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint", as_joints(self.joint))


def require_own_bodies(setups: Sequence[Setup]) -> None:
    """Refuse a measurement of a body that several set-ups have.

    Its errors are the same in all of them, and the likelihoods of set-ups are those of independent data: with its
    noise propagated they would count as averaged, and intervals would be too narrow.

    Raises
    ------
    ModelError
        If two set-ups have it.
    """
    owners: list[tuple[str, MeasuredBody]] = []
    for setup in setups:
        whole = substructures(setup.structure)
        bodies = whole.measured if whole.propagate else ()
        for body in bodies:
            other = next((name for name, earlier in owners if _is_one_measurement(earlier, body)), None)
            if other is not None:
                raise ModelError(
                    f"problem: found one measurement of the body {body.name} in set-ups {other} and {setup.name}, with "
                    "one error that would count as one of each; expected a measurement for each set-up, or one set-up; "
                    "measure the body again"
                )
        owners += ((setup.name, body) for body in bodies)


def _is_one_measurement(first: MeasuredBody, second: MeasuredBody) -> bool:
    return first is second or (
        np.array_equal(first.frequency_hz, second.frequency_hz) and np.array_equal(first.receptance, second.receptance)
    )


def own_name(setup: str, name: str, names: Iterable[str]) -> str | None:
    """Name of a quantity of a set-up among `names`: its own where there is one, or else the one for all; or None."""
    among = set(names)
    first = prefixed(setup, name) if setup else name
    return first if first in among else name if name in among else None


def columns_of_names(setup: str, wanted: Sequence[str], names: Sequence[str]) -> NDArray[np.intp]:
    """Places of the quantities of a set-up among `names`.

    Raises
    ------
    ModelError
        If one is not among them.
    """
    own_names = [own_name(setup, name, names) for name in wanted]
    missing = [name for name, among_names in zip(wanted, own_names, strict=True) if among_names is None]
    if missing:
        of = f" of set-up {setup}" if setup else ""
        raise ModelError(
            f"posterior: found no prior for {', '.join(missing)}{of}; expected one for each of {', '.join(wanted)}; "
            "add it"
        )
    return np.array([names.index(name) for name in own_names if name is not None], dtype=np.intp)


def arranged(parametrisation: Parametrisation, setups: Sequence[tuple[str, AnyJoint]]) -> Parametrisation:
    """The parametrisation with a K^J of the joints of all set-ups side by side, in the order of the set-ups.

    Parameters
    ----------
    parametrisation
        Of all joints; one that is of several set-ups once.
    setups
        Name and joints of each.

    Raises
    ------
    ModelError
        If a joint has no quantities, or those of a joint of another size.
    """
    blocks = parametrisation.blocks if isinstance(parametrisation, Blocks) else (Block("", parametrisation, (0,)),)
    rows: dict[str, list[int]] = {block.name: [] for block in blocks}
    by_joint = {joint: block for block in blocks for joint in block.joints}
    row = 0
    for setup, joints in setups:
        for joint in joints.joints if isinstance(joints, Joints) else (joints,):
            own_joint = prefixed(setup, joint.name) if joint.name else setup
            block = (
                by_joint.get(own_joint)
                or by_joint.get(joint.name)
                or (blocks[0] if _is_lone_joint(blocks, joints) else None)
            )
            if block is None or block.parametrisation.size != joint.size:
                those = "none" if block is None else f"those of {block.parametrisation.size} DOFs"
                raise ModelError(
                    f"problem: found a prior of quantities for {', '.join(map(repr, by_joint))}, and {those} for joint "
                    f"{joint.name or str(joint)!r} with {joint.size} DOFs; expected a parametrisation of each joint; "
                    "make it with `blocks_of` by the joints' names"
                )
            rows[block.name].append(row)
            row += joint.size
    if not isinstance(parametrisation, Blocks) and rows[""] == [0]:
        return parametrisation
    return Blocks(tuple(replace(block, rows=tuple(rows[block.name])) for block in blocks))


def _is_lone_joint(blocks: Sequence[Block], joints: AnyJoint) -> bool:
    """Whether one set of quantities without a name meets one joint, whatever its name."""
    return len(blocks) == 1 and not blocks[0].name and not (isinstance(joints, Joints) and len(joints.joints) > 1)


@dataclass(frozen=True, slots=True)
class Term:
    """The likelihood of one set-up, and what of all joints and quantities it depends on.

    Parameters
    ----------
    likelihood
        Of the set-up.
    rows
        Of the joint matrix, those of its joints.
    columns
        Of the factors, in the order of its names.
    """

    likelihood: Likelihood
    rows: slice
    columns: NDArray[np.intp]

    def of(self, matrices: AnyJointMatrix, factors: ArrayLike | None) -> tuple[JointMatrix, Array]:
        """Joint matrices (..., r, r) and factors (..., q) of the set-up from those of all."""
        assert factors is not None
        return as_joint_matrix(matrices).block(self.rows), np.asarray(factors, dtype=float)[..., self.columns]


class SetupsLikelihood(Likelihood):
    """Likelihood of independent set-ups: the sum of theirs.

    Joint matrices are those of all set-ups' joints side by side; factors are those of all quantities of the prior.

    Parameters
    ----------
    names
        All uncertain quantities beside the joints, those of the noise models last.
    terms
        One for each set-up.

    Raises
    ------
    ModelError
        If the parameters of the noise models are not the last.
    """

    def __init__(self, names: Sequence[str], terms: Sequence[Term]) -> None:
        self.names, self.terms = tuple(names), tuple(terms)
        self.noise = terms[0].likelihood.noise
        self.constant = sum(term.likelihood.constant for term in terms)
        self.n_data = sum(term.likelihood.n_data for term in terms)
        of_noise = {
            int(column) for term in terms for column in term.columns[len(term.columns) - term.likelihood.hyper_count :]
        }
        # one of several set-ups leaves the parameters of the others' noise among the last out
        self.hyper_count = len(self.names) - min(of_noise, default=len(self.names))
        of_structure = {int(column) for term in terms for column in term.columns} - of_noise
        if of_structure and max(of_structure) >= len(self.names) - self.hyper_count:
            raise ModelError(
                f"likelihood: found uncertain quantities {self.names}; expected those of the noise last; reorder them"
            )

    @property
    def gaussian(self) -> bool:
        """Whether the noise of every set-up is Gaussian of known size."""
        return all(term.likelihood.gaussian for term in self.terms)

    def hyper(self, factors: ArrayLike) -> Array:
        """Parameters of the noise model of a lone set-up, shape (batch, its number)."""
        (term,) = self.terms
        factor_rows = np.atleast_2d(np.asarray(factors, dtype=float))
        return term.likelihood.hyper(factor_rows[:, term.columns])

    def log_likelihood(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,): the sum of all set-ups."""
        return np.sum([term.likelihood.log_likelihood(*term.of(matrices, factors)) for term in self.terms], axis=0)

    def standardised(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> NDArray[Any]:
        """Residuals over σ: of a lone set-up in its own shape, of several one after the other, shape (batch, n)."""
        return self._joined([term.likelihood.standardised(*term.of(matrices, factors)) for term in self.terms])

    def predicted(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> NDArray[Any]:
        """What is compared with the data, as `standardised`."""
        return self._joined([term.likelihood.predicted(*term.of(matrices, factors)) for term in self.terms])

    def variance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """σ² of what is compared, as `standardised`."""
        return self._joined([term.likelihood.variance(*term.of(matrices, factors)) for term in self.terms])

    def pointwise(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> NDArray[Any]:
        """ln L value by value, as `standardised`."""
        return self._joined([term.likelihood.pointwise(*term.of(matrices, factors)) for term in self.terms])

    @staticmethod
    def _joined(of_tests: Sequence[NDArray[Any]]) -> NDArray[Any]:
        if len(of_tests) == 1:
            return of_tests[0]
        return np.concatenate([values.reshape(len(values), -1) for values in of_tests], axis=1)

    def white(self, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Real residuals, shape (batch, m), of all set-ups."""
        return np.concatenate([term.likelihood.white(*term.of(matrices, factors)) for term in self.terms], axis=1)

    def typical_squares(self, matrices: AnyJointMatrix, factors: ArrayLike) -> tuple[float, int]:
        """Sum and number of the squared white residuals of one joint."""
        squares = [term.likelihood.typical_squares(*term.of(matrices, factors)) for term in self.terms]
        return sum(total for total, _ in squares), sum(count for _, count in squares)

    def gradient(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, R, R) by the joint matrices."""
        joints = as_joint_matrix(matrices)
        factor_rows = np.empty((len(joints), 0)) if factors is None else np.asarray(factors, dtype=float)
        total, slope = np.zeros(len(joints)), np.zeros_like(joints.stiffness)
        for term in self.terms:
            value, slope[:, term.rows, term.rows] = term.likelihood.gradient(*term.of(joints, factor_rows))
            total += value
        return total, slope

    def residuals(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint, of all set-ups."""
        changes = as_joint_matrix(directions)
        factor_rows = np.empty(0) if factors is None else np.asarray(factors, dtype=float)
        residuals, slopes = [], []
        for term in self.terms:
            joint, of_test = term.of(matrix, factor_rows)
            residual, slope = term.likelihood.residuals(joint, changes.block(term.rows), of_test)
            whole = np.zeros((len(residual), len(changes) + len(self.names)))
            whole[:, : len(changes)] = slope[:, : len(changes)]
            whole[:, len(changes) + term.columns] = slope[:, len(changes) :]
            residuals.append(residual)
            slopes.append(whole)
        return np.concatenate(residuals), np.concatenate(slopes)
