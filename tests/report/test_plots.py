"""Figures that a notebook draws: those of the report, onto the axes that are given."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure as Canvas
from numpy.testing import assert_allclose, assert_array_equal

import jointbayes as jb
from jointbayes.posterior.setup_summary import setup_summaries
from jointbayes.report.inputs import SetupInputs
from jointbayes.report.model import Figure
from jointbayes.report.sections.fit_to_data import fit_section
from tests.conftest import CONFIGS, FEW_STEPS
from tests.report.test_setups import OWN, TORQUES, posterior_of


@pytest.fixture(scope="module")
def torques():
    return posterior_of(jb.case_from_text("torques", OWN + TORQUES))


@pytest.fixture(scope="module")
def shapes():
    return jb.sample(CONFIGS / "two_storeys_shape.toml", seed=1, settings=FEW_STEPS)


@pytest.fixture
def axes():
    return Canvas().subplots()


#: A figure onto one Axes, of which posterior, and its labels.
ON_AXES = [
    (jb.plot_frf, "cheap_posterior", ("Frequency (Hz)", "|H| (m/N)")),
    (lambda of, ax: jb.plot_frf(of, phase=True, ax=ax), "cheap_posterior", ("Frequency (Hz)", "Phase (°)")),
    (lambda of, ax: jb.plot_frf(of.problem.test.data.frf, ax=ax), "cheap_posterior", ("Frequency (Hz)", "|H| (m/N)")),
    (lambda of, ax: jb.plot_frf(of.problem, ax=ax), "cheap_posterior", ("Frequency (Hz)", "|H| (m/N)")),
    (jb.plot_residuals, "cheap_posterior", ("Frequency (Hz)", "Squared residual")),
    (jb.plot_intervals, "frequency_posterior", ("Value over its median", "")),
    (jb.plot_autocorrelation, "frequency_posterior", ("Lag (steps)", "Autocorrelation")),
    (jb.plot_frequencies, "frequency_posterior", ("Mode", "Deviation from measured (%)")),
    (jb.plot_mode_shape, "shapes", ("", "Component over the reference's")),
    (lambda of, ax: jb.plot_levels(of, "k22", ax=ax), "torques", ("Torque (N m)", "k22 (N·m/rad)")),
]  # fmt: skip


@pytest.mark.parametrize(("plot", "name", "labels"), ON_AXES)
def test_a_figure_is_drawn_onto_the_axes_that_are_given_and_nothing_else_changes(plot, name, labels, axes, request):
    posterior, before = request.getfixturevalue(name), dict(mpl.rcParams)
    assert plot(posterior, ax=axes) is axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == labels
    assert axes.has_data()
    assert pyplot.get_fignums() == []
    assert dict(mpl.rcParams) == before
    axes.figure.canvas.draw()


def test_figures_of_several_axes_are_drawn_onto_as_many(cheap_posterior):
    names = cheap_posterior.problem.names
    assert_array_equal(jb.plot_traces(cheap_posterior, axes=(row := Canvas().subplots(3))), row)
    assert [axes.get_ylabel() for axes in row] == ["ln k11", "ln k12", "ln k22"]
    (profile,) = jb.plot_profiles(cheap_posterior, "k22", axes=Canvas().subplots())
    assert profile.lines[0].get_ydata().max() == pytest.approx(0, abs=1e-6)
    history = cheap_posterior.estimate.iteration
    norm, *each = jb.plot_iteration(history, axes=Canvas().subplots(1, 4))
    assert_array_equal(norm.lines[0].get_ydata(), history.residual_norm)
    assert [axes.get_title() for axes in each] == ["k11 (N/m)", "k12 (N)", "k22 (N·m/rad)"]
    grid = jb.plot_corner(cheap_posterior, fig=(canvas := Canvas()))
    assert grid.shape == (len(names), len(names))
    assert len(canvas.axes) == 6  # those above the diagonal are gone
    assert pyplot.get_fignums() == []


def test_without_axes_a_figure_is_pyplots_own(cheap_posterior):
    pyplot.switch_backend("Agg")
    try:
        assert jb.plot_intervals(cheap_posterior).figure.number in pyplot.get_fignums()
        assert len(jb.plot_profiles(cheap_posterior)) == 3
        assert jb.plot_corner(cheap_posterior).shape == (3, 3)
        assert len(pyplot.get_fignums()) == 3
    finally:
        pyplot.close("all")


def test_the_curves_are_those_of_the_report(cheap_posterior, axes):
    summary = setup_summaries(cheap_posterior, cheap_posterior.problem.first_guess, None)[""]
    section = fit_section(SetupInputs(cheap_posterior, cheap_posterior.problem, summary))
    figure = next(block for block in section.blocks if isinstance(block, Figure) and block.identifier == "frf-0-0")
    curves = {curve.name: np.abs(curve.values) for curve in figure.plot.curves}
    jb.plot_frf(cheap_posterior, ax=axes)
    assert [line.get_label() for line in axes.lines] == ["synthetic", "first guess", "MAP"]
    for line in axes.lines:  # of so few lines none is left out
        assert_array_equal(line.get_ydata(), curves[line.get_label()])


def test_a_curve_over_levels_prints_as_its_sentence(torques):
    assert repr(torques.curve("k22")) == torques.curve("k22").sentence


def test_an_interval_stands_where_the_draws_have_it(cheap_posterior, axes):
    jb.plot_intervals(cheap_posterior, ax=axes)
    low, high = cheap_posterior.interval("k11")
    middle = np.median(cheap_posterior.values("k11"))
    (segment, *_) = axes.collections[1].get_segments()
    assert_allclose(segment[:, 0], [low / middle, high / middle])
    assert axes.get_yticklabels()[0].get_text().startswith("k11 = ")


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda p, _: jb.plot_frf(p, "1:y"), "found DOF '1:y'; expected one of 5:y; correct the label"),
        (lambda p, _: jb.plot_frf(p, setup="cold"), "found set-up 'cold'"),
        (
            lambda _, f: jb.plot_frf(f),
            "found natural frequencies; expected FRFs; draw plot_frequencies or plot_intervals",
        ),
        (lambda _, f: jb.plot_residuals(f), "found natural frequencies; expected FRFs"),
        (lambda p, _: jb.plot_mode_shape(p), "found no shape of mode 1; expected a mode whose shape was measured"),
        (
            lambda p, _: jb.plot_frequencies(replace(p, case=None)),
            "found no measured frequencies; expected some; draw plot_frf",
        ),
        (lambda p, _: jb.plot_levels(p, "k11"), "curve: found 0 levels of set-ups"),
    ],
)
def test_what_cannot_be_drawn_is_told_in_one_line(draw, message, cheap_posterior, frequency_posterior):
    with pytest.raises(jb.JointBayesError, match=message):
        draw(cheap_posterior, frequency_posterior)
    assert pyplot.get_fignums() == []
