"""What tests of a case share and what is each one's own, by small changes that would give or take one too many."""

import pytest

import jointbayes as jb
from jointbayes.case.case_text import case_text, drop_inherited, texts_of_tests
from jointbayes.case.parse import parse_tests
from tests.case.test_bodies import TEXT as MEASURED
from tests.case.test_several_tests import BASE, HEARD, TWO, built
from tests.case.test_structures import SPINDLE, text_of
from tests.one_line import refused

LONG_AND_HEARD = "\n[tests.long]\n" + HEARD
PEAKS = '[data]\nkind = "natural_frequencies"\nfrequencies_hz = [121.5, 752.5]\nsd_relative = 0.0\nsd_hz = 0.5\n'
HEARD_ALL = BASE.split("[data]")[0] + PEAKS
INEXACT = "[uncertain.model_error]\nfrequency_error = 0.01\n"


def fault(text):
    """The one line by which a case is refused."""
    return refused(lambda: parse_tests(text, "case"), jb.CaseError)


def test_a_quantity_of_a_body_that_one_test_states_is_its_own():
    text = text_of(SPINDLE, "tool.tip:y", "tool.tip:y")
    specs = parse_tests(text + "[tests.a]\n[tests.b.uncertain.bodies.tool.density]\nsd_percent = 1.0\n")
    assert {name: spec.uncertain.given["tool.density"].own for name, spec in specs.items()} == {"a": False, "b": True}
    assert not specs["b"].uncertain.given["youngs_modulus"].own


def test_priors_that_tests_do_not_share_may_differ():
    each = "[tests.a.uncertain.density]\nsd_percent = 3.0\n[tests.b.uncertain.density]\nsd_percent = 2.0\n"
    assert built(each).problem.names[3:] == ("a.density", "b.density")
    scales = "[noise]\nscale = 'sampled'\n[tests.a.noise]\n[tests.b.noise]\nscale_high_factor = 3.0\n"
    assert built(scales).problem.names[3:] == ("a.noise_scale", "b.noise_scale")
    errors = parse_tests(HEARD_ALL + INEXACT + "[tests.a]\n[tests.b.uncertain.model_error]\nfrequency_error = 0.02\n")
    assert {name: spec.uncertain.model_error.frequency_error for name, spec in errors.items()} == {"a": 0.01, "b": 0.02}


def test_what_a_test_itself_states_and_cannot_have_is_told():
    """Only what the file says for all is left out of it."""
    assert ": tests.heard.uncertain.gain: " in fault(
        BASE + LONG_AND_HEARD + "[tests.heard.uncertain.gain]\nsd_percent = 1.0\n"
    )
    assert parse_tests(BASE + "[uncertain.gain]\nsd_percent = 1.0\n" + LONG_AND_HEARD)["heard"].uncertain.given == {}


def test_the_first_guess_of_a_shared_joint_is_stated_for_all():
    line = fault(BASE + TWO + "[tests.long.joint]\ninitial = { k11 = 1e8, k12 = 0.0, k22 = 1e6 }\n")
    assert ": tests.long.joint.initial: found it for one test, of a joint that all tests share" in line
    own = parse_tests(BASE + TWO + "[tests.long.joint]\nown = true\ninitial = { k11 = 1e8, k12 = 0.0, k22 = 1e6 }\n")
    assert own["long"].joint.initial.k11 == 1e8


def test_the_prior_of_a_shared_joint_with_a_name_is_stated_for_all():
    joints = HEARD_ALL.split("[prior]")[0].replace("[joint]", "[joints.left]") + PEAKS
    prior = "distribution = 'log_uniform'\nlow = 1e8\nhigh = 1e12\n"
    each = "".join(f"[tests.short.joints.left.prior.k{n}]\n{prior}" for n in (11, 12, 22))
    assert ": tests.short.joints.left.prior: found it for one test" in fault(f"{joints}[tests.long]\n{each}")


@pytest.mark.parametrize(("keys", "key", "what"), [
    ("viscous = ['k11']\n", "viscous", "viscous"),
    ("loss_factors = ['k11']\n", "loss_factors", "loss_factors"),
    ("dofs = ['1:z', '1:ry']\n", "dofs", "directions"),
    ("parametrisation = 'elastic_centre'\n", "parametrisation", "parametrisation"),
])  # fmt: skip
def test_joints_that_share_their_quantities_are_alike(keys, key, what):
    base = HEARD_ALL.replace("length_mm", "dofs_per_node = 5\nlength_mm") if what == "directions" else HEARD_ALL
    base = base.split("[prior]")[0] + PEAKS
    line = fault(f"{base}[tests.long]\n[tests.short.joint]\n{keys}")
    assert f": tests.short.joint.{key}: found another {what} than in test long, with which it shares" in line
    assert parse_tests(f"{base}[tests.long]\n[tests.short.joint]\nown = true\n{keys}")


def test_one_measurement_of_a_body_may_stand_in_several_tests_where_its_noise_is_ignored():
    both = "[tests.a]\n[tests.b]\n"
    assert ": bodies.spindle: found spindle.uff in tests a and b" in fault(MEASURED + both)
    ignored = MEASURED.replace('file = "spindle.uff"', 'file = "spindle.uff"\npropagate = false')
    assert list(parse_tests(ignored + both)) == ["a", "b"]


def test_unknowns_are_in_one_order_those_of_the_data_behind_those_of_the_structure():
    more = "[uncertain.gain]\nsd_percent = 1.0\n[noise]\nscale = 'sampled'\n[tests.a]\n"
    more += "[tests.b.uncertain.gain]\nsd_percent = 2.0\n[tests.b.uncertain.density]\nsd_percent = 3.0\n"
    assert built(more).problem.names[3:] == ("b.density", "gain", "b.gain", "noise_scale")


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
    alone = tests.replace("uncertain.length_offset", "tests.free.uncertain.length_offset")
    assert ": tests.free.uncertain.length_offset: found it in a test with joined = false" in fault(BASE + alone)


def test_of_the_quantities_of_bodies_only_that_which_a_test_cannot_have_is_left_out():
    text = text_of(SPINDLE, "tool.tip:y", "tool.tip:y") + "[uncertain.bodies.holder.density]\nsd_percent = 2.0\n"
    key = ("uncertain", "bodies", "tool", "density")
    found, rest = drop_inherited(texts_of_tests(case_text(text + "[tests.a]\n", "case"))["a"], key)
    assert (found, rest.data["uncertain"]["bodies"]) == (key, {"tool": {}, "holder": {"density": {"sd_percent": 2.0}}})
    assert "youngs_modulus" in rest.data["uncertain"]
