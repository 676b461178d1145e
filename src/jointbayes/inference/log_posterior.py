"""The posterior density over the coordinates of a joint and of what else is uncertain."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.inference.likelihood_base import Likelihood
from jointbayes.inference.noise.base import Residuals
from jointbayes.inference.prior import JointPrior
from jointbayes.joint import JointMatrix
from vibrecords.arrays import Array
from vibrecords.errors import array_of

ExtraLogLikelihood = Callable[[Array], ArrayLike]


class LogPosterior:
    """ln p(θ | data) up to the evidence, vectorised over walkers.

    Parameters
    ----------
    prior
        Prior density over θ; carries the parametrisation.
    likelihood
        Likelihood of joint matrices and factors.
    extra
        A further term of the log likelihood as a function of θ, (n, d) → (n,); −inf where impossible.

    Raises
    ------
    ModelError
        If prior and likelihood do not name the same uncertain quantities in the same order.
    """

    def __init__(self, prior: JointPrior, likelihood: Likelihood, extra: ExtraLogLikelihood | None = None) -> None:
        self.prior, self.likelihood, self.extra = prior, likelihood, extra
        named = tuple(n.name for n in prior.nuisances)
        if named != likelihood.names:
            raise ModelError.of("posterior", (), f"found priors for {named}", f"one for each of {likelihood.names}")
        #: Number of joints inside the prior's support at which the model had no finite value so far.
        self.singular = 0
        #: Number of joints at which the model was evaluated so far; derivatives at one count as many differences.
        self.evaluations = 0
        self._parametrisation = prior.parametrisation

    def __call__(self, theta: ArrayLike) -> Array:
        """Log density, shape (n,), of θ, shape (n, d); −inf outside the prior's support and where H is not finite.

        Raises
        ------
        ModelError
            If θ has another shape, or is no array of numbers.
        """
        t = self.rows_of(theta)
        with np.errstate(over="ignore", invalid="ignore"):  # far outside the support
            density = self.prior.log_density(t)
        inside = np.isfinite(density)
        if inside.any():
            value = self.log_likelihood(t[inside])
            density[inside] += value
            self.singular += int(np.isneginf(value).sum())
        return density

    def rows_of(self, theta: ArrayLike) -> Array:
        """θ as an array of shape (n, d).

        Raises
        ------
        ModelError
            If it has another shape, or is no array of numbers.
        """
        array = (
            theta if isinstance(theta, np.ndarray) and theta.dtype == float else array_of(theta, float, "θ", ModelError)
        )
        t = np.atleast_2d(array)
        if t.ndim != 2 or t.shape[1] != len(self.prior.names):
            found = f"found shape {array.shape}"
            raise ModelError.of("θ", (), found, f"(n, {len(self.prior.names)}), a row for each joint")
        return t

    def log_likelihood(self, theta: ArrayLike) -> Array:
        """ln L, shape (n,), of θ, shape (n, d), inside the prior's support; the further term is part of it.

        Raises
        ------
        ModelError
            If the further term does not give one number for each θ.
        """
        t = np.atleast_2d(np.asarray(theta, dtype=float))
        self.evaluations += len(t)
        value = self.likelihood.log_likelihood(self.prior.matrix(t), self.prior.factors(t))
        if self.extra is None:
            return value
        further = np.asarray(self.extra(t), dtype=float)
        if further.shape != value.shape or np.isnan(further).any():
            nan = ", with NaN," if np.isnan(further).any() else ""
            found = f"found values of shape {further.shape}{nan} for θ of shape {t.shape}"
            expected = f"one number, or -inf, for each row: shape {value.shape}"
            raise ModelError.of("extra log likelihood", (), found, expected)
        return value + further

    def standardised(self, theta: ArrayLike) -> Residuals:
        """Residuals over σ, see `Likelihood.standardised`, at θ, shape (n, d) or (d,)."""
        return self.likelihood.standardised(*self._points(theta))

    def predicted(self, theta: ArrayLike) -> NDArray[Any]:
        """What is compared with the data, see `Likelihood.predicted`, at θ, shape (n, d) or (d,)."""
        return self.likelihood.predicted(*self._points(theta))

    def variance(self, theta: ArrayLike) -> Array:
        """σ² of the measured values, see `Likelihood.variance`, at θ, shape (n, d) or (d,)."""
        return self.likelihood.variance(*self._points(theta))

    def white(self, theta: ArrayLike) -> Array:
        """Real residuals, shape (n, m), white with unit variance if model and noise hold, at θ, shape (n, d)."""
        self.evaluations += len(np.atleast_2d(theta))
        return self.likelihood.white(*self._points(theta))

    def typical_squares(self, theta: ArrayLike) -> tuple[float, int]:
        """Sum and number of the squared white residuals at one θ, see `Likelihood.typical_squares`."""
        return self.likelihood.typical_squares(*self._points(theta))

    def pointwise(self, theta: ArrayLike) -> Array:
        """ln L value by value, see `Likelihood.pointwise`, at θ, shape (n, d)."""
        return self.likelihood.pointwise(*self._points(theta))

    def _points(self, theta: ArrayLike) -> tuple[JointMatrix, Array]:
        """Joint matrices (n, R, R) and factors (n, q) at θ, shape (n, d) or (d,)."""
        points = np.atleast_2d(np.asarray(theta, dtype=float))
        return self.prior.matrix(points), self.prior.factors(points)

    @property
    def gaussian(self) -> bool:
        """Whether ln p is −eᵀe/2 of `residuals` and a constant inside the support."""
        return self.likelihood.gaussian and self.prior.gaussian and self.extra is None

    def residuals(self, theta: ArrayLike) -> tuple[Array, Array]:
        """Standardised residuals of data and prior, and their Jacobian, at one θ, shape (d,).

        Returns
        -------
        residual, jacobian : ndarray, shapes (m + d,) and (m + d, d)
            ln p = constant − eᵀe/2 inside the support and ∇ ln p = −Jᵀe where noise is Gaussian of known size. With
            another noise model this holds with its parameters held fixed; their columns are zero but for the prior.
            A prior of one's own counts as a normal one of its width, and a further term of the likelihood not at all.
        """
        t = np.asarray(theta, dtype=float)
        data, slope = self.data_residuals(t)
        root = np.sqrt(self.prior.precision)
        return (np.concatenate([data, root * (t - self.prior.mean)]), np.concatenate([slope, np.diag(root)]))

    def data_residuals(self, theta: ArrayLike) -> tuple[Array, Array]:
        """Return the part of `residuals` that belongs to the data, shape (m,), and its Jacobian, shape (m, d)."""
        t = np.asarray(theta, dtype=float)
        self.evaluations += 1 + t.size
        directions = self._parametrisation.changes(self.prior.joint(t))
        return self.likelihood.residuals(self.prior.matrix(t), directions, self.prior.factors(t))

    def gradient(self, theta: ArrayLike) -> Array:
        """∇ ln p, shape (n, d), of θ, shape (n, d), inside the support; shape (d,) of one θ, shape (d,).

        Exact in the joint's coordinates where nothing else is uncertain; otherwise by differences.
        """
        t = np.asarray(theta, dtype=float)
        many = np.atleast_2d(t)
        by_residuals = self._parametrisation.damped or not self.likelihood.has_slope
        if by_residuals and self.gaussian and not self.prior.nuisances:
            linearised = (self.residuals(point) for point in many)
            return np.array([-jacobian.T @ residual for residual, jacobian in linearised]).reshape(t.shape)
        if self.prior.nuisances or not self.gaussian:
            # differences inside the support, in one call; 0 along what has no room in it
            step, (n, d) = 1e-5 * np.minimum(self.prior.sd, 1.0), many.shape
            sides = [self.prior.moved(point, np.diag(sign * step)) for point in many for sign in (1, -1)]
            moved = np.reshape(sides, (n, 2, d, d))
            value = self(moved.reshape(-1, d)).reshape(n, 2, d)
            apart, by_difference = np.diagonal(moved[:, 0] - moved[:, 1], axis1=1, axis2=2), np.zeros((n, d))
            np.divide(value[:, 0] - value[:, 1], apart, out=by_difference, where=apart > 0)
            return by_difference.reshape(t.shape)
        _, slope = self.likelihood.gradient(self._parametrisation.matrix(self._parametrisation.values(many)))
        by_quantity = np.einsum("nij,kij->nk", slope, self._parametrisation.pattern)
        by_theta = np.einsum("nk,nkt->nt", by_quantity, self._parametrisation.derivative(many))
        return (by_theta - self.prior.precision * (many - self.prior.mean)).reshape(t.shape)
