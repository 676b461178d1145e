"""What the walk-throughs show is what their commands print, but for those that take minutes."""

import pytest
from benchmarks.walk_through import PAGES, made

AGAIN = "run `python -m benchmarks.walk_through`"


@pytest.mark.docs
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_walk_through_shows_what_its_commands_print(page):
    text = page.read_text(encoding="utf-8")
    assert made(text, long=False) == text, AGAIN
    assert text.count("$ jointbayes run my_case.toml\n") == 1
    assert "Report: reports/my_case/report.html" in text


@pytest.mark.docs
def test_a_changed_output_is_noticed():
    text = PAGES[0].read_text(encoding="utf-8")
    changed = text.replace("averages: 10", "averages: 11", 1)
    assert made(changed, long=False) == text
