"""Natural frequencies and modes: all that was measured of them against what is predicted, and which show the joint."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.inference import ModePrediction, Problem, mac
from jointbayes.phrases import IF_MODEL_RIGHT
from jointbayes.posterior import Posterior
from jointbayes.posterior.summary import FrequencySummary
from jointbayes.report import drawing
from jointbayes.report.inputs import TestInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Block, Figure, Paragraph, ReportSection, Table
from jointbayes.report.structure_sketch import wireframe
from jointbayes.rounding import interval, number, signed
from vibrecords import Data, ModeData, Observed
from vibrecords.arrays import Array

_DRAWS = 1000
_MOST_ROWS, _MOST_FIGURES, _MOST_SHAPES = 60, 8, 6
_SAME = 0.05  # of a frequency: a peak farther from it belongs to another mode
#: Either way, of a difference for 1 % of a stiffness: near the edge of what is positive semidefinite 1 % leaves it.
_STEP = 1e-5
_KNOWN_PERCENT = 0.1  # to which a test usually knows a natural frequency
_MOST_MODES = 12
_PEAKS = (
    "The MAP's frequencies are undamped ones. Error and damping compare peaks, read in the same way in data and MAP."
)


def frequency_section(inputs: TestInputs) -> ReportSection | None:
    """Compare natural frequencies of model and data; None if there are neither."""
    frequencies, peaks = inputs.summary.natural_frequencies_hz, inputs.summary.diagnosis.modes
    measured, modes = frequencies.measured, inputs.problem.test.data.modes
    best = np.array(frequencies.map or [peak.predicted_hz for peak in peaks])
    if not best.size:
        return None
    of_data = "Peak of the data (Hz)" if modes is None else "Measured (Hz)"
    seen = [min(peaks, key=lambda peak: abs(peak.predicted_hz - hz), default=None) for hz in best]
    seen = [
        peak if peak and abs(peak.predicted_hz / hz - 1) < _SAME else None for peak, hz in zip(seen, best, strict=True)
    ]
    beyond = [peak for peak in peaks if peak not in seen]  # modes that are not among those of the table
    seen, more = [*seen, *beyond], ["–"] * len(beyond)
    columns = {
        "Mode": [*(str(i + 1) for i in range(best.size)), *more],
        of_data: ["–" if peak is None else f"{peak.measured_hz:.2f}" for peak in seen],
        "Published (Hz)": [*(f"{hz:.1f}" for hz in (measured or ()) if modes is None), *more],
        "First guess (Hz)": [*(f"{hz:.2f}" for hz in frequencies.initial), *more],
        "MAP (Hz)": [*(f"{hz:.2f}" for hz in best), *more],
        "95 % interval (Hz)": [*(f"{low:.2f} to {high:.2f}" for low, high in frequencies.interval95), *more],
        "Error (%)": ["–" if peak is None else signed(peak.error_percent) for peak in seen],
        "Damping, data over MAP": ["–" if peak is None else number(peak.damping_ratio, 2) for peak in seen],
    }
    shown = {head: cells for head, cells in columns.items() if set(cells) - {"–"}}
    note = _PEAKS if modes is None and peaks else ""
    blocks: list[Block] = [Table.of("Natural frequencies", shown, note=f"{note} {_whose(inputs.problem)}".strip())]
    ranges = zip(columns["MAP (Hz)"][: best.size], columns["95 % interval (Hz)"], strict=False)
    names = tuple(f"Mode {i}: {hz} Hz ({ends})" for i, (hz, ends) in enumerate(ranges, 1))[:_MOST_SHAPES]
    frame = wireframe(inputs.problem, inputs.posterior.estimate, names)
    if frame is not None:
        caption = "Shapes of the modes at the MAP, over the structure at rest; the frequency with its 95 % interval."
        alt = f"{len(names)} mode shapes drawn on the structure. {'; '.join(names)}."
        blocks.append(Figure("mode-shapes", caption, alt, drawing.wireframes(frame), frame))
    if measured:
        errors = frequency_values(frequencies, inputs.problem.test.data)
        kind = errors[-1]
        svg = drawing.draw_alone(drawing.draw_frequency_errors, *errors, height=3.0, top=0.3)
        caption = f"Predicted natural frequencies against the {kind} ones."
        caption += " These were not fitted: the FRFs were." if modes is None else ""
        worst = max(abs(100 * (b / m - 1)) for b, m in zip(frequencies.map, measured, strict=True))
        alt = f"Deviation of predicted natural frequencies by mode; the largest at the MAP is {worst:.2f} per cent."
        blocks.append(Figure("frequencies-plot", caption, alt, svg))
    return ReportSection("frequencies", "Natural frequencies", tuple(blocks))


def frequency_values(frequencies: FrequencySummary, data: Data) -> tuple[Array, Array | None, dict[str, Any], str]:
    """Measured frequencies, their standard deviations if they are the data, what is predicted, and their kind."""
    low, high = np.array(frequencies.interval95).T
    series = {"MAP": np.array(frequencies.map), "95 % interval": (low, high)}
    sd, kind = (None, "published") if data.modes is None else (data.modes.sd_hz, "measured")
    return np.array(frequencies.measured), sd, series, kind


def _whose(problem: Problem) -> str:
    """Whose intervals they are, where the model is not taken for exact: the model's; empty where it is."""
    if problem.test.noise is None or problem.test.noise.shares is None:
        return ""
    return "The 95 % intervals are the model's; they hold neither its own error nor a measurement's."


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """One kind of quantity, measured against the MAP and the ends of its 95 % interval; arrays of one shape."""

    measured: Array
    sd: Array
    best: Array
    low: Array
    high: Array

    def row(self, at: tuple[int, ...]) -> tuple[str, ...]:
        """Measured, sd, MAP, deviation in standard deviations, interval."""
        ends = interval((self.low[at], self.high[at]), 4)
        if np.isnan(self.measured[at]):
            return ("–", "–", number(self.best[at], 4), "–", ends)
        away = (self.best[at] - self.measured[at]) / self.sd[at]
        return (number(self.measured[at], 4), number(self.sd[at], 2), number(self.best[at], 4), signed(away), ends)


