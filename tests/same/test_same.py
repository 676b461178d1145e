"""The net names what changed, and nothing that rounding alone has moved."""

import copy
import json
import sys
from pathlib import Path

import pytest

from tests.same import __main__ as command
from tests.same import runs
from tests.same.cases import IN_CI, NAMES
from tests.same.compare import Difference, differences, judged, masked
from tests.same.record import number, sentences, without_passing

RECORD = json.loads(Path(__file__).with_name("example.json").read_text(encoding="utf-8"))


def changed(*path, to):
    """The record with one value replaced, or without it where that is Ellipsis."""
    record = copy.deepcopy(RECORD)
    place = record
    for key in path[:-1]:
        place = place[key]
    if to is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = to
    return record


def elsewhere(record):
    """The same, computed with another BLAS."""
    return record | {"made_with": RECORD["made_with"] | {"blas": "openblas Zen"}, "draws_sha256": "ffff"}


K22 = ("summary", "parameters", "k22")


EXPLAINS, NOT, TEN = (
    "The model explains the data.",
    "The model does NOT explain the data.",
    "k22  | 1.518 × 10⁷ (1.507)",
)


@pytest.mark.parametrize(("path", "to", "where", "kept", "found"), [
    ((*K22, "median"), 1.5181e6, "summary.parameters.k22.median", "1517900.0", "1518100.0"),
    ((*K22, "interval95", 1), 1.5539e6, "summary.parameters.k22.interval95[1]", "1553700.0", "1553900.0"),
    ((*K22, "interval95", 1), ..., "summary.parameters.k22.interval95[1]", "1553700.0", "nothing"),
    ((*K22, "limit95"), 1.0, "summary.parameters.k22.limit95", "None", "1.0"),
    ((*K22, "verdict"), ..., "summary.parameters.k22.verdict", "'identified'", "nothing"),
    ((*K22, "new"), 2, "summary.parameters.k22.new", "nothing", "2"),
    (("summary", "converged"), False, "summary.converged", "True", "False"),
    (("summary", "check", "steps"), 151, "summary.check.steps", "150", "151"),
    (("summary", "check", "sentence"), "Misfit 1.0025 times the noise.", "summary.check.sentence", "1.0023", "1.0025"),
    (("draws_sha256",), "0a1c", "draws_sha256", "'0a1b'", "'0a1c'"),
    (("report", 0), NOT, "report", repr(EXPLAINS), repr(NOT)),
    (("report", 0), ..., "report", repr(EXPLAINS), "nothing"),
    (("report", 2), "Of 15 starts 14 succeed.", "report 'Of 15 starts 14 succeed.'", "15", "14"),
    (("report", 1), TEN, f"report {TEN!r}", "1.518 × 10⁶", "1.518 × 10⁷"),
])  # fmt: skip
def test_a_change_is_named_alone_with_its_place(path, to, where, kept, found):
    assert list(map(str, differences(RECORD, changed(*path, to=to)))) == [f"{where}: kept {kept}, found {found}"]


@pytest.mark.parametrize("median", [1.5179e6, 1.5180e6, 1.5178e6])
def test_a_rounding_boundary_is_no_difference(median):
    assert differences(RECORD, changed(*K22, "median", to=median)) == []


@pytest.mark.parametrize(("kept", "found", "same"), [(9.9999, 10.0, True), (9.9997, 10.0, True), (9.998, 10.0, False),
                                                     (0.0, 1e-9, False), (-1.0, 1.0, False), (0, 0, True)])  # fmt: skip
def test_a_unit_of_the_fifth_digit_is_that_of_the_larger_number(kept, found, same):
    assert (differences(*[{**RECORD, "summary": {"parameters": {}, "x": x}} for x in (kept, found)]) == []) == same


def test_draws_of_another_arithmetic_may_differ_but_not_words_verdicts_and_intervals():
    assert differences(RECORD, elsewhere(RECORD)) == []
    moved = changed(*K22, "median", to=1.52e6)  # 0.05 of the interval's width
    moved["report"][1] = "k22  | 1.520 × 10⁶ (1.509)"
    assert differences(RECORD, elsewhere(moved)) == []
    hashes = [{**RECORD, "report": [f"Data SHA-256 {digit * 32}."]} for digit in ("1a", "b2")]
    assert (differences(hashes[0], elsewhere(hashes[1])), len(differences(*hashes))) == ([], 1)
    walked = changed("summary", "sampler", to={"stretch": 0.6})
    assert (differences(RECORD, elsewhere(walked)), len(differences(RECORD, walked))) == ([], 1)
    far = "summary.parameters.k22.median (draws of two arithmetics)"
    assert differences(RECORD, elsewhere(changed(*K22, "median", to=1.53e6))) == [
        Difference(far, "1517900.0", "1530000.0")
    ]
    assert judged(RECORD, elsewhere(changed(*K22, "verdict", to="bounded below")))[0]
    for path, value in (((*K22, "verdict"), "not identified"), (("report", 0), "The model does NOT explain the data.")):
        assert len(differences(RECORD, elsewhere(changed(*path, to=value)))) == 1


