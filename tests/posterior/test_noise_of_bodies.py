"""What a posterior says of measured bodies: verdicts, summary, bands, report, and that it is loaded without them."""

import datetime
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.measured_body import SETTINGS, data_set

from jointbayes.errors import ModelError
from jointbayes.frf import MeasuredBody, NoisePropagation, Ports, Substructures
from jointbayes.inference import Problem, Test
from jointbayes.posterior import Posterior, data_sha256
from jointbayes.posterior.diagnosis import diagnosis_of
from jointbayes.posterior.model_errors import DOUBTFUL, measured_bodies_of, noise_of_bodies
from jointbayes.posterior.verdicts import reason_lines
from jointbayes.report.contents import build_report
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.model import Lights, Table
from jointbayes.report.sections.measured_data import measured_bodies_section
from jointbayes.workflow import identify, load_posterior, sample
from tests.conftest import judged_as, on_one_line
from vibrecords import MeasuredFile


@pytest.fixture(scope="module")
def posterior() -> Posterior:
    return sample(data_set("counted", 1), seed=1, settings=SETTINGS)


@pytest.fixture(scope="module")
def ignoring() -> Posterior:
    return sample(data_set("ignored", 1), seed=1, settings=SETTINGS)


@pytest.mark.whole
def test_where_the_noise_counts_the_verdicts_are_as_ever(posterior):
    found = measured_bodies_of(posterior)
    assert found is not None
    assert found.within
    assert "is propagated to first order" in found.sentence
    assert "ignored" not in " ".join(reason_lines(posterior.verdict("k11")))
    assert posterior.check.explains
    assert found.sentence in on_one_line(posterior.summary())


@pytest.mark.usefixtures("plain_reports")
def test_where_the_noise_is_ignored_verdicts_summary_and_report_say_so(posterior, ignoring):
    for name in ignoring.stiffness_names:
        known = ignoring.verdict(name)
        assert "the noise of the measured body spindle is ignored, so that the interval is too narrow" in (
            known.because
        )
        low, high = np.log(ignoring.interval(name))
        wide = np.log(posterior.interval(name))
        assert high - low < 0.9 * (wide[1] - wide[0])
    summary = ignoring.summary()
    table = summary.to_dict()["measured_bodies"]
    assert table["ignored"]
    assert not table["within_bound"]
    assert "Intervals are too narrow." in str(summary)
    assert not ignoring.check.explains
    assert "let it count (propagate = true)" in diagnosis_of(ignoring).sentence
    inputs = ReportInputs(ignoring)
    report = build_report(inputs, datetime.date(2026, 11, 22))
    (lights,) = (block for block in report.lead if isinstance(block, Lights))
    assert lights.lights[1].kind == "bad"
    assert "is ignored" in lights.lights[1].text
    captions = [block.caption for block in report.blocks() if isinstance(block, Table)]
    assert captions.count("Measured bodies") == 1
    modes = next(b for b in report.blocks() if isinstance(b, Table) and b.caption.startswith("Natural frequencies"))
    assert "95 % interval (Hz)" not in modes.head  # of a body that was measured nobody knows its modes: peaks alone


def test_a_posterior_is_loaded_without_the_files_of_its_bodies(posterior, tmp_path):
    path = tmp_path / "posterior.nc"
    posterior.save(path)
    again = load_posterior(path)
    assert (again.stiffness == posterior.stiffness).all()
    assert measured_bodies_of(again) == measured_bodies_of(posterior)
    (body,), (stored,) = posterior.problem.test.measured_bodies, again.problem.test.measured_bodies
    assert (stored.receptance == body.receptance).all()
    assert (stored.covariance == body.covariance).all()
    theta = posterior.thinned(5)
    assert (again.problem.log_posterior(theta) == posterior.problem.log_posterior(theta)).all()


@pytest.mark.whole
def test_the_files_of_bodies_are_listed_and_their_numbers_are_in_the_fingerprint(posterior, tmp_path):
    problem = posterior.problem
    (body,) = problem.test.measured_bodies
    file = MeasuredFile("nose.uff", 1234, 32 * "ab")

    def of(changed):
        return replace(
            posterior, problem=problem.with_test(structure=replace(problem.test.structure, measured=(changed,)))
        )

    of(replace(body, files=(file,))).save(tmp_path / "posterior.nc")
    again = judged_as(load_posterior(tmp_path / "posterior.nc"), posterior)
    summary = again.summary().to_dict()
    assert summary["measured_bodies"]["files"] == {
        "spindle": [{"name": "nose.uff", "size": 1234, "sha256": file.sha256}]
    }
    section = measured_bodies_section(ReportInputs(again))
    listed = section.blocks[-1]
    assert listed.rows == (("spindle", "nose.uff", "1234", f"`{file.sha256}`"),)
    assert len(measured_bodies_section(ReportInputs(posterior)).blocks) == len(section.blocks) - 1
    usual = posterior.summary().data_sha256
    assert summary["data_sha256"] == usual
    for changed in (
        replace(body, receptance=body.receptance * (1 + 1e-12)),
        replace(body, covariance=body.covariance * (1 + 1e-12)),
    ):
        assert data_sha256(of(changed).problem) != usual


