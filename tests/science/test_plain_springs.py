"""A spring that a hypothesis does not name is rigid: as good as its DOF held fixed, in every forward model."""

import numpy as np
import pytest

from jointbayes.frf import AssembledModes, LowRankCoupling, NaturalFrequencies, Ports
from jointbayes.frf.synthetic import DirectSolve
from jointbayes.joint import Joint, PlainSprings
from jointbayes.structure import LossFactor, ModalDamping
from tests.conftest import CLAMP, pair_matrix, rod
from tests.oracles import differences, off_peak

SOFT_TO_STIFF = np.logspace(2, 11, 7)
PORTS = Ports(np.linspace(20.0, 2500.0, 300), ("11:y", "6:rz"), ("11:y", "9:y"))
LAWS = {"modal": (ModalDamping((0.01,)), AssembledModes), "loss factor": (LossFactor(0.02), LowRankCoupling)}
#: Springs that are named, DOFs that are then held, and the joint of the DOF that yields.
HYPOTHESES = {
    "translation": (("k11",), ["1:rz"], Joint(("1:y",))),
    "rotation": (("k22",), ["1:y"], Joint(("1:rz",))),
    "rigid": ((), CLAMP.dofs, Joint(("5:y",))),  # the reference has a joint that does nothing
}


def joints(names):
    """Joint matrices, two DOFs, of the hypothesis, and one DOF of its only spring, if it has one."""
    pair = pair_matrix(PlainSprings(names).values(np.log(SOFT_TO_STIFF)[:, None][:, : len(names)]))
    return pair, SOFT_TO_STIFF[:, None, None] * len(names)


@pytest.mark.parametrize("hypothesis", HYPOTHESES)
def test_natural_frequencies_are_those_of_the_structure_with_the_other_dofs_fixed(hypothesis):
    names, held, yielding = HYPOTHESES[hypothesis]
    pair, single = joints(names)
    expected = NaturalFrequencies(rod().fixed(held), yielding, 5).frequency_hz(single)
    np.testing.assert_allclose(NaturalFrequencies(rod(), CLAMP, 5).frequency_hz(pair), expected, rtol=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("hypothesis", HYPOTHESES)
def test_frfs_are_those_of_the_structure_with_the_other_dofs_fixed(law, hypothesis):
    (damping, model), (names, held, yielding) = LAWS[law], HYPOTHESES[hypothesis]
    pair, single = joints(names)
    reference = model if names else DirectSolve
    expected = reference(rod(damping=damping).fixed(held), yielding, PORTS).receptance(single)
    assert off_peak(model(rod(damping=damping), CLAMP, PORTS).receptance(pair), expected, axis=1) < 1e-9


@pytest.mark.parametrize("law", LAWS)
def test_the_misfit_and_its_gradient_stay_finite_beside_a_rigid_spring(law):
    damping, model = LAWS[law]
    pair, _ = joints(("k22",))
    whole = model(rod(damping=damping), CLAMP, PORTS)
    measured = whole.receptance(pair_matrix([5.05e9, 3.44e7, 1.52e6]))[0]
    misfit = whole.misfit(measured, np.full(measured.shape, 1e6))
    chi2, slope = misfit.chi2_gradient(pair)
    direct = (np.abs(whole.receptance(pair) - measured) ** 2 * 1e12).sum(axis=(1, 2, 3))
    np.testing.assert_allclose(chi2, direct, rtol=1e-6)
    # of each joint at once, along ln k22
    difference = differences(
        lambda at: misfit.chi2(pair_matrix(PlainSprings(("k22",)).values(at))), np.log(SOFT_TO_STIFF)[:, None], 1e-4
    )[0]
    found = slope[:, 1, 1] * SOFT_TO_STIFF
    np.testing.assert_allclose(found, difference, rtol=1e-4, atol=1e-6 * np.abs(difference).max())
