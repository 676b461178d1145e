"""What a clamp's edge and springs do to all modes: against a longer beam, a real spring and dense normal densities."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, linalg, stats
from scipy.interpolate import CubicSpline

import jointbayes as jb
from jointbayes.case.case import case_from_text
from jointbayes.inference import ErrorSizes, ModelErrorNoise
from jointbayes.inference.common_errors import with_common_errors
from jointbayes.joint import Joints
from tests.case.refusal_rows import parts_named
from tests.euler_beam import euler_beam
from tests.oracles import differences
from vibrecords import Antiresonances, FrequencyData, ModeData, ModeShapes, Observed

STIFFNESS = np.array([2e7, 3e4])
LENGTH = 0.3
BEAM = parts_named("rooms")["inference/common_errors beam"]


def problem_of(length=LENGTH, data=None, height=16.0, **sizes):
    text = BEAM.replace("LENGTH", f"{1000 * length:g}").replace("height_mm = 16.0", f"height_mm = {height}")
    problem = case_from_text("beam", text).problem
    data = problem.test.data if data is None else data
    return problem.with_test(data=data, noise=ModelErrorNoise.of(data, ErrorSizes(**sizes)))


def modes_and_zeros(numbers=(1, 2, 4)):
    """Modes but the third, and two antiresonances of the tip, near those of the beam."""
    hz = 100.0 * np.array(numbers) ** 2
    zeros = Antiresonances(("11:y", "11:y"), Observed(np.array([300.0, 900.0]), np.array([0.1, 0.2])), (1, 2))
    return ModeData(Observed(hz, 1e-4 * hz), numbers=numbers, zeros=zeros)


def theta_of(problem):
    return np.concatenate([np.log(STIFFNESS), problem.prior.mean[2:]])


def noise_of(problem, theta=None):
    """Noise of a test with what the clamp's edge and springs do at this point, or at the means of all but the joint."""
    return with_common_errors(problem, theta_of(problem) if theta is None else theta).test.noise


def log_values(problem, theta):
    return np.log(problem.log_posterior.predicted(theta)[0])


@pytest.mark.parametrize("data", [None, modes_and_zeros()])
def test_the_edge_does_what_a_longer_overhang_does(data):
    problem = problem_of(data=data)
    found = noise_of(problem)
    longer, shorter = (log_values(other, theta_of(other)) for other in map(problem_of, (0.3003, 0.2997), [data] * 2))
    by_length = 0.01 * (longer - shorter) / 0.002
    predicted_over_sd = problem.log_posterior.predicted(theta_of(problem))[0] / problem.test.data.sd
    assert found.edges[:, 0] / predicted_over_sd == pytest.approx(by_length, rel=2e-3)


def test_springs_are_tried_at_the_quantities_of_the_joint_without_a_table_over_all(monkeypatch):
    problem = problem_of(data=modes_and_zeros())
    theta = theta_of(problem)
    theta[2] += problem.prior.sd[2]  # a longer beam
    found, nominal = noise_of(problem, theta), noise_of(problem)
    monkeypatch.setattr(type(problem.test.structures), "solved_anew", lambda self: self)
    np.testing.assert_allclose(found.springs, noise_of(problem, theta).springs, rtol=1e-7, atol=1e-9)
    assert np.abs(found.springs / nominal.springs - 1).max() > 1e-4


@pytest.mark.parametrize("data", [None, modes_and_zeros()])
def test_springs_do_what_a_real_one_does(data):
    problem = problem_of(data=data)
    found = noise_of(problem)
    of_springs = found.springs / found.relative[:, None]
    assert (of_springs[0] ** 2).sum() == pytest.approx(1.0)  # a is what all of them do to the lowest frequency

    spring, beam = 10.0, problem.test.structures
    joints = Joints((jb.Joint(("1:y", "1:rz"), name="clamp"), jb.Joint(("11:y",), name="spring")))
    matrices = np.zeros((2, 3, 3))
    matrices[:, [0, 1], [0, 1]] = STIFFNESS
    matrices[1, 2, 2] = spring
    numbers = max(problem.test.data.numbers)
    model = jb.frf.NaturalFrequencies(beam, joints, numbers)
    without, on_spring = np.log(model.frequency_hz(matrices, np.ones((2, 1))))
    change = (on_spring - without)[np.array(problem.test.data.numbers) - 1]
    tip = of_springs[: len(change), -1]  # places are in order, and the tip is the last
    assert tip / tip[0] == pytest.approx(change / change[0], rel=1e-3)
    assert np.abs(of_springs[len(change) :, -1]).max(initial=0.0) == pytest.approx(0.0, abs=1e-6)  # held there


