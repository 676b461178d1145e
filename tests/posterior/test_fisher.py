"""Fisher information: blocks, priors, coordinates, combinations that nothing determines."""

import numpy as np
import pytest

from jointbayes.errors import ModelError
from jointbayes.frf import Ports
from jointbayes.identification.refine import laplace_covariance
from jointbayes.inference import JointPrior, Normal, Problem, Uniform
from jointbayes.joint import LogStiffness, SignedCoupling, joint_matrix
from jointbayes.measurement import RelativeNoise, synthesise_frf
from jointbayes.posterior.information.fisher import FisherInformation, fisher_information
from jointbayes.posterior.information.freeing import freeing_table
from tests.conftest import TABLE_3

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
    sd = fisher.sd(["length", "k11"], with_prior=False)
    assert list(sd) == ["length", "k11"]
    expected = np.sqrt(np.diag(np.linalg.inv(fisher.data[np.ix_(rows, rows)])))
    np.testing.assert_allclose(list(sd.values()), expected)
    whole = np.linalg.inv(fisher.data + fisher.prior)
    root = np.sqrt(np.diag(whole))
    np.testing.assert_allclose(fisher.correlation(), whole / np.outer(root, root), atol=1e-12)


def test_joint_information_is_the_inverse_of_the_joints_block_of_the_covariance():
    fisher = random_fisher()
    names, information = fisher.joint_information(with_prior=True)
    assert names == ("k11", "k12", "k22")
    np.testing.assert_allclose(np.linalg.inv(information), fisher.covariance()[:3, :3], rtol=1e-9)
    prior = fisher.prior.copy()
    prior[:3, :3] = 0.0  # without the joint's own prior, but with that of the nuisances
    _, data_only = fisher.joint_information()
    whole = np.linalg.inv(fisher.data + prior)
    np.testing.assert_allclose(np.linalg.inv(data_only), whole[:3, :3], rtol=1e-9)
    directions = fisher.eigen_directions()
    assert [d.sd for d in directions] == sorted(d.sd for d in directions)
    for direction in directions:
        assert direction.weights @ whole[:3, :3] @ direction.weights == pytest.approx(direction.sd**2)
        assert direction.weights[np.abs(direction.weights).argmax()] > 0


def test_a_parameter_or_combination_that_nothing_determines_has_no_finite_sd():
    data = np.zeros((5, 5))
    both = np.array([1.0, 1.0, 0.0, 0.0, 0.0])  # only k11·k12 is seen, and k22
    data += 1e4 * np.outer(both, both) + 1e2 * np.diag([0, 0, 1, 0, 0])
    fisher = random_fisher(data=data, prior=np.zeros((5, 5)))
    assert fisher.sd() == {name: pytest.approx(0.1) if name == "k22" else np.inf for name in NAMES}
    assert fisher.correlation()[0, 1] == pytest.approx(-1.0)
    assert fisher.correlation()[0, 3] == 0.0
    best, middle, worst = fisher.eigen_directions()
    assert best.sd == pytest.approx(0.01 / np.sqrt(2))
    assert middle.sd == pytest.approx(0.1)
    assert worst.sd == np.inf


@pytest.mark.parametrize("seed", range(6))
def test_rounding_does_not_make_a_direction_known(seed):
    root = np.random.default_rng(seed).normal(size=(2, 3)) * 1e3  # two residuals, three stiffnesses
    fisher = random_fisher(data=root.T @ root, prior=np.zeros((3, 3)), names=NAMES[:3])
    assert [np.isinf(direction.sd) for direction in fisher.eigen_directions()] == [False, False, True]
    assert set(fisher.sd().values()) == {np.inf}


def test_nuisances_that_the_data_do_not_see_change_nothing():
    seen = random_fisher(names=NAMES[:3])
    data = np.zeros((5, 5))
    data[:3, :3] = seen.data
    fisher = random_fisher(data=data, prior=np.zeros((5, 5)))
    np.testing.assert_allclose(fisher.joint_information()[1], seen.data)


def test_data_part_is_the_curvature_of_the_likelihood_of_exact_data(cheap_case):
    problem = _exact(cheap_case.problem, LogStiffness())
    theta = np.log(TABLE_3)
    fisher = fisher_information(problem, theta)
    assert fisher.names == ("k11", "k12", "k22")
    assert (fisher.prior == np.diag(problem.prior.precision)).all()
    curvature = np.linalg.inv(laplace_covariance(problem.log_posterior, theta))  # differences of the gradient
    scale = np.sqrt(np.outer(np.diag(curvature), np.diag(curvature)))
    np.testing.assert_allclose(fisher.total() / scale, curvature / scale, atol=1e-4)


