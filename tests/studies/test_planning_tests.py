"""Tests that a plan proposes: with quantities of their own, such as an error of an overhang."""

from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import Ports, receptance_model
from jointbayes.inference import JointPrior, Normal, Nuisance, ScaledNoise, Uniform
from jointbayes.posterior.first_look import FirstLook, FrfCandidate, WithOwn, fisher_information, own_of
from jointbayes.studies.planning.case_candidates import candidates_of
from jointbayes.studies.planning.make_plan import WithFurther
from jointbayes.studies.planning.plan_report import plan_lines
from tests.case.refusal_rows import parts_named
from tests.conftest import CLAMP, CONFIGS, PAIR, TABLE_3, cheap_text, pair_matrix
from tests.one_line import refused
from vibrecords import FrfData, FrfSet, RelativeNoise

LINES = np.arange(20.0, 2000.0, 10.0)
LAW = RelativeNoise(0.02, 0.01)
KNOWN = Normal(0.0, 0.002)
MODULUS = Nuisance("youngs_modulus", "GPa", 210.0, Normal(0.0, 0.02))
SCALE = Nuisance("noise_scale", "1", 1.0, Normal(0.0, 0.3))
MARGINALS = tuple(Uniform(np.log(k) - 3, np.log(k) + 3) for k in TABLE_3)


def beams(length):
    recipe = jb.BeamRecipe(
        length, jb.Section.circle(0.025), jb.BeamMaterial(2.1e11, 0.3, 7800.0), jb.ModalDamping((0.01,))
    )
    return jb.BeamFamily(recipe, {"youngs_modulus": (-0.12, 0.12), "length": (-0.012, 0.012)})


def measured(length, seed=None):
    ports = Ports(LINES, ("11:y",), ("11:y",))
    exact = receptance_model(beams(length), CLAMP, ports).receptance(pair_matrix(TABLE_3), np.ones((1, 2)))[0]
    rng, variance = np.random.default_rng(seed), LAW.variance(exact)
    white = 0 if seed is None else rng.standard_normal((*exact.shape, 2)) @ [1, 1j] / np.sqrt(2)
    return FrfData(FrfSet(LINES, exact + np.sqrt(variance) * white, ("11:y",), ("11:y",)), variance)


def length_of(name, mm):
    return Nuisance(name, "mm", mm, KNOWN)


def present(noise=None):
    nuisances = (MODULUS, length_of("length", 383.0), *(() if noise is None else (SCALE,)))
    return jb.Problem(
        structure=beams(0.383),
        joint=CLAMP,
        data=measured(0.383, 1),
        prior=JointPrior(PAIR, MARGINALS, nuisances),
        noise=noise,
    )


def proposed(name, length):
    own = (length_of(f"{name}.length", 1000 * length),)
    ports = Ports(LINES, ("11:y",), ("11:y",))
    return FrfCandidate(
        name=name,
        words=name,
        structure=beams(length),
        ports=ports,
        quantity="receptance",
        law=LAW,
        test=name,
        own_nuisances=own,
    )


SHORT, TINY = proposed("short", 0.2), proposed("tiny", 0.1)


def together(problem, *lengths):
    """The same tests as tests of one problem, those proposed without errors."""
    tests = [jb.Test("long", problem.test.structure, CLAMP, problem.test.data, problem.test.noise)]
    tests += [jb.Test(name, beams(length), CLAMP, measured(length)) for name, length in lengths]
    own = tuple(length_of(f"{name}.length", 1000 * length) for name, length in lengths)
    known = problem.prior.nuisances
    return jb.Problem(tests=tests, prior=replace(problem.prior, nuisances=(*known[:2], *own, *known[2:])))


def test_a_linearised_figure_of_proposed_tests_is_that_of_a_problem_of_several():
    problem = present()
    theta = np.concatenate([np.log(TABLE_3), [0.0, 0.0]])
    look = FirstLook(problem, {"short": SHORT, "tiny": TINY}, "k12", theta[None])
    for names, lengths in ((("short",), [("short", 0.2)]), (("short", "tiny"), [("short", 0.2), ("tiny", 0.1)])):
        several = together(problem, *lengths)
        expected = fisher_information(several, np.concatenate([theta, np.zeros(len(lengths))])).sd()["k12"]
        assert look.linearised(names).median == pytest.approx(expected, rel=1e-6)


def test_the_density_of_present_and_proposed_data_is_that_of_a_problem_of_several():
    problem = present(ScaledNoise())
    whole = WithOwn(problem, own_of((SHORT, TINY)))
    assert whole.problem.names[-4:] == ("length", "short.length", "tiny.length", "noise_scale")
    truth = np.concatenate([np.log(TABLE_3), [0.0, 0.0, 0.0, 0.0, 0.0]])
    further = [one.problem(whole.problem, truth) for one in (SHORT, TINY)]
    density = WithFurther(whole.log_density, further)
    tests = [
        jb.Test("long", problem.test.structure, CLAMP, problem.test.data, problem.test.noise),
        *(one.test for one in further),
    ]
    several = jb.Problem(tests=tests, prior=whole.problem.prior)
    theta = truth + 0.001 * np.random.default_rng(4).standard_normal((5, truth.size))
    np.testing.assert_allclose(density(theta), several.log_posterior(theta), rtol=1e-11)
    # an overhang of its own moves only its own data
    alone = further[0].log_posterior.log_likelihood(theta + 1e-3 * (np.array(whole.problem.names) == "tiny.length"))
    np.testing.assert_array_equal(alone, further[0].log_posterior.log_likelihood(theta))


