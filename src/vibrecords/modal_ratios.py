"""How much sensors move relative to each other in the modes that measured FRFs show: ratios of residues, with noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrecords.arrays import Array
from vibrecords.frf_set import FrfSet
from vibrecords.modal_problem import ModalProblem, pole_of
from vibrecords.provenance import MeasuredMode

_DIRECTIONS = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class MotionRatio:
    """How much a DOF moves in a mode, over what the reference moves: φ(DOF)/φ(reference).

    Parameters
    ----------
    dof, reference
        Labels; the reference is what moves most in that mode.
    value, sd
        The ratio, and the standard deviation that the noise of the FRFs leaves it.
    """

    dof: str
    reference: str
    value: float
    sd: float


def identify_ratios(frf: FrfSet, variance: Array, modes: Sequence[MeasuredMode]) -> tuple[tuple[MotionRatio, ...], ...]:
    """Ratios of the motions of sensors in each mode, from the residues of a modal model with these poles.

    Sensors that turn are left out: their ratio to one that moves has a unit. Of a roving hammer, where one sensor stays
    and the force goes round, the DOFs of the force have the ratios, by reciprocity.

    Parameters
    ----------
    frf
        FRFs of one structure, of any quantity.
    variance
        σ² = E|δH|² of both parts together, shape as ``frf.values``.
    modes
        Found in them.

    Returns
    -------
    tuple
        Of each mode those of each DOF but its reference; empty where fewer than two DOFs move.

    References
    ----------
    Ewins, D. J. (2000). Modal Testing: Theory, Practice and Application, 2nd ed. Research Studies Press, section 4.4.
    """
    across = [i for i, dof in enumerate(frf.outputs) if dof.rpartition(":")[2] in _DIRECTIONS]
    along = [i for i, dof in enumerate(frf.inputs) if dof.rpartition(":")[2] in _DIRECTIONS]
    if not modes or not across or not along or max(len(across), len(along)) < 2:
        return ((),) * len(modes)
    values, sd = frf.values[:, across][:, :, along], np.sqrt(variance[:, across][:, :, along])
    lines, poles = len(values), pole_of(*np.array([(2 * np.pi * m.frequency_hz, m.damping_ratio) for m in modes]).T)
    problem = ModalProblem(frf.frequency_hz, values.reshape(lines, -1), 1 / sd.reshape(lines, -1), frf.quantity)
    amplitude, error = (part.T.reshape(len(modes), *values.shape[1:]) for part in problem.in_phase(poles))
    dofs = [frf.outputs[i] for i in across]
    if len(dofs) < 2:
        amplitude, error, dofs = amplitude.swapaxes(1, 2), error.swapaxes(1, 2), [frf.inputs[i] for i in along]
    return tuple(_ratios(dofs, *of_mode) for of_mode in zip(amplitude, error, strict=True))


def _ratios(dofs: Sequence[str], amplitude: Array, sd: Array) -> tuple[MotionRatio, ...]:
    """Divide every row by the row that moves most; with standard deviations.

    Amplitudes have one row for each DOF that moves, and one column for each force, which moves all rows in proportion:
    the ratio of two rows is the mean of those of each column, weighted by their errors.
    """
    reference = int(np.linalg.norm(amplitude, axis=1).argmax())
    below, below_sd = amplitude[reference], sd[reference]
    ratio = amplitude / below
    variance = (sd**2 + (ratio * below_sd) ** 2) / below**2
    weight = 1 / variance
    mean, spread = (ratio * weight).sum(axis=1) / weight.sum(axis=1), weight.sum(axis=1) ** -0.5
    each = zip(dofs, mean.tolist(), spread.tolist(), strict=True)
    return tuple(MotionRatio(dof, dofs[reference], *ratio) for dof, *ratio in each if dof != dofs[reference])
