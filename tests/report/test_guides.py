"""Each figure says how to read it, and each report what its terms mean."""

import datetime

import pytest
from benchmarks.reference_pages import glossary

from jointbayes.report.html import render_html
from jointbayes.report.methods import guide_of, packaged, terms, terms_section
from jointbayes.report.model import Figure, Guide, Paragraph, Report, ReportSection
from jointbayes.report.pdf import render_pdf
from jointbayes.sampling import SamplerSettings
from jointbayes.verdict_rule import RULE

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="72pt" height="36pt"/>'


@pytest.mark.parametrize("name", packaged("guides.toml"))
def test_a_guide_is_whole_and_short(name):
    guide = guide_of(name)
    parts = (guide.shows, guide.better, guide.worse, guide.action)
    assert all(part.endswith(".") for part in parts)
    assert sum(len(part.split()) for part in parts) <= 60


@pytest.mark.parametrize(
    ("identifier", "name"),
    [
        ("frf-0-1", "frf"),
        ("test-12-frf-0-0", "frf"),
        ("traces-2", "traces"),
        ("mode-shapes", "mode-shapes"),
        ("mode-shape-3", "mode-shape-"),
        ("nothing-like-it", None),
    ],
)
def test_the_guide_is_that_of_the_longest_beginning(identifier, name):
    assert guide_of(identifier) == (None if name is None else Guide(**packaged("guides.toml")[name]))


def test_a_figure_has_its_guide_on_the_page_or_one_of_its_own():
    mine = Guide("mine", "a", "b", "c")
    figures = (Figure("corner", "Corner.", "Corner.", SVG), Figure("traces-1", "Traces.", "Traces.", SVG, guide=mine))
    section = ReportSection("all", "All", (Paragraph("Text."), *figures))
    page = render_html(Report("Clamp", "", (), (section,), datetime.date(2026, 1, 5), "0")).replace("\u00a0", " ")
    assert guide_of("corner").shows in page
    assert "<dd>mine</dd>" in page
    assert guide_of("traces-1").shows not in page


def test_the_terms_state_the_limits_of_the_program():
    section = terms_section(" ".join(terms()))
    assert section.appendix
    assert dict(section.blocks[0].rows) == terms()
    assert dict(terms_section("of the prior, identified").blocks[0].rows) == {
        name: terms()[name] for name in ("prior", "identified")
    }
    meaning = terms()["identified"]
    assert f"at most {RULE.identified:g} times" in meaning
    assert f"at most {RULE.weakly_identified:g} times" in meaning
    assert f"at {SamplerSettings().r_hat_max:g} or more" in terms()["R-hat"]
    assert all(f"| {meaning} |" in "\n".join(glossary()).replace("\\", "") for meaning in terms().values())
    report = Report("Clamp", "", (), (section,), datetime.date(2026, 1, 5), "0")
    assert meaning in render_html(report).replace("\u00a0", " ")
    assert render_pdf(report).startswith(b"%PDF-")
