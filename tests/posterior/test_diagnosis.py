"""What residuals point to: each fault by itself is named, and a right model has none."""

from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.identification.resonances import fit_resonance
from jointbayes.posterior.diagnosis import diagnose, diagnose_frequencies, diagnose_frfs
from tests.conftest import CONFIGS, TABLE_3, edited, pair_matrix

TIP = edited((CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8"), ("f_step_hz = 1.0", "f_step_hz = 4.0"))
BOTH = edited(TIP, ('outputs = ["11:y"]', 'outputs = ["11:y", "6:y"]'))
THREE = edited(TIP, ('outputs = ["11:y"]', 'outputs = ["11:y", "6:y", "8:y"]'))


def with_truth(text, line):
    return edited(text, ("\n[data.truth]", f"\n[data.truth]\n{line}\n#"))


def problem_of(text, change=None):
    """The problem of a case, its measured FRFs changed in place."""
    problem = jb.case_from_text("diagnosis", text).problem
    if change is None:
        return problem
    values = problem.test.data.frf.values.copy()
    change(values)
    frf = replace(problem.test.data.frf, values=values)
    return problem.with_test(data=replace(problem.test.data, frf=frf))


def scaled(index, factor):
    def change(values):
        values[:, index] *= factor

    return change


def at_true_joint(text, change=None, seed=1):
    problem = problem_of(text, change)
    return diagnose(problem.test.data, problem, np.log(TABLE_3), np.random.default_rng(seed))


@pytest.mark.parametrize("text", [TIP, BOTH, THREE], ids=["one", "two", "three"])
@pytest.mark.parametrize("noise", [1, 2, 3, 4, 5])
def test_a_right_model_has_no_cause(text, noise):
    found = at_true_joint(edited(text, ("seed = 20150787", f"seed = {noise}")))
    assert found.causes == ()
    assert [round(mode.measured_hz) for mode in found.modes] == pytest.approx([121, 752, 2066], abs=2)
    assert max(abs(mode.error_percent) for mode in found.modes) < 0.12
    assert min(pair.correlation for pair in found.pairs) > 0.995  # noise of 4 % on some ten lines that count


@pytest.mark.parametrize(
    ("text", "change", "cause", "word"),
    [
        (with_truth(TIP, "length_mm = 370.0"), None, "frequencies, all the same way", "too low: check length"),
        (with_truth(BOTH, "youngs_modulus_gpa = 200.0"), None, "frequencies, all the same way", "too high"),
        (with_truth(TIP, "damping_ratio = 0.02"), None, "damping", "their width is wrong"),
        (with_truth(BOTH, "damping_ratio = 0.007"), None, "damping", "their width is wrong"),
        (with_truth(TIP, "gain = 1.1"), None, "level", "times the predicted ones at every resonance"),
        (with_truth(BOTH, "gain = 1.1"), None, "level", "calibration"),
        (BOTH, scaled(1, 1.2), "one sensor", "One FRF alone is off: 6:y/11:y is 1."),
        (BOTH, scaled(0, 0.8), "one sensor", "One FRF alone is off: 11:y/11:y is 0.8"),
        (THREE, scaled(2, 1.2), "one sensor", "One FRF alone is off: 8:y/11:y is 1."),
        (BOTH, scaled(1, -1.0), "one sensor", "6:y/11:y has the opposite sign"),
    ],
)
def test_a_fault_at_the_true_joint_is_named(text, change, cause, word):
    found = at_true_joint(text, change)
    assert found.causes == (cause,)
    assert word in found.sentence


def test_the_size_of_a_fault_is_stated():
    damping = at_true_joint(with_truth(TIP, "damping_ratio = 0.02")).modes
    assert np.median([mode.damping_ratio for mode in damping]) == pytest.approx(2.0, rel=0.1)
    assert at_true_joint(with_truth(TIP, "gain = 1.1")).pairs[0].level == pytest.approx(1.1, rel=0.03)
    assert at_true_joint(BOTH, scaled(1, 1.2)).pairs[1].level == pytest.approx(1.2, rel=0.03)
    shifts = [mode.error_percent for mode in at_true_joint(with_truth(TIP, "youngs_modulus_gpa = 200.0")).modes]
    assert shifts == pytest.approx([100 * (np.sqrt(210 / 200) - 1)] * 3, abs=0.25)  # the joint is not softer with it


@pytest.mark.science
@pytest.mark.parametrize(
    ("text", "change", "cause"),
    [
        (with_truth(BOTH, "youngs_modulus_gpa = 220.5"), None, "frequencies"),
        (with_truth(BOTH, "accelerometer_mass_g = 40.0"), None, "frequencies"),
        (with_truth(TIP, "damping_ratio = 0.02"), None, "damping"),
        (with_truth(BOTH, "gain = 1.1"), None, "level"),
        (BOTH, scaled(1, 1.2), "one sensor"),
    ],
)
def test_a_fault_is_named_after_the_joint_has_taken_up_what_it_can(text, change, cause):
    case = replace(jb.case_from_text("diagnosis", text), problem=problem_of(text, change))
    found = diagnose(case.problem.test.data, case.problem, jb.find_map(case, seed=1).theta, np.random.default_rng(1))
    assert [name.split(",")[0] for name in found.causes] == [cause]


def test_gain_and_other_uncertain_quantities_are_applied_before_anything_is_compared():
    problem = problem_of(with_truth(TIP, "gain = 1.1") + "\n[uncertain.gain]\nsd_percent = 20.0\n")
    right = np.append(np.log(TABLE_3), np.log(1.1))
    assert diagnose(problem.test.data, problem, right, np.random.default_rng(1)).causes == ()
    assert diagnose(problem.test.data, problem, np.append(np.log(TABLE_3), 0.0), np.random.default_rng(1)).causes == (
        "level",
    )


def test_the_fit_of_a_resonance_is_exact_for_one_mode():
    f = np.arange(80.0, 120.0, 0.25)

    def mode(frequency, damping, size):
        return (size / (frequency**2 - f**2 + 2j * damping * frequency * f))[:, None, None]

    sd = np.full((f.size, 1, 1), 1e-9)
    found = diagnose_frfs(f, mode(100.5, 0.012, 3.0), mode(100.0, 0.01, 2.5), sd, "a", "b", np.random.default_rng(1))
    assert found.modes[0].measured_hz == pytest.approx(100.5, rel=2e-4)
    assert found.modes[0].error_percent == pytest.approx(100 * (100 / 100.5 - 1), abs=0.01)
    assert found.modes[0].damping_ratio == pytest.approx(1.2, rel=0.01)
    assert found.pairs[0].level == pytest.approx(1.2, rel=0.01)


def test_frfs_without_any_resonance_are_compared_as_a_whole():
    f = np.arange(10.0, 60.0, 1.0)
    frf = (1 / (100.0**2 - f**2) + 0j)[:, None, None]
    sd = 1e-3 * np.abs(frf)
    found = diagnose_frfs(f, 1.3 * frf, frf, sd, ("tip",), ("tip",), np.random.default_rng(1))
    assert found.modes == ()
    assert found.causes == ("level",)
    assert found.pairs[0].correlation == pytest.approx(1)
    assert found.pairs[0].level == pytest.approx(1.3)


def test_a_resonance_that_only_one_of_the_two_shows_is_no_pair():
    structure = problem_of(TIP)
    ports = jb.Ports(structure.test.data.frf.frequency_hz, ("11:y",), ("11:y",))
    predicted = structure.test.receptance_model(ports).receptance(pair_matrix(TABLE_3[None]), np.ones((1, 0)))[0]
    f = ports.frequency_hz
    extra = predicted + 2e-2 / (1400.0**2 - f**2 + 28j * f)[:, None, None]
    sd = 0.01 * np.median(np.abs(predicted)) * np.ones(predicted.shape)
    found = diagnose_frfs(f, extra, predicted, sd, ("11:y",), ("11:y",), np.random.default_rng(1))
    assert len(found.modes) == 3
    assert not any(1300 < mode.measured_hz < 1500 for mode in found.modes)


@pytest.mark.parametrize(
    ("measured", "causes"),
    [
        ([120.0, 762.0, 2101.0], ()),
        ([123.0, 780.0, 2150.0], ("frequencies, all the same way",)),
        ([120.0, 780.0, 2060.0], ("frequencies, unevenly",)),
    ],
)
def test_natural_frequencies_are_compared_one_by_one(measured, causes):
    predicted, sd = np.array([120.0, 762.0, 2101.0]), np.array([0.5, 1.0, 2.0])
    found = diagnose_frequencies(np.array(measured), predicted, sd)
    assert found.causes == causes
    assert found.pairs == ()
    worst = max(100 * abs(p / m - 1) for p, m in zip(predicted, measured, strict=True))
    assert max(abs(mode.error_percent) for mode in found.modes) == pytest.approx(worst)
    assert f"off by up to {worst:.2g} %" in found.measure


def test_a_flank_whose_parabola_has_its_foot_below_0_hz_is_no_resonance():
    coarse, f = np.arange(10.0, 100.0, 10.0), np.arange(10.0, 40.0, 0.5)
    x = (coarse**2 - 10.0**2) / 10.0**2
    for foot in (-1.5, -1.05):  # of 1/|H|² over x = (f² − f₀²)/f₀²; 0 Hz is x = −1
        assert np.isnan(fit_resonance(coarse, 1 / (0.01 + (x - foot) ** 2), 0)).all()
    x = (f**2 - 20.0**2) / 20.0**2
    assert np.exp(fit_resonance(f, 1 / (1e-4 + x**2), 20)) == pytest.approx([20.0, 0.005, 20.0**2], rel=1e-6)
