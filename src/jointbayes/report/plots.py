"""Figures of a report in a notebook, each drawn onto the axes that are given, or onto new ones of pyplot.

What they show is drawn by :mod:`jointbayes.report.drawing`, as in a report; fonts and grid are the user's. Where
there are several tests, `test` is the name of one, by default of the first.
"""

from typing import Any, cast

import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jointbayes.errors import ModelError, require, require_count, shown
from jointbayes.frf import AssembledShapes
from jointbayes.identification import IterationHistory
from jointbayes.inference import Problem
from jointbayes.posterior import Posterior
from jointbayes.posterior.checks import checks_of
from jointbayes.posterior.summary import frequency_summary, measured_frequencies
from jointbayes.posterior.verdicts import region_of
from jointbayes.report import drawing
from jointbayes.report.drawing import AxesArray
from jointbayes.report.sections.fit_to_data import frf_curves, frf_unit
from jointbayes.report.sections.identifiable import corner_values
from jointbayes.report.sections.natural_frequencies import compared_modes, frequency_values, shape_values
from jointbayes.report.sections.run_details import chain_values
from jointbayes.rounding import quantity_text
from vibrecords import FrfSet, ModeData

_SHAPE_DRAWS, _MOST_SHAPE_DOFS = 400, 40  # of a mode that is predicted alone
_MOST_INSIDE = 6  # curves that a legend names inside the axes


