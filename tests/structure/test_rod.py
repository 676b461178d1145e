"""The rod that the tests of vibrecords bring along is the rod of jointbayes, computed another way."""

import numpy as np

from jointbayes.frf import DirectSolve, Ports
from jointbayes.structure import LossFactor
from tests.conftest import CLAMP, TABLE_3, pair_matrix, rod
from tests.vibrecords.rod import free_rod, receptance

LINES, DOFS = np.linspace(20.0, 2500.0, 50), ("11:y", "5:y", "1:rz")


def test_both_have_the_matrices_of_one_element():
    ours, (stiffness, mass) = rod(), free_rod()
    for matrix, theirs in ((ours.stiffness, stiffness), (ours.mass, mass)):
        np.testing.assert_allclose(matrix, theirs, rtol=1e-9, atol=1e-12 * np.abs(theirs).max())


def test_both_have_the_frfs_of_one_rod_with_either_damping():
    for law, options in ((None, {}), (LossFactor(0.02), {"loss_factor": 0.02})):
        model = DirectSolve(rod(damping=law), CLAMP, Ports(LINES, DOFS, DOFS[:2]))
        found = receptance(LINES, DOFS, DOFS[:2], **options)
        np.testing.assert_allclose(found, model.receptance(pair_matrix(TABLE_3))[0], rtol=1e-5)
