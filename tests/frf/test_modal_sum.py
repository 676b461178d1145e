"""The modal sum of many pairs, each mode divided by once for all of them, is that of each pair by itself."""

import numpy as np
import pytest

from jointbayes.frf import AssembledModes, Ports
from jointbayes.structure import ModalDamping
from tests.conftest import CLAMP, TABLE_3, pair_matrix, rod

OUTPUTS = ("11:y", "9:y", "6:y", "5:y", "3:y", "11:rz")


@pytest.mark.parametrize("top_hz", [25.0, 2500.0, 20e3], ids=["no mode", "a few", "many"])
def test_many_pairs_and_draws_give_what_each_pair_gives_by_itself(top_hz):
    free, lines = rod(damping=ModalDamping((0.01,))), np.linspace(5.0, top_hz, 333)
    rng = np.random.default_rng(1)
    matrices = pair_matrix(TABLE_3 * rng.uniform(0.7, 1.3, (70, 1)))  # more draws than are summed at once
    together = AssembledModes(free, CLAMP, Ports(lines, OUTPUTS, ("11:y",)))
    h = together.receptance(matrices)
    measured = h[0] * (1 + 0.1 * rng.standard_normal(h[0].shape))
    weight = rng.uniform(0.5, 1.5, h[0].shape) / np.abs(h[0])
    chi2 = 0.0
    for i, output in enumerate(OUTPUTS):
        alone = AssembledModes(free, CLAMP, Ports(lines, (output,), ("11:y",)))
        one = alone.receptance(matrices)
        np.testing.assert_allclose(h[:, :, i : i + 1], one, rtol=1e-9, atol=1e-12 * np.abs(one).max())
        chi2 = chi2 + alone.misfit(measured[:, i : i + 1], weight[:, i : i + 1]).chi2(matrices)
    np.testing.assert_allclose(together.misfit(measured, weight).chi2(matrices), chi2, rtol=1e-9)