def own_section(inputs: TestInputs) -> ReportSection | None:
    """The section that the kind of data registers, see `compared_section`; None where it has none."""
    return compared_section(inputs.problem.test.data, inputs)


@singledispatch
def compared_section(data: Data, inputs: TestInputs) -> ReportSection | None:
    """Measured against predicted values, if that kind of data registers a section with ``@compared_section.register``.

    FRFs and natural frequencies have theirs among the sections of all data.
    """
    return None


@compared_section.register
def _modes_section(measured: ModeData, inputs: TestInputs) -> ReportSection:
    posterior, problem = inputs.posterior, inputs.problem
    parts, likeness, places = compared_modes(posterior, problem, measured)
    head = ("Measured", "sd", "MAP", "MAP − measured (sd)", "95 % interval")
    rows = []
    for name, compared in parts.items():
        if name == "zero" and measured.zeros is not None:
            each_zero = enumerate(zip(measured.zeros.numbers, measured.zeros.dofs, strict=True))
            rows += [(f"Antiresonance {n} of {foreign(dof)} (Hz)", *compared.row((i,))) for i, (n, dof) in each_zero]
        elif name == "constant" and measured.constants is not None:
            pairs = list(enumerate(foreign("/".join(pair)) for pair in measured.constants.pairs))
            rows += [
                (f"Modal constant {pair} (1/kg), mode {n}", *compared.row((i, j)))
                for i, n in enumerate(measured.numbers)
                for j, pair in pairs
            ]
        elif name != "shape":
            rows += [(f"{name}, mode {n}", *compared.row((i,))) for i, n in enumerate(measured.numbers)]
    repetitions = len(measured.frequency.values)
    note = f"Means over {repetitions} repetitions, weighted by their precision, and their standard deviations. "
    note = f"{note if repetitions > 1 else ''}Frequencies are undamped ones. {_whose(problem)}".strip()
    blocks: list[Block] = [Table("Modes, measured and predicted", ("Quantity", *head), tuple(rows), note=note)]
    if "shape" in parts and measured.shapes is not None:
        shape, dofs = parts["shape"], measured.shapes.dofs
        each = [
            (f"{foreign(dof)} over {foreign(measured.references[i])}, mode {n}", *shape.row((i, j)))
            for i, n in enumerate(measured.numbers)
            for j, dof in enumerate(dofs)
        ]
        more = f"The first {_MOST_ROWS} of {len(each)}." if len(each) > _MOST_ROWS else ""
        blocks.append(Table("Components of mode shapes", ("Component", *head), tuple(each[:_MOST_ROWS]), note=more))
        matched = tuple(
            (str(n), str(place + 1), number(mac, 4))
            for n, place, mac in zip(measured.numbers, places, likeness, strict=True)
        )
        how = "the number that the data state" if measured.match == "number" else "the nearest shape"
        note = f"Matched by {how}, at the MAP. Modal assurance criterion: 1 where the two shapes are proportional."
        of_match = ("Measured mode", "Mode of the model", "Modal assurance criterion")
        blocks.append(Table("Matched modes", of_match, matched, note=note))
        blocks += _figures(measured, shape)
    return ReportSection("modes", "Modes", tuple(blocks))


