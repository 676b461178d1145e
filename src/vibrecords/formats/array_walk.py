"""One walk over all structs, groups and cells of a file of arrays: what in them are records, and what the user says."""

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import Array
from vibrecords.errors import MeasurementError
from vibrecords.formats import units as known
from vibrecords.formats.array_frfs import columns_of_parts, frequency_records, mode_records
from vibrecords.formats.channel_units import sides_of
from vibrecords.formats.columns import TIME_S
from vibrecords.formats.matlab_5 import Unread
from vibrecords.formats.named_arrays import ALIASES, Block, is_text, rises, size_of, strings, time_records, tokens_of
from vibrecords.formats.table_text import float_of
from vibrecords.formats.units import frequency_factor, frf_unit, parse_unit
from vibrecords.records import CoherenceRecord, FrfRecord, Record

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
    *("samples", "force", "response", "mode_frequencies_hz", "damping_ratios", "mode_shapes"),
)
_VALUES = {"", "frf", "coherence", "spectrum", "real", "imaginary", "magnitude", "phase", "signal", "samples"}
_VALUES |= {"outputs", "inputs"}
_OVER_FREQUENCY = {"frequency", "omega", *_VALUES} - {"signal", "samples"}
#: Keys of a layout for arrays.
LAYOUT_KEYS = (*_AXES, *_DATA)
_MOST_LISTED = 8
#: What structs that describe themselves hold, by words of their type.
_KINDS = (("coherence", "coh"), ("spectrum", "spectr|psd|fft|power|cross"), ("frf", "frf|transfer|frequency ?response"))


def records_of_tree(tree: Mapping[str, Any], layout: Mapping[str, str], sign: str) -> Iterator[Record]:
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
    used = [_non_negative_half(block) for block in used]
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
    records = (
        replace(record, notes=(*record.notes, *block.notes)) if block.notes else record
        for block in blocks
        for part in (frequency_records, time_records, mode_records)
        for record in part(block)
    )
    while True:
        with np.errstate(all="ignore"):
            record = next(records, None)
        if record is None:
            return
        yield record


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


def _non_negative_half(block: Block) -> Block:
    """A block without the negative half of a frequency axis and of what stands over it; others as they are."""
    axis = next((n for role in ("frequency", "omega") for n in block.named(role) if block.is_two_sided(n)), None)
    if axis is None:
        return block
    lines, arrays = block.numbers(axis).ravel(), dict(block.arrays)
    kept = np.argsort(lines)[np.count_nonzero(lines < 0) :]
    for name, value in block.arrays.items():
        if size_of(value) and block.meanings[name].role in _OVER_FREQUENCY:
            for i in [i for i, size in enumerate(np.shape(value)) if size == lines.size]:
                arrays[name] = np.take(arrays[name], kept, axis=i)
    note = f"two-sided axis '{block.path(axis)}': {kept.size} of {lines.size} lines, from 0 Hz on"
    return block.with_arrays(arrays, note)


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
        return iter([_sep_5(block)])
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
    yield from (
        column.with_arrays({**column.arrays, **stated}, *notes)
        for column in _columns(block, "y_values.values", (axis, values), units, kind, list(labels))
    )


def _stored_unit(quantity: Block) -> tuple[str, tuple[str, ...]]:
    """Unit of stored values, which are in SI: `factor` leads from there to the label, which is for display."""
    label, stated = quantity.string("label"), _struct(quantity, "unit_transformation").scalar("factor")
    unit, kind, sensor = parse_unit(label), frf_unit(label), known.sensor_unit(label)
    about = quantity.string("info")
    if unit is None or unit.factor == 1:
        return label, ()
    if stated is None and "MKS" not in about.split():
        return _in_doubt(label, "or SI: no factor"), ()
    if stated is not None and not abs(stated * unit.factor - 1) < 1e-3:
        return _in_doubt(label, f"factor {stated:g}"), ()  # one of the two is wrong
    si_label = known.si_frf_unit(kind[1]) if kind else known.si_sensor_unit(sensor[1]) if sensor else label
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


def _sep_5(block: Block) -> Block:
    """A channel as SDyPy's proposal SEP 5 has it."""
    names = {"samples": "data", "channels": "name", "units": "unit_str", "sample_rate_hz": "fs", "time": "time"}
    arrays = {ours: block.arrays[theirs] for ours, theirs in names.items() if theirs in block.arrays}
    return Block(arrays, written={"samples": f"{block.place}data"})


def _polytec(block: Block) -> Iterator[Block]:
    x, values, usd = block.numbers("x").ravel(), block.numbers("y", np.complex128), _struct(block, "usd")
    values = values.reshape(1, -1) if values.size == x.size else values
    if values.ndim != 2 or x.size != values.shape[1]:
        raise MeasurementError(f"{block.where('y')}: found shape {values.shape}; expected rows of {x.size} values")
    kind = " ".join(usd.string(key) for key in ("functiontype", "name"))
    labels = [(f"point {i + 1}", "input 1") for i in range(len(values))]
    yield from _columns(block, "y", (x, values.T), (usd.string("xunit"), usd.string("yunit")), kind, labels)


def _columns(
    block: Block,
    name: str,
    over: tuple[Array, NDArray[Any]],
    units: tuple[str, str],
    kind: str,
    labels: list[tuple[str, str]],
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
        'frequency_hz = "name"'
    )


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
