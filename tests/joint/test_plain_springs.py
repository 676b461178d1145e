"""Plain springs: coordinates, derivatives, compliance and volumes for none, one or two of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jointbayes.errors import ModelError
from jointbayes.frf import NaturalFrequencies
from jointbayes.inference import JointPrior, LogPosterior, Uniform
from jointbayes.inference.likelihood import likelihood_of
from jointbayes.joint import RIGID, ComplianceCoordinates, PlainSprings
from jointbayes.measurement import FrequencyMeasurement
from tests.conftest import CLAMP, PAIR, best_of, pair_matrix, rod

NAMES = [(), ("k11",), ("k22",), ("k11", "k22")]
ALL = pytest.mark.parametrize("springs", [PlainSprings(names) for names in NAMES], ids=["0", "k11", "k22", "both"])
LN_K = st.floats(np.log(1e2), np.log(1e12))


def theta_of(springs, ln_k11, ln_k22):
    return np.array([{"k11": ln_k11, "k22": ln_k22}[name] for name in springs.names])


@ALL
@given(LN_K, LN_K)
def test_named_springs_are_coordinates_and_the_others_rigid(springs, ln_k11, ln_k22):
    theta = theta_of(springs, ln_k11, ln_k22)
    k11, k12, k22 = springs.values(theta)
    assert k12 == 0.0
    assert k11 == (pytest.approx(np.exp(ln_k11), rel=1e-13) if "k11" in springs.names else RIGID)
    assert k22 == (pytest.approx(np.exp(ln_k22), rel=1e-13) if "k22" in springs.names else RIGID)
    np.testing.assert_allclose(springs.coordinates([k11, k12, k22]), theta, rtol=1e-13)
    assert springs.feasible(theta)
    assert springs.log_determinant(theta) == pytest.approx(theta.sum(), rel=1e-13)
    assert PAIR.is_positive_semidefinite([k11, k12, k22])


def test_a_compliance_that_is_not_positive_is_no_spring():
    theta, inside = ComplianceCoordinates(PlainSprings()).inverse(np.array([[1e-9, -1e-6], [0.0, 1e-6], [1e-9, 1e-6]]))
    assert inside.tolist() == [False, False, True]
    assert np.isfinite(theta).all()


@pytest.mark.parametrize(
    "broken",
    [
        lambda: PlainSprings(("k22", "k11")),
        lambda: PlainSprings(("k12",)),
        lambda: PlainSprings(("k11", "k11")),
        lambda: PlainSprings().coordinates([1e9, 0.0, 0.0]),
        lambda: PlainSprings(("k11",)).coordinates([np.nan, 0.0, 1.0]),
    ],
)
def test_impossible_springs_are_refused_in_one_line(broken):
    with pytest.raises(ModelError, match="expected") as caught:
        broken()
    assert "\n" not in str(caught.value)


@ALL
def test_the_mode_search_finds_the_springs_that_made_the_data(springs):
    """Also without any coordinate, where there is nothing to find."""
    theta = theta_of(springs, np.log(3e8), np.log(2e5))
    made = NaturalFrequencies(rod(elements=4), CLAMP, 3).frequency_hz(pair_matrix(springs.values(theta)))[0]
    measurement = FrequencyMeasurement(made, np.full(3, 0.01))
    marginals = {"k11": Uniform(np.log(1e6), np.log(1e11)), "k22": Uniform(np.log(1e3), np.log(1e8))}
    prior = JointPrior(springs, tuple(marginals[name] for name in springs.names))
    assert prior.sample(np.random.default_rng(1), 5).shape == (5, theta.size)
    assert [end.shape for end in prior.support] == [(theta.size,)] * 2
    posterior = LogPosterior(prior, likelihood_of(rod(elements=4), CLAMP, measurement))
    found = best_of(posterior, {"paper": [1e8, 0.0, 0.0], "stiff": [1e10, 1e6, 1e6]})
    np.testing.assert_allclose(found.theta, theta, atol=1e-6)
    assert found.covariance.shape == (theta.size, theta.size)
    assert not found.failed_starts
