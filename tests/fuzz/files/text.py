"""Damage to universal files, tables and LabVIEW files: fields of headers, columns, units, rows."""

import random
import re
from collections.abc import Callable

from tests.fuzz.mutations import EXTREMES, damaged_bytes, replaced, with_extreme_number, with_other_line

UNITS = [
    "g/N", "(mm/s^2)/lbf", "1/kg", "m/N", "m/s/N", "EU/EU", "N", "N*s", "((((m))))", "m^9", "mm^-9/N", "s^-1", "rad/s",
    "kHz", "rpm", "furlong", "dB", "(m/s²)/N", "1/1/1/1", "m/s^2", "deg", "rad", "ms", "V", "1", "g0", "m(s)(N)", "//",
]  # fmt: skip
_WORDS = [w.encode() for w in UNITS] + [
    b"", b" ", b"NONE", b"frequency [Hz]", b"omega", b"time [s]", b"time [ms]", b"real 1:Z+ / 2:Z- [g/N]", b"imaginary",
    b"magnitude [dB re 1 m/N]", b"phase", b"phase [deg]", b"coherence", b"12:Z+", b"Point:12:RX-", b"hit 2",
    b"averages 10", b"sample_rate_hz=200.0", b"response=", b"\x1b[31m", "\u202e".encode(), b"a" * 400, b"[" * 60,
    b"(" * 60, b" " * 400, b"$\\frac{", b'"', b'"a', b"#", b"%", b"X_Value",
]  # fmt: skip
#: Columns of the fields in the lines of a data set 58, counted from 0; lines from that of its number.
_FIELDS: dict[int, list[tuple[int, int]]] = {
    0: [(0, 6), (6, 7), (7, 13), (13, 19), (19, 31), (31, 43)],
    6: [(0, 5), (5, 15), (15, 20), (20, 30), (31, 41), (41, 51), (51, 55), (56, 66), (66, 76), (76, 80)],
    7: [(0, 10), (10, 20), (20, 30), (30, 43), (43, 56), (56, 69)],
    **{line: [(0, 10), (10, 15), (15, 20), (20, 25), (26, 46), (47, 67)] for line in (8, 9, 10, 11)},
}
_NUMBERS = b"0 1 -1 2 3 4 5 6 7 9 11 12 13 17 18 58 164".split()


def _number(rng: random.Random) -> bytes:
    return rng.choice(_NUMBERS) if rng.random() < 0.6 else rng.choice(EXTREMES).encode()


def _with_field(rng: random.Random, content: bytes) -> bytes:
    """One field of the header of one data set 58 has another value, in its columns."""
    if not (starts := [m.start() for m in re.finditer(rb"(?m)^ {4}58", content)]):
        return content
    start = rng.choice(starts)
    lines = content[start:].split(b"\n", 12)
    line = rng.choice(list(_FIELDS))
    if line >= len(lines) - 1:
        return content
    first, last = rng.choice(_FIELDS[line])
    value = _number(rng) if rng.random() < 0.7 else rng.choice(_WORDS)
    row = lines[line].ljust(last)
    value = value[: last - first] if rng.random() < 0.9 else value
    lines[line] = row[:first] + value.rjust(last - first) + row[last:]
    return content[:start] + b"\n".join(lines)


def _with_other_sets(rng: random.Random, content: bytes) -> bytes:
    """Data sets in another order, twice, or left out."""
    parts = content.split(b"    -1\n")
    if len(parts) < 3:
        return content
    sets = [part for part in parts if part]
    match rng.randrange(4):
        case 0:
            rng.shuffle(sets)
        case 1:
            sets.append(rng.choice(sets))
        case 2:
            sets.remove(rng.choice(sets))
        case 3:
            units = b"   164\n" + _number(rng).rjust(10) + rng.choice(_WORDS)[:20].ljust(20) + b"         2\n"
            factors = b"".join(_number(rng).rjust(25) for _ in range(3))
            sets.insert(rng.randrange(len(sets)), units + factors + b"\n" + factors + b"\n")
    return b"".join(b"    -1\n" + one + b"    -1\n" for one in sets)


def _with_word_in_line(rng: random.Random, content: bytes) -> bytes:
    """An ID line or another line has other text."""
    lines = content.split(b"\n")
    lines[rng.randrange(min(len(lines), 60))] = rng.choice(_WORDS)
    return b"\n".join(lines)


def _with_line_ends(rng: random.Random, content: bytes) -> bytes:
    return content.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b" \n", b"\n\r")), rng.choice((-1, 1, 3)))


