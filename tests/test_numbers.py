"""README and docs quote what the shipped cases printed: every marked place is compared with docs/numbers.json."""

import itertools
import json
import re

import numpy as np
import pytest
from benchmarks import gallery, numbers, quoted, readme_figure
from benchmarks.paper_tables import audit

from jointbayes.posterior.identifiability import IDENTIFIED_RATIO, LEAST_CONTRACTION, WEAK_RATIO
from jointbayes.studies.reference_check import EXACT_TOLERANCE, NOISY_TOLERANCE_K22, REGION

pytestmark = pytest.mark.docs

AGAIN = "run `make numbers` (all cases) or `make pages` (pages and figures only)"


@pytest.fixture(scope="module")
def record():
    return json.loads(numbers.RECORD.read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", quoted.pages(), ids=lambda page: page.name)
def test_every_marked_number_and_block_is_that_of_the_record(page, record):
    text = page.read_text(encoding="utf-8")
    assert quoted.written(text, record) == text, AGAIN
    opened, closed = len(re.findall(r"<!--n ", text)), len(re.findall(r"<!--/n-->", text))
    assert opened == closed == len(quoted.INLINE.findall(text))
    # Markdown takes a line that begins with a comment for HTML, and shows what follows on it as it is
    assert not re.search(r"^ *<!--n ", text, re.MULTILINE)
    blocks = re.findall(r"<!--(/?)numbers", text)
    assert blocks == ["", "/"] * (len(blocks) // 2)


def test_the_figure_of_the_readme_is_that_of_the_record(record):
    assert readme_figure.drawn(record) == readme_figure.FIGURE.read_text(encoding="utf-8"), AGAIN
    wider = {**record["cases"]["clamped_beam"]["k11"], "high": 1e11}
    cases = record["cases"] | {"clamped_beam": record["cases"]["clamped_beam"] | {"k11": wider}}
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


def test_the_pages_quote_the_record_at_all():
    marked = {page.name: quoted.INLINE.findall(page.read_text(encoding="utf-8")) for page in quoted.pages()}
    assert len(marked["README.md"]) >= 3
    assert len(marked["what-now.md"]) >= 3
    kinds = {page.name: re.findall(r"<!--numbers (\w+)", page.read_text("utf-8")) for page in quoted.pages()}
    blocks = {(page, kind) for page, each in kinds.items() for kind in each}
    assert {("frames.md", "run"), ("lapped-beams.md", "verdicts"), ("cases.md", "cases"),
            ("identifiability.md", "intervals")} <= (blocks)  # fmt: skip
    assert {("comparison.md", "compare"), ("method.md", "identify"), ("campaigns.md", "check")} <= blocks


def test_a_changed_number_in_a_page_is_noticed(record):
    readme = quoted.pages()[0].read_text(encoding="utf-8")
    found = quoted.INLINE.search(readme)
    assert quoted.written(readme[: found.start(3)] + "9" + readme[found.start(3) :], record) == readme
    page = (numbers.ROOT / "docs" / "examples" / "frames.md").read_text(encoding="utf-8")
    terminal = page.replace("first.kx: ", "first.kx: 1", 1)
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


def holds(line: str, value: float) -> bool:
    """Whether a number in a line is this value to the digits that it is printed with."""
    for whole, decimals, exponent in re.findall(r"(-?\d+)(?:\.(\d+))?(?:e([+-]?\d+))?", line):
        power = int(exponent or 0)
        printed = float(f"{whole}.{decimals or 0}e{power}")
        if any(abs(printed - value / scale) <= 0.51 * 10.0 ** (power - len(decimals)) for scale in (1, 1e3, 1e6, 1e9)):
            return True
    return False


def test_the_terminal_block_says_what_the_record_says(record):
    for case in record["cases"].values():
        for k in quoted.stiffnesses(case):
            start = next(i for i, line in enumerate(case["printed"]) if line.startswith(f"{k}: "))
            reasons = itertools.takewhile(lambda line: line.startswith("  "), case["printed"][start + 1 :])
            line = " ".join([case["printed"][start], *reasons])
            assert case[k]["verdict"] in line
            assert case[k]["words"] in line
            for end in ["limit"] if "limit" in case[k] else ["low", "high"]:
                assert holds(line, case[k][end]), (k, end, line)
    assert holds("k11: 95 % 3.534e+09 to 1.36e10", 1.3553e10)
    assert not holds("k11: 95 % 3.534e+09 to 1.36e10", 1.37e10)
    assert holds("k11: 5.40 (3.53 to 13.6) GN/m", 1.3553e10)
    assert not holds("k11: 5.40 (3.53 to 13.6) GN/m", 1.37e10)


@pytest.mark.parametrize("line", [
    "k11: 4.790e+09 N/m, 95 % 3.534e+09 to 1.355e+10: not identified",
    "k11: 5.40 (3.50 to 13.6) GN/m: not identified (its interval: too wide (3.8))",
])  # fmt: skip
def test_the_words_of_a_verdict_are_read_from_the_terminal_without_their_reason(line):
    assert numbers.words_of("k11", ["converged", line]) == "not identified"


def test_digits_are_those_that_the_errors_support(record):
    entry = {
        "unit": "N/m",
        "reference": 5.05e9,
        "median": 5.43439e9,
        "low": 3.53402e9,
        "high": 1.35532e10,
        "ratio": 3.8352,
    }
    entry |= {"low_error": 5.1e6, "high_error": 2.1e8, "median_error": 3.0e7, "verdict": "x", "words": "not identified"}
    row = quoted.BLOCKS["verdicts"](of_one(record, entry), "one")[2]
    assert "| 5.43e9 | 3.534e9 to 1.36e10 | 3.84 | not identified |" in row
    bounded = of_one(record, {**entry, "limit": 3.9e9, "verdict": "bounded below"})
    assert "| above 3.90e9, one-sided |" in quoted.BLOCKS["verdicts"](bounded, "one")[2]


def of_one(record, entry):
    """The record with one case whose three stiffnesses are alike."""
    return {**record, "cases": {"one": dict.fromkeys(("k11", "k12", "k22"), entry)}}


@pytest.mark.parametrize(("value", "style", "text"), [
    (3.8345, ".2g", "3.8"), (42.8, ".2g", "43"), (-12.913, ".1f", "−12.9"), (13553170353.1, "3e", "1.36e10"),
    (0.00123, "2e", "1.2e−3"), ("not identified", "", "not identified"), ("springs", "code", "`springs`"),
])  # fmt: skip
def test_values_are_printed_in_their_style(value, style, text):
    assert quoted.printed(value, style) == text


@pytest.mark.parametrize(("low", "high", "ends", "ratio"), [
    (3.53402e9, 1.35532e10, "3.53e9 to 1.36e10", "3.84"), (1.51689e6, 1.52193e6, "1.517e6 to 1.522e6", "1.003"),
    (8.72e5, 3.39e7, "8.72e5 to 3.39e7", "38.9"), (-1.69e8, 1.33e6, "−1.69e8 to 1.33e6", "either sign"),
])  # fmt: skip
def test_an_interval_has_the_digits_that_tell_its_ends_apart(low, high, ends, ratio, record):
    entry = {"low": low, "high": high, "ratio": high / low if low > 0 else None, "unit": "N", "words": "identified"}
    entry["verdict"] = "identified"
    assert (
        quoted.BLOCKS["intervals"](of_one(record, entry), "one")[2] == f"| one | k11 | {ends} | {ratio} | identified |"
    )


#: How the pages state the limits of the verdicts: pattern, the constants of its groups.
LIMITS = (
    (r"(?<!weakly )identified up to ([\d.]+\d)", (IDENTIFIED_RATIO,)),
    (r"weakly identified up to ([\d.]+\d|\d)", (WEAK_RATIO,)),
    (r"at most ([\d.]+) times the lower", (IDENTIFIED_RATIO,)),
    (r"\*weakly identified\*:? (?:if )?at most ([\d.]+) times", (WEAK_RATIO,)),
    (r"\| ✓ identified \| the upper end is at most (\S+) times", (IDENTIFIED_RATIO,)),
    (r"\| weakly identified \| at most (\S+) times", (WEAK_RATIO,)),
    (r"\| identified \| at most (\S+) \| at least (\S+) \|", (IDENTIFIED_RATIO, LEAST_CONTRACTION)),
    (r"\| weakly identified \| at most (\S+) \| at least (\S+) \|", (WEAK_RATIO, LEAST_CONTRACTION)),
    (r"\| not identified \| above (\S+), \*or\* \| below (\S+) \|", (WEAK_RATIO, LEAST_CONTRACTION)),
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
    assert {("gallery.md", LIMITS[i][0]) for i in (4, 5)} <= set(stated)
    assert {("method.md", LIMITS[i][0]) for i in (6, 7, 8)} <= set(stated)


def test_the_audit_of_the_paper_in_the_docs_is_what_it_finds():
    page = (numbers.ROOT / "docs" / "method.md").read_text(encoding="utf-8")
    for finding in audit():
        assert finding.claim in page
        assert finding.found in page, finding.found


def test_the_tolerances_of_the_check_in_prose_are_the_constants():
    page = (numbers.ROOT / "docs" / "campaigns.md").read_text(encoding="utf-8")
    assert f"each stiffness within {100 * EXACT_TOLERANCE:g} %" in page
    assert f"k22 within {100 * NOISY_TOLERANCE_K22:g} %, published joint inside the {100 * REGION:g} % region" in page
    for path in numbers.shipped().values():
        comments = " ".join(
            line.strip("# ") for line in path.read_text(encoding="utf-8").splitlines() if "#" in line[:1]
        )
        for stated in re.findall(r"k22 comes back within (\S+) %", comments):
            assert float(stated) == 100 * NOISY_TOLERANCE_K22
        for stated in re.findall(r"each stiffness comes back within (\S+) %", comments):
            assert float(stated) == 100 * EXACT_TOLERANCE
