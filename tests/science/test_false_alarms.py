"""Exact data are found to be explained: a sample of `benchmarks.false_alarms`."""

from dataclasses import replace

import pytest
from benchmarks.false_alarms import KINDS, analyse, table, text_of

from tests.conftest import TO_CONVERGE


@pytest.mark.science
@pytest.mark.parametrize("kind", [pytest.param(k, marks=[pytest.mark.long] * (k == "uncertain")) for k in KINDS])
def test_exact_data_are_explained(kind):
    outcome = analyse(kind, 1, replace(TO_CONVERGE, walkers=24))
    assert outcome.finding == "explained"
    assert f"| {kind} | 1 | 0 |" in table([outcome])


@pytest.mark.docs
@pytest.mark.parametrize("kind", KINDS)
def test_each_data_set_has_noise_of_its_own(kind):
    assert text_of(kind, 1) == text_of(kind, 1) != text_of(kind, 2)
