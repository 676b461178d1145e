"""Frequencies, damping ratios and shapes of the assembled structure, against eigenproblems of the test's own."""

from fractions import Fraction

import numpy as np
import pytest
from scipy import linalg

import jointbayes as jb
from jointbayes.frf import AssembledShapes
from jointbayes.joint import JointMatrix, Joints
from jointbayes.structure import Rayleigh, ViscousMatrix
from tests.conftest import CLAMP, STEEL, rod

STIFF = np.array([[3e6, 2e4], [2e4, 4e3]])
DIRECTIONS = np.array([[[1e6, 0], [0, 0]], [[0, 1e4], [1e4, 0]], [[0, 0], [0, 1e3]]])
DOFS = ("1:y", "4:y", "8:rz", "11:y")
RECIPE = jb.BeamRecipe(0.383, jb.Section.circle(0.025), STEEL, jb.LossFactor(0.01))


def assembled(structure: jb.Structure, matrix: np.ndarray) -> np.ndarray:
    whole = structure.stiffness.copy()
    place = structure.index(CLAMP.dofs)
    whole[np.ix_(place, place)] += matrix
    return whole


def lowest(poles, count):
    poles = poles[np.abs(poles.imag) > 0]
    return poles[np.argsort(np.abs(poles))][:count]


def poles_of(stiffness, damping, mass, count):
    """Lowest poles above the real axis of K + sC + s²M."""
    zero, one = np.zeros_like(damping), np.eye(len(damping))
    first = np.block([[zero, one], [-stiffness, -damping]])
    poles = linalg.eigvals(first, linalg.block_diag(one, mass))
    return lowest(poles[poles.imag > 0], count)


def test_frequencies_and_shapes_are_those_of_the_assembled_matrices():
    structure = rod()
    model = AssembledShapes(structure, CLAMP, 4, DOFS)
    batch = np.array([STIFF, 1e4 * STIFF, 1e-3 * STIFF])
    modal = model.modes(batch)
    for i, matrix in enumerate(batch):
        # of M relative to K, in which the lowest modes are the largest values and lose nothing to rounding
        inverse, shapes = linalg.eigh(structure.mass, assembled(structure, matrix))
        inverse, shapes = inverse[::-1], (shapes / np.sqrt(np.abs(inverse)))[:, ::-1]
        np.testing.assert_allclose(modal.frequency_hz[i], 1 / np.sqrt(inverse[:4]) / (2 * np.pi), rtol=1e-7)
        seen = shapes[structure.index(DOFS), :4].T
        sign = np.sign((seen * modal.shapes[i]).sum(axis=1))
        scale = np.abs(seen).max(axis=1, keepdims=True)
        assert np.abs(modal.shapes[i] * sign[:, None] - seen).max() < 1e-6 * scale.max()
    np.testing.assert_array_equal(modal.damping_ratio, 0.01)


@pytest.mark.parametrize("law", [jb.LossFactor(2e-3), Rayleigh(3.0, 2e-6)])
def test_damping_ratios_are_those_of_the_complex_eigenvalues(law):
    structure = rod(damping=law)
    found = AssembledShapes(structure, CLAMP, 4, ()).modes(STIFF).damping_ratio[0]
    whole = assembled(structure, STIFF)
    if isinstance(law, jb.LossFactor):
        poles = lowest(1j * np.sqrt(linalg.eigvals(whole + 2e-3j * structure.stiffness, structure.mass)), 4)
    else:
        poles = poles_of(whole, 3.0 * structure.mass + 2e-6 * structure.stiffness, structure.mass, 4)
    np.testing.assert_allclose(found, np.abs(poles.real) / np.abs(poles), rtol=1e-4)


@pytest.mark.parametrize("law", [jb.ModalDamping((0.01, 0.02)), jb.LossFactor(0.01), Rayleigh(3.0, 2e-6)])
def test_the_derivative_is_that_of_differences(law):
    model = AssembledShapes(rod(damping=law), CLAMP, 4, DOFS)
    here, slope = model.tangent(STIFF, DIRECTIONS)
    step = 1e-4
    up, down = (model.modes(STIFF + sign * step * DIRECTIONS) for sign in (1, -1))
    for name in ("frequency_hz", "damping_ratio"):
        difference = (getattr(up, name) - getattr(down, name)) / (2 * step)
        np.testing.assert_allclose(getattr(slope, name), difference, rtol=2e-5, atol=1e-7 * np.abs(difference).max())
    signs = [np.sign((one.shapes * here.shapes).sum(axis=2, keepdims=True)) for one in (up, down)]
    difference = (up.shapes * signs[0] - down.shapes * signs[1]) / (2 * step)
    np.testing.assert_allclose(slope.shapes, difference, atol=2e-5 * np.abs(difference).max())


