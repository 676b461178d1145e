"""Figures that a notebook draws: those of the report, onto the axes that are given."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure as Canvas
from numpy.testing import assert_allclose, assert_array_equal
from scipy import linalg, stats

import jointbayes as jb
from jointbayes.posterior.summary import summaries_of_tests
from jointbayes.report import drawing, plots
from jointbayes.report.inputs import TestInputs
from jointbayes.report.model import Figure
from jointbayes.report.sections.fit_to_data import fit_section
from tests.conftest import CONFIGS, FEW_STEPS


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
    (jb.plot_mode_shape, "cheap_posterior", ("", "Component over 5:y's")),
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
    assert [axes.get_title(loc="right") for axes in each] == ["k11 (N/m)", "k12 (N)", "k22 (N·m/rad)"]
    assert jb.plot_corner(cheap_posterior, fig=(canvas := Canvas())) is canvas
    assert len(canvas.axes) == len(names) * (len(names) + 1) / 2  # those above the diagonal are gone
    assert pyplot.get_fignums() == []


def test_without_axes_a_figure_is_pyplots_own(cheap_posterior):
    pyplot.switch_backend("Agg")
    try:
        assert jb.plot_intervals(cheap_posterior).figure.number in pyplot.get_fignums()
        assert len(jb.plot_profiles(cheap_posterior)) == 3
        assert len(jb.plot_corner(cheap_posterior).axes) == 6
        assert len(pyplot.get_fignums()) == 3
    finally:
        pyplot.close("all")


def test_the_curves_are_those_of_the_report(cheap_posterior, axes):
    summary = summaries_of_tests(cheap_posterior, cheap_posterior.problem.first_guess, None)[""]
    section = fit_section(TestInputs(cheap_posterior, cheap_posterior.problem, summary))
    figure = next(block for block in section.blocks if isinstance(block, Figure) and block.identifier == "frf-0-0")
    curves = {curve.name: np.abs(curve.values) for curve in figure.plot.curves}
    jb.plot_frf(cheap_posterior, ax=axes)
    assert [line.get_label() for line in axes.lines] == ["computed", "first guess", "MAP"]
    for line in axes.lines:  # of so few lines none is left out
        assert_array_equal(line.get_ydata(), curves[line.get_label()])


def test_an_interval_stands_where_the_draws_have_it(cheap_posterior, axes):
    jb.plot_intervals(cheap_posterior, ax=axes)
    low, high = cheap_posterior.interval("k11")
    middle = np.median(cheap_posterior.values("k11"))
    (segment, *_) = axes.collections[1].get_segments()
    assert_allclose(segment[:, 0], [low / middle, high / middle])
    assert axes.get_yticklabels()[0].get_text().startswith("k11 = ")


def ends_of_bars(axes):
    """Lower and upper ends of error bars, shape (bars, 2)."""
    return np.array(axes.containers[0].lines[2][0].get_segments())[:, :, 1]


def test_what_was_measured_has_bars_of_95_percent(axes):
    measured, sd, normal = np.array([100.0, 400.0]), np.array([1.0, 2.0]), stats.norm.ppf(0.975)
    drawing.draw_frequency_errors(axes, measured, sd, {"MAP": measured})
    per_cent = 100 * sd / measured
    assert_allclose(ends_of_bars(axes), normal * np.stack([-per_cent, per_cent], axis=1), rtol=1e-3)
    axes = Canvas().subplots()
    drawing.draw_mode_shape(axes, ("1:y", "2:y"), measured, sd, measured, measured - sd, measured + sd)
    assert_allclose(ends_of_bars(axes), np.stack([measured - normal * sd, measured + normal * sd], axis=1), rtol=1e-3)


def test_a_predicted_mode_shape_is_that_of_the_matrices(axes, cheap_posterior):
    jb.plot_mode_shape(cheap_posterior, 2, ax=axes)
    best = next(line for line in axes.lines if line.get_label() == "MAP").get_ydata()
    assert "measured, 95 %" not in axes.get_legend_handles_labels()[1]
    problem, theta = cheap_posterior.problem, cheap_posterior.estimate.theta
    whole = problem.test.structures.certain()
    stiffness = np.array(whole.stiffness)
    at = whole.index(problem.test.joints.labels)
    stiffness[np.ix_(at, at)] += problem.prior.matrix(theta).stiffness
    shape = linalg.eigh(stiffness, whole.mass)[1][:, 1]
    moved = shape[[i for i, label in enumerate(whole.labels) if label.endswith(":y") and label[0] != "~"]]
    shown = [text.get_text() for text in axes.get_xticklabels()]
    assert_allclose(best, moved / moved[np.abs(moved).argmax()], rtol=0.02, atol=0.02)
    assert shown[-1] == "5:y"


def test_the_line_across_a_profile_is_at_its_95_percent(axes):
    drawing.draw_profiles([axes], [("k22", np.arange(3.0), np.array([-4.0, 0.0, -4.0]))])
    across = axes.lines[-1].get_ydata()
    assert_allclose(across, -stats.chi2.ppf(0.95, df=1) / 2, rtol=1e-3)


def test_frequencies_are_refused_before_anything_is_computed(cheap_posterior, monkeypatch):
    monkeypatch.setattr("jointbayes.report.plots.checks_of", None)
    monkeypatch.setattr("jointbayes.report.plots.frequency_summary", None)
    with pytest.raises(jb.ModelError, match="found no measured frequencies; expected some; draw plot_frf"):
        jb.plot_frequencies(replace(cheap_posterior, case=None))


def test_many_curves_are_named_beside_the_axes(cheap_posterior, axes, monkeypatch):
    names, theta, ensemble = plots.chain_values(cheap_posterior)
    many = [f"{name} {i}" for i in range(3) for name in names]
    monkeypatch.setattr(plots, "chain_values", lambda _: (many, np.tile(theta, 3), ensemble))
    jb.plot_autocorrelation(cheap_posterior, ax=axes)
    axes.figure.canvas.draw()
    assert len(axes.get_legend().get_texts()) == 9
    assert axes.get_legend().get_window_extent().x0 >= axes.get_window_extent().x1


@pytest.mark.parametrize(("width", "columns"), [(7.2, 4), (4.0, 2)])
def test_a_legend_has_as_many_columns_as_its_axes_are_wide(cheap_posterior, width, columns):
    axes = Canvas(figsize=(width, 3)).subplots()
    jb.plot_frf(cheap_posterior, ax=axes)
    axes.figure.canvas.draw()
    assert axes.get_legend()._ncols == columns
    assert axes.get_legend().get_window_extent().x1 <= axes.get_window_extent().x1 + 1


def test_one_of_several_frfs_is_named(cheap_posterior, axes):
    frf = cheap_posterior.problem.test.data.frf
    two = jb.FrfSet(frf.frequency_hz, np.repeat(frf.values, 2, axis=1), ("5:y", "4:y"), frf.inputs, frf.quantity)
    assert jb.plot_frf(two, "4:y", ax=axes).get_title() == "4:y / 5:y"
    assert jb.plot_frf(frf, ax=Canvas().subplots()).get_title() == ""
