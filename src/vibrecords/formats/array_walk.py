"""One walk over all structs, groups and cells of a file of arrays: what in them are records, and what the user says.

What one struct or group holds is FRFs, coherences, spectra or modes.
"""

import difflib
import re
from collections.abc import Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import Array, Quantity, complex_of
from vibrecords.errors import MeasurementError, refusal, require_one_of
from vibrecords.formats import units as known
from vibrecords.formats.channel_units import sides_of
from vibrecords.formats.matlab_5 import Unread
from vibrecords.formats.named_arrays import ALIASES, Block, axis_of, is_complex, is_text, rises, size_of, time_records
from vibrecords.formats.names import RATE_KEY, float_of
from vibrecords.formats.units import TIME_S, frf_unit, hertz_factor, in_hz, parse_unit, read_frf_unit, scaled
from vibrecords.records import HIGHEST_HZ, CoherenceRecord, FrfRecord, ModeRecord, Record, SpectrumRecord, is_two_sided

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
    coherences = [name for name in block.named("coherence") if frfs or _axis(block, name, block.numbers(name).shape)]
    if coherences and not frfs and any(block.named(part) for part in ("magnitude", "real", "imaginary")):
        raise _not_understood([block])  # an FRF of which one part has another name
    pairs = dict(_pairs(block, [frf.name for frf in frfs], coherences))
    for frf in frfs:
        yield from _frf_records(block, frf, pairs.get(frf.name), alone=len(frfs) == 1)
    placed = {*pairs.values()}
    for name in (name for name in coherences if name not in placed):
        alone = not frfs and len(coherences) == 1
        given = _Values(name, block.numbers(name))
        for labels, lines, values, where, notes in _columns_of_frf(block, given, alone=alone):
            yield CoherenceRecord(*labels, lines, values, block.averages(), where, notes)
    for name in block.named("spectrum"):
        array = block.numbers(name, np.complex128)
        if array.ndim < 3 and _axis(block, name, array.shape):
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
            raise refusal(block.where(imaginary), f"the unit {other!r}", f"{one!r}, that of '{real}'", "correct one")
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
        alone = f"export the other part as well, or write {_paste(block, real=named[0])} if it is a real part alone"
        keys = f"write {keys}" if (keys := _keys_to_paste(block)) else alone
        found = "real numbers, which may be the real part of an FRF or its magnitude"
        expected = "complex numbers, or the other part with them"
        raise refusal(block.where(named[0]), found, expected, f"{keys}, in [data.layout]")
    if len(frfs) > 1 and {frf.name.lower() for frf in frfs} <= {"h1", "h2", "hv"}:
        found = f"{' and '.join(named)}, which may be estimates of one FRF or FRFs of several channels"
        expected = "one of them"
        raise refusal(block.where(named[0]), found, expected, f"write {_paste(block, frf=named[0])} in [data.layout]")
    return frfs


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
        raise refusal(block.where(other), f"shape {second.shape}", f"{first.shape} as '{name}'", "correct one of them")
    return first, second.reshape(first.shape)


def _polar(block: Block, name: str, of_phase: str) -> _Values:
    magnitude, phase = _same_size(block, name, of_phase)
    hints, notes = block.hints(of_phase), ["magnitude taken as linear, not in decibels"]
    if "db" in block.hints(name) or block.units_of(name)[0][:2].lower() == "db":
        notes = ["decibels taken as 20 log10 of the magnitude"]
        magnitude = 10 ** (magnitude / 20)
    elif (magnitude < 0).any():
        key = "phase_rad" if "rad" in hints else "phase_deg"
        raise MeasurementError(
            f"{block.where(name)}: found negative numbers, which may be decibels or the real part of an FRF; expected "
            f"magnitudes of 0 or more; write {_paste(block, magnitude_db=name, **{key: of_phase})}, or real with its "
            "imaginary part, in [data.layout]"
        )
    if not hints & {"deg", "rad"} and np.max(np.abs(phase[np.isfinite(phase)]), initial=0.0) > _MOST_RADIANS:
        hints, notes = frozenset({"deg"}), [*notes, "phase without unit taken as degrees, since it passes 4π"]
    if not hints & {"deg", "rad"}:
        raise MeasurementError(
            f"{block.where(of_phase)}: found a phase that may be in degrees or in radians; expected its unit; write "
            f'phase_rad = "{block.path(of_phase)}" or phase_deg = "{block.path(of_phase)}" in [data.layout]: this key '
            "alone will do"
        )
    return _Values(name, magnitude * np.exp(1j * (np.deg2rad(phase) if "deg" in hints else phase)), notes)


