"""Priors and first guesses of a case that states none: the structure's own stiffness at each DOF."""

import re
from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.inference.default_prior import default_prior
from tests.case.refusal_rows import parts_named
from tests.conftest import CONFIGS, edited, shipped_without
from tests.one_line import refused

BEAM, DATA, RING, MATRICES, SWAPPED, CHAIN = parts_named("default_priors").values()
REST = shipped_without("spindle_measured", "joints.taper")
MODULUS = 210e9
UPRIGHT, FLAT = MODULUS * 0.1**3 * 0.005 / 12, MODULUS * 0.005**3 * 0.1 / 12


def springs(structure: str, dofs: tuple[str, ...], end: str) -> jb.Case:
    names = [f"k{label.partition(':')[2]}" for label in dofs]
    truth = "".join(f"{name} = {1e3 if 'r' in name else 1e6}\n" for name in names)
    joint = f'[joint]\nkind = "springs"\ndofs = {list(dofs)}\n'.replace("'", '"')
    text = structure + joint + DATA.replace("END", end) + f"[data.truth.stiffness]\n{truth}"
    return jb.case_from_text("default", text)


def own(case: jb.Case) -> dict[str, float]:
    """The structure's own stiffness as the bounds of each prior have it, and as the first guess has it."""
    found = {}
    guesses = case.problem.initial
    for name, marginal, guess in zip(case.problem.names, case.problem.prior.marginals, guesses, strict=True):
        low, high = np.exp(marginal.support)
        rotation = "r" in name.rpartition(".")[2]
        assert (low, guess) == (pytest.approx((1e-8 if rotation else 1e-7) * high), pytest.approx(1e-3 * high))
        found[name] = 1e-6 * high
    return found


ANGLE = RING.replace('["a", "b", "c", "a"]', '["a", "b", "c"]')
THICK = BEAM.replace("height_mm = 5.0", "height_mm = 60.0")


@pytest.mark.parametrize(("structure", "dofs", "end"), [
    (BEAM, ("1:y", "1:rz"), "11:y"), (BEAM, ("1:z", "1:ry"), "11:z"), (THICK, ("1:y", "1:rz"), "11:y"),
    (BEAM, ("4:y", "4:rz"), "11:y"), (ANGLE, ("a:x", "a:y", "a:rz"), "c:x"), (RING, ("a:y", "a:rz"), "c:x"),
])  # fmt: skip
def test_the_structure_without_its_joint_and_on_a_rigid_one_are_inside_the_default_range(structure, dofs, end):
    problem = springs(structure, dofs, end).problem
    low, high = np.exp(np.array([marginal.support for marginal in problem.prior.marginals]).T)
    rigid_modes = problem.test.structures.at(problem.test.joints.labels, 1.0).rigid_motions(np.array([0])).shape[1]
    joints = np.vstack([low * 1e-6, high, high * 1e3, np.where(np.eye(len(low), dtype=bool), low, low * 1e-6)])
    none, stiffest, rigid, *soft = problem.natural_frequencies_hz(joints, rigid_modes + 4)
    elastic = slice(rigid_modes, None)
    for of_one_spring in soft:
        assert of_one_spring[elastic] == pytest.approx(none[elastic], rel=0.003)
    assert stiffest == pytest.approx(rigid, rel=0.003)


def test_each_direction_of_a_beam_has_the_bending_of_its_own_plane():
    case = springs(BEAM, ("1:y", "1:rz", "1:z", "1:ry"), "11:y")
    expected = {"ky": FLAT / 0.3**3, "krz": FLAT / 0.3, "kz": UPRIGHT / 0.3**3, "kry": UPRIGHT / 0.3}
    assert own(case) == pytest.approx(expected)


def test_a_frame_is_as_long_as_the_body_is_and_may_be_a_ring():
    bending = MODULUS * 0.04 * 0.02**3 / 12
    assert own(springs(RING, ("a:y", "a:rz"), "c:x")) == pytest.approx({"ky": bending / 0.125, "krz": bending / 0.5})


