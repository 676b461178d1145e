"""Starts for many unknowns from reconstructed motions of the joints."""

from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import DirectSolve, Ports
from jointbayes.identification import refine
from jointbayes.identification.reconstruction import _MODEL_ERROR, _TestData, reconstructed_starts
from jointbayes.inference import JointPrior, Uniform
from jointbayes.joint import Damped, Joint, Joints, blocks_of, parametrisation_named
from jointbayes.structure import LossFactor, ModalDamping
from tests.conftest import PAIR, rod
from tests.oracles import differences, noisy_frfs
from vibrecords import FrequencyData

PLACES = (Joint(("1:y", "1:rz"), name="left"), Joint(("5:y", "5:rz"), name="inner"), Joint(("11:y",), name="right"))
SPRINGS = {place.name: parametrisation_named("springs", place.directions) for place in PLACES}
LOW, HIGH = np.log([1e5, 1e2, 1e5, 1e2, 1e5]), np.log([1e10, 1e7, 1e10, 1e7, 1e10])
PORTS = Ports(np.arange(20.0, 3000.0, 6.0), ("3:y", "8:y"), ("10:y",))


def problem_of(k, seed=1, kinds=SPRINGS, damping=None, low=LOW, high=HIGH):
    """Data of the joints, solved line by line, and a prior of decades."""
    kinds, structure = blocks_of(kinds), rod(damping=damping or LossFactor(0.01))
    exact = DirectSolve(structure, Joints(PLACES), PORTS).receptance(kinds.matrix(np.asarray(k)))[0]
    prior = JointPrior(kinds, tuple(Uniform(*ends) for ends in zip(low, high, strict=True)))
    data = noisy_frfs(exact, PORTS, seed, relative=0.03)
    return jb.Problem(structure=structure, joint=PLACES, data=data, prior=prior)


def random_springs(seed):
    return np.exp(np.random.default_rng(seed).uniform(LOW, HIGH))


def damped_problem():
    kinds = {"left": PAIR, "inner": Damped(SPRINGS["inner"], ("ky",), ("krz",)), "right": SPRINGS["right"]}
    k = [5e7, 4e5, 5e4, 3e7, 2e4, 200.0, 0.1, 1e6]
    low, high = np.log(k) - 3, np.log(k) + 3
    return problem_of(k, kinds=kinds, low=low, high=high), np.log(k)


def solved(problem, k):
    """Receptances of the joints, solved line by line."""
    direct = DirectSolve(rod(damping=LossFactor(0.01)), Joints(PLACES), PORTS)
    return direct.receptance(problem.parametrisation.matrix(k))[0]


def test_without_tolerance_the_squares_are_those_of_the_frfs():
    problem, other = problem_of(random_springs(4)), 1.3 * random_springs(4)
    part, there = _TestData.from_problem(problem), slice(None, None, 6)
    np.testing.assert_allclose(part.omega / (2 * np.pi), PORTS.frequency_hz[there])
    h = solved(problem, other)[there]
    data, variance = problem.test.data.frf.values[there], problem.test.data.variance[there]
    expected = np.sum(np.abs(h - data) ** 2 / (variance + (_MODEL_ERROR * np.abs(data)) ** 2))
    assert part.value(np.log(other)[None], 1e-9)[0] == pytest.approx(expected, rel=1e-6)


def test_joints_that_made_the_data_leave_nothing_whatever_the_tolerance():
    k = random_springs(5)
    problem = problem_of(k)
    part = _TestData.from_problem(problem)
    noise = (problem.test.data.frf.values - solved(problem, k))[::6]
    noise_free = replace(part, off=part.off - noise)
    for tolerance in (3.0, 0.1):
        theta = np.log(k)[None]
        assert noise_free.value(theta, tolerance)[0] < 1e-6 * part.value(theta + 1.0, tolerance)[0]


@pytest.mark.parametrize("tolerance", [3.0, 0.05])
@pytest.mark.parametrize("damped", [False, True])
def test_the_slope_of_the_squares_is_that_of_differences(damped, tolerance):
    problem, theta = damped_problem() if damped else (problem_of(random_springs(3)), np.log(random_springs(3)))
    part, theta = _TestData.from_problem(problem), theta + 0.3
    residual, jacobian = part.linearised(theta, tolerance)
    assert residual @ residual == pytest.approx(part.value(theta[None], tolerance)[0], rel=1e-9)
    slope = differences(lambda at: part.value(at[None], tolerance)[0], theta)
    np.testing.assert_allclose(2 * jacobian.T @ residual, slope, rtol=1e-4, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("damped", [False, True])
def test_squares_beside_a_point_are_those_of_the_places_themselves(damped):
    problem, theta = damped_problem() if damped else (problem_of(random_springs(3)), np.log(random_springs(3)))
    part = _TestData.from_problem(problem)
    moved = np.tile(theta, (theta.size, 3, 1))
    for column, rows in enumerate(moved):
        rows[:, column] += [-2.0, 0.5, 2.0]
        rows[2, column - 1] += 0.5  # and two that change together
    for tolerance in (3.0, 0.05):
        expected = part.value(moved.reshape(-1, theta.size), tolerance).reshape(moved.shape[:2])
        np.testing.assert_allclose(part.values_near(theta, moved, tolerance), expected, rtol=1e-7)


@pytest.mark.science
@pytest.mark.parametrize("damping", [LossFactor(0.01), ModalDamping((0.005,))], ids=["loss", "modal"])
def test_the_best_start_leads_to_the_mode(damping):
    for seed in (1, 2):
        k = random_springs(seed)
        problem = problem_of(k, seed, damping=damping)
        _, best = refine(problem.log_posterior, np.log(k))
        starts = reconstructed_starts(problem, np.random.default_rng(seed))
        assert starts.shape[1] == 5
        assert max(refine(problem.log_posterior, start)[1] for start in starts) > best - 1e-3, seed


@pytest.mark.science
def test_dashpots_and_loss_factors_are_found_with_their_springs():
    problem, theta = damped_problem()
    _, best = refine(problem.log_posterior, theta)
    starts = reconstructed_starts(problem, np.random.default_rng(1))
    assert refine(problem.log_posterior, starts[0])[1] > best - 1e-3


def test_few_unknowns_and_data_that_are_no_frfs_have_no_such_starts():
    whole, few = problem_of(random_springs(1)), (Joint(("1:y", "1:rz"), name="left"),)
    prior = JointPrior(blocks_of({"left": PAIR}), (Uniform(10.0, 20.0),) * 3)
    frequencies = FrequencyData([50.0, 200.0, 500.0, 900.0, 1500.0], [1.0] * 5)
    for problem, unknowns in (
        (jb.Problem(structure=rod(), joint=few, data=whole.test.data, prior=prior), 3),
        (whole.with_test(data=frequencies), 5),
    ):
        assert reconstructed_starts(problem, np.random.default_rng(1)).shape == (0, unknowns)
