"""Likelihood-ratio limits: known in closed form, equal to profiles, and what is printed of them."""

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize

import jointbayes as jb
from jointbayes.inference import JointPrior, Normal, Nuisance, OfStiffness, Uniform
from jointbayes.inference.climb import LimitClimb, climb_together, farthest_in_ball
from jointbayes.joint import parametrisation_named
from jointbayes.phrases import Reason
from jointbayes.posterior import Posterior, verdicts
from jointbayes.posterior.identifiability import assess, with_test_alone
from jointbayes.posterior.limits import FALL, LikelihoodRegion
from jointbayes.posterior.verdicts import region_of
from jointbayes.report.sections.identifiable import verdict_sentences
from jointbayes.rounding import quantity_text, with_interval
from jointbayes.verdict_rule import RULE
from tests.conftest import CONFIGS, PAIR, TO_CONVERGE, unsettled
from tests.posterior.test_verdicts import bound_at_draws, with_cached

SPRINGS = parametrisation_named("springs", ("x", "y"))
Z95 = 1.959963984540054


@dataclass
class Stated:
    """A density with a likelihood that is written down, and its draws on a grid of the support."""

    prior: JointPrior
    log_of: object

    def log_likelihood(self, theta):
        return self.log_of(np.atleast_2d(theta))

    def draws(self, count=4000):
        """Draws of the posterior by weight from the prior."""
        rng = np.random.default_rng(7)
        theta = self.prior.sample(rng, 200_000)
        weight = np.exp(self.log_likelihood(theta) - self.log_likelihood(theta).max())
        return theta[rng.choice(len(theta), count, p=weight / weight.sum())]

    def limits(self, index):
        return LikelihoodRegion(self, self.draws()).limits(index)


def springs(log_of, *marginals, nuisances=()):
    marginals = marginals or (Uniform(math.log(1e5), math.log(1e9)),) * 2
    return Stated(JointPrior(SPRINGS, marginals, nuisances), log_of)


def test_the_fall_is_a_quantile_of_chi_square():
    assert pytest.approx(Z95**2 / 2) == FALL


WIDE, MIDDLE, SD = Uniform(math.log(1e5), math.log(1e9)), math.log(1e7), 0.4
PRECISION = np.array([[40.0, -38.0], [-38.0, 41.0]])
CORRELATED_SD = math.sqrt(np.linalg.inv(PRECISION)[0, 0])
MODULUS = Nuisance("youngs_modulus", "GPa", 210.0, Normal(0.0, 0.04))


def about(middle, sd):
    return middle - Z95 * sd, middle + Z95 * sd


def one(theta):
    """A likelihood of the first spring alone."""
    return -0.5 * ((theta[:, 0] - MIDDLE) / SD) ** 2


def correlated(theta):
    away = theta - np.log([2e7, 5e6])
    return -0.5 * np.einsum("ni,ij,nj->n", away, PRECISION, away)


def two_places(theta):
    """The second is as likely by e^-0.5."""
    each = [-0.5 * (((theta - np.log(at)) / 0.05) ** 2).sum(axis=1) for at in ([1e6, 3e7], [3e7, 1e6])]
    return np.logaddexp(each[0], each[1] - 0.5)


def in_series(theta):
    """Two springs of which the sum of the flexibilities is known: each is open above, whatever is there."""
    return -0.5 * ((np.exp(-theta).sum(axis=1) - 1e-6) / 1e-7) ** 2


#: A likelihood, priors of both springs, what else is uncertain, ln of the limits of the first: NaN where it is open.
CLOSED = {
    "a correlated Gaussian": (correlated, (WIDE, WIDE), (), about(math.log(2e7), CORRELATED_SD)),
    "a normal prior is a measurement": (one, (Normal(MIDDLE, SD), WIDE), (), about(MIDDLE, SD / math.sqrt(2))),
    "a uniform one is none": (one, (WIDE, WIDE), (), about(MIDDLE, SD)),
    "uniform in k itself: a volume": (one, (OfStiffness(Uniform(1e5, 1e9)), WIDE), (), about(MIDDLE, SD)),
    "cut by its bound": (one, (Uniform(WIDE.low, MIDDLE + 0.3), WIDE), (), (MIDDLE - Z95 * SD, math.nan)),
    "the prior of a modulus is part of it": (  # only the product of spring and modulus is seen
        lambda theta: -0.5 * ((theta[:, 0] + theta[:, 2] - MIDDLE) / 0.03) ** 2, (WIDE, WIDE), (MODULUS,),
        about(MIDDLE, 0.05),
    ),
    "every mode that has draws": (
        two_places, (WIDE, WIDE), (),
        (math.log(1e6) - 0.05 * Z95, math.log(3e7) + 0.05 * math.sqrt(2 * (FALL - 0.5))),
    ),
    "an open ridge": (in_series, (WIDE, WIDE), (), (-math.log(1e-6 + Z95 * 1e-7 - 1e-9), math.nan)),
}  # fmt: skip


