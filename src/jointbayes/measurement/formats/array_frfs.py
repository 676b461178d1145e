"""FRFs, coherences and spectra among the arrays of one struct or group."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.frf import Quantity
from jointbayes.measurement.formats.named_arrays import Block, is_text, rises, size_of, square_error, two_axes_error
from jointbayes.measurement.formats.units import frequency_factor, read_frf_unit, scaled
from jointbayes.measurement.records import MOST_AVERAGES, CoherenceRecord, FrfRecord, SpectrumRecord

#: Phases beyond are in degrees: those of resonances in radians do not come near.
_MOST_RADIANS = 4 * np.pi


@dataclass(frozen=True, slots=True)
class _Values:
    """Values over frequency under one name or two, before they are laid along the lines."""

    name: str
    values: NDArray[Any]
    rest: frozenset[str]
    notes: list[str] = field(default_factory=list)
    quantity: Quantity | None = None


def frequency_records(block: Block) -> Iterator[FrfRecord | CoherenceRecord | SpectrumRecord]:
    """All that stands over frequency in a block, each coherence with its FRF where both are in it.

    Raises
    ------
    MeasurementError
        If a frequency axis is missing or is one of two, shapes do not agree, or what is given has two readings.
    """
    frfs = _frfs(block)
    _refuse_estimators(block, [frf.name for frf in frfs])
    coherences = [
        _Values(n, block.numbers(n), block.meanings[n].rest)
        for n in block.named("coherence")
        if frfs or _axis(block, np.shape(block.get(n)))
    ]
    for frf in frfs:
        fitting = [c for c in coherences if c.rest == frf.rest] or (coherences if len(frfs) == 1 else [])
        coherence = fitting[0] if len(fitting) == 1 else None
        coherences = [c for c in coherences if c is not coherence]
        yield from _frf_records(block, frf, coherence, alone=len(frfs) == 1)
    for values in coherences:
        lines, notes, array = _laid_out(block, values)
        labels = _labels_of(block, values, array.shape, alone=not frfs and len(coherences) == 1)
        for i, j, output, input_ in _pairs(labels[:2]):
            place = f"{block.where(values.name)}, {output!r} over {input_!r}"
            said = (*notes, *labels[2])
            yield CoherenceRecord(output, input_, lines, array[:, i, j], _averages(block), place, said)
    for name in block.named("spectrum"):
        array = block.numbers(name, np.complex128)
        if array.ndim < 3 and _axis(block, array.shape) is not None:
            kind = " ".join(w for w in re.split(r"[\W_]+", name) if not w.isdecimal())
            lines, notes, array = _laid_out(block, _Values(name, array, frozenset()))
            for i in range(array.shape[1]):
                label = _channel(name) or (f"{name} {i + 1}" if array.shape[1] > 1 else name)
                unit = block.unit_of(name)
                yield SpectrumRecord(label, kind, lines, array[:, i, 0], unit, block.where(name), tuple(notes))


def _pairs(labels: Sequence[list[str]]) -> Iterator[tuple[int, int, str, str]]:
    outputs, inputs = labels
    for i, output in enumerate(outputs):
        for j, input_ in enumerate(inputs):
            yield i, j, output, input_


# ---- values


def _frfs(block: Block) -> list[_Values]:
    """FRFs of a block: complex arrays, real and imaginary parts, magnitudes with phases."""
    frfs = [_complex(block, *names) for names in _matched(block, "real", "imaginary")]
    if block.stated("real") and not frfs:
        frfs.append(_Values("real", block.numbers("real").astype(complex), frozenset(), ["imaginary part taken as 0"]))
    frfs += [_polar(block, *names) for names in _matched(block, "magnitude", "phase")]
    named = [n for n, m in block.meanings.items() if m.role == "frf" and _may_be_frf(block, n)]
    for name in named:
        array = block.numbers(name, np.complex128)
        if np.asarray(block.get(name)[0] if isinstance(block.get(name), list) else block.get(name)).dtype.kind == "c":
            meaning = block.meanings[name]
            frfs.append(_Values(name, array, meaning.rest, [], meaning.quantity))
    if frfs or not named:
        return frfs
    polar = [_polar(block, *names) for names in _matched(block, "frf", "phase")]
    if not polar:
        raise MeasurementError(
            f"{block.where(named[0])}: found real numbers, which may be the real part of an FRF or its magnitude; "
            f'expected complex numbers, or the other part beside it; write magnitude = "{block.place}{named[0]}" and '
            "phase_deg, or real and imaginary, in [data.layout]"
        )
    return polar


def _may_be_frf(block: Block, name: str) -> bool:
    value = block.get(name)
    if name.lower() in ("frf", "frfs") and not isinstance(value, (dict, list)):
        return True
    return size_of(value) > 1


def _matched(block: Block, first: str, second: str) -> Iterator[tuple[str, str]]:
    """Names of two roles that belong together: by their other words, or because there is one of each."""
    ones, others = block.named(first), block.named(second)
    for name in ones:
        alike = [o for o in others if block.meanings[o].rest == block.meanings[name].rest]
        if len(ones) == len(others) == 1 or len(alike) == 1:
            yield name, (alike or others)[0]


def _same_shape(block: Block, name: str, other: str) -> tuple[Array, Array]:
    first, second = block.numbers(name), block.numbers(other)
    if first.shape != second.shape and not (first.size == second.size == max(*first.shape, *second.shape)):
        raise MeasurementError(
            f"{block.where(other)}: found shape {second.shape}; expected {first.shape} as '{name}'; correct one of them"
        )
    return first, second.reshape(first.shape)


def _complex(block: Block, real: str, imaginary: str) -> _Values:
    first, second = _same_shape(block, real, imaginary)
    values = np.empty(first.shape, complex)
    values.real, values.imag = first, second
    return _Values(real, values, block.meanings[real].rest, [], block.meanings[real].quantity)


def _polar(block: Block, name: str, of_phase: str) -> _Values:
    magnitude, phase = _same_shape(block, name, of_phase)
    notes, meaning = [], block.meanings[name]
    unit = block.unit_of(name)
    if "db" in meaning.hints or re.match(r"dB\b", unit, re.IGNORECASE):
        notes.append("decibels taken as 20 log10 of the magnitude")
        with np.errstate(over="ignore"):
            magnitude = 10 ** (magnitude / 20)
    elif (magnitude < 0).any():
        raise MeasurementError(
            f"{block.where(name)}: found negative numbers, which may be decibels or the real part of an FRF; expected "
            f'magnitudes of 0 or more; write magnitude_db or real = "{block.place}{name}" in [data.layout]'
        )
    radians, note = _radians(block, of_phase, phase)
    with np.errstate(invalid="ignore"):
        values = magnitude * np.exp(1j * radians)
    return _Values(name, values, meaning.rest, notes + note, meaning.quantity)


def _radians(block: Block, name: str, phase: Array) -> tuple[Array, list[str]]:
    hints, unit = block.meanings[name].hints, block.unit_of(name).lower().strip("[]() ")
    if hints & {"rad", "radian", "radians"} or unit in ("rad", "radian", "radians"):
        return phase, []
    if hints & {"deg", "degree", "degrees"} or unit in ("deg", "degree", "degrees", "°"):
        return np.deg2rad(phase), []
    if np.max(np.abs(phase[np.isfinite(phase)]), initial=0.0) > _MOST_RADIANS:
        return np.deg2rad(phase), ["phase without unit taken as degrees, since it passes 4π"]
    raise MeasurementError(
        f"{block.where(name)}: found a phase that may be in degrees or in radians; expected the unit in its name; "
        f'write phase_deg = "{block.place}{name}" or phase_rad in [data.layout]'
    )


def _refuse_estimators(block: Block, names: list[str]) -> None:
    """H1 and H2 may be two estimates of one FRF, or two FRFs."""
    small = {name.lower() for name in names}
    if len(small) > 1 and small <= {"h1", "h2", "hv"}:
        raise MeasurementError(
            f"{block.where(names[0])}: found {' and '.join(names)}, which may be estimates of one FRF or FRFs of "
            f'several channels; expected one of them; write frf = "{block.place}{names[0]}" in [data.layout]'
        )


# ---- axes


def _axis(block: Block, shape: tuple[int, ...]) -> str | None:
    """Name of the frequency vector that fits an array of this shape, in this block or an outer one."""
    fitting = [n for n in block.named("frequency") + block.named("omega") if size_of(block.get(n)) in shape]
    return fitting[0] if fitting else (None if block.outer is None else _axis(block.outer, shape))


def _lines(block: Block, name: str, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
    """Frequency lines of an array, in Hz, with notes."""
    for holder in _outwards(block):
        for role, factor in (("frequency", 1.0), ("omega", 0.5 / np.pi)):
            axes = holder.named(role)
            if role == "frequency" and not axes and (name_of := holder.name_of("frequency_hz")) is not None:
                axes = [name_of]  # of one line, or no numbers at all
            fitting = [axis for axis in axes if size_of(holder.get(axis)) in shape] or axes[:1]
            key = "frequency_hz" if role == "frequency" else "omega"
            fitting = [axis for axis in fitting if holder.stated(axis)] or fitting
            if not fitting:
                continue
            lines = holder.numbers(fitting[0]).ravel()
            for other in fitting[1:]:
                if not np.array_equal(holder.numbers(other).ravel(), lines):
                    raise two_axes_error(holder, name, (fitting[0], other), key)
            unit = holder.unit_of(fitting[0]) or ("khz" if "khz" in holder.meanings[fitting[0]].hints else "")
            if role == "omega":
                return lines * factor, ["frequency in rad/s converted to Hz"]
            return _in_hertz(lines, unit, holder.where(fitting[0]))
    return _counted_lines(block, name, shape)


def _outwards(block: Block | None) -> Iterator[Block]:
    while block is not None:
        yield block
        block = block.outer


def _in_hertz(lines: Array, unit: str, where: str) -> tuple[Array, list[str]]:
    factor: float | None = frequency_factor(unit) if unit else 1.0
    if factor is None:
        raise MeasurementError(f"{where}: found the unit {unit!r}; expected Hz or rad/s; correct it")
    return np.multiply(lines, factor, dtype=np.float64), [f"frequency in {unit} converted to Hz"] if factor != 1 else []


def _counted_lines(block: Block, name: str, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
    """Lines from a first one and a step; refused where these are missing."""
    start, step = block.scalar("f_start"), block.scalar("f_step")
    if step is not None and start is not None:
        return start + step * np.arange(float(max(shape, default=0))), [
            f"lines from {start:g} Hz in steps of {step:g} Hz"
        ]
    if step is not None:
        raise MeasurementError(
            f"{block.where(name)}: found a step of {step:g} Hz and no first line, which may be 0 or {step:g} Hz; "
            f'expected both; write f_start_hz = "0" or "{step:g}" in [data.layout]'
        )
    for holder in _outwards(block):
        for axis in holder.named("w"):
            raise MeasurementError(
                f"{holder.where(axis)}: found an axis that may be in rad/s or in Hz; expected its name to say which; "
                f'write omega_rad_s = "{holder.place}{axis}" or frequency_hz in [data.layout]'
            )
    rising = [n for n, v in block.arrays.items() if size_of(v) in shape and rises(v)]
    guess = (
        f"; '{rising[0]}' rises: write frequency_hz = \"{block.place}{rising[0]}\" in [data.layout]" if rising else ""
    )
    raise MeasurementError(
        f"{block.where(name)}: found no frequency lines with it; expected a variable 'frequency_hz' (or "
        f"'omega_rad_s'){guess or '; add it, or name it in [data.layout]'}"
    )


def _laid_out(block: Block, values: _Values) -> tuple[Array, list[str], NDArray[Any]]:
    """Lines, notes, and the values in the shape (lines, outputs, inputs)."""
    lines, notes = _lines(block, values.name, values.values.shape)
    array, moved = _arrange_axes(values.values, lines.size, values.name, block)
    return lines, [*notes, *values.notes, *moved], array


def _arrange_axes(values: NDArray[Any], lines: int, name: str, block: Block) -> tuple[NDArray[Any], list[str]]:
    """Array of shape (lines, outputs, inputs) from the shapes that occur in files."""
    shape, notes, where = values.shape, [], block.where(name)
    if values.ndim == 0 or values.ndim > 3 or lines not in shape:
        raise MeasurementError(
            f"{where}: found shape {shape}; expected (lines, outputs, inputs) with {lines} lines; correct the array"
        )
    if shape.count(lines) > 1 and lines > 1 and not block.strings("outputs"):
        raise square_error(where, shape, "lines", "frf", block.place + name)
    if shape[0] != lines:
        axis = shape.index(lines)
        values = np.moveaxis(values, axis, 0)
        notes.append(f"array of shape {shape} read with its lines along axis {axis + 1}")
    if values.ndim == 1:
        return values[:, None, None], notes
    if values.ndim == 2:
        one_output = len(block.strings("outputs")) == 1 and values.shape[1] > 1
        return (values[:, None, :] if one_output else values[:, :, None]), notes
    return values, notes


# ---- records


def _frf_records(block: Block, frf: _Values, coherence: _Values | None, *, alone: bool) -> Iterator[FrfRecord]:
    lines, notes, values = _laid_out(block, frf)
    outputs, inputs, of_labels = _labels_of(block, frf, values.shape, alone=alone)
    of_coherence = None
    if coherence is not None:
        of_coherence, _ = _arrange_axes(coherence.values, lines.size, coherence.name, block)
        if of_coherence.shape != values.shape:
            raise MeasurementError(
                f"{block.where(coherence.name)}: found shape {of_coherence.shape}; expected {values.shape} as the "
                "FRFs; store one coherence for each FRF"
            )
    unit = block.unit_of(frf.name) or block.string("unit")
    factor, of_unit, converted = read_frf_unit(unit)
    quantity = _quantity(block) or frf.quantity or of_unit
    if of_unit is not None and quantity != of_unit:
        converted = [*converted, f"{quantity} by name, {of_unit} by its unit: the name was followed"]
    averages = _averages(block)
    for i, j, output, input_ in _pairs((outputs, inputs)):
        yield FrfRecord(
            output,
            input_,
            lines,
            scaled(values[:, i, j], factor),
            quantity,
            unit,
            None if of_coherence is None else of_coherence[:, i, j],
            averages,
            f"{block.where(frf.name)}, {output!r} over {input_!r}",
            (*notes, *of_labels, *converted),
            factor,
        )


def _channel(name: str) -> str | None:
    """Channel of a variable of SignalCalc."""
    match = re.fullmatch(r".*_chan_(\d{1,6})", name.lower())
    return f"channel {match[1]}" if match else None


def _labels_of(
    block: Block, values: _Values, shape: tuple[int, ...], *, alone: bool
) -> tuple[list[str], list[str], list[str]]:
    """Response and reference labels of an array, and notes on where they are from."""
    digits = re.fullmatch(r"[a-z]+_?(\d)_?(\d)", values.name.lower())
    channel = _channel(values.name)
    if channel is not None:
        labels, notes = (channel, "channel 1"), ["channel 1 taken as the reference of all FRFs"]
    elif digits is not None:
        labels = (f"output {digits[1]}", f"input {digits[2]}")
        notes = [f"'{values.name}' read as response {digits[1]} over force {digits[2]}"]
    elif alone and block.label and not block.has("outputs"):
        named = next((block.string(key) for key in ("name", "label", "point") if is_text(block.get(key))), "")
        labels, notes = (named or block.label, "input 1"), ["channels named by the elements of an array of structs"]
    elif alone:
        outputs, of_outputs = _labels(block, "outputs", shape[1])
        inputs, of_inputs = _labels(block, "inputs", shape[2])
        return outputs, inputs, of_outputs + of_inputs
    else:
        labels, notes = (values.name, "input 1"), ["channels named by the variables of the file"]
    sides = [[f"{x} {i + 1}" for i in range(n)] if n > 1 else [x] for x, n in zip(labels, shape[1:], strict=True)]
    return sides[0], sides[1], notes


def _labels(block: Block, key: str, count: int) -> tuple[list[str], list[str]]:
    labels = block.strings(key)
    if not labels:
        name = key[:-1]
        return [f"{name} {i + 1}" for i in range(count)], [f"no {key} named in the file, numbered instead"]
    if len(labels) != count or len(set(labels)) != count:
        raise MeasurementError(
            f"{block.where(key)}: found {len(labels)} labels, {len(set(labels))} different; expected {count}, one for "
            "each; correct them"
        )
    return labels, []


def _quantity(block: Block) -> Quantity | None:
    word = block.string("quantity").lower()
    if not word:
        return None
    if word not in get_args(Quantity):
        raise MeasurementError(
            f"{block.where('quantity')}: found {word!r}; expected one of {', '.join(get_args(Quantity))}; correct it"
        )
    return cast(Quantity, word)


def _averages(block: Block) -> int | None:
    if not block.has("averages"):
        return None
    values, where = block.numbers("averages").ravel(), block.where("averages")
    if values.size != 1 or not (1 <= values[0] <= MOST_AVERAGES) or values[0] != int(values[0]):
        raise MeasurementError(
            f"{where}: found {values[:3].tolist()}; expected one whole number from 1 to {MOST_AVERAGES}; correct it"
        )
    return int(values[0])