# ---- axes


def _axis(block: Block, name: str, shape: tuple[int, ...]) -> tuple[Block, str] | None:
    return axis_of(block, name, shape, ("frequency", "omega"), "frequency_hz")


def _lines(block: Block, name: str, shape: tuple[int, ...]) -> tuple[Array, list[str]]:
    """Frequency lines of an array, in Hz, with notes: its axis, or a first line and a step."""
    of_another_size = (axis for role in ("frequency", "omega") for axis in block.named(role, 0))
    holder, axis = _axis(block, name, shape) or (block, next(of_another_size, ""))
    if axis:
        in_rad_s = holder.meanings[axis].role == "omega"
        unit = "rad/s" if in_rad_s else holder.unit_of(axis) or ("kHz" if "khz" in holder.hints(axis) else "Hz")
        return in_hz(holder.numbers(axis).ravel(), unit, holder.where(axis), "correct it")
    start, step = block.scalar("f_start"), block.scalar("f_step")
    if step is not None and start is not None:
        lines = start + step * np.arange(float(max(shape, default=0)))
        return lines, [f"lines of {start:g} Hz and steps of {step:g} Hz"]
    if step is not None:
        found = f"a step of {step:g} Hz and no first line, which may be 0 or {step:g} Hz"
        remedy = f'write f_start_hz = "0" or f_start_hz = "{step:g}" in [data.layout]'
        raise refusal(block.where(name), found, "both", remedy)
    if axes := [*block.named("w"), *(block.outer.named("w") if block.outer else [])]:
        remedy = f'write omega_rad_s = "{axes[0]}" or frequency_hz = "{axes[0]}" in [data.layout]'
        raise refusal(f"variable '{axes[0]}'", "an axis that may be in rad/s or in Hz", "its name to say which", remedy)
    keys = _keys_to_paste(block) or 'f_start_hz = "0", f_step_hz = "0.5" with the first line and the step in Hz'
    expected = "a variable 'frequency_hz' or 'omega_rad_s'"
    raise refusal(block.where(name), "no frequency lines with it", expected, f"write {keys} in [data.layout]")


def _arrange(block: Block, name: str, values: NDArray[Any], lines: int) -> tuple[NDArray[Any], list[str]]:
    """Array of shape (lines, outputs, inputs) from the shapes that occur in files."""
    shape, notes, where = values.shape, [], block.where(name)
    if values.ndim == 0 or values.ndim > 3 or lines not in shape:
        raise refusal(where, f"shape {shape}", f"(lines, outputs, inputs) with {lines} lines", "correct the array")
    if shape.count(lines) > 1 and lines > 1 and not block.strings("outputs"):
        raise block.square_error(name, shape, "lines", "frf")
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
            remedy = "store one coherence for each FRF"
            raise refusal(block.where(coherence), f"shape {arranged.shape}", f"{frf.values.shape} as the FRFs", remedy)
    units, averages = block.units_of(frf.name, len(columns), alone=True), block.averages()
    word, own = ", ".join(dict.fromkeys(block.strings("quantity"))).lower(), block.quantity_of(frf.name)
    if own not in get_args(Quantity) and word:
        require_one_of(get_args(Quantity), word, block.where("quantity"))
        own = word
    stated = cast(Quantity, own) if own in get_args(Quantity) else block.meanings[frf.name].quantity
    for (labels, lines, values, where, notes), of_pair, unit in zip(columns, squared, units, strict=True):
        factor, of_unit, converted = read_frf_unit(unit)
        quantity = stated or of_unit
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
            found = f"{len(stated)} labels, {len(set(stated))} different"
            raise refusal(block.where(f"{side}s"), found, f"{count}, one for each", "correct them")
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


