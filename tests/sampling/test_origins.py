"""Draws have the ends and shares of a dense grid, and count only where two origins found the same."""

import re
import sys
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_t, norm, truncnorm

import jointbayes as jb
from jointbayes.inference import Landing, LogPosterior
from jointbayes.progress import Budget
from jointbayes.sampling import NormalScores, Quantities, SamplerSettings, draw, sampler
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.kernels import Kernels
from jointbayes.sampling.origins import _distinct, two_origins
from jointbayes.sampling.stopping import END_TOLERANCE

BOTH = Quantities(("x", "y"), lambda theta: theta)
PROBABILITIES = (0.025, 0.5, 0.975)
SETTINGS = SamplerSettings(walkers=24, max_steps=8000)


@dataclass
class Box:
    """A uniform prior on a box, as `JointPrior` is asked."""

    low: np.ndarray
    high: np.ndarray
    precision = np.zeros(2)
    marginals = (0, 0)

    @property
    def support(self):
        return self.low, self.high

    @cached_property
    def mean(self):
        return (self.low + self.high) / 2

    @cached_property
    def sd(self):
        return (self.high - self.low) / np.sqrt(12)

    def feasible(self, theta):
        return ((theta >= self.low) & (theta <= self.high)).all(axis=-1)

    def log_density(self, theta):
        return np.where(self.feasible(np.atleast_2d(theta)), -np.log(self.high - self.low).sum(), -np.inf)

    def transform(self, u):
        return self.low + u * (self.high - self.low)


