"""What a measurement file holds, as it says it: FRFs, coherences, time histories, spectra, modes, each with a place."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import Array, ComplexArray, Flags, OverFrequency, Quantity, SensorQuantity, convert_fields
from vibrecords.errors import MeasurementError, read_only, refusal, require_at_most

#: Nothing measured has a larger number in SI units or the inverse of it, and no line is higher or at the inverse, Hz.
#: Squares and products of what is within stay finite.
LARGEST, HIGHEST_HZ = 1e40, 1e9
#: Bytes of a file; the largest that was tried, a universal file of 10 000 FRFs, has 2 GB.
MOST_BYTES = 16 * 2**30
#: FRFs and time histories in a file; data sets of other types count in a universal file.
MOST_RECORDS = 100_000
#: Averages of an FRF.
MOST_AVERAGES = 10**6
#: Columns of a table.
MOST_COLUMNS = 50_000
#: Characters of a channel label or a unit.
LONGEST_LABEL = 300

_AXES = ("S", "X", "Y", "Z", "RX", "RY", "RZ")
_LABEL = re.compile(r"(?:(?P<entity>[^:\s]{1,10}):)?(?P<node>\d{1,9}):(?P<axis>S|R?[XYZ])(?P<sign>[+-]?)")


@dataclass(frozen=True, slots=True, eq=False)
class FrfRecord(OverFrequency):
    """One FRF of a file, in SI units where `factor` is a number; zero lines and NaN are still there.

    Parameters
    ----------
    response, reference
        Channel labels as the file gives them, such as ``"Point:12:Z+"`` or ``"acc tip"``.
    frequency_hz
        Frequency lines as stored, shape (lines,), Hz.
    values
        Complex FRF in SI units per newton, shape (lines,).
    quantity
        What the file says it is; None where it does not say.
    unit
        Unit as written in the file, before conversion; empty where none is.
    coherence
        γ², shape (lines,), or None where the file has none.
    averages
        Number of averages, or None where the file does not say.
    where
        Place in the file for messages: ``"data set 3"``, ``"columns 2 and 3"``, ``"variable 'H'"``.
    notes
        What was done on reading, in words: ``"g converted to m/s²"``.
    factor
        What the numbers of the file were multiplied by to be in SI units per newton; None where `unit` does not tell,
        or is none of an FRF over a force: the values are as written.
    window_rate
        a of the exponential window e^(−at) that the file states, 1/s: the values are H(jω + a). NaN where the file does
        not say how fast it decays.
    """

    response: str
    reference: str
    frequency_hz: Array
    values: ComplexArray
    quantity: Quantity | None = None
    unit: str = ""
    coherence: Array | None = None
    averages: int | None = None
    where: str = ""
    notes: tuple[str, ...] = field(default=())
    factor: float | None = 1.0
    window_rate: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only(self.values, complex))
        convert_fields(self, read_only, "frequency_hz", "coherence")

    @property
    def conjugate(self) -> "FrfRecord":
        """The same for the other time factor, exp(−iωt)."""
        return replace(self, values=self.values.conj())


@dataclass(frozen=True, slots=True, eq=False)
class TimeRecord:
    """One time history of a file, in SI units.

    Parameters
    ----------
    channel
        Channel label as the file gives it.
    sample_rate_hz
        Samples per second, Hz.
    values
        Samples, shape (samples,), in N, m, m/s or m/s²; in the file's own unit where `quantity` is ``"unknown"``.
    quantity
        What was measured.
    unit
        Unit as written in the file, before conversion.
    hit
        Which hit or block this is, counted from 1, where the file keeps them apart; else None.
    where, notes, factor
        As in `FrfRecord`.
    """

    channel: str
    sample_rate_hz: float
    values: Array
    quantity: SensorQuantity = "unknown"
    unit: str = ""
    hit: int | None = None
    where: str = ""
    notes: tuple[str, ...] = field(default=())
    factor: float | None = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only(self.values))


@dataclass(frozen=True, slots=True, eq=False)
class CoherenceRecord(OverFrequency):
    """A coherence γ², shape (lines,), that stands apart from its FRF: in a file of its own. As `FrfRecord`."""

    response: str
    reference: str
    frequency_hz: Array
    values: Array
    averages: int | None = None
    where: str = ""
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        convert_fields(self, read_only, "frequency_hz", "values")


@dataclass(frozen=True, slots=True, eq=False)
class SpectrumRecord(OverFrequency):
    """A spectrum of one signal or of two, which is no FRF: listed, never data.

    `kind` says in words which, as the file has it: ``"auto spectrum"``, ``"PSD"``, ``"FFT, RMS"``; `values` are as
    written, shape (lines,).
    """

    channel: str
    kind: str
    frequency_hz: Array
    values: NDArray[np.number]
    unit: str = ""
    where: str = ""
    notes: tuple[str, ...] = field(default=())


@dataclass(frozen=True, slots=True, eq=False)
class ModeRecord:
    """One mode of a modal test: what another program made of FRFs.

    Parameters
    ----------
    number
        As the file counts, from 1.
    frequency_hz, frequency_sd_hz
        Natural frequency and its standard deviation, Hz.
    damping_ratio, damping_sd
        Of critical damping, and its standard deviation.
    shape
        Displacement by channel label, in the file's own scale.
    modal_mass
        Of that scale; None where the file does not say.
    where, notes
        As in `FrfRecord`.
    """

    number: int
    frequency_hz: float
    frequency_sd_hz: float | None = None
    damping_ratio: float | None = None
    damping_sd: float | None = None
    shape: Mapping[str, complex] = field(default_factory=dict)
    modal_mass: float | None = None
    where: str = ""
    notes: tuple[str, ...] = field(default=())


Record = FrfRecord | TimeRecord | CoherenceRecord | SpectrumRecord | ModeRecord


def labels_of(record: Record) -> tuple[str, ...]:
    """Labels of the channels that a record names."""
    match record:
        case FrfRecord() | CoherenceRecord():
            return record.response, record.reference
        case TimeRecord() | SpectrumRecord():
            return (record.channel,)
    return tuple(record.shape)


def coherence_on(lines: Array, coherence: CoherenceRecord, where: str) -> Array:
    """A coherence that stood apart from its FRF, of these lines and this place.

    Raises
    ------
    MeasurementError
        If it is one of other lines.
    """
    others = coherence.frequency_hz
    if others.shape != lines.shape or not np.allclose(others, lines, rtol=1e-6, equal_nan=True):
        found = f"a coherence of {others.size} lines that are not the {lines.size} of the FRF in {where}"
        raise refusal(coherence.where, found, "the same lines", "export again")
    return coherence.values


def measurable(values: Array | ComplexArray) -> Flags:
    """Which values a measurement can have: 0, or a finite number of a size that occurs."""
    with np.errstate(all="ignore"):
        size = np.maximum(np.abs(values.real), np.abs(values.imag))
        return np.asarray((size == 0) | ((size >= 1 / LARGEST) & (size <= LARGEST)))


@np.errstate(all="ignore")  # a file may hold any number
def is_two_sided(axis: NDArray[np.number]) -> bool:
    """Whether an axis has even steps and a negative half, before 0 or, as an FFT has it, behind."""
    if axis.size < 3 or not axis.min() < 0 <= axis.max():
        return False
    given = axis.astype(float)
    steps, drops = np.diff(np.sort(given)), np.count_nonzero(np.diff(given) <= 0)
    ordered = drops == 0 or (drops == 1 and given[0] == 0)
    return bool(ordered and np.abs(steps - np.median(steps)).max() < 1e-3 * np.median(steps))


def non_negative_half(record: Record) -> Record:
    """A record over frequency without the negative half of a two-sided axis; any other as it is."""
    if isinstance(record, (TimeRecord, ModeRecord)) or not is_two_sided(record.frequency_hz):
        return record
    lines = record.frequency_hz
    kept = np.argsort(lines)[np.count_nonzero(lines < 0) :]
    note = f"two-sided axis: {kept.size} of {lines.size} lines, from 0 Hz on"
    return replace(record.at_lines(kept), notes=(*record.notes, note))


def require_short(where: str, *labels: str) -> None:
    """Refuse labels and units that are none.

    Raises
    ------
    MeasurementError
        If one is longer than `LONGEST_LABEL`.
    """
    for label in labels:
        require_at_most(LONGEST_LABEL, len(label), where, f"characters in the name {label[:20]!r}…", "shorten it")


def reading_package(name: str, what: str, otherwise: str) -> Any:  # noqa: ANN401 (a module)
    """The package that reads files of one kind, which jointbayes installs with its extra `files`.

    Raises
    ------
    MeasurementError
        If it is missing: with what was found, and what to do otherwise.
    """
    try:
        return import_module(name.lower())
    except ImportError:
        expected = f"the package {name}, which reads it"
        raise refusal("content", what, expected, f"pip install jointbayes[files], or {otherwise}") from None


@contextmanager
def refuse_damage(where: str, expected: str, part: str = "a part", most: int = 80) -> Iterator[None]:
    """Say in one line what a library raises on damaged bytes: any error.

    Raises
    ------
    MeasurementError
        If the body fails: with the first `most` characters of the reason, and what was expected.
    """
    try:
        yield
    except MeasurementError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:most] or type(error).__name__
        raise refusal(where, f"{part} that cannot be read ({reason})", expected) from None


@np.errstate(all="ignore")  # a file may hold any number
def even_rate(time: Array, where: str, told: float | None = None) -> float:
    """Return the sampling rate in Hz of evenly spaced instants in s, or the one told where it fits them.

    1. Steps that are even to 1 % give the rate.
    2. Otherwise the instants may be rounded: they lie on a straight line, but for half of the last digit that the file
       prints, and but for a quarter of a step at most.

    Raises
    ------
    MeasurementError
        If there are fewer than two instants, or they are not evenly spaced: with the largest gap.
    """
    if time.size < 2 or not np.isfinite(time).all():
        raise refusal(where, "fewer than two instants, or one that is no number", "a column of time", "correct it")
    steps, count = np.diff(time), np.arange(time.size)
    step = (time[-1] - time[0]) / (time.size - 1)
    fits = told is not None and abs(told * step - 1) < 1e-3
    if 1 / HIGHEST_HZ <= step <= HIGHEST_HZ:
        if np.abs(steps / step - 1).max() < 0.01:
            return told if told is not None and fits else float(1 / step)
        bound = np.minimum(half_a_digit(time) * (1 + 4 / np.sqrt(time.size)), step / 4)  # the line itself is fitted
        line = np.polyfit(count, time, 1, w=1 / np.maximum(bound, 1e-9 * step))[0] if time.size > 2 else step
        for rate in (told if fits else None, float(np.rint(1 / line)), float(1 / line)):
            if rate and (time - count / rate - bound).max() <= (time - count / rate + bound).min():  # one start for all
                return rate
    usual, widest = float(np.median(steps)), int(np.argmax(np.abs(steps - np.median(steps))))
    gap = f"a step of {steps[widest]:.4g} s behind {time[widest]:.6g} s, where most are {usual:.4g} s"
    found = f"instants that are not evenly spaced: {gap}"
    raise refusal(where, found, "one sampling rate", "cut the record there, or resample it")


def half_a_digit(values: Array) -> Array:
    """Half of the last digit that each value was printed with, by decimals or by significant digits; 0 where full."""
    largest = np.abs(values).max()
    decimals = next((d for d in range(13) if _whole(values * 10.0**d) and largest * 10.0**d < 1e12), None)
    exponent = np.floor(np.log10(np.where(values == 0, 1, np.abs(values))))
    digits = next((d for d in range(1, 13) if _whole(values * 10.0 ** (d - 1 - exponent))), None)
    by_decimals = 0.0 if decimals is None else 0.5 * 10.0**-decimals
    by_digits = 0.0 if digits is None else 0.5 * 10.0 ** (exponent - digits + 1)
    return np.maximum(by_decimals, by_digits) + np.zeros(values.shape)


def _whole(values: Array) -> bool:
    return bool((np.abs(values - np.rint(values)) < 1e-3).all())


@dataclass(frozen=True, slots=True)
class Dof:
    """A channel label ``Point:12:Z+`` in the parts that a universal file has.

    Entity name (empty where unused), node, and direction: 0 scalar, ±1…3 translations, ±4…6 rotations.
    """

    entity: str
    node: int
    direction: int


def dof_label(dof: Dof) -> str:
    """Label of a degree of freedom of a file.

    Examples
    --------
    >>> dof_label(Dof("Point", 12, 3)), dof_label(Dof("", 4, -5))
    ('Point:12:Z+', '4:RY-')
    """
    axis = _AXES[abs(dof.direction)] + ("", "+", "-")[(dof.direction > 0) - (dof.direction < 0)]
    return f"{dof.entity}:{dof.node}:{axis}" if dof.entity else f"{dof.node}:{axis}"


def parse_dof(label: str) -> Dof | None:
    """Degree of freedom of a label, upper or lower case, with or without sign; None where it is a mere name.

    Examples
    --------
    >>> parse_dof("11:y")
    Dof(entity='', node=11, direction=2)
    """
    match = _LABEL.fullmatch(label.replace("x", "X").replace("y", "Y").replace("z", "Z").replace(":r", ":R"))
    if match is None:
        return None
    direction = _AXES.index(match["axis"]) * (-1 if match["sign"] == "-" else 1)
    return Dof(label.split(":")[0] if match["entity"] else "", int(match["node"]), direction)
