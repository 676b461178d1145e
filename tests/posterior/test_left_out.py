"""What is left out of the estimate is predicted with all its errors, and a wrong model is seen to fail."""

import json

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.posterior.prediction import left_out_of, predict_left_out, sentence_of_left_out
from tests.case.refusal_rows import parts_named
from tests.conftest import cli

# three masses on three equal springs: one unknown
CHAIN = parts_named("rooms")["posterior/left_out chain"]
MODES = parts_named("rooms")["posterior/left_out modes"]
ERROR = "[uncertain.model_error]\nfrequency_error = 0.004\nerror_factor = 1.000001\n"
K = 1e5


def frequencies(*, last_mass=1.0):
    """Natural frequencies of the chain with springs of 1e5 N/m, by NumPy, Hz."""
    stiffness = K * np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    root = np.diag([1, 1, last_mass**-0.5])
    return np.sqrt(np.linalg.eigvalsh(root @ stiffness @ root)) / (2 * np.pi)


def case(data, mass=1.0):
    return jb.case_from_text("chain", CHAIN.replace("MASS", str(mass)) + data)


def modes_of(measured, more=""):
    return MODES.replace("FREQUENCIES", str(measured.tolist())) + more


def at_truth(problem, count=4000):
    """Draws of θ that all lie at the true stiffness, with the noise's parameters from their prior."""
    theta = problem.prior.sample(np.random.default_rng(3), count)
    theta[:, 0] = np.log(K)
    return theta


@pytest.mark.parametrize(("more", "sd"), [("", 0.002), (ERROR, np.hypot(0.002, 0.004))])
def test_intervals_hold_the_errors_of_measurement_and_model(more, sd):
    problem = case(modes_of(frequencies(), more)).problem
    (left_out,) = predict_left_out(problem, at_truth(problem), 0.95, seed=1)
    assert left_out.names == ("frequency 2", "frequency 3")
    np.testing.assert_allclose(left_out.measured, frequencies()[1:])
    np.testing.assert_allclose(left_out.median, left_out.measured, rtol=3e-4)
    np.testing.assert_allclose((left_out.high - left_out.low) / left_out.measured, 2 * 1.96 * sd, rtol=0.08)
    assert left_out.inside.all()


def test_modes_left_out_do_not_enter_the_estimate():
    kept = case(modes_of(frequencies())).problem
    other = case(modes_of(frequencies() * [1, 1.1, 1.2])).problem
    alone = case(modes_of(frequencies()[:1]).partition("[left_out]")[0]).problem
    theta = np.log(np.geomspace(3e4, 3e5, 7))[:, None]
    np.testing.assert_array_equal(kept.log_posterior(theta), other.log_posterior(theta))
    np.testing.assert_allclose(kept.log_posterior(theta), alone.log_posterior(theta), rtol=1e-12)
    assert kept.test.data.numbers == (1,)
    assert kept.left_out[0].data.numbers == (2, 3)


@pytest.mark.whole
def test_a_right_model_predicts_what_was_left_out():
    posterior = jb.sample(case(modes_of(frequencies(), ERROR)), seed=1)
    predicted = left_out_of(posterior)
    assert sentence_of_left_out(predicted) == "Left out and predicted: 2 of 2 inside 95 % intervals."
    narrower = left_out_of(posterior, 0.5)
    assert (narrower[0].high - narrower[0].low < predicted[0].high - predicted[0].low).all()


@pytest.mark.whole
def test_a_wrong_model_is_seen_to_fail_in_report_summary_and_terminal(tmp_path, plain_reports):
    path, out = tmp_path / "wrong.toml", tmp_path / "wrong"
    path.write_text(CHAIN.replace("MASS", "2.0") + modes_of(frequencies(), ERROR), encoding="utf-8")
    result = cli("run", path, "--out", out)
    assert result.exit_code == 0, result.output
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["check"]["explains"]  # one frequency and one spring: any model does
    said = summary["left_out"]
    assert (said["inside"], said["count"]) == (0, 2)
    assert [value["inside"] for value in said["values"]] == [False, False]
    assert "Outside: frequency 2, measured 62.76" in said["sentence"]
    assert said["sentence"] in " ".join(result.output.splitlines())
    html = (out / "report.html").read_text(encoding="utf-8")
    assert "Left out and predicted: 0 of 2 inside 95\u00a0% intervals" in html
    assert "they hold neither its own error nor a measurement" in html
    posterior = jb.load_posterior(out / "posterior.nc")
    assert sentence_of_left_out(left_out_of(posterior)) == said["sentence"]


BAND = f"""
[data]
kind = "synthetic_frf"
outputs = ["3:x"]
inputs = ["3:x"]
f_min_hz = 10.0
f_max_hz = 100.0
f_step_hz = 0.25
truth = {{ stiffness.a.kx = {K} }}
noise = {{ relative = 0.03, floor = 0.01, seed = 1 }}
[left_out]
bands_hz = [[50.0, 75.0]]
"""


def test_lines_left_out_are_predicted_as_magnitudes_and_a_wrong_model_misses_them():
    made = case(BAND).problem
    assert made.test.data.frf.n_lines + made.left_out[0].data.frf.n_lines == 361
    lines = made.left_out[0].data.frf.frequency_hz
    assert (lines.min(), lines.max()) == (50.0, 75.0)
    wrong = case(BAND, mass=1.3).problem.with_test(data=made.test.data)
    wrong = type(wrong)(wrong.tests, wrong.prior, wrong.initial, left_out=[
        type(test)(test.name, test.structure, test.joints, made.left_out[0].data, test.noise) for test in wrong.left_out
    ])  # fmt: skip
    shares = []
    for problem in (made, wrong):
        (left_out,) = predict_left_out(problem, at_truth(problem, 400), 0.95, seed=1)
        assert left_out.names[0] == "3:x/3:x at 50 Hz"
        shares.append(left_out.inside.mean())
    assert 0.9 < shares[0] < 0.99
    assert shares[1] < 0.4


TESTS = f"""
[tests.light]
[tests.heavy.structure.masses_kg]
3 = 2.0
[tests.heavy.data]
frequencies_hz = {frequencies(last_mass=2.0).tolist()}
"""


def test_a_test_left_out_is_predicted_from_the_others():
    data = modes_of(frequencies()).replace("modes = [2, 3]", 'tests = ["heavy"]')
    read = case(data + TESTS)
    assert [test.name for test in read.problem.tests] == ["light"]
    assert [test.name for test in read.problem.left_out] == ["heavy"]
    (left_out,) = predict_left_out(read.problem, at_truth(read.problem), 0.95, seed=1)
    assert left_out.test == "heavy"
    assert left_out.inside.all()
    posterior = jb.sample(read, seed=1)
    assert posterior.summary().to_dict()["left_out"]["inside"] == 3
    assert read.workshop_problem is not None
    assert [test.name for test in read.workshop_problem.left_out] == ["heavy"]


def test_a_summary_of_nothing_left_out_says_so(cheap_posterior):
    assert left_out_of(cheap_posterior) == ()
    assert cheap_posterior.summary().to_dict()["left_out"] is None
