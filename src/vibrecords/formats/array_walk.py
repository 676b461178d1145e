"""One walk over all structs, groups and cells of a file of arrays: what in them are records, and what the user says.

What one struct or group holds is FRFs, coherences, spectra or modes.
"""

import difflib
import re
from collections.abc import Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import Array, Quantity, complex_of
from vibrecords.errors import MeasurementError, require_one_of
from vibrecords.formats import units as known
from vibrecords.formats.channel_units import sides_of
from vibrecords.formats.matlab_5 import Unread
from vibrecords.formats.named_arrays import (
    ALIASES,
    Block,
    is_complex,
    is_text,
    rises,
    size_of,
    square_error,
    strings,
    time_records,
    tokens_of,
    two_axes_error,
)
from vibrecords.formats.table_text import float_of
from vibrecords.formats.units import TIME_S, frequency_factor, frf_unit, in_hz, parse_unit, read_frf_unit, scaled
from vibrecords.records import HIGHEST_HZ, MOST_AVERAGES, CoherenceRecord, FrfRecord, ModeRecord, Record, SpectrumRecord

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
        given = _Values(name, block.numbers(name))
        for labels, lines, values, where, notes in _columns_of_frf(block, given, alone=alone):
            yield CoherenceRecord(*labels, lines, values, _averages(block), where, notes)
    for name in block.named("spectrum"):
        array = block.numbers(name, np.complex128)
        if array.ndim < 3 and _axes(block, array.shape):
            kind = block.string("kind") or " ".join(w for w in re.split(r"[\W_]+", name) if not w.isdecimal())
            alone = bool(block.strings("outputs"))
            for labels, lines, values, where, notes in _columns_of_frf(block, _Values(name, array), alone=alone):
                yield SpectrumRecord(labels[0], kind, lines, values, block.units_of(name)[0], where, notes)


# ---- values


def _frfs(block: Block) -> list[_Values]:
    """FRFs of a block: complex arrays, real and imaginary parts, magnitudes with phases."""
    pairs = [*_pairs(block, block.named("real"), block.named("imaginary"))]
    for real, imaginary in pairs:
        one, other = block.unit_of(real), block.unit_of(imaginary)
        if one and other and one != other:
            raise MeasurementError(
                f"{block.where(imaginary)}: found the unit {other!r}; expected {one!r}, that of '{real}'; correct one"
            )
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
        keys = f'magnitude = "{path}" and phase_deg, or real and imaginary'
        keys = f"{parts}, or magnitude and phase_deg so" if parts else keys
        found = f"{block.where(named[0])}: found real numbers, which may be the real part of an FRF or its magnitude"
        expected = "complex numbers, or the other part beside it"
        raise MeasurementError(f"{found}; expected {expected}; write {keys}, in [data.layout]")
    if len(frfs) > 1 and {frf.name.lower() for frf in frfs} <= {"h1", "h2", "hv"}:
        raise MeasurementError(
            f"{block.where(named[0])}: found {' and '.join(named)}, which may be estimates of one FRF or FRFs of "
            f'several channels; expected one of them; write frf = "{block.path(named[0])}" in [data.layout]'
        )
    return frfs