def test_damping_ratios_of_a_matrix_of_dampers_are_those_of_the_complex_eigenvalues():
    stiffness = np.array([[700.0, -700.0, 0.0], [-700.0, 1200.0, -500.0], [0.0, -500.0, 500.0]])
    dampers = np.array([[0.3, -0.1, 0.0], [-0.1, 0.15, -0.05], [0.0, -0.05, 0.05]])
    masses = np.diag([2.0, 1.0, 1.5])
    chain = jb.Structure(stiffness, masses, ViscousMatrix(dampers), ("1:x", "2:x", "3:x"))
    model = AssembledShapes(chain, jb.Joint(("1:x",)), 3, ("3:x",))
    poles = poles_of(stiffness + np.diag([900.0, 0.0, 0.0]), dampers, masses, 3)
    found = model.modes([[[900.0]]])
    np.testing.assert_allclose(found.damping_ratio[0], -poles.real / np.abs(poles), rtol=1e-4)
    assert found.shapes.shape == (1, 3, 1)
    _, slope = model.tangent([[900.0]], [[[1.0]]])
    up, down = model.modes([[[901.0]], [[899.0]]]).damping_ratio
    np.testing.assert_allclose(slope.damping_ratio[0], (up - down) / 2, rtol=1e-5)


LOSSES = np.array([[40.0, 0.2], [0.2, 0.05]])  # N s/m
IMAGINARY = np.array([[6e4, 200.0], [200.0, 90.0]])


def test_damping_of_the_joint_itself_is_that_of_the_complex_eigenvalues():
    structure = rod(damping=jb.LossFactor(0.0))
    found = AssembledShapes(structure, CLAMP, 3, ()).modes(JointMatrix(STIFF, LOSSES, IMAGINARY)).damping_ratio[0]
    place, whole = np.ix_(*[structure.index(CLAMP.dofs)] * 2), assembled(structure, STIFF)
    damping, imaginary = np.zeros((2, *whole.shape))
    damping[place], imaginary[place] = LOSSES, IMAGINARY
    both = ((whole, damping), (whole + 1j * imaginary, 0 * damping))
    poles = [poles_of(*matrices, structure.mass, 3) for matrices in both]
    expected = sum(np.abs(p.real) / np.abs(p) for p in poles)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_the_derivative_of_joints_with_damping_is_that_of_differences():
    model = AssembledShapes(rod(damping=jb.LossFactor(0.01)), CLAMP, 4, DOFS)
    zero = np.zeros((2, 2))
    matrix = JointMatrix(STIFF, LOSSES, IMAGINARY)
    directions = JointMatrix(*np.array([[STIFF, zero, STIFF], [zero, LOSSES, LOSSES], [IMAGINARY, zero, zero]]))
    _, slope = model.tangent(matrix, directions)
    sides = list(zip(matrix.sides, directions.sides, strict=True))
    up, down = (model.modes(JointMatrix(*(k + step * d for k, d in sides))) for step in (1e-4, -1e-4))
    difference = (up.damping_ratio - down.damping_ratio) / 2e-4
    np.testing.assert_allclose(slope.damping_ratio, difference, rtol=1e-5, atol=1e-8)


def test_a_family_and_its_factors_give_the_modes_of_the_changed_structure():
    family = jb.BeamFamily(RECIPE, {"youngs_modulus": (-0.2, 0.2), "loss_factor": (-1.0, 1.0)})
    factors = np.array([1.1, 2.0])
    found = AssembledShapes(family, CLAMP, 3, DOFS).modes(STIFF, factors)
    structure = family.structure(factors)
    own = AssembledShapes(structure, CLAMP, 3, DOFS).modes(STIFF)
    np.testing.assert_allclose(found.frequency_hz, own.frequency_hz, rtol=1e-6)
    np.testing.assert_allclose(found.damping_ratio, own.damping_ratio, rtol=1e-5)
    ratio, expected = (one.shapes[..., 3] / one.shapes[..., 1] for one in (found, own))
    np.testing.assert_allclose(ratio, expected, rtol=1e-5)


CHAIN = jb.Structure(np.array([[2.0, -1.0], [-1.0, 1.0]]), np.eye(2), jb.ModalDamping((0.0,)), ("1:x", "2:x"))


def modes_below(structure: jb.Structure, matrix: np.ndarray, held: str, frequency_hz: float) -> int:
    """How many natural frequencies lie below, in rational arithmetic: negative pivots of K + K_J − ω²M."""
    square = Fraction(float((2 * np.pi * frequency_hz) ** 2))
    kept = np.delete(np.arange(structure.n_dofs), structure.index([held])).tolist()
    stiffness = [[Fraction(float(structure.stiffness[i, j])) for j in kept] for i in kept]
    for i, first in enumerate(CLAMP.dofs):
        for j, second in enumerate(CLAMP.dofs):
            if held not in (first, second):
                row, column = (kept.index(int(structure.index([dof])[0])) for dof in (first, second))
                stiffness[row][column] += Fraction(float(matrix[i, j]))
    mass = [[Fraction(float(structure.mass[i, j])) for j in kept] for i in kept]
    rows = zip(stiffness, mass, strict=True)
    dynamic = [[k - square * m for k, m in zip(*row, strict=True)] for row in rows]
    negative = 0
    for p, pivot_row in enumerate(dynamic):
        negative += pivot_row[p] < 0
        for row in dynamic[p + 1 :]:
            factor = row[p] / pivot_row[p]
            if factor:
                row[p:] = [value - factor * above for value, above in zip(row[p:], pivot_row[p:], strict=True)]
    return negative


