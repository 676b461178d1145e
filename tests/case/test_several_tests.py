"""Several tests in one case file: their tables, what they share, and what is wrong between them."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jointbayes as jb
from jointbayes.case.parse import parse_case, parse_tests
from tests.case.refusal_rows import case_text_named, parts_named
from tests.conftest import CLAMP, PAIR, TABLE_3, pair_matrix
from tests.one_line import refused

BASE = case_text_named("tests")
TWO, HEARD, CLAMP_EDGE, OTHERS, _ = parts_named("several_tests").values()
FREE = parts_named("free_structure")["free"]


def built(more, base=BASE):
    return jb.case_from_text("case", base + more)


def beam(length, names):
    recipe = jb.BeamRecipe(
        length, jb.Section.circle(0.025), jb.BeamMaterial(2.1e11, 0.3, 7800.0), jb.ModalDamping((0.01,))
    )
    return jb.BeamFamily(recipe, names)


def test_a_case_of_two_tests_is_the_problem_that_one_would_write_by_hand():
    case = built(CLAMP_EDGE + TWO)
    assert [part.test.name for part in case.problem.parts] == ["long", "short"]
    known = (
        jb.Nuisance("youngs_modulus", "GPa", 210.0, jb.Normal(0.0, 0.02)),
        jb.Nuisance("long.length", "mm", 383.0, jb.Normal(0.0, 0.1 / 383)),
        jb.Nuisance("length_offset", "mm", 1000.0, jb.Normal(0.0, 0.0019)),
        jb.Nuisance("short.length", "mm", 200.0, jb.Normal(0.0, 0.1 / 200)),
    )
    ends = [(1e8, 1e12), (1e5, 1e9), (1e4, 1e8)]
    prior = jb.JointPrior(jb.LogStiffness(), tuple(jb.Uniform(*np.log(pair)) for pair in ends), known)
    tests = []
    for part, (name, length) in zip(case.problem.parts, {"long": 0.383, "short": 0.2}.items(), strict=True):
        own = {n.name.removeprefix(f"{name}."): n.range for n in known if "." not in n.name or n.name.startswith(name)}
        tests.append(jb.Test(name, beam(length, own), CLAMP, part.test.data))
    by_hand = jb.Problem(tests=tests, prior=prior)
    assert case.problem.names == by_hand.names
    rng = np.random.default_rng(1)
    theta = np.concatenate([np.log(TABLE_3), np.zeros(4)]) + 0.5 * by_hand.prior.sd * rng.normal(size=(5, 7)) * (
        [0.01] * 3 + [1.0] * 4
    )
    assert_array_equal(case.problem.log_posterior(theta), by_hand.log_posterior(theta))
    assert [part.test.data.frf.outputs for part in case.problem.parts] == [("11:y",), ("11:y", "6:y")]


def test_the_order_of_tables_and_what_a_test_replaces_are_those_of_extends():
    first, second = parse_tests(BASE + TWO).values()
    assert (first.structure.length_mm, second.structure.length_mm) == (383.0, 200.0)
    assert (second.structure.section, second.data.noise) == (first.structure.section, first.data.noise)
    assert parse_case(BASE + TWO) == first


SCALED, INTEGRATED = (f"[noise]\nscale = '{scale}'\n" for scale in ("sampled", "integrated"))
DENSITIES = "[tests.a.uncertain.density]\nsd_percent = 3.0\n[tests.b.uncertain.density]\nsd_percent = 2.0\n"


@pytest.mark.parametrize(("more", "names"), [
    (TWO + OTHERS + HEARD, "gain"),  # natural frequencies depend on none: what is uncertain in the file is the others'
    (SCALED + TWO, "noise_scale"), (SCALED + "own = true\n" + TWO, "long.noise_scale short.noise_scale"),
    (TWO + "[tests.short.noise]\nscale = 'sampled'\n", "short.noise_scale"),
    (SCALED + "[tests.a.noise]\n[tests.b.noise]\nscale_high_factor = 3.0\n", "a.noise_scale b.noise_scale"),
    (INTEGRATED + "own = true\n" + TWO, ""), (INTEGRATED + "[tests.alone]\n", ""),
    ("[tests.long]\n[tests.short.noise]\nscale = 'integrated'\n", ""), (DENSITIES, "a.density b.density"),
    ("[tests.calm]\n[tests.loud.joint]\nown = true\n[tests.loud.data.truth]\nk22 = 1e6\n",
     "loud.k11 loud.k12 loud.k22"),
    # those of the data stand behind those of the structure
    ("[uncertain.gain]\nsd_percent = 1.0\n" + SCALED + "[tests.a]\n[tests.b.uncertain.gain]\nsd_percent = 2.0\n"
     "[tests.b.uncertain.density]\nsd_percent = 3.0\n", "b.density gain b.gain noise_scale"),
    (FREE + "[tests.a]\n[tests.b]\n", ""),
])  # fmt: skip
def test_unknowns_are_shared_or_of_one_test_in_one_order(more, names):
    problem = built(more).problem
    assert problem.names == (*PAIR.names, *names.split())
    assert np.isfinite(problem.log_posterior(problem.prior.mean[None])).all() or "k22 = 1e6" in more


@pytest.mark.parametrize(("more", "names"), [
    (CLAMP_EDGE + TWO, "youngs_modulus density long.length length_offset damping_ratio short.length"),
    (FREE + "[tests.clamped]\n", "youngs_modulus density length damping_ratio"),
])  # fmt: skip
def test_what_a_workshop_leaves_uncertain_is_that_of_every_test(more, names):
    problem = built(more).workshop_problem
    assert problem.names == (*PAIR.names, *names.split())
    theta = np.concatenate([np.log(TABLE_3), np.zeros(len(problem.names) - 3)])
    assert np.isfinite(problem.log_posterior(theta)).all()


def test_each_test_has_noise_of_its_own_whatever_others_there_are():
    same = built("[tests.one]\n[tests.two]\n[tests.three]\n").problem.parts
    values = [part.test.data.frf.values for part in same]
    exact = same[0].test.receptance_model(jb.Ports(same[0].test.data.frf.frequency_hz, ("11:y",), ("11:y",)))
    true = exact.receptance(pair_matrix(TABLE_3)[None])[0]
    noise = [(value - true) / np.sqrt(part.test.data.variance) for value, part in zip(values, same, strict=True)]
    for a, b in ((0, 1), (0, 2), (1, 2)):
        correlation = abs(np.vdot(noise[a], noise[b])) / np.linalg.norm(noise[a]) / np.linalg.norm(noise[b])
        assert correlation < 0.4  # of 50 lines: 0.14 typically
    (again,) = built("[tests.two]\n").problem.parts
    assert_array_equal(again.test.data.frf.values, values[1])


def test_a_joint_of_its_own_has_quantities_with_the_name_of_the_test():
    every = built("[tests.calm]\n[tests.loud]\n", BASE.replace("[joint]", "[joint]\nown = true"))
    assert every.problem.parametrisation.stiffness_names[::3] == ("calm.k11", "loud.k11")
    assert not every.warnings
    far = built("[tests.calm]\n[tests.loud.data.truth]\nk22 = 1e9\n", BASE.replace("[joint]", "[joint]\nown = true"))
    (warning,) = far.warnings
    assert str(warning).startswith("tests.loud.data.truth.k22: found a truth with loud.k22 = 1e+09")
    assert "widen [prior.k22]" in str(warning)


def test_named_joints_of_their_own_share_within_their_test():
    joints = BASE.replace("[joint]", "[joints.left]").split("[prior]")[0]
    joints += '[joints.right]\ndofs = ["11:y", "11:rz"]\nshared = "left"\n'
    data = "[data]" + BASE.split("[data]")[1].replace('"11:y"', '"6:y"')
    data = data.replace("truth = {", "truth = {stiffness = {left = {").replace("1.52e6}", "1.52e6}}}")
    case = jb.case_from_text("case", joints + data + "[tests.calm]\n[tests.loud.joints.left]\nown = true\n")
    assert case.problem.parametrisation.stiffness_names[::3] == ("left.k11", "loud.left.k11")
    k = case.problem.prior.matrix(np.log(np.concatenate([TABLE_3, 0.5 * TABLE_3]))).stiffness
    for row, factor in enumerate((1.0, 1.0, 0.5, 0.5)):
        block = slice(2 * row, 2 * row + 2)
        assert_allclose(k[block, block], factor * pair_matrix(TABLE_3))


def test_a_factor_that_tests_share_on_other_values_is_told_as_a_factor():
    (length,) = built("[uncertain.length]\nsd_percent = 0.5\n" + TWO).problem.prior.nuisances
    assert (length.name, length.unit, length.nominal) == ("length", "× stated", 1.0)
    (modulus,) = built("[uncertain.youngs_modulus]\nsd_percent = 2.0\n" + TWO).problem.prior.nuisances
    assert (modulus.unit, modulus.nominal) == ("GPa", 210.0)


def test_a_case_with_tests_may_be_built_on_another(tmp_path):
    (tmp_path / "base.toml").write_text(BASE + TWO)
    text = 'extends = "base.toml"\n[tests.mid.structure]\nlength_mm = 300.0\n'
    (tmp_path / "case.toml").write_text(text)
    case = jb.load_case(tmp_path / "case.toml")
    lengths = {one.name: one.spec.structure.length_mm for one in case.tests}
    assert lengths == {"long": 383.0, "short": 200.0, "mid": 300.0}
    assert [part.test.data.frf.outputs for part in case.problem.parts] == [("11:y",), ("11:y", "6:y"), ("11:y",)]
    whole = jb.case_from_text("case", case.text)
    theta = np.log(TABLE_3)[None]
    assert_array_equal(whole.problem.log_posterior(theta), case.problem.log_posterior(theta))


def test_damping_of_a_workshop_is_one_factor_that_every_test_can_have():
    """Of ratios of 0.01 and 0.3 the largest bounds it: three times 0.3 is below the critical damping."""
    problem = built("[tests.long]\n[tests.damped.structure.damping]\nratio = 0.3\n").workshop_problem
    (factor,) = (one for one in problem.prior.nuisances if one.name.endswith("damping_ratio"))
    assert_allclose(np.exp(factor.range), [0.1, 3.0], rtol=1e-6)
    assert np.isfinite(problem.log_posterior(problem.prior.mean[None])).all()


def test_older_files_that_call_tests_set_ups_are_read(tmp_path):
    """So are the lists and tables that name them, and what a case lays over the one that it builds on."""
    today = BASE + TWO + '\n[left_out]\ntests = ["short"]\n'
    older = re.sub(r"(?<=[\[.])tests(?=[.\]])|(?<=\n)tests(?= =)", "setups", today)
    assert (older.count("setups"), parse_tests(older)) == (4, parse_tests(today))
    (tmp_path / "older.toml").write_text(older, encoding="utf-8")
    (tmp_path / "over.toml").write_text(
        'extends = "older.toml"\n[setups.third.structure]\nlength_mm = 300.0\n', encoding="utf-8"
    )
    assert [test.name for test in jb.load_case(tmp_path / "over.toml").problem.tests] == ["long", "third"]
    with pytest.raises(jb.CaseError, match=rf"^case:{older.count(chr(10)) + 1}: tests.short.nonsense: "):
        parse_tests(older + "[setups.short.nonsense]\n")
    refused(lambda: parse_tests(older + "[tests.other]\n"), jb.CaseError, "setups")