TIP, THIN = "11:y", 4.0  # mm high: shear does hardly anything


def fine(length, spring=0.0, numbers=(1, 2, 4), elements=120, at=None):
    """Frequencies and, of the first modes, motions along a beam of my own: Euler-Bernoulli, (x, modes).

    Cubic elements, shear-stiff; a spring to ground at the distance `at` from the free end.
    """
    modulus, density, width, height = 210e9, 7850.0, 0.030, THIN / 1000
    stiffness, inertia = euler_beam(length, modulus * width * height**3 / 12, density * width * height, elements)
    stiffness[[0, 1], [0, 1]] += STIFFNESS
    if spring:
        place = round((length - at) / length * elements)
        stiffness[2 * place, 2 * place] += spring
    squares, motions = linalg.eigh(stiffness, inertia, subset_by_index=(0, max(numbers) - 1))
    places = np.linspace(0.0, length, elements + 1)
    return np.sqrt(squares) / (2 * np.pi), CubicSpline(places, motions[::2])


def with_shapes(numbers=(1, 2, 4), reference=TIP):
    """The same modes with two components of each shape."""
    dofs = tuple(dof for dof in ("4:y", "9:y", TIP) if dof != reference)
    shapes = ModeShapes(dofs, reference, Observed(np.array([[0.2, 0.7], [-0.7, 0.5], [0.6, -0.5]]), 0.01))
    return replace(modes_and_zeros(numbers), zeros=None, shapes=shapes)


def ratios(motion, length, dofs, reference, numbers=(1, 2, 4)):
    """Of the numbered modes, at places as far from the free end as those of 300 mm are, (modes, dofs)."""
    of_free_end = {dof: 0.3 - 0.03 * (int(dof.split(":")[0]) - 1) for dof in (*dofs, reference)}
    at = {dof: motion(length - away)[np.array(numbers) - 1] for dof, away in of_free_end.items()}
    return np.stack([at[dof] / at[reference] for dof in dofs], axis=1)


@pytest.mark.parametrize("reference", [TIP, "9:y"])
def test_the_edge_leaves_sensors_where_they_are(reference):
    data = with_shapes(reference=reference)
    problem = problem_of(data=data, height=THIN)
    found = noise_of(problem).edges[3:, 0].reshape(3, 2) * 0.01
    longer, shorter = (ratios(fine(length)[1], length, data.shapes.dofs, reference) for length in (0.3015, 0.2985))
    assert found == pytest.approx(longer - shorter, rel=0.01, abs=1e-4)


@pytest.mark.parametrize("reference", [TIP, "9:y"])
def test_a_spring_changes_shapes_as_a_real_one_does(reference):
    data, spring, away = with_shapes(reference=reference), 20.0, 0.15
    problem = problem_of(data=data, height=THIN)
    noise = noise_of(problem)
    (hz, plain), (moved_hz, moved) = fine(0.3), fine(0.3, spring, at=away)
    change = (ratios(motion, 0.3, data.shapes.dofs, reference) for motion in (moved, plain))
    change = next(change) - next(change)
    relative = moved_hz[0] / hz[0] - 1
    middle = noise.springs[:, 4]  # points 2 to 11 in order: 6 is 150 mm from the free end
    scale = relative / (middle[0] / noise.relative[0])
    assert middle[3:].reshape(3, 2) * 0.01 * scale == pytest.approx(change, rel=0.02, abs=1e-6)


def test_neither_is_there_where_it_is_left_out_or_there_is_no_clamp():
    noise = noise_of(problem_of(edge=0.0, spring=0.0))
    assert noise.edges.shape == noise.springs.shape == (3, 0)
    middle = problem_of().with_test(joints=jb.Joint(("6:y", "6:rz")))  # held in the middle it has two overhangs
    assert noise_of(middle).edges.shape == (3, 0)


def test_a_clamp_of_two_overhangs_has_one_edge_in_mm():
    one = problem_of()
    tests = [replace(problem_of(length).test, name=f"{1000 * length:g}") for length in (0.3, 0.2)]
    both = with_common_errors(replace(one, tests=tuple(tests)), theta_of(one))
    first, second = (test.noise for test in both.tests)
    alone = [noise_of(problem) for problem in (one, problem_of(0.2))]
    assert first.edges == pytest.approx(alone[0].edges * 0.25 / 0.3)  # 1 % of their mean, 2.5 mm
    assert second.edges == pytest.approx(alone[1].edges * 0.25 / 0.2)
    (group,) = both.log_posterior.likelihood.sharing
    assert group.noise.edges[:, 0] == pytest.approx(np.concatenate([first.edges[:, 0], second.edges[:, 0]]))
    assert group.noise.springs.shape == (6, 2 * first.springs.shape[1])  # a spring of each rig


