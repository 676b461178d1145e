"""Modes as data: natural frequencies, damping ratios and shapes of one or several repetitions of a modal test."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError, array_of, printable
from jointbayes.frf.frf_set import read_only
from jointbayes.measurement.data import Match, ModalData
from jointbayes.measurement.provenance import Provenance

_WIDEST = 1e100  # of a value: squares stay finite
#: What a value of a mode is, in the order in which they come.
ModeQuantity = Literal["frequency", "eigenvalue", "damping", "shape"]


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


@dataclass(frozen=True, slots=True)
class ModeValue:
    """What one number of a modal test is.

    Parameters
    ----------
    quantity
        A natural frequency (Hz), its eigenvalue (rad²/s²), a damping ratio, or a component of a shape.
    mode, dof
        Place of the mode among the measured ones, and of the DOF among those of the shapes, from 0.
    repetition
        Repetition of the test, from 0.
    """

    quantity: ModeQuantity
    mode: int
    dof: int
    repetition: int


@dataclass(frozen=True, eq=False)
class ModeData(ModalData):
    """Modes from a modal test, or from several repetitions of it.

    Parameters
    ----------
    frequency
        Natural frequencies, shape (repetitions, n) or (n,), Hz; or the eigenvalues (2πf)², rad²/s².
    damping
        Damping ratios, shape (repetitions, n) or (n,).
    shapes
        Mode shapes.
    numbers
        Number of each measured mode among those of the structure with its joint, from 1; by default the lowest n.
    match
        Whether the mode of that ``"number"`` is compared with the measured one, or the one that has the nearest
        ``"shape"`` (by the modal assurance criterion), whatever joint changes their order.
    eigenvalues
        Whether `frequency` holds eigenvalues: their errors are then the normal ones.
    provenance
        Where the data come from, as in `FrfData`.

    Raises
    ------
    MeasurementError
        If shapes of arrays disagree, a number is impossible, or modes are to be matched by shapes that are not given.

    Examples
    --------
    >>> frequency = Observed([[12.1, 31.4], [12.2, 31.6]], 0.1)
    >>> ratio = Observed([[[0.62], [-1.60]], [[0.61], [-1.63]]], 0.02)
    >>> ModeData(frequency, shapes=ModeShapes(("1:x",), "2:x", ratio))
    ModeData(2 modes, 2 repetitions: 12.15, 31.5 Hz; shapes at 1:x over 2:x)
    """

    frequency: Observed
    damping: Observed | None = None
    shapes: ModeShapes | None = None
    numbers: tuple[int, ...] = ()
    match: Match = "number"
    eigenvalues: bool = False
    provenance: Provenance | None = None

    def __post_init__(self) -> None:
        what = "eigenvalues" if self.eigenvalues else "natural frequencies"
        given = array_of(self.frequency.values, float, what, MeasurementError)
        n = given.shape[-1] if given.ndim else 0
        object.__setattr__(self, "frequency", self.frequency.rows((n,), what))
        seen = self.frequency.values
        if np.isnan(seen).all(axis=0).any() or (seen <= 0).any():
            raise MeasurementError(
                f"{what}: found a mode without any, or one that is not above 0; expected one above 0 for each mode; "
                "leave out modes of which only the shape is known"
            )
        object.__setattr__(self, "numbers", tuple(map(int, self.numbers)) or tuple(range(1, n + 1)))
        if len(self.numbers) != n or len(set(self.numbers)) != n or min(self.numbers) < 1:
            raise MeasurementError(
                f"mode numbers: found {self.numbers} for {n} modes; expected a different one, from 1, for each"
            )
        if self.damping is not None:
            damping = self.damping.rows((n,), "damping ratios")
            object.__setattr__(self, "damping", damping)
            if not (np.nan_to_num(damping.values) < 1).all() or (damping.values < 0).any():
                raise MeasurementError("damping ratios: found one outside 0 to 1; expected ratios, 0.01 for 1 %")
        if self.shapes is not None:
            object.__setattr__(self, "shapes", _checked(self.shapes, n))
        if self.match not in ("number", "shape") or (self.match == "shape" and self.shapes is None):
            raise MeasurementError(
                f'modes: found match = "{self.match}"{"" if self.shapes else " without shapes"}; expected "number", or '
                '"shape" where shapes are given; correct it'
            )

    def __repr__(self) -> str:
        listed = ", ".join(f"{f:.4g}" for f in self.frequency_hz)
        count = len(self.frequency.values)
        more = f", {count} repetitions" if count > 1 else ""
        shapes = "; damping ratios" if self.damping is not None else ""
        if self.shapes is not None:
            reference = ", ".join(dict.fromkeys(self.references))
            shapes += printable(f"; shapes at {', '.join(self.shapes.dofs)} over {reference}")
        return f"ModeData({self.frequency_hz.size} modes{more}: {listed} Hz{shapes})"

    @cached_property
    def _mean(self) -> tuple[Array, Array]:
        """Mean natural frequencies and their standard deviations, Hz."""
        mean, sd = self.frequency.mean()
        if not self.eigenvalues:
            return mean, sd
        frequency = np.sqrt(mean) / (2 * np.pi)
        return frequency, sd / (8 * np.pi**2 * frequency)

    @property
    def frequency_hz(self) -> Array:  # type: ignore[override]
        """Natural frequencies, weighted means over repetitions, shape (n,), Hz."""
        return self._mean[0]

    @property
    def sd_hz(self) -> Array:  # type: ignore[override]
        """Their standard deviations, shape (n,), Hz."""
        return self._mean[1]

    @property
    def lowest_hz(self) -> tuple[float, ...] | None:
        """Natural frequencies, if they are the lowest, each of them, in rising order, Hz."""
        rising = bool((np.diff(self.frequency_hz) > 0).all())
        lowest = self.match == "number" and rising and self.numbers == tuple(range(1, len(self.numbers) + 1))
        return super().lowest_hz if lowest else None

    @property
    def references(self) -> tuple[str, ...]:
        """Reference DOF of each mode, shape (n,); empty without shapes."""
        if self.shapes is None:
            return ()
        given = self.shapes.reference
        return (given,) * len(self.numbers) if isinstance(given, str) else given

    @property
    def dofs(self) -> tuple[str, ...]:
        """DOFs of the shapes and their references, each once."""
        return tuple(dict.fromkeys((*(self.shapes.dofs if self.shapes else ()), *self.references)))

    @property
    def _parts(self) -> tuple[tuple[ModeQuantity, Observed | None], ...]:
        return (
            ("eigenvalue" if self.eigenvalues else "frequency", self.frequency),
            ("damping", self.damping),
            ("shape", self.shapes.components if self.shapes else None),
        )

    @cached_property
    def observed(self) -> tuple[ModeValue, ...]:
        """What each of `values` is."""
        mode_values = []
        for quantity, observed in self._parts:
            for repetition, mode, *dof in np.argwhere(~np.isnan(observed.values)).tolist() if observed else ():
                mode_values.append(ModeValue(quantity, mode, dof[0] if dof else 0, repetition))
        return tuple(mode_values)

    @property
    def value_names(self) -> tuple[str, ...]:
        """What each of `values` is: ``"frequency 2"``, ``"shape 2 6:y over 11:y"``."""
        names = []
        for value in self.observed:
            name = f"{value.quantity} {self.numbers[value.mode]}"
            if self.shapes is not None and value.quantity == "shape":
                name += f" {self.shapes.dofs[value.dof]} over {self.references[value.mode]}"
            names.append(name)
        return tuple(names)

    @cached_property
    def values(self) -> Array:
        """All that was observed, in the order of `observed`, shape (m,)."""
        return np.concatenate([observed.values[~np.isnan(observed.values)] for _, observed in self._parts if observed])

    @cached_property
    def sd(self) -> Array:
        """Standard deviations of `values`, shape (m,)."""
        return np.concatenate([observed.sd[~np.isnan(observed.values)] for _, observed in self._parts if observed])

    @property
    def arrays(self) -> dict[str, Array]:
        """All numbers that were measured or stated."""
        given = {name: observed for name, observed in self._parts if observed}
        return {
            key: a
            for name, observed in given.items()
            for key, a in ((name, observed.values), (f"{name}_sd", observed.sd))
        }

    @property
    def layout(self) -> dict[str, object]:
        """What must be the same of other modes for these to stand for them."""
        dofs = self.dofs, self.references
        return {"data": "modes", "values": self.observed, "mode numbers": self.numbers, "DOFs": dofs}

    def some(self, which: NDArray[np.bool_]) -> "ModeData":
        """Some of the modes, by a mask over them, shape (n,)."""

        def of(observed: Observed | None) -> Observed | None:
            if observed is None or np.isnan(observed.values[:, which]).all():
                return None
            return Observed(observed.values[:, which], observed.sd[:, which])

        frequency, damping, components = (of(observed) for _, observed in self._parts)
        assert frequency is not None  # each mode has one
        references = tuple(label for label, kept in zip(self.references, which, strict=False) if kept)
        shapes = ModeShapes(self.shapes.dofs, references, components) if self.shapes and components else None
        numbers = tuple(number for number, kept in zip(self.numbers, which, strict=True) if kept)
        match: Match = self.match if shapes else "number"
        return replace(self, frequency=frequency, damping=damping, shapes=shapes, numbers=numbers, match=match)

    def with_values(self, values: Array, *, relative: bool = False) -> "ModeData":
        """The same with other values, in the order of `observed`, shape (m,)."""
        parts: list[Observed | None] = []
        start = 0
        for _, observed in self._parts:
            if observed is None:
                parts.append(None)
                continue
            changed, seen = np.array(observed.values), ~np.isnan(observed.values)
            changed[seen] = values[start : start + seen.sum()]
            start += int(seen.sum())
            parts.append(Observed(changed, observed.sd))
        frequency, damping, components = parts
        assert frequency is not None
        shapes = replace(self.shapes, components=components) if self.shapes and components else None
        return replace(self, frequency=frequency, damping=damping, shapes=shapes)


def split_modes(data: ModalData, numbers: Sequence[int]) -> tuple[ModeData, ModeData]:
    """The modes but some, and these, by their numbers; each with all that was measured of it.

    Raises
    ------
    MeasurementError
        If one of them was not measured, or no other one was.
    """
    apart = np.isin(data.numbers, numbers)
    if apart.all() or not set(numbers) <= set(data.numbers):
        wanted, measured = (", ".join(map(str, some)) for some in (numbers, data.numbers))
        raise MeasurementError(
            f"left out: found modes {wanted}; expected some of {measured}, but not all; correct the numbers"
        )
    if not isinstance(data, ModeData):
        frequency = Observed(data.frequency_hz, data.sd_hz)
        data = ModeData(frequency, numbers=data.numbers, provenance=data.provenance)
    return data.some(~apart), data.some(apart)


def _checked(shapes: ModeShapes, n: int) -> ModeShapes:
    """Shapes of n modes with one row for each repetition.

    Raises
    ------
    MeasurementError
        If shapes of arrays disagree, or references are not one or one for each mode.
    """
    dofs = tuple(shapes.dofs)
    reference = shapes.reference if isinstance(shapes.reference, str) else tuple(shapes.reference)
    if not dofs or len(set(dofs)) != len(dofs):
        raise MeasurementError(f"mode shapes: found DOFs {dofs}; expected one or more, each once; correct them")
    if not isinstance(reference, str) and len(reference) != n:
        raise MeasurementError(
            f"mode shapes: found {len(reference)} reference DOFs for {n} modes; expected one, or one for each mode"
        )
    if isinstance(reference, str) and reference in dofs:
        raise MeasurementError(
            f'mode shapes: found the reference DOF "{reference}" among the DOFs; expected it to be none of them, since '
            "its component is 1; leave it out"
        )
    return ModeShapes(dofs, reference, shapes.components.rows((n, len(dofs)), "mode shapes"))