def test_draws_of_what_only_a_proposed_test_has_are_those_of_its_prior():
    problem = present()
    whole = WithOwn(problem, own_of((SHORT,)))
    known = np.tile(np.concatenate([np.log(TABLE_3), [0.01, -0.001]]), (4000, 1))
    drawn = whole.drawn(known, np.random.default_rng(1))
    np.testing.assert_array_equal(drawn[:, whole.present_columns], known)
    own = drawn[:, whole.own_columns[0]]
    assert (own.mean(), own.std()) == (pytest.approx(0.0, abs=1e-4), pytest.approx(0.002, rel=0.05))
    np.testing.assert_array_equal(WithOwn(problem, ()).drawn(known, np.random.default_rng(1)), known)


PLANNED, NOISES, SPRINGS = parts_named("planning_tests").values()


def planned_case(text=PLANNED):
    return jb.case_from_text("planned", cheap_text() + text)


def test_a_case_proposes_tests_with_what_is_different_and_what_is_their_own():
    case = planned_case()
    by_name = {one.name: one for one in candidates_of(case)}
    assert list(by_name) == ["3:y", "4 × averages", "short", "heavy"]
    short, heavy = by_name["short"], by_name["heavy"]
    assert (short.words, (short.position, short.test)) == ("the test short (length_mm = 200.0)", ("200 mm", "short"))
    assert [(one.name, one.nominal, one.prior.sd) for one in short.own_nuisances] == [
        ("short.length", 200.0, 0.1 / 200)
    ]
    assert [one.name for one in heavy.own_nuisances] == ["heavy.density", "heavy.length"]
    assert heavy.words == 'the test heavy (accelerometer_mass_g = 2000.0, outputs = ["5:y", "2:y"])'
    assert heavy.ports.outputs == ("5:y", "2:y")
    # the structure is that of a case with this table, 2 kg at each measured translation
    recipe = heavy.structure.recipe
    assert (recipe.accelerometer_mass, recipe.accelerometer_dofs) == (2.0, ("5:y", "2:y"))
    whole = WithOwn(case.problem, own_of((short,)))
    assert whole.problem.names == ("k11", "k12", "k22", "length", "length_offset", "short.length")


def test_a_proposed_test_is_what_the_same_table_would_be_as_a_test():
    case = planned_case()
    text = cheap_text() + PLANNED.split("[plan]")[0] + "[tests.now]\n[tests.short.structure]\nlength_mm = 200.0\n"
    several = jb.case_from_text("several", text)
    short = next(one for one in candidates_of(case) if one.name == "short")
    whole = WithOwn(case.problem, own_of((short,)))
    theta = np.concatenate([np.log(TABLE_3), [0.0, 0.001, 0.0004]])
    proposed = short.problem(whole.problem, theta)
    part = several.problem.part("short")
    names = [{"length": "now.length"}.get(name, name) for name in proposed.names]
    at = theta[[names.index(name) for name in several.problem.names]]
    exact = proposed.test.data.frf.values
    found = part.test.receptance_model(short.ports).receptance(
        part.prior.matrix(at), part.structural(part.prior.factors(at))
    )[0]
    np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-12 * np.abs(exact).max())


def test_candidates_on_several_present_tests_are_named_after_them():
    text = PLANNED.replace(
        "[plan.tests.heavy]", "[tests.long]\n[tests.brief.structure]\nlength_mm = 150.0\n[plan.tests.heavy]"
    )
    text = text.replace('together = [["short", "3:y"]]', 'together = [["short", "long 3:y"]]')
    case = planned_case(text)
    found = {one.name: one for one in candidates_of(case)}
    assert list(found) == ["long 3:y", "long 4 × averages", "brief 3:y", "brief 4 × averages", "short", "heavy"]
    assert found["brief 3:y"].words.endswith("(3:y, 75 mm) in test brief")
    theta = case.problem.prior.mean.copy()
    theta[:3] = np.log(TABLE_3)
    look = FirstLook(case.problem, found, "k12", theta[None])
    short = "[plan.tests.short.structure]\nlength_mm = 200.0\n"
    several = planned_case(text.replace(short, "") + short.replace("plan.", ""))
    assert several.problem.names == (*case.problem.names, "short.length")
    expected = fisher_information(replace_data(several, theta), np.append(theta, 0.0))
    assert look.linearised(("short",)).median == pytest.approx(expected.sd()["k12"], rel=0.02)