@pytest.mark.parametrize("name", CLOSED)
def test_limits_are_those_in_closed_form(name):
    log_of, marginals, nuisances, expected = CLOSED[name]
    found = springs(log_of, *marginals, nuisances=nuisances).limits(0)
    assert np.log(found) == pytest.approx(expected, abs=1e-3, nan_ok=True)


def test_climbs_that_stop_short_of_the_limit_are_gone_on_with(monkeypatch):
    centre, sd = np.log([2e7, 5e6]), 0.2
    problem = springs(lambda theta: -0.5 * (((theta - centre) / sd) ** 2).sum(axis=1))
    region = LikelihoodRegion(problem, problem.draws())
    end, calls = LimitClimb.end, []

    def stopped(self, *arguments, **options):
        calls.append(1)
        return end(self, *arguments, **options | ({"steps": 1} if len(calls) <= 2 else {}))

    monkeypatch.setattr(LimitClimb, "end", stopped)
    limits = region.limits(0)
    assert np.log(limits) == pytest.approx([centre[0] - Z95 * sd, centre[0] + Z95 * sd], abs=2e-3)


@pytest.mark.parametrize("seed", range(6))
def test_the_farthest_point_of_a_ball_between_faces_is_that_of_a_general_optimiser(seed):
    rng = np.random.default_rng(seed)
    slope, forward, sides = rng.normal(size=3), rng.normal(size=3), rng.normal(size=(4, 3))
    room, spare = rng.uniform(0.3, 1.5, 4), 1.0
    found = farthest_in_ball(slope, spare, forward, sides, room)
    ball = {"type": "ineq", "fun": lambda z: slope @ z - z @ z / 2 + spare}
    faces = {"type": "ineq", "fun": lambda z: room - sides @ z}
    best = optimize.minimize(lambda z: -forward @ z, np.zeros(3), method="SLSQP", constraints=[ball, faces])
    assert (sides @ found <= room + 1e-6).all()
    assert slope @ found - found @ found / 2 >= -spare - 1e-6
    # a face once held is not let go before the next step of the climb: never farther, and never at rest
    assert 0 < forward @ found <= -best.fun + 1e-6
    free = farthest_in_ball(slope, spare, forward, sides, room + 1e3)
    assert free == pytest.approx(slope + math.sqrt(2 * spare + slope @ slope) * forward / np.linalg.norm(forward))
    assert farthest_in_ball(slope, spare, None, sides, room + 1e3) == pytest.approx(slope)


def test_limits_of_a_likelihood_that_is_far_narrower_than_its_draws_are_its_own():
    """The best fit is a thin spike, in which hardly a draw lies: steps as wide as these lead nowhere."""
    spike, bulk = np.log([2e7, 5e6]), np.log([6e6, 4e6])
    along, across = 0.1, 0.002

    def log_of(theta):
        turned = (theta - spike) @ np.array([[1.0, 1.0], [1.0, -1.0]]) / math.sqrt(2)
        high = 5.0 - 0.5 * ((turned / (along, across)) ** 2).sum(axis=1)
        return np.logaddexp(high, -0.5 * (((theta - bulk) / 1.2) ** 2).sum(axis=1))

    draws = np.vstack([np.random.default_rng(3).normal(bulk, 1.2, (2000, 2)), spike])
    for index in (0, 1):
        found = LikelihoodRegion(springs(log_of), draws).limits(index)
        reach = Z95 * math.hypot(along, across) / math.sqrt(2)
        assert np.log(found) == pytest.approx([spike[index] - reach, spike[index] + reach], abs=2e-3)


def test_limits_of_a_coupling_that_spans_decades_are_found_at_either_sign():
    """A k12 below zero does harm at once, one above it hardly at all: one end is a few newtons, the other millions."""
    signed = parametrisation_named("signed")
    prior = JointPrior(signed, (Uniform(0.0, 25.0), Uniform(-4.0, 21.0), Uniform(-1.0, 1.0)))
    place, sd, newtons = np.array([12.0, 8.0]), 4.0, 5.0

    def log_of(theta):
        above, k12 = np.maximum(theta[:, :2] - place, 0.0), signed.values(theta)[:, 1]
        return -0.5 * ((above / sd) ** 2).sum(axis=1) - 0.5 * (np.minimum(k12, 0.0) / newtons) ** 2

    found = Stated(prior, log_of).limits(1)
    high = math.exp(place.mean() + Z95 * sd / math.sqrt(2))  # with ρ at one
    assert found == pytest.approx([-Z95 * newtons, high], rel=2e-3)


