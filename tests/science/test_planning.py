"""What a plan forecasts is what measuring and sampling then find; its figures for random cases are in the docs."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.planning import PAGE, RESULTS, SETTINGS, analyse, measured_together, random_case

from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.studies.planning.case_candidates import candidates_of
from jointbayes.studies.planning.make_plan import Simulator
from jointbayes.workflow import sample


def test_the_real_measurement_of_a_random_case_is_made_at_its_truth():
    drawn = random_case(1)
    new = next(c for c in candidates_of(drawn.case) if re.fullmatch(r"\d+:y", c.name))
    averaged = next(c for c in candidates_of(drawn.case) if "averages" in c.name)
    for candidate in (new, averaged):
        problem = measured_together(drawn, candidate, np.random.default_rng(1)).problem
        lines = problem.test.data.frf.values.size
        chi2 = 2 * (problem.log_posterior.likelihood.constant - problem.log_posterior.log_likelihood(drawn.truth)[0])
        assert chi2 / (2 * lines) == pytest.approx(1.0, abs=0.12)  # χ² of real and imaginary parts
    quarter = drawn.case.problem.test.data.variance.mean() / 4
    assert problem.test.data.variance.mean() == pytest.approx(quarter, rel=0.3)  # of the average


@pytest.mark.science
@pytest.mark.parametrize(("seed", "name"), [(2, "averages"), pytest.param(5, "4:y", marks=pytest.mark.long)])
def test_a_simulated_posterior_is_that_of_sampling_the_same_data(seed, name):
    """The forecast's own sums, against the search for the mode and the ensemble sampler on the data it simulated."""
    drawn = random_case(seed)
    present = sample(drawn.case, seed=1)
    candidate = next(c for c in candidates_of(drawn.case) if name in c.name)
    problem = drawn.case.problem
    systems, rng = coordinate_systems(problem), np.random.default_rng([1, 7])
    simulator = Simulator(problem, drawn.parameter, present.theta, systems, rng, truths=4)
    for truth in range(3):
        simulated = simulator.posterior_after([candidate], truth)
        there = replace(drawn, truth=simulator.truths[truth])
        data = measured_together(there, candidate, simulator.noise(truth, candidate))
        found = sample(data, seed=3, settings=SETTINGS)
        assert found.converged
        assert simulated.sd == pytest.approx(np.log(found.values(drawn.parameter)).std(), rel=0.12)


@pytest.mark.science
@pytest.mark.long
def test_one_case_is_planned_and_measured():
    (rows,) = (analyse(5, repeats=1),)
    assert sum(row.recommended for row in rows) == 1
    assert [row.median for row in rows] == sorted(row.median for row in rows)
    assert all(row.low <= row.median <= row.high <= 1.5 * row.before for row in rows)
    assert all(0.05 * row.before < sd < 1.5 * row.before for row in rows for sd in row.found)


def test_the_study_of_fifty_cases_is_published_and_holds():
    found = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert found["cases"] >= 50
    assert 0.7 <= found["in_range"] / found["spreads"] <= 0.9
    assert found["first_among_best_two"] >= 0.8 * found["planned"]
    page = PAGE.read_text(encoding="utf-8")
    assert f"{found['in_range']} of {found['spreads']}" in page
    assert f"{found['first_among_best_two']} of {found['planned']}" in page


def test_the_kept_plan_of_tests_has_them_in_the_order_of_the_table():
    """383 mm with mid-span and 150 mm, with mid-span, with four overhangs, with 200 mm, with 2 kg at the tip."""
    kept = json.loads((RESULTS.parent / "next_setup.json").read_text(encoding="utf-8"))
    found = {tuple(one["names"]): one["simulated"]["sd_median"] for one in kept["measurements"]}
    order = [("6:y", "mm150"), ("6:y",), ("mm300", "mm200", "mm150", "mm100"), ("mm200",), ("heavy",)]
    sds = [found[names] for names in order]
    assert sds == sorted(sds)
    assert kept["recommended"] == list(order[0])
    page = PAGE.read_text(encoding="utf-8").replace("\n> ", " ")
    assert kept["sentence"] in page
