"""The search for the mode: resonances of the data, frequencies matched, climbs together, and a search that goes on."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jointbayes as jb
from jointbayes.identification import ModeSearch, SearchEffort, effort, refine, search_further
from jointbayes.identification.refine import laplace_covariance
from jointbayes.identification.starting_points import _TestMatch, frequency_starts
from jointbayes.inference.climb import PosteriorSquares, climb_all
from jointbayes.posterior.coordinates import draw_problem
from jointbayes.posterior.storage import _with_values, estimate_record
from jointbayes.stored_values import stored_value
from tests.conftest import CONFIGS, TABLE_3, cheap_text, edited, pair_matrix, shipped_text
from tests.oracles import differences
from vibrecords import FrequencyData, FrfData, FrfSet, peaks
from vibrecords.peaks import resonances_hz


def natural(problem, stiffness=TABLE_3, count=4):
    return problem.natural_frequencies_hz(stiffness, count)[0]


def one_mode(frequency_hz, natural_hz, ratio=0.005, noise=0.0, seed=0):
    """FRF of one mode of unit size with a noise floor, 1 % of the peak unless exact."""
    w, w0 = 2 * np.pi * frequency_hz, 2 * np.pi * natural_hz
    values = 1 / (w0**2 - w**2 + 2j * ratio * w0 * w)
    sd = max(noise, 1e-3) * np.abs(values).max()
    rng = np.random.default_rng(seed)
    values = values + (noise > 0) * sd * (rng.normal(size=w.size) + 1j * rng.normal(size=w.size)) / np.sqrt(2)
    frf = FrfSet(frequency_hz, values[:, None, None], ("1:y",), ("1:y",), "receptance")
    return FrfData(frf, np.full((w.size, 1, 1), sd**2))


def test_resonances_are_those_of_the_joint_that_made_the_data(cheap_case):
    found = resonances_hz(cheap_case.problem.test.data)
    assert_allclose(found, natural(cheap_case.problem, count=3), rtol=2e-3)


def test_a_resonance_is_found_between_lines_that_are_coarser_than_it_is_wide():
    lines = np.arange(100.0, 3000.0, 20.0)  # half-power width 10 Hz
    for true in (991.0, 1000.0, 1007.3):
        (found,) = resonances_hz(one_mode(lines, true))
        assert abs(found - true) < 0.5


def test_noise_is_no_resonance(monkeypatch):
    data = one_mode(np.arange(10.0, 3000.0, 2.0), 1000.0, noise=0.01)
    assert resonances_hz(data).size == 1
    monkeypatch.setattr(peaks, "LEAST_SD", 0.0)
    assert resonances_hz(data).size > 20


def test_measured_natural_frequencies_are_their_own_resonances():
    assert resonances_hz(FrequencyData(np.array([1.0, 2.0]), np.array([0.1, 0.1]))).tolist() == [1.0, 2.0]


@pytest.mark.parametrize("values", [np.ones((2, 1, 1), complex), np.zeros((8, 1, 1), complex)])
def test_lines_too_few_or_all_zero_show_no_resonance(values):
    frf = FrfSet(1.0 + np.arange(len(values)), values, ("1:y",), ("1:y",), "receptance")
    assert resonances_hz(FrfData(frf, np.ones(values.shape))).size == 0


@pytest.mark.parametrize("shown", [[0, 1, 2], [0, 2], [1, 2]])  # 0, 2: a response at a node of the second mode
def test_modes_that_show_no_resonance_are_skipped(cheap_case, shown):
    match = _TestMatch(cheap_case.problem)
    predicted = match.predicted_hz(np.log(TABLE_3)[None])
    match.resonances_hz = predicted[0, shown] * 1.001
    (assigned,), (missing,) = match._assigned(predicted)
    assert (assigned.tolist(), missing) == (shown, 3 - len(shown))


def test_a_resonance_that_no_mode_explains_is_given_up(cheap_case):
    match = _TestMatch(cheap_case.problem)
    predicted = match.predicted_hz(np.log(TABLE_3)[None])
    between = np.sqrt(predicted[0, 1] * predicted[0, 2])
    match.resonances_hz = np.array([predicted[0, 0], predicted[0, 1], between, predicted[0, 2]])
    assert match._assigned(predicted)[0][0].tolist() == [0, 1, -1, 2]


def test_the_best_frequency_start_has_the_natural_frequencies_of_the_data(cheap_case):
    starts = frequency_starts(cheap_case.problem, np.random.default_rng(1))
    assert 1 <= len(starts) <= 12
    assert np.isfinite(cheap_case.problem.log_posterior(starts)).all()
    best = natural(cheap_case.problem, cheap_case.problem.prior.values(starts[0]), 3)
    assert_allclose(best, resonances_hz(cheap_case.problem.test.data), rtol=5e-3)
    again = frequency_starts(cheap_case.problem, np.random.default_rng(1))
    assert np.array_equal(again, starts)


def test_frequencies_as_data_are_matched_directly(frequency_case):
    problem = frequency_case.problem
    starts = frequency_starts(problem, np.random.default_rng(1))
    found = natural(problem, problem.prior.values(starts[0]), 3)
    assert_allclose(found, problem.test.data.frequency_hz, rtol=5e-3)


def test_data_without_a_resonance_give_no_frequency_starts(cheap_case):
    measured = cheap_case.problem.test.data
    noisy = replace(measured, variance=np.full_like(measured.variance, np.abs(measured.frf.values).max() ** 2))
    assert frequency_starts(cheap_case.problem.with_test(data=noisy), np.random.default_rng(1)).shape == (0, 3)


def test_climbs_together_end_where_each_ends_alone(cheap_case):
    squares = PosteriorSquares(cheap_case.problem.log_posterior)
    starts = np.log(TABLE_3) + np.array([[0.3, -0.1, 0.02], [-0.4, 0.1, -0.03], [0.0, 0.2, 0.01]])
    together, value = climb_all(squares, starts, 40)
    alone = np.array([climb_all(squares, start[None], 40)[0][0] for start in starts])
    assert np.array_equal(together, alone)
    estimate = jb.find_map(cheap_case)
    assert_allclose(value, estimate.log_posterior, atol=1e-2)


def test_a_climb_stops_at_the_edge_of_the_prior_and_goes_on_along_it(cheap_case):
    text = edited(cheap_text(), ("high = 1.0e8", "high = 1.4e6"))  # k22 of the data is 1.52e6
    problem = jb.case_from_text("edge", text).problem
    estimate = jb.find_map(jb.case_from_text("edge", text))
    assert estimate.values[2] == pytest.approx(1.4e6, rel=1e-6)
    theta, _ = climb_all(PosteriorSquares(problem.log_posterior), np.log([[5e9, 3e7, 1.3e6]]), 60)
    assert theta[0, 2] == pytest.approx(np.log(1.4e6), abs=1e-9)


@pytest.mark.science
def test_the_mode_at_the_end_of_a_curved_ridge_is_reached():
    """Rotation by differences: the climb stopped 26 standard deviations from the mode at the bound of k11."""
    case = jb.load_case(CONFIGS / "measured_rotation.toml")
    estimate = jb.find_map(case)
    assert estimate.values[0] == pytest.approx(1e11, rel=1e-3)
    assert estimate.log_posterior == pytest.approx(-25114.7826, abs=1e-3)  # differential evolution, 60 × 3 × 300
    assert estimate.effort is not None
    assert not estimate.effort.explains
    assert not estimate.effort.mode_missed
    assert "most likely the model is wrong" in estimate.sentence
    assert estimate.modes[0].inside is not None
    chains, proposal = draw_problem(case.problem, estimate.places, np.random.default_rng(1), jb.SamplerSettings())
    assert chains.converged
    assert proposal.efficiency > 0.5


def wrong_summit(case):
    """A search of one start that ends at a false summit."""
    search = ModeSearch(case.problem.log_posterior)
    search.climb_stiffnesses({"soft": [1e8, 1e5, 1e4]})
    return search


def test_a_start_that_leads_nowhere_is_kept_with_its_own_joint_as_its_end(cheap_case, monkeypatch):
    search, releases_energy = wrong_summit(cheap_case), [-1e8, 1e5, -1e4]
    monkeypatch.setattr("jointbayes.identification.mode_search.into_support", lambda *_: None)
    search.climb_stiffnesses({"paper's iteration": releases_energy})
    estimate = search.estimate()
    plain = json.loads(json.dumps(estimate_record(estimate), default=np.ndarray.tolist))
    again = stored_value(jb.MapEstimate, _with_values(plain), "file")
    for outcome in (estimate.starts[-1], again.starts[-1]):
        assert (outcome.name, outcome.log_posterior, outcome.reached_mode) == ("paper's iteration", -np.inf, False)
        np.testing.assert_array_equal(outcome.stiffness, releases_energy)


@pytest.mark.science
def test_a_search_whose_end_does_not_explain_the_data_goes_on_until_it_finds_the_mode(cheap_case):
    truth = jb.find_map(cheap_case)
    search, lines = wrong_summit(cheap_case), []
    assert search.best[1] < truth.log_posterior - 100
    went = search_further(search, cheap_case.problem, 1, lines.append)
    assert search.best[1] == pytest.approx(truth.log_posterior, abs=1e-3)
    assert went.rounds == len(lines) == 1
    assert went.gain > 100
    assert (went.explains, went.sentence) == (True, "")
    assert "round 1 of at most 3" in lines[0].text


def test_a_search_that_explains_the_data_does_not_go_on(cheap_case):
    lines: list[str] = []
    estimate = jb.find_map(cheap_case, progress=lines.append)
    assert {line.stage for line in lines} == {"searching for the best fit"}
    assert not any(line.text for line in lines)  # no further round
    assert estimate.effort.rounds == 0
    assert estimate.effort.squares == pytest.approx(1.0, abs=0.2)
    assert estimate.sentence == ""


def test_where_the_search_stands_is_kept_with_the_posterior(cheap_posterior, tmp_path):
    moved = replace(cheap_posterior.estimate, effort=SearchEffort(20.0, 1.2, 40, 17, 1))
    replace(cheap_posterior, estimate=moved).save(tmp_path / "p.nc")
    loaded = jb.load_posterior(tmp_path / "p.nc")
    assert loaded.estimate.effort == moved.effort
    assert loaded.estimate.sentence == moved.sentence


def test_the_weights_of_a_flattened_density_take_noise_for_a_fraction_of_the_frf(cheap_case):
    measured = cheap_case.problem.test.data
    weights = effort._weights(cheap_case.problem)
    sd, size = np.sqrt(measured.variance)[:, 0], np.abs(measured.frf.values)[:, 0]
    expected = (sd / np.hypot(sd, size)).ravel()
    assert_allclose(weights[0].reshape(-1, 2), np.column_stack([expected, expected]), rtol=1e-12)
    theta = np.log(TABLE_3)[None]
    density = cheap_case.problem.log_posterior
    plain, flat = PosteriorSquares(density), PosteriorSquares(density, weights[0])
    z = plain.residuals(theta)
    assert_allclose(flat.residuals(theta), z * weights[0], rtol=1e-12)
    expected = density.prior.log_density(theta) - 0.5 * ((z * weights[0]) ** 2).sum()
    assert_allclose(flat.value(theta), expected, rtol=1e-12)


#: A steel rod of 50 × 5 mm with the damping of one; bounds as wide as the main case's next to its own stiffness.
_ROD = edited(
    shipped_text("clamped_beam"),
    ("length_mm = 383.0", "length_mm = 50.0"),
    ("diameter_mm = 25.0", "diameter_mm = 5.0"),
    ("ratio = 0.01", "ratio = 0.005"),
    ('outputs = ["11:y"]', 'outputs = ["11:y", "6:y"]'),
    ("f_min_hz = 20.0", "f_min_hz = 100.0"),
    ("f_max_hz = 2500.0", "f_max_hz = 20000.0"),
    ("f_step_hz = 1.0", "f_step_hz = 20.0"),
    ("low = 1.0e6\nhigh = 1.0e11", "low = 1.0e4\nhigh = 1.0e10"),
    ("low = 1.0e4\nhigh = 1.0e10\n\n[prior.k22]", "low = 1.0e1\nhigh = 1.0e8\n\n[prior.k22]"),
    ("low = 1.0e3\nhigh = 1.0e8", "low = 1.0e0\nhigh = 1.0e6"),
)


def rod(seed):
    """The rod on a joint drawn from its prior, and (k11, k12, k22)."""
    prior = jb.case_from_text("rod", _ROD).problem.prior
    truth = prior.values(prior.sample(np.random.default_rng([seed, 77]), 1)[0])
    before, after = _ROD.split("\n[data.truth]")
    stated = [(f"{name} = {old}", f"{name} = {float(value)!r}") for name, old, value in
              zip(("k11", "k12", "k22"), ("5.05e9", "3.44e7", "1.52e6"), truth, strict=True)]  # fmt: skip
    text = f"{before}\n[data.truth]{edited(after, *stated, ('seed = 20150787', f'seed = {seed}'))}"
    return jb.case_from_text(f"rod {seed}", text), truth


def climbed(case, starts):
    search = ModeSearch(case.problem.log_posterior)
    search.climb({f"start {i}": theta for i, theta in enumerate(starts, 1)})
    return search.estimate()


def by_frequencies(case):
    return climbed(case, frequency_starts(case.problem, np.random.default_rng(1)))


def by_draws(case):
    return climbed(case, case.problem.prior.sample(np.random.default_rng(1), 12))


def found(find, seeds):
    """How many modes of the rod this search finds, no more than 1 in log posterior below a climb from the truth."""
    count = 0
    for case, truth in map(rod, seeds):
        density = case.problem.log_posterior
        _, from_truth = refine(density, case.problem.prior.parametrisation.coordinates(truth))
        count += find(case).log_posterior > from_truth - 1.0
    return count


@pytest.mark.science
def test_the_mode_is_found_on_the_rod():
    assert found(jb.find_map, (200, 201)) == 2


@pytest.mark.science
def test_natural_frequencies_alone_find_modes_that_draws_miss_and_miss_them_without_the_condition_on_noise(monkeypatch):
    """Of as many draws; without the condition a ripple is taken for a mode."""
    assert found(by_frequencies, (0, 1, 2)) == 3
    assert found(by_draws, (0, 1, 2)) < 3
    assert found(by_frequencies, (5, 6, 8)) == 3
    monkeypatch.setattr(peaks, "LEAST_SD", 0.0)
    assert found(by_frequencies, (5, 6, 8)) < 3


def test_points_of_which_none_is_possible_have_no_density(cheap_case):
    posterior = cheap_case.problem.log_posterior
    lines, pairs = posterior.likelihood.standardised(pair_matrix([[5e9, 3e7, 1.3e6]])).shape[1:]
    squares = PosteriorSquares(posterior, np.ones(2 * lines * pairs))
    assert np.isneginf(squares.value(np.full((3, 3), 1e3))).all()
    assert squares.residuals(np.empty((0, 3))).shape[0] == 0


# at the edge of the cone of possible joints, where a start may end


@pytest.fixture(scope="module")
def of_scale():
    return jb.case_from_text("scaled", cheap_text() + '\n[noise]\nscale = "sampled"\n').problem.log_posterior


#: k12² as near to k11·k22 as rounding leaves it positive definite.
EDGE = np.array([20.0, 16.0 - 1e-12, 12.0, 0.1])


def test_a_move_out_of_the_cone_is_not_made_and_one_out_of_the_box_ends_at_its_side(of_scale):
    prior = of_scale.prior
    assert prior.feasible(EDGE)
    out, inwards = prior.moved(EDGE, np.array([[0.0, 0.1, 0.0, 0.0], [0.0, -0.1, 0.0, 0.0]]))
    assert (out == EDGE).all()
    assert inwards[1] == pytest.approx(EDGE[1] - 0.1)
    (far,) = prior.moved(EDGE, np.array([[0.0, 0.0, 0.0, 1e3]]))
    assert far[3] == prior.support[1][3]


def test_gradient_and_covariance_are_finite_at_the_edge_and_differences_central_inside(of_scale):
    assert np.isfinite(of_scale.gradient(EDGE)).all()
    assert (np.linalg.eigvalsh(laplace_covariance(of_scale, EDGE)) > 0).all()
    inside = np.array([22.0, 16.0, 14.0, 0.1])
    assert of_scale.gradient(inside) == pytest.approx(differences(lambda at: of_scale(at)[0], inside), rel=1e-3)
