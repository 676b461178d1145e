"""The study of printed ends around one joint, in small; and what has been published of it."""

import json

import pytest
from benchmarks import limits_hold

pytestmark = pytest.mark.docs


def row(index, **stiffness):
    return {"index": index, "converged": True, "explains": True, "seconds": 1.0, "stiffness": stiffness}


def of_class(verdict, truth, draws, printed, volume=False):
    return {"truth": truth, "verdict": verdict, "draws": draws, "printed": printed, "volume": volume}


def test_joints_scatter_around_their_centre_and_each_has_its_own_noise():
    cases = [limits_hold.case_of("stiff", index) for index in range(1, 4)]
    assert len({case.spec.data.noise.seed for case, _ in cases}) == 3
    for case, truth in cases:
        assert case.spec.data.truth.model_dump(exclude_none=True).items() >= truth.items()
        assert 0.3 < truth["k11"] / (5 * 5.05e9) < 3
        assert 0.7 < truth["k22"] / (5 * 1.52e6) < 1.4
        assert truth["k12"] ** 2 < truth["k11"] * truth["k22"]
    assert limits_hold.case_of("stiff", 1)[1] == cases[0][1] != limits_hold.case_of("soft", 1)[1]


def test_one_joint_is_analysed_and_kept(tmp_path, monkeypatch):
    kept = tmp_path / "paper.jsonl"
    first = limits_hold.outcomes("paper", 1, kept)
    _, truth = limits_hold.case_of("paper", 1)
    assert {name: one["truth"] for name, one in first[0]["stiffness"].items()} == truth
    for one in first[0]["stiffness"].values():
        for which, wider in (("draws", 1.0), ("printed", 1.0)):
            low, high = one[which]
            assert low is not None or high is not None
            assert wider * (low or 0) < 3 * one["truth"]
            assert 3 * (high or 1e12) > one["truth"]
        pairs = zip(one["draws"], one["printed"], (-1, 1), strict=True)
        assert all(drawn is printed is None or side * (printed - drawn) >= 0 for drawn, printed, side in pairs)
        assert one["verdict"] != "identified" or one["draws"] == one["printed"]
    monkeypatch.setattr(limits_hold, "analysed", lambda *_: pytest.fail("analysed again"))
    assert limits_hold.outcomes("paper", 1, kept) == first


def test_classes_are_counted_by_stiffness_and_verdict():
    held = of_class("weakly identified", 2.0, [1.0, 4.0], [1.0, 4.0])
    below = of_class("weakly identified", 0.5, [1.0, 4.0], [0.25, 4.0], volume=True)
    missed = of_class("weakly identified", 0.1, [1.0, 4.0], [0.25, 4.0])
    limit = of_class("bounded below", 2.0, [3.0, None], [1.0, None], volume=True)
    rows = [row(1, k11=held, k22=limit), row(2, k11=below, k22=limit), row(3, k11=missed, k22=held)]
    found = limits_hold.summary(rows)
    classes = {(one["stiffness"], one["verdict"]): one for one in found["classes"]}
    weak, bounded = classes["k11", "weakly identified"], classes["k22", "bounded below"]
    assert (weak["joints"], weak["held_by_draws"], weak["held"], weak["volume"]) == (3, 1, 2, 1)
    assert weak["width_ratio"] == pytest.approx(2.0)  # ln 16 over ln 4
    assert (bounded["joints"], bounded["held_by_draws"], bounded["held"], bounded["volume"]) == (2, 0, 2, 2)
    assert bounded["width_ratio"] is None
    assert "| k11 |" not in limits_hold.section({"paper": found})  # too few to be shown
    text = limits_hold.section({"paper": limits_hold.summary([row(i, k11=held, k22=limit) for i in range(10)])})
    assert "| k11 | weakly identified | 10 | 100.0 % (69.2 to 100.0) | – |" in text


@pytest.mark.parametrize(
    ("verdict", "held", "said"),
    [
        *(("weakly identified", held, said) for held, said in [
            (91, "**too seldom**"), (92, "yes"), (98, "yes"), (99, "more often")
        ]),
        *(("bounded below", held, said) for held, said in [(92, "**too seldom**"), (93, "yes"), (100, "yes")]),
        ("no verdict", 10, "–"),
    ],
)  # fmt: skip
def test_what_is_wanted_of_a_class(verdict, held, said):
    assert limits_hold.finding({"joints": 100, "verdict": verdict, "held": held}) == said
    assert limits_hold.finding({"joints": 39, "verdict": verdict, "held": 0}) == "–"


@pytest.mark.skipif(not limits_hold.SUMMARY.exists(), reason="`make science` has not been run")
def test_the_published_study_stands_on_its_page():
    found = json.loads(limits_hold.SUMMARY.read_text(encoding="utf-8"))
    assert limits_hold.section(found) in limits_hold.PAGE.read_text(encoding="utf-8")