def test_an_end_is_open_where_another_coordinate_can_make_up_for_it():
    """A coupling that is felt only above a certain size: below it, at the prior's edge too, the data are fitted."""
    felt, known = math.log(1e7), math.log(1e7)

    def log_of(theta):
        return -0.5 * ((theta[:, 1] + np.exp(theta[:, 0] - felt) - known) / 0.3) ** 2

    problem = springs(log_of)
    draws = problem.draws()
    near = draws[draws[:, 0] > felt + 0.5]  # those at the edge would show it by themselves
    low, high = LikelihoodRegion(problem, near).limits(0)
    assert math.isnan(low)
    assert high == pytest.approx(1e7 * (known - math.log(1e5) + 0.3 * Z95), rel=1e-3)


@pytest.mark.parametrize(("short_by", "is_open"), [(0.3, True), (-0.1, False)])
def test_an_end_is_open_where_the_prior_ends_before_the_likelihood_has_fallen_far_enough(short_by, is_open):
    centre, sd = math.log(1e7), 0.2
    edge = centre + sd * math.sqrt(2 * (FALL - short_by))

    def log_of(theta):
        return -0.5 * ((theta - centre) / sd) ** 2 @ np.ones(2)

    low, high = springs(log_of, Uniform(math.log(1e5), edge), Uniform(math.log(1e5), math.log(1e9))).limits(0)
    assert low == pytest.approx(math.exp(centre - Z95 * sd), rel=2e-3)
    assert math.isnan(high) == is_open
    assert is_open or high == pytest.approx(math.exp(centre + Z95 * sd), rel=2e-3)


def test_what_lies_below_the_level_is_no_end():
    reached, heights = np.log([[1e7, 1e7], [2e7, 1e7], [4e7, 1e7]]), np.array([-1.0, -1.009, -1.5])
    stated = springs(one)
    farthest = LikelihoodRegion(stated, stated.draws())._farthest(reached, heights, 0, -1.0, 1.0)
    np.testing.assert_array_equal(farthest, reached[1])


@pytest.mark.science
def test_limits_at_the_end_of_a_thin_curved_ridge_are_those_of_the_profile():
    """Three frequencies of three unknowns: to the far end steps as wide as all draws do not lead."""
    posterior = jb.sample(jb.load_case(CONFIGS / "clamped_beam_frequencies_360mm.toml"), seed=1, settings=TO_CONVERGE)
    region, index = region_of(posterior), posterior.stiffness_names.index("k22")
    profile, found = region.profile("k22"), region.limits(index)
    assert not profile.open_above
    assert np.log(found) == pytest.approx(profile.interval, abs=1e-9)
    assert heights_at(region, posterior.problem.names.index("k22"), profile) == pytest.approx(-FALL, abs=1e-3)


def test_limits_of_a_coupling_that_is_no_coordinate_equal_a_search_over_a_grid():
    signed = parametrisation_named("signed")
    prior = JointPrior(signed, (Uniform(15.0, 17.0), Uniform(9.0, 11.0), Uniform(-1.0, 1.0)))
    place, sd = np.array([16.0, 10.0, 0.05]), np.array([0.2, 0.3, 0.1])

    def log_of(theta):
        return -0.5 * (((theta - place) / sd) ** 2).sum(axis=1)

    low, high = Stated(prior, log_of).limits(1)
    axes = np.meshgrid(np.linspace(15.2, 16.9, 120), np.linspace(9.0, 11.0, 120), np.linspace(-0.2, 0.3, 201))
    grid = np.stack([axis.ravel() for axis in axes], axis=1)
    k12 = signed.values(grid[log_of(grid) >= -FALL])[:, 1]
    assert low < 0 < high
    assert (low, high) == pytest.approx((k12.min(), k12.max()), rel=0.01)
    assert low <= k12.min()
    assert high >= k12.max()


def heights_at(region, at, profile) -> np.ndarray:
    """ln L over its maximum of the best joints with a coordinate held at its limits, by the rest of its profile."""
    others = profile.theta[~np.isin(profile.value, profile.interval)]
    assert len(others) == len(profile.theta) - 2
    climbs = [region._along(at, np.array([end]), others) for end in profile.interval]
    best = np.array([known[-1] for known in climb_together(region._height, climbs)])
    return region._height(best) - region.greatest


def test_limits_equal_the_ends_of_profiles(cheap_posterior):
    for index, name in enumerate(PAIR.stiffness_names):
        region = region_of(cheap_posterior)
        profile, limits = region.profile(name), region.limits(index)
        assert np.log(limits) == pytest.approx(profile.interval, abs=1e-9)
        assert heights_at(region, index, profile) == pytest.approx(-FALL, abs=1e-4)


# ---- what is printed


def with_limits(posterior: Posterior, low: float, high: float) -> Posterior:
    """A copy of a posterior whose likelihood has other limits."""
    return with_cached(posterior, region_of=SimpleNamespace(limits=lambda _: (low, high)))


