"""Measured and predicted data: whether the model explains them, the FRFs side by side, and what was left out."""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from jointbayes.frf import Ports
from jointbayes.inference import Problem
from jointbayes.posterior import Posterior
from jointbayes.posterior.compared_frfs import ComparedFrf, compared_frfs_of, sentences_of_faults
from jointbayes.posterior.diagnosis import Diagnosis, PairFit
from jointbayes.posterior.prediction import sentence_of_left_out
from jointbayes.report import drawing
from jointbayes.report.canvas import extremes
from jointbayes.report.inputs import ReportInputs, TestInputs, computed_from, explained
from jointbayes.report.markup import foreign
from jointbayes.report.model import (
    SERIES_COLOURS,
    Block,
    Callout,
    Figure,
    FrfCurve,
    FrfPlot,
    LinePlot,
    Paragraph,
    ReportSection,
    Series,
    Table,
)
from jointbayes.rounding import interval, number
from vibrecords import FrfData, FrfSet, Quantity
from vibrecords.arrays import Array, Indices

_MOST_LINES = 4000  # of a figure: a screen has no more columns of points
_PER_TIME = {"receptance": "", "mobility": "s ", "accelerance": "s² "}


def frf_unit(quantity: Quantity, output: str, input_: str) -> str:
    """Unit of an FRF between two DOFs: rad for a rotation, N m for a moment."""
    response, force = ("rad" if ":r" in output else "m"), ("N m" if ":r" in input_ else "N")
    below = f"{_PER_TIME[quantity]}{force}"
    return f"{response}/({below})" if " " in below else f"{response}/{below}"


def shown_lines(frf: FrfSet) -> Indices:
    """Return the lines that a figure of FRFs shows: all, or of many the highest and lowest of each stretch."""
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


#: FRFs that have figures, and rows of a table of FRFs; those that fit worst come first.
MOST_FIGURES, MOST_ROWS = 8, 20
_SHARE_OF_SEVERAL = 0.65  # of the height of a lone FRF, so that a page takes two
_FIRST = 2  # blocks on FRFs before the residuals and the tables


def fit_section(inputs: TestInputs) -> ReportSection:
    """Measured against predicted, what is explained worst first."""
    summary, test, data = inputs.summary, inputs.problem.test.name, inputs.problem.test.data
    check, diagnosis = summary.check, summary.diagnosis
    # 1. Whether the model explains the data, and what and which sensor to check.
    advice = check.advice if check.explains else " ".join((*diagnosis.advice, check.advice))
    of_test = f"Test {test}: " if test else ""
    blocks: list[Block] = [Paragraph(foreign(f"{of_test}The model {explained(check)} {advice}"))]
    compared = compared_frfs_of(inputs.posterior)[test]
    blocks += [Callout("caution", foreign(text)) for text in sentences_of_faults(compared, test)]
    # 2. Figures of FRFs, and a table of them all.
    shown = data.shown_frfs
    of_frfs = [] if shown is None else _frf_figures(inputs.posterior, inputs.problem, shown, diagnosis)
    residuals = list[Block]()
    if data.frfs is None:
        note = "Over lines above the noise. Agreement: mean cosine of the phase, −1 where the sign is opposite. Level: "
        table = table_of_frfs("FRFs of data and answer", compared, f"{note}median ratio.", compared)
    else:
        note = "Agreement: FRF assurance criterion over all lines, 1 where the two are proportional. Level: at the "
        note += "resonances where there are any."
        lines, each = data.frfs.frf.frequency_hz, np.maximum(check.chi2_by_line, 1e-4)  # none is 0 on a log axis
        series = [Series("each line", lines, each, "points")]
        middle, mean, name = drawing.running_mean(lines, check.chi2_by_line)
        if mean.size:
            series.append(Series(name, middle, np.maximum(mean, 1e-4)))
        caption = (
            "Squared residual of each line over the noise's, mean over the draws; the line is a running mean over "
        )
        caption += "1 % of the lines. Where it stays above 1 the model is wrong."
        largest = (
            f"Squared residual by frequency; the largest is at {lines[int(np.argmax(check.chi2_by_line))]:.0f} Hz."
        )
        squares, size = drawing.draw_squares_by_line, {"width": 7.2, "height": 2.4, "top": 0.3}
        drawn = drawing.draw_alone(squares, lines, check.chi2_by_line, **size)
        plot = LinePlot("Frequency (Hz)", "Squared residual", tuple(series), log_y=True)
        residuals.append(Figure("residuals", caption, largest, drawn, plot))
        table = table_of_frfs("FRFs of data and best fit", diagnosis.pairs, note, compared)
    return ReportSection(
        "fit", "Measured and predicted", (*blocks, *of_frfs[:_FIRST], *residuals, *table, *of_frfs[_FIRST:])
    )


def check_section(inputs: ReportInputs) -> ReportSection:
    """What the check of each test rests on, for who knows the tests."""
    checks = (test.summary.check for test in inputs.tests)
    said = (Paragraph(foreign(f"{check.sentence} {check.figures}")) for check in checks)
    return ReportSection("check", "Check of the model", tuple(said))


