"""The evidence: its parts against closed forms, and when which method is used."""

import json
import math

import numpy as np
import pytest
from scipy import stats
from scipy.special import ndtri

import jointbayes as jb
from jointbayes.errors import SamplingError
from jointbayes.identification import LocalMode
from jointbayes.identification.mode_search import local_modes
from jointbayes.inference import JointPrior, Normal, Nuisance, Uniform
from jointbayes.joint import LogStiffness, SignedCoupling
from jointbayes.posterior import evidence, importance_evidence, nested_evidence
from jointbayes.posterior.storage import _with_values, estimate_record
from jointbayes.sampling import Proposal, StudentT, fit_proposal, starting_walkers
from jointbayes.sampling.diagnostics import pareto_k
from jointbayes.stored_values import stored_value
from tests.conftest import CONFIGS

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


class FakePosterior:
    """What `evidence` asks of a posterior: two coordinates, uniform prior on a square of side 20."""

    class prior:
        names = ("a", "b")

        @staticmethod
        def log_density(theta):
            return np.where((np.abs(theta) < 10).all(axis=1), -2 * math.log(20), -np.inf)

        @staticmethod
        def transform(u):
            return 20 * u - 10

    def __init__(self, log_likelihood):
        self.log_likelihood = log_likelihood

    def __call__(self, theta):
        out = self.prior.log_density(theta)
        inside = np.isfinite(out)
        out[inside] += self.log_likelihood(theta[inside])
        return out


class TestImportance:
    @pytest.mark.parametrize("dimension", [1, 3, 7])
    def test_a_gaussian_has_its_closed_form(self, dimension):
        known = Gaussian(dimension)
        rng = np.random.default_rng(1)
        start = (np.ones(dimension), 0.3 * np.eye(dimension))
        proposal = fit_proposal(known, [None], [start], rng)
        found = importance_evidence(known, proposal, rng)
        assert found.method == "importance sampling"
        assert abs(found.log_z - known.log_z) < 4 * found.error
        assert found.error < 0.01
        assert found.pareto_k < 0.5
        assert found.evaluations == proposal.evaluations + 20_000

    def test_the_error_is_the_scatter_of_repetitions(self):
        known = Gaussian(2)
        proposal = Proposal(StudentT(np.zeros(2), 2.0 * np.eye(2), 5.0), 0.2, 0)
        runs = [importance_evidence(known, proposal, np.random.default_rng(seed), draws=1000) for seed in range(200)]
        z = np.array([(run.log_z - known.log_z) / run.error for run in runs])
        assert abs(z.mean()) < 0.3
        assert 0.85 < z.std() < 1.15

    def test_draws_are_those_of_the_posterior(self):
        known = Gaussian(2)
        proposal = Proposal(StudentT(np.zeros(2), 2.0 * np.eye(2), 5.0), 0.2, 0)
        draws = importance_evidence(known, proposal, np.random.default_rng(2)).draws
        sample = draws.resample(np.random.default_rng(3), 4000)
        sd = 1 / math.sqrt(1 / 2.0**2 + 1 / 0.5**2)
        np.testing.assert_allclose(sample.mean(axis=0), sd**2 / 0.5**2, atol=0.04)
        np.testing.assert_allclose(sample.std(axis=0), sd, rtol=0.06)
        assert draws.weight.sum() == pytest.approx(1.0)

    def test_draws_where_the_density_is_zero_count_among_the_draws(self):
        def half_normal(theta):  # integrates to one
            return np.where(theta[:, 0] > 0, stats.norm.logpdf(theta[:, 0]) + math.log(2), -np.inf)

        proposal = Proposal(StudentT(np.zeros(1), np.eye(1), 5.0), 0.5, 0)
        found = importance_evidence(half_normal, proposal, np.random.default_rng(6))
        assert abs(found.log_z) < 4 * found.error < 0.05

    def test_a_proposal_beside_the_density_leaves_no_evidence(self):
        def far(theta):
            return np.where(theta[:, 0] > 1e9, 0.0, -np.inf)

        found = importance_evidence(
            far, Proposal(StudentT(np.zeros(1), np.eye(1), 5.0), 0.0, 0), np.random.default_rng(4)
        )
        assert (found.log_z, found.pareto_k, found.ess) == (-math.inf, math.inf, 0.0)


class TestParetoK:
    def test_few_or_equal_weights(self):
        assert pareto_k(np.zeros(10)) == math.inf
        assert pareto_k(np.zeros(1000)) == -math.inf