def compared_modes(
    posterior: Posterior, problem: Problem, measured: ModeData
) -> tuple[dict[str, Compared], Array, NDArray[np.intp]]:
    """Each kind of quantity by name; and of each mode its MAC and its partner's place (from 0) at the MAP."""
    prediction = ModePrediction(measured, problem.test.structures, problem.test.joints)
    prior = problem.prior
    theta = np.vstack([posterior.estimate.theta, posterior.thinned(_DRAWS)])
    matrices, factors = prior.matrix(theta), problem.structural(prior.factors(theta))
    modal, places = prediction.matched(matrices, factors)
    both: dict[str, tuple[Observed, Array]] = {"Frequency (Hz)": (measured.frequency, modal.frequency_hz)}
    if measured.eigenvalues:
        both = {"Eigenvalue (rad²/s²)": (measured.frequency, (2 * np.pi * modal.frequency_hz) ** 2)}
    if measured.damping is not None:
        both["Damping ratio"] = measured.damping, modal.damping_ratio
    if measured.zeros is not None:
        both["zero"] = measured.zeros.frequency, modal.zeros_hz
    if measured.constants is not None:
        both["constant"] = measured.constants.constants, prediction.constants(modal)
    likeness = np.empty(0)
    if measured.shapes is not None:
        both["shape"] = measured.shapes.components, prediction.components(modal)
        likeness = np.diagonal(mac(prediction.measured_shapes, modal.shapes[0]))
    parts = {
        name: Compared(*observed.mean(), predicted[0], *np.quantile(predicted[1:], [0.025, 0.975], axis=0))
        for name, (observed, predicted) in both.items()
    }
    return parts, likeness, places[0]


def shape_values(dofs: Sequence[str], shape: Compared, place: int) -> tuple[Any, ...]:
    """Labels of the DOFs, and what is compared of the mode at this place: measured, sd, MAP and interval."""
    arrays = (shape.measured, shape.sd, shape.best, shape.low, shape.high)
    return [foreign(dof) for dof in dofs], *(array[place] for array in arrays)


def _figures(measured: ModeData, shape: Compared) -> list[Block]:
    """Components, measured and predicted, of each mode of which some were measured."""
    assert measured.shapes is not None
    blocks: list[Block] = []
    with_some = [i for i, components in enumerate(shape.measured) if not np.isnan(components).all()]
    for i in with_some[:_MOST_FIGURES]:
        n = measured.numbers[i]
        name = f"mode-shape-{n}"
        caption = f"Shape of mode {n} over its component at {foreign(measured.references[i])}: measured with 95 %, "
        caption += "MAP, and the 95 % interval of the posterior."
        away = np.abs((shape.best[i] - shape.measured[i]) / shape.sd[i])
        alt = f"Components of mode {n}; the largest deviation of the MAP is {number(np.nanmax(away), 2)} sd."
        svg = drawing.draw_alone(drawing.draw_mode_shape, *shape_values(measured.shapes.dofs, shape, i), top=0.3)
        blocks.append(Figure(name, caption, alt, svg))
    return blocks


