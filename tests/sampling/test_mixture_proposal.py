"""Proposals of several bells, in several coordinates, from several modes."""

import numpy as np
import pytest
from scipy import stats

from jointbayes.sampling import NormalScores, StudentT, distributions, fit_proposal, importance_efficiency
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.distributions import StudentMixture, first_mixture, most_likely_mixture, resampled
from jointbayes.sampling.kernels import Kernels
from jointbayes.sampling.proposal import Proposal

LEFT = StudentT(np.array([-4.0, 0.0]), np.array([[1.0, 0.5], [0.5, 1.0]]), 5.0)
RIGHT = StudentT(np.array([3.0, 2.0]), 0.25 * np.eye(2), 8.0)
TWO = StudentMixture((LEFT, RIGHT), np.array([0.8, 0.2]))


def unequal_modes(x):
    """Gaussians of masses 0.9 and 0.1, seven of their widths apart: integral one."""
    left = stats.multivariate_normal([-3.0, 0.0], np.eye(2)).logpdf(x)
    right = stats.multivariate_normal([4.0, 1.0], np.diag([0.25, 1.0])).logpdf(x)
    return np.logaddexp(np.log(0.9) + left, np.log(0.1) + right)


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

    def test_first_centres_reach_a_light_mode_far_off(self):
        near = np.random.default_rng(11).normal(size=(1000, 2))
        x = np.concatenate([near, near + 50.0])
        weight = np.repeat([0.995, 0.005], 1000) / 1000
        found = [first_mixture(x, weight, 4, np.random.default_rng(seed)) for seed in range(20)]
        # by weight alone one of fifty would
        assert sum(max(bell.mean[0] for bell in one.components[:-1]) > 40.0 for one in found) > 15


def exact(n, rng):
    """Draws of it."""
    left = rng.random(n) < 0.9
    normal = rng.normal(size=(n, 2))
    return np.where(left[:, None], normal - np.array([3.0, 0.0]), normal * [0.5, 1.0] + np.array([4.0, 1.0]))


