"""Priors and first guesses of a case that states none: the structure's own stiffness at each DOF."""

import numpy as np
import pytest

from jointbayes.case.case import Case, case_from_text
from jointbayes.errors import CaseError
from tests.conftest import CONFIGS

BEAM = """
[structure]
length_mm = 300.0
dofs_per_node = 5
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = { shape = "rectangle", width_mm = 100.0, height_mm = 5.0 }
damping = { law = "loss_factor", loss_factor = 0.01 }
supports = []
"""
DATA = """
[data]
kind = "synthetic_frf"
outputs = ["END"]
inputs = ["END"]
f_min_hz = 20.0
f_max_hz = 300.0
f_step_hz = 20.0
noise = { relative = 0.03, floor = 0.01, seed = 2 }
"""
MODULUS = 210e9
UPRIGHT, FLAT = MODULUS * 0.1**3 * 0.005 / 12, MODULUS * 0.005**3 * 0.1 / 12
RING = """
[structure]
kind = "frame"
directions = ["x", "y", "rz"]
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = { shape = "rectangle", width_mm = 40.0, height_mm = 20.0 }
damping = { law = "loss_factor", loss_factor = 0.01 }
members = [{ points = ["a", "b", "c", "a"] }]
points = { a = [0, 0, 0], b = [300, 0, 0], c = [300, 400, 0] }
"""
MATRICES = """
[structure]
kind = "matrices"
dofs = ["1:y", "1:rz"]
stiffness = [[1.2e8, 6e6], [6e6, 4e5]]
mass = [1, 1e-3]
damping = { law = "modal", ratio = 0.01 }
"""


def springs(structure: str, dofs: tuple[str, ...], end: str) -> Case:
    names = [f"k{label.partition(':')[2]}" for label in dofs]
    truth = "".join(f"{name} = {1e3 if 'r' in name else 1e6}\n" for name in names)
    joint = f'[joint]\nkind = "springs"\ndofs = {list(dofs)}\n'.replace("'", '"')
    text = structure + joint + DATA.replace("END", end) + f"[data.truth.stiffness]\n{truth}"
    return case_from_text("default", text)


def own(case: Case) -> dict[str, float]:
    """The structure's own stiffness as the bounds of each prior have it, and as the first guess has it."""
    found = {}
    guesses = case.problem.initial
    for name, marginal, guess in zip(case.problem.names, case.problem.prior.marginals, guesses, strict=True):
        low, high = np.exp(marginal.support)
        assert high / low == pytest.approx(1e7)
        assert guess == pytest.approx(1e4 * low)
        found[name] = 10 * low
    return found


def test_each_direction_of_a_beam_has_the_bending_of_its_own_plane():
    case = springs(BEAM, ("1:y", "1:rz", "1:z", "1:ry"), "11:y")
    expected = {"ky": FLAT / 0.3**3, "krz": FLAT / 0.3, "kz": UPRIGHT / 0.3**3, "kry": UPRIGHT / 0.3}
    assert own(case) == pytest.approx(expected)


def test_a_frame_is_as_long_as_the_body_is_and_may_be_a_ring():
    bending = MODULUS * 0.04 * 0.02**3 / 12
    assert own(springs(RING, ("a:y", "a:rz"), "c:x")) == pytest.approx({"ky": bending / 0.125, "krz": bending / 0.5})


def test_a_short_member_at_the_joint_does_not_make_a_body_stiff():
    case = case_from_text("stub", 'extends = "spindle_tool.toml"\nremove = ["joints.taper.prior"]\n', directory=CONFIGS)
    prior = dict(zip(case.problem.prior.names, case.problem.prior.marginals, strict=True))
    bending = MODULUS * np.pi * 0.063**4 / 64
    for name, size, truth in (("taper.ky", bending / 0.09**3, 6e8), ("taper.krz", bending / 0.09, 1.2e6)):
        low, high = np.exp(prior[name].support)
        assert (low, high) == pytest.approx((0.1 * size, 1e6 * size))
        assert low < truth < high / 10


def test_matrices_have_the_stiffness_of_each_dof():
    assert own(springs(MATRICES, ("1:y", "1:rz"), "1:y")) == pytest.approx({"ky": 1.2e8, "krz": 4e5})


SWAPPED = """extends = "spindle_measured.toml"
remove = ["joints.taper.dofs", "joints.taper.against", "joints.taper.prior"]
[joints.taper]
dofs = ["nose:y", "nose:rz"]
"""


def test_a_joint_that_names_the_measured_body_first_has_the_default_priors_of_the_modelled_one():
    swapped = SWAPPED + 'against = ["holder.flange:y", "holder.flange:rz"]\n'
    usual = 'extends = "spindle_measured.toml"\nremove = ["joints.taper.prior"]\n'
    first, second = (case_from_text("first", text, directory=CONFIGS).problem for text in (swapped, usual))
    assert first.prior.marginals == second.prior.marginals
    np.testing.assert_array_equal(first.initial, second.initial)


def test_a_joint_of_a_measured_body_to_ground_needs_a_prior_and_starts_from_it():
    with pytest.raises(CaseError, match=r"joints\.taper\.prior: found no prior; expected one for a joint") as caught:
        case_from_text("ground", SWAPPED, directory=CONFIGS)
    assert "\n" not in str(caught.value)
    stated = "[joints.taper.prior]\n" + "".join(
        f'{name} = {{ distribution = "log_uniform", low = {low}, high = {high} }}\n'
        for name, low, high in (("ky", 1e6, 1e10), ("krz", 1e4, 1e8))
    )
    problem = case_from_text("ground", SWAPPED + stated, directory=CONFIGS).problem
    assert problem.initial[:2] == pytest.approx([1e8, 1e6])
