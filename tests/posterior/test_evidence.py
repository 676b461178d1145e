"""The evidence of draws and by nested sampling against known integrals; what the prior is cut to."""

import json
import math

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter
from scipy.special import ndtri

import jointbayes as jb
from jointbayes.identification import LocalMode
from jointbayes.identification.mode_search import local_modes
from jointbayes.inference import JointPrior, Normal, Nuisance, Uniform
from jointbayes.joint import LogStiffness, SignedCoupling
from jointbayes.posterior import evidence, nested_evidence
from jointbayes.posterior.evidence import constant_evidence, laplace_evidence
from jointbayes.posterior.storage import _with_values, estimate_record
from jointbayes.sampling import Draws, NormalScores
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.stored_values import stored_value

LOG = JointPrior(LogStiffness(), (Normal(20.0, 2.0), Normal(16.0, 1.5), Uniform(11.0, 16.0)))
SIGNED = JointPrior(SignedCoupling(), (Normal(20.0, 1.0), Uniform(11.0, 16.0), Normal(0.6, 0.5)))
UNCERTAIN = JointPrior(LogStiffness(), LOG.marginals, (Nuisance("youngs_modulus", "Pa", 2.1e11, Normal(0.0, 0.02)),))


class Gaussian:
    """Prior N(0, 2²) and likelihood N(1 | θ, 0.5²) in each coordinate: Z in closed form."""

    def __init__(self, dimension):
        self.dimension = dimension
        self.log_z = dimension * stats.norm(0.0, math.hypot(2.0, 0.5)).logpdf(1.0)

    def log_likelihood(self, theta):
        return (-0.5 * ((theta - 1.0) / 0.5) ** 2 - math.log(0.5 * math.sqrt(2 * math.pi))).sum(axis=1)

    def __call__(self, theta):
        prior = (-0.5 * (theta / 2.0) ** 2 - math.log(2.0 * math.sqrt(2 * math.pi))).sum(axis=1)
        return self.log_likelihood(theta) + prior

    @staticmethod
    def transform(u):
        return 2.0 * ndtri(u)


def gaussian(d):
    return lambda x: stats.norm.logpdf(x).sum(axis=1), lambda rng, n: rng.normal(size=(n, d)), Identity()


def banana():
    """A ridge of width 0.3 along a parabola."""

    def draw(rng, n):
        along = 2 * rng.normal(size=n)
        return np.column_stack([along, along**2 + 0.3 * rng.normal(size=n)])

    return lambda x: stats.norm.logpdf(x[:, 0], 0, 2) + stats.norm.logpdf(x[:, 1], x[:, 0] ** 2, 0.3), draw, Identity()


def two_modes():
    """Shares 0.77 and 0.23, twelve standard deviations apart."""

    def density(x):
        wide, narrow = stats.norm.logpdf(x).sum(axis=1), stats.norm.logpdf(x, 12, 0.5).sum(axis=1)
        return np.logaddexp(math.log(0.77) + wide, math.log(0.23) + narrow)

    def draw(rng, n):
        wide = rng.random((n, 1)) < 0.77
        return np.where(wide, rng.normal(size=(n, 2)), rng.normal(12, 0.5, size=(n, 2)))

    return density, draw, Identity()


def plateau():
    """Flat from 4 to the prior's end at 10, where it ends at once; half a Gaussian below 4."""
    edge = 0.3 * math.sqrt(math.pi / 2)

    def density(x):
        flat = np.where(x[:, 0] > 4, 0.0, -0.5 * ((x[:, 0] - 4) / 0.3) ** 2) - math.log(6 + edge)
        return np.where(((x > 0) & (x < 10)).all(axis=1), flat + stats.norm.logpdf(x[:, 1], 5, 0.5), -np.inf)

    def draw(rng, n):
        flat = rng.random(n) < 6 / (6 + edge)
        first = np.where(flat, rng.uniform(4, 10, n), 4 - np.abs(0.3 * rng.normal(size=n)))
        return np.column_stack([first, rng.normal(5, 0.5, n)])

    return density, draw, NormalScores(np.zeros(2), np.full(2, 10.0))


def draws_from(density, theta, ensembles=4):
    """Draws as those of a run, of rows in this order."""
    theta = theta.reshape(ensembles, -1, theta.shape[1])
    values = density(theta.reshape(-1, theta.shape[2])).reshape(theta.shape[:2])
    return Draws(theta, values, np.arange(ensembles))


def half():
    """Half a Gaussian, which ends where it is highest."""

    def density(x):
        return np.where(x[:, 0] > 0, stats.norm.logpdf(x[:, 0]) + math.log(2), -np.inf)

    return density, lambda rng, n: np.abs(rng.normal(size=(n, 1))), Identity()