def table_of_frfs(
    title: str, pairs: Sequence[PairFit | ComparedFrf], note: str, compared: Sequence[ComparedFrf] = ()
) -> list[Block]:
    """A row for each FRF, those that are furthest off first; a tint for those whose sensor is to be checked."""

    def off(pair: PairFit | ComparedFrf) -> float:
        away = (1 - pair.correlation, abs(math.log(pair.level)) if pair.level > 0 else math.nan)
        return max((each for each in away if math.isfinite(each)), default=0.0)

    if not pairs:
        return []
    suspect = {(frf.output, frf.input) for frf in compared if frf.faults}
    shown = sorted(pairs, key=off, reverse=True)[:MOST_ROWS]
    rows = tuple((foreign(f"{p.output}/{p.input}"), f"{p.correlation:.4f}", number(p.level)) for p in shown)
    more = f"The {MOST_ROWS} of {len(pairs)} that are furthest off; summary.json has all. "
    kinds = tuple("caution" if (p.output, p.input) in suspect else "" for p in shown)
    head = ("FRF", "Agreement", "Level, measured over predicted")
    return [Table(title, head, rows, note=f"{more * (len(pairs) > MOST_ROWS)}{note}", row_kinds=kinds)]


def _frf_figures(posterior: Posterior, problem: Problem, data: FrfData, diagnosis: Diagnosis) -> list[Block]:
    """Figures of all FRFs, or of many those that correlate least and the one with the highest peak; the worst first."""
    frf, blocks = data.frf, list[Block]()
    every = [(output, input_) for output in frf.outputs for input_ in frf.inputs]
    shown = shown_frfs(every, np.abs(frf.values), diagnosis)
    if len(shown) < len(every):
        frf = frf.select(
            tuple(o for o in frf.outputs if any(o == output for output, _ in shown)),
            tuple(i for i in frf.inputs if any(i == input_ for _, input_ in shown)),
        )
        text = f"Of {len(every)} FRFs the figures show {len(shown)}: one with the highest resonances, and those that "
        blocks.append(Paragraph(f"{text}correlate least with the MAP."))
    squares = None
    if problem.test.data.frfs is not None:  # over all lines, of which a figure may show some
        away = np.abs(data.frf.values - problem.log_posterior.predicted(posterior.estimate.theta)[0]) ** 2
        squares = (away / data.variance).mean(axis=0)
    plots = frf_curves(posterior, problem, frf, shown)
    for plot in sorted(plots, key=lambda plot: -float(np.mean(plot.misfit**2))):
        output, input_ = plot.pair
        said = "Its modes were fitted, not its lines: between them and in height it need not agree."
        if squares is not None:
            rms = math.sqrt(squares[data.frf.outputs.index(output), data.frf.inputs.index(input_)])
            said = f"The MAP misses this FRF by {rms:#.3g} times the stated noise (1 is expected)."
        title, measured = f"{plot.quantity} {foreign('/'.join(plot.pair))}", plot.curves[0].name
        said += f" Dotted: the line that is explained worst, {plot.worst_hz:.5g} Hz."
        first, last = plot.frequency_hz[[0, -1]]
        caption = f"The {title}: {measured}, first guess of the joint, and MAP with the 95 % band of the posterior."
        alt = (
            f"Magnitude and phase of the {title}, {first:g} to {last:g} Hz: {measured}, first guess, MAP and 95 % band."
        )
        share = 1.0 if len(shown) == 1 else _SHARE_OF_SEVERAL
        name = f"frf-{plot.place[0]}-{plot.place[1]}"
        blocks.append(Figure(name, f"{caption} {said}", alt, drawing.frf_overlay(plot, share), plot))
    return blocks


def shown_frfs(every: Sequence[tuple[str, str]], magnitude: Array, diagnosis: Diagnosis) -> set[tuple[str, str]]:
    """The FRFs that have figures: all, or of many the one with the highest peak and those that correlate least."""
    if len(every) <= MOST_FIGURES:
        return set(every)
    highest = every[int(magnitude.max(axis=0).argmax())]
    worst = [(p.output, p.input) for p in sorted(diagnosis.pairs, key=lambda p: p.correlation)] or every
    return {highest, *[pair for pair in worst if pair != highest][: MOST_FIGURES - 1]}


def left_out_section(inputs: ReportInputs) -> ReportSection | None:
    """Each value against its interval; None where nothing was left out."""
    predicted = inputs.summary.left_out
    if not predicted:
        return None
    shown = [(each, i) for each in predicted for i in each.shown]
    columns = {
        "Left out": [foreign(f"{each.test} {each.names[i]}".strip()) for each, i in shown],
        "Measured": [number(each.measured[i], 4) for each, i in shown],
        "Median": [number(each.median[i], 4) for each, i in shown],
        "95 % interval": [interval((each.low[i], each.high[i]), 4) for each, i in shown],
        "Inside": ["yes" if each.inside[i] else "no" for each, i in shown],
    }
    count = sum(each.inside.size for each in predicted)
    note = (
        "The intervals are those of a measurement: what is uncertain in joint and structure, the error of the model "
        "where [noise] states one, and the stated noise. Frequencies in Hz, FRFs as magnitudes."
    )
    note += f" Of {count} values those outside." if len(shown) < count else ""
    kinds = tuple("" if inside == "yes" else "bad" for inside in columns["Inside"])
    table = Table.of("Left out and predicted", columns, note=note, row_kinds=kinds)
    text = Paragraph(foreign(sentence_of_left_out(predicted)))
    return ReportSection("left-out", "Left out and predicted", (text, table))
