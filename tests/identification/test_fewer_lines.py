"""Some of the lines of long FRFs serve a search, and the slopes and bends of a density, as all of them do."""

from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes import workflow
from jointbayes.case.case import case_from_text
from jointbayes.identification import on_fewer_lines, resonances, with_lines_in_groups
from jointbayes.inference import ErrorSizes, Landing
from jointbayes.progress import tell_nobody
from tests.conftest import cheap_text, edited


@pytest.fixture(scope="module")
def long_frf():
    """The same band at 0.5 Hz: half of the power of the first mode lies within 2.4 Hz."""
    return case_from_text("long", edited(cheap_text(), ("f_step_hz = 10.0", "f_step_hz = 0.5"))).problem


def needing(monkeypatch, values, on_a_peak):
    monkeypatch.setattr(resonances, "_ENOUGH_VALUES", values)
    monkeypatch.setattr(resonances, "_FEWEST_LINES", 50)
    monkeypatch.setattr(resonances, "_ON_A_PEAK", on_a_peak)


def test_frfs_of_a_usual_length_are_searched_whole(cheap_case, long_frf):
    assert on_fewer_lines(cheap_case.problem) is cheap_case.problem
    assert on_fewer_lines(long_frf) is long_frf


@pytest.mark.parametrize(("on_a_peak", "step"), [(1, 9), (2, 4), (4, 2), (5, 1), (100, 1)])
def test_each_peak_keeps_the_lines_that_show_its_shape(long_frf, monkeypatch, on_a_peak, step):
    """Above half of its height the narrowest peak, the first, has 9 lines, with 500 values wanted of 4961."""
    needing(monkeypatch, 500, on_a_peak)
    every, kept = long_frf.test.data, on_fewer_lines(long_frf).test.data
    lines = np.searchsorted(every.frf.frequency_hz, kept.frf.frequency_hz)
    np.testing.assert_array_equal(every.frf.frequency_hz[lines], kept.frf.frequency_hz)
    np.testing.assert_array_equal(every.variance[lines], kept.variance)
    apart, top = np.diff(lines), np.argmax(np.abs(every.frf.values[:480, 0, 0]))
    assert lines[0] == 0
    on_peak = lines[np.abs(lines - top) <= 3]
    assert on_peak.size >= 7 // step
    assert (np.diff(on_peak) == step).all()
    assert apart.max() == 9
    # away from the peaks they are as far apart as the values that are wanted allow
    assert (apart[lines[:-1] > 4500] == 9).all()


def test_where_nearly_all_lines_are_on_peaks_all_are_kept(long_frf, monkeypatch):
    needing(monkeypatch, 2400, 1)
    assert on_fewer_lines(long_frf) is not long_frf
    monkeypatch.setattr(resonances, "shoulders", lambda magnitude, _: (0, len(magnitude) - 1))
    monkeypatch.setattr(resonances, "_ON_A_PEAK", 5000)
    assert on_fewer_lines(long_frf) is long_frf


def test_the_mode_is_that_of_all_lines(long_frf, monkeypatch):
    whole = jb.find_map(long_frf, seed=1)
    needing(monkeypatch, 500, 2)
    assert on_fewer_lines(long_frf) is not long_frf
    estimate = jb.find_map(long_frf, seed=1)
    assert estimate.log_posterior == pytest.approx(whole.log_posterior, abs=1e-6)
    np.testing.assert_allclose(estimate.theta, whole.theta, atol=1e-4)
    np.testing.assert_allclose(estimate.covariance, whole.covariance, rtol=1e-3)
    assert estimate.effort.squares == pytest.approx(whole.effort.squares, rel=1e-6)
    assert estimate.effort.limit == pytest.approx(whole.effort.limit, rel=1e-12)
    assert estimate.effort.agreeing >= 3


@pytest.mark.parametrize(("error", "climbs"), [(0.003, 0), (1e-7, 1)])
def test_only_a_fit_that_is_checked_is_climbed_on_all_lines(long_frf, monkeypatch, error, climbs):
    """The modes that measured FRFs show are numbered by what the search on some lines finds."""
    needing(monkeypatch, 500, 2)
    measured = long_frf.with_test(data=replace(long_frf.test.data, synthetic=False))
    climb, found = workflow._climbed_again, []
    monkeypatch.setattr(workflow, "_climbed_again", lambda *given: found.append(climb(*given)) or found[-1])
    measured = replace(measured, model_error=ErrorSizes(frequency=error))
    assert workflow.answered_case(measured, 1, tell_nobody).premises.of_modes == (not climbs)
    assert len(found) == climbs


def test_natural_frequencies_and_other_tests_stay_as_they_are(long_frf, frequency_case, monkeypatch):
    needing(monkeypatch, 500, 2)
    assert on_fewer_lines(frequency_case.problem) is frequency_case.problem
    both = [replace(long_frf.test, name="long"), replace(frequency_case.problem.test, name="typed")]
    problem = jb.Problem(both, long_frf.prior)
    fewer = on_fewer_lines(problem)
    assert fewer.tests[1] is problem.tests[1]
    assert fewer.tests[0].data.frf.n_lines < problem.tests[0].data.frf.n_lines


def test_one_line_for_a_few_gives_the_slopes_and_bends_of_all(long_frf):
    """At ends of climbs, of all lines and of groups alike: curvature to 2 %, bends to a twentieth of the length."""
    grouped = with_lines_in_groups(long_frf)
    assert grouped.test.data.frf.n_lines < long_frf.test.data.frf.n_lines / 4
    whole = Landing(long_frf.log_posterior)
    coarse = Landing(long_frf.log_posterior, coarse=grouped.log_posterior)
    places, height = coarse.land(32, np.random.default_rng(1))
    assert height.max() == pytest.approx(whole.land(32, np.random.default_rng(1))[1].max(), abs=2.0)
    np.testing.assert_allclose(height, long_frf.log_posterior(places))
    near = places[height > height.max() - 25.0][:8]
    reach = np.full(len(near), 0.5)
    (axes, bend), (few_axes, few_bend) = whole.shapes(near, reach, 1), coarse.shapes(near, reach, 1)
    covariance = axes @ axes.swapaxes(1, 2)
    ratio = np.linalg.eigvals(np.linalg.solve(covariance, few_axes @ few_axes.swapaxes(1, 2))).real
    np.testing.assert_allclose(ratio, 1.0, atol=0.02)
    across = np.linalg.solve(axes, (few_bend - bend)[:, 0, 0, :, None])
    np.testing.assert_allclose(across, 0.0, atol=0.05)


def test_lines_without_neighbours_to_spare_stay_as_they_are(frequency_case, long_frf, monkeypatch):
    assert with_lines_in_groups(frequency_case.problem) is frequency_case.problem
    monkeypatch.setattr(resonances, "_IN_A_GROUP", 1)
    assert with_lines_in_groups(long_frf) is long_frf
