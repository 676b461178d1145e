"""What likelihoods have in common, one of several tests, and how a measured FRF is compared.

Each offers ln L for a batch, and for one point the standardised residuals e, with ln L = constant − eᵀe/2 for Gaussian
noise of known size, and their Jacobian. Of an FRF the complex value is compared: predicted FRFs become standardised
residuals z for a noise model, such that the total ln L = constant + noise.log_likelihood(z, hyper).
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.inference.noise.base import NoiseModel, Residuals, residuals_of_values, values_of_residuals
from jointbayes.joint import AnyJointMatrix, JointMatrix, joint_matrix_of
from vibrecords.arrays import Array, ComplexArray, Indices


class ComplexResidual:
    """z = (H − Hˣ)/σ, complex, E|z|² = 1.

    Parameters
    ----------
    measured
        Hˣ, shape (lines, outputs, inputs).
    variance
        σ² = E|δH|², both parts together, shape as `measured`.
    """

    def __init__(self, measured: ComplexArray, variance: Array) -> None:
        self._measured, self._weight = measured, 1 / np.sqrt(variance)
        #: −Σ ln πσ².
        self.constant = -float(np.log(math.pi * variance).sum())

    def z(self, predicted: ComplexArray) -> ComplexArray:
        """Residuals, shape (n, lines, pairs), of predicted FRFs, shape (n, lines, outputs, inputs)."""
        return self._weighted(predicted - self._measured)

    def tangent(self, predicted: ComplexArray, derivative: ComplexArray) -> ComplexArray:
        """Derivative of z, shape (p, lines, pairs), from ∂H, shape (p, lines, outputs, inputs), at one prediction."""
        return self._weighted(np.array(derivative))

    def _weighted(self, values: ComplexArray) -> ComplexArray:
        # each part by itself: a product of complex numbers costs more than twice that
        values.real *= self._weight
        values.imag *= self._weight
        return values.reshape(*values.shape[:2], math.prod(values.shape[2:]))  # n may be 0: nothing of the joint yields


#: Of the logarithm of a quantity, in differences.
STEP = 1e-5


class Likelihood(ABC):
    """What all kinds of data have in common.

    Parameters
    ----------
    names
        Uncertain quantities but the joint's, in the order in which factors come; those of the noise are the last.
    noise
        Noise model.
    constant
        ln L of a perfect fit where the noise is as stated.
    n_data
        Number of measured values.
    """

    def __init__(self, names: Sequence[str], noise: NoiseModel, constant: float, n_data: int) -> None:
        self.names, self.noise, self.constant, self.n_data = tuple(names), noise, constant, n_data
        #: Number of the noise model's parameters.
        self.hyper_count = len(noise.names)
        if self.names[len(self.names) - self.hyper_count :] != noise.names:
            found = f"found uncertain quantities {self.names}"
            raise ModelError.of("likelihood", (), found, f"{noise.names} last", "reorder them")

    @property
    def gaussian(self) -> bool:
        """Whether ln L is −eᵀe/2 of the residuals and a constant: Gaussian noise of known size."""
        return self.noise.as_stated

    @property
    def has_slope(self) -> bool:
        """Whether `gradient` is there, where the noise is Gaussian of known size."""
        return True

    def hyper(self, factors: ArrayLike) -> Array:
        """Parameters of the noise model among factors (batch, q), shape (batch, hyper_count)."""
        factor_rows = np.atleast_2d(np.asarray(factors, dtype=float))
        return factor_rows[:, factor_rows.shape[1] - self.hyper_count :]

    @abstractmethod
    def log_likelihood(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q).

        −inf where the model has no finite value: a joint that resonates, undamped, on a line.
        """

    @abstractmethod
    def standardised(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Residuals:
        """Residuals over σ, shape (batch, lines, pairs), or (batch, n)."""

    @abstractmethod
    def predicted(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> NDArray[Any]:
        """What is compared with the data: FRFs (batch, lines, outputs, inputs), or natural frequencies (batch, n)."""

    @abstractmethod
    def variance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """σ² of what is compared, of the shape of `predicted`: as stated, with what else is known to be noise."""

    @abstractmethod
    def white(self, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Real residuals, shape (batch, m), that are white with unit variance if model and noise hold."""

    def plain_residuals(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> Array:
        """Residuals over their stated deviations, then their derivatives, shape (1 + p + q, m), for one joint.

        Asked where tests share errors, of real values only.
        """
        raise NotImplementedError

    def draw_shared(self, factors: ArrayLike, rng: np.random.Generator) -> dict[int, Residuals]:
        """Noise of tests that share errors, drawn for all of them together: z by the place of each; by default none."""
        return {}

    def draw_error_size(
        self, law: Hashable, matrices: AnyJointMatrix, factors: ArrayLike, rng: np.random.Generator
    ) -> Array | None:
        """Sizes of errors that are `NoiseModel.shares`, shape (batch, q), drawn given the data; None where none are."""
        return None

    def shift_of_edges(self, law: Hashable, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Mean of the place of each clamp's edge, in its standard deviations, shape (batch, edges)."""
        return np.empty((len(joint_matrix_of(matrices)), 0))

    def typical_squares(self, matrices: AnyJointMatrix, factors: ArrayLike) -> tuple[float, int]:
        """Sum and number of the squared white residuals of one joint, in units of the noise that the data show."""
        residual = self.white(matrices, factors)[0]
        total = float(residual @ residual)
        # where its size is integrated out
        return total / self.noise.typical_scale(total / 2, residual.size // self.noise.parts) ** 2, residual.size

    @abstractmethod
    def add_noise(self, predicted: NDArray[Any], z: NDArray[Any]) -> NDArray[Any]:
        """What would be measured: `predicted` of one joint with noise, z of a noise model, both as the data in shape.

        E|z|² is 1 of complex residuals and 1/2 of real ones.
        """

    @abstractmethod
    def pointwise(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L value by value, shape (batch, …), where residuals are independent.

        Raises
        ------
        ModelError
            If the noise model correlates them, or errors of a measured body do.
        """

    @abstractmethod
    def gradient(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r) by the joint: d ln L = Σ S_ij dK_ij for symmetric dK.

        Raises
        ------
        ModelError
            If the noise is not Gaussian of known size.
        """

    @abstractmethod
    def residuals(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint.

        Along changes dK^J (p, r, r), exact, and along the logarithms of the factors (q,), by differences. Columns of
        the noise model's parameters are zero: it is held fixed, and whitens residual and derivative alike.
        """


def moved_factors(factors: Array) -> Array:
    """Factors (1, n) with each in turn a little larger, then a little smaller, shape (2n, n)."""
    step = np.exp(STEP * np.eye(factors.shape[1]))
    return np.concatenate([factors * step, factors / step])


@dataclass(frozen=True, slots=True)
class Term:
    """The likelihood of one test, and what of all joints and quantities it depends on.

    Parameters
    ----------
    likelihood
        Of the test.
    rows
        Of the joint matrix, those of its joints.
    columns
        Of the factors, in the order of its names.
    """

    likelihood: Likelihood
    rows: slice
    columns: Indices

    def select(self, matrices: AnyJointMatrix, factors: ArrayLike | None) -> tuple[JointMatrix, Any]:
        """Select the test's joint matrices (..., r, r) and factors (..., q) from the ones of all tests."""
        of_test = None if factors is None else np.asarray(factors, dtype=float)[..., self.columns]
        return joint_matrix_of(matrices).block(self.rows), of_test


@dataclass(frozen=True, slots=True)
class Sharing:
    """Tests whose values have errors in common.

    Parameters
    ----------
    tests
        Their places among all, in order.
    noise
        Noise model, without parameters, of the values of all of them, one after the other.
    """

    tests: tuple[int, ...]
    noise: NoiseModel


class TestsLikelihood(Likelihood):
    """Likelihood of several tests: the sum of theirs, but for those whose errors are shared.

    Joint matrices are those of all tests' joints side by side; factors are those of all quantities of the prior.

    Parameters
    ----------
    names
        All uncertain quantities other than the joints', those of the noise models last.
    terms
        One for each test.
    sharing
        Tests of modes that share errors of the model.

    Raises
    ------
    ModelError
        If the parameters of the noise models are not the last.
    """

    def __init__(self, names: Sequence[str], terms: Sequence[Term], sharing: Sequence[Sharing] = ()) -> None:
        self.names, self.terms, self.sharing = tuple(names), tuple(terms), tuple(sharing)
        shared = {place for group in sharing for place in group.tests}
        self._alone = [term for place, term in enumerate(self.terms) if place not in shared]
        self.noise = terms[0].likelihood.noise
        self.constant = sum(term.likelihood.constant for term in terms)
        self.n_data = sum(term.likelihood.n_data for term in terms)
        of_noise = {
            int(column) for term in terms for column in term.columns[len(term.columns) - term.likelihood.hyper_count :]
        }
        # one of several tests leaves the parameters of the others' noise among the last out
        self.hyper_count = len(self.names) - min(of_noise, default=len(self.names))
        of_structure = {int(column) for term in terms for column in term.columns} - of_noise
        if of_structure and max(of_structure) >= len(self.names) - self.hyper_count:
            found = f"found uncertain quantities {self.names}"
            raise ModelError.of("likelihood", (), found, "those of the noise last", "reorder them")

    @property
    def gaussian(self) -> bool:
        """Whether the noise of every test is Gaussian of known size."""
        return all(term.likelihood.gaussian for term in self.terms)

    @property
    def has_slope(self) -> bool:
        """Whether the likelihood of every test has a gradient."""
        return all(term.likelihood.has_slope for term in self.terms)

    def hyper(self, factors: ArrayLike) -> Array:
        """Parameters of the noise model of a lone test, shape (batch, its number)."""
        (term,) = self.terms
        factor_rows = np.atleast_2d(np.asarray(factors, dtype=float))
        return term.likelihood.hyper(factor_rows[:, term.columns])

    def log_likelihood(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,): the sum of all tests."""
        values = [term.likelihood.log_likelihood(*term.select(matrices, factors)) for term in self._alone]
        for group in self.sharing:
            z = self._compared(self._terms_of(group), matrices, factors)
            constant = sum(self.terms[place].likelihood.constant for place in group.tests)
            values.append(constant + group.noise.log_likelihood(z, ()))
        return np.sum(values, axis=0)

    def _terms_of(self, group: Sharing) -> tuple[Term, ...]:
        return tuple(self.terms[place] for place in group.tests)

    @staticmethod
    def _compared(terms: Sequence[Term], matrices: AnyJointMatrix, factors: ArrayLike | None) -> Residuals:
        """Residuals z, shape (batch, m, 1), of tests of real values, one after the other."""
        rows = [term.likelihood.standardised(*term.select(matrices, factors)) for term in terms]
        return residuals_of_values(np.concatenate(rows, axis=1))

    def standardised(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> NDArray[Any]:
        """Residuals over σ: of a lone test in its own shape, of several one after the other, shape (batch, n)."""
        return self._joined([term.likelihood.standardised(*term.select(matrices, factors)) for term in self.terms])

    def predicted(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> NDArray[Any]:
        """What is compared with the data, as `standardised`."""
        return self._joined([term.likelihood.predicted(*term.select(matrices, factors)) for term in self.terms])

    def add_noise(self, predicted: NDArray[Any], z: NDArray[Any]) -> NDArray[Any]:
        """What would be measured in a lone test."""
        (term,) = self.terms
        return term.likelihood.add_noise(predicted, z)

    def variance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """σ² of what is compared, as `standardised`."""
        return self._joined([term.likelihood.variance(*term.select(matrices, factors)) for term in self.terms])

    def pointwise(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> NDArray[Any]:
        """ln L value by value, as `standardised`.

        Raises
        ------
        ModelError
            If values depend on each other.
        """
        for group in self.sharing:
            group.noise.pointwise(self._compared(self._terms_of(group), matrices, factors), ())
        return self._joined([term.likelihood.pointwise(*term.select(matrices, factors)) for term in self.terms])

    @staticmethod
    def _joined(of_tests: Sequence[NDArray[Any]]) -> NDArray[Any]:
        if len(of_tests) == 1:
            return of_tests[0]
        return np.concatenate([values.reshape(len(values), -1) for values in of_tests], axis=1)

    def white(self, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Real residuals, shape (batch, m), of all tests; those that share errors last."""
        rows = [term.likelihood.white(*term.select(matrices, factors)) for term in self._alone]
        rows += [self._white_of_group(group, matrices, factors) for group in self.sharing]
        return np.concatenate(rows, axis=1)

    def draw_shared(self, factors: ArrayLike, rng: np.random.Generator) -> dict[int, Residuals]:
        """Noise z (m,) of the tests that share errors, by their places, at factors (1, q)."""
        drawn: dict[int, Residuals] = {}
        for group in self.sharing:
            ends = np.cumsum([self.terms[place].likelihood.n_data for place in group.tests])
            noise = group.noise.draw(rng, np.empty((1, 0)), ends[-1], 1)[0, :, 0]
            drawn |= zip(group.tests, np.split(noise, ends[:-1]), strict=True)
        return drawn

    def _white_of_group(self, group: Sharing, matrices: AnyJointMatrix, factors: ArrayLike | None) -> Array:
        return values_of_residuals(group.noise.scores(self._compared(self._terms_of(group), matrices, factors), ()))

    def draw_error_size(
        self, law: Hashable, matrices: AnyJointMatrix, factors: ArrayLike, rng: np.random.Generator
    ) -> Array | None:
        """Sizes of errors of the model, shape (batch, q), drawn given what is left of the data."""
        found = next(self._of_law(law), None)
        return None if found is None else found[0].draw_size(rng, self._compared(found[1], matrices, factors))

    def shift_of_edges(self, law: Hashable, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Mean of the place of each clamp's edge, in its standard deviations, shape (batch, edges)."""
        each = [noise.shift_of_edges(self._compared(terms, matrices, factors)) for noise, terms in self._of_law(law)]
        return np.hstack(each) if each else np.empty((len(joint_matrix_of(matrices)), 0))

    def _of_law(self, law: Hashable) -> Iterator[tuple[Any, tuple[Term, ...]]]:
        """Noise models of tests that share errors by this law, with their tests."""
        alone = ((term.likelihood.noise, (term,)) for term in self._alone)
        groups = [(group.noise, self._terms_of(group)) for group in self.sharing]
        return ((noise, terms) for noise, terms in (*groups, *alone) if noise.shares == law)

    def typical_squares(self, matrices: AnyJointMatrix, factors: ArrayLike) -> tuple[float, int]:
        """Sum and number of the squared white residuals of one joint."""
        squares = [term.likelihood.typical_squares(*term.select(matrices, factors)) for term in self._alone]
        for group in self.sharing:
            white = self._white_of_group(group, matrices, factors)[0]
            squares.append((float(white @ white), white.size))
        return sum(total for total, _ in squares), sum(count for _, count in squares)

    def gradient(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, R, R) by the joint matrices."""
        joints = joint_matrix_of(matrices)
        factor_rows = np.empty((len(joints), 0)) if factors is None else np.asarray(factors, dtype=float)
        total, slope = np.zeros(len(joints)), np.zeros_like(joints.stiffness)
        for term in self.terms:
            value, slope[:, term.rows, term.rows] = term.likelihood.gradient(*term.select(joints, factor_rows))
            total += value
        return total, slope

    def residuals(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint, of all tests."""
        changes = joint_matrix_of(directions)
        factor_rows = np.empty(0) if factors is None else np.asarray(factors, dtype=float)
        residuals, slopes = [], []
        for term in self._alone:
            joint, of_test = term.select(matrix, factor_rows)
            residual, slope = term.likelihood.residuals(joint, changes.block(term.rows), of_test)
            residuals.append(residual)
            slopes.append(self._among_all(term, slope, len(changes)))
        for group in self.sharing:
            rows = []
            for term in self._terms_of(group):
                joint, of_test = term.select(matrix, factor_rows)
                residual, *slope_rows = term.likelihood.plain_residuals(joint, changes.block(term.rows), of_test)
                rows.append(np.vstack([residual, self._among_all(term, np.array(slope_rows).T, len(changes)).T]))
            white = values_of_residuals(group.noise.whiten(residuals_of_values(np.hstack(rows)), ()))
            residuals.append(white[0])
            slopes.append(white[1:].T)
        return np.concatenate(residuals), np.concatenate(slopes)

    def _among_all(self, term: Term, slope: Array, count: int) -> Array:
        """Put the derivatives of one test's residuals, shape (m, count + its factors), in their place among all."""
        whole = np.zeros((len(slope), count + len(self.names)))
        whole[:, :count] = slope[:, :count]
        whole[:, count + term.columns] = slope[:, count:]
        return whole
