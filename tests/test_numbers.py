"""README and docs quote what the shipped cases printed: every marked place is compared with docs/numbers.json."""

import json
import re

import numpy as np
import pytest
from benchmarks import gallery, numbers, quoted, readme_figure
from benchmarks.paper_tables import audit

from jointbayes.verdict_rule import RULE

pytestmark = pytest.mark.docs

AGAIN = "run `make numbers` (all cases) or `make pages` (pages and figures only)"


@pytest.fixture(scope="module")
def record():
    return json.loads(numbers.RECORD.read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", quoted.pages(), ids=lambda page: page.name)
def test_every_marked_number_and_block_is_that_of_the_record(page, record):
    text = page.read_text(encoding="utf-8")
    assert quoted.written(text, record) == text, AGAIN
    blocks = re.findall(r"<!--(/?)numbers", text)
    assert blocks == ["", "/"] * (len(blocks) // 2)


def test_the_figure_of_the_readme_is_that_of_the_record(record):
    assert readme_figure.drawn(record) == readme_figure.FIGURE.read_text(encoding="utf-8"), AGAIN
    higher = {**record["cases"][readme_figure.CASE]["k11"], "low": 1e10}
    cases = record["cases"] | {readme_figure.CASE: record["cases"][readme_figure.CASE] | {"k11": higher}}
    assert readme_figure.drawn({**record, "cases": cases}) != readme_figure.drawn(record)


def words_and_places(figure):
    """What a figure says, and where its lines and marks are; how it is written depends on matplotlib, 3.9 to 3.11."""
    words = re.findall(r"<!-- (.*?) -->|<text[^>]*>(.*?)</text>", figure, re.DOTALL)
    lines = re.findall(r'<path (?!id="DejaVu)[^>]*?\bd="([^"]*)"', figure)
    marks = re.findall(r'<use xlink:href="#m[^>]*? (x="[^"]*" y="[^"]*")', figure)
    return words, [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", " ".join(lines + marks))]


def test_every_figure_is_as_it_is_made_now(record):
    made = numbers.made_files(record)
    assert {path.suffix for path in made} == {".svg"}
    for path, text in made.items():
        kept, said = path.read_text(encoding="utf-8"), f"{path.name}: {AGAIN}"
        assert len(kept) < 200_000
        (words, places), (kept_words, kept_places) = words_and_places(text), words_and_places(kept)
        assert words
        assert words == kept_words, said
        assert len(places) > 20
        # coordinates are cut to hundredths of a point, and the last bits of a processor may decide which
        np.testing.assert_allclose(places, kept_places, rtol=0, atol=0.02, err_msg=said)


def texts_of_pages():
    return [page.read_text(encoding="utf-8") for page in quoted.pages()]


def test_no_sentence_has_a_comment_inside():
    assert [text for text in texts_of_pages() if re.search(r"\S *<!--|-->(?!\n)", re.sub("`[^`]*`", "", text))] == []


def test_a_changed_number_in_a_page_is_noticed(record):
    for template in quoted.sentences():
        ((text, match),) = ((text, match) for text in texts_of_pages() for match in quoted.found(template, text))
        assert quoted.written(text[: match.start(1)] + "9" + text[match.start(1) :], record) == text, template
    page = (numbers.ROOT / "docs" / "examples" / "frames.md").read_text(encoding="utf-8")
    terminal = page.replace("first.kx = ", "first.kx = 1", 1)
    assert terminal != page
    assert quoted.written(terminal, record) == page


def test_the_truth_is_found_wherever_a_case_states_it():
    known = {name: numbers.truth(path) for name, path in numbers.shipped().items()}
    assert known["lapped_beams"] == {"bolt.kx": 8e7, "bolt.ky": 3e8, "bolt.krz": 1.2e4}
    assert (known["clamped_beam"]["k22"], known["two_storeys"]) == (1.52e6, {})
    assert known["two_storeys_shape"]["first.kx"] == pytest.approx(1.44669e7, rel=1e-5)


def test_every_published_value_of_the_gallery_lies_inside_its_interval(record):
    page = (numbers.ROOT / "docs" / "trust.md").read_text(encoding="utf-8")
    for name in gallery.CASES:
        assert f"`configs/{name}.toml`" in page
        assert record["cases"][name]["check"]["exit"] == 0
        for i, k in enumerate(quoted.stiffnesses(record["cases"][name])):
            entry = record["cases"][name][k]
            published = [values[i] for values in quoted.OBJECTIVES.get(name, {}).values()]
            for value in (entry["reference"], *published):
                assert entry["low"] < value < entry["high"], (name, k)


def test_the_record_holds_every_case_that_says_that_it_runs(record):
    runnable = [name for name, path in numbers.shipped().items() if "run" in numbers.claims(path)]
    assert list(record["cases"]) == runnable


@pytest.mark.parametrize("name", list(numbers.shipped()))
def test_the_record_is_of_the_case_file_as_it_is_now(name, record):
    path = numbers.shipped()[name]
    claimed = numbers.claims(path)
    assert claimed, f"{path.name}: the comments say of no command what it exits with"
    if "run" in claimed:
        case = record["cases"][name]
        assert case["config"] == numbers.fingerprint(path), f"{name} has changed: {AGAIN}"
        assert (case["exit"], case.get("check", {}).get("exit")) == (claimed["run"], claimed.get("check"))


#: How the pages state the limits of the verdicts: pattern, the constants of its groups.
LIMITS = (
    (r"(?<!weakly )identified up to ([\d.]+\d)", (RULE.identified,)),
    (r"weakly identified up to ([\d.]+\d|\d)", (RULE.weakly_identified,)),
    (r"at most ([\d.]+) times the lower", (RULE.identified,)),
    (r"\*weakly identified\*:? (?:if )?at most ([\d.]+) times", (RULE.weakly_identified,)),
    (r"\| identified \| at most (\S+) \| at least (\S+) \|", (RULE.identified, RULE.contraction)),
    (r"\| weakly identified \| at most (\S+) \| at least (\S+) \|", (RULE.weakly_identified, RULE.contraction)),
    (r"\| not identified \| above (\S+), \*or\* \| below (\S+) \|", (RULE.weakly_identified, RULE.contraction)),
)


def test_the_limits_of_the_verdicts_in_prose_are_the_constants():
    stated = []
    for page in quoted.pages():
        text = " ".join(page.read_text(encoding="utf-8").split())
        for pattern, constants in LIMITS:
            for match in re.finditer(pattern, text):
                stated.append((page.name, pattern))
                assert tuple(map(float, match.groups())) == constants, (page.name, match[0])
    assert {("tutorial.md", LIMITS[i][0]) for i in (2, 3)} <= set(stated)
    assert {("README.md", LIMITS[i][0]) for i in (2,)} <= set(stated)
    assert {("method.md", LIMITS[i][0]) for i in (4, 5, 6)} <= set(stated)


def test_the_audit_of_the_paper_in_the_docs_is_what_it_finds():
    page = (numbers.ROOT / "docs" / "method.md").read_text(encoding="utf-8")
    for finding in audit():
        assert finding.claim in page
        assert finding.found in page, finding.found
