"""One posterior, one verdict, one interval: every surface gives the same numbers of a run."""

import csv
import json
import math
import re
from dataclasses import fields, replace
from xml.etree import ElementTree

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.cli.common import print_summary
from jointbayes.posterior.decision import premises_of
from jointbayes.posterior.summary import stiffness_row
from jointbayes.posterior.verdicts import line_of
from jointbayes.report import ReportInputs, build_report, drawing, render_html, render_pdf
from jointbayes.report.export import central_joint, export
from jointbayes.report.model import FrfPlot
from jointbayes.workflow import AS_ASKED
from tests.case.test_several_tests import BASE, CLAMP_EDGE, TWO
from tests.conftest import (
    CONFIGS,
    TABLE_3,
    TO_CONVERGE,
    cheap_text,
    edited,
    judged_as,
    on_one_line,
    shipped_text,
    unsettled,
)
from tests.posterior.test_decision import of_another_truth
from tests.posterior.test_knowledge import WRONG_LENGTH
from tests.report.conftest import DATE, made_up
from tests.report.test_renderers import Page, pdf_text, squeezed
from vibrecords.formats import iter_records

RHO = '[prior.rho]\ndistribution = "uniform"\nlow = -1.0\nhigh = 1.0\n\n'


def signed_text():
    """The coupling by its coefficient, which may have either sign."""
    text = edited(cheap_text(), ('parametrisation = "log"', 'parametrisation = "signed"'))
    at, end = text.index("[prior.k12]"), text.index("[prior.k22]")
    return text[:at] + RHO + text[end:]


def by_modes(cheap_case):
    """Of measured FRFs of a beam half a millimetre longer than the one that is analysed."""
    return jb.sample(of_another_truth(cheap_case, "length_mm = 383.5"), seed=1)


def of_frfs(cheap_case):
    """The same FRFs as they are, which the beam does not explain."""
    return jb.sample(of_another_truth(cheap_case, "length_mm = 383.5"), seed=1, settings=TO_CONVERGE, premises="exact")


def of_text(name, text):
    return jb.sample(jb.case_from_text(name, text, directory=CONFIGS), seed=1, settings=TO_CONVERGE)


def of_cheap(get, text=""):
    """The draws of the cheap case, with what was found of them, as one of another text."""
    posterior = get("cheap_posterior")
    if text:
        case = jb.case_from_text("rule", text)
        posterior = replace(
            posterior, case=case, record=replace(posterior.record, case_name="rule", case_text=case.text)
        )
    return judged_as(replace(posterior), get("cheap_inputs").posterior)


#: Runs of which every surface is read; of some the draws are made up about a joint, which costs no sampling.
RUNS = {
    "computed": lambda get: of_cheap(get),
    "measured, by modes": lambda get: by_modes(get("cheap_case")),
    "measured, as they are": lambda get: of_frfs(get("cheap_case")),
    "typed frequencies": lambda get: replace(get("frequency_posterior")),
    "typed modes with shapes": lambda _: of_text("shapes", shipped_text("two_storeys_shape")),
    "failed check": lambda _: of_text("wrong length", WRONG_LENGTH),
    "signed coupling": lambda _: of_text("signed", signed_text()),
    "several tests": lambda _: made_up("tests", BASE + CLAMP_EDGE + TWO, TABLE_3),
    "measured body": lambda _: made_up("spindle", shipped_text("spindle_measured"), (6e8, 1.2e6, 2e8, 1e5)),
    "free structure": lambda _: made_up("bolts", shipped_text("lapped_beams"), (8e7, 3e8, 1.2e4)),
    "its own rule": lambda get: of_cheap(get, f"{cheap_text()}[verdict.k22]\nidentified = 1.0001\n"),
    "not settled": lambda get: judged_as(unsettled(get("cheap_posterior")), get("cheap_inputs").posterior),
    "damped joint": lambda _: made_up("dampers", shipped_text("rotor_dampers"), (1e6, 3e3)),
}
#: What of a posterior gives a median, an interval or a verdict of a stiffness: the test below reads all of it.
READ = {
    "draws", "interval", "load", "repr", "repr_html", "save", "stiffness", "summary", "to_arviz", "to_dataframe",
    "under", "values", "verdict",
}  # fmt: skip
#: And what gives none: draws of other scales, figures of the run, predictions, sentences on premises.
SILENT = {
    "best", "case", "check", "converged", "estimate", "log_density", "mode", "predict", "predict_frf",
    "predict_natural_frequencies", "premises", "prior_values", "problem", "reason", "record", "stiffness_names",
    "theta", "thinned", "tree", "unit",
}  # fmt: skip