def joint_in_modes_section(inputs: TestInputs) -> ReportSection | None:
    """Effect of the joint on each natural frequency in the band of the data; None where there is none."""
    problem = inputs.problem
    names = tuple(problem.quantities[i].name for i in _stiffnesses(problem))
    if not names:
        return None
    modes, best, rigid, change = _modes_in_band(problem, inputs.posterior.estimate.theta)
    if not modes.size:
        return None
    rows = tuple(
        (
            str(mode),
            f"{f:.2f}",
            f"{stiff:.2f}",
            signed(100 * (f / stiff - 1)),
            f"{200 * slopes.sum():.2f}",  # λ = φᵀKφ + Σ k φᵀ(∂K^J/∂k)φ: the share of k is 2 ∂ln f/∂ln k
            *(number(slope, 2) for slope in slopes),
        )
        for mode, f, stiff, slopes in zip(modes, best, rigid, change.T, strict=True)
    )
    head = ("Mode", "MAP (Hz)", "Rigid joint (Hz)", "The joint's effect (%)", "Strain energy in the joint (%)")
    note = (
        "Undamped, at the MAP. The last columns: change of the natural frequency in per cent if this stiffness alone "
        "rose by 1 %."
    )
    whole = (*head, *(f"{foreign(n)} +1 % (%)" for n in names))
    table = Table("Effect of the joint on natural frequencies", whole, rows, note=note)
    sentence = _sentence(modes, names, change)
    if not inputs.summary.check.explains and inputs.summary.fit.synthetic_data:
        sentence = f"{IF_MODEL_RIGHT.capitalize()}: {sentence[0].lower()}{sentence[1:]}"
    return ReportSection("joint-in-modes", "Which modes show the joint", (Paragraph(sentence), table))


def _sentence(modes: NDArray[np.intp], names: tuple[str, ...], change: Array) -> str:
    """How well the mode that shows a stiffness most would tell it."""
    accuracies, telling = [], []
    for name, slopes in zip(names, change, strict=True):
        most = int(np.argmax(np.abs(slopes)))
        telling.append(modes[most])
        reached = _KNOWN_PERCENT / max(abs(slopes[most]), np.finfo(float).tiny)
        to = f"to {number(reached, 2)} %" if reached < 100 else "not even by its order"
        accuracies.append(f"**{foreign(name)}** {to}")
    measured = f"measured to {_KNOWN_PERCENT:g} %, with inputs exact, it gives"
    if len(set(telling)) == 1:
        return f"Mode {telling[0]} is the most telling: {measured} {', '.join(accuracies)}."
    each = (f"{accuracy} (mode {mode})" for accuracy, mode in zip(accuracies, telling, strict=True))
    return f"The mode that is most telling of a stiffness: {measured} {', '.join(each)}."


def _stiffnesses(problem: Problem) -> list[int]:
    """Which quantities are stiffnesses of a joint of this test."""
    return [i for i, quantity in enumerate(problem.quantities) if quantity.role == "stiffness" and quantity.places]


def _modes_in_band(problem: Problem, theta: Array) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """Numbers of the modes within the data's band, natural frequencies with the joint and with a rigid one, Hz.

    Last, the change in per cent for 1 % more of each stiffness, shape (stiffnesses, modes).
    """
    modes = problem.test.data.modes
    count, low, high = _MOST_MODES, *problem.test.data.band_hz
    if modes is not None:
        count, low, high = max(modes.numbers), np.finfo(float).tiny, math.inf
    count = min(count, problem.test.most_modes)
    if count < 1:  # a rigid joint would leave no mode
        return np.empty(0, dtype=np.intp), *np.empty((2, 0)), np.empty((0, 0))
    k = problem.prior.values(theta)
    steps = _STEP * np.eye(k.size)[_stiffnesses(problem)]
    joints = np.stack([k, problem.parametrisation.rigid, *(k * (1 + steps)), *(k * (1 - steps))])
    here = problem.with_test(structure=problem.test.structures.solved_anew())  # because few joints need no table
    frequency_hz = here.natural_frequencies_hz(joints, count, np.stack([problem.prior.factors(theta)] * len(joints)))
    inside = (frequency_hz[0] >= low) & (frequency_hz[0] <= high)
    best, rigid, *moved = frequency_hz[:, inside]
    more, less = np.split(np.array(moved), 2)
    return np.flatnonzero(inside) + 1, best, rigid, 100 * (more - less) / best * (0.01 / (2 * _STEP))
