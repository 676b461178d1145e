"""From a virtual test through files of every format to one posterior; the long study is benchmarks/files.py."""

import pytest
from benchmarks.files import analyse, measured_text, table, truth_text
from benchmarks.written_files import FORMATS

pytestmark = pytest.mark.science


@pytest.fixture(scope="module")
def outcome():
    return analyse(0)


def test_every_format_leads_to_the_same_posterior_but_text_with_its_thirteen_digits(outcome):
    assert set(outcome.held) == set(FORMATS)
    assert outcome.posteriors == 2
    assert outcome.converged


def test_the_intervals_of_this_virtual_test_hold_the_truth(outcome):
    assert all(all(held) for held in outcome.held.values())


def test_the_table_counts_each_format(outcome):
    assert "| uff58b | 1 | 1 (100.0 %) | 1 (100.0 %) | 1 (100.0 %) |" in table([outcome])


def test_the_analysed_case_does_not_know_the_truth():
    text = measured_text(truth_text([1.0e9, 1.0e7, 1.0e6]), "npz")
    assert "truth" not in text.split("[data]")[1].split("[identification]")[0]
    assert 'file = "test.npz"' in text
