"""Natural frequencies: measured, with the first guess of the joint, and predicted."""

import numpy as np

from jointbayes.measurement import ModalMeasurement
from jointbayes.report import figures
from jointbayes.report.inputs import SetupInputs
from jointbayes.report.model import Block, Figure, Section, Table


def frequency_section(inputs: SetupInputs) -> Section | None:
    """Natural frequencies: measured, first guess, MAP, interval; None where the model has none."""
    frequencies = inputs.said.natural_frequencies_hz
    if not frequencies.map:
        return None
    measured = frequencies.measured
    rows = []
    for i, (guess, best, ends) in enumerate(
        zip(frequencies.initial, frequencies.map, frequencies.interval95, strict=True)
    ):
        row = [str(i + 1), f"{guess:.2f}", f"{best:.2f}", f"{ends[0]:.2f} … {ends[1]:.2f}"]
        if measured:
            row.insert(1, f"{measured[i]:.1f}")
        rows.append(tuple(row))
    head = ["Mode", "First guess (Hz)", "MAP (Hz)", "95 % interval (Hz)"]
    if measured:
        head.insert(1, "Measured (Hz)")
    blocks: list[Block] = [Table("Natural frequencies, undamped", tuple(head), tuple(rows))]
    measurement = inputs.part.measurement
    if measured:
        sd = measurement.sd_hz if isinstance(measurement, ModalMeasurement) else None
        low, high = np.array(frequencies.interval95).T
        series = {"MAP": np.array(frequencies.map), "95 % interval": (low, high)}
        svg = figures.frequency_errors(np.array(measured), sd, series)
        caption = "Predicted natural frequencies against the measured ones."
        if inputs.said.fit.synthetic_data:
            caption += " The FRF data are synthetic, so that these measured frequencies were not fitted."
        worst = max(abs(100 * (b / m - 1)) for b, m in zip(frequencies.map, measured, strict=True))
        alt = f"Deviation of predicted natural frequencies by mode; the largest at the MAP is {worst:.2f} per cent."
        blocks.append(Figure("frequencies-plot", caption, alt, svg))
    return Section("frequencies", "Natural frequencies", tuple(blocks))
