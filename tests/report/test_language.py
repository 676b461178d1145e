"""Reports and documentation in the field's words: no turns of phrase that a test engineer has to read twice."""

import re

import pytest

from tests.conftest import CONFIGS
from tests.report.test_ten_questions import page_text

#: What is not said, in any prose.
NOT_SAID = (
    r"\bbeside\b",
    r"\bnobody\b",
    r"\banew\b",
    r"\b(is|are) told\b",
    r"\bwhat became of\b",
    r"\blet(s|ting)? (it |them )?go\b",
    r"\b(crews?|greet\w*|dismiss\w*)\b",
    r"\ball else (as stated|exact)\b",
    r"\b(he|she|it) who\b",
    r"\bnext to nothing\b",
    r"\bspans a factor of \d+ either way\b",
    r" … (?=[\d−-])",
)
#: In reports, moreover.
NOT_REPORTED = (r"\bthat of\b", r"\bby the likelihood alone\b", r"\bin a workshop where\b", r"\d … \d")


def found(patterns, text):
    """Sentences, from a few words before to a few behind, in which a pattern occurs."""
    return [text[max(0, m.start() - 60) : m.end() + 40] for p in patterns for m in re.finditer(p, text, re.IGNORECASE)]


@pytest.mark.whole
@pytest.mark.parametrize("name", ["main", "uncertain", "tests", "frequencies", "frame", "comparison"])
def test_a_report_is_in_plain_words(reports, name):
    assert found(NOT_SAID + NOT_REPORTED, page_text(reports[name])) == []


@pytest.mark.parametrize(
    "page", sorted((CONFIGS.parent / "tests" / "report" / "golden").iterdir()), ids=lambda p: p.stem
)
def test_a_golden_page_is_in_plain_words(page):
    assert found(NOT_SAID + NOT_REPORTED, page.read_text(encoding="utf-8")) == []


PAGES = [CONFIGS.parent / "README.md", *sorted((CONFIGS.parent / "docs").rglob("*.md"))]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_a_page_of_the_documentation_is_in_plain_words(path):
    prose = re.sub(r"```.*?```", " ", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    prose = re.sub(r"`[^`]*`|\]\([^)]*\)|<[^>]*>", " ", prose)
    assert found(NOT_SAID, prose) == []
