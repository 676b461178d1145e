"""Structures that float: frequencies, modes and ratios count from the first mode that is no rigid-body motion."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg

import jointbayes as jb
from jointbayes.frf import AssembledModes, DirectSolve, NaturalFrequencies
from jointbayes.frf.modal import rigid_body_modes
from jointbayes.frf.mode_shapes import AssembledShapes
from jointbayes.inference import ModePrediction
from jointbayes.joint import Joints
from jointbayes.structure import ViscousMatrix, family_of_recipe
from tests.conftest import CONFIGS, STEEL
from tests.oracles import differences
from vibrecords import FrequencyData, ModeData, ModeShapes, Observed

FLAT = jb.Section.rectangle(0.04, 0.01)
ONE_RATIO = jb.ModalDamping((0.01,))


def row() -> tuple:
    """Four masses of which the first two and the last two hang together, and a joint between these pairs: all float."""
    structure = jb.chain([1.0, 2.0, 1.5, 0.7], [("1", "2", 4e4), ("3", "4", 7e4)], ONE_RATIO).structure()
    return structure, jb.Joint(("3:x",), ("2:x",))


def assembled(structure, joint, matrix):
    """Eigenvalues and shapes of the dense assembled problem, rigid-body motions and all."""
    p = joint.selection(structure)
    return linalg.eigh(structure.stiffness + p @ matrix @ p.T, structure.mass)


def two_bars(directions):
    """Two bars in a row, a joint between them in all directions of the model."""
    bodies = {
        name: jb.FrameBody({"a": (x, 0, 0), "b": (x + 0.3, 0, 0)}, (jb.Member(("a", "b"), FLAT, STEEL),))
        for name, x in (("left", 0.0), ("right", 0.3))
    }
    joint = jb.Joint(tuple(f"right.a:{d}" for d in directions), tuple(f"left.b:{d}" for d in directions))
    return jb.FrameRecipe(bodies, ONE_RATIO, directions), joint


@pytest.mark.parametrize(
    ("directions", "count"),
    [(("x", "y", "z", "rx", "ry", "rz"), 6), (("x", "y", "rz"), 3), (("y", "rz"), 2), (("x",), 1), (("rx",), 1)],
)
def test_two_bodies_with_a_joint_in_all_directions_float_like_one(directions, count):
    recipe, joint = two_bars(directions)
    structure = recipe.structure()
    assert rigid_body_modes(structure, joint) == count
    # to ground, nothing floats; in one direction alone, the two bodies keep all their others
    ground = jb.Joint(tuple(f"left.a:{d}" for d in directions), name="ground")
    assert rigid_body_modes(structure, Joints((replace(joint, name="between"), ground))) == 0
    one = jb.Joint((f"right.a:{directions[-1]}",), (f"left.b:{directions[-1]}",))
    assert rigid_body_modes(structure, one) == 2 * count - 1


def test_a_soft_suspension_is_no_rigid_body_motion_and_masses_without_springs_float_unless_joints_hold_them():
    structure, joint = row()
    hung = np.array(structure.stiffness)
    hung[0, 0] += 0.5  # 0.05 Hz
    masses = jb.chain([1.0, 2.0], (), ONE_RATIO).structure()
    between, ground = jb.Joint(("2:x",), ("1:x",), name="between"), jb.Joint(("1:x",), name="ground")
    cases = [(structure, joint), (replace(structure, stiffness=hung), joint)]
    cases += [(masses, between), (masses, Joints((between, ground)))]
    assert [rigid_body_modes(*case) for case in cases] == [1, 0, 1, 0]


def test_natural_frequencies_are_those_that_are_not_zero():
    structure, joint = row()
    k = np.array([[[3e4]], [[9e5]]])
    found = NaturalFrequencies(structure, joint, 3).frequency_hz(k)
    for one, matrix in zip(found, k, strict=True):
        assert_allclose(one, np.sqrt(assembled(structure, joint, matrix)[0][1:]) / (2 * np.pi), rtol=1e-9)
    model = NaturalFrequencies(structure, joint, 3)
    frequency, slope = model.tangent(k[0], np.ones((1, 1, 1)))
    assert_allclose(frequency, found[0])
    assert_allclose(slope[0], differences(lambda at: model.frequency_hz(at)[0], k[0], 0.3)[0], rtol=1e-5)


def test_shapes_and_damping_ratios_are_those_of_the_elastic_modes():
    structure, joint = row()
    matrix = np.array([[3e4]])
    lam, shapes = (part[..., 1:] for part in assembled(structure, joint, matrix))
    c = np.diag([3.0, 0.0, 0.0, 0.0])
    modes = AssembledShapes(replace(structure, damping=ViscousMatrix(c)), joint, 3, ("1:x", "4:x")).modes(matrix)
    assert_allclose(modes.frequency_hz[0], np.sqrt(lam) / (2 * np.pi), rtol=1e-9)
    assert_allclose(modes.damping_ratio[0], np.diag(shapes.T @ c @ shapes) / (2 * np.sqrt(lam)), rtol=1e-8)
    assert_allclose(modes.shapes[0, :, 1] / modes.shapes[0, :, 0], shapes[3] / shapes[0], rtol=1e-8)
    listed = AssembledShapes(replace(structure, damping=jb.ModalDamping((0.01, 0.02))), joint, 3, ("1:x",))
    assert listed.modes(matrix).damping_ratio.tolist() == [[0.01, 0.02, 0.02]]


def test_the_first_of_listed_damping_ratios_is_that_of_the_first_elastic_mode():
    structure, joint = row()
    listed = replace(structure, damping=jb.ModalDamping((0.005, 0.03, 0.05)))
    matrix, lines = np.array([[3e4]]), np.linspace(2.0, 80.0, 50)
    ports = jb.Ports(lines, ("1:x", "4:x"), ("1:x",))
    lam, shapes = assembled(structure, joint, matrix)
    omega, wr = 2 * np.pi * lines[:, None], np.sqrt(np.maximum(lam, 0))
    terms = 1 / (lam - omega**2 + 2j * np.array([0, 0.005, 0.03, 0.05]) * wr * omega)
    expected = np.einsum("lm,om->lo", terms * shapes[0], shapes[[0, 3]])[:, :, None]
    for model in (AssembledModes(listed, joint, ports), DirectSolve(listed, joint, ports)):
        found = model.receptance(matrix)[0]
        assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max(), rtol=1e-7)
    model = AssembledModes(listed, joint, ports)
    value, slope = model.tangent(matrix, np.ones((1, 1, 1)))
    assert_allclose(value, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())
    by_hand = differences(lambda at: model.receptance(at)[0], matrix, 1.0)[0]
    assert_allclose(slope[0], by_hand, rtol=1e-4, atol=1e-5 * np.abs(slope).max())


def test_modes_as_data_have_no_rigid_body_motions_among_them():
    structure, joint = row()
    matrix = np.array([[3e4]])
    lam, shapes = (part[..., 1:] for part in assembled(structure, joint, matrix))
    frequency = np.sqrt(lam) / (2 * np.pi)
    ratio = ModeShapes(("4:x",), "1:x", Observed((shapes[3] / shapes[0])[:2, None], 0.01))
    measured = ModeData(Observed(frequency[None, :2], 0.1), shapes=ratio)
    found = ModePrediction(measured, structure, joint).predicted_values(matrix[None])
    assert_allclose(np.sort(found), np.sort(np.hstack([frequency[:2], (shapes[3] / shapes[0])[:2]])[None]), rtol=1e-8)
    again = ModePrediction(replace(measured, match="shape"), structure, joint).predicted_values(matrix[None])
    assert_allclose(again, found, rtol=1e-8)


@pytest.mark.science
def test_two_beams_in_free_suspension_come_back_from_their_natural_frequencies():
    recipe, joint = two_bars(("y", "rz"))
    family = family_of_recipe(recipe)
    truth = np.array([2e7, 1e4, 3e4])
    exact = NaturalFrequencies(family, joint, 5).frequency_hz(jb.LogStiffness().matrix(truth))[0]
    assert exact[0] > 20
    prior = jb.JointPrior(jb.LogStiffness(), tuple(jb.Uniform(np.log(k / 30), np.log(30 * k)) for k in truth))
    problem = jb.Problem(structure=family, joint=joint, data=FrequencyData(exact, 1e-3 * exact), prior=prior)
    found = jb.find_map(problem)
    assert_allclose(problem.natural_frequencies_hz(found.values, 5)[0], exact, rtol=1e-4)
    assert problem.test.most_modes == problem.test.structures_of_data.nominal.n_dofs - 2 - 2


def test_two_lapped_beams_float_in_three_directions_however_many_modes_are_asked_for():
    """The finer the mesh, the more rounding there is in the rigid-body motions of its eigenvectors."""
    problem = jb.load_case(CONFIGS / "lapped_beams.toml").problem
    joint = problem.first_guess
    lowest = [problem.natural_frequencies_hz(joint, count)[0, 0] for count in (3, 20)]
    assert_allclose(lowest, lowest[0], rtol=1e-6)


def test_springs_between_many_single_masses_give_the_modes_of_the_whole_chain():
    """Each mass alone is a mode at 0 Hz: eighteen equal poles, of which a spring moves those of its own two bodies."""
    problem = jb.load_case(CONFIGS / "eighteen_storeys.toml").problem
    masses = np.repeat([21210.1, 21006.15, 20598.27], [11, 6, 1])
    matrices = problem.prior.matrix(problem.prior.sample(np.random.default_rng(1), 4000)).stiffness
    found = AssembledShapes(problem.test.structure, problem.test.joints, 4).modes(matrices).frequency_hz
    strokes = (np.eye(18) - np.eye(18, k=1)) / np.sqrt(masses)[:, None]
    expected = np.sqrt(np.linalg.eigvalsh(strokes @ matrices @ strokes.T)[:, :4]) / (2 * np.pi)
    assert_allclose(found, expected, rtol=1e-9)
