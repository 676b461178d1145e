"""Fisher information: blocks, priors, coordinates, combinations that nothing determines."""

import dataclasses

import numpy as np
import pytest

from jointbayes.frf import Ports, synthesise_frf
from jointbayes.identification.refine import laplace_covariance
from jointbayes.inference import JointPrior, Normal, Problem, Uniform
from jointbayes.joint import ElasticCentre, LogStiffness, SignedCoupling
from jointbayes.posterior.fisher import FisherInformation, fisher_information
from tests.conftest import TABLE_3, pair_matrix
from vibrecords import RelativeNoise

NAMES = ("k11", "k12", "k22", "youngs_modulus", "length")
PRIOR_SD = np.array([2.0, 3.0, 2.0, 0.02, 0.005])


def random_fisher(prior=None, data=None, parametrisation=None, theta=None, names=NAMES) -> FisherInformation:
    rng = np.random.default_rng(3)
    d = len(names)
    if data is None:
        root = rng.normal(size=(20, d)) * np.linspace(1, 30, d)
        data = root.T @ root
    return FisherInformation(
        names,
        np.concatenate([np.log(TABLE_3), np.zeros(d - 3)]) if theta is None else theta,
        data,
        np.diag(PRIOR_SD[:d] ** -2.0) if prior is None else prior,
        PRIOR_SD[:d],
        parametrisation or LogStiffness(),
    )


def test_parameters_that_are_not_free_are_taken_as_exactly_known():
    fisher = random_fisher()
    rows = [4, 0]
    block = (fisher.data + fisher.prior)[np.ix_(rows, rows)]
    np.testing.assert_allclose(fisher.covariance(["length", "k11"]), np.linalg.inv(block))
    sd = fisher.sd(["length", "k11"])
    assert list(sd) == ["length", "k11"]
    np.testing.assert_allclose(list(sd.values()), np.sqrt(np.diag(np.linalg.inv(block))))


def test_a_parameter_or_combination_that_nothing_determines_has_no_finite_sd():
    data = np.zeros((5, 5))
    both = np.array([1.0, 1.0, 0.0, 0.0, 0.0])  # only k11·k12 is seen, and k22
    data += 1e4 * np.outer(both, both) + 1e2 * np.diag([0, 0, 1, 0, 0])
    fisher = random_fisher(data=data, prior=np.zeros((5, 5)))
    assert fisher.sd() == {name: pytest.approx(0.1) if name == "k22" else np.inf for name in NAMES}
    covariance = fisher.covariance()
    assert covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]) == pytest.approx(-1.0)
    assert covariance[0, 3] == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_rounding_does_not_make_a_direction_known(seed):
    root = np.random.default_rng(seed).normal(size=(2, 3)) * 1e3  # two residuals, three stiffnesses
    fisher = random_fisher(data=root.T @ root, prior=np.zeros((3, 3)), names=NAMES[:3])
    assert set(fisher.sd().values()) == {np.inf}


def test_nuisances_that_the_data_do_not_see_change_nothing():
    seen = random_fisher(names=NAMES[:3], prior=np.zeros((3, 3)))
    data = np.zeros((5, 5))
    data[:3, :3] = seen.data
    fisher = random_fisher(data=data, prior=np.zeros((5, 5)))
    assert fisher.stiffness_sd() == pytest.approx(seen.sd())


def test_data_part_is_the_curvature_of_the_likelihood_of_exact_data(cheap_case):
    problem = _exact(cheap_case.problem, LogStiffness())
    theta = np.log(TABLE_3)
    fisher = fisher_information(problem, theta)
    assert fisher.names == ("k11", "k12", "k22")
    assert (fisher.prior == np.diag(problem.prior.precision)).all()
    curvature = np.linalg.inv(laplace_covariance(problem.log_posterior, theta))  # differences of the gradient
    scale = np.sqrt(np.outer(np.diag(curvature), np.diag(curvature)))
    np.testing.assert_allclose(fisher.total() / scale, curvature / scale, atol=1e-4)


@pytest.mark.parametrize("other", [SignedCoupling(), ElasticCentre()], ids=lambda other: other.key)
def test_all_parametrisations_know_the_same_of_the_stiffnesses(cheap_case, other):
    logs = fisher_information(_exact(cheap_case.problem, LogStiffness()), np.log(TABLE_3))
    theirs = fisher_information(_exact(cheap_case.problem, other), other.coordinates(TABLE_3))
    of_data = [dataclasses.replace(fisher, prior=np.zeros((3, 3))) for fisher in (logs, theirs)]
    assert of_data[1].stiffness_sd() == pytest.approx(of_data[0].sd(), rel=1e-6)


def test_the_logarithm_of_a_signed_coupling_follows_from_the_derivative():
    theta = np.array([20.0, 14.0, 0.05])
    data, names = np.diag([1e4, 1e4, 1e4]), ("k11", "k22", "rho")  # ρ to ±0.01
    fisher = random_fisher(np.zeros((3, 3)), data, SignedCoupling(), theta, names)
    # ln k12 = ln ρ + (ln k11 + ln k22)/2
    assert fisher.stiffness_sd()["k12"] == pytest.approx(0.01 * np.sqrt(20**2 + 0.5))


def test_what_is_free_makes_the_stiffnesses_less_known():
    # k22 is as uncertain as the length makes it, k12 as both make it, k11 not at all
    jacobian = np.array([[1.0, 0, 0, 0, 0], [0, 1.0, 0, 20.0, 100.0], [0, 0, 1.0, 0, 6.0]])
    data = jacobian.T @ jacobian / 0.01**2
    fisher = random_fisher(data=data, prior=np.diag([0, 0, 0, *PRIOR_SD[3:] ** -2.0]))
    joint = NAMES[:3]
    assert fisher.stiffness_sd(joint) == pytest.approx({"k11": 0.01, "k12": 0.01, "k22": 0.01})
    modulus, length = (fisher.stiffness_sd((*joint, freed)) for freed in NAMES[3:])
    assert modulus == pytest.approx({"k11": 0.01, "k12": np.hypot(0.01, 0.4), "k22": 0.01})
    assert length == pytest.approx({"k11": 0.01, "k12": np.hypot(0.01, 0.5), "k22": np.hypot(0.01, 0.03)})
    assert fisher.stiffness_sd()["k12"] == pytest.approx(np.sqrt(0.01**2 + 0.4**2 + 0.5**2))


def _exact(problem: Problem, parametrisation) -> Problem:
    """The problem with data of Table 3's joint without noise, and a normal prior that does not move the mode."""
    frf = problem.test.data.frf
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    data = synthesise_frf(
        problem.test.structure,
        problem.test.joints,
        pair_matrix(TABLE_3),
        ports,
        RelativeNoise(0.008, 0.0016),
        frf.quantity,
    )
    theta = parametrisation.coordinates(TABLE_3)
    log = isinstance(parametrisation, LogStiffness)
    marginals = [Normal(t, 2.0) if log else Uniform(t - 0.5, t + 0.5) for t in theta]
    prior = JointPrior(parametrisation, tuple(marginals))
    return Problem(structure=problem.test.structure, joint=problem.test.joints, data=data, prior=prior)