#: What modes are made of as pyOMA names it: the key of a layout, and the names that other programs give.
_MODES = {
    "fn": ("mode_frequencies_hz", r"(f_?n|(natural|modal|modes?|resonan[ct]e?|eigen)_?freq(uenc(y|ies)|s)?(_?hz)?)"),
    "xi": ("damping_ratios", r".*(damp.*(ratio|perc|pct)|zeta).*"),
    "phi": ("mode_shapes", r".*shapes?|phi|psi"),
    "fn_std": ("fn_std", "fn_std"),
    "xi_std": ("xi_std", "xi_std"),
}


def mode_records(block: Block) -> Iterator[ModeRecord]:
    """Modes of a block: frequencies ``Fn``, Hz, ratios ``Xi``, shapes ``Phi`` (channels x modes), as pyOMA has them.

    Raises
    ------
    MeasurementError
        If a frequency is none, or shapes do not agree.
    """
    # 1. names, as the user or pyOMA gives them, or other programs where there is no FRF
    names: dict[str, str] = {}
    for key, (own, pattern) in _MODES.items():
        stated = next((n for n in (own, key) if size_of(block.get(n))), "")
        alike = [n for n in block.arrays if re.fullmatch(pattern, n, re.IGNORECASE) and not block.named("frf")]
        if stated or len(alike) == 1:
            names[key] = stated or alike[0]
    # a frequency axis is none of modes, unless as many damping ratios stand next to it
    axes, ratios = block.named("frequency", 1), size_of(block.get(names.get("xi", "")))
    if "fn" not in names and len(axes) == 1 and ratios == size_of(block.get(axes[0])) > 0:
        names["fn"] = axes[0]
    if "fn" not in names:
        return
    # 2. numbers, one of each for each mode
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
        found = f"{sizes} values and shapes 'Phi' of shape {shapes.shape}"
        raise refusal(where, found, f"one of each for each of {count} modes, channels x modes", "correct them")
    if not ((frequency >= 0) & (frequency <= HIGHEST_HZ)).all():
        raise refusal(where, "no frequencies", f"0 to {HIGHEST_HZ:g} Hz", "leave the others out")
    # 3. what is not taken, and the records
    doubtful = [key for key in ("Fn_cov", "Xi_cov") if block.name_of(key.lower())]
    notes += [f"{key} not taken: a variance or a relative one" for key in doubtful]
    dampings = [n for n in block.arrays if "xi" not in names and "damp" in n.lower()]
    notes += [f"'{n}' not taken: a ratio, or another measure; damping_ratios can name it" for n in dampings]
    if "xi" in of_modes and not (np.abs(of_modes["xi"]) < 1).all():
        notes.append("Xi not taken: above critical, or in percent")
        of_modes = {key: values for key, values in of_modes.items() if "xi" not in key}
    labels = block.strings("dofs") or block.strings("channels") or [f"channel {i + 1}" for i in range(len(shapes))]
    if len(set(labels)) != len(shapes):
        found = f"{len(labels)} channels for {len(shapes)} rows"
        raise refusal(block.where(names.get("phi", "phi")), found, "one for each", "correct them")
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
    answers = {key: path for key, path in layout.items() if key in ("phase_deg", "phase_rad")}
    if answers and not {*layout} & ({*_DATA} - {*answers}):  # alone they say the unit of the phases, and nothing else
        for key, path in answers.items():
            holder, name = _holders(blocks, key, path)[0]
            if holder.meanings[name].role != "phase":
                continue
            layout = {other: path for other, path in layout.items() if other != key}
            for i, block in enumerate(blocks):
                open_ = [n for n in block.named("phase") if not block.hints(n) & {"deg", "rad"}]
                stated = {f"{n}_unit": np.array(key.removeprefix("phase_")) for n in open_}
                blocks[i] = replace(block, arrays={**block.arrays, **stated})
    used = _name_arrays(blocks, layout) if layout else list(_expand_structs(blocks))
    # one by one, without warnings of NumPy: a file may hold any number
    parts, records = (frequency_records, time_records, mode_records), list[Record]()
    with np.errstate(all="ignore"):
        for block in used:
            for record in (record for part in parts for record in part(block)):
                records.append(replace(record, notes=(*record.notes, *block.notes)) if block.notes else record)
    apart: dict[tuple[str, str], list[CoherenceRecord]] = {}
    for record in records:
        if isinstance(record, CoherenceRecord):
            apart.setdefault((record.response, record.reference), []).append(record)
    for record in records:
        if isinstance(record, FrfRecord) and record.coherence is None:
            of_pair = apart.get((record.response, record.reference))
            if of_pair and np.array_equal(of_pair[0].frequency_hz, record.frequency_hz):
                record = replace(record, coherence=of_pair.pop(0).values)
        if not isinstance(record, CoherenceRecord):
            yield record
    for of_pair in apart.values():
        yield from of_pair
    if not records and any(block.arrays for block in blocks):
        raise _not_understood(blocks)


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
# `data` of a channel with `name`, `unit_str`, and `fs` or `time`. DEWESoft's modal test:
# `Data1_MT_FRF_H1_2Zplus_1Zplus_Ampl` and `_Phase`, `Data1_MT_Coherence_2Zplus_1Zplus`, each with its axis under
# `Data1_X_`, and `Data1_MT_Ave_Count`.

