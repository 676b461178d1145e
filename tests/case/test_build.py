"""Each key of a case file reaches the prediction with its value: compared with closed formulas, not with the code."""

import math

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.case.spec.structure_tables import RayleighDampingSpec
from jointbayes.inference import GaussianNoise, IntegratedScale, ScaledNoise, StudentNoise
from tests.conftest import cheap_text, edited, pair_matrix

L, E, NU, RHO, KAPPA = 0.383, 2.1e11, 0.3, 7800.0, 0.8
G = E / (2 * (1 + NU))
CIRCLE = (
    'shape = "circle"             # or "tube", "rectangle", "box", each with its own dimensions\ndiameter_mm = 25.0'
)
B, H, T = 0.040, 0.020, 0.003


def ring(outer: float, inner: float = 0.0) -> tuple[float, float, float]:
    """Area, and second moments for bending along y and along z."""
    return math.pi * (outer**2 - inner**2), *2 * (math.pi * (outer**4 - inner**4) / 4,)


def block(width: float, height: float) -> tuple[float, float, float]:
    return width * height, width * height**3 / 12, height * width**3 / 12


#: Key lines, area, second moments for bending along y and along z.
SECTIONS = {
    "circle": ('shape = "circle"\ndiameter_mm = 30.0', *ring(0.015)),
    "tube": ('shape = "tube"\nouter_diameter_mm = 40.0\ninner_diameter_mm = 30.0', *ring(0.020, 0.015)),
    "rectangle": ('shape = "rectangle"\nwidth_mm = 40.0\nheight_mm = 20.0', *block(B, H)),
    "box": ('shape = "box"\nwidth_mm = 40.0\nheight_mm = 20.0\nwall_mm = 3.0',
            *np.subtract(block(B, H), block(B - 2 * T, H - 2 * T))),
}  # fmt: skip
STATED_SHEAR = ('shear_coefficient = "cowper"', f"shear_coefficient = {KAPPA}")
SPACE = (
    ("dofs_per_node = 2", "dofs_per_node = 5"),
    ("supports = []", 'supports = ["1:x", "1:y", "1:rz"]'),
    ('dofs = ["1:y", "1:rz"]', 'dofs = ["1:z", "1:ry"]'),
    ('outputs = ["5:y"]', 'outputs = ["5:z"]'),
    ('inputs = ["5:y"]', 'inputs = ["5:z"]'),
)


def case_of(*changes: tuple[str, str]) -> jb.Case:
    return jb.case_from_text("wiring", edited(cheap_text(), *changes))


def receptance(case: jb.Case, stiffness, dof: str = "5:y", f_hz: float = 0.01) -> complex:
    """Drive-point receptance at one low frequency."""
    return case.problem.test.receptance_model(jb.Ports(np.array([f_hz]), (dof,), (dof,))).receptance(
        pair_matrix(stiffness)
    )[0, 0, 0, 0]


def cantilever(area: float, inertia: float, modulus: float = E, length: float = L) -> float:
    """Deflection of the tip of a clamped Timoshenko beam under unit force, m/N."""
    return length**3 / (3 * modulus * inertia) + length / (KAPPA * (modulus / (2 * (1 + NU))) * area)


@pytest.mark.parametrize("shape", SECTIONS)
@pytest.mark.parametrize("direction", ["y", "z"])
def test_a_static_force_bends_the_section_of_the_case_file(shape, direction):
    lines, area, along_y, along_z = SECTIONS[shape]
    case = case_of((CIRCLE, lines), STATED_SHEAR, *(SPACE if direction == "z" else ()))
    k11, k22 = 3e8, 2e5
    expected = cantilever(area, along_y if direction == "y" else along_z) + 1 / k11 + L**2 / k22
    assert receptance(case, [k11, 0.0, k22], f"5:{direction}").real == pytest.approx(expected, rel=1e-6)


def test_the_coupling_of_the_joint_reaches_the_tip_with_its_sign():
    case = case_of(STATED_SHEAR)
    k11, k12, k22 = 3e8, 2e6, 2e5
    (c11, c12), (_, c22) = np.linalg.inv([[k11, k12], [k12, k22]])
    beam = cantilever(math.pi * 0.025**2 / 4, math.pi * 0.025**4 / 64)
    # unit force at the tip is force 1 and moment L at the joint
    assert receptance(case, [k11, k12, k22]).real == pytest.approx(beam + c11 + 2 * L * c12 + L**2 * c22, rel=1e-6)


@pytest.mark.parametrize("direction", ["y", "z"])
def test_a_box_that_is_not_square_shears_differently_in_its_two_directions(direction):
    width, height, wall = 0.080, 0.120, 0.002
    case = case_of(
        (CIRCLE, 'shape = "box"\nwidth_mm = 80.0\nheight_mm = 120.0\nwall_mm = 2.0'),
        *(SPACE if direction == "z" else ()),
    )
    across, along = (width, height) if direction == "y" else (height, width)
    inertia = (across * along**3 - (across - 2 * wall) * (along - 2 * wall) ** 3) / 12
    area = width * height - (width - 2 * wall) * (height - 2 * wall)
    # Cowper (1966), thin-walled box, sides at mid-wall: n = flange over web, m = n as the walls are of one thickness
    n = m = (across - wall) / (along - wall)
    kappa = (10 * (1 + NU) * (1 + 3 * m) ** 2) / (
        (12 + 72 * m + 150 * m**2 + 90 * m**3)
        + NU * (11 + 66 * m + 135 * m**2 + 90 * m**3)
        + 10 * n**2 * ((3 + NU) * m + 3 * m**2)
    )
    shear = receptance(case, [1e12, 0.0, 1e10], f"5:{direction}").real - L**3 / (3 * E * inertia) - 1e-12 - L**2 / 1e10
    assert L / (G * area) / shear == pytest.approx(kappa, rel=1e-4)


