"""Draws from two origins have the ends and shares of a dense grid, and count only where both found the same."""

import sys
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_t, norm

import jointbayes as jb
from jointbayes.inference import Landing, LogPosterior
from jointbayes.progress import Budget
from jointbayes.sampling import (
    ALONE,
    Quantities,
    SamplerSettings,
    draws_from_two_origins,
    fit_each_mode,
    independent_chains,
    run_adapted,
    second_opinion,
    starting_walkers,
)
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.kernels import Kernels
from jointbayes.sampling.origins import interval_errors
from jointbayes.sampling.stopping import END_TOLERANCE

BOTH = Quantities(("x", "y"), lambda theta: theta)
PROBABILITIES = (0.025, 0.5, 0.975)


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
        """Quantiles of x and y, and ln of the integral, by a dense grid."""
        axes = [np.linspace(low, high, n) for low, high in zip(*self.prior.support, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        value = np.concatenate([self(part) for part in np.array_split(points, 40)]).reshape(n, n)
        weight = np.exp(value - value.max())
        ends = [np.interp(PROBABILITIES, np.cumsum(weight.sum(axis=1 - i)) / weight.sum(), axes[i]) for i in range(2)]
        cell = np.prod([axis[1] - axis[0] for axis in axes])
        return np.array(ends), np.log(weight.sum() * cell) + value.max()


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
}


def found_of(sheet, seed, **options):
    at = np.zeros((0, 2))
    return draws_from_two_origins(Landing(sheet), at, np.random.default_rng(seed), BOTH, **options)


@pytest.mark.parametrize("name", SHEETS)
def test_ends_and_integral_are_those_of_a_grid(name):
    ends, log_z = SHEETS[name].by_grid()
    for seed in (1, 2, 3):
        found = found_of(SHEETS[name], seed)
        assert found is not None
        assert found.settled
        drawn = np.quantile(found.theta, PROBABILITIES, axis=0).T
        assert (np.abs(drawn - ends) / (ends[:, [2]] - ends[:, [0]])).max() < END_TOLERANCE
        assert abs(found.log_z - log_z) < 5 * found.log_z_error + 1e-3


def test_shares_of_two_modes_apart_are_right():
    """By the grid, not by the widths that made them: the factors are close to 0.77 and 0.23."""
    sheet = SHEETS["two modes"]
    y = np.linspace(-8, 8, 200_001)
    height = np.exp(-0.5 * ((y**2 - 9) / np.where(y > 0, 1.54, 0.46)) ** 2)
    share = height[y > 0].sum() / height.sum()
    assert share == pytest.approx(0.77, abs=0.005)
    for seed in (1, 2, 3):
        assert (found_of(sheet, seed).theta[:, 1] > 0).mean() == pytest.approx(share, abs=0.03)


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
    drawn = [(found_of(sheet, seed).theta[:, 1] < 0).mean() for seed in range(12)]
    assert np.mean(drawn) == pytest.approx(share, rel=0.3)


def test_what_only_one_origin_found_is_not_settled(monkeypatch):
    """One origin never comes down on y < 0: more than `ALONE` is its alone, and the run does not say it is done."""
    sheet, whole = SHEETS["two modes"], Landing.land
    calls = iter(range(100))

    def land(self, n, rng):
        theta, value = whole(self, n, rng)
        right = theta[:, 1] > 0 if next(calls) % 2 else theta[:, 1] < 20
        return theta[right], value[right]

    monkeypatch.setattr(Landing, "land", land)
    found = found_of(sheet, 1)
    assert not found.settled
    assert found.alone == pytest.approx(0.23, abs=0.05)


# ---- the second opinion on ensembles, which begin at the modes that a search has found

SETTINGS = SamplerSettings(walkers=16, max_steps=4000, tau_factor=20, end_tolerance=0.04)
UP, DOWN = (np.array([1.0, 3.0]), np.diag([1.0, 0.07])), (np.array([1.0, -3.0]), np.diag([1.0, 0.006]))


def by_ensembles(starts, seed):
    sheet, rng = SHEETS["two modes"], np.random.default_rng(seed)
    proposal = fit_each_mode(sheet, [Identity()], starts, None, rng)
    start = starting_walkers(starts, sheet.prior.log_density, SETTINGS, rng, proposal.shares)
    chains, _ = run_adapted(sheet, start, rng, SETTINGS, systems=[Identity()], proposal=proposal)
    assert chains.converged
    return chains


@pytest.mark.parametrize(("starts", "alone"), [([UP], 0.23), ([DOWN], 0.77), ([UP, DOWN], 0.0)])
def test_climbs_from_the_prior_find_what_ensembles_have_missed(starts, alone):
    """Shares are 0.77 and 0.23. The ensembles agree with each other wherever they begin."""
    chains = by_ensembles(starts, 1)
    opinion = second_opinion(Landing(SHEETS["two modes"]), chains, np.random.default_rng(2))
    judged = opinion.of(chains, SETTINGS)
    assert opinion.alone == pytest.approx(alone, abs=0.04 if alone else ALONE)
    if not alone:
        assert judged is chains
        assert (chains.theta[:, chains.held_burn_in :, :, 1] > 0).mean() == pytest.approx(0.77, abs=0.02)
        return
    assert (np.sign(opinion.missed[:, 1]) == -np.sign(starts[0][0][1])).all()
    assert not judged.converged
    assert judged.reason.startswith("not converged after ")
    assert judged.reason.endswith("% of the density was found from one origin only")


def test_climbs_that_miss_what_ensembles_have_found_do_not_confirm_them(monkeypatch):
    whole, climbs = Landing.land, []

    def land(self, n, rng):
        theta, value = whole(self, n, rng)
        climbs.append(n)
        return theta[theta[:, 1] > 0], value[theta[:, 1] > 0]

    monkeypatch.setattr(Landing, "land", land)
    chains = replace(by_ensembles([UP, DOWN], 1), evaluations=100_000)
    opinion = second_opinion(Landing(SHEETS["two modes"]), chains, np.random.default_rng(2))
    assert opinion.alone == pytest.approx(0.23, abs=0.04)
    assert climbs[:2] == [32, 64]  # a run of many evaluations can afford more
    assert not len(opinion.missed)
    assert not opinion.of(chains, SETTINGS).converged


def test_where_no_climb_comes_down_the_reason_says_that_nothing_confirms_the_draws(monkeypatch):
    monkeypatch.setattr(Landing, "land", lambda *_: (np.zeros((0, 2)), np.zeros(0)))
    chains = by_ensembles([UP], 1)
    judged = second_opinion(Landing(SHEETS["two modes"]), chains, np.random.default_rng(2)).of(chains, SETTINGS)
    assert judged.converged
    assert judged.reason.endswith("so that no second origin confirms that these are all")


def test_a_run_out_of_its_budget_gives_what_it_has_and_says_so():
    found = found_of(SHEETS["Gaussian"], 1, budget=Budget(50_000))
    chains = independent_chains(SHEETS["Gaussian"], found._replace(settled=False, error=0.08), 1.0)
    assert not chains.converged
    assert chains.theta.shape[-1] == 2


def test_errors_of_ends_are_those_of_independent_draws():
    values = norm.ppf((np.arange(4000) + 0.5) / 4000)[:, None]
    error, effective = interval_errors(values, np.full(4000, 1 / 4000))
    # sd of a quantile of n draws: √(p (1 − p) / n) / density there, over the interval's width
    assert error == pytest.approx(np.sqrt(0.025 * 0.975 / 4000) / 0.05845 / 3.92, rel=0.05)
    assert effective == pytest.approx(4000, rel=0.01)


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