def _axes(given: Any, height: float, count: int = 1, columns: int = 4, **options: Any) -> AxesArray:  # noqa: ANN401
    """The axes that are given, or new ones in rows of so many columns, each so high: shape (count,).

    Raises
    ------
    ModelError
        If there are more or fewer, or other things among them.
    """
    if given is None:
        rows, columns = -(-count // columns), min(columns, count)
        size: Any = {"figsize": (7.2, height * rows), "layout": "constrained", "squeeze": False}
        given = np.ravel(pyplot.subplots(rows, columns, **size, **options)[1])
        for spare in given[count:]:
            spare.remove()
        given = given[:count]
    axes = np.ravel(np.array(given, dtype=object))
    if len(axes) != count or not all(isinstance(each, Axes) for each in axes):
        found = shown(given) if len(axes) == 1 else f"{len(axes)} axes"
        raise ModelError(f"figure: found {found}; expected {count} Axes; make them by pyplot.subplots({count})")
    return axes


def _of(posterior: Posterior) -> Posterior:
    """What is given in its place is refused."""
    require(posterior, Posterior, "figure: found", "a posterior; make it by jb.sample(case) or jb.load_posterior(path)")
    return posterior


def _measured_frfs(problem: Problem) -> FrfSet:
    data = problem.test.data
    if data.shown_frfs is None:
        raise ModelError(f"figure: found {data.words}; expected FRFs; draw plot_frequencies or plot_intervals instead")
    return data.shown_frfs.frf


def plot_frf(
    source: Posterior | Problem | FrfSet,
    output: str | None = None,
    input_: str | None = None,
    *,
    phase: bool = False,
    test: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw one FRF: of a posterior measured, first guess, and MAP with its 95 % band; else as measured.

    Parameters
    ----------
    source
        Posterior, problem, or FRFs.
    output, input_
        DOF labels; by default the first of each.
    phase
        The phase in degrees instead of the magnitude.
    test
        Name of the test, where there are several; by default the first.
    ax
        Axes to draw on; by default new ones.

    Raises
    ------
    ModelError
        If the data are no FRFs, or there is no such test.
    MeasurementError
        If there is no such DOF.
    """
    require(source, Posterior | Problem | FrfSet, "plot_frf: found", "a posterior, a problem or an FrfSet; pass one")
    problem = source.problem if isinstance(source, Posterior) else source
    whole = problem if isinstance(problem, FrfSet) else _measured_frfs(problem.part(test))
    frf = whole.select([output or whole.outputs[0]], [input_ or whole.inputs[0]])
    (ax,) = _axes(ax, 3.4)
    if not isinstance(source, Posterior):
        label = "Phase (°)" if phase else f"|H| ({frf_unit(frf.quantity, *frf.outputs, *frf.inputs)})"
        values = np.angle(frf.values, deg=True) if phase else np.abs(frf.values)
        drawing.draw_curve(ax, frf.frequency_hz, values[:, 0, 0], label, log=not phase)
    else:
        drawing.draw_frf(ax, *frf_curves(source, source.problem.part(test), frf), phase=phase)
    if len(whole.outputs) * len(whole.inputs) > 1:
        (ax.get_legend() or ax).set_title(f"{frf.outputs[0]} / {frf.inputs[0]}")
    return ax


def plot_residuals(posterior: Posterior, *, test: str | None = None, ax: Axes | None = None) -> Axes:
    """Draw the squared residual of each line over what the noise makes of it.

    Raises
    ------
    ModelError
        If the data are no FRFs, or there is no such test.
    """
    part = _of(posterior).problem.part(test)
    if part.test.data.frfs is None and part.test.data.shown_frfs is not None:
        found, remedy = "the modes of FRFs as data, not these", 'the posterior of jb.sample(case, premises="exact")'
        raise ModelError(f"figure: found {found}; expected FRFs analysed line by line; draw plot_frf, or {remedy}")
    lines, (ax,) = _measured_frfs(part).frequency_hz, _axes(ax, 2.4)
    drawing.draw_squares_by_line(ax, lines, checks_of(posterior)[posterior.problem.parts.index(part)].chi2_by_line)
    return ax


def plot_intervals(posterior: Posterior, *, ax: Axes | None = None) -> Axes:
    """Draw median and 95 % interval of each quantity of the joint over its median, and the interval of the prior."""
    labels, ends = [], []
    for name in _of(posterior).stiffness_names:
        low, middle, high = np.quantile(posterior.values(name), [0.025, 0.5, 0.975])
        labels.append(f"{name} = {quantity_text(middle, posterior.unit(name))}")
        ends.append([*np.quantile(posterior.prior_values(name), [0.025, 0.975]), low, middle, high])
    (ax,) = _axes(ax, 0.9 + 0.4 * len(labels))
    drawing.draw_intervals(ax, labels, np.array(ends))
    return ax


def plot_corner(posterior: Posterior, *, fig: Figure | None = None) -> Figure:
    """Draw marginals and pairs of the joint's coordinates, with prior, mode and published values.

    Parameters
    ----------
    posterior
        The posterior.
    fig
        Figure without axes; by default a new one.

    Returns
    -------
    Figure
        With a panel for each coordinate and each pair of coordinates.
    """
    new = "a Figure without axes; pass pyplot.figure()"
    require(fig, Figure | None, "plot_corner: found", new, lambda given: not (given and given.axes))
    values = corner_values(_of(posterior))
    count = len(values[0])
    fig = fig or pyplot.figure(figsize=(1.2 + 2.0 * count, 1.2 + 2.0 * count))
    drawing.draw_corner(fig.subplots(count, count, squeeze=False), *values)
    return fig


def plot_traces(posterior: Posterior, *, axes: AxesArray | None = None) -> AxesArray:
    """Draw each coordinate over the kept draws, on as many axes: median and 95 % range of each ensemble's walkers."""
    names, theta, ensemble = chain_values(_of(posterior))
    axes = _axes(axes, 0.8 + 0.9 / len(names), len(names), 1, sharex=True)
    drawing.draw_traces(axes, names, theta, ensemble)
    return axes


def plot_autocorrelation(posterior: Posterior, *, ax: Axes | None = None) -> Axes:
    """Draw the autocorrelation of each coordinate over lags in steps."""
    names, theta, _ = chain_values(_of(posterior))
    (ax,) = _axes(ax, 2.6)
    drawing.draw_autocorrelation(ax, names, theta, posterior.record.sampler["thin"])
    if len(names) > _MOST_INSIDE:
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small", ncols=-(-len(names) // 12))
    return ax


def plot_profiles(posterior: Posterior, *names: str, axes: AxesArray | None = None) -> AxesArray:
    """Draw the profile likelihood of coordinates of the joint, by default of all, on as many axes.

    Raises
    ------
    ModelError
        If there is no such coordinate, or no data depend on one.
    """
    names = names or _of(posterior).problem.parametrisation.names
    profiles = [region_of(_of(posterior)).profile(name) for name in names]
    axes = _axes(axes, 2.4, len(names), sharey=True)
    drawing.draw_profiles(axes, [profile.on_axis for profile in profiles])
    return axes


def plot_frequencies(posterior: Posterior, *, test: str | None = None, ax: Axes | None = None) -> Axes:
    """Draw how far predicted natural frequencies are from the measured ones.

    Raises
    ------
    ModelError
        If no natural frequencies were measured, or there is no such test.
    """
    part = _of(posterior).problem.part(test)
    measured = measured_frequencies(posterior) if len(posterior.problem.tests) == 1 else part.test.data.lowest_hz
    if not measured:
        raise ModelError("plot_frequencies: found no measured frequencies; expected some; draw plot_frf instead")
    (ax,), guess = _axes(ax, 3.0), posterior.problem.first_guess.tolist()
    frequencies = frequency_summary(posterior, part, guess, measured, 0)
    drawing.draw_frequency_errors(ax, *frequency_values(frequencies, part.test.data))
    return ax


def plot_mode_shape(posterior: Posterior, mode: int = 1, *, test: str | None = None, ax: Axes | None = None) -> Axes:
    """Draw the components of one mode: as measured and predicted where its shape is among the data, else as predicted.

    Measured ones have the number of the data. Predicted ones are counted from the lowest natural frequency, and drawn
    at translations of the structure over the largest.

    Raises
    ------
    ModelError
        If there is no such mode or test, or a body is given by its measured FRFs and has no modes.
    """
    problem = _of(posterior).problem.part(test)
    data = problem.test.data.modes
    shapes = getattr(data, "shapes", None)
    if data is None or shapes is None or mode not in data.numbers:
        return _plot_predicted_shape(posterior, problem, mode, ax)
    shape, (ax,) = compared_modes(posterior, problem, cast(ModeData, data))[0]["shape"], _axes(ax, 2.6)
    drawing.draw_mode_shape(ax, *shape_values(shapes.dofs, shape, data.numbers.index(mode)))
    return ax


def _plot_predicted_shape(posterior: Posterior, problem: Problem, mode: int, ax: Axes | None) -> Axes:
    test, prior = problem.test, problem.prior
    count = 0 if test.measured_bodies else test.most_modes
    require_count(mode, "plot_mode_shape: found mode")
    if mode > count:
        raise ModelError(f"plot_mode_shape: found mode {mode}; expected one of {count} of the model; correct it")
    own = [label for label in test.structures.labels if not label.startswith("~")]  # those are of the mesh alone
    labels = [label for label in own if ":r" not in label] or own
    labels = labels[:: -(-len(labels) // _MOST_SHAPE_DOFS)]
    theta = np.vstack([posterior.estimate.theta, posterior.thinned(_SHAPE_DRAWS)])
    model = AssembledShapes(test.structures, test.joints, mode, labels)
    drawn = model.modes(prior.matrix(theta), problem.structural(prior.factors(theta))).shapes[:, mode - 1]
    largest = int(np.abs(drawn[0]).argmax())
    drawn = drawn / drawn[:, largest : largest + 1]
    low, high = np.quantile(drawn[1:], [0.025, 0.975], axis=0)
    nothing, (ax,) = np.full(len(labels), np.nan), _axes(ax, 2.6)
    drawing.draw_mode_shape(ax, labels, nothing, nothing, drawn[0], low, high, over=labels[largest])
    return ax


def plot_iteration(history: IterationHistory, *, axes: AxesArray | None = None) -> AxesArray:
    """Draw the paper's iteration: the norm of the residual FRF, then each quantity, on as many axes and one more."""
    require(history, IterationHistory, "plot_iteration: found", "the iteration; make it by jb.identify(case)")
    titles = [f"{name} ({unit})" for i, (name, unit) in enumerate(history.units.items()) if i in history.iterated]
    axes = _axes(axes, 2.6, 1 + len(titles))
    drawing.draw_residual_norm(axes[0], history.residual_norm)
    drawing.draw_histories(axes[1:], titles, history.stiffness_history[:, history.iterated], None)
    return axes