@pytest.fixture
def plain_figures(monkeypatch):
    """Reports with blank figures and without profiles, whose numbers are no claim here."""
    monkeypatch.setattr(
        drawing, "svg", lambda *_: '<svg xmlns="http://www.w3.org/2000/svg" width="72pt" height="36pt"/>'
    )
    monkeypatch.setattr("jointbayes.posterior.posterior.profiles_of", lambda *_: ())
    monkeypatch.setattr("jointbayes.case.case.find_numbering", lambda *_: None)


def test_a_new_surface_of_a_posterior_is_read_or_says_nothing_of_a_stiffness():
    public = {name for name in dir(jb.Posterior) if not name.startswith("_")} | {f.name for f in fields(jb.Posterior)}
    assert {name for name in public if not name.startswith("_")} == (READ - {"load", "repr", "repr_html"}) | SILENT


def require_figures_that_agree(posterior, report, path):
    """What the figure of an FRF holds, which the page saves as CSV, is what `export` writes and Python predicts."""
    plots = [plot for block in report.blocks() if isinstance(plot := getattr(block, "plot", None), FrfPlot)]
    has_frfs = all(test.data.shown_frfs is not None for test in posterior.problem.tests)
    assert bool(plots) == has_frfs
    if not has_frfs or len(posterior.problem.tests) > 1:  # of several the page tells which by its heading
        return
    export(posterior, path, "csv")
    written = {(record.response, record.reference): record.values for record in iter_records(path)}
    text = path.read_text(encoding="utf-8").splitlines()
    columns = list(csv.DictReader(line for line in text if not line.startswith("#")))
    for plot in plots:
        output, input_ = plot.pair
        median = next(curve.values for curve in plot.curves if curve.name == "median")
        np.testing.assert_allclose(median, written[output, input_], rtol=1e-9)
        for end, values in zip(("lower", "upper"), plot.band, strict=True):
            column = f"{end} end of 95 % / {input_} of {output}"
            ends = [float(row[column]) for row in columns]
            np.testing.assert_allclose(abs(values), ends, rtol=1e-9, err_msg=column)


def require_one_interval(name, line, surfaces, known):
    """No surface has a second interval under the name of a stiffness."""
    for said in surfaces:
        values = re.findall(rf"(?<![\w.]){re.escape(name)} = (?=[^:;]* to )", said)
        assert len(values) == said.count(line) * (not math.isfinite(known.limit))


def require_same_in_arviz(draws, known):
    """Draws that are thinned to whole chains have the median and the interval by a few Monte Carlo errors."""
    quantiles, errors = np.quantile(draws, [0.5, 0.025, 0.975]), (known.median_error, *known.interval_error)
    assert (abs(quantiles - (known.median, *known.interval)) < 8 * np.maximum(errors, 1e-9)).all()


