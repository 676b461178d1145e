"""The matrices of joints as one object."""

import numpy as np
import pytest

from jointbayes.joint import JointMatrix, joint_matrix_of

RNG = np.random.default_rng(1)
K, C, H = RNG.normal(size=(3, 5, 4, 4))
OMEGA = np.array([3.0, 70.0])


def test_the_dynamic_stiffness_is_k_plus_j_omega_c_plus_j_h():
    found = JointMatrix(K, C, H).dynamic_stiffness(OMEGA)
    expected = K[:, None] + 1j * (OMEGA[:, None, None] * C[:, None] + H[:, None])
    np.testing.assert_array_equal(found, expected)


def test_one_kind_of_damping_alone_leaves_the_other_at_zero():
    dashpots, lossy = JointMatrix(K, viscous=C), JointMatrix(K, hysteretic=H)
    assert dashpots.damped
    assert lossy.damped
    np.testing.assert_array_equal(dashpots.hysteretic, 0 * K)
    np.testing.assert_array_equal(lossy.viscous, 0 * K)
    assert not JointMatrix(K).damped
    np.testing.assert_array_equal(JointMatrix(K).sides, [K, 0 * K, 0 * K])


@pytest.mark.parametrize("sides", [(K,), (K, C, H)])
def test_what_is_done_to_a_batch_is_done_to_each_of_its_matrices(sides):
    joints = JointMatrix(*sides)
    assert (len(joints), joints.size, joints.damped) == (5, 4, len(sides) == 3)
    for found, given in zip(joints[1:3].block(slice(1, 3)).sides, sides, strict=False):
        np.testing.assert_array_equal(found, given[1:3, 1:3, 1:3])
    np.testing.assert_array_equal(joints[2].batch.stiffness, K[2:3])
    np.testing.assert_array_equal(joints[2].repeated(3).stiffness, K[[2, 2, 2]])
    moved = joints[0].moved(joints, -0.5)
    for found, given in zip(moved.sides, sides, strict=False):
        np.testing.assert_array_equal(found, given[0] - 0.5 * given)
    assert moved.damped == joints.damped


def test_the_damping_alone_has_no_stiffness():
    loss = JointMatrix(K, C, H).dissipative
    for found, expected in zip(loss.sides, (0 * K, C, H), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_motions_are_linked_where_any_of_the_three_is_not_zero():
    k, c, h = np.zeros((3, 2, 3, 3))
    k[0, 0, 0], c[1, 1, 2], h[0, 2, 1] = 1.0, 1.0, 1.0
    assert np.argwhere(JointMatrix(k, c, h).linked).tolist() == [[0, 0], [1, 2], [2, 1]]


def test_an_array_is_a_joint_without_damping():
    assert joint_matrix_of(K.tolist()).stiffness.shape == (5, 4, 4)
    joints = JointMatrix(K)
    assert joint_matrix_of(joints) is joints
