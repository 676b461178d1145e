"""Proposals of several bells, in several coordinates, from several modes."""

import numpy as np
import pytest
from scipy import stats

from jointbayes.sampling import NormalScores, StudentT, distributions, fit_proposal, importance_efficiency
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.distributions import Pool, StudentMixture, first_mixture, most_likely_mixture, resampled, split

LEFT = StudentT(np.array([-4.0, 0.0]), np.array([[1.0, 0.5], [0.5, 1.0]]), 5.0)
RIGHT = StudentT(np.array([3.0, 2.0]), 0.25 * np.eye(2), 8.0)
TWO = StudentMixture((LEFT, RIGHT), np.array([0.8, 0.2]))


def unequal_modes(x):
    """Gaussians of masses 0.9 and 0.1, seven of their widths apart: integral one."""
    left = stats.multivariate_normal([-3.0, 0.0], np.eye(2)).logpdf(x)
    right = stats.multivariate_normal([4.0, 1.0], np.diag([0.25, 1.0])).logpdf(x)
    return np.logaddexp(np.log(0.9) + left, np.log(0.1) + right)


BOTH = ((np.array([-3.0, 0.0]), np.eye(2)), (np.array([4.0, 1.0]), np.eye(2)))


class TestStudentMixture:
    def test_log_density_is_the_weighted_sum(self):
        x = np.random.default_rng(1).normal(scale=5.0, size=(50, 2))
        bells = (stats.multivariate_t(b.mean, b.scale, b.dof).pdf(x) for b in (LEFT, RIGHT))
        expected = np.log(sum(w * p for w, p in zip((0.8, 0.2), bells, strict=True)))
        np.testing.assert_allclose(TWO.log_density(x), expected, rtol=1e-12)

    @pytest.mark.parametrize("random", [np.random.default_rng(2), np.random.RandomState(2)], ids=["new", "old"])
    def test_every_draw_is_from_the_mixture_whatever_its_place(self, random):
        side = np.array([TWO.draw(random, 10)[:, 0] > 0.5 for _ in range(2000)])
        # P(x > 0.5) of each component, and so of each place
        expected = 0.8 * stats.t(5).sf(4.5) + 0.2 * stats.t(8).sf(-5.0)
        assert np.abs(side.mean(axis=0) - expected).max() < 4.5 * np.sqrt(expected / 2000)


class TestWeights:
    def test_tempering_leaves_enough_draws_and_no_more_than_needed(self):
        log_weight = 50.0 * np.random.default_rng(6).normal(size=1000)
        weight = distributions.tempered(log_weight, 50)
        assert 1 / (weight**2).sum() >= 50
        np.testing.assert_allclose(distributions.tempered(np.zeros(4), 4), 0.25)

    def test_resampling_gives_each_draw_its_share_to_within_one(self):
        weight = np.random.default_rng(7).dirichlet(np.full(20, 0.3))
        counts = np.bincount(resampled(weight, 1000, np.random.default_rng(8)), minlength=20)
        assert np.abs(counts - 1000 * weight).max() < 1.0


class TestMixtureFit:
    def test_weights_centres_and_scales_are_those_of_the_draws(self):
        x = TWO.draw(np.random.default_rng(9), 20_000)
        weight = np.full(len(x), 1 / len(x))
        mixture = first_mixture(x, weight, 2, np.random.default_rng(1))
        for _ in range(4):
            mixture = most_likely_mixture(mixture, x, weight)
        # beside the wide component of 0.05 that both share
        order = np.argsort([bell.mean[0] for bell in mixture.components[:-1]])
        assert mixture.weights[-1] == pytest.approx(0.05)
        np.testing.assert_allclose(mixture.weights[order] / 0.95, [0.8, 0.2], atol=0.02)
        for bell, known in zip(np.array(mixture.components[:-1], dtype=object)[order], (LEFT, RIGHT), strict=True):
            np.testing.assert_allclose(bell.mean, known.mean, atol=0.06)
            np.testing.assert_allclose(bell.scale, known.scale, atol=0.15)

    def test_components_without_draws_are_dropped(self):
        x = LEFT.draw(np.random.default_rng(10), 2000)
        mixture = StudentMixture((LEFT, RIGHT, LEFT), np.array([0.5, 0.3, 0.2]))
        kept = most_likely_mixture(mixture, x, np.full(2000, 1 / 2000))
        assert len(kept.components) == 2

    def test_splitting_keeps_place_and_weight(self):
        halves = split(TWO)
        assert len(halves.components) == 3
        assert halves.weights[:2].sum() == pytest.approx(0.8)
        np.testing.assert_allclose(np.mean([b.mean for b in halves.components[:2]], axis=0), LEFT.mean, atol=1e-12)
        assert min(np.linalg.eigvalsh(b.scale).min() for b in halves.components) > 0

    def test_first_centres_reach_a_light_mode_far_off(self):
        near = np.random.default_rng(11).normal(size=(1000, 2))
        x = np.concatenate([near, near + 50.0])
        weight = np.repeat([0.995, 0.005], 1000) / 1000
        found = [first_mixture(x, weight, 4, np.random.default_rng(seed)) for seed in range(20)]
        # by weight alone one of fifty would
        assert sum(max(bell.mean[0] for bell in one.components[:-1]) > 40.0 for one in found) > 15


