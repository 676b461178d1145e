"""Joints with damping of their own, against the assembled structure solved line by line."""

import numpy as np
import pytest

from jointbayes.frf import DirectSolve, NaturalFrequencies, Ports, receptance_model
from jointbayes.joint import Damped, Joint, JointMatrix, Joints, LogStiffness, blocks_of, parametrisation_named
from jointbayes.structure import BeamFamily, BeamRecipe, LossFactor, ModalDamping, Rayleigh, Section
from tests.conftest import CLAMP, PAIR, STEEL, pair_matrix, rod
from tests.oracles import differences, off_peak

LAWS = {"modal": ModalDamping((0.01, 0.02)), "loss factor": LossFactor(0.02), "Rayleigh": Rayleigh(3.0, 1e-7)}
DAMPED = pytest.mark.parametrize("law", LAWS.values(), ids=list(LAWS))
PORTS = Ports(np.arange(20.0, 2000.0, 45.0), ("6:y", "1:y", "11:y"), ("11:y", "1:rz"))
KIND = Damped(LogStiffness(), ("k11", "k22"), ("all",))
K = np.array([5e7, 4e5, 6e4, 900.0, 3.0, 0.15])  # k11, k12, k22, c11, c22, eta
SPRINGS = Damped(parametrisation_named("springs", ("y", "rz")), ("krz",), ("ky", "krz"))
TWO = Joints((Joint(("1:y", "1:rz"), name="left"), Joint(("11:y", "11:rz"), name="right")))
BOTH = blocks_of({"left": KIND, "right": SPRINGS})
K_BOTH = np.concatenate([K, [2e7, 3e4, 1.5, 0.3, 0.05]])


def test_damping_stands_in_matrices_of_its_own_beside_the_stiffness():
    assert KIND.stiffness_names == ("k11", "k12", "k22", "c11", "c22", "eta")
    assert [q.unit for q in KIND.quantities] == ["N/m", "N", "N·m/rad", "N·s/m", "N·m·s/rad", "1"]
    assert SPRINGS.names == ("ky", "krz", "crz", "etay", "etarz")
    stiffness, viscous, hysteretic = KIND.matrix(K).sides
    np.testing.assert_array_equal(stiffness, pair_matrix(K[:3]))
    np.testing.assert_array_equal(viscous, np.diag(K[3:5]))
    np.testing.assert_allclose(hysteretic, 0.15 * stiffness)
    hysteretic = SPRINGS.matrix(K_BOTH[6:]).hysteretic
    np.testing.assert_allclose(hysteretic, np.diag([0.3 * 2e7, 0.05 * 3e4]))
    whole = BOTH.matrix(K_BOTH)
    assert whole.damped
    assert whole.size == 4
    np.testing.assert_array_equal(whole.block(slice(0, 2)).viscous, np.diag(K[3:5]))
    np.testing.assert_array_equal(whole.block(slice(2, 4)).hysteretic, hysteretic)
    np.testing.assert_array_equal(whole.viscous[2:, :2], 0.0)


@DAMPED
def test_receptances_with_damped_joints_are_those_of_the_assembled_structure(law):
    structure = rod(damping=law)
    for joint, matrix in ((TWO, BOTH.matrix(K_BOTH)), (CLAMP, KIND.matrix(K))):
        exact = DirectSolve(structure, joint, PORTS).receptance(matrix)[0]
        assert off_peak(receptance_model(structure, joint, PORTS).receptance(matrix)[0], exact) < 3e-8
    assert off_peak(DirectSolve(structure, CLAMP, PORTS).receptance(pair_matrix(K[:3]))[0], exact) > 1e-2


@DAMPED
def test_without_any_damping_the_joint_is_that_of_its_stiffness(law):
    model = receptance_model(rod(damping=law), CLAMP, PORTS)
    matrix = KIND.matrix([*K[:3], 0.0, 0.0, 0.0])
    plain = model.receptance(pair_matrix(K[:3]))
    np.testing.assert_allclose(model.receptance(matrix), plain, rtol=0, atol=1e-9 * np.abs(plain).max())
    frequencies = NaturalFrequencies(rod(), CLAMP, 4)
    of_stiffness = frequencies.frequency_hz(pair_matrix(K[:3]))
    np.testing.assert_array_equal(frequencies.frequency_hz(KIND.matrix(K)), of_stiffness)


@pytest.mark.parametrize("joint", [Joint(("1:y",)), CLAMP, TWO])
def test_what_changes_nothing_of_this_joint_has_no_slope(joint):
    # in a problem of two tests each test's joint has directions that move only the joint of the other test
    model, softer = receptance_model(rod(), joint, PORTS), -np.eye(joint.size)
    k = np.diag([5e7, 6e4, 3e6, 2e4])[: joint.size, : joint.size]
    _, slope = model.tangent(k, [0 * softer, softer])
    by_hand = (model.receptance(k + 10 * softer)[0] - model.receptance(k - 10 * softer)[0]) / 20
    np.testing.assert_array_equal(slope[0], 0.0)
    np.testing.assert_allclose(slope[1], by_hand, rtol=1e-6, atol=1e-6 * np.abs(by_hand).max())


MANY = Joints((*TWO.joints, Joint(("6:y",), name="middle")))
KINDS = {"left": KIND, "right": SPRINGS, "middle": parametrisation_named("springs", ("y",))}
K_MANY = np.array([*K_BOTH, 3e6])
INSIDE = Ports(np.arange(20.0, 2000.0, 15.0), ("3:y", "8:y"), ("9:y", "4:rz"))  # of more lines than a block holds
LOSS = LAWS["loss factor"]


