"""What is drawn is what was fitted: gain, accelerometer and all other uncertain quantities are in the curves."""

from dataclasses import replace

import numpy as np
import pytest

from jointbayes.case.case import case_from_text
from jointbayes.posterior import summarise
from jointbayes.posterior.compared_frfs import ComparedFrf
from jointbayes.posterior.diagnosis import Diagnosis, PairFit
from jointbayes.report import ReportInputs
from jointbayes.report.drawing import frf_overlay
from jointbayes.report.model import Figure, FrfCurve, FrfPlot
from jointbayes.report.sections.fit_to_data import (
    MOST_FIGURES,
    MOST_ROWS,
    fit_section,
    frf_unit,
    shown_frfs,
    table_of_frfs,
)
from jointbayes.workflow import sample
from tests.conftest import FEW_STEPS, TABLE_3, cheap_text, edited
from tests.report.conftest import posterior_about

INITIAL = (1e8, 0.0, 0.0)
TRUTH = "[data.noise]"
GAIN = edited(cheap_text(), (TRUTH, f"gain = 26.0\n{TRUTH}")) + (
    "\n[uncertain.gain]\nlow_factor = 0.01\nhigh_factor = 100.0\n"
)
HEAVY = edited(
    cheap_text(),
    ("length_mm = 383.0", "length_mm = 383.0\naccelerometer_mass_g = 60.0"),
    (TRUTH, f"accelerometer_mass_g = 120.0\nlength_mm = 391.0\n{TRUTH}"),
) + ("\n[uncertain.accelerometer_mass]\nlow_factor = 0.5\nhigh_factor = 4.0\n\n[uncertain.length]\nsd_percent = 2.0\n")


@pytest.fixture(scope="module", params=["gain of 26", "heavy accelerometer on a longer beam"])
def fitted(request):
    if request.param == "gain of 26":
        return sample(case_from_text("gain", GAIN), seed=1, settings=FEW_STEPS)
    case = case_from_text("heavy", HEAVY)
    assert [n.name for n in case.problem.prior.nuisances] == ["length", "accelerometer_mass"]
    middle = np.log([*TABLE_3, 391.0 / 383.0, 120.0 / 60.0])
    return posterior_about(case, middle, np.full(middle.size, 1e-4))


def drawn(posterior, initial=INITIAL):
    """Magnitudes of the interactive curves by name, and of both ends of the band."""
    inputs = ReportInputs(replace(posterior, problem=replace(posterior.problem, initial=initial)))
    inputs.__dict__["summary"] = inputs.posterior.summary()  # without profiles, which this section does not need
    section = fit_section(inputs.tests[0])
    (figure,) = (b for b in section.blocks if isinstance(b, Figure) and b.identifier == "frf-0-0")
    low, high = map(np.abs, figure.plot.band)
    return {curve.name: np.abs(curve.values) for curve in figure.plot.curves} | {"low": low, "high": high}


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_the_measured_curve_lies_on_that_of_the_map_and_in_its_band(fitted):
    curves = drawn(fitted)
    measured, best = curves["computed"], curves["MAP"]
    frf = fitted.problem.test.data.frf.values[:, 0, 0]
    sd = np.sqrt(fitted.problem.test.data.variance[:, 0, 0]) / np.abs(frf)
    apart = np.log(measured / best)
    assert abs(np.median(apart)) < 0.005
    assert np.abs(apart / sd).max() < 5
    low, high = curves["low"], curves["high"]
    assert ((low <= best * 1.001) & (best <= high * 1.001)).mean() > 0.9
    assert np.median(high / low) < 1.1


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_the_first_guess_differs_from_the_map_by_the_joint_alone(fitted):
    curves = drawn(fitted, tuple(fitted.estimate.values))
    np.testing.assert_allclose(curves["first guess"], curves["MAP"], rtol=1e-9)


def test_natural_frequencies_of_the_first_guess_are_those_of_the_structure_that_was_fitted(fitted):
    frequencies = summarise(fitted, tuple(fitted.estimate.values)).to_dict()["natural_frequencies_hz"]
    assert frequencies["initial"] == pytest.approx(frequencies["map"], rel=1e-12)
    low, high = np.array(frequencies["interval95"]).T
    assert ((low < frequencies["map"]) & (frequencies["map"] < high)).all()


def test_the_axis_has_the_unit_of_the_frf():
    assert frf_unit("receptance", "11:y", "11:y") == "m/N"
    assert frf_unit("mobility", "11:y", "11:y") == "m/(s N)"
    assert frf_unit("accelerance", "11:y", "11:y") == "m/(s² N)"
    assert frf_unit("receptance", "1:rz", "11:y") == "rad/N"
    assert frf_unit("receptance", "1:rz", "1:rz") == "rad/(N m)"
    assert frf_unit("accelerance", "1:y", "1:rz") == "m/(s² N m)"


def test_of_many_frfs_the_highest_and_those_that_fit_worst_have_figures():
    every = [(f"{n}:y", "1:y") for n in range(1, 31)]
    magnitude = np.ones((5, 30, 1))
    magnitude[2, 7] = 100.0
    pairs = tuple(PairFit(*pair, 1 - 0.01 * n, 1.0, turned=False) for n, pair in enumerate(every))
    shown = shown_frfs(every, magnitude, Diagnosis((), pairs, ()))
    assert shown == {every[7], *every[-MOST_FIGURES + 1 :]}
    assert shown_frfs(every[:3], magnitude[:, :3], Diagnosis((), pairs[:3], ())) == set(every[:3])


def test_the_table_of_many_frfs_has_the_worst_by_shape_or_level_and_tints_a_suspect_sensor():
    pairs = [PairFit(f"{n}:y", "1:y", 1 - 0.01 * n, 1.0, turned=False) for n in range(29)]
    suspect = ComparedFrf("30:y", "1:y", 0.5, 1.0, ("level",))
    (table,) = table_of_frfs("FRFs", (*pairs, suspect), "Level.", (suspect,))
    assert len(table.rows) == MOST_ROWS
    assert [row[0] for row in table.rows[:2]] == ["30:y/1:y", "28:y/1:y"]
    assert table.row_kinds[:2] == ("caution", "")
    assert table.note.startswith(f"The {MOST_ROWS} of 30")
    assert table_of_frfs("FRFs", (), "") == []


def test_the_line_that_is_explained_worst_is_marked_and_said():
    frequency, misfit = np.array([10.0, 20.0, 30.0]), np.array([1.0, 7.0, 2.0])
    curves = tuple(FrfCurve(name, np.array([1.0, 2.0, 1.0]) + 0j, "#000") for name in ("measured", "MAP"))
    plot = FrfPlot(("2:y", "1:y"), (0, 0), "receptance", "m/N", frequency, curves, (curves[0].values,) * 2, misfit)
    assert plot.worst_hz == 20.0
    marked = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.axes.Axes.axvline", lambda _, x, **__: marked.append(x))
        frf_overlay(plot)
    assert marked == [20.0, 20.0]  # magnitude and phase
