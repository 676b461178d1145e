"""Draws of a density are had from those of a restrained one, with ends as well known as is said."""

import re

import numpy as np
import pytest
from scipy.stats import norm

from jointbayes.inference import Independent, Uniform
from jointbayes.sampling import ENOUGH, NormalScores, Quantities, Restraint, independent_chains, released_draws
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.released import END_TOLERANCE, interval_errors

THIN = 5e-3
Z95 = norm.ppf(0.975)
LOW, HIGH = np.array([-20.0, -10.0, -np.inf]), np.array([20.0, 6.0, np.inf])


def curved_sheet(theta):
    """Data fix a + m + m²/4 + exp(b) to 0.005; m is normal, b uniform: where exp(b) is small it is unknown."""
    a, b, m = theta.T
    inside = ((theta > LOW) & (theta < HIGH)).all(axis=1)
    fixed = a + m + m**2 / 4 + np.exp(b)
    return np.where(inside, -0.5 * (fixed / THIN) ** 2 - 0.5 * m**2 - 0.5 * np.exp(b) ** 2, -np.inf)


def restrained(rng, n=2000):
    """Draws with m held at zero."""
    theta = np.zeros((n, 3))
    theta[:, 1] = rng.uniform(-10.0, 0.0, n)
    theta[:, 0] = -np.exp(theta[:, 1]) + THIN * rng.standard_normal(n)
    return theta


class Compliance:
    """(a, exp(b), m): the sheet is a parabola here, and what is flat in b a spike."""

    def forward(self, theta):
        return np.column_stack([theta[:, 0], np.exp(theta[:, 1]), theta[:, 2]])

    def inverse(self, phi):
        inside = phi[:, 1] > 0
        return np.column_stack([phi[:, 0], np.log(np.where(inside, phi[:, 1], 1.0)), phi[:, 2]]), inside

    def log_volume(self, theta):
        return -theta[:, 1]


def everything(theta):
    return theta


JUDGED = Quantities(("a", "b", "m"), everything)


@pytest.mark.science
@pytest.mark.parametrize("seed", [1, 2])
def test_a_thin_curved_sheet_is_followed_as_it_opens(seed):
    rng = np.random.default_rng(seed)
    systems = (Compliance(), NormalScores(LOW, HIGH))
    told, start = [], restrained(rng)
    more = {"restraint": Restraint(np.array([2]), np.array([1.0])), "tell": told.append}
    theta, effective, _ = released_draws(curved_sheet, systems, start, rng, JUDGED, **more)
    assert [line.partition(" of ")[0] for line in told] == [f"round {number}" for number in range(1, len(told) + 1)]
    assert len(told) >= 2
    assert effective >= 400
    exact = np.random.default_rng(0)
    b = exact.uniform(-10.0, 6.0, 400_000)
    b = b[exact.random(b.size) < np.exp(-0.5 * np.exp(2 * b))]
    m = exact.standard_normal(b.size)
    a = -(m + m**2 / 4 + np.exp(b))
    for drawn, known in zip(theta.T, (a, b, m), strict=True):
        ends, expected = (np.quantile(values, [0.025, 0.975]) for values in (drawn, known))
        assert ends == pytest.approx(expected, abs=3 * END_TOLERANCE * (expected[1] - expected[0]))


def on_a_plateau(theta):
    """Ln of a density with 3.5 % of its mass spread evenly up to 100, where its upper 95 % end is, at 28.6."""
    x = theta[:, 0]
    even = np.where((x > 0) & (x < 100), 0.035 / 100, 0.0)
    with np.errstate(divide="ignore"):
        return np.log(0.965 * norm.pdf(x) + even)


def test_an_end_on_a_plateau_is_good_enough_once_the_probability_beyond_it_is_known():
    rng = np.random.default_rng(2)
    around = np.concatenate([rng.standard_normal((1900, 1)), rng.uniform(0, 100, (100, 1))])
    judged = Quantities(("x",), everything)
    few, many = [], []
    released = released_draws(on_a_plateau, [Identity()], around, rng, judged, tell=few.append)
    assert released.effective >= ENOUGH
    assert released.error > END_TOLERANCE  # of the interval's width: to know it so well takes 90 000 draws
    assert (released.theta > 100 * (1 - 0.025 / 0.035)).mean() == pytest.approx(0.025, rel=0.35)
    chains = independent_chains(on_a_plateau, released, 0.0)
    assert re.search(r"the 2\.5 % beyond each end of a 95 % interval are good to 0\.\d+ %$", chains.reason)
    released_draws(on_a_plateau, [Identity()], around, rng, judged, enough=np.inf, tell=many.append)
    assert 10 <= len(few) < len(many) / 2


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_far_shelf_is_seen_by_draws_of_all_that_is_possible(seed):
    """A twentieth of the probability lies on a thin bent shelf that no draw near the bulk says anything of."""

    def bulk_and_shelf(theta):
        x, y = theta.T
        bulk = np.log(0.95) + norm.logpdf(x, 0, 0.1) + norm.logpdf(y, 0, 0.1)
        shelf = np.where((x > 1) & (x < 9), np.log(0.05 / 8) + norm.logpdf(y, x**2 / 10, 0.2), -np.inf)
        return np.where((np.abs(theta) < 10).all(axis=1), np.logaddexp(bulk, shelf), -np.inf)

    rng, systems = np.random.default_rng(seed), (NormalScores([-10.0, -10.0], [10.0, 10.0]),)
    near, wide = 0.1 * rng.standard_normal((2000, 2)), Independent((Uniform(-10.0, 10.0),) * 2)
    drawn = released_draws(bulk_and_shelf, systems, near, rng, Quantities(("x", "y"), everything), wide=wide)
    low, high = np.quantile(drawn.theta[:, 0], [0.025, 0.975])
    assert low == pytest.approx(-0.194, abs=0.03)
    assert high == pytest.approx(5.0, abs=3 * drawn.error * (high - low))


def test_nothing_is_said_where_the_density_is_not_found():
    rng = np.random.default_rng(1)
    nowhere = np.zeros((2000, 3)) + 30.0
    assert released_draws(curved_sheet, (Identity(),), nowhere[:0], rng, JUDGED) is None
    away = nowhere + 1e-3 * rng.standard_normal(nowhere.shape)
    assert released_draws(curved_sheet, (Identity(),), away, rng, JUDGED) is None


def test_the_error_of_the_ends_is_that_seen_over_repeats():
    lower, said = [], []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        x = 1.5 * rng.standard_normal(2000)
        weight = norm.pdf(x) / norm.pdf(x, scale=1.5)
        weight /= weight.sum()
        error, effective = interval_errors(x[:, None], weight)
        order = np.argsort(x)
        lower.append(np.interp(0.025, np.cumsum(weight[order]), x[order]))
        said.append(error)
        assert effective > 500
    seen = np.std(lower) / (2 * Z95)
    assert np.mean(said) == pytest.approx(seen, rel=0.3)
