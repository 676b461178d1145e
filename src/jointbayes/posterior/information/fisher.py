"""Fisher information at a point: how well data and prior determine each parameter, and which combinations of them.

References
----------
Fisher, R. A. (1922). On the mathematical foundations of theoretical statistics. Philosophical Transactions of the Royal
Society A 222, 309-368. DOI 10.1098/rsta.1922.0009
Gutenkunst, R. N. et al. (2007). Universally sloppy parameter sensitivities in systems biology models. PLoS
Computational Biology 3(10), e189. DOI 10.1371/journal.pcbi.0030189 (eigen-directions of the information in logarithms)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.inference import Problem
from jointbayes.joint import STIFFNESS_NAMES, Parametrisation

__all__ = ["EigenDirection", "FisherInformation", "fisher_information"]

Array = NDArray[np.float64]

#: Eigenvalues of an information, relative to the greatest, that are told from zero.
_SMALLEST = 1e-13
#: The least eigenvalue of an information scaled to a unit diagonal that is inverted: what rounding leaves of zero.
_ROUNDING = 1e-15
#: A parameter whose variance, in units of that with all else known, exceeds this is not determined at all: far enough
#: below 1/_ROUNDING that a hundredth of a direction without information is enough.
_UNDETERMINED = 1e11
#: So many standard deviations of ρ must lie between ρ and 0 for k12 to have a sign, and so a logarithm.
_SIGNED = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class EigenDirection:
    """One combination of the joint's coordinates that the data determine independently of the others.

    Parameters
    ----------
    names
        Coordinates: ln of the stiffness of that name, except ``"rho"``, which is ρ itself; shape (p,).
    weights
        Unit vector, shape (p,), its largest component positive.
    sd
        Standard deviation of weights · coordinates.
    """

    names: tuple[str, ...]
    weights: Array
    sd: float


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

    Raises
    ------
    ModelError
        If the shapes do not agree.
    """

    names: tuple[str, ...]
    theta: Array
    data: Array
    prior: Array
    prior_sd: Array
    parametrisation: Parametrisation

    def __post_init__(self) -> None:
        d = len(self.names)
        shapes = (self.theta.shape, self.data.shape, self.prior.shape, self.prior_sd.shape)
        if shapes != ((d,), (d, d), (d, d), (d,)) or self.names[: len(self.joint_names)] != self.joint_names:
            raise ModelError(
                f"Fisher information: found names {self.names} and arrays of shapes {shapes}; expected the joint's "
                f"coordinates {self.joint_names} first and arrays of one length; give all for the same parameters"
            )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joint's coordinates."""
        return self.parametrisation.names

    def total(self, free: Sequence[str] | None = None, *, with_prior: bool = True) -> Array:
        """Information about the parameters in `free`, in that order (all if None), the others exactly known: (f, f).

        Raises
        ------
        ModelError
            If there is no such parameter, or one is named twice.
        """
        rows = self._rows(free)
        whole = self.data + self.prior if with_prior else self.data
        block: Array = whole[np.ix_(rows, rows)]
        return block

    def covariance(self, free: Sequence[str] | None = None, *, with_prior: bool = True) -> Array:
        """Inverse of `total`, shape (f, f): the smallest covariance that an unbiased estimate can have.

        Combinations that neither data nor prior determine have a variance at the limit of double precision, 1e15 of
        what it would be with all else known, rather than infinity, so that correlations keep their limit of ±1.
        A parameter without any information has an infinite variance and no correlation.

        References
        ----------
        Rao, C. R. (1945). Information and accuracy attainable in the estimation of statistical parameters.
        Bulletin of the Calcutta Mathematical Society 37, 81-91.
        """
        return inverse_information(self.total(free, with_prior=with_prior))

    def sd(self, free: Sequence[str] | None = None, *, with_prior: bool = True) -> dict[str, float]:
        """Standard deviation of each parameter in `free`; infinite where it is not determined."""
        information = self.total(free, with_prior=with_prior)
        sd = _sd(information, inverse_information(information))
        return {self.names[i]: float(s) for i, s in zip(self._rows(free), sd, strict=True)}

    def correlation(self, free: Sequence[str] | None = None, *, with_prior: bool = True) -> Array:
        """Correlation matrix of the parameters in `free`, shape (f, f)."""
        covariance = self.covariance(free, with_prior=with_prior)
        variance = np.diag(covariance)
        root = np.sqrt(np.where(np.isfinite(variance), variance, 1.0))
        matrix: Array = np.where(np.isfinite(covariance), covariance, 0.0) / np.outer(root, root)
        np.fill_diagonal(matrix, 1.0)
        return matrix

    def stiffness_sd(self, free: Sequence[str] | None = None, *, with_prior: bool = True) -> dict[str, float]:
        """Standard deviation of ln |k| of each stiffness that the joint's coordinates move, whatever they are.

        `free` names coordinates of θ, as in `sd`; for coordinates other than logarithms the derivative at θ is used.
        A stiffness that is zero has an infinite one.
        """
        rows = self._rows(free)
        information = self.total(free, with_prior=with_prior)
        covariance = inverse_information(information)
        own = self.sd(free, with_prior=with_prior)
        names, slope = self._log_slope()
        out: dict[str, float] = {}
        for name, row in zip(names, slope, strict=True):
            if name in self.joint_names:
                out[name] = own.get(name, 0.0)
                continue
            by_row = row_of(row, rows)
            moved = by_row != 0
            undetermined = any(np.isinf(own[self.names[rows[i]]]) for i in np.flatnonzero(moved))
            variance = by_row[moved] @ covariance[np.ix_(moved, moved)] @ by_row[moved]
            out[name] = float("inf") if undetermined or not np.isfinite(row).all() else float(np.sqrt(variance))
        return out

    def joint_information(self, *, with_prior: bool = False) -> tuple[tuple[str, ...], Array]:
        """Information about the joint's logarithms once the nuisances are marginalised.

        The nuisances' priors count; the joint's own only with `with_prior`. For the signed parametrisation the
        coordinates are turned into (ln k11, ln |k12|, ln k22) by their derivative at θ; where ρ lies within two
        standard deviations of zero, so that k12 has no sign and no logarithm, they stay (ln k11, ln k22, ρ).

        Returns
        -------
        names, information : tuple of str, ndarray of shape (p, p)
        """
        p = len(self.joint_names)
        whole = self.data + self.prior
        if not with_prior:
            whole[:p, :p] = self.data[:p, :p]
        cross = whole[:p, p:]
        block = whole[:p, :p] - cross @ _pseudo_inverse(whole[p:, p:]) @ cross.T
        block = (block + block.T) / 2
        names = self.joint_names
        if "rho" in names:
            i = names.index("rho")
            sd = _sd(block, inverse_information(block))[i]
            if abs(self.theta[i]) > _SIGNED * sd:
                names, slope = self._log_slope()
                back = np.linalg.inv(slope)
                block = back.T @ block @ back
        return names, block

    def eigen_directions(self, *, with_prior: bool = False) -> tuple[EigenDirection, ...]:
        """Combinations of the joint's logarithms that are determined independently, best known first.

        Eigenvectors of `joint_information`; see there for its coordinates.
        """
        names, information = self.joint_information(with_prior=with_prior)
        values, vectors = np.linalg.eigh(information)
        smallest = _SMALLEST * max(float(values.max(initial=0.0)), np.finfo(float).tiny)
        out = []
        for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
            sign = np.sign(vector[np.abs(vector).argmax()])
            sd = float(value**-0.5) if value > smallest else float("inf")
            out.append(EigenDirection(names, sign * vector, sd))
        return tuple(out)

    def _rows(self, free: Sequence[str] | None) -> list[int]:
        if free is None:
            return list(range(len(self.names)))
        unknown = [name for name in free if name not in self.names]
        if unknown or len(set(free)) != len(free):
            raise ModelError(
                f"Fisher information: found free parameters {', '.join(free)}; expected each once and among "
                f"{', '.join(self.names)}; correct the names"
            )
        return [self.names.index(name) for name in free]

    def _log_slope(self) -> tuple[tuple[str, ...], Array]:
        """Names of the stiffnesses that the joint's coordinates move, and ∂ ln |k|/∂θ, shape (stiffnesses, p)."""
        theta = self.theta[: len(self.joint_names)]
        stiffness = self.parametrisation.stiffness(theta)
        derivative = self.parametrisation.derivative(theta)
        moved = (derivative != 0).any(axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = derivative[moved] / stiffness[moved, None]
        return tuple(name for name, moves in zip(STIFFNESS_NAMES, moved, strict=True) if moves), slope


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
        coordinate_names(problem),
        point,
        data.T @ data,
        np.diag(np.asarray(problem.prior.precision, dtype=float)),
        np.asarray(problem.prior.sd, dtype=float),
        problem.parametrisation,
    )


