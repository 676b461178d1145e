"""The climb ends where scipy's optimisers do: in a box, along bent ridges, with coordinates fixed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import optimize

import jointbayes as jb
from jointbayes.inference.climb import PosteriorSquares, climb_all


class _Box:
    """Stands for a prior that is flat between two ends."""

    def __init__(self, end, size):
        self.support = low, high = np.full(size, -end), np.full(size, end)
        self.sd, self.mean, self.precision = (high - low) / np.sqrt(12), np.zeros(size), np.zeros(size)

    def feasible(self, theta):
        return (np.abs(theta) <= self.support[1]).all(axis=-1)


@dataclass
class _Squares:
    """Squares of residuals in closed form."""

    prior: _Box
    residuals: Callable[[np.ndarray], np.ndarray]
    columns: np.ndarray
    linearised = None

    def value(self, theta):
        return np.where(self.prior.feasible(theta), -(self.residuals(theta) ** 2).sum(axis=-1) / 2, -np.inf)


def _squares(end, size, residuals, columns=None):
    return _Squares(_Box(float(end), size), residuals, np.arange(size) if columns is None else columns)


def _climb(squares, starts):
    return climb_all(squares, np.array(starts, dtype=float), 600, fine=True)


@pytest.mark.parametrize("seed", range(5))
def test_a_quadratic_in_a_box_ends_where_bounded_least_squares_do(seed):
    rng = np.random.default_rng(seed)
    slope, offset = rng.normal(size=(12, 5)) * np.logspace(0, 2, 5), 30 * rng.normal(size=12)
    best = optimize.lsq_linear(slope, offset, (-1, 1), tol=1e-14).x
    assert (np.abs(best) > 1 - 1e-9).any()
    squares = _squares(1, 5, lambda theta: theta @ slope.T - offset)
    ends, _ = _climb(squares, rng.uniform(-0.9, 0.9, (4, 5)))
    np.testing.assert_allclose(ends, np.tile(best, (4, 1)), atol=1e-6)


def test_bent_ridges_are_followed_to_their_end():
    def valley(theta):  # Rosenbrock's in three unknowns, a million times as steep across as along
        return np.concatenate([1000 * (theta[..., 1:] - theta[..., :-1] ** 2), 1 - theta[..., :1]], axis=-1)

    ends, value = _climb(_squares(4, 3, valley), [[-1.2] * 3, [1.3] * 3])
    np.testing.assert_allclose(ends, np.ones((2, 3)), atol=1e-5)
    assert value == pytest.approx(0, abs=1e-9)


def test_coordinates_that_are_fixed_stay_and_the_others_are_best_for_them():
    slope = np.random.default_rng(1).normal(size=(9, 4))
    squares = _squares(9, 4, lambda theta: theta @ slope.T - 1, np.array([0, 2]))
    start = np.array([0.5, -1.0, 0.3, 2.0])
    (end,), _ = _climb(squares, [start])
    assert (end[[1, 3]] == start[[1, 3]]).all()
    best = np.linalg.lstsq(slope[:, [0, 2]], 1 - slope[:, [1, 3]] @ start[[1, 3]], rcond=None)[0]
    np.testing.assert_allclose(end[[0, 2]], best, atol=1e-7)


def test_the_mode_of_a_posterior_is_that_of_trust_region_least_squares(cheap_case):
    density = cheap_case.problem.log_posterior
    start, (low, high) = jb.find_map(cheap_case).theta + 0.05, density.prior.support
    squares = PosteriorSquares(density, exact=True)
    (end,), (value,) = climb_all(squares, start[None], 200, fine=True)
    best = optimize.least_squares(
        lambda theta: density.residuals(theta)[0], start, lambda theta: density.residuals(theta)[1],
        bounds=(low, high), x_scale=density.prior.sd, xtol=1e-15, ftol=1e-15, gtol=1e-12,
    ).x  # fmt: skip
    _, jacobian = density.residuals(end)
    assert np.abs(jacobian @ (end - best)).max() < 1e-5  # standard deviations of the residuals
    assert value == pytest.approx(density(end)[0])
