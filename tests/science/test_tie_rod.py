"""A tie rod: axial force against the rotation of its ends, the classic pair that two frequencies do not tell apart."""

import numpy as np
import pytest

from jointbayes.case.case import case_from_text
from jointbayes.workflow import sample
from tests.case.refusal_rows import parts_named

pytestmark = pytest.mark.science

#: Of a rod of 2 m and 20 mm under 20 kN, with 3 kN m/rad at both ends.
FREQUENCIES = [26.995446, 64.602597, 118.582897, 191.138862, 283.041241]
TIE = parts_named("rooms")["science/tie_rod tie"]


def verdicts(count):
    posterior = sample(case_from_text("tie.toml", TIE.replace("FREQUENCIES", str(FREQUENCIES[:count]))), seed=1)
    names = ("left.krz", "axial_force")
    for name, truth in zip(names, (3000.0, 20000.0), strict=True):
        low, high = posterior.interval(name, 0.95)
        assert low < truth < high
    krz, force = (np.log(posterior.draws[name].values.ravel()) for name in names)
    return [posterior.verdict(name).cls for name in names], float(np.corrcoef(krz, force)[0, 1])


def test_two_frequencies_do_not_tell_force_and_rotation_apart_and_five_do():
    few, together = verdicts(2)
    assert few[0] != "identified"
    assert together < -0.9
    assert verdicts(5)[0] == ["identified", "identified"]
