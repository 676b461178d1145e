"""One walk over all structs, groups and cells of a file of arrays: what in them are records, and what the user says."""

import difflib
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.array_frfs import frequency_records
from jointbayes.measurement.formats.array_modes import mode_records
from jointbayes.measurement.formats.array_names import ALIASES, tokens_of
from jointbayes.measurement.formats.array_structs import described_blocks
from jointbayes.measurement.formats.matlab_5 import Unread
from jointbayes.measurement.formats.named_arrays import Block, is_text, rises, size_of, time_records
from jointbayes.measurement.records import CoherenceRecord, FrfRecord, Record

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
    *("samples", "force", "response"),
)
_VALUES = {*("frf", "coherence", "spectrum", "real", "imaginary", "magnitude", "phase", "signal", "samples"), ""}
_VALUES |= {"outputs", "inputs"}
#: Keys of a layout for arrays.
LAYOUT_KEYS = (*_AXES, *_DATA)
_MOST_LISTED = 8


def records_of_tree(tree: Mapping[str, Any], layout: Mapping[str, str], sign: str) -> Iterator[Record]:
    """Records of a tree of arrays.

    Parameters
    ----------
    tree
        As `jointbayes.measurement.formats.array_files.read_arrays` gives it.
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
    used = _name_arrays(blocks, layout) if layout else _described(blocks)
    records: list[Record] = []
    with np.errstate(all="ignore"):  # a file may hold any number
        for block in used:
            records += [*frequency_records(block), *time_records(block), *mode_records(block)]
    if not records and any(block.arrays for block in blocks):
        raise MeasurementError(_not_understood(blocks))
    yield from _with_coherences(records)


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


def _described(blocks: list[Block]) -> Iterator[Block]:
    """Structs that describe themselves under our own names, in place of what is within them; the others as they are."""
    outer: str | None = None  # what is within a struct follows it
    for block in blocks:
        if outer is None or not block.place.startswith(outer):
            described = described_blocks(block)
            outer = None if described is None else block.place
            yield from [block] if described is None else described


def _elements(values: list[Any], place: str, brackets: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for i, value in enumerate(values):
        position = f"{place}{brackets[0]}{i + 1}{brackets[1]}"
        if isinstance(value, dict):
            yield position, value
        elif isinstance(value, list):
            yield from _elements(value, position, "{}")


def _with_coherences(records: list[Record]) -> Iterator[Record]:
    """Coherences that stand apart go to the one FRF of their channels and lines."""
    frfs = [record for record in records if isinstance(record, FrfRecord) and record.coherence is None]
    placed: dict[int, CoherenceRecord] = {}
    for coherence in (record for record in records if isinstance(record, CoherenceRecord)):
        fitting = [
            frf
            for frf in frfs
            if (frf.response, frf.reference) == (coherence.response, coherence.reference)
            and np.array_equal(frf.frequency_hz, coherence.frequency_hz)
        ]
        if len(fitting) == 1:
            placed.setdefault(id(fitting[0]), coherence)
    apart = {id(coherence) for coherence in placed.values()}
    for record in records:
        if isinstance(record, FrfRecord) and id(record) in placed:
            yield replace(record, coherence=placed[id(record)].values)
        elif id(record) not in apart:
            yield record


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
    near = difflib.get_close_matches(name, paths, 1, 0.6)
    listed = ", ".join(f"'{p[:60]}'" for p in paths[:_MOST_LISTED]) + (" …" if len(paths) > _MOST_LISTED else "")
    remedy = f"did you mean '{near[0]}'?" if near else "correct the name"
    raise MeasurementError(f"[data.layout] {key}: found no variable '{path[:60]}'; expected one of {listed}; {remedy}")


_COLUMN = re.compile(r"\((?:(?P<row>\d{1,6}), *:|:, *(?P<column>\d{1,6}))\)$")


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if np.isfinite(number) else None


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
    known = [alias for aliases in ALIASES.values() for alias in aliases if len(alias) > 3]
    near = difflib.get_close_matches(name.lower()[:40], known, 1, 0.75) or [
        close for token in tokens_of(name[:80])[:5] for close in difflib.get_close_matches(token, known, 1, 0.8)
    ]
    guess = ""
    if near and not role:
        guess = f", did you mean '{near[0]}'?"
    elif role in ("magnitude", "phase", "real", "imaginary"):
        guess = f", {role}: the other part is missing"
    elif kind == "complex":
        guess = ", frf?"
    elif rises(value):
        guess = ", frequency_hz or time?"
    return f"{shape} {kind}{guess}"