def coordinate_names(problem: Problem) -> tuple[str, ...]:
    """Names of all coordinates of θ: of the joint, and of the nuisances where the prior has any."""
    return tuple(getattr(problem.prior, "names", problem.parametrisation.names))


def row_of(row: Array, rows: Sequence[int]) -> Array:
    """The entries of a row over the joint's coordinates that belong to `rows` of θ; zero for nuisances."""
    return np.array([row[i] if i < row.size else 0.0 for i in rows])


def inverse_information(information: Array) -> Array:
    """Covariance, shape (d, d), of an information that may be singular; see `FisherInformation.covariance`."""
    diagonal = np.diag(information)
    seen = diagonal > 0
    root = np.sqrt(diagonal[seen])
    values, vectors = np.linalg.eigh(information[np.ix_(seen, seen)] / np.outer(root, root))
    covariance = np.diag(np.full(diagonal.size, np.inf))
    covariance[np.ix_(seen, seen)] = (vectors / np.maximum(values, _ROUNDING)) @ vectors.T / np.outer(root, root)
    return covariance


def _sd(information: Array, covariance: Array) -> Array:
    """Standard deviations, shape (d,), infinite where a parameter is not determined."""
    variance = np.diag(covariance)
    with np.errstate(invalid="ignore"):  # inf · 0 where there is no information at all
        return np.where(variance * np.diag(information) < _UNDETERMINED, np.sqrt(variance), np.inf)


def _pseudo_inverse(information: Array) -> Array:
    """Inverse, shape (q, q), that takes what is not determined as known: the joint does not depend on it either."""
    root = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    scaled = information / np.outer(root, root)
    inverse: Array = np.linalg.pinv(scaled, rcond=_SMALLEST, hermitian=True) / np.outer(root, root)
    return inverse