SIZES = ErrorSizes(frequency=0.004, factor=2.0, edge=0.01, spring=0.01, spring_factor=3.0)
DATA = FrequencyData([11.9, 30.8, 70.0], [0.05, 0.1, 0.2])
EDGES, SPRINGS = np.array([[-4.0], [-5.0], [-7.0]]), np.array([[300.0, 20.0], [60.0, 150.0], [10.0, 30.0]])
NOISE = replace(ModelErrorNoise.of(DATA, SIZES), edges=EDGES, springs=SPRINGS)


def dense(noise, s, a):
    size = s * noise.relative
    return np.eye(3) + np.diag(size**2) + noise.edges @ noise.edges.T + a**2 * noise.springs @ noise.springs.T


def test_the_density_is_the_mean_of_dense_normal_ones_over_both_sizes():
    for residual in ([0.5, -1.0, 0.3], [9.0, 3.0, -2.0], [-12.0, -16.0, -20.0]):

        def density(v, u, residual=residual):
            covariance = dense(NOISE, SIZES.frequency * SIZES.factor**u, SIZES.spring * SIZES.spring_factor**v)
            value = stats.multivariate_normal(cov=covariance).pdf(residual)
            return stats.norm.pdf(u) * stats.norm.pdf(v) * value

        exact = math.log(integrate.dblquad(density, -5, 5, -3, 3, epsrel=1e-4)[0] / (2 * stats.norm.cdf(3) - 1))
        z = np.array(residual)[None, :, None] / math.sqrt(2)
        assert NOISE.log_likelihood(z, ())[0] - 1.5 * math.log(2 * math.pi) == pytest.approx(exact, abs=0.01)


def test_replicated_residuals_have_the_covariance_of_edge_and_springs_and_scores_are_white():
    rng = np.random.default_rng(5)
    drawn = math.sqrt(2) * NOISE.draw(rng, np.tile([0.004, 0.02], (100_000, 1)), 3, 1)[:, :, 0]
    assert drawn.T @ drawn / len(drawn) == pytest.approx(dense(NOISE, 0.004, 0.02), rel=0.03, abs=0.3)
    z = NOISE.draw(rng, np.empty((20_000, 0)), 3, 1)
    squares = 2 * (NOISE.scores(z, ()) ** 2).mean(axis=(0, 2))
    assert squares.mean() == pytest.approx(1.0, abs=0.03)
    assert squares == pytest.approx(1.0, abs=0.12)


def test_what_moves_all_modes_is_found_again():
    noise = replace(NOISE, springs=100 * np.array([[3.0], [0.5], [0.1]]))
    rng = np.random.default_rng(6)
    moved = {"edge": 2.0 * EDGES[:, 0], "spring": 0.1 * noise.springs[:, 0]}
    z = np.array([np.zeros(3), moved["edge"], moved["spring"]])[:, :, None] / math.sqrt(2)
    none, edge, _ = noise.shift_of_edges(z)[:, 0]
    assert none == pytest.approx(0.0, abs=1e-12)
    assert 1.2 < edge < 2.0  # drawn towards the prior
    sizes = [np.median(noise.draw_size(rng, np.repeat(each[None], 4000, axis=0))[:, 1]) for each in z]
    assert sizes[0] < SIZES.spring < 0.05 < sizes[2] < 0.2


def test_the_slopes_of_many_joints_come_from_one_evaluation_of_the_density(monkeypatch):
    problem = with_common_errors(problem_of(), theta_of(problem_of()))
    density, low = problem.log_posterior, problem.prior.support[0]
    many = problem.prior.sample(np.random.default_rng(3), 4)
    many[1, 0] = low[0]  # at an edge: the difference goes to one side
    alone = np.array([density.gradient(theta) for theta in many])
    calls, evaluate = [], density.log_likelihood
    monkeypatch.setattr(density, "log_likelihood", lambda theta: calls.append(len(theta)) or evaluate(theta))
    np.testing.assert_allclose(density.gradient(many), alone, rtol=1e-6)
    assert len(calls) == 1
    np.testing.assert_allclose(alone[:, 1], differences(density, many, 1e-4)[1], rtol=1e-3)