def test_a_short_member_at_the_joint_does_not_make_a_body_stiff():
    case = jb.case_from_text("stub", shipped_without("spindle_tool", "joints.taper.prior"))
    prior = dict(zip(case.problem.prior.names, case.problem.prior.marginals, strict=True))
    bending = MODULUS * np.pi * 0.063**4 / 64
    for name, size, truth in (("taper.ky", bending / 0.09**3, 6e8), ("taper.krz", bending / 0.09, 1.2e6)):
        low, high = np.exp(prior[name].support)
        assert high == pytest.approx(1e6 * size)
        lowest = 0.01 if "r" in name.removeprefix("taper") else 0.1
        assert 0.05 * lowest * size < low <= lowest * size * (1 + 1e-9)  # the first mode of all is below
        assert low < truth < high / 10


def test_matrices_have_the_stiffness_of_each_dof():
    assert own(springs(MATRICES, ("1:y", "1:rz"), "1:y")) == pytest.approx({"ky": 1.2e8, "krz": 4e5})


@pytest.mark.whole
def test_a_joint_that_names_the_measured_body_first_has_the_default_priors_of_the_modelled_one():
    swapped = REST + SWAPPED + 'against = ["holder.flange:y", "holder.flange:rz"]\n'
    usual = shipped_without("spindle_measured", "joints.taper.prior")
    first, second = (jb.case_from_text("first", text, directory=CONFIGS).problem for text in (swapped, usual))
    priors = [dict(zip(problem.prior.names, problem.prior.marginals, strict=True)) for problem in (first, second)]
    assert priors[0] == priors[1]
    starts = [dict(zip(problem.parametrisation.names, problem.initial, strict=True)) for problem in (first, second)]
    assert starts[0] == starts[1]


def test_a_joint_of_a_measured_body_to_ground_needs_a_prior_and_starts_from_it():
    refused(
        lambda: jb.case_from_text("ground", REST + SWAPPED, directory=CONFIGS),
        jb.CaseError,
        r"joints\.taper\.prior: found no prior of taper.ky, taper.krz|found no prior of ky, krz; expected one for each",
    )
    stated = "[joints.taper.prior]\n" + "".join(
        f'{name} = {{ distribution = "log_uniform", low = {low}, high = {high} }}\n'
        for name, low, high in (("ky", 1e6, 1e10), ("krz", 1e4, 1e8))
    )
    problem = jb.case_from_text("ground", REST + SWAPPED + stated, directory=CONFIGS).problem
    assert problem.initial[-2:] == pytest.approx([1e8, 1e6])


def hung(coupling: float, joint: float) -> jb.Case:
    """Two masses on a joint, with the natural frequencies that they have."""
    stiffness, mass = np.array([[joint + coupling, -coupling], [-coupling, coupling]]), np.diag([50.0, 15.0])
    first, second = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)) / (2 * np.pi)
    text = CHAIN.replace("COUPLING", str(coupling)).replace("FIRST", str(first)).replace("SECOND", str(second))
    return jb.case_from_text("hung", text)


@pytest.mark.parametrize("coupling", [8e3, 1e6, 1e9])
def test_a_joint_far_softer_than_its_structure_is_inside_the_default_range(coupling):
    """Two masses that move as one on 2000 N/m at 0.88 Hz, however stiff the spring between them is."""
    case = hung(coupling, 2e3)
    low, high = np.exp(case.problem.prior.marginals[0].support)
    first = case.problem.test.data.frequency_hz[0]
    assert first == pytest.approx(0.88, abs=0.01)
    spring = 50 * (2 * np.pi * first) ** 2
    assert low == pytest.approx(0.1 * (coupling if 0.1 * coupling < spring else spring))
    assert low < 2e3 / 2
    assert high == pytest.approx(1e6 * coupling)


def test_a_mass_that_nothing_holds_takes_its_range_from_the_measured_frequency():
    between = '{ between = ["1", "2"], stiffness_n_per_m = 8000.0 }'
    text = edited(hung(8e3, 2e3).text, (between, ""), ("1 = 50.0, ", ""), ("1:x", "2:x"))
    text = re.sub(r"frequencies_hz = .*", "frequencies_hz = [1.8]", text)
    problem = jb.case_from_text("loose", text).problem
    low, high = np.exp(problem.prior.marginals[0].support)
    spring = 15.0 * (2 * np.pi * problem.test.data.frequency_hz[0]) ** 2
    assert (low, high) == pytest.approx((0.1 * spring, 1e6 * spring))