class TestPool:
    def test_weights_are_over_the_mixture_of_all_proposals(self):
        rng = np.random.default_rng(12)
        pool = Pool(unequal_modes, 2)
        box = NormalScores([-20.0, -20.0], [20.0, 20.0])
        pool.extend(StudentT(np.zeros(2), 16.0 * np.eye(2), 5.0), Identity(), rng, 3000)
        pool.extend(StudentT(np.zeros(2), 0.1 * np.eye(2), 5.0), box, rng, 2000)
        pool.extend(LEFT, Identity(), rng, 1000)
        # weights over the sum of counts times densities add up to the integral, which is one
        assert np.exp(pool.log_weight).sum() == pytest.approx(1.0, abs=0.05)


class TestFit:
    @pytest.mark.parametrize("seed", range(3))
    def test_two_modes_are_both_proposed_with_their_masses(self, seed):
        found = fit_proposal(unequal_modes, [None], BOTH, np.random.default_rng(seed))
        assert isinstance(found.density, StudentMixture)
        assert found.efficiency > 0.7
        right = found.density.draw(np.random.default_rng(20), 20_000)[:, 0] > 1.0
        # 0.95 of the weight follows the density, the wide rest is about both
        assert 0.95 * 0.1 - 0.02 < right.mean() < 0.95 * 0.1 + 0.05
        theta, log_weight = found.weighted_draws(unequal_modes, np.random.default_rng(21), 20_000)
        weight = np.exp(log_weight)
        assert weight.sum() / 20_000 == pytest.approx(1.0, abs=0.03)
        assert weight[theta[:, 0] > 1.0].sum() / weight.sum() == pytest.approx(0.1, abs=0.02)

    def test_one_start_that_a_bell_fits_gives_one_bell_and_asks_no_other_coordinates(self):
        class Forbidden(Identity):
            def forward(self, theta):
                raise AssertionError

        start, density = (np.zeros(2), np.eye(2)), lambda x: -0.5 * np.sum(x**2, axis=1)
        found = fit_proposal(density, [None, Forbidden()], [start], np.random.default_rng(1))
        assert isinstance(found.density, StudentT)
        assert type(found.coordinates) is Identity

    def test_the_coordinates_that_serve_are_taken(self):
        box = NormalScores(np.zeros(3), np.full(3, 10.0))

        def flat(x):
            return np.where(((x > 0) & (x < 10)).all(axis=1), -0.1 * x[:, 0], -np.inf)

        start = (np.array([0.5, 5.0, 9.999]), np.eye(3))
        found = fit_proposal(flat, [None, box], [start], np.random.default_rng(2))
        assert found.coordinates is box
        assert found.efficiency > 0.7

    def test_evaluations_are_those_made(self):
        calls, box = [], NormalScores([-20.0, -20.0], [20.0, 20.0])

        def counted(x):
            calls.append(len(x))
            return unequal_modes(x)

        assert fit_proposal(counted, [None, box], BOTH, np.random.default_rng(3)).evaluations == sum(calls)

    def test_the_efficiency_is_that_of_other_draws(self):
        for seed in range(4):
            found = fit_proposal(unequal_modes, [None], BOTH, np.random.default_rng(seed))
            _, log_weight = found.weighted_draws(unequal_modes, np.random.default_rng(30 + seed), 20_000)
            assert importance_efficiency(log_weight) == pytest.approx(found.efficiency, abs=0.08)


class TestTruncatedWeights:
    def test_truncation_cuts_at_root_n_times_the_mean(self):
        log_weight = np.log([1.0, 1.0, 100.0])
        cut = distributions.truncated(log_weight, 4)  # a fourth draw had weight zero: mean 25.5, √4 times that 51
        np.testing.assert_allclose(np.exp(cut), [1.0, 1.0, 51.0])

    def test_draws_are_chosen_by_their_weights_and_none_twice(self):
        rng = np.random.default_rng(1)
        picked = [distributions.drawn_without_replacement(np.log([1.0, 2.0, 7.0]), 2, rng) for _ in range(4000)]
        assert all(len(set(one.tolist())) == 2 for one in picked)
        first = np.bincount([one[0] for one in picked], minlength=3) / 4000
        np.testing.assert_allclose(first, [0.1, 0.2, 0.7], atol=0.03)
        assert len(distributions.drawn_without_replacement(np.zeros(3), 9, rng)) == 3
