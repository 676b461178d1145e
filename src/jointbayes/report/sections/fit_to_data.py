"""Measured and predicted data: whether the model explains them, the FRFs side by side, and what was left out."""

from collections.abc import Sequence

import numpy as np

from jointbayes.inference import Problem
from jointbayes.posterior import Posterior, PredictiveCheck
from jointbayes.posterior.compared_frfs import ComparedFrf, compared_frfs_of, sentences_of_faults
from jointbayes.posterior.diagnosis import Diagnosis
from jointbayes.posterior.prediction import sentence_of_left_out
from jointbayes.report import drawing
from jointbayes.report.frf_curves import frf_curves
from jointbayes.report.inputs import ReportInputs, TestInputs
from jointbayes.report.line_plot import FrfPlot, LinePlot, Series
from jointbayes.report.markup import foreign
from jointbayes.report.model import Block, Callout, Figure, Paragraph, ReportSection, Table
from jointbayes.rounding import interval, number
from vibrecords import FrfData, FrfSet

#: FRFs that have figures, and rows of a table of FRFs; those that fit worst come first.
MOST_FIGURES, MOST_ROWS = 8, 20
_SHARE_OF_SEVERAL = 0.65  # of the height of a lone FRF, so that a page takes two
_NOT_FITTED = "Its modes were fitted, not its lines: between them and in height it need not agree."
_FIRST = 2  # blocks on FRFs before the residuals and the tables


def fit_section(inputs: TestInputs) -> ReportSection:
    """Measured against predicted."""
    summary = inputs.summary
    blocks: list[Block] = [Paragraph(foreign(f"{summary.check.sentence} {summary.check.advice}"))]
    data, shown = inputs.problem.test.data.frfs, inputs.problem.test.data.shown_frfs
    of_frfs = [] if shown is None else _frf_figures(inputs.posterior, inputs.problem, shown, summary.diagnosis)
    residuals = [] if data is None else [_residuals(data, summary.check)]
    test = inputs.problem.test.name
    compared = compared_frfs_of(inputs.posterior)[test]
    blocks += [Callout("caution", foreign(text)) for text in sentences_of_faults(compared, test)]
    table = _compared(compared) if data is None else _correlations(summary.diagnosis)
    blocks += [*of_frfs[:_FIRST], *residuals, *table, *of_frfs[_FIRST:]]
    blocks.append(Paragraph(f"**For the statistician.** {foreign(summary.check.figures)}"))
    return ReportSection("fit", "Measured and predicted", tuple(blocks))


def _residuals(data: FrfData, check: PredictiveCheck) -> Figure:
    """Where the model does not explain the data."""
    lines, each = data.frf.frequency_hz, np.maximum(check.chi2_by_line, 1e-4)  # none is 0 on a logarithmic axis
    series = [Series("each line", lines, each, "points")]
    middle, mean, name = drawing.running_mean(lines, check.chi2_by_line)
    if mean.size:
        series.append(Series(name, middle, np.maximum(mean, 1e-4)))
    return Figure(
        "residuals",
        "Squared misfit of each line over the noise's, mean over the draws; the line is a running mean over 1 % "
        "of the lines. Where it stays above 1 the model is wrong.",
        f"Squared residual by frequency; the largest is at {lines[int(np.argmax(check.chi2_by_line))]:.0f} Hz.",
        drawing.draw_alone(drawing.draw_squares_by_line, lines, check.chi2_by_line, width=7.2, height=2.4, top=0.3),
        LinePlot("Frequency (Hz)", "Squared residual", tuple(series), log_y=True),
    )


def _correlations(diagnosis: Diagnosis) -> list[Block]:
    """How well each FRF of the best fit correlates with the data."""
    if not diagnosis.pairs:
        return []
    shown, note = diagnosis.pairs, ""
    if len(shown) > MOST_ROWS:
        shown = tuple(sorted(shown, key=lambda p: p.correlation)[:MOST_ROWS])
        note = f"The {MOST_ROWS} of {len(diagnosis.pairs)} that correlate least; summary.json has all. "
    pairs = tuple((foreign(f"{p.output}/{p.input}"), f"{p.correlation:.4f}", number(p.level)) for p in shown)
    note += (
        "Correlation: FRF assurance criterion over all lines, 1 where the two are proportional. Level: at the "
        "resonances where there are any."
    )
    return [Table("FRFs of data and best fit", ("FRF", "Correlation", "Level, data over fit"), pairs, note=note)]


