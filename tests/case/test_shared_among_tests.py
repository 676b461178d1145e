"""What tests of a case share and what is each one's own, by small changes that would give or take one too many."""

import pytest

import jointbayes as jb
from jointbayes.case.case_text import case_text, drop_inherited, texts_of_tests
from jointbayes.case.parse import parse_tests
from tests.case.test_bodies import TEXT as MEASURED
from tests.case.test_several_tests import BASE, HEARD, TWO, built
from tests.case.test_structures import SPINDLE, text_of

LONG_AND_HEARD = "\n[tests.long]\n" + HEARD
PEAKS = '[data]\nkind = "natural_frequencies"\nfrequencies_hz = [121.5, 752.5]\nsd_relative = 0.0\nsd_hz = 0.5\n'
HEARD_ALL = BASE.split("[data]")[0] + PEAKS
INEXACT = "[uncertain.model_error]\nfrequency_error = 0.01\n"


def test_a_quantity_of_a_body_that_one_test_states_is_its_own():
    text = text_of(SPINDLE, "tool.tip:y", "tool.tip:y")
    specs = parse_tests(text + "[tests.a]\n[tests.b.uncertain.bodies.tool.density]\nsd_percent = 1.0\n")
    assert {name: spec.uncertain.given["tool.density"].own for name, spec in specs.items()} == {"a": False, "b": True}
    assert not specs["b"].uncertain.given["youngs_modulus"].own


def test_what_the_file_says_for_all_is_left_out_of_a_test_that_cannot_have_it():
    assert parse_tests(BASE + "[uncertain.gain]\nsd_percent = 1.0\n" + LONG_AND_HEARD)["heard"].uncertain.given == {}


def test_the_first_guess_of_a_tests_own_joint_is_stated_for_it():
    own = parse_tests(BASE + TWO + "[tests.long.joint]\nown = true\ninitial = { k11 = 1e8, k12 = 0.0, k22 = 1e6 }\n")
    assert own["long"].joint.initial.k11 == 1e8


@pytest.mark.parametrize("keys", [
    "viscous = ['k11']", "loss_factors = ['k11']", "dofs = ['1:z', '1:ry']", "parametrisation = 'elastic_centre'",
])  # fmt: skip
def test_joints_of_their_own_need_not_be_alike(keys):
    base = HEARD_ALL.replace("length_mm", "dofs_per_node = 5\nlength_mm") if "1:z" in keys else HEARD_ALL
    base = base.split("[prior]")[0] + PEAKS
    assert parse_tests(f"{base}[tests.long]\n[tests.short.joint]\nown = true\n{keys}\n")


def test_one_measurement_of_a_body_may_stand_in_several_tests_where_its_noise_is_ignored():
    ignored = MEASURED.replace('file = "spindle.uff"', 'file = "spindle.uff"\npropagate = false')
    assert list(parse_tests(ignored + "[tests.a]\n[tests.b]\n")) == ["a", "b"]


def test_each_test_has_the_distribution_of_its_residuals_and_the_guess_of_all():
    guess = BASE.replace("[joint]", "[joint]\ninitial = { k11 = 2e8, k12 = 0.0, k22 = 3e6 }")
    more = "[tests.a]\n[tests.b.noise]\ndistribution = 'student_t'\ndof = 5.0\n"
    problem = built(more, guess).problem
    assert [isinstance(one.noise, jb.StudentNoise) for one in problem.tests] == [False, True]
    assert problem.first_guess.tolist() == [2e8, 0.0, 3e6]


def test_the_error_of_a_clamps_edge_leaves_a_free_test_as_it_is():
    """It moved the free bar as well, and k22 came out at 1.24 in place of 1.52, and "identified"."""
    offset = "[uncertain.length_offset]\nsd_mm = 0.5\n"
    tests = f"[tests.free]\njoined = false\n[tests.long]\n[uncertain.youngs_modulus]\nsd_percent = 1.0\n{offset}"
    free, clamped = built(tests).problem.tests
    assert free.structures.names == ("youngs_modulus",)
    assert clamped.structures.names == ("youngs_modulus", "length_offset")


def test_of_the_quantities_of_bodies_only_that_which_a_test_cannot_have_is_left_out():
    text = text_of(SPINDLE, "tool.tip:y", "tool.tip:y") + "[uncertain.bodies.holder.density]\nsd_percent = 2.0\n"
    key = ("uncertain", "bodies", "tool", "density")
    found, rest = drop_inherited(texts_of_tests(case_text(text + "[tests.a]\n", "case"))["a"], key)
    assert (found, rest.data["uncertain"]["bodies"]) == (key, {"tool": {}, "holder": {"density": {"sd_percent": 2.0}}})
    assert "youngs_modulus" in rest.data["uncertain"]