KNOWN = {
    "half": half(),
    "gaussian": gaussian(2),
    "seven": gaussian(7),
    "banana": banana(),
    "modes": two_modes(),
    "plateau": plateau(),
}
OFF = 7.25  # ln of what every density is multiplied with


def found_from(name, seed, *, repeated=0):
    density, draw, coordinates = KNOWN[name]
    rng = np.random.default_rng(seed)
    theta = draw(rng, 8000)
    if repeated:
        theta = theta[rng.choice(repeated, 8000)]
    return evidence(lambda x: density(x) + OFF, [coordinates], draws_from(lambda x: density(x) + OFF, theta), rng)


class TestBridge:
    @pytest.mark.parametrize("name", KNOWN)
    def test_the_integral_is_found_from_draws(self, name):
        found = found_from(name, 1)
        assert found.method == "bridge sampling"
        assert abs(found.log_z - OFF) < 4 * found.error < 0.06
        assert found.trusted

    @pytest.mark.parametrize(("name", "repeated"), [*((name, 0) for name in KNOWN), ("seven", 2500), ("modes", 2500)])
    def test_the_error_is_the_scatter_of_repetitions(self, name, repeated):
        runs = [found_from(name, seed, repeated=repeated) for seed in range(20)]
        z = np.array([(run.log_z - OFF) / run.error for run in runs])
        assert abs(z.mean()) < 0.6
        assert 0.6 < np.sqrt((z**2).mean()) < 1.35

    def test_repeated_draws_do_not_make_the_mixture_too_narrow(self):
        off = [found_from("seven", seed, repeated=1500).log_z - OFF for seed in range(6)]
        assert abs(np.mean(off)) < 0.05

    @pytest.mark.science
    def test_the_error_of_correlated_draws_is_the_scatter_of_repetitions(self):
        density, _, coordinates = KNOWN["gaussian"]
        z, errors = [], []
        for seed in range(12):
            rng = np.random.default_rng(seed)
            noise = math.sqrt(1 - 0.95**2) * rng.normal(size=(4, 2200, 2))
            theta = lfilter([1.0], [1.0, -0.95], noise, axis=1)[:, 200:].reshape(-1, 2)  # τ = 39
            found = evidence(density, [coordinates], draws_from(density, theta), rng)
            z.append(found.log_z / found.error)
            errors.append(found.error)
        assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.5
        assert np.mean(errors) > 1.3 * found_from("gaussian", 1).error

    def test_a_mixture_that_is_never_where_the_density_is_has_no_error_that_is_trusted(self):
        def nowhere(theta):
            return np.full(len(theta), -np.inf)

        draws = draws_from(lambda x: np.zeros(len(x)), np.random.default_rng(1).normal(size=(800, 2)))
        found = evidence(nowhere, [Identity()], draws, np.random.default_rng(1))
        assert found.error == math.inf
        assert not found.trusted


class TestLaplace:
    def test_a_gaussian_has_its_closed_form_but_no_error(self):
        covariance = np.array([[2.0, 0.3], [0.3, 0.5]])
        peak = float(stats.multivariate_normal.logpdf(np.zeros(2), np.zeros(2), covariance))
        found = laplace_evidence((np.zeros(2), covariance), peak - 3.0)
        assert found.log_z == pytest.approx(-3.0)
        assert math.isnan(found.error)
        assert found.trusted


class TestNested:
    @pytest.mark.science
    def test_a_gaussian_has_its_closed_form(self):
        known, told = Gaussian(2), []
        rng = np.random.default_rng(6)
        found = nested_evidence(known.log_likelihood, known.transform, 2, rng, live=200, tell=told.append)
        assert found.method == "nested sampling"
        assert abs(found.log_z - known.log_z) < 4 * found.error
        assert 0.02 < found.error < 0.2


def test_without_parameters_the_evidence_is_the_likelihood():
    found = constant_evidence(lambda theta: np.full(len(theta), -16.19))
    assert (found.log_z, found.error, found.method, found.evaluations) == (-16.19, 0.0, "exact", 1)