_SEP_5 = {"samples": "data", "channels": "name", "units": "unit_str", "sample_rate_hz": "fs", "time": "time"}


def _expand_structs(blocks: list[Block]) -> Iterator[Block]:
    """Columns of structs that describe themselves, each as a block of our own names; the others as they are.

    Raises
    ------
    MeasurementError
        If parts of a struct contradict each other, or it may be of time or of frequency.
    """
    outer: str | None = None  # what is within a struct follows it
    for block in blocks:
        if outer is not None and block.place.startswith(outer):
            continue
        outer = block.place
        if isinstance(block.get("x_values"), dict) and isinstance(block.get("y_values"), dict):
            yield from _test_lab(block)
        elif {"data", "name", "unit_str"} <= block.arrays.keys() and not {"fs", "time"}.isdisjoint(block.arrays):
            arrays = {ours: block.arrays[theirs] for ours, theirs in _SEP_5.items() if theirs in block.arrays}
            yield Block(arrays, written={"samples": f"{block.place}data"})
        elif isinstance(block.get("usd"), dict) and size_of(block.get("x")) > 1 and size_of(block.get("y")) > 1:
            x, values = block.numbers("x").ravel(), block.numbers("y", np.complex128)
            values, usd = values.reshape(1, -1) if values.size == x.size else values, _struct(block, "usd")
            if values.ndim != 2 or x.size != values.shape[1]:
                raise refusal(block.where("y"), f"shape {values.shape}", f"rows of {x.size} values")
            kind = " ".join(usd.string(key) for key in ("functiontype", "name"))
            labels = ((f"point {i + 1}", "input 1") for i in range(len(values)))
            yield from _columns(block, "y", (x, values.T), (usd.string("xunit"), usd.string("yunit")), kind, labels)
        else:
            outer = None
            yield from _dewesoft(block)


_DEWESOFT_DOF = r"(\d+R?[XYZ](?:plus|minus))"
_DEWESOFT_FRF = re.compile(rf"(Data\d+_)(MT_FRF_(\w+?)_{_DEWESOFT_DOF}_{_DEWESOFT_DOF}_)(Ampl|Real|Re)")
_DEWESOFT_PARTS = {"Ampl": "magnitude", "Phase": "phase", "Real": "real", "Re": "real", "Imag": "imaginary"}