def antiresonances(body, joint, zeros, matrices, factors=None):
    return AssembledShapes(body, joint, 1, (), zeros).modes(matrices, factors).zeros_hz


@pytest.mark.parametrize("dof", ["7:y", "1:y"])
def test_antiresonances_are_exact_from_soft_joints_to_rigid_ones(dof):
    structure = rod(elements=6)
    scales = np.array([1e-4, 1.0, 1e2, 3e3, 1e4, 1e5, 1e8, 1e20])
    asked = [(dof, number) for number in (3, 1, 2)]
    predicted = antiresonances(structure, CLAMP, asked, scales[:, None, None] * STIFF)
    for scale, frequencies in zip(scales, predicted, strict=True):
        for frequency, number in zip(frequencies, (3, 1, 2), strict=True):
            ends = [modes_below(structure, scale * STIFF, dof, frequency * (1 + side * 1e-8)) for side in (-1, 1)]
            assert ends == [number - 1, number]


def test_antiresonances_of_several_points_come_in_the_order_in_which_they_are_asked_for():
    asked = (("11:y", 1), ("6:y", 1), ("8:y", 1), ("11:y", 2))
    together = antiresonances(rod(), CLAMP, asked, STIFF)[0]
    alone = [antiresonances(rod(), CLAMP, [zero], STIFF)[0, 0] for zero in asked]
    np.testing.assert_allclose(together, alone, rtol=1e-7)
    assert len(set(np.round(alone))) == len(asked)


def test_the_derivative_of_antiresonances_is_that_of_differences():
    zeros = [("11:y", 1), ("6:y", 2), ("11:y", 3)]
    up, down = (antiresonances(rod(), CLAMP, zeros, STIFF + step * DIRECTIONS) for step in (1e-4, -1e-4))
    _, slope = AssembledShapes(rod(), CLAMP, 2, DOFS, zeros).tangent(STIFF, DIRECTIONS)
    np.testing.assert_allclose(slope.zeros_hz, (up - down) / 2e-4, rtol=2e-5)


def test_antiresonances_of_uncertain_bodies_are_those_of_a_dense_solution_with_the_dof_held():
    family = jb.BeamFamily(RECIPE, {"youngs_modulus": (-0.2, 0.2), "length": (-0.03, 0.03)})
    rng = np.random.default_rng(5)
    factors, scales = np.exp(rng.uniform(-0.02, 0.02, (6, 2))), 10.0 ** rng.uniform(-3, 9, 6)
    zeros, matrices = [("11:y", 1), ("6:y", 2), ("11:y", 3)], scales[:, None, None] * STIFF
    model = AssembledShapes(family, CLAMP, 3, DOFS, zeros)
    found = model.modes(matrices, factors)
    plain = AssembledShapes(family, CLAMP, 3, DOFS).modes(matrices, factors)
    np.testing.assert_allclose(found.frequency_hz, plain.frequency_hz, rtol=1e-8)
    np.testing.assert_allclose(found.damping_ratio, plain.damping_ratio, rtol=1e-8)
    for row, matrix, own in zip(factors, matrices, found.zeros_hz, strict=True):
        np.testing.assert_allclose(model.modes(matrix, row).zeros_hz[0], own, rtol=1e-13)  # batched as one by one
        structure = model._body.structure(row)
        joined = structure.stiffness + CLAMP.selection(structure) @ matrix @ CLAMP.selection(structure).T
        for (dof, number), hz in zip(zeros, own, strict=True):
            kept = np.ix_(*[np.delete(np.arange(structure.n_dofs), structure.index([dof]))] * 2)
            # the inverse problem, whose lowest modes have all digits
            inverse = linalg.eigh(structure.mass[kept], joined[kept], eigvals_only=True)[::-1]
            assert hz == pytest.approx(inverse[number - 1] ** -0.5 / (2 * np.pi), rel=2e-8)


def test_a_free_structure_has_the_antiresonances_above_its_rigid_motions():
    # two masses on a spring: with one of them held the other one swings by itself
    free = jb.chain([2.0, 1.0], [("1", "2", 400.0)], jb.ModalDamping((0.0,))).structure()
    between = jb.Joint(("2:x",), ("1:x",))
    zeros_hz = antiresonances(free, between, [("1:x", 1), ("2:x", 1)], [[[500.0]]])
    np.testing.assert_allclose(2 * np.pi * zeros_hz[0], np.sqrt([900.0, 450.0]), rtol=1e-12)


def test_a_structure_that_is_joined_to_nothing_has_antiresonances():
    structure = rod(elements=6)
    alone = antiresonances(structure, Joints(()), [("7:y", 1)], np.zeros((1, 0, 0)))[0, 0]
    soft = antiresonances(structure, CLAMP, [("7:y", 2)], np.zeros((1, 2, 2)))[0, 0]
    assert alone == pytest.approx(soft, rel=1e-9)  # the first one of the soft joint is the swinging about the tip
