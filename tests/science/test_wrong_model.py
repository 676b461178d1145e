"""Wrong models: the answer by modes holds the true joint, or the light of the model or a condition says what is wrong.

One data set each of `benchmarks.wrong_model`, `wrong_verdicts` and, for right models, `false_alarms`; the long studies
are these, docs/wrong-model.md what they found.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from benchmarks import false_alarms, wrong_model, wrong_verdicts

import jointbayes as jb
from tests.conftest import CONFIGS, TO_CONVERGE, first_in_ci
from vibrecords import FrfData

science = pytest.mark.science
_KINDS = [("nothing", "stocky"), ("length 5 % off", "slender")]
_KINDS += [pair for pair in product(wrong_model.WRONGS, wrong_model.BEAMS) if pair not in _KINDS]
_LOW, _ = wrong_verdicts.BANDS
_VERDICTS = list(product(wrong_verdicts.BANDS, wrong_verdicts.NOISES, wrong_verdicts.WRONGS))


@science
@pytest.mark.parametrize(("wrong", "beam"), first_in_ci(_KINDS, 1))
def test_nothing_is_identified_where_the_truth_is_far_outside_and_the_light_of_a_right_model_is_green(wrong, beam):
    outcome = wrong_model.analyse(wrong, beam, 1)
    assert outcome.outside == outcome.identified == ()
    if wrong == "nothing":
        assert outcome.held == ("ky", "krz")
        assert outcome.grade in ("usual", "negligible")
    if wrong == "length 5 % off" and beam == "slender":
        assert outcome.grade in ("large", "impossible")


@science
def test_what_the_check_cannot_see_the_freed_inputs_do():
    outcome, posterior = wrong_verdicts.analyse(wrong_verdicts.WRONGS[0], 0.10, _LOW, 1, TO_CONVERGE)
    assert outcome.explains
    assert "ky" in outcome.missed
    assert posterior.verdict("ky").verdict == "identified"
    condition = "identified only if Young's modulus, density, length and damping ratio are exact"
    assert outcome.verdicts == {"ky": condition, "krz": condition}
    assert outcome.false == ()
    assert "| length 1 % off | 10 % | to 500 Hz | 1 | 1 | 1 | 0 |" in wrong_verdicts.table([outcome])


@science
@pytest.mark.parametrize(("band", "noise", "wrong"), first_in_ci(_VERDICTS, 1))
def test_nothing_is_identified_without_condition_that_is_not(wrong, noise, band):
    outcome, _ = wrong_verdicts.analyse(wrong, noise, band, 2, TO_CONVERGE)
    assert outcome.false == ()


@science
@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=[pytest.mark.long] * (k == "uncertain")) for k in false_alarms.KINDS]
)
def test_exact_data_are_explained(kind):
    outcome = false_alarms.analyse(kind, 1, replace(TO_CONVERGE, walkers=24))
    assert outcome.finding == "explained"
    assert f"| {kind} | 1 | 0 |" in false_alarms.table([outcome])


def measured_of(kind, seed):
    """All that is measured of a data set, of all its tests."""
    case = jb.case_from_text(kind, false_alarms.text_of(kind, seed), directory=CONFIGS)
    data = [test.data for test in false_alarms.problem_of(kind, seed, case).tests]
    return np.concatenate([(one.frf if isinstance(one, FrfData) else one).values.ravel() for one in data])


@pytest.mark.docs
@pytest.mark.parametrize("kind", false_alarms.KINDS)
def test_each_data_set_has_noise_of_its_own(kind):
    first, again, other = (measured_of(kind, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()
