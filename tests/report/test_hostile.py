"""Reports and figures whose every text field is hostile, in a real browser, and as PDF text."""

import dataclasses
import re
import shutil
import subprocess

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.report import render_html, render_pdf
from jointbayes.report.inspect_figure import inspect_figure
from tests.conftest import of_case
from tests.hostile import beacons, browser, in_page, opened
from tests.report.conftest import campaign, comparison
from vibrecords import MeasuredFile
from vibrecords.provenance import ChannelUse, MeasurementWarning, Provenance
from vibrecords.records import FrfRecord

pytestmark = pytest.mark.science


def hostile(posterior, text):
    """The posterior with this text wherever a file or a user may put one."""
    provenance = Provenance(
        (MeasuredFile(text, 1, text),), text, 3, (1.0, 2.0), None, (ChannelUse(text, text, "force", 1.0, True),),
        (text, text), text, (text,), (MeasurementWarning(text, text, text, text),), (), (text,), text,
    )  # fmt: skip
    problem = posterior.problem
    problem = dataclasses.replace(problem, name=text).with_test(
        data=dataclasses.replace(problem.test.data, provenance=provenance)
    )
    record = dataclasses.replace(
        posterior.record, case_name=text, case_text=f"# {text}", reason=text,
        versions={**posterior.record.versions, text: text},
        sampler={**posterior.record.sampler, "move_acceptance": {text: 0.5}},
    )  # fmt: skip
    starts = tuple(dataclasses.replace(start, name=text) for start in posterior.estimate.starts)
    estimate = dataclasses.replace(posterior.estimate, starts=starts)
    posterior = dataclasses.replace(posterior, problem=problem, record=record, estimate=estimate)
    reference = posterior.estimate.values
    return of_case(
        posterior, stated=problem, title=text, reference=reference, reference_source=text, warnings=(text,)
    )  # fmt: skip


@pytest.fixture(scope="module")
def written(cheap_posterior, tmp_path_factory):
    """A directory with a hostile report, the port that it calls, and what was asked for there."""
    with beacons() as (port, asked):
        directory = tmp_path_factory.mktemp("hostile") / "run"
        jb.write_report(hostile(cheap_posterior, in_page(port)), directory)
        yield directory, asked


def test_a_hostile_report_runs_nothing_and_asks_for_nothing(written, tmp_path):
    directory, asked = written
    page, said = opened(directory / "report.html", tmp_path)
    assert 'id="pwned"' not in page
    assert asked == []
    assert said == ""  # the policy had nothing to refuse: all was text
    assert 'class="tools"' in page  # our own script ran
    assert "{{7*7}}" in page
    assert "**bold** `code`" in page
    assert "\u202e" not in page
    assert "<bdi>" in page


def test_hostile_figures_open_by_themselves_and_run_nothing(written, tmp_path):
    directory, asked = written
    frequency = np.arange(1.0, 20.0)
    with beacons() as (port, asked_of_figure):
        text = in_page(port)
        record = FrfRecord(text, text, frequency, np.ones(frequency.size, complex), "receptance")
        figure = tmp_path / "inspect.svg"
        figure.write_text(inspect_figure([record], [], [(text, text, frequency, frequency)]), encoding="utf-8")
        for path in (figure, directory / "figures" / "corner.svg"):
            page, said = opened(path, tmp_path)
            assert page.count("<svg") == 1
            assert "parsererror" not in page
            assert 'id="pwned"' not in page
            assert said == ""
        assert asked_of_figure == asked == []


def test_a_hostile_pdf_shows_text_and_has_no_action(written):
    directory, _ = written
    # streams are compressed: what stands in their bytes by chance is no name of the PDF's language
    content = re.sub(rb"stream\r?\n.*?endstream", b"", (directory / "report.pdf").read_bytes(), flags=re.DOTALL)
    assert content.count(b"/Page") > 1
    for action in (b"/URI", b"/JavaScript", b"/JS", b"/Launch", b"/OpenAction", b"/EmbeddedFile", b"/SubmitForm"):
        assert not re.search(action + rb"(?![A-Za-z])", content)  # a subset of a font may be /JSXKCD+Libertinus
    if shutil.which("pdftotext") is None:
        pytest.skip("NOT CHECKED: no pdftotext found to read hostile text in the PDF")
    done = subprocess.run(["pdftotext", directory / "report.pdf", "-"], capture_output=True, check=True)
    text = "".join(done.stdout.decode().replace("\u200b", "").split())
    for shown in ('#read("/etc/passwd")', "$x^2$", "**bold**`code`", "{{7*7}}", "<script>"):
        assert shown in text
    assert "root:x:0" not in text


def test_hostile_studies_run_nothing_and_ask_for_nothing(tmp_path, cheap_case):
    with beacons() as (port, asked):
        text = in_page(port)
        for place, report in (
            ("compare", comparison(text)),
            ("campaign", campaign(text.replace("\x00", ""))),
        ):  # fmt: skip
            path = tmp_path / f"{place}.html"
            path.write_text(render_html(report), encoding="utf-8")
            render_pdf(report)
            page, said = opened(path, tmp_path)
            assert 'id="pwned"' not in page, place
            assert (asked, said) == ([], ""), place
            assert "{{7*7}}" in page, place
            assert "\u202e" not in page, place


def test_the_browser_would_show_a_script_that_runs(tmp_path):
    browser()
    with beacons() as (port, asked):
        path = tmp_path / "bare.html"
        run = f"fetch('http://127.0.0.1:{port}/x'); document.documentElement.id = 'pwned'"
        path.write_text(f"<!DOCTYPE html><title>x</title><p>a<script>{run}</script>", encoding="utf-8")
        page, _ = opened(path, tmp_path)
        assert 'id="pwned"' in page
        assert asked
