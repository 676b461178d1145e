"""Studies: rows are kept and counted, figures on pages are those on record, and rules of single studies."""

import importlib
import json

import numpy as np
import pytest
from benchmarks import interval_ends, limits_hold
from benchmarks.record import write_between
from benchmarks.study import ROOT, Study, coverage, holds

pytestmark = pytest.mark.docs

NAMES = ("exact_study", "false_alarms", "free_bar", "interval_ends", "joint_damping", "limits_hold", "measured_body",
         "modal_fit", "predictions", "random_frames", "solid", "wrong_model")  # fmt: skip
STUDIES = [importlib.import_module(f"benchmarks.{name}").STUDY for name in NAMES]


@pytest.mark.parametrize("study", [one for one in STUDIES if one.record.exists()], ids=lambda study: study.name)
def test_the_page_of_a_study_shows_what_is_on_record(study):
    results = json.loads(study.record.read_text(encoding="utf-8"))
    assert study.section(results) in (ROOT / "docs" / study.page).read_text(encoding="utf-8")
    assert {kind: data["sets"] for kind, data in results.items()}.items() <= study.sets.items()


def row_of(index, truth, low, high, verdict="identified"):
    known = {"k": {"truth": truth, "interval95": [low, high], "ends": [low, None], "verdict": verdict}}
    return {"converged": True, "explains": index > 1, "known": known}


def test_a_study_that_was_cut_off_goes_on_counts_and_is_written(tmp_path, monkeypatch):
    for module in ("study", "record"):
        monkeypatch.setattr(f"benchmarks.{module}.ROOT", tmp_path)
    for name in ("benchmarks", "docs"):
        (tmp_path / name).mkdir()
    page, mark = tmp_path / "docs" / "page.md", "<!-- begin: written by benchmarks/made.py -->\n<!-- end -->"
    page.write_text(f"# Page\n\n{mark}\n\nAfter\n", encoding="utf-8")
    asked, rows = [], {1: (2.0, 1.0, 4.0), 2: (9.0, 1.0, 2.0), 3: (3.0, 1.0, 3.0)}

    def analyse(kind, index):
        asked.append((kind, index))
        return row_of(index, *rows[index])

    study = Study("made", "page.md", {"one": 3, "other": 1}, analyse, coverage, lambda r: [str(r["one"]["held"])])
    study.main(["--kind", "one", "--sets", "2", "--pilot"])
    (file,) = (tmp_path / "build" / "made").iterdir()
    file.write_text(file.read_text(encoding="utf-8")[:-20], encoding="utf-8")  # cut off in its last row
    results = study.main([])
    assert asked == [("one", 1), ("one", 2), ("one", 2), ("one", 3), ("other", 1)]
    expected = {"sets": 3, "held": {"k": 2}, "explains": 2, "converged": 3, "verdicts": {"k": {"identified": 3}}}
    assert results["one"].items() >= expected.items()
    text = page.read_text(encoding="utf-8")
    assert "{'k': 2}" in text
    assert text.endswith("After\n")
    with pytest.raises(ValueError, match="not enough values"):
        write_between(page, "other.py", "")


def test_an_open_end_holds_every_truth():
    assert holds(row_of(1, 5.0, 1.0, 2.0)["known"]["k"], "ends")
    assert not holds(row_of(1, 0.5, 1.0, 2.0)["known"]["k"], "ends")


# ---- limits_hold


@pytest.mark.parametrize(("verdict", "held", "said"), [
    *(("weakly identified", *pair) for pair in [(91, "**too seldom**"), (92, "yes"), (98, "yes"), (99, "more often")]),
    *(("bounded below", *pair) for pair in [(92, "**too seldom**"), (93, "yes"), (100, "yes")]),
    ("no verdict", 10, "–"),
])  # fmt: skip
def test_what_is_wanted_of_a_class(verdict, held, said):
    assert limits_hold.finding({"joints": 100, "verdict": verdict, "held": held}) == said
    assert limits_hold.finding({"joints": 39, "verdict": verdict, "held": 0}) == "–"


# ---- interval_ends


def rows(seeds, stated, rng):
    """Ends of scatter 1 with this stated error."""
    whole = {"converged": True, "errors": {"k": [stated, stated]}}
    return [{"index": seed, "ends": {"k": rng.normal(size=2).tolist()}, **whole} for seed in range(seeds)]


def counted(seeds, stated, rng):
    return {"sets": seeds, **interval_ends.summary(rows(seeds, stated, rng))}


def test_the_ratio_is_scatter_over_stated_error():
    low, high = interval_ends.ratios(rows(4000, 0.5, np.random.default_rng(1)))["k"]
    assert (low, high) == (pytest.approx(2.0, rel=0.05), pytest.approx(2.0, rel=0.05))


def test_the_band_leaves_the_errors_that_are_right_and_fails_those_that_are_wrong():
    rng, allowed = np.random.default_rng(2), interval_ends.allowed
    right = {f"case {i}": counted(20, 1.0, rng) for i in range(18)}
    assert interval_ends.wrong(right) == []
    assert interval_ends.wrong(right | {"case 3": counted(20, 0.45, rng)})[0].startswith("case 3: ")
    assert interval_ends.wrong({name: counted(20, 1.4, rng) for name in right})[-1].startswith("all cases: ")
    assert interval_ends.wrong({"beam": right["case 1"] | {"not_converged": [4]}})[0].endswith("at seeds [4]")
    assert allowed(20)[0] < allowed(100)[0] < 0.8 < 1.25 < allowed(100)[1] < allowed(20)[1]


def test_a_shipped_case_is_measured():
    assert all(interval_ends.measure("two_storeys_shape", seed)["converged"] for seed in (1, 2, 3))
