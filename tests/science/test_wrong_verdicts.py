"""No unconditional verdict on a wrong model: a sample of `benchmarks.wrong_verdicts`."""

from itertools import product

import pytest
from benchmarks.wrong_verdicts import BANDS, NOISES, WRONGS, analyse, table

from tests.conftest import TO_CONVERGE, first_in_ci

LOW, _ = BANDS


@pytest.mark.science
def test_what_the_check_cannot_see_the_freed_inputs_do():
    outcome, posterior = analyse(WRONGS[0], 0.10, LOW, 1, TO_CONVERGE)
    assert outcome.explains
    assert "ky" in outcome.missed
    assert posterior.verdict("ky").verdict == "identified"
    condition = "identified only if Young's modulus, density, length and damping ratio are exact"
    assert outcome.verdicts == {"ky": condition, "krz": condition}
    assert outcome.false == ()
    assert "| length 1 % off | 10 % | to 500 Hz | 1 | 1 | 1 | 0 |" in table([outcome])


@pytest.mark.science
@pytest.mark.parametrize(("band", "noise", "wrong"), first_in_ci(list(product(BANDS, NOISES, WRONGS)), 1))
def test_nothing_is_identified_without_condition_that_is_not(wrong, noise, band):
    outcome, _ = analyse(wrong, noise, band, 2, TO_CONVERGE)
    assert outcome.false == ()