class Sheet:
    """Posterior of two unknowns in a box with these white residuals, shape (n, m)."""

    likelihood = SimpleNamespace(n_data=2, hyper_count=0, gaussian=False)

    def __init__(self, residuals, low, high):
        self.white, self.prior = residuals, Box(np.array(low, float), np.array(high, float))
        self.evaluations = 0

    def __call__(self, theta):
        self.evaluations += len(theta)
        return self.prior.log_density(theta) - 0.5 * (self.white(theta) ** 2).sum(axis=1)

    def by_grid(self, n=4000):
        """Quantiles of x and y by a dense grid."""
        axes = [np.linspace(low, high, n) for low, high in zip(*self.prior.support, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        value = np.concatenate([self(part) for part in np.array_split(points, 40)]).reshape(n, n)
        weight = np.exp(value - value.max())
        ends = [np.interp(PROBABILITIES, np.cumsum(weight.sum(axis=1 - i)) / weight.sum(), axes[i]) for i in range(2)]
        return np.array(ends)


def columns(*parts):
    return np.column_stack(parts)


SHEETS = {
    "Gaussian": Sheet(lambda t: columns(t[:, 0] - 1, (t[:, 1] + t[:, 0]) / 0.3), (-20, -20), (20, 20)),
    "banana": Sheet(lambda t: columns(t[:, 0] - 1, (t[:, 1] - t[:, 0] ** 2) / 0.2), (-8, -10), (8, 30)),
    # a spring and the one behind it: only their sum of compliances is known
    "two springs": Sheet(lambda t: columns(np.log(np.exp(-t[:, 0]) + np.exp(-t[:, 1])) / 0.05), (-4, -4), (12, 12)),
    # 0.77 of the probability has y = 1.54, and 0.23 has y = -0.46: the sheet is as much thicker there
    "two modes": Sheet(
        lambda t: columns(t[:, 0] - 1, (t[:, 1] - 3.0) * (t[:, 1] + 3.0) / np.where(t[:, 1] > 0, 1.54, 0.46)),
        (-6, -8),
        (8, 8),
    ),
    "plateau": Sheet(lambda t: columns(t[:, 0], 4 / (1 + np.exp(2 * t[:, 1]))), (-6, -15), (6, 25)),
    # two unknowns of which the second sets the width of the first
    "funnel": Sheet(lambda t: columns(t[:, 1], t[:, 0] / np.exp(0.6 * t[:, 1])), (-30, -4), (30, 4)),
}
MODES = {"plateau": (0.0, 3.0), "funnel": (0.0, 0.0), "two springs": (1.0, 1.0)}


def drawn_of(sheet, seed, mode=(1.0, 3.0), settings=SETTINGS, **options):
    at, rng = np.array([mode]), np.random.default_rng(seed)
    systems = Identity(), NormalScores(*sheet.prior.support)
    return draw(Landing(sheet), at, rng, settings, systems=systems, quantities=BOTH, **options)[0]


def kept(chains):
    return chains.draws().theta.reshape(-1, 2)


@pytest.mark.parametrize("name", SHEETS)
def test_ends_are_those_of_a_grid(name):
    ends = SHEETS[name].by_grid()
    for seed in (1, 2, 3):
        chains = drawn_of(SHEETS[name], seed, MODES.get(name, (1.0, 1.0)))
        assert chains.converged, chains.reason
        drawn = np.quantile(kept(chains), PROBABILITIES, axis=0).T
        assert (np.abs(drawn - ends) / (ends[:, [2]] - ends[:, [0]])).max() < END_TOLERANCE


def test_shares_of_two_modes_apart_are_right():
    """By the grid, not by the widths that made them: the factors are close to 0.77 and 0.23."""
    sheet = SHEETS["two modes"]
    y = np.linspace(-8, 8, 200_001)
    height = np.exp(-0.5 * ((y**2 - 9) / np.where(y > 0, 1.54, 0.46)) ** 2)
    share = height[y > 0].sum() / height.sum()
    assert share == pytest.approx(0.77, abs=0.005)
    for seed in (1, 2, 3):
        assert (kept(drawn_of(sheet, seed))[:, 1] > 0).mean() == pytest.approx(share, abs=0.03)


def test_a_thin_mode_has_its_share():
    """All climbs to it end at one point, which must make one long kernel and not many short ones."""
    thickness = 0.0031
    sheet = Sheet(
        lambda t: columns(t[:, 0] - 1, (t[:, 1] ** 2 - 9) / np.where(t[:, 1] > 0, 1.54, thickness)), (-6, -8), (8, 8)
    )
    y = np.linspace(-8, 8, 4_000_001)
    height = np.exp(-0.5 * ((y**2 - 9) / np.where(y > 0, 1.54, thickness)) ** 2)
    share = height[y < 0].sum() / height.sum()
    assert share == pytest.approx(0.002, rel=0.01)
    at = np.array([[1.0, 3.0]])
    drawn = [(two_origins(Landing(sheet), at, np.random.default_rng(s)).theta[:, 1] < 0).mean() for s in range(12)]
    assert np.mean(drawn) == pytest.approx(share, rel=0.3)


def test_climbs_that_end_at_one_point_are_one_place():
    places, bent = _distinct(Landing(SHEETS["banana"]), np.array([[1.0, 1.0], [1.0, 1.0 + 1e-9], [0.0, 0.0]]))
    np.testing.assert_array_equal(places, [[1.0, 1.0], [0.0, 0.0]])
    assert bent == 1


def landing_only(monkeypatch, wanted):
    """From now on climbs of every second origin, or of all, are lost where they end elsewhere; list their numbers."""
    whole, climbs = Landing.land, []

    def land(self, n, rng):
        theta, value = whole(self, n, rng)
        climbs.append(n)
        there = wanted(theta, len(climbs))
        return theta[there], value[there]

    monkeypatch.setattr(Landing, "land", land)
    return climbs


@pytest.mark.parametrize(("first", "alone"), [(1, 0.77), (-1, 0.23)])
def test_what_only_one_origin_found_is_not_settled(monkeypatch, first, alone):
    """The second origin comes down on one mode only: more than `ALONE` is known from the first one only."""
    climbs = landing_only(monkeypatch, lambda theta, number: (number % 2 == 1) | (first * theta[:, 1] < 0))
    chains = drawn_of(SHEETS["two modes"], 1, settings=replace(SETTINGS, max_evaluations=1_000_000))
    assert not chains.converged
    assert climbs[-1] > climbs[0]  # it has looked from more places
    assert chains.reason.startswith("not converged after ")
    share = re.fullmatch(r".*; (.*) % of the density was found from one origin only", chains.reason)
    assert float(share[1]) == pytest.approx(100 * alone, abs=6)
    # what was found is drawn all the same
    assert (kept(chains)[:, 1] > 0).mean() == pytest.approx(0.77, abs=0.03)


def test_climbs_find_a_mode_that_the_search_has_missed():
    """The only mode that is known has a share of 0.23."""
    chains = drawn_of(SHEETS["two modes"], 1, (1.0, -3.0))
    assert chains.converged
    assert (kept(chains)[:, 1] > 0).mean() == pytest.approx(0.77, abs=0.03)


def test_where_no_climb_comes_down_the_reason_says_that_nothing_confirms_the_draws(monkeypatch):
    landing_only(monkeypatch, lambda theta, _: np.zeros(len(theta), dtype=bool))
    chains = drawn_of(SHEETS["Gaussian"], 1, (1.0, -1.0))
    assert chains.converged
    assert chains.reason.endswith("so that no second origin confirms that these are all")


def test_where_weights_say_nothing_nearness_tells_what_one_origin_only_has_found(monkeypatch):
    """As in many dimensions, where kernels do not resemble the density."""
    monkeypatch.setattr(sampler, "RESEMBLES", 2.0)
    assert drawn_of(SHEETS["two modes"], 1).converged
    landing_only(monkeypatch, lambda theta, number: (number % 2 == 1) | (theta[:, 1] > 0))
    chains = drawn_of(SHEETS["two modes"], 1, settings=replace(SETTINGS, max_evaluations=1_000_000))
    assert not chains.converged
    assert chains.reason.endswith("% of the density was found from one origin only")


def test_walkers_start_in_a_corner_of_the_support_where_hardly_a_draw_of_the_kernels_lies():
    """A plane wave of density that is highest where two ends of the box meet: three of four draws lie outside."""
    corner = Sheet(lambda t: columns((t[:, 0] + 8) / 3, (t[:, 1] + 8) / 3), (-6, -6), (20, 20))
    at = np.array([[-6.0, -6.0]]) + 1e-6
    chains = drawn_of(corner, 1, at[0])
    assert chains.converged
    for column in kept(chains).T:  # a normal about -8, cut off at -6
        exact = truncnorm.ppf(PROBABILITIES, 2 / 3, np.inf, loc=-8, scale=3)
        assert np.quantile(column, PROBABILITIES) == pytest.approx(exact, abs=END_TOLERANCE * np.ptp(exact))


def test_a_run_out_of_its_budget_gives_what_it_has_and_says_so():
    chains = drawn_of(SHEETS["banana"], 1, budget=Budget(1))
    assert not chains.converged
    assert chains.steps == SETTINGS.check_every
    assert "(max_evaluations)" in chains.reason


def test_a_curve_too_thin_for_a_mixture_is_drawn_by_its_kernels(monkeypatch):
    """A thread over a parabola, a thousandth as thick as long: walkers hardly move on it by themselves."""
    thin = Sheet(lambda t: columns(t[:, 0], (t[:, 1] - np.sin(3 * t[:, 0])) / 0.002), (-6, -10), (6, 10))
    made = []
    whole = sampler.adapted
    monkeypatch.setattr(sampler, "adapted", lambda *a, **k: made.append(whole(*a, **k)) or made[-1])
    for seed in (1, 2):
        chains = drawn_of(thin, seed, (0.0, 0.0))
        assert chains.converged
        x, y = kept(chains).T
        assert np.quantile(x, PROBABILITIES) == pytest.approx(norm.ppf(PROBABILITIES), abs=0.05 * 3.92)
        assert (y - np.sin(3 * x)).std() == pytest.approx(0.002, rel=0.1)
        assert made[-1][1] > 0.05
        assert chains.move_acceptance["independence"] > 10 * chains.move_acceptance["differential evolution"]


def test_the_density_of_a_bent_kernel_is_that_of_its_draws():
    """By a grid it integrates to one, and y lies as far up as the draws do, u² b / 2 away from the axis."""
    kernels = Kernels(np.zeros((1, 2)), np.diag([1.0, 0.1])[None], np.array([[[[0.0, 0.8]]]]), np.ones(1))
    x, y = np.linspace(-60, 60, 3001), np.linspace(-20, 300, 16001)
    total, up = 0.0, 0.0
    for column in x:
        weight = np.exp(kernels.log_density(np.column_stack([np.full(y.size, column), y])))
        total += weight.sum()
        up += (weight * np.minimum(y, 3.0)).sum()
    cell = (x[1] - x[0]) * (y[1] - y[0])
    assert total * cell == pytest.approx(1.0, abs=0.003)
    drawn = np.minimum(kernels.draw(np.random.default_rng(1), 200_000)[:, 1], 3.0)
    assert drawn.mean() == pytest.approx(up * cell, abs=5 * drawn.std() / np.sqrt(drawn.size))


@pytest.mark.parametrize(("d", "bent", "n"), [(1, 0, 1), (2, 1, 64), (3, 0, 65), (4, 3, 200)])
def test_each_kernel_is_a_bent_student_t(d, bent, n):
    rng = np.random.default_rng(d)
    bend = rng.normal(size=(7, bent, bent, d))
    kernels = Kernels(rng.normal(size=(7, d)), rng.normal(size=(7, d, d)), bend + bend.swapaxes(1, 2), rng.random(7))
    theta = kernels.draw(rng, n)
    each = kernels.log_densities(theta)
    z = np.linalg.solve(kernels.axes[0], (theta - kernels.places[0]).T)
    z -= np.linalg.solve(kernels.axes[0], np.einsum("an,bn,abd->dn", z[:bent], z[:bent], kernels.bend[0]) / 2) * (
        np.arange(d) >= bent
    ).reshape(-1, 1)
    exact = multivariate_t(np.zeros(d), np.eye(d), df=5).logpdf(z.T) - np.linalg.slogdet(kernels.axes[0])[1]
    np.testing.assert_allclose(each[0], exact, atol=1e-10)
    np.testing.assert_allclose(kernels.log_density(theta), logsumexp(each.T, b=kernels.weights, axis=1), atol=1e-10)


def test_the_walk_from_sample_to_the_density_has_ten_frames_at_most(cheap_case, monkeypatch):
    """Printed by ``pytest -s``: functions on the way to the density while the ensembles step."""
    walks = set()
    whole = LogPosterior.__call__

    def looked_at(self, theta):
        names, frame = [], sys._getframe(1)
        while frame is not None and frame.f_code.co_name != "sample":
            names.append(frame.f_code.co_name)
            frame = frame.f_back
        if frame is not None and "propose" in names:
            walks.add(("sample", *reversed(names)))
        return whole(self, theta)

    monkeypatch.setattr(LogPosterior, "__call__", looked_at)
    jb.sample(cheap_case, settings=SamplerSettings(walkers=8, max_steps=100), premises="exact")
    print("\n".join(" → ".join(walk) for walk in walks))
    assert walks
    assert max(map(len, walks)) <= 10
