"""Structures of a case file that are no straight beams: frames, chains, matrices."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg

import jointbayes as jb
from jointbayes.frf import DirectSolve, Ports
from jointbayes.posterior.storage import _Description, _Restoring
from tests.case.refusal_rows import case_text_named, parts_named
from tests.conftest import edited, shipped_text
from tests.one_line import refused

DATA, CHAIN, MATRICES, SPRINGS, TWO_POINTS = parts_named("structures").values()
PRIOR = "".join(
    f'\n[prior.{k}]\ndistribution = "log_uniform"\nlow = {low}\nhigh = {high}\n'
    for k, low, high in (("k11", 1e4, 1e10), ("k12", 1e2, 1e8), ("k22", 1e2, 1e8))
)
PORTAL, SPINDLE = case_text_named("portal"), case_text_named("spindle")


LOSS = 'law = "loss_factor", loss_factor = 0.02'


def text_of(structure, out, into, more=PRIOR):
    return structure + DATA.replace("OUT", out).replace("IN", into) + more


def built(structure, out, into, **more):
    return jb.case_from_text("frame", text_of(structure, out, into), **more)


def test_a_portal_frame_is_what_it_says():
    case = built(PORTAL, "3:y", "1:x")
    steel = jb.BeamMaterial(2.1e11, 0.3, 7800.0)
    points = {"foot": (0, 0, 0), "1": (0, 0.4, 0), "5": (0.5, 0.4, 0), "right": (0.5, 0, 0)}
    body = jb.FrameBody(points, (jb.Member(tuple(points), jb.Section.rectangle(0.04, 0.02), steel),))
    expected = jb.FrameRecipe(
        body, jb.ModalDamping((0.005,)), ("x", "y", "rz"), case.spec.structure.supports, accelerometer_dofs=("3:y",)
    )
    assert case.problem.test.structure.recipe.bodies[0][1].members == expected.bodies[0][1].members
    assert case.problem.test.structure.recipe == expected
    assert case.problem.test.structure.nominal.position("3:y") == pytest.approx((0.25, 0.4, 0))
    assert np.isfinite(case.problem.log_posterior(case.problem.prior.mean[None])).all()


STRAIGHT = SPINDLE.replace(", inertia_kg_m2 = [1e-6, 2e-6, 2e-6], offset_mm = [1, 0, 0]", "")


def test_an_error_of_a_length_in_mm_is_one_of_the_straight_body_that_has_it():
    def length_of(structure):
        prior = built(structure, "tool.tip:y", "tool.tip:y").problem.prior
        return next(n for n in prior.nuisances if n.name.endswith("length"))

    tool = length_of(STRAIGHT.replace("density]\nsd_percent = 3.0", "length]\nsd_mm = 0.05"))
    assert ((tool.name, tool.unit, tool.nominal), tool.prior.sd) == (("tool.length", "mm", 100.0), pytest.approx(5e-4))
    like = STRAIGHT.replace("tip = [180, 0, 0]", "tip = [160, 0, 0]") + "[uncertain.length]\nsd_mm = 0.2\n"
    assert length_of(like).prior.sd == pytest.approx(0.2 / 80)


def test_a_workshop_knows_the_lengths_of_straight_frames_to_half_a_per_cent():
    case = built(STRAIGHT, "tool.tip:y", "tool.tip:y")
    lengths = [n for n in case.workshop_problem.prior.nuisances if n.name == "length"]
    assert [(n.unit, n.prior.sd) for n in lengths] == [("× stated", 0.005)]
    assert "length" not in built(PORTAL, "3:y", "1:x").workshop_problem.names
    case = built(SPINDLE, "tool.tip:y", "tool.tip:y")
    assert case.problem.names[3:] == case.problem.test.structure.names == ("youngs_modulus", "tool.density")
    assert case.workshop_problem.names[3:] == ("youngs_modulus", "density", "accelerometer_mass", "tool.density")


def test_a_workshop_knows_the_mass_of_accelerometers_to_five_per_cent():
    weighed = PORTAL.replace("[structure]\n", "[structure]\naccelerometer_mass_g = 4.0\n", 1)
    nuisances = built(weighed, "3:y", "1:x").workshop_problem.prior.nuisances
    (mass,) = (nuisance for nuisance in nuisances if nuisance.name == "accelerometer_mass")
    assert (mass.unit, mass.nominal, mass.prior.sd) == ("g", 4.0, 0.05)
    exact = weighed + '[uncertain]\nexact = ["accelerometer_mass"]\n'
    for text in (PORTAL, exact):
        assert "accelerometer_mass" not in built(text, "3:y", "1:x").workshop_problem.names


def test_a_case_without_priors_takes_the_frames_own_stiffness():
    low, _ = jb.case_from_text("frame", text_of(PORTAL, "3:y", "1:x", "")).problem.prior.marginals[0].support
    own = 2.1e11 * 0.04 * 0.02**3 / 12 / np.hypot(0.5, 0.4) ** 3  # about the weaker axis, in the box of the frame
    assert low == pytest.approx(np.log(0.1 * own))


def test_a_chain_is_that_of_python_and_its_unknown_springs_are_joints():
    problem = jb.case_from_text("chain", CHAIN + SPRINGS).problem
    expected = jb.chain([1.0, 2.0, 1.5], [("2", "3", 1e5)], dampers=[("1", "ground", 5.0)])
    found = problem.test.structure.nominal
    assert_allclose(found.stiffness, expected.stiffness)
    assert_allclose(found.mass, expected.mass)
    assert_allclose(found.damping.matrix, expected.damping.matrix)
    assert problem.names == ("base.kx", "middle.kx")
    k = np.array([3e4, 5e4])
    added = np.array([[k.sum(), -k[1], 0], [-k[1], k[1], 0], [0, 0, 0]])
    square = linalg.eigh(expected.stiffness + added, expected.mass, eigvals_only=True)
    assert_allclose(problem.natural_frequencies_hz(k, 2)[0], np.sqrt(square[:2]) / (2 * np.pi), rtol=1e-9)


LAPPED = edited(
    shipped_text("lapped_beams"),
    ('law = "loss_factor", loss_factor = 0.004', 'law = "modal", ratio = 0.005'),
    ("accelerometer_mass_g = 4.0\n", ""),
)


def test_two_lapped_beams_with_two_shared_bolts_are_those_of_a_dense_solve():
    problem = jb.case_from_text("lapped", LAPPED).problem
    assert problem.names == ("bolt.kx", "bolt.ky", "bolt.krz")
    k = np.array([2e8, 1e8, 2e4])
    ports = Ports(np.arange(20.0, 900.0, 110.0), ("upper.end:y", "lower.end:y"), ("upper.end:y",))
    found = problem.test.receptance_model(ports).receptance(problem.parametrisation.matrix(k))[0]
    free = problem.test.structure.recipe.structure()
    # by hand: each bolt's end hangs on a rigid arm of 5 mm from either axis
    forms = []
    for bolt in ("left", "right"):
        for side, sign, arm in (("upper", 1.0, -0.005), ("lower", -1.0, 0.005)):
            x, y, rz = (free.index([f"{side}.{bolt}:{d}"])[0] for d in ("x", "y", "rz"))
            rows = np.zeros((3, free.n_dofs))
            rows[0, x], rows[0, rz], rows[1, y], rows[2, rz] = 1.0, -arm, 1.0, 1.0
            forms.append(sign * rows)
    upper_left, lower_left, upper_right, lower_right = forms
    added = sum(f.T @ np.diag(k) @ f for f in (upper_left + lower_left, upper_right + lower_right))
    whole = replace(free, stiffness=free.stiffness + added)
    expected = DirectSolve(whole, jb.Joint(("upper.end:x",)), ports).receptance(np.zeros((1, 1)))[0]
    assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["inline", "npy", "csv"])
def test_matrices_come_from_the_text_or_from_files(kind, tmp_path):
    stiffness, text = np.array([[2e5, -1e4], [-1e4, 1e3]]), MATRICES
    if kind == "npy":
        np.save(tmp_path / "K.npy", stiffness)
    elif kind == "csv":
        np.savetxt(tmp_path / "K.csv", stiffness, delimiter=",")
    if kind != "inline":
        text = text.replace("[[2e5, -1e4], [-1e4, 1e3]]", f'"K.{kind}"')
    case = built(text, "1:y", "1:y", directory=tmp_path)
    assert_allclose(case.problem.test.structure.nominal.stiffness, stiffness)
    assert_allclose(case.problem.test.structure.nominal.mass, np.diag([2.0, 0.01]))
    assert case.problem.test.structure.nominal.damping == jb.LossFactor(0.02)
    assert np.isfinite(case.problem.log_posterior(case.problem.prior.mean[None])).all()


def test_a_damping_matrix_comes_from_a_file(tmp_path):
    np.save(tmp_path / "C.npy", np.array([[3.0, -1.0], [-1.0, 2.0]]))
    text = MATRICES.replace(LOSS, 'law = "matrix", damping_matrix = "C.npy"')
    damping = built(text, "1:y", "1:y", directory=tmp_path).problem.test.structure.nominal.damping
    assert_allclose(damping.matrix, [[3.0, -1.0], [-1.0, 2.0]])


def test_a_frame_is_kept_in_a_posterior_file_as_it_is():
    recipe = built(SPINDLE, "tool.tip:y", "tool.tip:y").problem.test.structure
    description = _Description()
    plain = description._taken(recipe, "structure")
    assert description.unstored == {}
    again = _Restoring(lambda name: description.arrays[name], "here").part(json.loads(json.dumps(plain)), "structure")
    assert isinstance(again, jb.FrameFamily)
    assert (again.recipe, again.ranges) == (recipe.recipe, recipe.ranges)


@pytest.mark.parametrize(("element", "right"), [("converged", True), ("paper", False)])
def test_a_frame_of_two_points_has_all_its_modes_where_its_elements_are_as_many_as_it_takes(element, right):
    text = TWO_POINTS.replace("ELEMENT", element)
    if right:
        assert jb.case_from_text("case", text).problem.test.data.modes.frequency_hz.size == 3
    else:
        refused(lambda: jb.case_from_text("case", text), jb.CaseError, "3 frequencies for 2 free DOFs")
