"""Natural frequencies that fit better when their modes are counted from another number are doubted, others are not."""

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.case.case import Case, case_from_text
from jointbayes.identification.numbering import find_numbering
from tests.conftest import CONFIGS, first_in_ci

BAR = """
[structure]
length_mm = 500.0
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = { shape = "rectangle", width_mm = 30.0, height_mm = 10.0 }
damping = { law = "loss_factor", loss_factor = 0.01 }
[joint]
kind = "springs"
dofs = ["1:y", "1:rz"]
[data]
"""


def bar(frequency: list[float], numbers: list[int] | None = None, sd: float = 0.01) -> Case:
    kind = 'kind = "natural_frequencies"\n' if numbers is None else f'kind = "modes"\nnumbers = {numbers}\n'
    return case_from_text("bar", f"{BAR}{kind}frequencies_hz = {frequency}\nsd_relative = {sd}\n")


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
    frequency = measured(2e3, 2.0, 3, 7)
    assert bar(frequency, [3, 4, 5, 6, 7]).warnings == ()
    doubt = find_numbering(bar(frequency, [5, 6, 7, 8, 9]).problem)
    assert doubt is not None
    assert doubt.better == (3, 4, 5, 6, 7)


@pytest.mark.parametrize("seed", first_in_ci(range(3), 1))
@pytest.mark.parametrize(("ky", "krz"), [(2e3, 2.0), (1e5, 1e3), (1e7, 1e4), (1e9, 1e6)])
def test_a_right_list_is_not_doubted(ky, krz, seed):
    assert find_numbering(bar(measured(ky, krz, 1, 5, seed=seed)).problem) is None


@pytest.mark.science
@pytest.mark.parametrize(("ky", "krz"), [(2e3, 2.0), (1e5, 1e3), (1e9, 1e6)])
def test_frequencies_in_rad_per_s_are_named(ky, krz):
    frequency = np.array(measured(ky, krz, 1, 5))
    (warning,) = bar((2 * np.pi * frequency).tolist()).warnings
    assert "fit far better divided by 2π, as if they were in rad/s" in warning.text
    assert warning.key == "data.frequencies_hz"
    assert bar(frequency.tolist()).warnings == ()


@pytest.mark.science
def test_a_length_two_per_cent_wrong_is_no_doubt_of_the_numbers():
    frequency = [f * 1.04 for f in measured(1e7, 1e4, 1, 5, sd=1e-3)]
    assert find_numbering(bar(frequency, sd=1e-3).problem) is None


@pytest.mark.parametrize("name", ["clamped_beam_frequencies", "clamped_beam_frequencies_360mm", "two_storeys"])
def test_no_shipped_case_is_doubted(name):
    case = jb.load_case(CONFIGS / f"{name}.toml")
    assert not any("fit far better" in warning.text for warning in case.warnings)
