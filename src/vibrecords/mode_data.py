"""Modes as data: frequencies, antiresonances, damping, shapes and modal constants of repetitions of a modal test."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, singledispatch
from itertools import compress
from typing import Any, Literal

import numpy as np

from vibrecords.arrays import Array, Flags, convert_fields
from vibrecords.data import FrfData, Match, ModalData
from vibrecords.errors import MeasurementError, array_of, printable, read_only, refusal
from vibrecords.provenance import Provenance

_WIDEST = 1e100  # of a value: squares stay finite
#: What a value of a mode is, in the order in which they come.
ModeQuantity = Literal["frequency", "eigenvalue", "damping", "shape", "zero", "constant"]
#: In which field of a table of modes, and of what stands there, values are that have DOFs of their own.
_PLACES: dict[ModeQuantity, tuple[str, str]] = {
    "shape": ("shapes", "components"),
    "zero": ("zeros", "frequency"),
    "constant": ("constants", "constants"),
}


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """Values with the standard deviations of their errors, which are independent; NaN where nothing was observed.

    Parameters
    ----------
    values
        Observed values, one row for each repetition of the test; of a single repetition without that axis.
    sd
        Standard deviation of each, or of all repetitions alike: any shape that broadcasts to the values'.
    """

    values: Array
    sd: Array

    def rows(self, shape: tuple[int, ...], what: str, *key: str) -> "Observed":
        """The same with one row for each repetition, shape (repetitions, *shape); checked. `key` is its own, in errors.

        Raises
        ------
        MeasurementError
            If shapes do not agree, nothing was observed, or a standard deviation is not positive.
        """
        given = array_of(self.values, float, what, MeasurementError)
        stated = array_of(self.sd, float, f"{what}: sd", MeasurementError)
        values = given[None] if given.ndim == len(shape) else given
        if values.shape[1:] != shape or len(values) == 0:
            found, expected = f"found values of shape {given.shape}", f"(repetitions, {', '.join(map(str, shape))})"
            raise MeasurementError.of(what, (*key, "values"), found, expected, "correct them")
        try:
            sd = np.broadcast_to(stated, values.shape)
        except ValueError:
            found = f"found standard deviations of shape {stated.shape}"
            expected = f"one for each value, shape {values.shape}"
            raise MeasurementError.of(what, (*key, "sd"), found, expected, "correct them") from None
        seen = ~np.isnan(values)
        if not (np.abs(values[seen]) < _WIDEST).all() or not seen.any():
            found = "found no finite value, or infinity"
            raise MeasurementError.of(what, (*key, "values"), found, "numbers, NaN where none is")
        if not ((sd[seen] > 1 / _WIDEST) & (sd[seen] < _WIDEST)).all():
            found = "found a standard deviation that is not above 0"
            raise MeasurementError.of(what, (*key, "sd"), found, "one above 0", "state what a value is uncertain by")
        return Observed(read_only(values), read_only(np.where(seen, sd, np.nan)))

    def above_0(self, what: str, key: str, each: str) -> "Observed":
        """As `rows` for one value of each mode (or what it is called), all of which must have one, above 0."""
        given = array_of(self.values, float, what, MeasurementError)
        checked = self.rows(given.shape[-1:] or (0,), what, key)
        if np.isnan(checked.values).all(axis=0).any() or (checked.values <= 0).any():
            found, remedy = f"found {each} without any, or one that is not above 0", "correct it or leave it out"
            raise MeasurementError.of(what, (key, "values"), found, "one above 0 for each", remedy)
        return checked

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
            raise _wrong_shapes("dofs", f"found DOFs {dofs}", "one or more, each once", "correct them")
        if not isinstance(reference, str) and len(reference) != n:
            found = f"found {len(reference)} reference DOFs for {n} modes"
            raise _wrong_shapes("reference", found, "one, or one for each mode", "correct the list")
        if isinstance(reference, str) and reference in dofs:
            found = f'found the reference DOF "{reference}" among the DOFs'
            expected = "it to be none of them, since its component is 1"
            raise _wrong_shapes("dofs", found, expected, "leave it out")
        return ModeShapes(dofs, reference, self.components.rows((n, len(dofs)), "mode shapes", "shapes", "components"))


def _wrong_shapes(key: str, *words: str) -> MeasurementError:
    return MeasurementError.of("mode shapes", ("shapes", key), *words)


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
        where, frequency = "antiresonances", self.frequency.above_0("antiresonances", "frequency", "one")
        n = frequency.values.shape[1]
        dofs = (self.dofs,) * n if isinstance(self.dofs, str) else tuple(self.dofs)
        numbers = tuple(map(int, self.numbers)) or tuple(dofs[: i + 1].count(dof) for i, dof in enumerate(dofs))
        apart = len(set(zip(dofs, numbers, strict=False)))
        if not len(dofs) == len(numbers) == apart == n or min(numbers) < 1:
            key, found = "dofs" if len(dofs) != n else "numbers", f"found DOFs {dofs} and numbers {numbers} for {n}"
            expected = "one of each, a different number, from 1, for each at a DOF"
            raise MeasurementError.of(where, (key,), found, expected, "correct them")
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
            key = "inputs" if len(self.outputs) != len(self.inputs) else "outputs"
            found = f"found outputs {self.outputs} and inputs {self.inputs}"
            raise MeasurementError.of("modal constants", (key,), found, "pairs, each once", "correct them")

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
        return replace(self, constants=self.constants.rows((n, len(self.inputs)), "modal constants", "constants"))


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


@dataclass(frozen=True, eq=False, repr=False)
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
        ``"shape"`` (by the modal assurance criterion), also where a joint changes their order.
    eigenvalues
        Whether `frequency` holds eigenvalues: their errors are then the normal ones.
    provenance
        Where the data come from, as in `FrfData`.
    zeros
        Antiresonances of drive points.
    constants
        Modal constants.
    read_off
        The measured FRFs that show these modes, if they were read off any: to be shown with what is predicted.

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
    zeros: Antiresonances | None = None
    constants: ModalConstants | None = None
    read_off: FrfData | None = None

    def __post_init__(self) -> None:
        of_both = ("eigenvalues", "eigenvalues"), ("natural frequencies", "frequency")
        what, of_frequency = of_both[not self.eigenvalues]
        object.__setattr__(self, "frequency", self.frequency.above_0(what, of_frequency, "a mode"))
        n = self.frequency.values.shape[1]
        object.__setattr__(self, "numbers", tuple(map(int, self.numbers)) or tuple(range(1, n + 1)))
        if len(self.numbers) != n or len(set(self.numbers)) != n or min(self.numbers) < 1:
            found, expected = f"found {self.numbers} for {n} modes", "a different one, from 1, for each"
            raise MeasurementError.of("mode numbers", ("numbers",), found, expected, "correct the list")
        if self.match == "number" and (np.diff(self.frequency_hz[np.argsort(self.numbers)]) < 0).any():
            found = f"found {', '.join(f'{f:.4g}' for f in self.frequency_hz)} Hz as modes {self.numbers}"
            remedy = "sort them, or correct the numbers"
            raise MeasurementError.of(what, (of_frequency,), found, "values that rise with the number", remedy)
        if self.damping is not None:
            damping = self.damping.rows((n,), "damping ratios", "damping")
            object.__setattr__(self, "damping", damping)
            if not (np.nan_to_num(damping.values) < 1).all() or (damping.values < 0).any():
                key, found = ("damping", "values"), "found one outside 0 to 1"
                raise MeasurementError.of("damping ratios", key, found, "ratios", "write 0.01 for 1 %")
        convert_fields(self, lambda part: part.rows(n), "shapes", "constants")
        if self.match not in ("number", "shape") or (self.match == "shape" and self.shapes is None):
            found = f'found match = "{self.match}"{"" if self.shapes else " without shapes"}'
            expected = '"number", or "shape" where shapes are given'
            raise MeasurementError.of("modes", ("match",), found, expected, "correct it")

    @property
    def shown_frfs(self) -> FrfData | None:
        """The FRFs that these modes were read off."""
        return self.read_off

    @property
    def in_full(self) -> str:
        """How many modes, their frequencies, and what else was measured of them."""
        listed = ", ".join(f"{f:.4g}" for f in self.frequency_hz)
        count = len(self.frequency.values)
        more = f", {count} repetitions" if count > 1 else ""
        shapes = "; damping ratios" if self.damping is not None else ""
        if self.shapes is not None:
            reference = ", ".join(dict.fromkeys(self.references))
            shapes += printable(f"; shapes at {', '.join(self.shapes.dofs)} over {reference}")
        if self.zeros is not None:
            shapes += printable(f"; antiresonances of {', '.join(dict.fromkeys(self.zeros.dofs))}")
        if self.constants is not None:
            shapes += printable(f"; modal constants of {', '.join(map('/'.join, self.constants.pairs))}")
        return f"{self.frequency_hz.size} modes{more}: {listed} Hz{shapes}"

    @cached_property
    def _mean(self) -> tuple[Array, Array]:
        """Mean natural frequencies and their standard deviations, Hz."""
        mean, sd = self.frequency.mean()
        hz = np.sqrt(mean) / (2 * np.pi)
        return (hz, sd / (8 * np.pi**2 * hz)) if self.eigenvalues else (mean, sd)

    @property
    def frequency_hz(self) -> Array:  # type: ignore[override]
        """Natural frequencies, weighted means over repetitions, shape (n,), Hz."""
        return self._mean[0]

    @property
    def sd_hz(self) -> Array:  # type: ignore[override]
        """Their standard deviations, shape (n,), Hz."""
        return self._mean[1]

    @property
    def shows_shapes(self) -> bool:
        """Whether mode shapes are among the data."""
        return self.shapes is not None

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
        """DOFs of the modes and of the antiresonances, each once."""
        return tuple(dict.fromkeys((*self.dofs_of_modes, *(self.zeros.dofs if self.zeros else ()))))

    @property
    def dofs_of_modes(self) -> tuple[str, ...]:
        """DOFs of the shapes and their references, and of modal constants, each once."""
        constants = (*self.constants.outputs, *self.constants.inputs) if self.constants else ()
        return tuple(dict.fromkeys((*(self.shapes.dofs if self.shapes else ()), *self.references, *constants)))

    @property
    def _parts(self) -> dict[ModeQuantity, Observed]:
        """What was observed of each quantity."""
        frequency: ModeQuantity = "eigenvalue" if self.eigenvalues else "frequency"
        parts = {frequency: self.frequency, "damping": self.damping}
        parts |= {quantity: getattr(getattr(self, name), of, None) for quantity, (name, of) in _PLACES.items()}
        return {quantity: observed for quantity, observed in parts.items() if observed}

    @cached_property
    def observed(self) -> tuple[ModeValue, ...]:
        """What each of `values` is."""
        return tuple(
            ModeValue(quantity, mode, dof[0] if dof else 0, repetition)
            for quantity, observed in self._parts.items()
            for repetition, mode, *dof in np.argwhere(~np.isnan(observed.values)).tolist()
        )

    @property
    def value_names(self) -> tuple[str, ...]:
        """What each of `values` is: ``"frequency 2"``, ``"shape 2 6:y over 11:y"``, ``"zero 1 of 11:y"``."""
        return tuple(map(self._name, self.observed))

    def _name(self, value: ModeValue) -> str:
        if self.zeros is not None and value.quantity == "zero":
            return f"zero {self.zeros.numbers[value.mode]} of {self.zeros.dofs[value.mode]}"
        name = f"{value.quantity} {self.numbers[value.mode]}"
        if self.shapes is not None and value.quantity == "shape":
            name += f" {self.shapes.dofs[value.dof]} over {self.references[value.mode]}"
        if self.constants is not None and value.quantity == "constant":
            name += f" {'/'.join(self.constants.pairs[value.dof])}"
        return name

    @cached_property
    def values(self) -> Array:
        """All that was observed, in the order of `observed`, shape (m,)."""
        return np.concatenate([part.values[~np.isnan(part.values)] for part in self._parts.values()])

    @cached_property
    def sd(self) -> Array:
        """Standard deviations of `values`, shape (m,)."""
        return np.concatenate([part.sd[~np.isnan(part.values)] for part in self._parts.values()])

    @property
    def arrays(self) -> dict[str, Array]:
        """All numbers that were measured or stated."""
        parts = self._parts.items()
        return {key: a for name, part in parts for key, a in ((name, part.values), (f"{name}_sd", part.sd))}

    @property
    def layout(self) -> dict[str, object]:
        """What must be the same of other modes for these to stand for them."""
        zeros = (self.zeros.dofs, self.zeros.numbers) if self.zeros else ()
        dofs = self.dofs, self.references, zeros, self.constants.pairs if self.constants else ()
        return {"data": "modes", "values": self.observed, "mode numbers": self.numbers, "DOFs": dofs}

    def some(self, which: Flags) -> "ModeData":
        """Some of the modes, by a mask over them, shape (n,)."""
        parts = {
            quantity: part if quantity == "zero" else Observed(part.values[:, which], part.sd[:, which])
            for quantity, part in self._parts.items()
            if quantity == "zero" or not np.isnan(part.values[:, which]).all()
        }
        shapes = self.shapes
        if shapes and "shape" in parts:
            shapes = replace(shapes, reference=tuple(compress(self.references, which)))
        match = self.match if "shape" in parts else "number"
        return self._made_of(parts, shapes=shapes, numbers=tuple(compress(self.numbers, which)), match=match)

    def with_values(self, values: Array) -> "ModeData":
        """The same with other values, in the order of `observed`, shape (m,)."""
        parts, start = {}, 0
        for quantity, part in self._parts.items():
            changed, seen = np.array(part.values), ~np.isnan(part.values)
            changed[seen] = values[start : start + seen.sum()]
            start += int(seen.sum())
            parts[quantity] = Observed(changed, part.sd)
        return self._made_of(parts)

    def _made_of(self, parts: Mapping[ModeQuantity, Observed], **changes: Any) -> "ModeData":  # noqa: ANN401
        """The same with other values of each of `_parts`, and other fields."""
        for quantity, (name, of) in _PLACES.items():
            holder = changes.get(name, getattr(self, name))
            changes[name] = replace(holder, **{of: parts[quantity]}) if quantity in parts else None
        frequency = parts["eigenvalue" if self.eigenvalues else "frequency"]
        return replace(self, frequency=frequency, damping=parts.get("damping"), **changes)


@singledispatch
def _as_table(data: ModalData) -> ModeData:
    """Natural frequencies as a table of modes, or the table itself."""
    return ModeData(Observed(data.frequency_hz, data.sd_hz), numbers=data.numbers, provenance=data.provenance)


_as_table.register(ModeData, lambda table: table)


def renumbered(data: ModalData, shift: int, unit_hz: float = 1.0) -> ModeData:
    """The same measurement of modes whose numbers are higher by `shift`, its frequencies in another unit.

    Between two modes of a drive point lies one antiresonance: their numbers are higher by as much.
    """
    table = _as_table(data)
    numbers = tuple(number + shift for number in table.numbers)
    frequency = Observed(table.frequency.values * unit_hz, table.frequency.sd * unit_hz)
    zeros = table.zeros and replace(table.zeros, numbers=tuple(number + shift for number in table.zeros.numbers))
    return replace(table, frequency=frequency, numbers=numbers, zeros=zeros)


def split_modes(data: ModalData, numbers: Sequence[int]) -> tuple[ModeData, ModeData]:
    """The modes but some, with the antiresonances, and these, by their numbers; each with all that was measured of it.

    Raises
    ------
    MeasurementError
        If one of them was not measured, or no other one was.
    """
    table = _as_table(data)
    apart = np.isin(table.numbers, numbers)
    if apart.all() or not set(numbers) <= set(table.numbers):
        wanted, measured = (", ".join(map(str, some)) for some in (numbers, table.numbers))
        raise refusal("left out", f"modes {wanted}", f"some of {measured}, but not all", "correct the numbers")
    return table.some(~apart), replace(table.some(apart), zeros=None)
