"""How accurately a stiffness is known, as the headline of page one says it."""

import math

import pytest

from jointbayes.posterior.identifiability import Identifiability
from jointbayes.report.sections.lead import _accuracy


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (1.0, 1.21, "±10 %"),  # 10 % either way of their geometric middle
        (2e6, 2e6 * 1.02**2, "±2 %"),
        (1.0, 1.5, "±22 %"),
        (1.0, 1.51, "its interval spans a factor of 1.51"),
        (-4.0, -1.0, "its interval spans a factor of 4"),
    ],
)
def test_up_to_a_factor_of_one_and_a_half_it_is_half_the_interval_in_per_cent(low, high, said):
    known = Identifiability((low, high), max(high / low, low / high), 0.1, 0.99, "identified", "", math.nan)
    assert _accuracy(known) == said