def test_a_case_knows_which_priors_no_one_stated():
    assert hung(8e3, 2e3).default_priors == {"kx"}
    stated = '[prior.kx]\ndistribution = "log_uniform"\nlow = 10.0\nhigh = 1e6\n'
    assert jb.case_from_text("stated", hung(8e3, 2e3).text + stated).default_priors == frozenset()
    stub = shipped_without("spindle_tool", "joints.taper.prior")
    assert jb.case_from_text("stub", stub).default_priors == {"taper.ky", "taper.krz"}
    assert jb.load_case(CONFIGS / "spindle_tool.toml").default_priors == frozenset()


@pytest.mark.whole
def test_a_limit_set_by_a_default_range_is_not_called_the_users():
    """A joint so stiff that the data say no more than that: the upper end of the range is nobody's statement."""
    both = hung(8e3, 5e8)
    first = both.problem.test.data.frequency_hz[0]
    case = jb.case_from_text("hung", re.sub(r"frequencies_hz = .*", f"frequencies_hz = [{first}]", both.text))
    posterior = jb.sample(case, settings=jb.SamplerSettings(walkers=16, max_steps=800, end_tolerance=0.2), seed=1)
    known = posterior.verdict("kx")
    assert known.cls == "bounded below"
    assert known.because.startswith("the test sets no upper limit before the end of the default range 8.00 GN/m")
    text = case.text + '[prior.kx]\ndistribution = "log_uniform"\nlow = 800.0\nhigh = 8e9\n'
    again = replace(posterior, case=jb.case_from_text("stated", text))
    bound = "the test sets no upper limit before the prior's upper bound 8.00 GN/m"
    assert again.verdict("kx").because.startswith(bound)


@pytest.mark.parametrize("name", ["clamped_beam", "two_storeys", "portal_frame"])
def test_a_problem_in_python_has_the_default_prior_of_a_case(name):
    text = (CONFIGS / f"{name}.toml").read_text(encoding="utf-8")
    bare = re.sub(r"(?ms)^\[(joints\.\w+\.)?prior(\.\w+)?\].*?(?=^\[|\Z)", "", text)
    case = jb.case_from_text(name, bare, directory=CONFIGS)
    assert case.default_priors == frozenset(case.problem.parametrisation.names)
    found, stated = default_prior([(t.structure, t.joints, t.data) for t in case.problem.tests]), case.problem.prior
    assert (found.names, found.marginals) == (stated.parametrisation.names, stated.marginals)


def test_a_problem_without_a_prior_has_it():
    lone = jb.case_from_text("default", (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")).problem.test
    problem = jb.Problem(structure=lone.structure, joint=("1:y", "1:rz"), data=lone.data)
    assert problem.prior == default_prior([(lone.structure, lone.joints, lone.data)])
    assert problem.test.joints == lone.joints
    assert np.isfinite(problem.log_posterior(problem.initial_theta)).all()
    lines = lone.data.frf.frequency_hz
    body = jb.MeasuredBody("held", lines, ("9:w",), np.ones((lines.size, 1, 1)), np.ones((lines.size, 1, 1)))
    whole = jb.Substructures(lone.structure, (body,))
    with pytest.raises(jb.ModelError, match=r"found no prior of joint '9:w' between measured bodies; .* pass prior="):
        jb.Problem(structure=whole, joint=jb.Joint(("9:w",)), data=lone.data)


def test_one_stated_prior_leaves_the_defaults_of_the_others():
    problem = springs(BEAM, ("1:y", "1:rz"), "11:y").problem
    text = springs(BEAM, ("1:y", "1:rz"), "11:y").text
    prior = '[prior.krz]\ndistribution = "log_uniform"\nlow = 10.0\nhigh = 1e6\n'
    case = jb.case_from_text("one", text + prior)
    assert case.default_priors == {"ky"}
    stated = jb.Uniform.of_logarithm(10.0, 1e6)
    assert case.problem.prior.marginals == (problem.prior.marginals[0], stated)
    test = problem.test
    arrays = {"structure": test.structures, "joint": test.joints.dofs, "data": test.data}
    default, one = jb.Problem(**arrays).prior, jb.Problem(**arrays, prior={"k22": stated}).prior
    assert one.marginals == (*default.marginals[:2], stated)
    refused(
        lambda: jb.Problem(**arrays, prior={"kz": stated}), jb.ModelError, "found a prior of 'kz'; expected priors of"
    )
