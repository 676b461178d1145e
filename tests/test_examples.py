"""The pages of the examples: their cases, figures and numbers."""

import itertools
import json

import numpy as np
import pytest
from benchmarks import example_data, example_figures, numbers, quoted
from benchmarks.written_files import write_frf

import jointbayes as jb
from vibrecords.formats import iter_records

pytestmark = pytest.mark.docs

RECORD = json.loads(numbers.RECORD.read_text(encoding="utf-8"))
EXAMPLES = example_figures.examples()


def test_every_page_shows_a_case_and_a_figure():
    pages = sorted(example_figures.FOLDER.glob("*.md"))
    shown = set(EXAMPLES.values())
    assert [page for page in pages if page not in shown] == []
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert any(f"({file})" in text for file in example_figures.named()), page.name


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_the_interval_of_every_stiffness_holds_what_made_the_data(name):
    case, truth = RECORD["cases"][name], numbers.truth(numbers.shipped()[name])
    for k in quoted.stiffnesses(case):
        if k in truth:
            assert case[k]["low"] < truth[k] < case[k]["high"], k
    assert case["explains"]
    assert case["converged"]


@pytest.mark.parametrize(("name", "most_sds", "most_sd", "most_error"), [
    ("spindle_tool", 3, np.inf, np.inf), ("spindle_measured", 3, np.inf, np.inf), ("lapped_beams", 3, 0.05, np.inf),
    pytest.param("portal_frame", 4, np.inf, 0.02, marks=(pytest.mark.science, pytest.mark.long)),
])  # fmt: skip
def test_the_springs_that_made_the_data_come_back_at_the_map(name, most_sds, most_sd, most_error):
    case, truth = jb.load_case(numbers.CONFIGS / f"{name}.toml"), numbers.truth(numbers.shipped()[name])
    found = jb.find_map(case)
    error = np.abs(np.log(found.values / [truth[k] for k in case.problem.parametrisation.stiffness_names]))
    sd = np.sqrt(np.diag(found.covariance))
    assert (error < most_sds * sd).all()
    assert sd.max() < most_sd
    assert error.max() < most_error


def test_the_two_storeys_are_those_of_the_publication():
    text = (numbers.CONFIGS / "two_storeys.toml").read_text(encoding="utf-8")
    assert f"eigenvalues = {example_data.eigenvalues().round(2).tolist()}" in text
    for mode in example_data.TWO_STOREYS["modes"]:
        median, sd_log = example_data.log_normal(mode)
        assert f"median = {median * example_data.TWO_STOREYS['nominal'] / 1e7:.4f}e7\nsd_log = {sd_log:.5f}" in text
        assert median * np.exp(-(sd_log**2)) == pytest.approx(mode)
    problem = jb.load_case(numbers.CONFIGS / "two_storeys.toml").problem
    for pair in example_data.solutions():
        found = problem.natural_frequencies_hz(pair, 2)[0]
        np.testing.assert_allclose(found, example_data.TWO_STOREYS["frequencies"], rtol=1e-9)
    assert f"components = [[{example_data.first_shape():.2f}]" in numbers.shipped()["two_storeys_shape"].read_text(
        encoding="utf-8"
    )


def test_the_moments_of_the_two_storeys_are_the_published_ones():
    case = RECORD["cases"]["two_storeys"]
    assert case["relative_mean"] == pytest.approx(example_data.PUBLISHED["mean"], abs=0.02)
    assert case["relative_sd"] == pytest.approx(example_data.PUBLISHED["sd"], abs=0.01)


def test_the_files_of_the_measured_spindle_are_those_of_the_script(tmp_path):
    for name, frf in zip(example_data.SPINDLE_FILES, example_data.spindle_files(), strict=True):
        write_frf(frf, tmp_path / "made.uff", "uff58b")
        made, shipped = (list(iter_records(path)) for path in (tmp_path / "made.uff", numbers.CONFIGS / name))
        assert len(made) == len(shipped) == frf.values[0].size
        for one, other in zip(made, shipped, strict=True):
            np.testing.assert_allclose(one.values, other.values, rtol=1e-5)


@pytest.mark.parametrize("length", example_data.BAR_FILES)
def test_the_files_of_the_measured_bar_are_those_of_the_script(length):
    shipped = list(iter_records(numbers.CONFIGS / example_data.BAR_FILES[length][0]))
    for one, other in zip(example_data.bar_records(length), shipped, strict=True):
        assert (one.response, one.reference, one.averages) == (other.response, other.reference, other.averages)
        np.testing.assert_allclose(one.values, other.values, rtol=1e-5)


def test_the_files_of_the_imported_bar_are_those_of_the_script(tmp_path):
    pytest.importorskip("skfem", reason="scikit-fem, which makes the matrices of configs/clamped_solid.toml")
    from benchmarks import solid_data

    solid_data.write_model(tmp_path / "made.npz")
    made, shipped = (jb.read_structure(path, length_unit="m") for path in (tmp_path / "made.npz", solid_data.MODEL))
    for name in ("stiffness", "mass"):
        one, other = getattr(made, name), getattr(shipped, name)
        assert abs(one - other).max() < 1e-9 * abs(other).max()
    for name, make in solid_data.MADE.items():
        made_frfs, records = make(every=40), list(iter_records(numbers.CONFIGS / "data" / name))
        for (i, output), (j, input_) in itertools.product(enumerate(made_frfs.outputs), enumerate(made_frfs.inputs)):
            (record,) = (r for r in records if (r.response, r.reference) == (output, input_))
            np.testing.assert_allclose(made_frfs.values[:, i, j], record.values[::40], rtol=1e-6)


def test_a_tool_of_beams_in_a_meshed_holder_has_the_frfs_of_matrices_and_an_exact_beam(monkeypatch):
    """From the text of the case, at the springs that made its data: one line in forty, without noise."""
    pytest.importorskip("skfem", reason="scikit-fem, which makes the matrices of configs/solid_holder.toml")
    from benchmarks import solid_data

    monkeypatch.setattr(solid_data, "NOISE", 0.0)
    exact, problem = solid_data.with_tool(every=40), jb.load_case(numbers.CONFIGS / "solid_holder.toml").problem
    ports = jb.Ports(exact.frequency_hz, ("tool.tip:y", "back:y"), ("tool.tip:y",))
    theta = np.atleast_2d(problem.parametrisation.coordinates(solid_data.TAPER))
    factors = problem.structural(problem.prior.factors(theta))
    (found,) = problem.test.receptance_model(ports).receptance(problem.prior.matrix(theta), factors)
    assert abs(found - exact.values).max() < 1e-4 * abs(exact.values).max()
    np.testing.assert_allclose(found, exact.values, rtol=2e-3)


def test_a_model_with_rigid_bearings_would_not_explain_the_measured_spindle():
    case = jb.load_case(numbers.CONFIGS / "spindle_tool.toml").problem
    measured = jb.load_case(numbers.CONFIGS / "spindle_measured.toml").problem
    wrong = case.with_test(data=measured.test.data)
    matrix = wrong.parametrisation.matrix(list(numbers.truth(numbers.shipped()["spindle_tool"]).values()))[None]
    here, there = (np.mean(np.abs(p.log_posterior.likelihood.standardised(matrix)) ** 2) for p in (measured, wrong))
    assert there > 100 * here
