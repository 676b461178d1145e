"""What a plan forecasts is what measuring and sampling then find; its figures for random cases are in the docs."""

import numpy as np
import pytest
from benchmarks.planning import analyse, first_is_among_best_two, in_range, measured_together, random_case

from jointbayes.case_candidates import candidates_of


def test_the_real_measurement_of_a_random_case_is_made_at_its_truth():
    drawn = random_case(1)
    new = next(c for c in candidates_of(drawn.case) if c.kind == "accelerometer")
    averaged = next(c for c in candidates_of(drawn.case) if c.kind == "averages")
    for candidate in (new, averaged):
        problem = measured_together(drawn, candidate, np.random.default_rng(1)).problem
        lines = problem.measurement.frf.values.size
        chi2 = 2 * (problem.log_posterior.likelihood.constant - problem.log_posterior.log_likelihood(drawn.truth)[0])
        assert chi2 / (2 * lines) == pytest.approx(1.0, abs=0.12)  # χ² of real and imaginary parts
    assert measured_together(drawn, averaged, np.random.default_rng(1)).problem.measurement.variance.mean() == (
        pytest.approx(drawn.case.problem.measurement.variance.mean() / 4, rel=0.3)
    )


@pytest.mark.science
@pytest.mark.xfail(
    reason="stated ranges are too narrow: 3 of 8 spreads found lie inside, see docs/planning.md", strict=False
)
def test_spreads_found_lie_where_the_plan_said_and_its_first_is_among_the_best():
    """Two random cases, none chosen for its outcome; the candidates of one case share their truth and so their luck."""
    cases = [analyse(seed, repeats=1) for seed in (2, 5)]
    inside, found = np.sum([in_range(rows) for rows in cases], axis=0)
    assert inside >= 0.5 * found
    assert any(first_is_among_best_two(rows) for rows in cases)
