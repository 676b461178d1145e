"""The same posterior in JAX, with gradients by automatic differentiation, in unconstrained coordinates for NUTS.

JAX is imported where it is needed: the other benchmarks run without it.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.peers import Test
from jointbayes.inference import Problem
from jointbayes.structure import LossFactor, ModalDamping


def log_likelihood(problem: Problem) -> Callable[[Any], Any]:
    """ln L of one joint's (k11, k12, k22), shape (3,), as a JAX function."""
    import jax

    jax.config.update("jax_enable_x64", True)
    test = Test(problem)
    receptance = _coupled(test) if isinstance(test.law, LossFactor) else _modal(test, problem)

    def value(stiffness: Any) -> Any:
        difference = receptance(stiffness) - test.measured
        return test.constant - ((difference.real**2 + difference.imag**2) / test.variance).sum()

    return value


def _coupled(test: Test) -> Callable[[Any], Any]:
    """Low-rank coupling with the 2 × 2 inverse written out: structural loss factor."""
    a_jj, a_jp, a_oi = test.free()
    a11, a12, a22 = a_jj[:, 0, 0], a_jj[:, 0, 1], a_jj[:, 1, 1]
    (in_1, out_1), (in_2, out_2) = a_jp[:, 0].T, a_jp[:, 1].T

    def receptance(stiffness: Any) -> Any:
        k11, k12, k22 = stiffness
        determinant = k11 * k22 - k12**2
        d11, d12, d22 = k22 / determinant + a11, a12 - k12 / determinant, k11 / determinant + a22
        numerator = out_1 * in_1 * d22 - (out_1 * in_2 + out_2 * in_1) * d12 + out_2 * in_2 * d11
        return a_oi - numerator / (d11 * d22 - d12**2)

    return receptance


def _modal(test: Test, problem: Problem) -> Callable[[Any], Any]:
    """Modal sum over the modes of the assembled structure, found in its free modes.

    The eigenproblem is that of the inverse, so that rounding is relative to the lowest modes.
    """
    import jax.numpy as jnp

    assert isinstance(test.law, ModalDamping)
    modes = test.modes()
    shift = test.structure.shift
    inverse = 1 / (modes.eigenvalues + shift)
    at_joint = modes.shapes.T @ test.joined
    driven = inverse[:, None] * at_joint
    flexibility = at_joint.T @ driven
    out, into = (test.out.T @ modes.shapes)[0], (test.into.T @ modes.shapes)[0]
    ratio, omega = test.law.per_mode(len(inverse)), test.omega

    def receptance(stiffness: Any) -> Any:
        k11, k12, k22 = stiffness
        matrix = jnp.array([[k11, k12], [k12, k22]])
        coupled = matrix @ jnp.linalg.inv(jnp.eye(2) + flexibility @ matrix)
        values, vectors = jnp.linalg.eigh(jnp.diag(inverse) - driven @ coupled @ driven.T)
        # a rigid joint leaves modes without any inverse eigenvalue: they are far above the band
        shifted = 1 / jnp.maximum(values, np.finfo(float).eps * inverse.max())
        squared = shifted[::-1] - shift
        constants = ((out @ vectors) * (into @ vectors))[::-1]
        natural = jnp.sqrt(jnp.maximum(squared, 1e-12))
        # one product of real matrices: complex division and its derivative take three times as long
        rate = 2 * ratio * natural
        apart = squared[:, None] - omega**2
        weights = jnp.stack([constants * squared, constants, constants * rate])
        static, inertial, damped = weights @ (1 / (apart**2 + (rate**2)[:, None] * omega**2))
        return static - omega**2 * inertial - 1j * omega * damped

    return receptance


def to_theta(problem: Problem, unbounded: Any) -> Any:
    """θ = ln k inside the box of the prior from unbounded coordinates, shape (..., 3)."""
    import jax

    low, high = problem.prior.support
    return low + (high - low) * jax.nn.sigmoid(unbounded)


def to_unbounded(problem: Problem, theta: np.ndarray) -> np.ndarray:
    """Unbounded coordinates of θ, shape (..., 3)."""
    low, high = problem.prior.support
    return np.log((theta - low) / (high - theta))


def log_density(problem: Problem) -> Callable[[Any], Any]:
    """Log posterior density of one point in unbounded coordinates, for uniform priors on ln k; −inf off the cone."""
    import jax
    import jax.numpy as jnp

    likelihood = log_likelihood(problem)

    def value(unbounded: Any) -> Any:
        theta = to_theta(problem, unbounded)
        inside = 2 * theta[1] < theta[0] + theta[2]
        # off the cone a harmless joint stands in, so that no NaN gets into the gradient
        joint = jnp.where(inside, theta, jnp.array([20.0, 10.0, 12.0]))
        volume = jax.nn.log_sigmoid(unbounded).sum() + jax.nn.log_sigmoid(-unbounded).sum()
        return jnp.where(inside, likelihood(jnp.exp(joint)) + volume, -jnp.inf)

    return value
