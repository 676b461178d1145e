"""Wrong models: the answer by modes holds the true joint, or the light of the model says that something is wrong.

One data set each; benchmarks/wrong_model.py has the long study, docs/wrong-model.md what it found.
"""

import pytest
from benchmarks.wrong_model import BEAMS, WRONGS, analyse

from tests.conftest import first_in_ci

pytestmark = pytest.mark.science
_KINDS = [("nothing", "stocky"), ("length 5 % off", "slender")]
_KINDS += [pair for pair in ((wrong, beam) for wrong in WRONGS for beam in BEAMS) if pair not in _KINDS]


@pytest.mark.parametrize(("wrong", "beam"), first_in_ci(_KINDS, 1))
def test_nothing_is_identified_where_the_truth_is_far_outside_and_the_light_of_a_right_model_is_green(wrong, beam):
    outcome = analyse(wrong, beam, 1)
    assert outcome.outside == outcome.identified == ()
    if wrong == "nothing":
        assert outcome.held == ("ky", "krz")
        assert outcome.grade in ("usual", "negligible")
    if wrong == "length 5 % off" and beam == "slender":
        assert outcome.grade in ("large", "impossible")
