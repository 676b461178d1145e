"""What a case file says reaches the problem: what `test_keys.py` cannot see by moving numbers."""

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.case.spec.structure_tables import RayleighDampingSpec
from jointbayes.inference import GaussianNoise, IntegratedScale, ScaledNoise, StudentNoise
from tests.conftest import cheap_text, edited

L, E = 0.383, 2.1e11
CIRCLE = (
    'shape = "circle"             # or "tube", "rectangle", "box", each with its own dimensions\ndiameter_mm = 25.0'
)
SPACE = (
    ("dofs_per_node = 2", "dofs_per_node = 5"),
    ("supports = []", 'supports = ["1:x", "1:y", "1:rz"]'),
    ('dofs = ["1:y", "1:rz"]', 'dofs = ["1:z", "1:ry"]'),
    ('outputs = ["5:y"]', 'outputs = ["5:z"]'),
    ('inputs = ["5:y"]', 'inputs = ["5:z"]'),
)


def case_of(*changes: tuple[str, str]) -> jb.Case:
    return jb.case_from_text("wiring", edited(cheap_text(), *changes))


@pytest.mark.parametrize("k12", [8.7612e7, -8.7612e7])  # refused from ±8.7613e7 on: refusals.txt
def test_a_stated_joint_may_be_all_but_indefinite(k12):
    assert case_of(("k12 = 3.44e7                 # N", f"k12 = {k12}")).spec.data.truth.k12 == k12


def test_the_factors_of_rayleighs_damping_are_those_of_mass_and_stiffness():
    law = RayleighDampingSpec(law="rayleigh", alpha_per_s=3.0, beta_s=1e-6).built()
    assert (law.alpha, law.beta) == (3.0, 1e-6)


@pytest.mark.parametrize(("lines", "expected"), [
    ('distribution = "gaussian"', GaussianNoise(2)),
    ('distribution = "student_t"\ndof = 7.0', StudentNoise(2, 7.0, False)),
    ('scale = "sampled"', ScaledNoise(2)),
    ('scale = "integrated"\nscale_dof = 3.0\nscale_guess = 1.5', IntegratedScale(2, 3.0, 1.5)),
], ids=["gaussian", "student", "sampled", "integrated"])  # fmt: skip
def test_the_noise_table_chooses_the_distribution(lines, expected):
    problem = case_of(("[identification]", f"[noise]\n{lines}\n\n[identification]")).problem
    assert (problem.test.noise or GaussianNoise(2)) == expected


def test_without_priors_and_first_guess_the_beam_sets_their_scale():
    text = cheap_text()
    bare = text[: text.index("[joint.initial]")] + text[text.index("[data]") :]
    case = jb.case_from_text(
        "bare", edited(bare, (CIRCLE, 'shape = "rectangle"\nwidth_mm = 40.0\nheight_mm = 20.0'), *SPACE)
    )
    own = E * 0.02 * 0.04**3 / 12 / L ** np.array([3.0, 2.0, 1.0])  # bending along z
    np.testing.assert_allclose(case.problem.first_guess, [1e3 * own[0], 0.0, 0.0])
    bounds = np.array([(m.low, m.high) for m in case.problem.prior.marginals])
    np.testing.assert_allclose(bounds, np.log(np.stack([[0.1, 0.1, 0.01] * own, 1e6 * own], axis=1)))
    signed = edited(bare, ('parametrisation = "log" ', 'parametrisation = "signed" '))
    k11, k22, rho = jb.case_from_text("signed", signed).problem.prior.marginals
    own = E * np.pi * 0.025**4 / 64 / L ** np.array([3.0, 1.0])
    np.testing.assert_allclose([k11.low, k22.high], np.log([0.1 * own[0], 1e6 * own[1]]))
    assert (rho.low, rho.high) == (-1.0, 1.0)
    centre = edited(bare, ('parametrisation = "log" ', 'parametrisation = "elastic_centre" '))
    _, arm, k22c = jb.case_from_text("centre", centre).problem.prior.marginals
    assert ((arm.low, arm.high), (k22c.low, k22c.high)) == ((-L, L), (k22.low, k22.high))


def test_a_case_without_title_is_named_after_its_file_and_a_band_without_lower_end_begins_at_its_step():
    text = cheap_text()
    case = jb.case_from_text("unnamed", edited(text, ("title = ", "# "), ("f_min_hz = 20.0", "")))
    assert case.title == "unnamed"
    frequency = case.problem.test.data.frf.frequency_hz
    assert (frequency[0], frequency[1], frequency[-1]) == (10.0, 20.0, 2500.0)
