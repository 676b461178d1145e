"""A wrong model: the FRFs are sure of a wrong joint, the modes hold the true one, and are the answer believed.

One data set each; benchmarks/wrong_model.py has the long study, docs/wrong-model.md what it found.
"""

import pytest
from benchmarks.wrong_model import WRONGS, analyse

from tests.conftest import first_in_ci

pytestmark = pytest.mark.science


@pytest.mark.parametrize("wrong", first_in_ci(WRONGS, 1))
def test_nothing_is_identified_where_the_truth_is_far_outside(wrong):
    outcome = analyse(wrong, 1)
    assert outcome.believed == "modes"
    assert outcome.false == ()
    assert len(outcome.frfs) < len(outcome.modes)