def _dewesoft(block: Block) -> Iterator[Block]:
    """FRFs of DEWESoft's modal test, each as a block of our own names, and what else the block holds."""
    arrays, used, estimators = block.arrays, set[str](), dict[tuple[str, ...], str]()
    for match in filter(None, map(_DEWESOFT_FRF.fullmatch, arrays)):
        data, stem, estimator, response, reference = match.groups()[:5]
        names = {ours: f"{data}{stem}{theirs}" for theirs, ours in _DEWESOFT_PARTS.items()}
        names |= {"frequency_hz": f"{data}X_{stem}{match[6]}", "averages": f"{data}MT_Ave_Count"}
        names |= {"coherence": f"{data}MT_Coherence_{response}_{reference}"}
        names = {
            ours: name
            for ours, name in names.items()
            if name in arrays and (ours != "averages" or size_of(arrays[name]))
        }
        if "frequency_hz" not in names:
            continue
        if (other := estimators.setdefault((data, response, reference), estimator)) != estimator:
            keys = {ours: name for ours, name in names.items() if ours not in ("averages", "phase")}
            keys |= {"phase_rad": names["phase"]} if "phase" in names else {}
            remedy = f"write {_paste(block, **keys)} (phase_deg for degrees) in [data.layout]"
            raise refusal(block.where(match[0]), f"{other} and {estimator} of one FRF", "one of them", remedy)
        used |= {name for ours, name in names.items() if ours != "averages"}
        used |= {name.replace(data, f"{data}X_") for name in used}
        ends = (
            re.sub(r"(R?[XYZ])(plus|minus)", lambda m: f":{m[1]}{'+' if m[2] == 'plus' else '-'}", dof)
            for dof in (response, reference)
        )
        labels = dict(zip(("outputs", "inputs"), map(np.array, ends), strict=True))
        unit = {"phase_unit": np.array(block.unit_of(names["phase"]))} if "phase" in names else {}
        yield Block(
            {ours: arrays[name] for ours, name in names.items()} | labels | unit,
            written={ours: block.place + name for ours, name in names.items()},
        )
    yield replace(block, arrays={name: value for name, value in arrays.items() if name not in used}) if used else block


def _struct(block: Block, key: str) -> Block:
    value = block.get(key)
    return Block(value if isinstance(value, dict) else {}, f"{block.place}{key}.")


def _test_lab(block: Block) -> Iterator[Block]:
    x, y, about = (_struct(block, key) for key in ("x_values", "y_values", "function_record"))
    values = y.numbers("values", np.complex128)
    values = values.reshape(-1, 1) if values.ndim != 2 or len(values) == 1 else values
    if size_of(x.get("values")) > 1:
        axis = x.numbers("values").ravel()
    else:
        start, step, stated = (x.scalar(key) for key in ("start_value", "increment", "number_of_values"))
        if start is None or step is None or not (np.isfinite([start, step]).all() and step > 0):
            raise refusal(x.where("increment"), f"steps of {step} from {start}", "'start_value' and a step above 0")
        axis = start + step * np.arange(float(len(values)) if stated is None or not 0 <= stated <= 1e9 else stated)
    if axis.size != len(values):
        raise refusal(y.where("values"), f"{len(values)} values", f"{axis.size}, as on the axis")
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
    of_all = {"averages": np.array(averages)} if averages else {}
    for column in _columns(block, "y_values.values", (axis, values), units, kind, labels):
        yield Block({**column.arrays, **of_all}, written=column.written, notes=notes)


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