@pytest.mark.parametrize(("factor", "possible"), [(1.0, True), (1.001, False), (-0.999, True), (-1.001, False)])
def test_a_stated_joint_is_refused_as_soon_as_it_is_not_positive_semidefinite(factor, possible):
    k12 = factor * math.sqrt(5.05e9 * 1.52e6)
    changes = (TRUTH, f"{TRUTH}\n"), ("k12 = 3.44e7                 # N", f"k12 = {k12!r}")
    if possible:
        assert case_of(*changes).spec.data.truth.k12 == k12
    else:
        with pytest.raises(jb.CaseError, match=r"data\.truth\.k12: found k11 = .* expected a positive semidefinite"):
            case_of(*changes)


def test_a_loss_factor_makes_the_beam_complex_and_not_the_joint():
    law = ('law = "modal"                # or "loss_factor", "rayleigh"', 'law = "loss_factor"')
    case = case_of(STATED_SHEAR, law, ("ratio = 0.01", "loss_factor = 0.3"))
    beam = cantilever(math.pi * 0.025**2 / 4, math.pi * 0.025**4 / 64)
    assert receptance(case, [3e8, 0.0, 2e5]) == pytest.approx(beam / (1 + 0.3j) + 1 / 3e8 + L**2 / 2e5, rel=1e-6)


def test_the_factors_of_rayleighs_damping_are_those_of_mass_and_stiffness():
    law = RayleighDampingSpec(law="rayleigh", alpha_per_s=3.0, beta_s=1e-6).built()
    assert (law.alpha, law.beta) == (3.0, 1e-6)


TRUTH = "[data.truth]                 # the joint that makes the data: Table 3 of the paper"
MORE = ("[identification]", "[noise]\n{lines}\n\n[identification]")


@pytest.mark.parametrize(("lines", "expected"), [
    ('distribution = "gaussian"', GaussianNoise(2)),
    ('distribution = "student_t"\ndof = 7.0', StudentNoise(2, 7.0, False)),
    ('scale = "sampled"\nscale_low_factor = 0.5\nscale_high_factor = 3.0', ScaledNoise(2)),
    ('scale = "integrated"\nscale_dof = 3.0\nscale_guess = 1.5', IntegratedScale(2, 3.0, 1.5)),
], ids=["gaussian", "student", "sampled", "integrated"])  # fmt: skip
def test_the_noise_table_chooses_the_distribution_with_its_numbers(lines, expected):
    problem = case_of((MORE[0], MORE[1].format(lines=lines))).problem
    assert (problem.test.noise or GaussianNoise(2)) == expected
    if "sampled" in lines:
        assert np.exp(problem.prior.nuisances[-1].prior.support) == pytest.approx((0.5, 3.0))


def test_an_uncertain_shear_coefficient_is_a_factor_on_cowpers():
    table = ("[identification]", "[uncertain.shear_coefficient]\nsd_percent = 8.0\n\n[identification]")
    kappa = 0.9 * 6 * (1 + NU) / (7 + 6 * NU)
    stated = case_of(('shear_coefficient = "cowper"', f"shear_coefficient = {kappa!r}")).problem
    joint, uncertain = [5.05e9, 3.44e7, 1.52e6], case_of(table).problem
    found = [uncertain.natural_frequencies_hz(joint, 3, [[factor]])[0] for factor in (0.9, 1.0)]
    np.testing.assert_allclose(found[0], stated.natural_frequencies_hz(joint, 3)[0], rtol=1e-7)
    assert np.abs(found[0] / found[1] - 1).max() > 1e-4


def test_without_priors_and_first_guess_the_beam_sets_their_scale():
    text = cheap_text()
    bare = text[: text.index("[joint.initial]")] + text[text.index("[data]") :]
    flat = SECTIONS["rectangle"]
    case = jb.case_from_text("bare", edited(bare, (CIRCLE, flat[0]), *SPACE))
    own = E * flat[3] / L ** np.array([3.0, 2.0, 1.0])  # bending along z
    np.testing.assert_allclose(case.problem.first_guess, [1e3 * own[0], 0.0, 0.0])
    bounds = np.array([(m.low, m.high) for m in case.problem.prior.marginals])
    np.testing.assert_allclose(bounds, np.log(np.stack([[0.1, 0.1, 0.01] * own, 1e6 * own], axis=1)))
    signed = edited(bare, ('parametrisation = "log" ', 'parametrisation = "signed" '))
    k11, k22, rho = jb.case_from_text("signed", signed).problem.prior.marginals
    own = E * SECTIONS["circle"][2] * (25 / 30) ** 4 / L ** np.array([3.0, 1.0])
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
