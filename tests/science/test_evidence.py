"""The evidence on the measured frequencies, by three methods; modes that are far apart are visited in proportion."""

import math

import numpy as np
import pytest
from scipy import stats

from jointbayes.joint import ComplianceCoordinates, SignedCoupling
from jointbayes.posterior import evidence, nested_evidence
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.progress import tell_nobody
from jointbayes.sampling import Draws, NormalScores, SamplerSettings, fit_proposal, run_ensembles
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.diagnostics import autocorrelation_time
from jointbayes.sampling.distributions import resampled
from jointbayes.workflow import draws_of, find_map
from tests.conftest import first_in_ci, on_paper_elements

pytestmark = pytest.mark.science

#: ln Z of the full K^J with its error, from an independent nested sampler.
KNOWN = {"clamped_beam_frequencies": (-16.0, 0.2), "clamped_beam_frequencies_360mm": (-14.5, 0.2)}


@pytest.fixture(scope="module", params=KNOWN)
def measured(request):
    case = on_paper_elements(request.param)
    density, systems = case.problem.log_posterior, coordinate_systems(case.problem)
    draws = draws_of(case.problem, find_map(case), 1, tell_nobody).draws()
    found = evidence(density, systems, draws, np.random.default_rng(1))
    return density, found, KNOWN[request.param]


def test_the_evidence_of_the_measured_frequencies_is_the_known_one(measured):
    _, found, (log_z, error) = measured
    assert found.method == "bridge sampling"
    assert found.error < 0.02
    assert abs(found.log_z - log_z) < 2 * error


def test_draws_from_the_prior_give_the_same_evidence(measured):
    (log_posterior, found, _), rng = measured, np.random.default_rng(2)
    draws = [log_posterior.prior.transform(rng.random((25_000, 3))) for _ in range(12)]
    likelihood = np.exp(np.concatenate([log_posterior.log_likelihood(theta) for theta in draws]) - found.log_z)
    error = likelihood.std() / math.sqrt(likelihood.size)
    assert abs(likelihood.mean() - 1) < 4 * error < 0.4


@pytest.mark.long
@pytest.mark.parametrize("measured", first_in_ci(sorted(KNOWN, reverse=True), 1), indirect=True)
def test_nested_sampling_gives_the_same_evidence(measured):
    (density, found, _), rng = measured, np.random.default_rng(3)
    nested = nested_evidence(density.log_likelihood, density.prior.transform, 3, rng, live=100)
    assert abs(nested.log_z - found.log_z) < 4 * nested.error < 1.5


class TwoCouplings:
    """Density over signed coordinates, of mass 0.7 near ρ = 0.97 and 0.3 near −0.95, of different stiffnesses."""

    masses = (0.7, 0.3)
    low, high = np.array([15.0, 8.0, -1.0]), np.array([26.0, 19.0, 1.0])

    def __init__(self):
        places = (np.array([22.0, 14.0]), np.array([20.5, 12.5]))
        self.stiffness = [stats.multivariate_normal(place, 0.01 * np.eye(2)) for place in places]
        self.coupling = [stats.beta(60, 1.5, loc=-1, scale=2), stats.beta(2, 40, loc=-1, scale=2)]

    def __call__(self, theta):
        with np.errstate(divide="ignore"):
            each = [
                math.log(mass) + stiffness.logpdf(theta[:, :2]) + coupling.logpdf(theta[:, 2])
                for mass, stiffness, coupling in zip(self.masses, self.stiffness, self.coupling, strict=True)
            ]
        return np.logaddexp(*each)


@pytest.fixture(scope="module")
def two_couplings():
    density = TwoCouplings()
    places, covariance = ([22.0, 14.0, 0.96], [20.5, 12.5, -0.93]), np.diag([0.01, 0.01, 0.001])
    starts, rng = tuple((np.array(place), covariance) for place in places), np.random.default_rng(4)
    known = ComplianceCoordinates(SignedCoupling()), NormalScores(density.low, density.high)
    about = np.concatenate([rng.multivariate_normal(*start, size=3000) for start in starts])
    return density, starts, fit_proposal(density, known, about[np.abs(about[:, 2]) < 1], rng)


def test_evidence_of_two_modes_near_both_limits_of_the_coupling(two_couplings):
    density, _, proposal = two_couplings
    assert proposal.efficiency > 0.4
    rng = np.random.default_rng(5)
    draws, log_weight = proposal.weighted_draws(density, rng, 20_000)
    weight = np.exp(log_weight - np.logaddexp.reduce(log_weight))
    draws = draws[resampled(weight, 20_000, rng)[rng.permutation(20_000)]]
    assert np.mean(draws[:, 2] > 0) == pytest.approx(0.7, abs=0.03)
    drawn = Draws(draws.reshape(4, 5000, 3), density(draws).reshape(4, 5000), np.arange(4))
    found = evidence(density, (Identity(), proposal.coordinates), drawn, rng)
    assert abs(found.log_z) < 4 * found.error < 0.08


def test_chains_visit_two_modes_near_both_limits_in_proportion(two_couplings):
    density, starts, proposal = two_couplings
    rng = np.random.default_rng(7)
    settings = SamplerSettings(ensembles=4, walkers=24, tau_factor=20.0)
    # half of the walkers about each mode, though one is more than twice as heavy as the other
    balls = [rng.multivariate_normal(mean, 0.1 * covariance, size=(4, 12)) for mean, covariance in starts]
    chains = run_ensembles(density, np.concatenate(balls, axis=1), rng, settings, proposal=proposal)
    assert chains.converged, chains.reason
    positive = (chains.theta[:, chains.burn_in :, :, 2:] > 0).astype(float)
    error = math.sqrt(0.21 * autocorrelation_time(positive)[0] / positive.size)
    assert abs(positive.mean() - 0.7) < 4 * error < 0.1