def test_a_verdict_has_the_interval_of_the_draws_and_the_limits_of_the_likelihood(cheap_posterior):
    for index, name in enumerate(("k11", "k12")):
        known = cheap_posterior.verdict(name)
        assert known.cls != "identified"
        assert known.likelihood95 == region_of(cheap_posterior).limits(index)
        assert known.interval == pytest.approx(cheap_posterior.interval(name), rel=1e-12)
    identified = cheap_posterior.verdict("k22")
    assert identified.cls == "identified"
    assert np.isnan(identified.likelihood95).all()


def test_of_many_unknowns_and_without_verdict_no_limits_are_sought(cheap_posterior, monkeypatch):
    monkeypatch.setattr(verdicts, "MOST_UNKNOWNS", 2)
    lost = with_cached(cheap_posterior, region_of=None)
    assert np.isnan(lost.verdict("k11").likelihood95).all()
    monkeypatch.undo()
    failed = unsettled(lost, apart=1.5)
    assert np.isnan(failed.verdict("k11").likelihood95).all()


@pytest.mark.parametrize(("share", "speaks"), [(0.09, False), (0.11, True)])
def test_the_test_alone_is_told_beyond_a_tenth_of_the_interval(cheap_posterior, share, speaks):
    low, high = cheap_posterior.interval("k12")
    width = high / low
    for moved, prior in (
        ((low * width**share, high), "below that the prior decides"),
        ((low, high / width**share), "above that the prior decides"),
        ((low * width**share, high / width**share), "outside that the prior decides"),
        ((low / width**share, high), "the prior narrows it"),
        ((low, high * width**share), "the prior narrows it"),
    ):
        changed = with_limits(cheap_posterior, *moved)
        told = [str(because) for because in changed.verdict("k12").reasons if because.reason is Reason.TEST_ALONE]
        assert told == ([f"the test alone: {with_interval(moved, 'N')}; {prior}"] if speaks else [])
        assert all(text in verdict_sentences(changed.summary()) for text in told)


def test_an_end_that_the_likelihood_leaves_open_is_told_as_open(cheap_posterior):
    low, high = cheap_posterior.interval("k12")
    for ends, alone in (
        ((low, math.nan), f"above {quantity_text(low, 'N')}"),
        ((math.nan, high), f"below {quantity_text(high, 'N')}"),
        ((math.nan, math.nan), "no limit"),
    ):
        known = replace(cheap_posterior.verdict("k12"), reasons=())
        (because,) = with_test_alone(known, ends).reasons
        assert str(because) == f"the test alone: {alone}; the prior narrows it"


def test_a_sign_that_the_likelihood_leaves_open_is_compared_on_the_plain_scale():
    known = replace(assess(np.linspace(0.1, 2.1, 1000), np.linspace(0.1, 9.0, 1000)), reasons=())
    low, high = known.interval
    assert with_test_alone(known, (-0.5, high)).reasons
    assert low - 0.09 * (high - low) < 0
    assert not with_test_alone(known, (low - 0.09 * (high - low), high)).reasons


def test_a_limit_that_excludes_little_of_the_prior_is_none(cheap_posterior):
    prior = cheap_posterior.prior_values("k22")
    for share, verdict in ((0.5, "not identified"), (1.5, "bounded below")):
        limit = float(np.quantile(prior, share * RULE.excluded))
        known = bound_at_draws(cheap_posterior, "upper", low=limit).verdict("k22")
        assert known == verdict
        assert math.isfinite(known.limit) == (verdict == "bounded below")
        assert (Reason.EXCLUDES_LITTLE in {because.reason for because in known.reasons}) == (share < 1)


@pytest.mark.parametrize("bend", [0.5, 2.0])
@pytest.mark.parametrize("width", [0.1, 0.001])
def test_a_thin_ridge_is_followed_round_its_bend_to_the_limit(width, bend):
    """y = bend x² to `width`: each end of x is where x alone says, however the ridge bends away on the way."""
    prior = JointPrior(SPRINGS, (Uniform(-40.0, 40.0), Uniform(-400.0, 400.0)))
    rng = np.random.default_rng(1)
    x = 2 * rng.standard_normal(2000)
    draws = np.column_stack([x, bend * x**2 + width * rng.standard_normal(2000)])

    def log_likelihood(theta):
        return -0.5 * ((theta[:, 0] / 2) ** 2 + ((theta[:, 1] - bend * theta[:, 0] ** 2) / width) ** 2)

    region = LikelihoodRegion(SimpleNamespace(prior=prior, log_likelihood=log_likelihood), draws)
    np.testing.assert_allclose(np.log(region.limits(0)), 2 * Z95 * np.array([-1, 1]), rtol=1e-3)
