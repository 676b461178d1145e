"""FRFs, coherences, spectra and modes among the arrays of one struct or group."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import Array, complex_of
from vibrecords.errors import MeasurementError
from vibrecords.formats.matlab_5 import Unread
from vibrecords.formats.named_arrays import Block, is_complex, rises, size_of, square_error, two_axes_error
from vibrecords.formats.units import in_hz, read_frf_unit, scaled
from vibrecords.frf_set import Quantity
from vibrecords.records import HIGHEST_HZ, MOST_AVERAGES, CoherenceRecord, FrfRecord, ModeRecord, SpectrumRecord

#: Phases beyond are in degrees: those of resonances in radians do not come near.
_MOST_RADIANS = 4 * np.pi


@dataclass(frozen=True, slots=True)
class _Values:
    """Values over frequency as they stand under one name or two."""

    name: str
    values: NDArray[Any]
    notes: list[str] = field(default_factory=list)


def frequency_records(block: Block) -> Iterator[FrfRecord | CoherenceRecord | SpectrumRecord]:
    """All that stands over frequency in a block, each coherence with its FRF where both are in it.

    Raises
    ------
    MeasurementError
        If a frequency axis is missing or is one of two, shapes do not agree, or what is given has two readings.
    """
    frfs = _frfs(block)
    coherences = [name for name in block.named("coherence") if frfs or _axes(block, block.numbers(name).shape)]
    pairs = dict(_pairs(block, [frf.name for frf in frfs], coherences))
    for frf in frfs:
        yield from _frf_records(block, frf, pairs.get(frf.name), alone=len(frfs) == 1)
    placed = {*pairs.values()}
    for name in (name for name in coherences if name not in placed):
        alone = not frfs and len(coherences) == 1
        for labels, lines, values, where, notes in _columns(block, _Values(name, block.numbers(name)), alone=alone):
            yield CoherenceRecord(*labels, lines, values, _averages(block), where, notes)
    for name in block.named("spectrum"):
        array = block.numbers(name, np.complex128)
        if array.ndim < 3 and _axes(block, array.shape):
            kind = block.string("kind") or " ".join(w for w in re.split(r"[\W_]+", name) if not w.isdecimal())
            alone = bool(block.strings("outputs"))
            for labels, lines, values, where, notes in _columns(block, _Values(name, array), alone=alone):
                yield SpectrumRecord(labels[0], kind, lines, values, block.told_unit(name), where, notes)


# ---- values


def _frfs(block: Block) -> list[_Values]:
    """FRFs of a block: complex arrays, real and imaginary parts, magnitudes with phases."""
    pairs = _pairs(block, block.named("real"), block.named("imaginary"))
    frfs = [_Values(real, complex_of(*_same_size(block, real, imaginary))) for real, imaginary in pairs]
    if block.stated("real") and not frfs:
        frfs.append(_Values("real", block.numbers("real").astype(complex), ["imaginary part taken as 0"]))
    phases = block.named("phase")
    frfs += [_polar(block, *names) for names in _pairs(block, block.named("magnitude"), phases)]
    array_like = [n for n, value in block.arrays.items() if isinstance(value, (np.ndarray, Unread))]
    named = block.named("frf") or [name for name in array_like if name.lower() in ("frf", "frfs")]
    arrays = {name: block.numbers(name, np.complex128) for name in named}
    frfs += [_Values(name, values) for name, values in arrays.items() if is_complex(block.get(name))]
    frfs = [replace(frf, notes=[*frf.notes, *block.unread()]) for frf in frfs]
    if named and not frfs:
        frfs = [_polar(block, *names) for names in _pairs(block, block.named("frf"), phases)]
    if named and not frfs:
        path, parts = block.path(named[0]), columns_of_parts(block.get(named[0]), block.path(named[0]))
        remedy = f'magnitude = "{path}" and phase_deg, or real and imaginary'
        raise MeasurementError(
            f"{block.where(named[0])}: found real numbers, which may be the real part of an FRF or its magnitude; "
            "expected complex numbers, or the other part beside it; write "
            f"{f'{parts}, or magnitude and phase_deg so' if parts else remedy}, in [data.layout]"
        )
    if len(frfs) > 1 and {frf.name.lower() for frf in frfs} <= {"h1", "h2", "hv"}:
        raise MeasurementError(
            f"{block.where(named[0])}: found {' and '.join(named)}, which may be estimates of one FRF or FRFs of "
            f'several channels; expected one of them; write frf = "{block.path(named[0])}" in [data.layout]'
        )
    return frfs


def columns_of_parts(value: Any, path: str) -> str:  # noqa: ANN401
    """Keys of a layout for a real matrix of two or three columns or rows, the first of three an axis; else empty."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf" or value.ndim != 2 or max(value.shape) < 4:
        return ""
    columns, form = (value.shape[1], "(:,{})") if value.shape[1] in (2, 3) else (value.shape[0], "({},:)")
    if columns not in (2, 3) or (columns == 3 and not rises(value[:, 0] if form[1] == ":" else value[0])):
        return ""
    keys = ("frequency_hz", "real", "imaginary")[-columns:]
    return ", ".join(f'{key} = "{path}{form.format(i)}"' for i, key in enumerate(keys, start=1))