class TestCut:
    def test_uniform_priors_leave_what_the_convolution_says(self):
        # 2 ln k12 < ln k11 + ln k22 with all three uniform on [0, 1]: the half, by symmetry
        unit = JointPrior(LogStiffness(), (Uniform(0.0, 1.0),) * 3)
        assert unit.log_normalisation == pytest.approx(math.log(0.5), abs=1e-6)
        # a coupling on [0, 3] is below the mean of two on [0, 1] in a sixth of all cases
        wide = JointPrior(LogStiffness(), (Uniform(0.0, 1.0), Uniform(0.0, 3.0), Uniform(0.0, 1.0)))
        assert wide.log_normalisation == pytest.approx(math.log(1 / 6), abs=1e-3)

    def test_a_signed_coupling_is_cut_at_one(self):
        inside = stats.norm(0.6, 0.5).cdf(1.0) - stats.norm(0.6, 0.5).cdf(-1.0)
        assert SIGNED.log_normalisation == pytest.approx(math.log(inside), abs=1e-8)
        assert JointPrior(SignedCoupling(), (*LOG.marginals[:2], Uniform(-1.0, 1.0))).log_normalisation == 0.0

    @pytest.mark.parametrize("prior", [LOG, SIGNED, UNCERTAIN], ids=["log", "signed", "with a nuisance"])
    def test_the_prior_integrates_to_one(self, prior):
        rng = np.random.default_rng(10)
        low, high = np.maximum(prior.support[0], prior.mean - 6 * prior.sd), prior.mean + 6 * prior.sd
        high = np.minimum(prior.support[1], high)
        theta = rng.uniform(low, high, size=(400_000, len(low)))
        density = np.exp(prior.log_density(theta)) * np.prod(high - low)
        assert abs(density.mean() - 1) < 4 * density.std() / math.sqrt(len(theta)) < 0.06

    @pytest.mark.parametrize("prior", [LOG, SIGNED, UNCERTAIN], ids=["log", "signed", "with a nuisance"])
    def test_the_transform_gives_draws_from_the_prior(self, prior):
        rng = np.random.default_rng(11)
        theta = prior.transform(rng.random((4000, len(prior.names))))
        drawn = prior.sample(rng, 40_000)
        assert np.isfinite(prior.log_density(theta)).all()
        directions = [*np.eye(theta.shape[1]), np.ones(theta.shape[1]), np.arange(theta.shape[1]) - 1.0]
        assert min(stats.ks_2samp(theta @ d, drawn @ d).pvalue for d in directions) > 1e-3


class TestModes:
    class Bimodal:
        """Modes at ρ = ±0.9 in two coordinates, a ridge along the first."""

        prior = JointPrior(SignedCoupling(), (Uniform(0.0, 10.0), Uniform(0.0, 10.0), Uniform(-1.0, 1.0)))

        def __init__(self, width=0.03):
            self.width = width

        def __call__(self, theta):
            t = np.atleast_2d(theta)
            w = self.width
            value = np.logaddexp(-0.5 * ((t[:, 2] - 0.9) / w) ** 2, -2 - 0.5 * ((t[:, 2] + 0.9) / w) ** 2)
            return value - 0.5 * (t[:, 1] - 5.0) ** 2

        def residuals(self, theta):
            side = 0.9 if theta[2] > 0 else -0.9
            e = np.array([theta[1] - 5.0, (theta[2] - side) / 0.03])
            return e, np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1 / 0.03]])

        def gradient(self, theta):
            linearised = [self.residuals(point) for point in theta]
            return np.array([-(e @ jacobian) for e, jacobian in linearised])

    def test_ends_on_one_ridge_are_one_mode_and_those_across_a_valley_two(self):
        density = self.Bimodal()
        places = [[1.0, 5.0, 0.9], [9.0, 5.0, 0.9], [2.0, 5.0, -0.9], [5.0, 5.0, -0.9], [5.0, 0.0, 0.9]]
        ends = [(np.array(place), float(density(np.array(place))[0])) for place in places]
        modes = local_modes(density, ends)
        assert [mode.theta[2] for mode in modes] == [0.9, -0.9]
        assert modes[0].log_posterior - modes[1].log_posterior == pytest.approx(2.0)
        np.testing.assert_allclose(np.sqrt(np.diag(modes[0].covariance))[1:], [1.0, 0.03], rtol=1e-6)

    @pytest.mark.parametrize(("width", "lower", "count"), [(0.35, 2.0, 2), (0.9, 2.0, 1), (0.03, 12.1, 1)])
    def test_a_valley_of_one_is_a_valley_and_a_mode_that_is_far_lower_does_not_matter(self, width, lower, count):
        # where the lower mode meets the flank of the higher one the log density is 1.7 below it, or not below at all
        places = (np.array([5.0, 5.0, r]) for r in (0.9, -0.9))
        modes = local_modes(self.Bimodal(width), list(zip(places, (0.0, -lower), strict=True)))
        assert len(modes) == count

    def test_modes_are_stored(self):
        modes = (
            LocalMode(np.zeros(3), np.eye(3), 1.0),
            LocalMode(np.ones(3), 2 * np.eye(3), 0.5, (np.ones(3), np.eye(3))),
        )
        estimate = jb.MapEstimate(modes[0].theta, np.ones(3), modes[0].covariance, 1.0, (), modes)
        plain = json.dumps(estimate_record(estimate), default=lambda array: array.tolist())
        back = stored_value(jb.MapEstimate, _with_values(json.loads(plain)), "")
        for one, other in zip(back.modes, modes, strict=True):
            assert one.log_posterior == other.log_posterior
            for restored, kept in zip(one.start, other.start, strict=True):
                np.testing.assert_array_equal(restored, kept)
