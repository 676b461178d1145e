"""What a plan foretells for a stated joint is what sampling then finds, as sharply as the plan says."""

import pytest
from benchmarks.planning import analyse, holds, sure


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_spread_found_is_the_one_foretold_for_an_accelerometer_at_the_joint(seed):
    """Random cases of the benchmark, but for the place of the accelerometer.

    Where the simulated spreads agree among themselves the one found lies within 15 % of their mean; where they do not,
    it lies among them. docs/planning.md has the figures of the cases with a random place.
    """
    row = analyse(seed, node=1)
    assert row.converged
    if sure(row.told_low, row.told_high):
        assert holds(row, "told")
    else:
        assert row.told_low / 1.15 <= row.found <= 1.15 * row.told_high