def _pairs(block: Block, names: list[str], others: list[str]) -> Iterator[tuple[str, str]]:
    """Names that belong together: by the words that tell which FRF it is, or because there is one of each."""
    of_words: dict[frozenset[str], list[str]] = {}
    for other in others:
        of_words.setdefault(block.rest(other), []).append(other)
    for name in names:
        alike = of_words.get(block.rest(name), others if len(names) == len(others) == 1 else [])
        if len(alike) == 1:
            yield name, alike[0]


def _same_size(block: Block, name: str, other: str) -> tuple[Array, Array]:
    first, second = block.numbers(name), block.numbers(other)
    if first.shape != second.shape and not first.size == second.size == max(*first.shape, *second.shape):
        raise MeasurementError(
            f"{block.where(other)}: found shape {second.shape}; expected {first.shape} as '{name}'; correct one of them"
        )
    return first, second.reshape(first.shape)


def _polar(block: Block, name: str, of_phase: str) -> _Values:
    magnitude, phase = _same_size(block, name, of_phase)
    hints, notes = block.hints(of_phase), ["magnitude taken as linear, not in decibels"]
    if "db" in block.hints(name) or block.told_unit(name)[:2].lower() == "db":
        notes = ["decibels taken as 20 log10 of the magnitude"]
        magnitude = 10 ** (magnitude / 20)
    elif (magnitude < 0).any():
        raise MeasurementError(
            f"{block.where(name)}: found negative numbers, which may be decibels or the real part of an FRF; expected "
            f'magnitudes of 0 or more; write magnitude_db or real = "{block.path(name)}" in [data.layout]'
        )
    if not hints & {"deg", "rad"} and np.max(np.abs(phase[np.isfinite(phase)]), initial=0.0) > _MOST_RADIANS:
        hints, notes = frozenset({"deg"}), [*notes, "phase without unit taken as degrees, since it passes 4π"]
    if not hints & {"deg", "rad"}:
        raise MeasurementError(
            f"{block.where(of_phase)}: found a phase that may be in degrees or in radians; expected the unit in its "
            f'name; write phase_deg = "{block.path(of_phase)}" or phase_rad in [data.layout]'
        )
    return _Values(name, magnitude * np.exp(1j * (np.deg2rad(phase) if "deg" in hints else phase)), notes)


# ---- axes


def _axes(block: Block | None, shape: tuple[int, ...]) -> list[tuple[Block, str]]:
    """Frequency vectors that fit an array, of the innermost block that has one; such in Hz before those in rad/s."""
    while block is not None:
        for role in ("frequency", "omega"):
            names = [n for n in block.named(role) if size_of(block.get(n)) in shape and not is_complex(block.get(n))]
            if names:
                return [(block, n) for n in names if block.stated(n)] or [(block, n) for n in names]
        block = block.outer
    return []


