"""Structures of given matrices, and chains of masses and springs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg

import jointbayes as jb
from jointbayes.frf import NaturalFrequencies, receptance_model
from jointbayes.structure import ViscousMatrix

LAW = jb.ModalDamping((0.01,))
PORTS = jb.Ports(np.linspace(3.0, 80.0, 7), ("1:x", "2:x"), ("2:x",))


def test_a_chain_has_the_matrices_of_the_book():
    recipe = jb.chain([1.0, 2.0, 3.0], [("ground", "1", 5.0), ("1", "2", 7.0), ("2", "3", 11.0)], LAW)
    assert_allclose(recipe.stiffness, [[12, -7, 0], [-7, 18, -11], [0, -11, 11]])
    assert_allclose(recipe.mass, np.diag([1.0, 2, 3]))
    assert recipe.dofs == ("1:x", "2:x", "3:x")
    named = jb.chain({"head": 2.0, "foot": 1.0}, [("head", "foot", 4.0)], LAW, direction="y")
    assert named.dofs == ("head:y", "foot:y")


def test_masses_that_joints_alone_hold_have_the_frequencies_of_the_chain():
    free = jb.MatrixFamily(jb.chain([1.0, 2.0], [], LAW), {})
    for dofs, against, expected in [(("1:x",), (), [np.sqrt(1e5 / 1.0)]), (("1:x",), ("2:x",), [np.sqrt(1e5 * 1.5)])]:
        found = NaturalFrequencies(free, jb.Joint(dofs, against), 1).frequency_hz(np.array([[1e5]]))[0]
        assert_allclose(found, np.array(expected) / (2 * np.pi), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("size", [2, 60])
def test_dampers_give_the_receptance_of_the_dynamic_stiffness(size):
    names = [str(i + 1) for i in range(size)]
    links = list(zip(["ground", *names], names, strict=False))
    springs = [(a, b, 1e5 + 1e3 * i) for i, (a, b) in enumerate(links)]
    dampers = [(a, b, 20.0 + i) for i, (a, b) in enumerate(links)]
    recipe = jb.chain(np.linspace(1, 2, size), springs, dampers=dampers)
    joint, k = jb.Joint(("2:x",)), np.array([[4e4]])
    found = receptance_model(jb.MatrixFamily(recipe, {}), joint, PORTS).receptance(k)[0]
    structure = recipe.structure()
    for f, one in zip(PORTS.frequency_hz, found, strict=True):
        w = 2 * np.pi * f
        z = structure.stiffness - w**2 * structure.mass + 1j * w * recipe.damping.matrix
        z[1, 1] += 4e4
        assert_allclose(one[:, 0], np.linalg.inv(z)[:2, 1], rtol=1e-9)


def test_supports_take_rows_of_all_matrices_away():
    recipe = jb.chain([1.0, 2.0], [("1", "2", 1e5)], dampers=[("1", "2", 3.0)])
    held = jb.MatrixRecipe(recipe.stiffness, recipe.mass, recipe.dofs, recipe.damping, supports=("1:x",)).structure()
    assert_allclose(held.damping.matrix, [[3.0]])
    assert_allclose(held.modes().eigenvalues, [5e4])


def test_uncertain_damping_follows_its_factor():
    k, m = np.array([[2e5, -1e5], [-1e5, 1e5]]), np.diag([1.0, 2.0])
    family = jb.MatrixFamily(jb.MatrixRecipe(k, m, ("1:x", "2:x"), LAW), {"damping_ratio": (-1, 1)})
    found = receptance_model(family, jb.Joint(("1:x",)), PORTS).receptance(np.zeros((1, 1)), np.array([[2.0]]))[0]
    square, shapes = linalg.eigh(k, m)
    omega = np.sqrt(square)
    w = 2 * np.pi * PORTS.frequency_hz[:, None]
    terms = shapes[None, :] * shapes[1] / (omega**2 - w**2 + 2j * 0.02 * omega * w)[:, None]
    assert_allclose(found[:, :, 0], terms.sum(axis=-1), rtol=1e-9)


def of_two(**loaded) -> jb.MatrixRecipe:
    return jb.MatrixRecipe(np.eye(2), np.eye(2), ("1:x", "2:x"), LAW, **loaded)


def test_fewer_springs_than_rounding_do_not_make_a_damping_matrix_negative():
    form = np.array([1.0, -1.0, 0.0])
    assert ViscousMatrix(3e7 * np.outer(form, form)).matrix.shape == (3, 3)


@pytest.mark.parametrize(("tiny", "spring"), [(1e-6, 1e9), (1e-7, 1e10), (1e-9, 1e12)])
def test_a_soft_support_beside_a_stiff_small_part_is_no_rigid_body_motion(tiny, spring):
    masses, link = {"big": 1000.0, "tiny": tiny}, ("big", "tiny", spring)
    held = jb.chain(masses, [("ground", "big", 4e4), link], LAW).structure().modes().frequency_hz
    assert_allclose(held, np.sqrt([4e4 / (1000 + tiny), spring / tiny]) / (2 * np.pi), rtol=1e-6)
    free = jb.chain(masses, [link], LAW).structure().modes().frequency_hz
    assert free[0] == 0.0
    assert_allclose(free[1], np.sqrt(spring * (1 / tiny + 1 / 1000)) / (2 * np.pi), rtol=1e-6)
