"""A wrong model is found out; errors of natural frequencies beside a discrepancy make its prediction hold.

One data set each; benchmarks/wrong_model.py has the long study, docs/wrong-model.md what it found.
"""

import pytest
from benchmarks import wrong_model
from benchmarks.wrong_model import MODELS, WRONGS, analyse

import jointbayes as jb
from tests.conftest import first_in_ci

pytestmark = pytest.mark.science
NOTHING, _, FREQUENCIES = MODELS


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(wrong_model, "SETTINGS", jb.SamplerSettings(walkers=48, max_steps=200))


@pytest.mark.parametrize("wrong", first_in_ci(WRONGS, 1))
def test_without_anything_admitted_the_check_says_that_the_model_does_not_explain(wrong):
    found = analyse(wrong, NOTHING, 0)
    assert not found.explains
    assert not found.structure


@pytest.mark.long
def test_with_errors_of_frequencies_the_prediction_holds_what_is_measured():
    found = analyse(WRONGS[0], FREQUENCIES, 0)
    assert found.explains
    assert found.structure
