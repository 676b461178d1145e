"""Joints: where they act, in axes of their own, over rigid links and side by side; and their matrices as one object."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jointbayes as jb
from jointbayes.joint import COORDINATES, JointMatrix, Joints, joint_matrix_of, joints_of
from tests.conftest import CLAMP, PAIR, TABLE_3, pair_matrix, rod

SIX = ("x", "y", "z", "rx", "ry", "rz")
TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


class Points:
    """Nodes with six DOFs each at stated places."""

    def __init__(self, places):
        self.places = places
        self.dofs = [f"{node}:{direction}" for node in places for direction in SIX]
        self.n_dofs = len(self.dofs)

    def index(self, labels):
        return np.array([self.dofs.index(label) for label in labels])

    def position(self, label):
        return self.places[int(label.split(":")[0])]

    def moved(self, translation, rotation):
        """Motion of all DOFs in a small rigid motion about the origin."""
        at_nodes = (translation + np.cross(rotation, place) for place in self.places.values())
        return np.concatenate([[*moved, *rotation] for moved in at_nodes])


def labels(node, directions=SIX):
    return tuple(f"{node}:{direction}" for direction in directions)


def test_the_paper_s_patterns_add_up_to_the_joint_matrix():
    matrix = pair_matrix([3.0, 1.0, 2.0])
    assert_array_equal(matrix, [[3.0, 1.0], [1.0, 2.0]])
    assert_array_equal(np.einsum("k,kij->ij", [3.0, 1.0, 2.0], PAIR.pattern), matrix)
    assert pair_matrix(np.ones((4, 5, 3))).shape == (4, 5, 2, 2)
    with pytest.raises(ValueError, match="read-only"):
        PAIR.pattern[0, 0, 0] = 2.0


def test_a_joint_to_ground_sees_the_motion_of_its_dofs():
    structure, motion = rod(), np.arange(22.0)
    assert_array_equal(CLAMP.selection(structure).T @ motion, motion[:2])
    assert_array_equal(jb.Joint(("1:rz", "1:y")).selection(structure).T @ motion, motion[[1, 0]])


def test_a_joint_between_two_sets_sees_their_difference_and_no_common_motion():
    structure, inner = rod(), jb.Joint(("3:y", "3:rz"), against=("8:y", "8:rz"))
    motion = np.random.default_rng(1).normal(size=22)
    near, far = structure.index(inner.dofs), structure.index(inner.against)
    deformation = inner.selection(structure).T @ motion
    assert_allclose(deformation, motion[near] - motion[far], rtol=1e-15)
    assert not (inner.selection(structure).T @ np.tile([1.0, 0.0], 11)).any()
    # action equals reaction: the assembled joint forces add up to zero
    forces = inner.selection(structure) @ pair_matrix(TABLE_3) @ deformation
    assert_array_equal(forces[near], -forces[far])
    assert np.count_nonzero(forces) == 4


def test_own_axes_turn_the_motions_of_a_joint():
    structure, motion = Points({1: np.zeros(3)}), np.random.default_rng(1).normal(size=6)
    found = jb.Joint(labels(1), axes=TURN).selection(structure).T @ motion
    assert_allclose(found, np.concatenate([TURN @ motion[:3], TURN @ motion[3:]]), rtol=1e-14)
    along = jb.Joint(("1:y",), axes=TURN)
    assert along.labels == ("1:x", "1:y", "1:z")
    assert_allclose(along.selection(structure).T @ motion, TURN[1] @ motion[:3])


def test_an_offset_is_a_rigid_link_to_the_point_of_the_joint():
    place, offset = np.array([0.3, -0.2, 0.5]), np.array([0.02, 0.05, -0.03])
    structure, (translation, rotation) = Points({1: place}), np.random.default_rng(2).normal(size=(2, 3))
    motion, at_point = structure.moved(translation, rotation), translation + np.cross(rotation, place + offset)
    for axes, turn in ((None, np.eye(3)), (TURN, TURN)):
        found = jb.Joint(labels(1), axes=axes, offset_m=offset).selection(structure).T @ motion
        assert_allclose(found, [*(turn @ at_point), *(turn @ rotation)], rtol=1e-13)


def test_a_joint_over_links_feels_no_common_rigid_motion():
    structure = Points({1: np.zeros(3), 2: np.array([0.1, 0.02, 0.0])})
    links = {"offset_m": (0.06, 0.0, 0.0), "offset_against_m": (-0.04, -0.02, 0.0)}
    joint = jb.Joint(labels(1), labels(2), axes=TURN, **links)
    motion = structure.moved(*np.random.default_rng(3).normal(size=(2, 3)))
    assert_allclose(joint.selection(structure).T @ motion, np.zeros(6), atol=1e-14)


APART = Points({1: np.zeros(3), 2: np.array([0.025, 0.0, 0.0])})


@pytest.mark.parametrize("offset", [{"offset_m": (0.025, 0, 0)}, {"offset_against_m": (-0.025, 0, 0)}])
def test_an_offset_may_lead_from_one_side_to_the_other(offset):
    jb.Joint(labels(1), labels(2), **offset).selection(APART)


def test_joints_side_by_side_are_their_selections_side_by_side():
    structure = rod()
    one, other = jb.Joint(("1:y", "1:rz"), name="one"), jb.Joint(("3:y",), ("8:y",), name="other")
    joints = Joints((one, other))
    expected = np.hstack([one.selection(structure), other.selection(structure)])
    assert_array_equal(joints.selection(structure), expected)
    assert (joints.size, joints.labels) == (3, ("1:y", "1:rz", "3:y", "8:y"))
    whole = np.zeros_like(expected)
    whole[structure.index(joints.labels)] = joints.deformations(joints.labels)
    assert_array_equal(whole, expected)
    assert joints_of(joints) is joints
    assert joints_of([one, other]) == joints
    assert str(joints) == "one: 1:y, 1:rz to ground; other: 3:y to 8:y"


@pytest.mark.parametrize("stiffness", [[2.0, 2.0, 2.0], [2.0, -2.0, 2.0], [1e8, 0.0, 0.0], [0.0, 0.0, 0.0], TABLE_3])
def test_the_edge_of_the_cone_is_a_possible_joint(stiffness):
    PAIR.check(stiffness)
    assert np.linalg.eigvalsh(pair_matrix(stiffness)).min() >= 0.0


@pytest.mark.parametrize("key", COORDINATES)
@pytest.mark.parametrize("stiffness", [[0.0, 0.0, 0.0], [1e8, 0.0, 0.0], [1e8, -2e8, 1e6], [1e9, 1e9, 1e6], TABLE_3])
def test_any_joint_has_a_positive_definite_one_near_that_has_coordinates(key, stiffness):
    parametrisation = jb.parametrisation_named(key)
    near = parametrisation.nearest(stiffness)
    assert parametrisation.describes(near)
    size = np.sqrt(near[[0, 2]])
    assert (np.linalg.eigvalsh(pair_matrix(near) / np.outer(size, size)) > 0).all()
    assert parametrisation.feasible(parametrisation.coordinates(near))
    if parametrisation.describes(stiffness) and abs(stiffness[1]) < 0.9 * np.sqrt(stiffness[0] * stiffness[2]):
        assert_array_equal(near, stiffness)


# matrices

K, C, H = np.random.default_rng(1).normal(size=(3, 5, 4, 4))
OMEGA = np.array([3.0, 70.0])


def test_the_dynamic_stiffness_is_k_plus_j_omega_c_plus_j_h_and_the_damping_alone_has_no_k():
    found = JointMatrix(K, C, H).dynamic_stiffness(OMEGA)
    assert_array_equal(found, K[:, None] + 1j * (OMEGA[:, None, None] * C[:, None] + H[:, None]))
    assert_array_equal(JointMatrix(K, C, H).dissipative.sides, [0 * K, C, H])


def test_one_kind_of_damping_alone_leaves_the_other_at_zero():
    assert_array_equal(JointMatrix(K, viscous=C).sides, [K, C, 0 * K])
    assert_array_equal(JointMatrix(K, hysteretic=H).sides, [K, 0 * K, H])
    assert_array_equal(JointMatrix(K).sides, [K, 0 * K, 0 * K])
    damped = [JointMatrix(K, viscous=C).damped, JointMatrix(K, hysteretic=H).damped, JointMatrix(K).damped]
    assert damped == [True, True, False]


@pytest.mark.parametrize("sides", [(K,), (K, C, H)])
def test_what_is_done_to_a_batch_is_done_to_each_of_its_matrices(sides):
    joints = JointMatrix(*sides)
    assert (len(joints), joints.size, joints.damped) == (5, 4, len(sides) == 3)
    for found, given in zip(joints[1:3].block(slice(1, 3)).sides, sides, strict=False):
        assert_array_equal(found, given[1:3, 1:3, 1:3])
    assert_array_equal(joints[2].batch.stiffness, K[2:3])
    assert_array_equal(joints[2].repeated(3).stiffness, K[[2, 2, 2]])
    moved = joints[0].moved(joints, -0.5)
    for found, given in zip(moved.sides, sides, strict=False):
        assert_array_equal(found, given[0] - 0.5 * given)
    assert moved.damped == joints.damped


def test_motions_are_linked_where_any_of_the_three_is_not_zero_and_an_array_is_a_joint_without_damping():
    k, c, h = np.zeros((3, 2, 3, 3))
    k[0, 0, 0], c[1, 1, 2], h[0, 2, 1] = 1.0, 1.0, 1.0
    assert np.argwhere(JointMatrix(k, c, h).linked).tolist() == [[0, 0], [1, 2], [2, 1]]
    assert joint_matrix_of(K.tolist()).stiffness.shape == (5, 4, 4)
    joints = JointMatrix(K)
    assert joint_matrix_of(joints) is joints
