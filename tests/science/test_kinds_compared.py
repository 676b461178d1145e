"""Kinds of joint asked for by name and compared by evidence: springs or coupled, damped or not, on data of each."""

import pytest

import jointbayes as jb
from tests.case.refusal_rows import parts_named

pytestmark = pytest.mark.science

TEXT = parts_named("rooms")["science/kinds_compared text"]
SPRINGS, FULL = "ky = 5e7\nkrz = 6e4\n", "k11 = 5e7\nk12 = 1.2e6\nk22 = 6e4\n"


def compared(truth, *hypotheses, kind="springs"):
    names = ", ".join(f'"{name}"' for name in hypotheses)
    case = jb.case_from_text("case", TEXT.replace("KIND", kind).replace("HYPOTHESES", names) + truth)
    found = jb.compare([case], seed=1)
    return found, {candidate.hypothesis: candidate for candidate in found.candidates}


def test_data_of_damped_springs_speak_for_them_and_against_a_rigid_joint_and_one_without_damping():
    found, by_name = compared(f"{SPRINGS}eta = 0.1\n", "rigid", "springs", "full", "undamped springs", "undamped full")
    assert found.best.hypothesis == "springs"
    assert by_name["springs"].names == ("ky", "krz", "eta")
    assert by_name["full"].names == ("k11", "k22", "rho12", "eta")
    assert by_name["undamped full"].names == ("k11", "k22", "rho12")
    assert found.two_log_b(by_name["full"]) > 2  # a coupling that is not needed costs its prior's width
    for name in ("rigid", "undamped springs", "undamped full"):
        assert found.words(by_name[name]) == "very strong"


def test_damping_that_the_data_do_not_show_is_not_needed():
    found, by_name = compared(f"{SPRINGS}eta = 1.1e-4\n", "springs", "undamped springs")
    assert found.best.hypothesis == "undamped springs" or found.two_log_b(by_name["undamped springs"]) < 2


def test_data_of_a_coupled_joint_speak_against_springs():
    found, by_name = compared(f"{FULL}eta = 0.1\n", "springs", "coupled", "full", kind="full")
    assert found.words(by_name["springs"]) == "very strong"
    # of a translation and a rotation the two are the same joint
    both = [by_name[name].evidence for name in ("coupled", "full")]
    assert both[0].log_z == pytest.approx(both[1].log_z, abs=4 * (both[0].error + both[1].error))


def test_a_joint_of_one_motion_cannot_be_coupled():
    text = TEXT.replace("KIND", "springs").replace("HYPOTHESES", '"coupled"').replace(', "1:rz"], loss', "], loss")
    with pytest.raises(jb.CaseError, match="hypothesis coupled of a joint in y; expected"):
        jb.compare([jb.case_from_text("case", f"{text}ky = 5e7\neta = 0.1\n")])