@pytest.mark.parametrize(
    ("law", "joints", "kind", "k", "ports"),
    [*((law, TWO, BOTH, K_BOTH, PORTS) for law in LAWS.values()), (LOSS, MANY, blocks_of(KINDS), K_MANY, INSIDE)],
)
def test_slope_and_misfit_along_stiffness_and_damping_are_those_of_the_receptances(law, joints, kind, k, ports):
    model, theta = receptance_model(rod(damping=law), joints, ports), kind.coordinates(k)
    value, slope = model.tangent(kind.matrix(k), kind.changes(theta))
    np.testing.assert_allclose(value, model.receptance(kind.matrix(k))[0], rtol=1e-12)
    by_hand = differences(lambda at: model.receptance(kind.matrix(kind.values(at)))[0], theta)
    np.testing.assert_allclose(slope, by_hand, rtol=0, atol=1e-6 * min(np.abs(value).max(), np.abs(slope).max()))
    measured, weight = 1.1 * value, 1 / np.abs(value)
    several = kind.matrix(k * np.exp(np.random.default_rng(1).normal(0, 0.3, size=(3, k.size))))
    for viscous in (several.viscous, 0 * several.viscous):
        matrices = JointMatrix(several.stiffness, viscous, several.hysteretic)
        expected = (np.abs(model.receptance(matrices) - measured) ** 2 * weight**2).sum(axis=(1, 2, 3))
        np.testing.assert_allclose(model.misfit(measured, weight).chi2(matrices), expected, rtol=1e-8)


def test_an_uncertain_structure_has_damped_joints_as_well():
    recipe = BeamRecipe(0.383, Section.circle(0.025), STEEL, LossFactor(0.02))
    factors = np.array([[1.03, 0.8]])
    family = BeamFamily(recipe, {"youngs_modulus": (-0.1, 0.1), "loss_factor": (-0.5, 0.5)})
    found = receptance_model(family, CLAMP, PORTS).receptance(KIND.matrix(K)[None], factors)[0]
    built = family.at(PORTS.outputs, 2000.0).structure(factors[0])
    assert off_peak(found, DirectSolve(built, CLAMP, PORTS).receptance(KIND.matrix(K))[0]) < 1e-6


def test_a_joint_between_bodies_dissipates_by_relative_motion_alone():
    """Both ends of a free rod moved alike: the dashpot between two of its points does nothing in rigid motion."""
    joint = Joint(("3:y",), ("9:y",))
    springs = Damped(parametrisation_named("springs", ("y",)), ("ky",))
    slow = Ports(np.array([0.5, 1.0]), ("6:y",), ("6:y",))
    model = receptance_model(rod(damping=LossFactor(0.0)), joint, slow)
    free = model.receptance(np.zeros((1, 1, 1)))[0]
    damped = model.receptance(springs.matrix([1e-9, 50.0])[None])[0]
    np.testing.assert_allclose(damped, free, rtol=1e-5)
    assert PAIR.damped is False


@pytest.mark.science
def test_the_squares_of_many_damped_joints_are_those_of_the_assembled_structure():
    structure, kinds = rod(damping=LOSS), blocks_of(KINDS)
    direct = DirectSolve(structure, MANY, INSIDE)
    data = direct.receptance(kinds.matrix(K_MANY))[0]
    weight = 1 / (0.03 * np.abs(data))
    other = K_MANY * np.exp(np.random.default_rng(1).normal(0, 0.3, size=(5, K_MANY.size)))
    other[3, [0, 1, 2]] = 5e7, 1.7320508e6, 6e4  # coupled to the last digit
    other[4, 6] = 1e-70  # a spring that is not there
    found = receptance_model(structure, MANY, INSIDE).misfit(data, weight).chi2(kinds.matrix(other))
    expected = [np.sum(np.abs(direct.receptance(kinds.matrix(k))[0] - data) ** 2 * weight**2) for k in other]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("stiff", [0, 1])
@pytest.mark.parametrize("size", [1e12, 1e59, 1e61, 1e100, 1e300])
def test_a_rigid_spring_leaves_the_other_one_as_it_is(stiff, size):
    """Without damping the low-rank coupling and the modal sum are one: the second takes any stiffness."""
    k = np.array([1.5e6, 6e4])
    k[stiff] = size
    of_pair, of_modes = (
        receptance_model(rod(damping=law), CLAMP, PORTS) for law in (LossFactor(0.0), ModalDamping((0.0,)))
    )
    exact = of_modes.receptance(np.diag(k))
    np.testing.assert_allclose(of_pair.receptance(np.diag(k)), exact, rtol=0, atol=1e-6 * np.abs(exact).max())
    change = np.diag([1.0, 1.0]) * (np.arange(2) != stiff)  # of the other spring
    h = np.diag(k) + 1e-6 * change @ np.diag(k)
    slope = (of_pair.receptance(h)[0] - of_pair.receptance(np.diag(k))[0]) / (1e-6 * k[1 - stiff])
    value, tangent = of_pair.tangent(np.diag(k), change[None])
    np.testing.assert_allclose(value, exact[0], rtol=0, atol=1e-6 * np.abs(exact).max())
    np.testing.assert_allclose(tangent[0], slope, rtol=0, atol=1e-4 * np.abs(slope).max())
