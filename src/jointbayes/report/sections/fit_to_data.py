"""Measured and predicted data: whether the model explains them, where it does not, and the FRFs side by side."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf import FrfSet, Ports, Quantity
from jointbayes.inference import Problem
from jointbayes.measurement import FrfData
from jointbayes.posterior import FrfPrediction, Posterior, PredictiveCheck
from jointbayes.posterior.diagnosis import Diagnosis
from jointbayes.posterior.prediction import frfs_as_measured
from jointbayes.posterior.rounding import number, signed
from jointbayes.report import figures
from jointbayes.report.inputs import SetupInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Block, Figure, LinePlot, Paragraph, ReportSection, Series, Table

#: FRFs that have figures, and rows of a table of FRFs; those that fit worst come first.
MOST_FIGURES, MOST_ROWS = 8, 20
_PER_TIME = {"receptance": "", "mobility": "s ", "accelerance": "s² "}


def fit_section(inputs: SetupInputs) -> ReportSection:
    """Measured against predicted."""
    summary, fit = inputs.summary, inputs.summary.fit
    text = (
        f"At the MAP the squared residual is {number(fit.chi2_per_line, 4)} times what the stated noise predicts, "
        f"over {fit.n_data} values (1 is expected)."
    )
    blocks: list[Block] = [Paragraph(text), Paragraph(summary.check.sentence)]
    data = inputs.problem.test.data.frfs
    if data is not None:
        blocks.append(_residuals(data, summary.check))
    blocks += _measure(summary.diagnosis)
    if data is not None:
        blocks += _frf_figures(inputs.posterior, inputs.problem, data, summary.diagnosis)
    return ReportSection("fit", "Measured and predicted", tuple(blocks))


def _residuals(data: FrfData, check: PredictiveCheck) -> Figure:
    """Where the model does not explain the data."""
    lines = data.frf.frequency_hz
    return Figure(
        "residuals",
        "Squared residual of each line over what the noise model expects, mean over posterior draws; the line is a "
        "running mean over 1 % of the lines. Where it stays above 1 the model is wrong.",
        f"Squared residual by frequency; the largest is at {lines[int(np.argmax(check.chi2_by_line))]:.0f} Hz.",
        figures.squares_by_line(lines, check.chi2_by_line),
    )


def _measure(diagnosis: Diagnosis) -> list[Block]:
    """Resonances and correlation of the FRFs, measured against the MAP."""
    blocks: list[Block] = []
    if diagnosis.modes:
        rows = tuple(
            (
                f"{m.measured_hz:.2f}",
                f"{m.predicted_hz:.2f}",
                signed(m.error_percent),
                number(m.damping_ratio, 2),
            )
            for m in diagnosis.modes
        )
        head = ("Measured (Hz)", "MAP (Hz)", "Error (%)", "Damping, measured over MAP")
        note = "Fitted to measured and predicted data in the same way. A dash: natural frequencies have no damping."
        blocks.append(Table("Resonances", head, rows, note=note))
    if diagnosis.pairs:
        shown, note = diagnosis.pairs, ""
        if len(shown) > MOST_ROWS:
            shown = tuple(sorted(shown, key=lambda p: p.correlation)[:MOST_ROWS])
            note = f"The {MOST_ROWS} of {len(diagnosis.pairs)} that correlate least; summary.json has all. "
        pairs = tuple((foreign(f"{p.output}/{p.input}"), f"{p.correlation:.4f}", number(p.level)) for p in shown)
        note += (
            "Correlation: FRF assurance criterion over all lines, 1 where the two are proportional. Level: at the "
            "resonances where there are any."
        )
        blocks.append(Table("FRFs at the MAP", ("FRF", "Correlation", "Level, measured over MAP"), pairs, note=note))
    return blocks


def _frf_figures(posterior: Posterior, problem: Problem, data: FrfData, diagnosis: Diagnosis) -> list[Block]:
    frf = data.frf
    shown = _shown(frf, diagnosis)
    every = len(frf.outputs) * len(frf.inputs)
    blocks: list[Block] = []
    if len(shown) < every:
        frf = frf.select(
            tuple(o for o in frf.outputs if any(o == output for output, _ in shown)),
            tuple(i for i in frf.inputs if any(i == input_ for _, input_ in shown)),
        )
        text = (
            f"Of {every} FRFs the figures show {len(shown)}: one with the highest resonances, and those that correlate "
            "least with the MAP."
        )
        blocks.append(Paragraph(text))
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    band = posterior.predict_frf(None if len(shown) == every else ports, setup=problem.test.name or None)
    theta, prior = posterior.estimate.theta, problem.prior
    # the first guess is one of the joint: all else is as at the MAP, so that the two curves differ by the joint alone
    factors = np.stack([prior.factors(theta)] * 2)
    stiffness = np.array([problem.first_guess, prior.values(theta)])
    guess, best = frfs_as_measured(problem, ports, frf.quantity, stiffness, factors)
    label = "synthetic" if data.synthetic else "measured"
    for i, output in enumerate(frf.outputs):
        for j, input_ in enumerate(frf.inputs):
            if (output, input_) not in shown:
                continue
            at = (slice(None), i, j)
            curves = (frf.values[at], guess[at], best[at])
            magnitude, phase = _magnitude(band, at, curves), _phase(band, at, curves)
            title = f"{frf.quantity} {foreign(f'{output}/{input_}')}"
            unit = frf_unit(frf.quantity, output, input_)
            blocks.append(
                _figure(f"frf-{i}-{j}", magnitude, label, f"Magnitude of the {title}", f"|H| ({unit})", log=True)
            )
            blocks.append(_figure(f"phase-{i}-{j}", phase, label, f"Phase of the {title}", "Phase (°)", log=False))
    return blocks


def _shown(frf: FrfSet, diagnosis: Diagnosis) -> set[tuple[str, str]]:
    """The FRFs that have figures: all, or of many the one with the highest peak and those that correlate least."""
    every = [(output, input_) for output in frf.outputs for input_ in frf.inputs]
    if len(every) <= MOST_FIGURES:
        return set(every)
    highest = every[int(np.abs(frf.values).max(axis=0).argmax())]
    worst = [(p.output, p.input) for p in sorted(diagnosis.pairs, key=lambda p: p.correlation)]
    return {highest, *[pair for pair in worst if pair != highest][: MOST_FIGURES - 1]}


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