@pytest.mark.whole
@pytest.mark.usefixtures("plain_figures")
@pytest.mark.parametrize("kind", list(RUNS))
def test_every_surface_gives_the_same_numbers(kind, request, tmp_path, capsys):
    posterior = RUNS[kind](request.getfixturevalue)
    inputs = ReportInputs(posterior)
    inputs.knowledge  # what is known without what is taken as exact, as a run has it  # noqa: B018
    report = build_report(inputs, DATE)
    pages = [squeezed("".join(Page(render_html(report)).text)), squeezed(pdf_text(render_pdf(report), tmp_path))]
    summary = inputs.summary
    told = json.loads(json.dumps(summary.to_dict()))["parameters"]
    frame = summary.to_dataframe()
    print_summary(posterior, inputs.knowledge)
    printed = capsys.readouterr().out
    posterior.save(tmp_path / "posterior.nc")
    again = jb.load_posterior(tmp_path / "posterior.nc", posterior.problem)
    drawn = posterior.to_arviz()["posterior"]
    table = [cell.text or "" for cell in ElementTree.fromstring(posterior._repr_html_()).iter("td")]
    assert (kind == "not settled") == (not posterior.converged)
    theta, _ = central_joint(posterior)
    exported = dict(zip(posterior.stiffness_names, posterior.problem.prior.values(theta), strict=True))
    for name in posterior.stiffness_names:
        known, line = posterior.verdict(name), line_of(name, posterior.verdict(name))
        assert repr(summary.parameters[name].known) == repr(known)
        assert repr(again.verdict(name)) == repr(known)
        np.testing.assert_allclose([posterior.interval(name), again.interval(name)], [known.interval] * 2, rtol=1e-12)
        np.testing.assert_allclose(frame.loc[name, ["low95", "high95"]].tolist(), known.interval, rtol=1e-12)
        np.testing.assert_allclose(told[name]["interval95"], known.interval, rtol=1e-12)
        assert {told[name]["verdict"], frame.loc[name, "verdict"]} == {known.cls}
        assert tuple(told[name]["conditions"]) == known.conditions
        assert told[name]["likelihood95"] == [end if math.isfinite(end) else None for end in known.likelihood95]
        reasons = [(reason["text"], reason["code"]) for reason in told[name]["reasons"]]
        assert reasons == [(str(because), because.reason.value) for because in known.reasons]
        of_draws = float(np.median(posterior.values(name)))
        assert told[name]["median"] == pytest.approx(of_draws) == pytest.approx(known.median)
        column = posterior.stiffness[:, posterior.stiffness_names.index(name)]
        for values in (posterior.draws[name], posterior.to_dataframe()[name], column):
            assert of_draws == pytest.approx(float(np.median(values)))
        assert exported[name] == pytest.approx(known.median, rel=1e-6)
        assert line in on_one_line(posterior)
        assert line in printed
        require_one_interval(name, line, (on_one_line(posterior), " ".join(printed.split())), known)
        require_same_in_arviz(drawn[name].values, known)
        at = table.index(name)
        assert table[at : at + 3] == list(stiffness_row(name, known))
        assert table[at + 2] == known.words
        assert known.words in on_one_line(summary)
        assert known.value in on_one_line(summary)
        assert squeezed(known.words) in pages[0]
        for page in pages:  # of the PDF the foot of a page may stand in a sentence
            assert squeezed(known.value.replace("-", "−")) in page.replace("-", "−")
            assert squeezed(known.plain_words) in page
    for premises, row in posterior.under.items():
        assert again.under[premises].interval(name) == pytest.approx(row.interval(name))
        assert row.interval(name) != posterior.interval(name)
    require_figures_that_agree(posterior, report, tmp_path / "frfs.csv")
    page = " ".join(map(str, report.blocks()))
    if kind == "signed coupling":
        assert (posterior.values("k12") > 0).all()  # although the prior allows either sign
        assert (posterior.prior_values("k12") < 0).any()
        assert "weakly identified" in page
    if posterior.problem.premises.of_modes or posterior.problem.premises.asked:
        for said in (printed, on_one_line(posterior), posterior._repr_html_(), on_one_line(posterior.summary()), page):
            assert all(sentence in said for sentence in premises_of(posterior)[:2])
    assert (posterior.problem.premises.asked == AS_ASKED) == (kind == "measured, as they are")
    if posterior.problem.premises.of_modes:
        assert summary.to_dict()["premises"]["reason"] == posterior.problem.premises.reason
        assert "analysed by the 3 modes that they show" in page
    assert posterior.problem.premises.of_modes == (kind == "measured, by modes")
