"""Several joints in one problem, against the assembled structure solved line by line and mode by mode."""

import numpy as np
import pytest
from scipy import linalg

import jointbayes as jb
from jointbayes.frf import DirectSolve, NaturalFrequencies, Ports, receptance_model
from jointbayes.inference import JointPrior, Normal, Uniform
from jointbayes.inference.prior import log_probability_inside
from jointbayes.joint import Joint, Joints, LogStiffness, Rigid, SignedCoupling, blocks_of, parametrisation_named
from jointbayes.structure import LossFactor, ModalDamping
from tests.conftest import PAIR, rod
from tests.oracles import check_density, noisy_frfs
from vibrecords import FrequencyData

PLACES = {
    "left": Joint(("1:y", "1:rz"), name="left"),
    "inner": Joint(("5:y", "5:rz"), ("6:y", "6:rz"), name="inner"),
    "right": Joint(("11:y", "11:rz"), name="right"),
}
KINDS = {"left": LogStiffness(), "inner": parametrisation_named("springs", ("y", "rz")), "right": SignedCoupling()}
K = np.array([5e8, 1e6, 2e5, 3e7, 4e4, 8e7, -2e5, 6e4])
PORTS = Ports(np.arange(20.0, 1200.0, 40.0), ("3:y", "9:y"), ("9:y",))


def joined(damping):
    structure, joints, parametrisation = rod(damping=damping), tuple(PLACES.values()), blocks_of(KINDS)
    exact = DirectSolve(structure, Joints(joints), PORTS).receptance(parametrisation.matrix(K))[0]
    measurement, theta = noisy_frfs(exact, PORTS), parametrisation.coordinates(K)
    marginals = tuple(
        Uniform(-1.0, 1.0) if axis.bounded else Normal(t + 0.1, 2.0)
        for axis, t in zip(parametrisation.axes, theta, strict=True)
    )
    prior = JointPrior(parametrisation, marginals)
    return jb.Problem(structure=structure, joint=joints, data=measurement, prior=prior), theta, exact


DAMPED = pytest.mark.parametrize("damping", [ModalDamping((0.01, 0.02)), LossFactor(0.02)], ids=["modal", "loss"])


@DAMPED
def test_the_likelihood_of_several_joints_and_its_slope_are_those_of_the_assembled_structure(damping):
    problem, theta, exact = joined(damping)
    values, variance = problem.test.data.frf.values, problem.test.data.variance
    expected = -np.sum(np.log(np.pi * variance) + np.abs(exact - values) ** 2 / variance)
    assert problem.log_posterior.log_likelihood(theta)[0] == pytest.approx(expected, rel=1e-9)
    assert np.abs(problem.log_posterior.predicted(theta)[0] - exact).max() < 1e-9 * np.abs(exact).max()
    check_density(problem.log_posterior, theta, rtol=1e-4)


def test_natural_frequencies_of_several_joints_are_those_of_the_assembled_matrices():
    structure, parametrisation = rod(), blocks_of(KINDS)
    added = sum(
        joint.selection(structure) @ kind.matrix(k).stiffness @ joint.selection(structure).T
        for joint, kind, k in zip(PLACES.values(), KINDS.values(), np.split(K, [3, 5]), strict=True)
    )
    expected = np.sqrt(linalg.eigh(structure.stiffness + added, structure.mass, eigvals_only=True)[:5]) / (2 * np.pi)
    measurement = FrequencyData(expected, np.ones(5))
    wide = {True: Uniform(-1.0, 40.0), False: Uniform(-1.0, 1.0)}
    prior = JointPrior(parametrisation, tuple(wide[axis.logarithmic] for axis in parametrisation.axes))
    problem = jb.Problem(structure=structure, joint=list(PLACES.values()), data=measurement, prior=prior)
    np.testing.assert_allclose(problem.natural_frequencies_hz(K, 5)[0], expected, rtol=1e-8)
    assert problem.test.most_modes == structure.n_dofs - 6


def test_a_rigid_joint_among_others_is_a_support():
    structure = rod()
    joints = Joints((PLACES["left"], PLACES["right"]))
    kinds = blocks_of({"left": Rigid(2), "right": PAIR})
    k = np.array([8e7, 2e5, 6e4])
    held = structure.fixed(("1:y", "1:rz"))
    alone = NaturalFrequencies(held, PLACES["right"], 4).frequency_hz(PAIR.matrix(k))
    np.testing.assert_allclose(NaturalFrequencies(structure, joints, 4).frequency_hz(kinds.matrix(k)), alone, rtol=1e-9)
    there = receptance_model(structure, joints, PORTS).receptance(kinds.matrix(k))
    expected = DirectSolve(held, PLACES["right"], PORTS).receptance(PAIR.matrix(k))
    # as near as a rigid joint alone comes to a support: rounding of 1e30 N/m, magnified by the resonances
    np.testing.assert_allclose(there, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_one_joint_with_a_name_has_the_likelihood_of_one_without():
    problem, *_ = joined(ModalDamping((0.01,)))
    marginals = tuple(Uniform(10.0, 25.0) for _ in range(3))
    one = {"structure": rod(), "data": problem.test.data}
    plain = jb.Problem(joint=Joint(("1:y", "1:rz")), prior=JointPrior(PAIR, marginals), **one)
    named = jb.Problem(joint=[PLACES["left"]], prior=JointPrior(blocks_of({"left": PAIR}), marginals), **one)
    theta = np.random.default_rng(2).uniform(11, 24, size=(20, 3))
    np.testing.assert_array_equal(plain.log_posterior(theta), named.log_posterior(theta))
    assert named.names == ("left.k11", "left.k12", "left.k22")


def test_the_cones_of_several_joints_leave_the_product_of_their_probabilities():
    one = tuple(Uniform(10.0, 20.0) for _ in range(3))
    other = (Uniform(12.0, 20.0), Uniform(5.0, 18.0), Uniform(10.0, 19.0))
    both = blocks_of({"a": PAIR, "b": PAIR})
    expected = log_probability_inside(PAIR, one) + log_probability_inside(PAIR, other)
    assert log_probability_inside(both, one + other) == pytest.approx(expected, abs=1e-8)
    prior = JointPrior(both, one + other)
    drawn = prior.sample(np.random.default_rng(1), 4000)
    turned = prior.transform(np.random.default_rng(2).random((4000, 6)))
    assert prior.feasible(turned).all()
    np.testing.assert_allclose(turned.mean(axis=0), drawn.mean(axis=0), atol=0.25)


@pytest.mark.long
@pytest.mark.science
def test_two_joints_are_found_where_one_sensor_between_them_listens():
    joints = [PLACES["left"], PLACES["right"]]
    kinds = blocks_of({"left": PAIR, "right": PAIR})
    truth = np.array([5e7, 4e5, 5e4, 2e7, 2e5, 3e4])
    ports = Ports(np.arange(20.0, 2500.0, 4.0), ("4:y", "9:y"), ("4:y",))
    exact = DirectSolve(rod(), Joints(tuple(joints)), ports).receptance(kinds.matrix(truth))[0]
    measurement = noisy_frfs(exact, ports, relative=0.03)
    prior = JointPrior(kinds, tuple(Uniform(t - 4, t + 3) for t in np.log(truth)))
    problem = jb.Problem(structure=rod(), joint=joints, data=measurement, prior=prior)
    posterior = jb.sample(problem, seed=1, premises="exact")
    assert posterior.converged
    for name, k in zip(kinds.stiffness_names, truth, strict=True):
        low, high = posterior.interval(name, 0.999)
        assert low < k < high, name
    assert posterior.summary().parameters["left.k22"].known.verdict == "identified"
