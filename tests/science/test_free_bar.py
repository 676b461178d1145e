"""A sample of the study of a joint that is not there: its frequencies, its verdicts, what is kept and counted."""

import numpy as np
import pytest
from benchmarks import free_bar
from benchmarks.exact_beam import ExactBeam, circle

from tests.conftest import first_in_ci

ALL_ELSE_EXACT, _, FROM_ONE = free_bar.KINDS


@pytest.mark.docs
def test_the_roots_are_those_of_a_free_bar():
    roots = free_bar.ROOTS
    np.testing.assert_allclose(np.cos(roots), 1 / np.cosh(roots), atol=1e-9)


@pytest.mark.docs
def test_the_closed_form_lacks_the_shear_that_the_exact_beam_has():
    beam = ExactBeam(1.0, circle(0.010, 0.3), 2.1e11, 0.3, 7800.0, {1: 0.0}, (1e-3, 0.0, 1e-3))
    exact = beam.modes(700.0).omega[2:] / (2 * np.pi)  # above those in which the bar swings and rocks
    off = exact / free_bar.frequencies_hz() - 1
    assert (np.diff(off) < 0).all()
    np.testing.assert_allclose(off[[0, 4]], [-0.00027, -0.00365], rtol=0.05)


@pytest.mark.science
@pytest.mark.parametrize("index", first_in_ci([1, 2, 3], 1))
@pytest.mark.parametrize("kind", [ALL_ELSE_EXACT, FROM_ONE])
def test_no_spring_of_a_free_bar_is_identified(kind, index):
    said = free_bar.analysed(kind, index)["verdicts"]
    assert said.keys() == {"k11", "k12", "k22"}
    assert "identified" not in said.values()
    assert "weakly identified" not in said.values()
    if kind == ALL_ELSE_EXACT:
        assert (said["k11"], said["k22"]) == ("bounded above", "bounded above")


@pytest.mark.science
@pytest.mark.parametrize("kind", [ALL_ELSE_EXACT, FROM_ONE])
def test_modes_that_are_counted_from_1_are_warned_of(kind):
    warnings = [str(warning) for warning in free_bar.case_of(kind, 1).warnings]
    named = [text for text in warnings if "fit far better as those of modes 3, 4, 5 than of modes 1, 2, 3" in text]
    assert len(named) == (kind == FROM_ONE)