def columns_of_parts(value: Any, path: str) -> str:  # noqa: ANN401
    """Keys of a layout for a matrix of two or three columns or rows: an axis, real and imaginary part; else empty."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iufc" or value.ndim != 2 or max(value.shape) < 4:
        return ""
    if is_complex(value):  # an axis and what stands over it
        first, form = (value[:, 0], "(:,{})") if value.shape[1] == 2 else (value[0], "({},:)")
        pair = 2 in value.shape and rises(first.real) and not first.imag.any()
        return f'frequency_hz = "{path}{form.format(1)}", frf = "{path}{form.format(2)}"' if pair else ""
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
    if "db" in block.hints(name) or block.units_of(name)[0][:2].lower() == "db":
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
    parts = columns_of_parts(block.get(name), block.path(name))
    guess = f"write {parts} in [data.layout]" if parts.startswith("frequency_hz") else ""
    if rising:
        guess = f"'{rising[0]}' rises: write frequency_hz = \"{block.path(rising[0])}\" in [data.layout]"
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


def _columns_of_frf(
    block: Block, given: _Values, *, alone: bool
) -> Iterator[tuple[tuple[str, str], Array, NDArray[Any], str, tuple[str, ...]]]:
    """Each column of an array with its labels, lines, place and notes."""
    lines, notes = _lines(block, given.name, given.values.shape)
    array, moved = _arrange(block, given.name, given.values, lines.size)
    outputs, of_outputs = _labels_of_axis(block, given.name, "output", array.shape[1], alone=alone)
    inputs, of_inputs = _labels_of_axis(block, given.name, "input", array.shape[2], alone=alone)
    said = tuple(dict.fromkeys([*notes, *given.notes, *moved, *of_outputs, *of_inputs]))
    for i, output in enumerate(outputs):
        for j, input_ in enumerate(inputs):
            where = f"{block.where(given.name)}, {output!r} over {input_!r}"
            yield (output, input_), lines, array[:, i, j], where, said


def _frf_records(block: Block, frf: _Values, coherence: str | None, *, alone: bool) -> Iterator[FrfRecord]:
    columns = list(_columns_of_frf(block, frf, alone=alone))
    squared: list[Array | None] = [None] * len(columns)
    if coherence is not None:
        arranged, _ = _arrange(block, coherence, block.numbers(coherence), columns[0][1].size if columns else 0)
        squared = list(arranged.reshape(len(arranged), -1).T)
        if len(squared) != len(columns):
            raise MeasurementError(
                f"{block.where(coherence)}: found shape {arranged.shape}; expected {frf.values.shape} as the FRFs; "
                "store one coherence for each FRF"
            )
    units, averages = block.units_of(frf.name, len(columns), alone=True), _averages(block)
    for (labels, lines, values, where, notes), of_pair, unit in zip(columns, squared, units, strict=True):
        factor, of_unit, converted = read_frf_unit(unit)
        own = block.quantity_of(frf.name)
        stated = cast(Quantity, own) if own in get_args(Quantity) else _quantity(block)
        quantity = stated or block.meanings[frf.name].quantity or of_unit
        if of_unit is not None and quantity != of_unit:
            converted = [*converted, f"{quantity} by name, {of_unit} by its unit: the name was followed"]
        said, si_values = (*notes, *converted), scaled(values, factor)
        yield FrfRecord(*labels, lines, si_values, quantity, unit, of_pair, averages, where, said, factor)


def _labels_of_axis(
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
        reference = "input 1" if block.name_of("hf_chan_1") else "channel 1"
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
    if not word:
        return None
    require_one_of(get_args(Quantity), word, block.where("quantity"))
    return cast(Quantity, word)


def _averages(block: Block) -> int | None:
    if block.get("averages") is None:
        return None
    values, where = block.numbers("averages").ravel(), block.where("averages")
    if values.size != 1 or not (1 <= values[0] <= MOST_AVERAGES) or values[0] != int(values[0]):
        raise MeasurementError(
            f"{where}: found {values[:3].tolist()}; expected one whole number from 1 to {MOST_AVERAGES}; correct it"
        )
    return int(values[0])


#: What modes are made of as pyOMA names it: the key of a layout, and the names that other programs give.
_MODES = {
    "fn": ("mode_frequencies_hz", r"^(f_?n|(natural|modal|modes?|resonan[ct]e?|eigen)_?freq(uenc(y|ies)|s)?(_?hz)?)$"),
    "xi": ("damping_ratios", r"damp.*(ratio|perc|pct)|zeta"),
    "phi": ("mode_shapes", r"shapes?$|^phi$|^psi$"),
}


def _mode_names(block: Block) -> dict[str, str]:
    """Names of what modes are made of: as pyOMA or the user names them, or frequencies with as many damping ratios."""
    keys = {"fn_std": "fn_std", "xi_std": "xi_std", **{name: key for name, (key, _) in _MODES.items()}}
    found = {name: next((n for n in (key, name) if size_of(block.get(n))), "") for name, key in keys.items()}
    alike = {name: [n for n in block.arrays if re.search(f"(?i){its}", n)] for name, (_, its) in _MODES.items()}
    alike |= {name: [found[name]] for name in _MODES if found[name]}
    alike["fn"] = alike["fn"] or block.named("frequency", 1)
    if len(alike["fn"]) == 1 and not block.named("frf"):
        count = size_of(block.get(*alike["fn"]))
        alike["xi"] = [name for name in alike["xi"] if size_of(block.get(name)) == count > 0]
        if found["fn"] or len(alike["xi"]) == 1:
            found |= {key: names[0] for key, names in alike.items() if len(names) == 1}
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
    if re.search(r"(?i)perc|pct|prozent", names.get("xi", "")):
        of_modes["xi"], notes = of_modes["xi"] / 100, [f"'{names['xi']}' taken as percent"]
    count = frequency.size
    shapes = block.numbers(names["phi"], np.complex128) if "phi" in names else np.empty((0, count))
    shapes = shapes.reshape(-1, 1) if count == 1 and shapes.size == max(shapes.shape) else shapes
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
    doubtful = [key for key in ("Fn_cov", "Xi_cov") if block.name_of(key.lower())]
    notes += [f"{key} not taken: a variance or a relative one" for key in doubtful]
    dampings = [n for n in block.arrays if "xi" not in names and "damp" in n.lower()]
    notes += [f"'{n}' not taken: a ratio, or another measure; damping_ratios can name it" for n in dampings]
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


#: Keys of a layout that name an axis, with the roles that they replace, and those that may be a number as well.
_AXES = {
    **dict.fromkeys(("frequency_hz", "omega_rad_s", "f_start_hz", "f_step_hz"), ("frequency", "omega", "w")),
    "time": ("time", "rate", "interval"),
    "sample_rate_hz": ("time", "rate", "interval"),
}
_NUMBERS = ("f_start_hz", "f_step_hz", "sample_rate_hz")
#: Keys of a layout that name values; where one is given, nothing else is read.
_DATA = (
    *("frf", "real", "imaginary", "magnitude", "magnitude_db", "phase", "phase_deg", "phase_rad", "coherence"),
    *("samples", "force", "response", *(key for key, _ in _MODES.values())),
)
_VALUES = {"", "frf", "coherence", "spectrum", "real", "imaginary", "magnitude", "phase", "signal", "samples"}
_VALUES |= {"outputs", "inputs"}
#: Keys of a layout for arrays.
LAYOUT_KEYS = (*_AXES, *_DATA)
_MOST_LISTED = 8
#: Modes of a test; a longer array of frequencies is an axis.
_MOST_MODES = 200
#: What structs that describe themselves hold, by words of their type.
_KINDS = (("coherence", "coh"), ("spectrum", "spectr|psd|fft|power|cross"), ("frf", "frf|transfer|frequency ?response"))


def records_of_tree(tree: Mapping[str, Any], layout: Mapping[str, str], sign: str) -> Generator[Record, None, None]:
    """Records of a tree of arrays.

    Parameters
    ----------
    tree
        As `vibrecords.formats.array_files.read_arrays` gives it.
    layout
        The user's names: one of `LAYOUT_KEYS` to the name or path in the file, with a column as in ``x(:,2)``.
    sign
        What stands between a struct and its field.

    Raises
    ------
    MeasurementError
        If nothing is understood, or something may be read in two ways; naming what there is.
    """
    blocks = list(_blocks(tree, "", None, sign))
    used = _name_arrays(blocks, layout) if layout else list(_expand_structs(blocks))
    apart: dict[tuple[str, str], list[CoherenceRecord]] = {}
    for record in _records(block for block in used if block.named("coherence")):
        if isinstance(record, CoherenceRecord):
            apart.setdefault((record.response, record.reference), []).append(record)
    understood = bool(apart)
    for record in _records(used):
        understood = True
        if isinstance(record, FrfRecord) and record.coherence is None:
            of_pair = apart.get((record.response, record.reference))
            if of_pair and np.array_equal(of_pair[0].frequency_hz, record.frequency_hz):
                record = replace(record, coherence=of_pair.pop(0).values)
        if not isinstance(record, CoherenceRecord):
            yield record
    for of_pair in apart.values():
        yield from of_pair
    if not understood and any(block.arrays for block in blocks):
        raise MeasurementError(_not_understood(blocks))


def _records(blocks: Iterable[Block]) -> Iterator[Record]:
    """Records of blocks one by one, without warnings of NumPy: a file may hold any number."""
    parts = (frequency_records, time_records, mode_records)
    records = ((block, record) for block in blocks for part in parts for record in part(block))
    quietly = np.errstate(all="ignore")(partial(next, records, None))
    for block, record in iter(quietly, None):
        yield replace(record, notes=(*record.notes, *block.notes)) if block.notes else record


def _blocks(tree: Mapping[str, Any], place: str, outer: Block | None, sign: str, label: str = "") -> Iterator[Block]:
    """The struct itself, then those within it."""
    block = Block(tree, place, outer, label=label)
    yield block
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _blocks(value, f"{place}{name}{sign}", block, sign)
        elif isinstance(value, list):
            for position, element in _elements(value, f"{place}{name}", "()"):
                yield from _blocks(element, f"{position}{sign}", block, sign, label=position)


def _expand_structs(blocks: list[Block]) -> Iterator[Block]:
    """Structs that describe themselves under our own names, in place of what is within them; the others as they are."""
    outer: str | None = None  # what is within a struct follows it
    for block in blocks:
        if outer is None or not block.place.startswith(outer):
            described = _expand(block)
            outer = None if described is None else block.place
            yield from [block] if described is None else described


def _elements(values: list[Any], place: str, brackets: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for i, value in enumerate(values):
        position = f"{place}{brackets[0]}{i + 1}{brackets[1]}"
        if isinstance(value, dict):
            yield position, value
        elif isinstance(value, list):
            yield from _elements(value, position, "{}")


# ---- structs that describe themselves
# Siemens Test.Lab: `x_values` (`start_value`, `increment`, `number_of_values`, or `values` of uneven lines), `y_values`
# (`values`, one column for each channel), `function_record` (`type`, `name`, channels); each axis has a `quantity` with
# its `label`. Polytec's file access: `x`, `y` (one row for each point) and `usd`, their description. SEP 5 of SDyPy:
# `data` of a channel with `name`, `unit_str`, and `fs` or `time`.

_SEP_5 = {"samples": "data", "channels": "name", "units": "unit_str", "sample_rate_hz": "fs", "time": "time"}


def _expand(block: Block) -> Iterator[Block] | None:
    """Columns of a struct that describes itself, each as a block of our own names; None of another struct.

    Raises
    ------
    MeasurementError
        On iteration, if its parts contradict each other, or it may be of time or of frequency.
    """
    if isinstance(block.get("x_values"), dict) and isinstance(block.get("y_values"), dict):
        return _test_lab(block)
    if {"data", "name", "unit_str"} <= block.arrays.keys() and not {"fs", "time"}.isdisjoint(block.arrays):
        arrays = {ours: block.arrays[theirs] for ours, theirs in _SEP_5.items() if theirs in block.arrays}
        return iter([Block(arrays, written={"samples": f"{block.place}data"})])
    if isinstance(block.get("usd"), dict) and size_of(block.get("x")) > 1 and size_of(block.get("y")) > 1:
        return _polytec(block)
    return None


def _struct(block: Block, key: str) -> Block:
    value = block.get(key)
    return Block(value if isinstance(value, dict) else {}, f"{block.place}{key}.")


def _test_lab(block: Block) -> Iterator[Block]:
    x, y, about = (_struct(block, key) for key in ("x_values", "y_values", "function_record"))
    values = y.numbers("values", np.complex128)
    values = values.reshape(-1, 1) if values.ndim != 2 or len(values) == 1 else values
    axis = x.numbers("values").ravel() if size_of(x.get("values")) > 1 else _even_axis(x, len(values))
    if axis.size != len(values):
        raise MeasurementError(f"{y.where('values')}: found {len(values)} values; expected {axis.size}, as on the axis")
    struct = block.place.rstrip("./").rpartition(".")[2]
    kind = about.string("type") if is_text(about.get("type")) else struct
    count, inputs = values.shape[1], next((_labels(about, key) for key in about.arrays if "reference" in key), [])
    outputs = _labels(about, "primary_channel") or [label.removeprefix(f"{kind} ") for label in _labels(about, "name")]
    if not inputs and all(label.count("/") == 1 for label in outputs):
        outputs, inputs = ([label.split("/")[side].strip() for label in outputs] for side in (0, 1))
    if len(outputs) != count:
        outputs = [f"{struct} {i + 1}" for i in range(count)] if count > 1 else [struct]
    inputs = inputs * count if len(inputs) == 1 else inputs
    labels = zip(outputs, inputs if len(inputs) == count else ["input 1"] * count, strict=True)
    unit, notes = _stored_unit(_struct(y, "quantity"))
    units, averages = (_struct(x, "quantity").string("label"), unit), _struct(about, "average").scalar("nr_of_averages")
    stated = {"averages": np.array(averages)} if averages else {}
    for column in _columns(block, "y_values.values", (axis, values), units, kind, labels):
        yield Block({**column.arrays, **stated}, written=column.written, notes=notes)


def _stored_unit(quantity: Block) -> tuple[str, tuple[str, ...]]:
    """Unit of stored values, which are in SI: `factor` leads from there to the label, which is for display."""
    label, stated = quantity.string("label"), _struct(quantity, "unit_transformation").scalar("factor")
    unit, about = parse_unit(label), quantity.string("info")
    if unit is None or unit.factor == 1:
        return label, ()
    if stated is None and "MKS" not in about.split():
        return _in_doubt(label, "or SI: no factor"), ()
    if stated is not None and not abs(stated * unit.factor - 1) < 1e-3:
        return _in_doubt(label, f"factor {stated:g}"), ()  # one of the two is wrong
    kind, sensor = frf_unit(label), known.sensor_unit(label)
    si_label = known.si_frf_unit(kind[1]) if kind else known.SI_SENSOR[sensor[1]] if sensor else label
    why = "by its factor" if stated is not None else f"by {about!r}"
    return si_label, (f"stored in SI units {why}, the label {label} is for display: not converted",)


def _in_doubt(label: str, why: str) -> str:
    """A label whose sides other than SI are no unit any more, so that a case asks for them."""
    sides = [(side, parse_unit(side)) for side in sides_of(label) if side]
    return "/".join(side if unit and unit.factor == 1 else f"{side} ({why})" for side, unit in sides)


def _even_axis(x: Block, count: int) -> Array:
    start, step, stated = (x.scalar(key) for key in ("start_value", "increment", "number_of_values"))
    if start is None or step is None or not (np.isfinite([start, step]).all() and step > 0):
        raise MeasurementError(
            f"{x.where('increment')}: found steps of {step} from {start}; expected 'start_value' and a step above 0"
        )
    return start + step * np.arange(float(count) if stated is None or not 0 <= stated <= 1e9 else stated)


def _labels(about: Block, key: str) -> list[str]:
    """Labels of one channel or of several: texts, or structs with a label or name."""
    value, labels = about.get(key), []
    for item in value if isinstance(value, list) else [value]:
        inner = Block(item) if isinstance(item, dict) else Block({"label": item})
        named = (inner.get(name) for name in ("label", "name", "point_id", "id"))
        labels += next((strings(text, about.where(key)) for text in named if is_text(text) and np.size(text)), [])
    return labels


def _polytec(block: Block) -> Iterator[Block]:
    x, values, usd = block.numbers("x").ravel(), block.numbers("y", np.complex128), _struct(block, "usd")
    values = values.reshape(1, -1) if values.size == x.size else values
    if values.ndim != 2 or x.size != values.shape[1]:
        raise MeasurementError(f"{block.where('y')}: found shape {values.shape}; expected rows of {x.size} values")
    kind = " ".join(usd.string(key) for key in ("functiontype", "name"))
    labels = ((f"point {i + 1}", "input 1") for i in range(len(values)))
    yield from _columns(block, "y", (x, values.T), (usd.string("xunit"), usd.string("yunit")), kind, labels)


def _columns(
    block: Block,
    name: str,
    over: tuple[Array, NDArray[Any]],
    units: tuple[str, str],
    kind: str,
    labels: Iterable[tuple[str, str]],
) -> Iterator[Block]:
    """Columns over an axis; `units` are those of the axis and of the values, `kind` is what the file calls it."""
    (axis, values), path = over, f"{block.place}{name}"
    word, seconds = kind.lower(), TIME_S.get(units[0].strip().lower())
    role = next((role for role, words in _KINDS if re.search(words, word)), "")
    if not units[0] and not role and re.search("signal|time", word):
        seconds = 1.0
    if seconds is None and frequency_factor(units[0]) is None and (units[0] or not role):
        raise MeasurementError(
            f"variable '{path}': found the unit {units[0]!r} of an axis that may be of time or frequency; expected s "
            f'or Hz; write frf = "{path}" with f_start_hz, f_step_hz, or samples with sample_rate_hz, in [data.layout]'
        )
    if not role and frf_unit(units[1]) is not None and np.any(values.imag):
        role = "frf"
    role = "samples" if seconds is not None else role or "spectrum"
    for (output, input_), column in zip(labels, values.T, strict=True):
        arrays: dict[str, Any] = {"unit": units[1], role: column if np.any(column.imag) else column.real}
        if seconds is not None:
            arrays |= {"channels": output, "time": axis * seconds}
        else:
            arrays |= {"frequency_hz": axis, "outputs": output, "inputs": input_}
            arrays |= {"frequency_hz_unit": units[0], "kind": kind}
        yield Block(arrays, written=dict.fromkeys(arrays, path))


# ---- what the user says


def _name_arrays(blocks: list[Block], layout: Mapping[str, str]) -> list[Block]:
    """Blocks in which arrays have the names that the layout gives them."""
    for key in layout:
        if key not in LAYOUT_KEYS:
            raise MeasurementError(
                f"[data.layout]: found '{key}' for a file of arrays; expected one of {', '.join(LAYOUT_KEYS)}"
            )
    places = {key: _holders(blocks, key, path) for key, path in layout.items()}
    within = {key: {id(holder): (holder, name) for holder, name in held} for key, held in places.items()}
    data = next((key for key in layout if key in _DATA), None)
    taken = {alias for key in layout for alias in ALIASES.get(key, (key,))}
    dropped = {role for key in layout for role in _AXES.get(key, ())} | (_VALUES if data else set())
    named: list[Block] = []
    for block in blocks if data is None else [holder for holder, _ in places[data]]:
        mapped, written = {}, {}
        for key, path in layout.items():
            held = within[key].get(id(block)) or places[key][0]
            if len(places[key]) > 1 and held[0] is not block:
                listed = " and ".join(f"'{holder.path(name)}'" for holder, name in places[key][:2])
                raise MeasurementError(
                    f"[data.layout] {key}: found {path!r} {len(places[key])} times, {listed}; expected one; write "
                    "its whole path"
                )
            mapped[key], written[key] = _value(held, key, path)
        kept = {n: v for n, v in block.arrays.items() if is_text(v) or block.meanings[n].role not in dropped}
        kept = {n: v for n, v in kept.items() if n.lower() not in taken}
        named.append(Block(mapped | kept, block.place, block.outer, written))
    return named


def _holders(blocks: list[Block], key: str, path: str) -> list[tuple[Block, str]]:
    """Blocks with the name of their array that a path means: the whole path, without its indices, or the name."""
    name = _COLUMN.sub("", path).replace("/", ".")
    entries = [(b, n) for b in blocks for n, value in b.arrays.items() if not isinstance(value, dict)]
    paths = [f"{block.place}{n}".replace("/", ".") for block, n in entries]
    for written in (paths, [re.sub(r"[({]\d+[)}]", "", p) for p in paths], [n for _, n in entries]):
        found = [entry for entry, p in zip(entries, written, strict=True) if p == name]
        if found:
            return found
    if key in _NUMBERS and _number(path) is not None:
        return [(blocks[0], "")]
    near = difflib.get_close_matches(name[:100], paths[:5000], 1, 0.6)
    listed = ", ".join(f"'{p[:60]}'" for p in paths[:_MOST_LISTED]) + (" …" if len(paths) > _MOST_LISTED else "")
    remedy = f"did you mean '{near[0]}'?" if near else "correct the name"
    raise MeasurementError(f"[data.layout] {key}: found no variable '{path[:60]}'; expected one of {listed}; {remedy}")


_COLUMN = re.compile(r"\((?:(?P<row>\d{1,6}), *:|:, *(?P<column>\d{1,6}))\)$")


def _number(text: str) -> float | None:
    number = float_of(text)
    return number if number is not None and np.isfinite(number) else None


def _value(held: tuple[Block, str], key: str, path: str) -> tuple[Any, str]:
    """What a path means, and how to write it."""
    block, name = held
    if not name:
        return np.array(_number(path)), path
    value, match, where = block.get(name), _COLUMN.search(path), f"{block.place}{name}"
    if match is None:
        return value, where
    axis, index = (0, int(match["row"])) if match["row"] else (1, int(match["column"]))
    array = block.numbers(name, np.complex128 if np.iscomplexobj(value) else np.float64)
    if array.ndim != 2 or not 1 <= index <= array.shape[axis]:
        raise MeasurementError(
            f"[data.layout] {key}: found {path!r} of an array of shape {array.shape}; expected a column or row of it, "
            "counted from 1; correct the number"
        )
    return np.take(array, index - 1, axis), path


# ---- what is not understood


def _not_understood(blocks: list[Block]) -> str:
    """All arrays by name, shape and type with the nearest guess, as far as there is room."""
    entries = [(b, n, v) for b in blocks for n, v in b.arrays.items() if size_of(v) or isinstance(v, Unread)]
    entries.sort(key=lambda entry: -min(size_of(entry[2]), 2))
    listed = ", ".join(f"'{(b.place + n)[-60:]}' ({_guess(b, n, v)})" for b, n, v in entries[:_MOST_LISTED])
    more = f" and {len(entries) - _MOST_LISTED} more" if len(entries) > _MOST_LISTED else ""
    return (
        f"content: found neither FRFs nor time histories in {listed or 'texts alone'}{more}; expected variables such "
        "as 'frequency_hz' and 'frf'; say in [data.layout] (or inspect --layout KEY=NAME) which is which, as "
        f'frequency_hz = "name"{_modes_hint(blocks)}'
    )


def _modes_hint(blocks: list[Block]) -> str:
    """Keys for modes, where as many other numbers stand with a short array of frequencies."""
    for block in blocks:
        sizes = {n: size_of(v) for n, v in block.arrays.items() if not re.search("(?i)omega|loss", n)}
        short = [name for name, size in sizes.items() if 1 < size < _MOST_MODES]
        for name in (name for name in short if rises(block.get(name))):
            same = [n for n in short if n != name and sizes[n] == sizes[name]]
            if len(same) == 1:
                frequencies, ratios, shapes = (key for key, _ in _MODES.values())
                said = f'{frequencies} = "{block.path(name)}", {ratios} = "{block.path(same[0])}"'
                return f", or of modes {said}, and {shapes}"
    return ""


def _guess(block: Block, name: str, value: Any) -> str:  # noqa: ANN401
    """Shape and type of an array, and what it may be."""
    if isinstance(value, Unread):
        return value.what
    first = value[0] if isinstance(value, list) else value
    shape = f"{len(value)} cells" if isinstance(value, list) else " x ".join(map(str, first.shape)) or "1"
    kind = {"c": "complex", "i": "whole", "u": "whole"}.get(getattr(first, "dtype", np.dtype(float)).kind, "real")
    role = block.meanings[name].role
    aliases = [alias for aliases in ALIASES.values() for alias in aliases if len(alias) > 3]
    near = difflib.get_close_matches(name.lower()[:40], aliases, 1, 0.75)
    for token in tokens_of(name[:80])[:5]:
        near += difflib.get_close_matches(token, aliases, 1, 0.8)
    if near and not role:
        return f"{shape} {kind}, did you mean '{near[0]}'?"
    if role in ("magnitude", "phase", "real", "imaginary"):
        return f"{shape} {kind}, {role}: the other part is missing"
    if block.is_two_sided(name):
        return f"{shape} {kind}, a two-sided axis: frequency_hz?"
    if parts := columns_of_parts(value, block.path(name)):
        return f"{shape} {kind}: {parts}?"
    guess = ", frf?" if kind == "complex" else ", frequency_hz or time?" if rises(value) else ""
    return f"{shape} {kind}{guess}"