def test_both_parametrisations_know_the_same_of_the_stiffnesses(cheap_case):
    logs = fisher_information(_exact(cheap_case.problem, LogStiffness()), np.log(TABLE_3))
    signed_theta = SignedCoupling().coordinates(TABLE_3)
    signed = fisher_information(_exact(cheap_case.problem, SignedCoupling()), signed_theta)
    assert signed.stiffness_sd(with_prior=False) == pytest.approx(logs.sd(with_prior=False), rel=1e-6)
    names, information = signed.joint_information()
    assert names == ("k11", "k12", "k22")
    np.testing.assert_allclose(information, logs.data, rtol=1e-6, atol=1e-6 * logs.data.max())


def test_a_coupling_whose_sign_is_open_keeps_its_own_coordinate():
    theta = np.array([20.0, 14.0, 0.05])
    data = np.diag([1e2, 1e2, 1e2])  # ρ to ±0.1
    names = ("k11", "k22", "rho")
    fisher = random_fisher(data=data, names=names, theta=theta, parametrisation=SignedCoupling())
    assert fisher.joint_information()[0] == names
    sharp = random_fisher(data=100 * data, names=names, theta=theta, parametrisation=SignedCoupling())
    assert sharp.joint_information()[0] == ("k11", "k12", "k22")
    # ln k12 = ln ρ + (ln k11 + ln k22)/2
    assert sharp.stiffness_sd(with_prior=False)["k12"] == pytest.approx(0.01 * np.sqrt(20**2 + 0.5))


def test_wrong_names_and_shapes_are_refused():
    fisher = random_fisher()
    with pytest.raises(ModelError, match="found free parameters k13"):
        fisher.sd(["k13"])
    with pytest.raises(ModelError, match="each once"):
        fisher.covariance(["k11", "k11"])
    with pytest.raises(ModelError, match="joint's coordinates"):
        random_fisher(parametrisation=SignedCoupling())


def test_freeing_table_has_a_row_for_each_nuisance_and_one_for_all():
    # k22 is as uncertain as the length makes it, k12 as both make it, k11 not at all
    jacobian = np.array(
        [
            [1.0, 0, 0, 0, 0],
            [0, 1.0, 0, 20.0, 100.0],
            [0, 0, 1.0, 0, 6.0],
        ]
    )
    data = jacobian.T @ jacobian / 0.01**2
    fisher = random_fisher(data=data, prior=np.diag([0, 0, 0, *PRIOR_SD[3:] ** -2.0]))
    known, modulus, length, everything = freeing_table(fisher, ["youngs_modulus", "length"])
    assert [row.freed for row in (known, modulus, length)] == [(), ("youngs_modulus",), ("length",)]
    assert everything.freed == ("youngs_modulus", "length")
    assert known.sd_log == pytest.approx({"k11": 0.01, "k12": 0.01, "k22": 0.01})
    assert modulus.sd_log == pytest.approx({"k11": 0.01, "k12": np.hypot(0.01, 0.4), "k22": 0.01})
    assert length.sd_log == pytest.approx({"k11": 0.01, "k12": np.hypot(0.01, 0.5), "k22": np.hypot(0.01, 0.03)})
    assert everything.sd_log["k12"] == pytest.approx(np.sqrt(0.01**2 + 0.4**2 + 0.5**2))
    assert everything.ratio["k11"] == pytest.approx(np.exp(2 * 1.959964 * 0.01))
    assert everything.verdict == {"k11": "identified", "k12": "not identified", "k22": "identified"}


def test_a_stiffness_that_only_its_prior_knows_is_not_identified():
    fisher = random_fisher(data=np.zeros((3, 3)), prior=np.eye(3) / 0.02**2, names=NAMES[:3])
    tight = FisherInformation(
        fisher.names, fisher.theta, fisher.data, fisher.prior, np.full(3, 0.02), fisher.parametrisation
    )
    assert set(freeing_table(tight, [])[0].verdict.values()) == {"not identified"}


def _exact(problem: Problem, parametrisation) -> Problem:
    """The problem with data of Table 3's joint without noise, and a normal prior that does not move the mode."""
    frf = problem.measurement.frf
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    data = synthesise_frf(
        problem.structure, problem.joint, joint_matrix(TABLE_3), ports, RelativeNoise(0.008, 0.0016), frf.quantity
    )
    theta = parametrisation.coordinates(TABLE_3)
    signed = "rho" in parametrisation.names
    marginals = [Normal(t, 2.0) if not signed else Uniform(t - 0.5, t + 0.5) for t in theta]
    prior = JointPrior(parametrisation, tuple(marginals))
    return Problem(problem.structure, problem.joint, data, prior)
