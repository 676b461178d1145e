"""A spring that a hypothesis does not name is rigid: as good as its DOF held fixed, in every forward model."""

import numpy as np
import pytest

from jointbayes.frf import AssembledModes, LowRankCoupling, NaturalFrequencies, Ports
from jointbayes.frf.synthetic import DirectSolve
from jointbayes.joint import Joint, PlainSprings
from jointbayes.structure import LossFactor, ModalDamping
from tests.conftest import CLAMP, pair_matrix, rod

SPRINGS = {"translation": ("k11",), "rotation": ("k22",)}
HELD = {"translation": "1:rz", "rotation": "1:y"}
YIELDING = {"translation": Joint(("1:y",)), "rotation": Joint(("1:rz",))}
SOFT_TO_STIFF = np.logspace(2, 11, 7)
PORTS = Ports(np.linspace(20.0, 2500.0, 300), ("11:y", "6:rz"), ("11:y", "9:y"))
LAWS = {"modal": (ModalDamping((0.01,)), AssembledModes), "loss factor": (LossFactor(0.02), LowRankCoupling)}


def joints(hypothesis):
    """Joint matrices, two DOFs, of the hypothesis, and one DOF of its only spring."""
    theta = np.log(SOFT_TO_STIFF)[:, None]
    return pair_matrix(PlainSprings(SPRINGS[hypothesis]).values(theta)), SOFT_TO_STIFF[:, None, None]


@pytest.mark.parametrize("hypothesis", SPRINGS)
def test_natural_frequencies_are_those_of_the_structure_with_the_other_dof_fixed(hypothesis):
    pair, single = joints(hypothesis)
    held = rod().fixed([HELD[hypothesis]])
    expected = NaturalFrequencies(held, YIELDING[hypothesis], 5).frequency_hz(single)
    np.testing.assert_allclose(NaturalFrequencies(rod(), CLAMP, 5).frequency_hz(pair), expected, rtol=1e-9)


def test_a_joint_without_springs_has_the_natural_frequencies_of_the_clamped_structure():
    rigid = pair_matrix(PlainSprings(()).values(np.empty((1, 0))))
    expected = rod().fixed(CLAMP.dofs).modes().frequency_hz[:5]
    np.testing.assert_allclose(NaturalFrequencies(rod(), CLAMP, 5).frequency_hz(rigid)[0], expected, rtol=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("hypothesis", SPRINGS)
def test_frfs_are_those_of_the_structure_with_the_other_dof_fixed(law, hypothesis):
    damping, model = LAWS[law]
    pair, single = joints(hypothesis)
    held = rod(damping=damping).fixed([HELD[hypothesis]])
    expected = model(held, YIELDING[hypothesis], PORTS).receptance(single)
    found = model(rod(damping=damping), CLAMP, PORTS).receptance(pair)
    peak = np.abs(expected).max(axis=1, keepdims=True)
    assert (np.abs(found - expected) / peak).max() < 1e-9


@pytest.mark.parametrize("law", LAWS)
def test_frfs_of_a_joint_without_springs_are_those_of_the_clamped_structure(law):
    damping, model = LAWS[law]
    rigid = pair_matrix(PlainSprings(()).values(np.empty((1, 0))))
    # the reference has a joint somewhere, too: one that does nothing
    clamped = rod(damping=damping).fixed(CLAMP.dofs)
    expected = DirectSolve(clamped, Joint(("5:y",)), PORTS).receptance(np.zeros((1, 1, 1)))
    found = model(rod(damping=damping), CLAMP, PORTS).receptance(rigid)
    peak = np.abs(expected).max(axis=1, keepdims=True)
    assert (np.abs(found - expected) / peak).max() < 1e-9


@pytest.mark.parametrize("law", LAWS)
def test_the_misfit_and_its_gradient_stay_finite_beside_a_rigid_spring(law):
    damping, model = LAWS[law]
    pair, _ = joints("rotation")
    whole = model(rod(damping=damping), CLAMP, PORTS)
    measured = whole.receptance(pair_matrix([5.05e9, 3.44e7, 1.52e6]))[0]
    misfit = whole.misfit(measured, np.full(measured.shape, 1e6))
    chi2, slope = misfit.chi2_gradient(pair)
    direct = (np.abs(whole.receptance(pair) - measured) ** 2 * 1e12).sum(axis=(1, 2, 3))
    np.testing.assert_allclose(chi2, direct, rtol=1e-6)
    step = 1e-4
    up, down = (
        misfit.chi2(pair_matrix(PlainSprings(("k22",)).values(np.log(SOFT_TO_STIFF)[:, None] + h)))
        for h in (step, -step)
    )
    difference = (up - down) / (2 * step)
    np.testing.assert_allclose(
        slope[:, 1, 1] * SOFT_TO_STIFF, difference, rtol=1e-4, atol=1e-6 * np.abs(difference).max()
    )
