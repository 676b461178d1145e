"""Direct, modal and coupled FRFs are one function; its derivative is exact; reciprocity and passivity hold."""

import numpy as np
import pytest

from jointbayes.frf import AssembledModes, DirectSolve, NaturalFrequencies, Ports, receptance_model
from jointbayes.joint import Joint
from jointbayes.structure import LossFactor, ModalDamping, Rayleigh
from tests.conftest import CLAMP, PAIR, TABLE_3, pair_matrix, rod
from tests.oracles import differences, off_peak

LAWS = [ModalDamping((0.01,)), ModalDamping((0.02, 0.005, 0.01)), LossFactor(0.02), Rayleigh(3.0, 1e-6)]
LINES = np.arange(20.0, 2501.0, 5.0)
ALL = ("11:y", "6:y", "11:rz", "1:y", "1:rz")
SOFT = np.array([1e7, 1e4, 1e3])
STIFF = np.array([1e11, 1e8, 1e8])
STEPS = (1e-4, 2e-4)


EVERY = pytest.mark.parametrize("law", LAWS, ids=str)


def both(structure, joint, ports, stiffness):
    """Receptances by the model of the structure's damping, and by the direct solve."""
    return (model(structure, joint, ports).receptance(stiffness)[0] for model in (receptance_model, DirectSolve))


@pytest.mark.parametrize("law", LAWS[:2], ids=str)
@pytest.mark.parametrize("band", [(5.0, 25.0), (20.0, 60e3)], ids=["below every mode", "up to high modes"])
def test_the_modal_sum_is_exact_whether_modes_are_near_the_band_or_far_above(law, band):
    ports = Ports(np.linspace(*band, 200), ALL, ALL)
    assert off_peak(*both(rod(damping=law), CLAMP, ports, pair_matrix(TABLE_3))) < 1e-9


@EVERY
@pytest.mark.parametrize("stiffness", [STIFF * 1e4, np.zeros(3)], ids=["nearly rigid", "absent"])
def test_a_rigid_and_an_absent_joint_are_no_special_cases_at_the_tip(law, stiffness):
    free, ports = rod(damping=law), Ports(LINES, ALL[:3], ALL[:3])
    fast, reference = both(free, CLAMP, ports, pair_matrix(stiffness))
    if stiffness.any():
        clamped, nowhere = free.fixed(CLAMP.dofs), Joint(("6:y", "6:rz"))
        reference = DirectSolve(clamped, nowhere, ports).receptance(np.zeros((2, 2)))[0]
    assert off_peak(fast, reference) < (2e-4 if stiffness.any() else 1e-9)  # what is left of the joint's compliance


@EVERY
def test_reciprocity_to_1e_12_and_a_drive_point_only_takes_power(law):
    h = receptance_model(rod(damping=law), CLAMP, Ports(LINES, ALL, ALL)).receptance(pair_matrix(TABLE_3))[0]
    assert off_peak(h.swapaxes(1, 2), h) < 1e-12
    drive = np.diagonal(h, axis1=1, axis2=2)
    assert (drive.imag < 1e-12 * np.abs(drive)).all()


@EVERY
def test_a_joint_between_two_dof_sets(law):
    held, inner = rod(damping=law).fixed(CLAMP.dofs), Joint(("3:y", "3:rz"), against=("8:y", "8:rz"))
    ports = Ports(LINES, ("11:y", "8:y"), ("11:y", "3:y"))
    assert off_peak(*both(held, inner, ports, pair_matrix([1e6, 1e4, 1e3]))) < 1e-9


@EVERY
@pytest.mark.parametrize("stiffness", [TABLE_3, SOFT], ids=["Table 3", "soft"])
def test_the_tangent_is_the_derivative(law, stiffness):
    model = receptance_model(rod(damping=law), CLAMP, Ports(LINES, ALL[:3], ALL[:2]))
    value, tangent = model.tangent(pair_matrix(stiffness), PAIR.pattern)
    np.testing.assert_allclose(value, model.receptance(pair_matrix(stiffness))[0], atol=1e-9 * np.abs(value).max())
    # over stiffnesses relative to their own: steps of 1e-4 and twice that
    near, far = (differences(lambda x: model.receptance(pair_matrix(x * stiffness))[0], np.ones(3), h) for h in STEPS)
    for slope, by_hand, k in zip(tangent, (4 * near - far) / 3, stiffness, strict=True):
        assert np.abs(by_hand / k - slope).max() < 1e-5 * np.abs(slope).max()


def test_the_tangent_survives_equal_frequencies_in_two_planes():
    # held at node 4, the planes y and z are alike as long as the joint at node 1 is absent
    space = rod(dofs_per_node=5).fixed([f"4:{d}" for d in ("x", "y", "z", "ry", "rz")])
    plane = rod().fixed(["4:y", "4:rz"])
    model = AssembledModes(space, CLAMP, Ports(LINES, ("2:y", "2:z"), ("1:y",)))
    flat = AssembledModes(plane, CLAMP, Ports(LINES, ("2:y",), ("1:y",)))
    _, tangent = model.tangent(np.zeros((2, 2)), PAIR.pattern)
    _, expected = flat.tangent(np.zeros((2, 2)), PAIR.pattern)
    scale = np.abs(expected).max(axis=(1, 2, 3), keepdims=True)
    np.testing.assert_allclose(tangent[:, :, :1] / scale, expected / scale, atol=1e-6)
    np.testing.assert_allclose(tangent[:, :, 1:] / scale, 0.0, atol=1e-6)


def test_the_tangent_of_natural_frequencies_is_their_derivative():
    model = NaturalFrequencies(rod(), CLAMP, 4)
    value, tangent = model.tangent(pair_matrix(TABLE_3), PAIR.pattern)
    by_hand = differences(lambda x: model.frequency_hz(pair_matrix(x * TABLE_3))[0], np.ones(3), 1e-4)
    for slope, difference, k in zip(tangent, by_hand, TABLE_3, strict=True):
        np.testing.assert_allclose(difference / k, slope, rtol=1e-5, atol=1e-9 * np.abs(slope).max())
    assert value.shape == (4,)