def replace_data(case, theta):
    """Exact data for the last test, the others as they are."""
    *known, last = case.problem.tests
    part = case.problem.part(last.name)
    point = np.append(theta, 0.0)
    frf = last.data.frf
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    values = part.test.receptance_model(ports).receptance(
        part.prior.matrix(point), part.structural(part.prior.factors(point))
    )[0]
    law = RelativeNoise(case.spec.data.noise.relative, case.spec.data.noise.floor)
    exact = FrfData(replace(frf, values=values), law.variance(values))
    return replace(case.problem, tests=(*known, replace(last, data=exact)))


@pytest.mark.whole
def test_a_plan_simulates_proposed_tests_and_sets_of_them(cheap_posterior):
    """The cheap posterior knows its beam exactly; a test has an own density and overhang beside it."""
    text = PLANNED.split("[plan]")[1].replace("[plan.tests.heavy]", "[plan.tests.heavy]\nuncertain.length.sd_mm = 0.1")
    case = planned_case(f"[plan]{text}[plan.tests.short.uncertain.length]\nsd_mm = 0.1\n")
    plan = jb.plan(case, cheap_posterior, seed=3, simulations=2)
    names = {one.names for one in plan.measurements}
    assert names == {("3:y",), ("4 × averages",), ("short",), ("heavy",), ("3:y", "short")}
    assert all(one.ranked for one in plan.measurements)
    by_names = {one.names: one.sd_after for one in plan.measurements}
    assert by_names["3:y", "short"] < by_names["short",]
    assert "3:y + short" in "\n".join(plan_lines(plan))
    assert "the test heavy (accelerometer_mass_g" in " ".join(one.words for one in plan.measurements)


@pytest.mark.whole
def test_the_first_look_ranks_the_tests_of_the_shipped_case_as_the_table_does():
    """physics: with mid-span and 150 mm, with mid-span, with four overhangs, with 200 mm, with 2 kg at the tip."""
    case = jb.load_case(CONFIGS / "next_setup.toml")
    found = {one.name: one for one in candidates_of(case)}
    others = np.zeros(len(case.problem.names) - 3)
    truth = np.concatenate([case.problem.parametrisation.coordinates(TABLE_3), others])
    order = [("6:y", "mm150"), ("6:y",), ("mm300", "mm200", "mm150", "mm100"), ("mm200",), ("heavy",)]
    for quantity in ("k11", "k12", "k22"):
        look = FirstLook(case.problem, found, quantity, truth[None])
        sds = [look.linearised(names).median for names in order]
        assert sds == sorted(sds)
        assert sds[1] < 0.7 * sds[2]
        assert sds[3] < 0.9 * sds[4]


def test_a_stiffness_that_the_problem_lacks_is_told_before_anything_is_sampled(monkeypatch):
    case = planned_case('[plan]\nparameter = "k12"\noutputs = ["3:y"]\n')
    monkeypatch.setattr("jointbayes.studies.planning.make_plan.sample", lambda *_: pytest.fail("sampled"))
    refused(
        lambda: jb.plan(replace(case, problem=jb.case_from_text("springs", SPRINGS.replace(",\n", ", ")).problem)),
        jb.CaseError,
        r':\d+: plan.parameter: found "k12"; expected .*"ky" or "krz"',
    )


def test_the_noise_of_a_proposed_test_is_that_of_its_own_tables():
    """The first present test has a noise of its own; what is proposed has that of the file, shared with the other."""
    case = planned_case(NOISES)
    short = next(one for one in candidates_of(case) if one.name == "short")
    theta = np.concatenate([np.log(TABLE_3), [np.log(3.0)]])
    assert case.problem.names[-1] == "noise_scale"
    there = short.problem(case.problem, theta, np.random.default_rng(1))
    exact = short.problem(case.problem, theta)
    assert isinstance(there.test.noise, ScaledNoise)
    error = (there.test.data.frf.values - exact.test.data.frf.values) / np.sqrt(there.test.data.variance)
    assert np.sqrt((np.abs(error) ** 2).mean()) == pytest.approx(3.0, rel=0.1)
    # its density knows the scale
    wrong = theta - np.log(3.0) * (np.arange(len(theta)) == len(theta) - 1)
    assert there.log_posterior.log_likelihood(theta[None]) > there.log_posterior.log_likelihood(wrong[None]) + 100


@pytest.mark.parametrize("name", ["measured_stations", "measured_rotation"])
def test_a_test_proposed_beside_measured_data_has_the_tails_of_their_estimated_variance(name):
    path = CONFIGS / f"{name}.toml"
    text = path.read_text(encoding="utf-8") + "\n[plan.tests.short.structure]\nlength_mm = 300.0\n"
    case = jb.case_from_text(name, text, directory=CONFIGS)
    (short,) = (one for one in candidates_of(case) if one.test == "short")
    assert isinstance(case.problem.test.noise, jb.StudentNoise)
    assert short.noise == case.problem.test.noise
