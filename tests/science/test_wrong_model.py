"""A wrong model: its FRFs are sure of a wrong joint, the answer by their modes holds the true one.

One data set each; benchmarks/wrong_model.py has the long study, docs/wrong-model.md what it found.
"""

import pytest
from benchmarks.wrong_model import WRONGS, analyse

#: .ci/run has the same of a small case, in tests/posterior/test_decision.py.
pytestmark = [pytest.mark.science, pytest.mark.long]


@pytest.mark.parametrize("wrong", WRONGS)
def test_nothing_is_identified_where_the_truth_is_far_outside(wrong):
    outcome = analyse(wrong, 1)
    assert outcome.taken_as == "modes"
    assert outcome.false == ()
    assert len(outcome.frfs) < len(outcome.modes)
