"""Whether the model explains the data: banners, the residuals by line, and the misfit in an engineer's measure."""

import numpy as np

from jointbayes.measurement import FrfMeasurement
from jointbayes.posterior import Knowledge, Posterior
from jointbayes.posterior.rounding import signed
from jointbayes.posterior.summary import Summary
from jointbayes.report import figures
from jointbayes.report.format import number
from jointbayes.report.model import Block, Callout, Figure, Paragraph, Table

__all__ = ["bold_head", "check_banners", "check_blocks"]


def bold_head(sentence: str) -> str:
    """The sentence with what stands before its first colon in bold."""
    head, colon, rest = sentence.partition(":")
    return f"**{head}**{colon}{rest}"


def check_banners(summary: Summary) -> list[Block]:
    """One banner where the model does not explain the data, with what helps; another where the noise is overstated."""
    check = summary.check
    if check.finding == "misfit":
        return [Callout("bad", f"{bold_head(check.sentence)} {summary.diagnosis.sentence}")]
    return [Callout("caution", bold_head(check.sentence))] if check.finding == "noise overstated" else []


def check_blocks(posterior: Posterior, knowledge: Knowledge) -> list[Block]:
    """Whether the model explains the data, and where it does not."""
    check = knowledge.check
    blocks: list[Block] = [Paragraph(check.sentence)]
    measurement = posterior.problem.measurement
    if isinstance(measurement, FrfMeasurement):
        svg = figures.squares_by_line(measurement.frf.frequency_hz, check.chi2_by_line)
        worst = measurement.frf.frequency_hz[int(np.argmax(check.chi2_by_line))]
        blocks.append(
            Figure(
                "residuals",
                "Squared residual of each line over what the noise model expects, mean over posterior draws; the line "
                "is a running mean over 1 % of the lines. Where it stays above 1 the model is wrong.",
                f"Squared residual by frequency; the largest is at {worst:.0f} Hz.",
                svg,
            )
        )
    return [*blocks, *_measure(posterior)]


def _measure(posterior: Posterior) -> list[Block]:
    """Resonances and correlation of the FRFs, measured against the MAP."""
    diagnosis = posterior.diagnosis
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
        pairs = tuple((f"{p.output}/{p.input}", f"{p.correlation:.4f}", number(p.level)) for p in diagnosis.pairs)
        note = (
            "Correlation: FRF assurance criterion over all lines, 1 where the two are proportional. Level: at the "
            "resonances where there are any."
        )
        blocks.append(Table("FRFs at the MAP", ("FRF", "Correlation", "Level, measured over MAP"), pairs, note=note))
    return blocks