def _lines(block: Block, name: str, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
    """Frequency lines of an array, in Hz, with notes."""
    axes = _axes(block, shape) or [(block, axis) for role in ("frequency", "omega") for axis in block.named(role, 0)]
    if not axes:
        return _counted_lines(block, name, shape)
    holder, axis = axes[0]
    lines, role = holder.numbers(axis).ravel(), holder.meanings[axis].role
    for _, other in axes[1:]:
        if role == holder.meanings[other].role and not np.array_equal(holder.numbers(other).ravel(), lines):
            raise two_axes_error(holder, name, (axis, other), "frequency_hz")
    unit = "rad/s" if role == "omega" else holder.unit_of(axis) or ("kHz" if "khz" in holder.hints(axis) else "Hz")
    return in_hz(lines, unit, holder.where(axis), "correct it")


def _counted_lines(block: Block, name: str, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
    """Lines from a first one and a step; refused where these are missing."""
    start, step = block.scalar("f_start"), block.scalar("f_step")
    if step is not None and start is not None:
        lines = start + step * np.arange(float(max(shape, default=0)))
        return lines, [f"lines of {start:g} Hz and steps of {step:g} Hz"]
    if step is not None:
        raise MeasurementError(
            f"{block.where(name)}: found a step of {step:g} Hz and no first line, which may be 0 or {step:g} Hz; "
            f'expected both; write f_start_hz = "0" or "{step:g}" in [data.layout]'
        )
    if axes := [*block.named("w"), *(block.outer.named("w") if block.outer else [])]:
        raise MeasurementError(
            f"variable '{axes[0]}': found an axis that may be in rad/s or in Hz; expected its name to say which; write "
            f'omega_rad_s = "{axes[0]}" or frequency_hz in [data.layout]'
        )
    rising = [n for n, v in block.arrays.items() if size_of(v) in shape and rises(v)]
    guess = f"'{rising[0]}' rises: write frequency_hz = \"{block.path(rising[0])}\" in [data.layout]" if rising else ""
    raise MeasurementError(
        f"{block.where(name)}: found no frequency lines with it; expected a variable 'frequency_hz' (or "
        f"'omega_rad_s'); {guess or 'add it, or name it in [data.layout]'}"
    )


def _arrange(block: Block, name: str, values: NDArray[Any], lines: int) -> tuple[NDArray[Any], list[str]]:
    """Array of shape (lines, outputs, inputs) from the shapes that occur in files."""
    shape, notes, where = values.shape, [], block.where(name)
    if values.ndim == 0 or values.ndim > 3 or lines not in shape:
        raise MeasurementError(
            f"{where}: found shape {shape}; expected (lines, outputs, inputs) with {lines} lines; correct the array"
        )
    if shape.count(lines) > 1 and lines > 1 and not block.strings("outputs"):
        raise square_error(block, name, shape, "lines", "frf")
    if shape[0] != lines:
        axis = shape.index(lines)
        values = np.moveaxis(values, axis, 0)
        notes = [f"array of shape {shape} read with its lines along axis {axis + 1}"] if values.size > lines else []
    one_output = values.ndim == 2 and values.shape[1] > 1 and len(block.strings("outputs")) == 1
    return values[:, None, :] if one_output else values.reshape(*values.shape, *[1] * (3 - values.ndim)), notes


# ---- records


def _columns(
    block: Block, given: _Values, *, alone: bool
) -> Iterator[tuple[tuple[str, str], Array, NDArray[Any], str, tuple[str, ...]]]:
    """Each column of an array with its labels, lines, place and notes."""
    lines, notes = _lines(block, given.name, given.values.shape)
    array, moved = _arrange(block, given.name, given.values, lines.size)
    outputs, of_outputs = _labels(block, given.name, "output", array.shape[1], alone=alone)
    inputs, of_inputs = _labels(block, given.name, "input", array.shape[2], alone=alone)
    said = tuple(dict.fromkeys([*notes, *given.notes, *moved, *of_outputs, *of_inputs]))
    for i, output in enumerate(outputs):
        for j, input_ in enumerate(inputs):
            where = f"{block.where(given.name)}, {output!r} over {input_!r}"
            yield (output, input_), lines, array[:, i, j], where, said


def _frf_records(block: Block, frf: _Values, coherence: str | None, *, alone: bool) -> Iterator[FrfRecord]:
    columns = list(_columns(block, frf, alone=alone))
    squared: list[Array | None] = [None] * len(columns)
    if coherence is not None:
        arranged, _ = _arrange(block, coherence, block.numbers(coherence), columns[0][1].size if columns else 0)
        squared = list(arranged.reshape(len(arranged), -1).T)
        if len(squared) != len(columns):
            raise MeasurementError(
                f"{block.where(coherence)}: found shape {arranged.shape}; expected {frf.values.shape} as the FRFs; "
                "store one coherence for each FRF"
            )
    units, averages = block.strings("unit"), _averages(block)
    if len(units) != len(columns) or block.unit_of(frf.name):
        units = [block.told_unit(frf.name)] * len(columns)
    for (labels, lines, values, where, notes), of_pair, unit in zip(columns, squared, units, strict=True):
        factor, of_unit, converted = read_frf_unit(unit)
        quantity = _quantity(block) or block.meanings[frf.name].quantity or of_unit
        if of_unit is not None and quantity != of_unit:
            converted = [*converted, f"{quantity} by name, {of_unit} by its unit: the name was followed"]
        said, si_values = (*notes, *converted), scaled(values, factor)
        yield FrfRecord(*labels, lines, si_values, quantity, unit, of_pair, averages, where, said, factor)


def _labels(
    block: Block, name: str, side: Literal["output", "input"], count: int, *, alone: bool
) -> tuple[list[str], list[str]]:
    """Labels of the responses or forces of an array, and notes on where they are from.

    They stand in the name of the array, in a list that belongs to the only array of its block, or are its own name or
    that of its struct.
    """
    is_output = side == "output"
    channel = re.fullmatch(r".*_chan_(\d{1,6})", name.lower())  # of SignalCalc
    digits = re.fullmatch(r"[a-z]+_?(\d)_?(\d)", name.lower())  # H12
    stated = block.strings(f"{side}s") if alone and not channel and not digits else []
    note = "channels named by variables or structs of the file"
    if channel:
        reference = "input 1" if block.has("hf_chan_1") else "channel 1"
        label, note = f"channel {channel[1]}" if is_output else reference, f"{reference} taken as the reference"
    elif digits:
        label = f"{side} {digits[1 if is_output else 2]}"
        note = f"'{name}' read as response {digits[1]} over {digits[2]}"
    elif stated:
        if len(stated) != count or len(set(stated)) != count:
            raise MeasurementError(
                f"{block.where(f'{side}s')}: found {len(stated)} labels, {len(set(stated))} different; expected {count}"
                ", one for each; correct them"
            )
        return stated, []
    elif alone and not (is_output and block.label):
        return [f"{side} {i + 1}" for i in range(count)], [f"no {side}s named in the file, numbered instead"]
    elif not is_output:
        label = "input 1"
    elif alone:
        label = block.string("name") or block.string("label") or block.label
    else:
        label = name
    return [label] if count == 1 else [f"{label} {i + 1}" for i in range(count)], [note]


def _quantity(block: Block) -> Quantity | None:
    word = ", ".join(dict.fromkeys(block.strings("quantity"))).lower()
    if word and word not in get_args(Quantity):
        raise MeasurementError(
            f"{block.where('quantity')}: found {word!r}; expected one of {', '.join(get_args(Quantity))}; correct it"
        )
    return cast(Quantity, word) if word else None


def _averages(block: Block) -> int | None:
    if not block.has("averages"):
        return None
    values, where = block.numbers("averages").ravel(), block.where("averages")
    if values.size != 1 or not (1 <= values[0] <= MOST_AVERAGES) or values[0] != int(values[0]):
        raise MeasurementError(
            f"{where}: found {values[:3].tolist()}; expected one whole number from 1 to {MOST_AVERAGES}; correct it"
        )
    return int(values[0])


def _mode_names(block: Block) -> dict[str, str]:
    """Names of what modes are made of: as pyOMA or the user names them, or frequencies with as many damping ratios."""
    ours = {"fn": "mode_frequencies_hz", "xi": "damping_ratios", "phi": "mode_shapes"}
    named = {key: (ours.get(key, key), key) for key in ("fn", "fn_std", "xi", "xi_std", "phi")}
    found = {key: next((n for n in names if size_of(block.get(n))), "") for key, names in named.items()}
    if not found["fn"]:
        ratios = [n for n in block.arrays if re.search(r"(?i)damping.?ratio", n)]
        axes = block.named("frequency", 1)
        sizes = {size_of(block.get(n)) for n in (*ratios, *axes)}
        if len(ratios) == len(axes) == len(sizes) == 1 and 0 not in sizes and not block.named("frf"):
            found |= {"fn": axes[0], "xi": ratios[0]}
    return {key: name for key, name in found.items() if name}


def mode_records(block: Block) -> Iterator[ModeRecord]:
    """Modes of a block: frequencies ``Fn``, Hz, ratios ``Xi``, shapes ``Phi`` (channels x modes), as pyOMA has them.

    Raises
    ------
    MeasurementError
        If a frequency is none, or shapes do not agree.
    """
    names = _mode_names(block)
    if "fn" not in names:
        return
    of_modes = {key: block.numbers(name).ravel() for key, name in names.items() if key != "phi"}
    frequency, notes, where = of_modes["fn"], [], block.where(names["fn"])
    count = frequency.size
    shapes = block.numbers(names["phi"], np.complex128) if "phi" in names else np.empty((0, count))
    shapes = shapes.reshape(-1, 1) if shapes.ndim == 1 and count == 1 else shapes
    if shapes.ndim == 2 and shapes.shape[0] == count > 1:
        square = shapes.shape[1] == count
        notes.append("square shapes read as channels x modes" if square else "shapes read as modes x channels")
        shapes = shapes if square else shapes.T
    sizes = {key: values.size for key, values in of_modes.items()}
    if shapes.ndim != 2 or shapes.shape[1] != count or set(sizes.values()) != {count}:
        raise MeasurementError(
            f"{where}: found {sizes} values and shapes 'Phi' of shape {shapes.shape}; expected one of each for each of "
            f"{count} modes, channels x modes; correct them"
        )
    if not ((frequency >= 0) & (frequency <= HIGHEST_HZ)).all():
        raise MeasurementError(f"{where}: found no frequencies; expected 0 to {HIGHEST_HZ:g} Hz; leave the others out")
    doubtful = [key for key in ("Fn_cov", "Xi_cov") if block.has(key.lower())]
    notes += [f"{key} not taken: a variance or a relative one" for key in doubtful]
    if "xi" in of_modes and not (np.abs(of_modes["xi"]) < 1).all():
        notes.append("Xi not taken: above critical, or in percent")
        of_modes = {key: values for key, values in of_modes.items() if "xi" not in key}
    labels = block.strings("dofs") or block.strings("channels") or [f"channel {i + 1}" for i in range(len(shapes))]
    if len(set(labels)) != len(shapes):
        found = f"found {len(labels)} channels for {len(shapes)} rows"
        raise MeasurementError(f"{block.where(names.get('phi', 'phi'))}: {found}; expected one for each; correct them")
    for i in range(count):
        of_mode = {key: float(values[i]) for key, values in of_modes.items() if np.isfinite(values[i])}
        sd, ratio, ratio_sd = (of_mode.get(key) for key in ("fn_std", "xi", "xi_std"))
        shape, place = dict(zip(labels, shapes[:, i].tolist(), strict=True)), f"{where}, mode {i + 1}"
        yield ModeRecord(i + 1, float(frequency[i]), sd, ratio, ratio_sd, shape, None, place, tuple(notes))