def test_by_another_arithmetic_a_short_run_may_settle_or_not_but_its_intervals_are_the_same():
    unsettled = changed("summary", "converged", to=False)
    unsettled["summary"]["parameters"]["k22"]["verdict"] = "no verdict"
    assert (len(differences(RECORD, unsettled)), differences(RECORD, elsewhere(unsettled))) == (2, [])
    unsettled["summary"]["parameters"]["k22"]["median"] = 1.53e6
    (far,) = differences(RECORD, elsewhere(unsettled))
    assert far.where == "summary.parameters.k22.median (draws of two arithmetics)"


def test_by_another_arithmetic_few_sentences_may_have_other_words():
    report = [f"Sentence {'a' * n}." for n in range(40)]
    one, two, three = ({**RECORD, "report": [*report[:-n], *["Other."] * n]} for n in (1, 2, 3))
    kept = {**RECORD, "report": report}
    for found, allowed in ((one, 1), (two, 2), (three, 0)):
        assert [len(part) for part in judged(kept, elsewhere(found))] == [0 if allowed else 3, allowed]
    assert [len(part) for part in judged(kept, one)] == [1, 0]


def test_a_page_is_read_as_a_person_reads_it_without_versions_and_times():
    page = """<html><head><title>T</title><style>p { color: red }</style></head><body><h1>Clamp</h1>
    <p>Settled. Good to <strong>1.23456789 %</strong>; k &lt; 2. The time: jointbayes 0.1.0+0a1b2c3d4e5f.</p>
    <p>It left 1625 effective draws in 3.2 s, seed 1.</p>
    <p>8000 independent draws by importance sampling in 0.9 s, seed 1.</p>
    <table><tr><th>numpy</th><td>2.4.6</td></tr></table><pre>title = "x"</pre>
    <script>let a = "<p>no</p>"</script></body></html>"""
    assert sentences(page) == [
        "Clamp",
        "Settled.",
        "Good to 1.2346 %; k < 2.",
        "The time: jointbayes VERSION.",
        "It left 1625 effective draws in TIME, seed 1.",
        "8000 independent draws by importance sampling in TIME, seed 1.",
        "numpy | VERSION",
    ]


def test_a_summary_is_kept_in_five_digits_without_versions_and_times():
    summary = {
        "seconds": 3.2,
        "versions": {"numpy": "2"},
        "a": [1.23456789, 150, True, None],
        "b": ("x is 0.123456789",),
    }
    assert without_passing(summary) == {"a": [1.2346, 150, True, None], "b": ["x is 0.12346"]}


@pytest.mark.parametrize(("text", "value"), [("1.2 × 10⁻⁷", 1.2e-7), ("−3.5", -3.5), ("5.05e9", 5.05e9)])
def test_numbers_of_a_report_are_read(text, value):
    assert number(text) == value
    assert masked(f"k11 is {text} N/m") == "k11 is # N/m"


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """The command on made-up records: exit status and output."""
    monkeypatch.setattr(runs, "KEPT", tmp_path / "kept")
    monkeypatch.setattr(runs, "FOUND", tmp_path / "found")
    ran = []

    def call(*arguments, found=RECORD, failure=""):
        def run_all(names, fingerprint):
            for name in names:
                ran.append(name)
                if not failure:
                    runs.write(tmp_path / "found" / f"{name}.json", {"sources": fingerprint, **found})
                yield name, 1.0, failure

        monkeypatch.setattr(runs, "run_all", run_all)
        monkeypatch.setattr(sys, "argv", ["same", *arguments])
        ran.clear()
        with pytest.raises(SystemExit) as ended:
            command.main()
        return ended.value.code, capsys.readouterr().out, list(ran)

    return call


def test_the_command_keeps_compares_and_fails(run, tmp_path):
    assert run("two_storeys")[0] == 1  # nothing is kept yet
    status, _, ran = run("two_storeys", "--update")  # what the last run found is kept without another
    assert (status, ran) == (0, [])
    assert json.loads((tmp_path / "kept" / "two_storeys.json").read_text(encoding="utf-8")) == RECORD
    assert run("two_storeys") == (
        0,
        "two_storeys: same (1.0 s of CPU)\n1 cases, 1 s of CPU; none differ\n",
        ["two_storeys"],
    )
    status, told, _ = run("two_storeys", found=changed("summary", "converged", to=False))
    assert status == 1
    assert "\n  summary.converged: kept True, found False\n" in told
    status, told, _ = run("two_storeys", found=elsewhere(RECORD))
    assert status == 0
    assert "NOT COMPARED" in told
    assert "blas openblas Haswell, here openblas Zen" in told
    status, told, _ = run("two_storeys", failure="ValueError: x")
    assert status == 1
    assert "ended with ValueError: x" in told
    (tmp_path / "kept" / "gone.json").write_text("{}", encoding="utf-8")
    assert run("two_storeys")[0] == 1


def test_a_name_that_is_none_is_refused_and_ci_stands_for_five(run):
    assert (run("two_stories")[0], sorted(run("ci", "--update")[2])) == (2, sorted(IN_CI))


def test_each_case_is_kept_and_small():
    sizes = {path.stem: path.stat().st_size for path in runs.KEPT.glob("*.json")}
    assert sizes.keys() == set(NAMES)
    assert max(sizes.values()) < 150_000
    assert sum(sizes.values()) < 2_000_000