class TestFit:
    @pytest.mark.parametrize("seed", range(3))
    def test_two_modes_are_both_proposed_with_their_masses(self, seed):
        rng = np.random.default_rng(seed)
        found = fit_proposal(unequal_modes, [Identity()], exact(6000, rng), rng)
        assert found.efficiency > 0.7
        right = found.density.draw(np.random.default_rng(20), 20_000)[:, 0] > 1.0
        # 0.95 of the weight follows the density, the wide rest is about both
        assert 0.95 * 0.1 - 0.02 < right.mean() < 0.95 * 0.1 + 0.05
        theta, log_weight = found.weighted_draws(unequal_modes, np.random.default_rng(21), 20_000)
        weight = np.exp(log_weight)
        assert weight.sum() / 20_000 == pytest.approx(1.0, abs=0.03)
        assert weight[theta[:, 0] > 1.0].sum() / weight.sum() == pytest.approx(0.1, abs=0.02)

    def test_coordinates_in_which_a_bell_fits_are_taken_and_no_others_tried(self):
        class Forbidden(Identity):
            def forward(self, theta):
                raise AssertionError

        rng = np.random.default_rng(1)
        density = lambda x: -0.5 * np.sum(x**2, axis=1)  # noqa: E731
        found = fit_proposal(density, [Identity(), Forbidden()], rng.normal(size=(6000, 2)), rng)
        assert type(found.coordinates) is Identity
        assert found.efficiency > 0.85  # of a t distribution with 5 degrees of freedom for a Gaussian: 0.94

    def test_the_coordinates_that_serve_are_taken(self):
        box, rng = NormalScores(np.zeros(3), np.full(3, 10.0)), np.random.default_rng(2)

        def flat(x):
            return np.where(((x > 0) & (x < 10)).all(axis=1), 0.0, -np.inf)

        found = fit_proposal(flat, [Identity(), box], 10 * rng.random((6000, 3)), rng)
        assert found.coordinates is box
        assert found.efficiency > 0.7

    def test_few_draws_that_carry_all_the_weight_are_a_start(self):
        """Draws of another density, weighted: a tenth as wide, and off by two of its widths."""
        rng = np.random.default_rng(3)
        density = lambda x: -0.5 * np.sum((x - 2) ** 2, axis=1)  # noqa: E731
        near = 2 + 0.1 * rng.normal(size=(6000, 2)) + [0.5, 0.0]
        assert fit_proposal(density, [Identity()], near, rng).efficiency > 0.8

    def test_a_bent_thread_is_straightened(self):
        rng = np.random.default_rng(4)
        x = rng.normal(size=6000)
        draws = np.column_stack([x, x**2 + 0.02 * rng.normal(size=x.size)])
        thread = lambda t: -0.5 * (t[:, 0] ** 2 + ((t[:, 1] - t[:, 0] ** 2) / 0.02) ** 2)  # noqa: E731
        found = fit_proposal(thread, [Identity()], draws, rng)
        assert found.efficiency > 0.8
        assert type(found.coordinates).__name__ == "StraightCoordinates"

    def test_points_that_are_hardly_proposed_are_told(self):
        """A narrow arm of a twentieth of the density, which a mixture fitted without it hardly proposes."""
        rng = np.random.default_rng(5)

        def with_arm(x):
            bulk = stats.multivariate_normal([0.0, 0.0], np.eye(2)).logpdf(x)
            arm = stats.multivariate_normal([0.0, 9.0], [0.01, 1.0]).logpdf(x)
            return np.logaddexp(np.log(0.95) + bulk, np.log(0.05) + arm)

        first = Proposal(StudentT(np.zeros(2), np.eye(2), 5.0), 0.5)
        on_arm = np.array([0.0, 9.0]) + rng.normal(size=(50, 2)) * [0.1, 1.0]
        missed = first.missed(with_arm, np.concatenate([rng.normal(size=(500, 2)), on_arm]), rng, 40)
        assert len(missed) == 40
        assert (missed[:, 1] > 5).all()

    def test_further_kernels_are_a_tenth_of_what_is_proposed(self):
        rng = np.random.default_rng(6)
        far = Kernels(np.array([[0.0, 50.0]]), np.eye(2)[None], np.zeros((1, 0, 0, 2)), np.ones(1))
        both = Proposal(StudentT(np.zeros(2), np.eye(2), 5.0), 0.5, further=far)
        drawn = both.draw(rng, 20_000)
        assert (drawn[:, 1] > 25).mean() == pytest.approx(0.1, abs=0.01)
        whole = Proposal(StudentT(np.zeros(2), np.eye(2), 5.0), 0.5)
        at = np.array([[0.0, 0.0], [0.0, 50.0]])
        exact = np.log(0.9 * np.exp(whole.log_density(at)) + 0.1 * np.exp(far.log_density(at)))
        np.testing.assert_allclose(both.log_density(at), exact)

    def test_the_efficiency_is_that_of_other_draws(self):
        for seed in range(4):
            rng = np.random.default_rng(seed)
            found = fit_proposal(unequal_modes, [Identity()], exact(6000, rng), rng)
            _, log_weight = found.weighted_draws(unequal_modes, np.random.default_rng(30 + seed), 20_000)
            assert importance_efficiency(log_weight) == pytest.approx(found.efficiency, abs=0.08)
            draws = exact(20_000, rng)
            assert found.efficiency_among(draws, unequal_modes(draws)) == pytest.approx(found.efficiency, abs=0.08)

    def test_draws_of_a_part_that_it_misses_tell_a_poor_efficiency(self):
        """Its own draws, none of which lies there, say that it is a good one."""
        left = Proposal(StudentT(np.array([-3.0, 0.0]), np.eye(2), 5.0), 0.9)
        draws = exact(5000, np.random.default_rng(6))
        assert left.efficiency_among(draws, unequal_modes(draws)) < 0.1


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
