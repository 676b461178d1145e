"""Values of modes with their standard deviations: of shapes, antiresonances, modal constants, and what each is."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vibrecords.arrays import Array, convert_fields
from vibrecords.errors import MeasurementError, array_of
from vibrecords.frf_set import read_only

_WIDEST = 1e100  # of a value: squares stay finite
#: What a value of a mode is, in the order in which they come.
ModeQuantity = Literal["frequency", "eigenvalue", "damping", "shape", "zero", "constant"]


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """Values with the standard deviations of their errors, which are independent; NaN where nothing was observed.

    Parameters
    ----------
    values
        Observed values, one row for each repetition of the test; of a single repetition without that axis.
    sd
        Standard deviation of each, or of all repetitions alike: any shape that broadcasts to that of the values.
    """

    values: Array
    sd: Array

    def rows(self, shape: tuple[int, ...], what: str) -> "Observed":
        """The same with one row for each repetition, shape (repetitions, *shape); checked.

        Raises
        ------
        MeasurementError
            If shapes do not agree, nothing was observed, or a standard deviation is not positive.
        """
        values = array_of(self.values, float, what, MeasurementError)
        given, values = values.shape, values[None] if values.ndim == len(shape) else values
        if values.shape[1:] != shape or len(values) == 0:
            expected = f"(repetitions, {', '.join(map(str, shape))})"
            raise MeasurementError(f"{what}: found values of shape {given}; expected {expected}; correct them")
        stated = array_of(self.sd, float, f"{what}: sd", MeasurementError)
        try:
            sd = np.broadcast_to(stated, values.shape)
        except ValueError:
            raise MeasurementError(
                f"{what}: found standard deviations of shape {stated.shape}; expected one for each value, shape "
                f"{values.shape}, or one for all; correct them"
            ) from None
        seen = ~np.isnan(values)
        if not (np.abs(values[seen]) < _WIDEST).all() or not seen.any():
            raise MeasurementError(f"{what}: found no finite value, or infinity; expected numbers, NaN where none is")
        if not ((sd[seen] > 1 / _WIDEST) & (sd[seen] < _WIDEST)).all():
            raise MeasurementError(f"{what}: found a standard deviation that is not above 0; expected one; correct it")
        return Observed(read_only(values), read_only(np.where(seen, sd, np.nan)))

    def mean(self) -> tuple[Array, Array]:
        """Weighted mean over repetitions and its standard deviation; NaN where nothing was observed."""
        weight = np.where(np.isnan(self.values), 0.0, 1 / self.sd**2)
        total = weight.sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.nansum(weight * self.values, axis=0) / total, 1 / np.sqrt(total)


@dataclass(frozen=True, slots=True, eq=False)
class ModeShapes:
    """Components of mode shapes relative to that at a reference DOF, which is 1.

    Parameters
    ----------
    dofs
        Labels of the p DOFs.
    reference
        Label of the reference DOF; or one for each mode, where no DOF moves in all of them.
    components
        φ(DOF)/φ(reference), shape (repetitions, n, p) or (n, p).
    """

    dofs: tuple[str, ...]
    reference: str | tuple[str, ...]
    components: Observed

    def rows(self, n: int) -> "ModeShapes":
        """The same of n modes with one row for each repetition; checked.

        Raises
        ------
        MeasurementError
            If shapes of arrays disagree, or references are not one or one for each mode.
        """
        dofs = tuple(self.dofs)
        reference = self.reference if isinstance(self.reference, str) else tuple(self.reference)
        if not dofs or len(set(dofs)) != len(dofs):
            raise MeasurementError(f"mode shapes: found DOFs {dofs}; expected one or more, each once; correct them")
        if not isinstance(reference, str) and len(reference) != n:
            raise MeasurementError(
                f"mode shapes: found {len(reference)} reference DOFs for {n} modes; expected one, or one for each mode"
            )
        if isinstance(reference, str) and reference in dofs:
            raise MeasurementError(
                f'mode shapes: found the reference DOF "{reference}" among the DOFs; expected it to be none of them, '
                "since its component is 1; leave it out"
            )
        return ModeShapes(dofs, reference, self.components.rows((n, len(dofs)), "mode shapes"))


@dataclass(frozen=True, slots=True, eq=False)
class Antiresonances:
    """Antiresonances of drive points, zeros of their FRFs: natural frequencies of the structure with that DOF held.

    Parameters
    ----------
    dofs
        Label of the DOF that was excited and measured; or one for each antiresonance.
    frequency
        Frequencies, shape (repetitions, n) or (n,), Hz.
    numbers
        Number of each among those of its DOF, from 1; by default the lowest, in the order in which they stand.

    Raises
    ------
    MeasurementError
        If shapes of arrays disagree, a frequency or number is impossible, or one is there twice.
    """

    dofs: str | tuple[str, ...]
    frequency: Observed
    numbers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        given = array_of(self.frequency.values, float, "antiresonances", MeasurementError)
        n = given.shape[-1] if given.ndim else 0
        frequency = self.frequency.rows((n,), "antiresonances")
        if not (np.nan_to_num(frequency.values, nan=1.0) > 0).all():
            raise MeasurementError("antiresonances: found one that is not above 0 Hz; expected frequencies; correct it")
        dofs = (self.dofs,) * n if isinstance(self.dofs, str) else tuple(self.dofs)
        numbers = tuple(map(int, self.numbers)) or tuple(dofs[: i + 1].count(dof) for i, dof in enumerate(dofs))
        apart = len(set(zip(dofs, numbers, strict=False)))
        if not len(dofs) == len(numbers) == apart == n or min(numbers) < 1:
            raise MeasurementError(
                f"antiresonances: found DOFs {dofs} and numbers {numbers} for {n}; expected one of each, a different "
                "number, from 1, for each at a DOF; correct them"
            )
        for name, value in (("dofs", dofs), ("frequency", frequency), ("numbers", numbers)):
            object.__setattr__(self, name, value)


@dataclass(frozen=True, slots=True, eq=False)
class ModalConstants:
    """Modal constants A = φ(output) φ(input) in modes of unit modal mass, H = Σ A/(ω_r² − ω² + 2jζ_r ω_r ω).

    Parameters
    ----------
    outputs, inputs
        Labels of the p pairs of DOFs.
    constants
        With their signs, shape (repetitions, n, p) or (n, p), 1/kg.

    Raises
    ------
    MeasurementError
        If there is no pair, or not as many outputs as inputs, or a pair is there twice.
    """

    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    constants: Observed

    def __post_init__(self) -> None:
        convert_fields(self, lambda given: (given,) if isinstance(given, str) else tuple(given), "outputs", "inputs")
        if not self.pairs or len(set(self.pairs)) != len(self.inputs) or len(self.outputs) != len(self.inputs):
            raise MeasurementError(
                f"modal constants: found outputs {self.outputs} and inputs {self.inputs}; expected pairs, each once; "
                "correct them"
            )

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Output and input of each."""
        return tuple(zip(self.outputs, self.inputs, strict=False))

    def rows(self, n: int) -> "ModalConstants":
        """The same of n modes with one row for each repetition; checked.

        Raises
        ------
        MeasurementError
            If shapes of arrays disagree.
        """
        return replace(self, constants=self.constants.rows((n, len(self.inputs)), "modal constants"))


@dataclass(frozen=True, slots=True)
class ModeValue:
    """What one number of a modal test is.

    Parameters
    ----------
    quantity
        A natural frequency (Hz), its eigenvalue (rad²/s²), a damping ratio, a component of a shape, the antiresonance
        of a drive point (Hz), or a modal constant (1/kg).
    mode, dof
        Place of the mode among the measured ones, or of the antiresonance among these, and of the DOF among those of
        the shapes, or the pair among those of the constants, from 0.
    repetition
        Repetition of the test, from 0.
    """

    quantity: ModeQuantity
    mode: int
    dof: int
    repetition: int