def test_the_band_holds_what_the_errors_of_the_body_make_of_the_frfs(posterior):
    """Its width beside that of the draws alone is that of the propagated noise."""
    band = posterior.predict_frf(max_draws=400)
    exact = replace(posterior, problem=posterior.problem.with_test(structure=_ignored(posterior)))
    narrow = exact.predict_frf(max_draws=400)
    problem = posterior.problem
    model = problem.test.receptance_model(Ports(band.frequency_hz, band.outputs, band.inputs))
    covariance = NoisePropagation(model).covariance(problem.prior.matrix(posterior.estimate.theta[None]))[0]
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2).real / 2).reshape(band.magnitude.shape)
    half, own = ((b.magnitude_high - b.magnitude_low) / 2 / 1.96 for b in (band, narrow))
    assert np.median(half / np.hypot(own, sd)) == pytest.approx(1.0, abs=0.05)
    assert (half > own).mean() > 0.9


def _ignored(posterior):
    return replace(posterior.problem.test.structure, propagate=False)


def test_lines_at_which_the_first_order_is_doubtful_are_named(posterior):
    problem, theta = posterior.problem, posterior.estimate.theta
    (body,) = problem.test.measured_bodies
    noisy = replace(body, covariance=body.covariance * 15**2)
    found = noise_of_bodies(problem.with_test(structure=Substructures(problem.test.structures, (noisy,))), theta)
    usual = measured_bodies_of(posterior)
    assert found.largest_sd == pytest.approx(15 * usual.largest_sd)
    assert found.largest_sd > DOUBTFUL
    assert not found.within
    assert f"At {found.doubtful_lines} of 145 lines, most at {found.largest_at_hz:.5g} Hz" in found.sentence
    odd = noise_of_bodies(
        problem.with_test(structure=Substructures(problem.test.structures, (replace(body, discrepancy=7.0),))), theta
    )
    assert odd.not_reciprocal == ("spindle",)
    assert "FRFs of spindle differ by 7 times what their noise allows" in odd.sentence


def test_the_papers_iteration_is_refused_beside_a_measured_body(posterior):
    with pytest.raises(ModelError, match="found the measured body spindle; the paper's iteration expects a structure"):
        identify(posterior.problem)


def test_data_at_lines_that_the_body_lacks_are_refused(posterior):
    problem = posterior.problem
    frf = replace(problem.test.data.frf, frequency_hz=problem.test.data.frf.frequency_hz + 1.0)
    with pytest.raises(ModelError, match="expected FRFs of the body at the very lines of the data"):
        problem.with_test(data=replace(problem.test.data, frf=frf)).log_posterior  # noqa: B018
    assert isinstance(problem.test.measured_bodies[0], MeasuredBody)


def of_tests(first, second, *, ignored="") -> Problem:
    """Two tests, each of one problem, of which one may take its body for exact."""
    tests = [
        Test(name, replace(one.test.structure, propagate=name != ignored), one.test.joints, one.test.data)
        for name, one in (("a", first), ("b", second))
    ]
    return Problem(tests=tests, prior=first.prior)


def test_one_measurement_of_a_body_in_two_tests_is_refused():
    first, second = data_set("counted", 1), data_set("counted", 2)
    of_tests(first, second)
    (body,) = first.test.measured_bodies
    for same in (body, replace(body, name="other")):
        whole = Substructures(first.test.structures, (same,))
        with pytest.raises(ModelError, match=r"one measurement of the body \w+ in tests a and b, .*; expected") as told:
            of_tests(first, second.with_test(structure=whole))
        assert "\n" not in str(told.value)
        of_tests(first, second.with_test(structure=whole), ignored="b")  # which is said in the report


def test_of_several_tests_the_worst_is_told(posterior):
    first, second = posterior.problem, data_set("counted", 2)
    (body,) = second.test.measured_bodies
    theta, lone = posterior.estimate.theta, measured_bodies_of(posterior)
    noisy = second.with_test(
        structure=Substructures(second.test.structures, (replace(body, covariance=225 * body.covariance),))
    )
    for problem in (of_tests(first, noisy), of_tests(noisy, first)):
        found = noise_of_bodies(problem, theta)
        assert found.test == ("b" if problem.tests[1].data is noisy.test.data else "a")
        assert found.doubtful_lines > lone.doubtful_lines
        assert f"spindle in test {found.test} is propagated" in found.sentence
        assert not any(test.ignores_noise_of_bodies for test in problem.tests)
    ignoring = of_tests(first, second, ignored="b")
    found = noise_of_bodies(ignoring, theta)
    assert (found.ignored, found.test) == (True, "b")


def test_the_report_has_the_bodies_of_every_test(posterior):
    problem = of_tests(posterior.problem, data_set("counted", 2))
    inputs = ReportInputs(replace(posterior, problem=problem))
    inputs.__dict__["summary"] = posterior.summary()
    (_, table) = measured_bodies_section(inputs).blocks
    assert [row[0] for row in table.rows] == ["spindle in test a", "spindle in test b"]
