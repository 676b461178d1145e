"""What the walk-throughs show is what their commands print, but for those that take minutes."""

import re

import pytest
from benchmarks.numbers import words_of
from benchmarks.walk_through import PAGES, made

AGAIN = "run `python -m benchmarks.walk_through --short`"


@pytest.mark.docs
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_walk_through_shows_what_its_commands_print(page):
    text = page.read_text(encoding="utf-8")
    assert made(text, long=False) == text, AGAIN
    assert text.count("$ jointbayes run my_case.toml\n") == 1
    assert ("$ jointbayes init my_case.toml\n" if page.stem == "tutorial" else "$ jointbayes init --from ") in text
    assert "Report: reports/my_case/report.html" in text


@pytest.mark.docs
def test_a_csv_of_ones_own_leads_to_a_report_in_three_commands():
    text = next(page for page in PAGES if page.stem == "my-file").read_text(encoding="utf-8")
    typed = re.findall(r"^\$ jointbayes (\w+)", text, re.MULTILINE)
    assert {"init", "run"} <= set(typed[:3])
    assert typed.index("run") < 3


@pytest.mark.docs
def test_a_changed_output_is_noticed():
    text = next(page for page in PAGES if page.stem == "my-file").read_text(encoding="utf-8")
    assert made(text.replace("averages: 10", "averages: 11", 1), long=False) == text


@pytest.mark.docs
def test_the_tutorial_says_of_k22_what_its_three_runs_found():
    text = next(page for page in PAGES if page.stem == "tutorial").read_text(encoding="utf-8")
    runs = re.findall(r"^\$ jointbayes run [^\n]*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    alone, workshop, two_sensors = (words_of("k22", run.splitlines()) for run in runs)
    assert alone.startswith("identified, if")
    assert '"if Young' in text
    assert (workshop, two_sensors) == ("not identified", "identified")