def damaged_uff(rng: random.Random, content: bytes) -> bytes:
    """A universal file with one to three damages."""
    return _damaged(rng, content, (_with_field, _with_field, _with_field, _with_other_sets, _with_word_in_line))


def _cells(content: bytes) -> tuple[bytes, list[list[bytes]]]:
    best = max((b"\t", b",", b";"), key=content.count)
    return best, [line.split(best) for line in content.split(b"\n")]


def _with_cell(rng: random.Random, content: bytes) -> bytes:
    separator, rows = _cells(content)
    row = rows[rng.randrange(len(rows) if rng.random() < 0.5 else min(len(rows), 4))]
    value = rng.choice(_WORDS) if rng.random() < 0.6 else rng.choice(EXTREMES).encode()
    row[rng.randrange(len(row))] = value
    return b"\n".join(separator.join(r) for r in rows)


def _with_column(rng: random.Random, content: bytes) -> bytes:
    """One column of numbers extreme throughout, moved, doubled or left out, its name with it or not."""
    separator, rows = _cells(content)
    wide = max(len(row) for row in rows)
    at, to, what, value = rng.randrange(wide), rng.randrange(wide), rng.randrange(4), rng.choice(EXTREMES).encode()
    out = []
    for number, row in enumerate(rows):
        if len(row) == wide and (number > 3 or rng.random() < 0.9):
            row = list(row)
            if what == 0:
                row[at] = value if number > 3 else row[at]
            elif what == 1:
                row[at], row[to] = row[to], row[at]
            elif what == 2:
                row.insert(to, row[at])
            else:
                row.pop(at)
        out.append(separator.join(row))
    return b"\n".join(out)


def _with_row(rng: random.Random, content: bytes) -> bytes:
    lines = content.split(b"\n")
    at = rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            lines[at] = b"# " + lines[at]
        case 1:
            lines.insert(at, rng.choice((b"", b"#", b"# averages: 3", b"# quantity: mobility", b"%a:b")))
        case 2:
            lines[at] = lines[at] + rng.choice((b",", b"\t", b";", b" ", b"1"))
        case _:
            return with_other_line(rng, content)
    return b"\n".join(lines)


def _with_other_signs(rng: random.Random, content: bytes) -> bytes:
    old, new = rng.choice(((b",", b";"), (b".", b","), (b"\t", b" "), (b",", b"\t"), (b"\t", b","), (b"e", b"D")))
    return content.replace(old, new)


def damaged_table(rng: random.Random, content: bytes) -> bytes:
    """A table with one to three damages."""
    return _damaged(rng, content, (_with_cell, _with_cell, _with_column, _with_row, _with_other_signs))


_LVM = re.compile(rb"(?m)^([A-Za-z_0-9]+)\t(.*)$")


def _with_lvm_field(rng: random.Random, content: bytes) -> bytes:
    choices = [b"Comma", b"Tab", b",", b".", b"No", b"One", b"Multi", b"Frequency", b"Time", b"0", b"9" * 5000]
    value = rng.choice(choices) if rng.random() < 0.5 else rng.choice((_number(rng), rng.choice(_WORDS)))
    return replaced(rng, content, _LVM.finditer(content), lambda _: value, 2)


def _with_segments(rng: random.Random, content: bytes) -> bytes:
    """The segment again, with or without the blank line between."""
    parts = content.split(b"***End_of_Header***")
    if len(parts) < 3:
        return content
    again = parts[1].lstrip(b"\n") + b"***End_of_Header***" + parts[2]
    return content + rng.choice((b"\n", b"", b"\n\n")) + again * rng.choice((1, 2, 5))


def damaged_lvm(rng: random.Random, content: bytes) -> bytes:
    """A LabVIEW file with one to three damages."""
    ways = (_with_lvm_field, _with_lvm_field, _with_segments, _with_cell, _with_column, _with_row, _with_other_signs)
    return _damaged(rng, content, ways)


def _damaged(rng: random.Random, content: bytes, ways: tuple[Callable[[random.Random, bytes], bytes], ...]) -> bytes:
    if rng.random() < 0.3:
        return damaged_bytes(rng, content)
    for _ in range(rng.choice((1, 1, 2, 3))):
        content = rng.choice((*ways, with_extreme_number, _with_line_ends))(rng, content or b"1,2\n")
    return damaged_bytes(rng, content, 1) if rng.random() < 0.1 else content