def _labels(about: Block, key: str) -> list[str]:
    """Labels of one channel or of several: texts, or structs with a label or name."""
    value, labels = about.get(key), []
    for item in value if isinstance(value, list) else [value]:
        inner = Block(item if isinstance(item, dict) else {"label": item}, f"{about.place}{key}.")
        named = (name for name in ("label", "name", "point_id", "id") if is_text(inner.get(name)))
        labels += next(filter(None, map(inner.strings, named)), [])
    return labels


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
    if seconds is None and hertz_factor(units[0]) is None and (units[0] or not role):
        step = (axis[-1] - axis[0]) / max(axis.size - 1, 1)
        raise MeasurementError(
            f"variable '{path}': found the unit {units[0]!r} of an axis of time or frequency; expected s or "
            f'Hz; write frf = "{path}", f_start_hz = "{axis[0]:.9g}", f_step_hz = "{step:.9g}", or samples = "{path}", '
            f'sample_rate_hz = "{1 / step if step else 0:.9g}" in [data.layout]'
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
            raise refusal("[data.layout]", f"'{key}' for a file of arrays", f"one of {', '.join(LAYOUT_KEYS)}")
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
                found = f"{path!r} {len(places[key])} times, {listed}"
                raise refusal(f"[data.layout] {key}", found, "one", "write its whole path")
            mapped[key], written[key] = _value(held, key, path)
        kept = {n: v for n, v in block.arrays.items() if is_text(v) or block.meanings[n].role not in dropped}
        used = {
            name for key, path in layout.items() for holder, name in places[key] if holder is block and path[-1] != ")"
        }
        kept = {n: v for n, v in kept.items() if n.lower() not in taken and n not in used}
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
    if key in _NUMBERS and (number := float_of(path)) is not None and np.isfinite(number):
        return [(blocks[0], "")]
    near = difflib.get_close_matches(name[:100], paths[:5000], 1, 0.6)
    listed = ", ".join(f"'{p[:60]}'" for p in paths[:_MOST_LISTED]) + (" …" if len(paths) > _MOST_LISTED else "")
    remedy = f"did you mean '{near[0]}'?" if near else "correct the name"
    raise refusal(f"[data.layout] {key}", f"no variable '{path[:60]}'", f"one of {listed}", remedy)


_COLUMN = re.compile(r"\((?:(?P<row>\d{1,6}(?::\d{1,6})?), *:|:, *(?P<column>\d{1,6}(?::\d{1,6})?))\)$")


def _value(held: tuple[Block, str], key: str, path: str) -> tuple[Any, str]:
    """What a path means, and how to write it."""
    block, name = held
    if not name:
        return np.array(float_of(path)), path
    value, match, where = block.get(name), _COLUMN.search(path), f"{block.place}{name}"
    if match is None:
        return value, where
    axis, (first, _, last) = (0 if match["row"] else 1), (match["row"] or match["column"]).partition(":")
    array = block.numbers(name, np.complex128 if np.iscomplexobj(value) else np.float64)
    if array.ndim != 2 or not 1 <= int(first) <= int(last or first) <= array.shape[axis]:
        found, remedy = f"{path!r} of an array of shape {array.shape}", "correct the number"
        raise refusal(f"[data.layout] {key}", found, "a column or row of it, or several as 2:4, counted from 1", remedy)
    part = np.take(array, np.arange(int(first) - 1, int(last or first)), axis)
    part = part.T if axis == 0 else part
    return part if last else part[:, 0], path


# ---- what is not understood

_PARTS = ("magnitude", "phase", "real", "imaginary")


def _not_understood(blocks: list[Block]) -> MeasurementError:
    """Refusal that lists all arrays by name, shape and type, as far as there is room, with the keys to paste."""
    listed: list[tuple[int, str]] = []
    for block in blocks:
        for name, value in block.arrays.items():
            first, role = value[0] if isinstance(value, list) and value else value, block.meanings[name].role
            shape = f"{len(value)} cells" if isinstance(value, list) else " x ".join(map(str, np.shape(value))) or "1"
            kind = {"c": "complex", "i": "whole", "u": "whole"}.get(
                getattr(first, "dtype", np.dtype(float)).kind, "real"
            )
            missing = f", {role}: the other part is missing" if role in _PARTS else ""
            what = value.what if isinstance(value, Unread) else f"{shape} {kind}{missing}"
            if size_of(value) or isinstance(value, Unread):
                listed.append((-min(size_of(value), 2), f"'{(block.place + name)[-60:]}' ({what})"))
    listed.sort(key=lambda entry: entry[0])
    shown = ", ".join(entry for _, entry in listed[:_MOST_LISTED]) or "texts alone"
    more = f" and {len(listed) - _MOST_LISTED} more" if len(listed) > _MOST_LISTED else ""
    keys = next(filter(None, map(_keys_to_paste, blocks)), 'frequency_hz = "NAME", frf = "NAME" with these names')
    expected = "arrays of known names, such as 'frequency_hz' and 'frf' or 'time' and 'force'"
    remedy = f"write {keys} in [data.layout] (or inspect --layout KEY=NAME)"
    found = f"found neither FRFs nor time histories in {shown}{more}"
    return MeasurementError.of("content", (), found, expected, remedy)


def _paste(block: Block, **names: str) -> str:
    """Keys of a layout with the arrays that they name; with an FRF its coherence, because nothing else is read then."""
    coherences = block.named("coherence") if {"frf", "real", "magnitude", "magnitude_db"} & {*names} else []
    names |= {"coherence": coherences[0]} if len(coherences) == 1 else {}
    return ", ".join(f'{key} = "{block.path(name)}"' for key, name in names.items())


def _keys_to_paste(block: Block) -> str:
    """Keys for arrays whose names do not say enough; the user knows which of two readings is right.

    1. Vectors are the arrays of one axis, and the columns of a matrix that begins with an axis or may be two parts.
    2. The first vector that rises is the axis; vectors of its length stand over it.
    3. Over lines these are FRFs or their parts, over instants time histories.
    """
    # 1. vectors by their paths
    arrays = {n: v for n, v in block.arrays.items() if isinstance(v, np.ndarray) and size_of(v) > 1 and v.ndim < 3}
    vectors = {n: v.ravel() for n, v in arrays.items() if v.size == max(v.shape)}
    on_lines = block.scalar("f_step") is not None
    for name, value in arrays.items():
        columns, form = (value, "{}(:,{})") if len(value) >= value.shape[-1] else (value.T, "{}({},:)")
        if name not in vectors and (rises(columns[:, 0].real) or (columns.shape[1] == 2 and (vectors or on_lines))):
            vectors |= {form.format(name, i): c if c.imag.any() else c.real for i, c in enumerate(columns.T, start=1)}
    # 2. the axis, and what stands over it
    roles = {path: block.meanings[path].role if path in arrays else "" for path in vectors}
    values = {"frf", "coherence", "spectrum", *_PARTS}
    may_be_axes = {path: v for path, v in vectors.items() if roles[path] not in values and not is_complex(v)}
    axis = next((path for path, v in may_be_axes.items() if rises(v) or is_two_sided(v)), "")
    others = [path for path, v in vectors.items() if path != axis and (not axis or v.size == vectors[axis].size)]
    unknown = [path for path in others if roles[path] in ("", "signal", "meta", "frf")]
    parts = dict(zip(("real", "imaginary"), unknown, strict=False))
    if not axis:
        if on_lines and len(unknown) > 1:
            return _paste(block, **parts)
        channels = [n for n in arrays if not is_complex(arrays[n]) and roles.get(n) in (None, "", "signal")]
        rate = {block.scalar("rate"), block.scalar("interval")} != {None}
        key = {"response" if n in vectors else "samples": n for n in channels[:1]}
        return _paste(block, **key) + ("" if rate else f", {RATE_KEY}") if key else ""
    # 3. modes with their damping; over lines, or over instants
    if damping := [path for path in others if "damp" in path.lower()]:
        keys = {"mode_frequencies_hz": axis, "damping_ratios": damping[0]}
        shapes = [n for n in arrays if re.fullmatch(_MODES["phi"][1], n, re.IGNORECASE)]
        return _paste(block, **keys, **dict(zip(["mode_shapes"], shapes, strict=False)))
    if not roles[axis] and {roles[path] for path in others} & values:
        return _paste(block, frequency_hz=axis)
    if frfs := [path for path in unknown if is_complex(vectors[path])]:
        return _paste(block, frequency_hz=axis, frf=frfs[0])
    as_parts = f"{_paste(block, frequency_hz=axis, **parts)}, or magnitude with phase_deg or phase_rad"
    if axis in arrays:
        named = {}  # arrays over the instants are histories under their own names
    elif len(others) > 2:
        named = {"samples": re.sub(r"2(?=[,)])", f"2:{len(others) + 1}", others[0])}
    else:
        named = dict(zip(("force", "response")[-len(others) :], others, strict=True))
    as_histories = _paste(block, time=axis, **named)
    steps = np.diff(vectors[axis])
    if roles[axis] == "frequency" or steps.mean() >= 0.1 or not np.ptp(steps) < 0.5 * abs(steps.mean()):
        return as_parts if len(unknown) > 1 else ""
    return as_histories if steps.mean() < 0.01 or len(unknown) < 2 else f"{as_histories}; or {as_parts}"
