"""Cases whose data are modes, and priors on the stiffness itself: what they state, and what is refused."""

import math

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.case.parse import parse_case
from tests.case.refusal_rows import case_text_named
from tests.conftest import edited, shipped_text
from tests.one_line import says

BASE, _, ZEROS = case_text_named("modes").partition("[data.zeros]")
BASE = f"{shipped_text('clamped_beam').partition('[data]')[0]}{BASE}"
ZEROS = f"[data.zeros]{ZEROS}"


def test_a_case_states_modes_as_python_does():
    measured = jb.case_from_text("modes", BASE).problem.test.data
    np.testing.assert_array_equal(measured.frequency.values, [[118.0, 750.0], [122.0, math.nan]])
    # fractions of the mean over repetitions
    np.testing.assert_allclose(measured.frequency.sd[0], np.hypot([1.2, 15.0], 0.5))
    np.testing.assert_allclose(measured.damping.sd, [[0.0011, 0.0009]])
    np.testing.assert_array_equal(measured.shapes.components.sd, [[[0.02, 0.02], [0.03, math.nan]]])
    assert (measured.dofs, measured.numbers, measured.match) == (("4:y", "8:y", "11:y"), (1, 2), "number")
    assert len(measured.values) == 3 + 2 + 3


def test_antiresonances_and_modal_constants_are_stated_with_fractions_of_their_means():
    measured = jb.case_from_text("modes", BASE + ZEROS).problem.test.data
    assert (measured.zeros.dofs, measured.zeros.numbers) == (("11:y", "11:y"), (1, 2))
    np.testing.assert_array_equal(measured.zeros.frequency.values, [[500.0, 1600.0], [505.0, math.nan]])
    np.testing.assert_allclose(
        measured.zeros.frequency.sd,
        [np.hypot([5.025, 16.0], [1.0, 2.0]), [measured.zeros.frequency.sd[0, 0], math.nan]],
    )
    assert measured.constants.pairs == (("8:y", "11:y"), ("11:y", "11:y"))
    np.testing.assert_array_equal(measured.constants.constants.values, [[[0.6, 1.1], [-0.4, math.nan]]])
    sd = [[math.hypot(0.03, 0.01), math.hypot(0.055, 0.01)], [math.hypot(0.02, 0.02), math.nan]]
    np.testing.assert_allclose(measured.constants.constants.sd, [sd])
    assert len(measured.values) == 3 + 2 + 3 + 3 + 3
    at_two = edited(ZEROS, ('dof = "11:y"', 'dof = ["11:y", "6:y"]\nnumbers = [2, 2]'))
    assert jb.case_from_text("modes", BASE + at_two).problem.test.data.value_names[8:10] == (
        "zero 2 of 11:y",
        "zero 2 of 6:y",
    )


def test_eigenvalues_and_repeated_shapes_are_taken():
    eigenvalue = [(2 * math.pi * f) ** 2 for f in (118.0, 750.0)]
    text = edited(
        BASE,
        ("frequencies_hz = [[118.0, 750.0], [122.0, nan]]", f"eigenvalues = {eigenvalue}"),
        ("sd_hz = 0.5\n", ""),
        ("= [[0.14, 0.62], [-0.61, nan]]", "= [[[0.1, 0.6], [-0.6, nan]], [[nan, 0.7], [-0.5, nan]]]"),
        ('reference = "11:y"', 'reference = ["11:y", "10:y"]'),
        ("numbers = [1, 2]", 'match = "shape"'),
    )
    measured = jb.case_from_text("modes", text).problem.test.data
    np.testing.assert_allclose(measured.frequency_hz, [118.0, 750.0])
    np.testing.assert_allclose(measured.frequency.sd[0], np.multiply(eigenvalue, [0.01, 0.02]))
    assert (measured.references, measured.shapes.components.values.shape) == (("11:y", "10:y"), (2, 2, 2))


def test_damping_ratios_make_uncertain_damping_visible():
    text = edited(BASE, ("[sampling]", "[uncertain.damping_ratio]\nlow_factor = 0.1\nhigh_factor = 10.0\n[sampling]"))
    assert jb.case_from_text("modes", text).problem.names[-1] == "damping_ratio"
    without = text.replace("damping_ratios = [0.011, 0.009]\ndamping_sd_relative = 0.1\n", "")
    with pytest.raises(jb.CaseError, match=r"uncertain\.damping_ratio: undamped natural frequencies do not depend"):
        parse_case(without)


def test_a_uniform_prior_of_a_stiffness_is_one_of_the_stiffness_itself():
    prior = '[prior.k11]                  # N/m\ndistribution = "log_uniform"'
    case = jb.case_from_text("modes", edited(BASE, (prior, '[prior.k11]\ndistribution = "uniform"')))
    assert case.problem.prior.marginals[0] == jb.OfStiffness(jb.Uniform(1e6, 1e11))


@pytest.mark.long
@pytest.mark.science
def test_a_case_of_modes_goes_from_its_text_to_its_report_and_back(tmp_path):
    text = edited(BASE + ZEROS, ("[122.0, nan]", "[122.0, 755.0]"), ("[-0.61, nan]", "[-0.61, -0.5]"))
    case = jb.case_from_text("modes", text)
    posterior = jb.sample(case, seed=1, settings=jb.SamplerSettings(walkers=16, max_steps=200))
    posterior.save(tmp_path / "modes.nc")
    again = jb.load_posterior(tmp_path / "modes.nc")
    np.testing.assert_array_equal(again.problem.test.data.values, case.problem.test.data.values)
    np.testing.assert_array_equal(again.theta, posterior.theta)
    assert posterior.summary().natural_frequencies_hz.measured == tuple(case.problem.test.data.frequency_hz)
    assert len(posterior.check.chi2_by_line) == len(case.problem.test.data.values)
    jb.write_report(again, tmp_path / "report")
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    says(page, "Modes, measured and predicted", "Damping ratio, mode 2", "Antiresonance 2 of 11:y (Hz)")
    says(page, "Modal constant 8:y/11:y (1/kg), mode 2", "Modal assurance criterion")
    assert (tmp_path / "report" / "figures" / "mode-shape-1.svg").exists()
