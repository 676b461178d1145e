"""Fisher's information about θ at one point, data and prior apart, and the spread of each stiffness by it.

References
----------
Fisher, R. A. (1922). On the mathematical foundations of theoretical statistics. Philosophical Transactions of the Royal
Society A 222, 309-368. DOI 10.1098/rsta.1922.0009
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.inference import Problem
from jointbayes.joint import Parametrisation
from jointbayes.rounding import percent
from vibrecords.arrays import Array

#: Half width of a 95 % interval in standard deviations; and the largest standard deviation of ln k that is said in %.
_HALF_WIDTH, _SMALL = 1.96, 0.2
#: Standard deviations of ln k beyond which nothing is known of a stiffness, and up to which a forecast is worth a word:
#: 0.1 to 10 times.
LARGEST, WORTH_SAYING = 3.0, math.log(10.0) / 1.96
#: The least eigenvalue of an information scaled to a unit diagonal that is inverted: what rounding leaves of zero.
_ROUNDING = 1e-15
#: A parameter whose variance, in units of that with all else known, exceeds this is not determined at all: far enough
#: below 1/_ROUNDING that a hundredth of a direction without information is enough.
_UNDETERMINED = 1e11


@dataclass(frozen=True, slots=True, eq=False)
class FisherInformation:
    """Information about θ at one point, data and prior apart.

    Parameters
    ----------
    names
        Coordinate names, joint first, then nuisances, shape (d,).
    theta
        The point, shape (d,).
    data
        JᵀJ of the standardised residuals of the data, shape (d, d).
    prior
        Precision of the prior, −∂² ln p/∂θ², shape (d, d); zero where the prior is uniform, whose bounds count for
        nothing here.
    prior_sd
        Standard deviation of the prior of each coordinate, shape (d,).
    parametrisation
        Meaning of the joint's coordinates, the first ones of θ.
    """

    names: tuple[str, ...]
    theta: Array
    data: Array
    prior: Array
    prior_sd: Array
    parametrisation: Parametrisation

    def total(self, free: Sequence[str] | None = None) -> Array:
        """Information about the parameters in `free`, in that order (all if None), the others exactly known: (f, f)."""
        rows = self._rows(free)
        return (self.data + self.prior)[np.ix_(rows, rows)]

    def covariance(self, free: Sequence[str] | None = None) -> Array:
        """Inverse of `total`, shape (f, f): the smallest covariance that an unbiased estimate can have.

        Combinations that neither data nor prior determine have a variance at the limit of double precision, 1e15 of
        what it would be with all else known, rather than infinity, so that correlations keep their limit of ±1.
        A parameter without any information has an infinite variance and no correlation.

        References
        ----------
        Rao, C. R. (1945). Information and accuracy attainable in the estimation of statistical parameters.
        Bulletin of the Calcutta Mathematical Society 37, 81-91.
        """
        return inverse_information(self.total(free))

    def sd(self, free: Sequence[str] | None = None) -> dict[str, float]:
        """Standard deviation of each parameter in `free`; infinite where it is not determined."""
        information = self.total(free)
        variance = np.diag(inverse_information(information))
        with np.errstate(invalid="ignore"):  # inf · 0 where there is no information at all
            sd = np.where(variance * np.diag(information) < _UNDETERMINED, np.sqrt(variance), np.inf)
        return {self.names[i]: float(s) for i, s in zip(self._rows(free), sd, strict=True)}

    def stiffness_sd(self, free: Sequence[str] | None = None) -> dict[str, float]:
        """Standard deviation of ln |k| of each stiffness that the joint's coordinates move.

        `free` names coordinates of θ, as in `sd`; for coordinates other than logarithms the derivative at θ is used.
        A stiffness that is zero has an infinite one.
        """
        rows, sd_of_coordinate, covariance = self._rows(free), self.sd(free), self.covariance(free)
        theta = self.theta[: len(self.parametrisation.names)]
        stiffness, derivative = self.parametrisation.values(theta), self.parametrisation.derivative(theta)
        sd_by_name: dict[str, float] = {}
        for quantity, k, row in zip(self.parametrisation.quantities, stiffness, derivative, strict=True):
            if not row.any():
                continue
            if quantity.name in self.parametrisation.names:
                sd_by_name[quantity.name] = sd_of_coordinate.get(quantity.name, 0.0)
                continue
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = np.array([row[i] / k if i < row.size else 0.0 for i in rows])  # ∂ ln |k|/∂θ
            moved = slope != 0
            undetermined = any(np.isinf(sd_of_coordinate[self.names[rows[i]]]) for i in np.flatnonzero(moved))
            variance = slope[moved] @ covariance[np.ix_(moved, moved)] @ slope[moved]
            finite = not undetermined and np.isfinite(slope).all()
            sd_by_name[quantity.name] = float(np.sqrt(variance)) if finite else float("inf")
        return sd_by_name

    def known_to(self, free: Sequence[str] | None = None) -> dict[str, float]:
        """As `stiffness_sd`, but no more than the prior's where the stiffness is a coordinate itself."""
        prior = dict(zip(self.names[: len(self.parametrisation.names)], self.prior_sd.tolist(), strict=False))
        return {name: min(sd, prior.get(name, sd)) for name, sd in self.stiffness_sd(free).items()}

    def with_more(self, data: Array | float) -> Self:
        """The same with the information of further data, shape (d, d), added to the information of the data."""
        return replace(self, data=self.data + data)

    def _rows(self, free: Sequence[str] | None) -> list[int]:
        return [self.names.index(name) for name in (self.names if free is None else free)]


def fisher_information(problem: Problem, theta: ArrayLike) -> FisherInformation:
    """Fisher information of a problem at θ, shape (d,), usually the mode.

    The data's part is JᵀJ of the exact Jacobian of the standardised residuals, for the noise as it stands at θ.

    Parameters
    ----------
    problem
        Structure, joint, data and prior.
    theta
        Where; inside the prior's support.
    """
    point = np.asarray(theta, dtype=float)
    _, jacobian = problem.log_posterior.residuals(point)
    data = jacobian[: len(jacobian) - point.size]  # the last d rows are the prior's
    return FisherInformation(
        problem.names, point, data.T @ data, np.diag(problem.prior.precision), problem.prior.sd, problem.parametrisation
    )


def inverse_information(information: Array) -> Array:
    """Covariance, shape (d, d), of an information that may be singular; see `FisherInformation.covariance`."""
    diagonal = np.diag(information)
    seen = diagonal > 0
    root = np.sqrt(diagonal[seen])
    values, vectors = np.linalg.eigh(information[np.ix_(seen, seen)] / np.outer(root, root))
    covariance = np.diag(np.full(diagonal.size, np.inf))
    covariance[np.ix_(seen, seen)] = (vectors / np.maximum(values, _ROUNDING)) @ vectors.T / np.outer(root, root)
    return covariance


def spread_in_words(sd: float) -> str:
    """The 95 % interval of a stiffness around its median, by the standard deviation of its logarithm.

    Examples
    --------
    >>> spread_in_words(0.045), spread_in_words(0.5), spread_in_words(9.0)
    ('±8.8 %', '0.38 to 2.7 times', 'beyond 0.0028 to 360 times')
    """
    if sd <= _SMALL:
        return f"±{percent(_HALF_WIDTH * sd)}"
    low, high = (float(f"{math.exp(side * _HALF_WIDTH * min(sd, LARGEST)):.2g}") for side in (-1, 1))
    return f"{'' if sd <= LARGEST else 'beyond '}{low:g} to {high:g} times"