class TestNested:
    @pytest.mark.science
    def test_a_gaussian_has_its_closed_form(self):
        known = Gaussian(2)
        found = nested_evidence(known.log_likelihood, known.transform, 2, np.random.default_rng(6), live=200)
        assert found.method == "nested sampling"
        assert abs(found.log_z - known.log_z) < 4 * found.error
        assert 0.02 < found.error < 0.2
        assert found.draws.resample(np.random.default_rng(7), 2000).mean() == pytest.approx(0.94, abs=0.1)

    def test_a_likelihood_that_is_nan_is_refused(self):
        with pytest.raises(SamplingError, match="nested sampling: found ln L = nan"):
            nested_evidence(lambda x: np.full(len(x), np.nan), lambda u: u, 1, np.random.default_rng(1))


class TestChoice:
    @staticmethod
    def bell(theta):
        return -0.5 * (theta**2).sum(axis=1)

    @staticmethod
    def ring(theta):
        """Thin and sharp-edged: no mixture of a dozen bells covers it."""
        return -0.5 * ((np.hypot(theta[:, 0], theta[:, 1]) - 6.0) / 0.015) ** 2

    def test_importance_sampling_where_its_weights_are_good(self):
        start = (np.zeros(2), np.eye(2))
        found = evidence(FakePosterior(self.bell), [None], [start], np.random.default_rng(8))
        assert found.method == "importance sampling"
        assert found.log_z == pytest.approx(math.log(2 * math.pi / 400), abs=0.01)

    @pytest.mark.science
    @pytest.mark.parametrize(
        ("draws", "method", "off"),
        [(20_000, "importance sampling", 0.05), pytest.param(200, "nested sampling", 0.45, marks=pytest.mark.long)],
    )
    def test_where_they_are_not_a_mixture_of_the_draws_of_nested_sampling_or_these_alone(self, draws, method, off):
        start = (np.array([6.0, 0.0]), 1e-4 * np.eye(2))
        found = evidence(FakePosterior(self.ring), [None], [start], np.random.default_rng(9), draws=draws)
        assert found.method == method
        area = math.sqrt(2 * math.pi) * 0.015 * 2 * math.pi * 6.0
        assert abs(found.log_z - math.log(area / 400)) < min(4 * found.error, off)
        drawn = found.draws.resample(np.random.default_rng(1), 4000)
        assert np.hypot(*drawn.T) == pytest.approx(6.0, abs=0.075)
        assert drawn.mean(axis=0) == pytest.approx([0.0, 0.0], abs=0.8)

    def test_without_parameters_the_evidence_is_the_likelihood(self):
        class Rigid:
            class prior:
                names = ()

            def __call__(self, theta):
                assert theta.shape == (1, 0)
                return np.array([-16.19])

        for found in (
            evidence(Rigid(), [], [], np.random.default_rng(1)),
            nested_evidence(Rigid(), lambda u: u, 0, np.random.default_rng(1)),
        ):
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

    @pytest.mark.parametrize(("width", "count"), [(0.35, 2), (0.9, 1)])
    def test_a_valley_of_one_is_a_valley(self, width, count):
        # where the lower mode meets the flank of the higher one the log density is 1.7 below it, or not below at all
        density = self.Bimodal(width)
        ends = [(place, float(density(place)[0])) for place in (np.array([5.0, 5.0, r]) for r in (0.9, -0.9))]
        assert len(local_modes(density, ends)) == count

    def test_a_mode_that_is_far_lower_does_not_matter(self):
        density = self.Bimodal()
        ends = [(np.array([5.0, 5.0, 0.9]), 0.0), (np.array([5.0, 5.0, -0.9]), -12.1)]
        assert len(local_modes(density, ends)) == 1

    def test_walkers_start_in_a_corner_of_the_support_where_hardly_a_draw_of_the_laplace_approximation_lies(self):
        case = jb.load_case(CONFIGS / "clamped_beam.toml")
        low, high = case.problem.prior.support
        corner = np.array([high[0] - 1e-4, low[1] + 1.0, low[2] + 1e-4])
        # what lowers k11, and so leads inside, lowers k22, and so leads outside
        covariance = np.array([[4.0, 0.0, 4.0 * (1 - 1e-12)], [0.0, 1.0, 0.0], [4.0 * (1 - 1e-12), 0.0, 4.0]])
        estimate = jb.MapEstimate(corner, np.exp(corner), covariance, 0.0, (), ())
        start = starting_walkers(
            estimate.starts_for_draws, case.problem.prior.log_density, case.sampler, np.random.default_rng(15)
        )
        assert np.isfinite(case.problem.prior.log_density(start.reshape(-1, 3))).all()
        assert (start.std(axis=(0, 1)) > 0).all()

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
