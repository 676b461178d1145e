"""The fit of the joint's compliance, which is linear in the compliance."""

import numpy as np
import pytest

from jointbayes.frf import DirectSolve, Ports
from jointbayes.identification import compliance_start
from jointbayes.structure import LossFactor
from tests.conftest import CLAMP, TABLE_3, pair_matrix, rod
from vibrecords import FrfData, FrfSet


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_exact_frfs_give_the_joint_that_made_them_with_the_sign_of_its_coupling(sign):
    joint = pair_matrix(TABLE_3 * [1e-2, sign * 1e-2, 1e-2])  # soft enough for each entry to count
    body, lines = rod(damping=LossFactor(0.02)), np.linspace(20.0, 2000.0, 100)
    ports = Ports(lines, ("11:y", "6:y"), ("11:y",))
    values = DirectSolve(body, CLAMP, ports).receptance(joint)[0]
    data = FrfData(FrfSet(lines, values, ports.outputs, ports.inputs), 1e-8 * np.abs(values) ** 2)
    np.testing.assert_allclose(compliance_start(body, CLAMP, data), joint, rtol=1e-5)
