"""Which modes show the joint, and what a natural frequency of each would tell of a stiffness."""

import math

import numpy as np
from numpy.typing import NDArray

from jointbayes.inference import Problem
from jointbayes.posterior.identifiability import IF_MODEL_RIGHT
from jointbayes.report.inputs import TestInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Paragraph, ReportSection, Table
from jointbayes.rounding import number, signed
from vibrecords.arrays import Array

#: Either way, of a difference for 1 % of a stiffness: near the edge of what is positive semidefinite 1 % leaves it.
_STEP = 1e-5
_KNOWN_PERCENT = 0.1  # to which a test usually knows a natural frequency
_MOST_MODES = 12


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
    table = Table(
        "Effect of the joint on natural frequencies",
        (*head, *(f"{foreign(n)} +1 % (%)" for n in names)),
        rows,
        note=note,
    )
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
    frequency_hz = problem.natural_frequencies_hz(joints, count, np.stack([problem.prior.factors(theta)] * len(joints)))
    inside = (frequency_hz[0] >= low) & (frequency_hz[0] <= high)
    best, rigid, *moved = frequency_hz[:, inside]
    more, less = np.split(np.array(moved), 2)
    return np.flatnonzero(inside) + 1, best, rigid, 100 * (more - less) / best * (0.01 / (2 * _STEP))
