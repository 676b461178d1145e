"""Measured FRFs of a run with what the joint predicts of them: curves for figures, tables and downloads."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from jointbayes.frf import Ports
from jointbayes.inference import Problem
from jointbayes.posterior import Posterior
from jointbayes.report.canvas import extremes
from jointbayes.report.inputs import computed_from
from jointbayes.report.line_plot import SERIES_COLOURS, FrfCurve, FrfPlot
from vibrecords import FrfSet, Quantity
from vibrecords.arrays import Indices

_MOST_LINES = 4000  # of a figure: a screen has no more columns of points
_PER_TIME = {"receptance": "", "mobility": "s ", "accelerance": "s² "}


def frf_unit(quantity: Quantity, output: str, input_: str) -> str:
    """Unit of an FRF between two DOFs: rad for a rotation, N m for a moment."""
    response, force = ("rad" if ":r" in output else "m"), ("N m" if ":r" in input_ else "N")
    below = f"{_PER_TIME[quantity]}{force}"
    return f"{response}/({below})" if " " in below else f"{response}/{below}"


def shown_lines(frf: FrfSet) -> Indices:
    """Lines that a figure of FRFs shows: all, or of many those of the highest and lowest magnitude of each stretch."""
    magnitude = np.abs(frf.values).reshape(frf.n_lines, -1).T
    if frf.n_lines <= _MOST_LINES:
        return np.arange(frf.n_lines)
    stretches = _MOST_LINES // (2 * len(magnitude))
    return np.unique(np.concatenate([extremes(column, stretches) for column in magnitude]))


def frf_curves(
    posterior: Posterior, problem: Problem, frf: FrfSet, pairs: Collection[tuple[str, str]] | None = None
) -> list[FrfPlot]:
    """Curves of measured FRFs: as measured, of the first guess, the paper's iteration, the MAP, and the median.

    Of more lines than a figure shows the highest and the lowest of each stretch, so that no peak is lost.

    Parameters
    ----------
    posterior
        Of all tests.
    problem
        The part of its problem whose data they are, or whose modes were read off them.
    frf
        The measured FRFs, or some of them.
    pairs
        Output and input of those that are wanted; by default all.
    """
    data = problem.test.data.shown_frfs
    assert data is not None
    lines = shown_lines(frf)
    frf = frf.at_lines(lines)
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    band = posterior.predict_frf(ports, test=problem.test.name or None)
    theta, prior, iteration = posterior.estimate.theta, problem.prior, posterior.estimate.iteration
    iterated = iteration if iteration is not None and iteration.test == problem.test.name else None
    stiffness = [problem.first_guess, prior.values(theta), *([] if iterated is None else [iterated.stiffness])]
    # the first guess is one of the joint: all else is as at the MAP, so that the curves differ by the joint alone
    factors = np.stack([prior.factors(theta)] * len(stiffness))
    guess, best, *others = problem.frfs_as_measured(ports, frf.quantity, np.array(stiffness), factors)
    sizes = band.magnitude_low, band.magnitude, band.magnitude_high
    turns = (np.exp(1j * np.radians(angle)) for angle in (band.phase_deg_low, band.phase_deg, band.phase_deg_high))
    low, median, high = ((size * turn).astype(np.complex128) for size, turn in zip(sizes, turns, strict=True))
    blue, *colours = SERIES_COLOURS
    curves = [
        FrfCurve("computed" if data.synthetic or computed_from(posterior) else "measured", frf.values, colours[0]),
        FrfCurve("first guess", guess, colours[1], dashed=True),
        FrfCurve("MAP", best, colours[2]),
        *(FrfCurve("paper's iteration", each, colours[3], True, True) for each in others if np.isfinite(each).all()),
        FrfCurve("median", median, blue, hidden=True),
    ]
    outputs, inputs = (np.array([every.index(dof) for dof in some], dtype=int) for every, some in (
        (data.frf.outputs, frf.outputs), (data.frf.inputs, frf.inputs)))  # fmt: skip
    misfit = np.abs(frf.values - best) / np.sqrt(data.variance[lines][:, outputs[:, None], inputs])
    return [
        FrfPlot(
            (output, input_),
            (i, j),
            frf.quantity,
            frf_unit(frf.quantity, output, input_),
            frf.frequency_hz,
            tuple(replace(curve, values=curve.values[:, i, j]) for curve in curves),
            (low[:, i, j], high[:, i, j]),
            misfit[:, i, j],
            None if frf.coherence is None else frf.coherence[:, i, j],
        )
        for i, output in enumerate(frf.outputs)
        for j, input_ in enumerate(frf.inputs)
        if pairs is None or (output, input_) in pairs
    ]
