"""Natural frequencies that fit better when their modes are counted from another number are doubted, others are not."""

import re

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.identification import numbering
from jointbayes.identification.numbering import SURE, find_above_rigid, find_numbering
from jointbayes.inference import ErrorSizes
from tests.case.refusal_rows import parts_named
from tests.conftest import CONFIGS, cheap_frequencies_text, edited, first_in_ci
from tests.one_line import says

(BAR,) = parts_named("numbering").values()


def bar(frequency: list[float], numbers: list[int] | None = None, sd: float = 0.01) -> jb.Case:
    kind = 'kind = "natural_frequencies"\n' if numbers is None else f'kind = "modes"\nnumbers = {numbers}\n'
    return jb.case_from_text("bar", f"{BAR}{kind}frequencies_hz = {frequency}\nsd_relative = {sd}\n")


def measured(ky: float, krz: float, first: int, last: int, sd: float = 0.01, seed: int = 1) -> list[float]:
    """Natural frequencies of the modes from the first to the last of a bar on two springs, with noise."""
    exact = bar([100.0]).problem.natural_frequencies_hz(np.array([ky, krz]), last)[0][first - 1 :]
    return (exact * (1 + sd * np.random.default_rng(seed).standard_normal(exact.size))).tolist()


@pytest.mark.parametrize("seed", first_in_ci(range(3), 1))
def test_the_list_of_a_free_bar_is_that_of_its_elastic_modes(seed):
    (warning,) = bar(measured(2e3, 2.0, 3, 7, seed=seed)).warnings
    assert "modes 3, 4, 5, 6, 7 than of modes 1, 2, 3, 4, 5" in warning.text
    assert "numbers = [3, 4, 5, 6, 7]" in warning.text
    assert warning.key == "data.frequencies_hz"


def test_the_remedy_ends_the_doubt_and_a_number_that_is_too_high_is_doubted():
    frequency = measured(2e3, 2.0, 3, 7, sd=1e-3)
    assert bar(frequency, [3, 4, 5, 6, 7], sd=1e-3).warnings == ()
    doubt = find_numbering(bar(frequency, [5, 6, 7, 8, 9], sd=1e-3).problem, ErrorSizes())
    assert doubt.better
    assert doubt.other == (3, 4, 5, 6, 7)


def test_two_numberings_that_fit_alike_are_both_named():
    """At 1 % the modes of a free bar from 3 on are those of a clamped one from 2 on: cosh λ cos λ = ∓1."""
    doubt = find_numbering(bar(measured(2e3, 2.0, 3, 7), [3, 4, 5, 6, 7]).problem, ErrorSizes())
    assert not doubt.better
    assert doubt.other == (2, 3, 4, 5, 6)
    (warning,) = bar(measured(2e3, 2.0, 3, 7), [3, 4, 5, 6, 7]).warnings
    assert "fit about as well as those of modes 2, 3, 4, 5, 6 as of modes 3, 4, 5, 6, 7" in warning.text
    assert "look below and between them for modes that were missed" in warning.text


@pytest.mark.parametrize(("away", "doubted", "better"), [(-0.01, False, False), (0.01, True, False)])
def test_a_numbering_is_doubted_from_a_bayes_factor_on(monkeypatch, away, doubted, better):
    gains = {(0, 1.0): 0.0}
    evidence = lambda problem, measured, other, sizes: gains.get(other, away - SURE)  # noqa: E731
    monkeypatch.setattr(numbering, "_log_evidence", evidence)
    found = find_numbering(bar(measured(1e5, 1e3, 1, 5)).problem, ErrorSizes())
    assert (found is not None) is doubted
    assert (found is not None and found.better) is better


@pytest.mark.parametrize(("gain", "better"), [(SURE - 0.01, False), (SURE + 0.01, True)])
def test_a_numbering_is_taken_from_a_bayes_factor_on(gain, better):
    assert numbering.Renumbered((1, 2), (2, 3), gain).better is better


def test_as_many_frequencies_as_springs_are_no_doubt_of_their_numbers():
    """Any two fit modes 1 and 2 of some joint: that others fit as well says nothing."""
    assert find_numbering(bar(measured(1e5, 1e3, 1, 2)).problem, ErrorSizes()) is None
    assert find_numbering(bar(measured(1e5, 1e3, 1, 3), [2, 3, 4]).problem, ErrorSizes()).other == (1, 2, 3)


