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
    assert PAIR.is_positive_semidefinite([k11, k12, k22])


@ALL
def test_batches_of_any_shape_are_the_same_as_one_by_one(springs):
    d = len(springs.names)
    theta = np.random.default_rng(1).uniform(5, 25, size=(4, 2, d))
    for name, shape in (("values", (3,)), ("derivative", (3, d)), ("feasible", ()), ("log_slope", ()),
                        ("log_determinant", ()), ("compliance", (d,)), ("log_compliance_volume", ())):  # fmt: skip
        together = getattr(springs, name)(theta)
        assert together.shape == (4, 2, *shape), name
        one_by_one = np.array([[getattr(springs, name)(t) for t in row] for row in theta])
        np.testing.assert_array_equal(together, one_by_one, err_msg=name)
    assert springs.coordinates(springs.values(theta)).shape == theta.shape


@ALL
@given(LN_K, LN_K)
def test_the_derivative_and_its_volume_are_those_of_the_stiffness(springs, ln_k11, ln_k22):
    theta = theta_of(springs, ln_k11, ln_k22)
    exact = springs.derivative(theta)
    assert exact.shape == (3, theta.size)
    used = [("k11", "k12", "k22").index(name) for name in springs.names]
    for i in range(theta.size):
        step = 1e-5 * np.eye(theta.size)[i]
        difference = (springs.values(theta + step) - springs.values(theta - step))[used] / 2e-5
        np.testing.assert_allclose(exact[used, i], difference, rtol=1e-8, atol=1e-8 * np.exp(theta[i]))
        assert not np.delete(exact[:, i], used).any()
    _, log_slope = np.linalg.slogdet(exact[used])
    assert springs.log_slope(theta) == pytest.approx(log_slope, abs=1e-9)
    assert springs.log_determinant(theta) == pytest.approx(np.log(springs.values(theta)[used]).sum(), abs=1e-9)


@ALL
@given(LN_K, LN_K)
def test_the_compliance_leads_back_and_its_volume_is_its_jacobian_determinant(springs, ln_k11, ln_k22):
    coordinates, theta = ComplianceCoordinates(springs), theta_of(springs, ln_k11, ln_k22)[None]
    phi = coordinates.forward(theta)
    used = [("k11", "k12", "k22").index(name) for name in springs.names]
    np.testing.assert_allclose(phi[0], 1 / springs.values(theta)[0, used], rtol=1e-12)
    back, inside = coordinates.inverse(phi)
    assert inside.tolist() == [True]
    np.testing.assert_allclose(back, theta, rtol=1e-12)
    if theta.size:
        step = 1e-5 * np.eye(theta.size)
        jacobian = (coordinates.forward(theta + step) - coordinates.forward(theta - step)).T / 2e-5  # ∂φ/∂θ
        _, log_determinant = np.linalg.slogdet(jacobian)
        assert coordinates.log_volume(theta)[0] == pytest.approx(-log_determinant, abs=1e-6)
    else:
        assert coordinates.log_volume(theta).tolist() == [0.0]


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