def _compared(compared: Sequence[ComparedFrf]) -> list[Block]:
    """Level and phase of FRFs that were not fitted."""
    if not compared:
        return []
    shown = sorted(compared, key=lambda frf: not frf.faults)[:MOST_ROWS]
    rows = tuple((foreign(f"{f.output}/{f.input}"), f"{f.correlation:.3f}", number(f.level)) for f in shown)
    note = (
        "Over lines above the noise. In phase: mean cosine of the phase, 1 where both agree, −1 where the sign is "
        "opposite. Level: median ratio."
    )
    kinds = tuple("caution" if frf.faults else "" for frf in shown)
    return [
        Table(
            "FRFs of data and answer", ("FRF", "In phase", "Level, data over answer"), rows, note=note, row_kinds=kinds
        )
    ]


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
    share, said = 1.0 if len(shown) == 1 else _SHARE_OF_SEVERAL, dict.fromkeys(shown, _NOT_FITTED)
    if problem.test.data.frfs is not None:
        away = np.abs(data.frf.values - problem.log_posterior.predicted(posterior.estimate.theta)[0]) ** 2
        squares = (away / data.variance).mean(axis=0)  # over all lines, of which a figure may show some
        for output, input_ in shown:
            misfit = np.sqrt(squares[data.frf.outputs.index(output), data.frf.inputs.index(input_)])
            said[output, input_] = f"The MAP misses this FRF by {misfit:#.3g} times the stated noise (1 is expected)."
    blocks += (_figure(plot, share, said[plot.pair]) for plot in frf_curves(posterior, problem, frf, shown))
    return blocks


def _shown(frf: FrfSet, diagnosis: Diagnosis) -> set[tuple[str, str]]:
    """The FRFs that have figures: all, or of many the one with the highest peak and those that correlate least."""
    every = [(output, input_) for output in frf.outputs for input_ in frf.inputs]
    if len(every) <= MOST_FIGURES:
        return set(every)
    highest = every[int(np.abs(frf.values).max(axis=0).argmax())]
    worst = [(p.output, p.input) for p in sorted(diagnosis.pairs, key=lambda p: p.correlation)] or every
    return {highest, *[pair for pair in worst if pair != highest][: MOST_FIGURES - 1]}


def _figure(plot: FrfPlot, share: float, said: str) -> Figure:
    title = f"{plot.quantity} {foreign('/'.join(plot.pair))}"
    first, last = plot.frequency_hz[[0, -1]]
    measured = plot.curves[0].name
    return Figure(
        f"frf-{plot.place[0]}-{plot.place[1]}",
        f"The {title}: {measured}, first guess of the joint, and MAP with the 95 % band of the posterior. {said}",
        f"Magnitude and phase of the {title}, {first:g} to {last:g} Hz: {measured}, first guess, MAP and 95 % band.",
        drawing.frf_overlay(plot, share),
        plot,
    )


def left_out_section(inputs: ReportInputs) -> ReportSection | None:
    """Each value against its interval; None where nothing was left out."""
    predicted = inputs.summary.left_out
    if not predicted:
        return None
    rows = [
        (
            foreign(f"{each.test} {each.names[i]}".strip()),
            number(each.measured[i], 4),
            number(each.median[i], 4),
            interval((each.low[i], each.high[i]), 4),
            "yes" if each.inside[i] else "no",
        )
        for each in predicted
        for i in each.shown
    ]
    count = sum(each.inside.size for each in predicted)
    note = (
        "The intervals are those of a measurement: what is uncertain in joint and structure, the error of the model "
        "where [noise] states one, and the stated noise. Frequencies in Hz, FRFs as magnitudes."
    )
    note += f" Of {count} values those outside." if len(rows) < count else ""
    head = ("Left out", "Measured", "Median", "95 % interval", "Inside")
    kinds = tuple("" if row[-1] == "yes" else "bad" for row in rows)
    table = Table("Left out and predicted", head, tuple(rows), note=note, row_kinds=kinds)
    text = Paragraph(foreign(sentence_of_left_out(predicted)))
    return ReportSection("left-out", "Left out and predicted", (text, table))
