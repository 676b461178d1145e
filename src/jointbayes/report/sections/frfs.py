"""The section that sets measured FRFs beside predicted ones."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf import Ports, Quantity
from jointbayes.measurement import FrfMeasurement
from jointbayes.posterior import FrfPrediction, Knowledge, Posterior
from jointbayes.posterior.prediction import frfs_as_measured
from jointbayes.posterior.summary import Summary
from jointbayes.report import figures
from jointbayes.report.format import number
from jointbayes.report.model import Block, Figure, LinePlot, Paragraph, Section, Series
from jointbayes.report.sections.check import check_blocks

__all__ = ["fit_section", "frf_unit"]

Triple = tuple[float, float, float]

_PER_TIME = {"receptance": "", "mobility": "s ", "accelerance": "s² "}


def fit_section(posterior: Posterior, initial: Triple, summary: Summary, knowledge: Knowledge) -> Section:
    """Measured against predicted."""
    fit = summary.fit
    text = (
        f"At the MAP the squared residual is {number(fit.chi2_per_line, 4)} times what the stated noise predicts, "
        f"over {fit.n_data} values (1 is expected)."
    )
    blocks: list[Block] = [Paragraph(text), *check_blocks(posterior, knowledge)]
    measurement = posterior.problem.measurement
    if isinstance(measurement, FrfMeasurement):
        blocks += _frf_figures(posterior, measurement, initial)
    return Section("fit", "Measured and predicted", tuple(blocks))


def _frf_figures(posterior: Posterior, measurement: FrfMeasurement, initial: Triple) -> list[Block]:
    frf, problem = measurement.frf, posterior.problem
    band = posterior.predict_frf()
    theta, prior = posterior.estimate.theta, problem.prior
    # the first guess is one of the joint: all else is as at the MAP, so that the two curves differ by the joint alone
    factors = np.stack([prior.factors(theta)] * 2)
    stiffness = np.array([initial, prior.stiffness(theta)])
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    guess, best = frfs_as_measured(problem, ports, frf.quantity, stiffness, factors)
    label = "synthetic" if measurement.synthetic else "measured"
    blocks: list[Block] = []
    for i, output in enumerate(frf.outputs):
        for j, input_ in enumerate(frf.inputs):
            at = (slice(None), i, j)
            curves = (frf.values[at], guess[at], best[at])
            magnitude, phase = _magnitude(band, at, curves), _phase(band, at, curves)
            title = f"{frf.quantity} {output}/{input_}"
            unit = frf_unit(frf.quantity, output, input_)
            blocks.append(
                _figure(f"frf-{i}-{j}", magnitude, label, f"Magnitude of the {title}", f"|H| ({unit})", log=True)
            )
            blocks.append(_figure(f"phase-{i}-{j}", phase, label, f"Phase of the {title}", "Phase (°)", log=False))
    return blocks


def frf_unit(quantity: Quantity, output: str, input_: str) -> str:
    """Unit of an FRF between two DOFs: rad for a rotation, N m for a moment."""
    response, force = ("rad" if ":r" in output else "m"), ("N m" if ":r" in input_ else "N")
    below = f"{_PER_TIME[quantity]}{force}"
    return f"{response}/({below})" if " " in below else f"{response}/{below}"


def _magnitude(band: FrfPrediction, at: Any, curves: tuple[NDArray[np.complex128], ...]) -> figures.Overlay:  # noqa: ANN401
    measured, guess, best = (np.abs(curve) for curve in curves)
    low, high = band.magnitude_low[at], band.magnitude_high[at]
    return figures.Overlay(band.frequency_hz, measured, guess, best, low, high)


def _phase(band: FrfPrediction, at: Any, curves: tuple[NDArray[np.complex128], ...]) -> figures.Overlay:  # noqa: ANN401
    # whole turns are chosen so that every curve stays within half a turn of the median prediction
    centre = band.phase_deg[at]
    measured, guess, best = (centre + np.angle(c * np.exp(-1j * np.radians(centre)), deg=True) for c in curves)
    return figures.Overlay(band.frequency_hz, measured, guess, best, band.phase_deg_low[at], band.phase_deg_high[at])


def _figure(identifier: str, data: figures.Overlay, label: str, title: str, y_label: str, *, log: bool) -> Figure:
    x = data.frequency_hz
    plot = LinePlot(
        "Frequency (Hz)",
        y_label,
        (
            Series("95 % band", x, kind="band", y_low=data.low, y_high=data.high),
            Series(label, x, data.measured),
            Series("first guess", x, data.guess, dashed=True),
            Series("MAP", x, data.best),
        ),
        log_y=log,
    )
    return Figure(
        identifier,
        f"{title}: {label}, first guess of the joint, and MAP with the 95 % band of the posterior.",
        f"{title} from {x[0]:g} to {x[-1]:g} Hz: {label}, first guess, MAP and 95 % band.",
        figures.frf_overlay(data, label, y_label, log=log),
        plot,
    )