def test_the_evidence_is_that_of_a_quadrature_over_the_prior():
    problem = bar(measured(1e5, 1e3, 1, 5)).problem
    points = 400
    u = (np.arange(points) + 0.5) / points
    low, high = problem.prior.support
    grid = np.stack(np.meshgrid(*(low[:, None] + (high - low)[:, None] * u), indexing="ij"), axis=-1).reshape(-1, 2)
    log_density = np.concatenate([problem.log_posterior(rows) for rows in np.array_split(grid, 40)])
    largest = log_density.max()
    exact = largest + np.log(np.exp(log_density - largest).sum() * np.prod((high - low) / points))
    assert abs(numbering._log_evidence(problem, problem.test.data.modes, (0, 1.0), None) - exact) < 1.0


@pytest.mark.parametrize("seed", first_in_ci(range(3), 1))
@pytest.mark.parametrize(("ky", "krz"), [(2e3, 2.0), (1e5, 1e3), (1e7, 1e4), (1e9, 1e6)])
def test_a_right_list_is_not_doubted(ky, krz, seed):
    assert find_numbering(bar(measured(ky, krz, 1, 5, seed=seed)).problem, ErrorSizes()) is None


@pytest.mark.parametrize("kept", [(1, 3), (1, 3, 4), (1, 2, 4), (1, 2, 3, 5), (1, 3, 4, 5)])
@pytest.mark.parametrize(("ky", "krz"), [(1e5, 1e3), (1e7, 1e4), (1e9, 1e6)])
def test_a_list_with_a_mode_left_out_is_not_taken_for_rad_per_s(ky, krz, kept):
    frequency = measured(ky, krz, 1, 5)
    warnings = bar([frequency[number - 1] for number in kept]).warnings
    assert not any("rad/s" in warning.text for warning in warnings)


@pytest.mark.science
@pytest.mark.parametrize(("ky", "krz"), [(2e3, 2.0), (1e5, 1e3), (1e9, 1e6)])
def test_frequencies_in_rad_per_s_are_named(ky, krz):
    frequency = np.array(measured(ky, krz, 1, 5))
    (warning,) = bar((2 * np.pi * frequency).tolist()).warnings
    assert "fit far better divided by 2π, as if they were in rad/s" in warning.text
    assert (warning.key, bar(frequency.tolist()).warnings) == ("data.frequencies_hz", ())


@pytest.mark.science
def test_a_length_two_per_cent_wrong_is_no_doubt_of_the_numbers():
    frequency = [f * 1.04 for f in measured(1e7, 1e4, 1, 5, sd=1e-3)]
    assert find_numbering(bar(frequency, sd=1e-3).problem, ErrorSizes()) is None


@pytest.mark.parametrize(
    "name", ["clamped_beam_frequencies", "clamped_beam_frequencies_360mm", "two_storeys", "two_machines"]
)
def test_no_shipped_case_is_doubted(name):
    case = jb.load_case(CONFIGS / f"{name}.toml")
    assert not any("natural frequencies that fit" in warning.text for warning in case.warnings)


#: First natural frequency of the shipped beam as a cantilever, Hz: 1.8751² / 2π √(E/ρ) (d/4) / L².
CANTILEVER = 1.8751**2 / (2 * np.pi) * np.sqrt(210e9 / 7800) * 0.025 / 4 / 0.36**2


def clamped(*frequency: float, more: str = "") -> jb.Case:
    stated = f"[{', '.join(map(str, map(float, frequency)))}]"
    text = edited(cheap_frequencies_text(), ("[120.0, 762.0, 2101.0]", stated))
    return jb.case_from_text("clamped", text + more)


@pytest.mark.parametrize(("times", "warned"), [(1.03, False), (1.07, True)])
def test_a_frequency_above_the_rigid_clamp_s_is_warned_of_but_for_an_error_of_the_model(times, warned):
    warnings = clamped(times * CANTILEVER, 762.0, 2101.0).warnings
    assert len(warnings) == warned
    for warning in warnings:
        assert warning.key == "data.frequencies_hz"
        says(warning.text, f"found mode 1 at {times * CANTILEVER:.4g} Hz", "check E, density, length and section")
        rigid = float(re.search(r"expected at most ([\d.]+) Hz", warning.text)[1])
        assert rigid == pytest.approx(CANTILEVER, rel=0.005)  # shear and rotary inertia lower it


def test_what_is_uncertain_of_the_structure_may_lift_a_frequency():
    assert find_above_rigid(clamped(1.15 * CANTILEVER).problem).number == 1
    uncertain = "\n[uncertain.youngs_modulus]\nsd_percent = 15.0\n"
    assert find_above_rigid(clamped(1.15 * CANTILEVER, more=uncertain).problem) is None


def test_a_frequency_above_the_rigid_clamp_s_and_its_other_number_are_one_warning():
    (warning,) = clamped(1.14 * CANTILEVER, 862.0, 2350.0).warnings
    says(warning.text, "numbers = [2, 3, 4]; otherwise check E, density, length and section")
