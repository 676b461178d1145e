"""Damage to files of every kind: bytes, text by its words and lines, arrays by name, shape, type and value.

Every choice is the generator's, so that an input follows from the seed, the file and its number.
"""

import io
import random
import re
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

_LINES = Path(__file__).with_name("words.txt").read_text(encoding="utf-8").split("== ")[1:]
#: Numbers at which arithmetic, limits and parsers break; words of any format, and what none of them expects: units,
#: headers, values of TOML, markup, marks that do not print; and bytes.
EXTREMES, WORDS, _STRANGE = ([eval(line) for line in part.splitlines()[1:]] for part in _LINES)
_TOKEN = re.compile(rb'"[^"\n]*"|[-+]?\d[\w.+-]*|[A-Za-z_][\w.]*|[^\s\w]')
_NUMBER = re.compile(rb"(?<![\w.])[-+]?\d[\d_]*(?:\.\d+)?(?:[eE][-+]?\d+)?")
_SEPARATORS = [(b",", b";"), (b".", b","), (b"\t", b" "), (b",", b"\t"), (b"\t", b","), (b"e", b"D"),
               *((b"\n", end) for end in (b"\r\n", b"\r", b"\n\n", b" \n"))]  # fmt: skip
Change = Callable[[random.Random, bytes], bytes]


def damaged_bytes(rng: random.Random, content: bytes, most: int = 4) -> bytes:
    """The content after one to a few small damages."""
    for _ in range(rng.randint(1, most)):
        if not content:
            return content
        at = rng.randrange(len(content))
        end = min(len(content), at + 1 + int(rng.expovariate(1 / 30)))
        span, rest = content[at:end], content[:at] + content[end:]
        content = rng.choice((
            lambda c, at, span, rest: c[:at] + bytes([c[at] ^ (1 << rng.randrange(8))]) + c[at + 1 :],
            lambda c, at, span, rest: c[:at] + bytes([rng.choice((0, 1, 127, 128, 255))]) + c[at + 1 :],
            lambda c, at, span, rest: c[:at] + rng.choice(_STRANGE) + c[at:],
            lambda c, at, span, rest: rest,
            lambda c, at, span, rest: c[:at] + span * rng.choice((2, 3, 50)) + c[at + len(span) :],
            lambda c, at, span, rest: c[:at],
            lambda c, at, span, rest: rest[: at // 2] + span + rest[at // 2 :],
            lambda c, at, span, rest: with_extreme_number(rng, c),
        ))(content, at, span, rest)  # fmt: skip
    return content


def with_extreme_number(rng: random.Random, content: bytes) -> bytes:
    """The text with one of its numbers replaced by one at which things break."""
    if not (found := list(_NUMBER.finditer(content))):
        return content
    number = rng.choice(found)
    return content[: number.start()] + rng.choice(EXTREMES).encode() + content[number.end() :]


def damaged_text(rng: random.Random, content: bytes, other: bytes = b"") -> bytes:
    """Text with a few other words, numbers, lines and separators, some of them from another text."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        way = rng.random()
        if way < 0.3:
            content = with_extreme_number(rng, content)
        elif way < 0.6:
            content = _with_other_word(rng, content, other)
        elif way < 0.85:
            content = _with_other_line(rng, content, other)
        elif way < 0.9:
            old, new = rng.choice(_SEPARATORS)
            content = content.replace(old, new, rng.choice((-1, 1, 3)))
        else:
            content = damaged_bytes(rng, content)
    return content


def _with_other_word(rng: random.Random, content: bytes, other: bytes) -> bytes:
    """One word in the place of another, in as many columns where a format may have fixed ones."""
    if not (words := list(_TOKEN.finditer(content[:20_000]))):
        return content
    old, theirs = rng.choice(words), _TOKEN.findall(other[:20_000])
    new = rng.choice((rng.choice(WORDS).encode(), rng.choice(EXTREMES).encode(), rng.choice(words)[0],
                      rng.choice(theirs or [b"x"]), old[0][:-1], old[0] + b"s"))  # fmt: skip
    wide = len(old[0])
    new = new[:wide].rjust(wide) if rng.random() < 0.4 else new
    return content[: old.start()] + new + content[old.end() :]


def _with_other_line(rng: random.Random, content: bytes, other: bytes) -> bytes:
    """A line left out, repeated, moved, commented out, or one of another text; or the rest of another text."""
    lines, theirs = content.split(b"\n"), other.split(b"\n")
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(7):
        case 0:
            del lines[at]
        case 1:
            lines[to:to] = [lines[at]] * rng.choice((1, 1, 1, 1, 1, 1, 300))
        case 2:
            lines[at], lines[to] = lines[to], lines[at]
        case 3:
            lines[at] = b"# " + lines[at]
        case 4:
            lines.insert(at, rng.choice(theirs))
        case 5:
            lines.insert(at, rng.choice((b"[%s]", b"%s = 1", b"# %s")) % rng.choice(WORDS).encode())
        case 6:
            lines[at:] = theirs[rng.randrange(len(theirs)) :]
    return b"\n".join(lines)


# ---- files of arrays


def damaged_npz(rng: random.Random, content: bytes, other: bytes = b"") -> bytes:
    """An archive with other arrays, or with damaged members and the right check sums."""
    with suppress(Exception):  # a seed that was an offender
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        name = rng.choice(list(members))
        if rng.random() < 0.5:
            array = np.lib.format.read_array(io.BytesIO(members[name]), allow_pickle=False)
            out = io.BytesIO()
            np.lib.format.write_array(out, np.asarray(_other_array(rng, array)), allow_pickle=True)
            members[name] = out.getvalue()
        else:
            head = rng.choice((0, min(len(members[name]), 128)))
            members[name] = members[name][:head] + damaged_bytes(rng, members[name][head:])
        if rng.random() < 0.2:
            members[rng.choice((f"{rng.choice(WORDS)[:40]}.npy", "\u202e/x.npy", "/f.npy", "x"))] = members.pop(name)
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", rng.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED))) as archive:
            for each, whole in members.items():
                archive.writestr(zipfile.ZipInfo(each), whole, archive.compression)
        return out.getvalue() if rng.random() < 0.8 else damaged_bytes(rng, out.getvalue())
    return damaged_bytes(rng, content)


def damaged_mat(rng: random.Random, content: bytes, other: bytes = b"") -> bytes:
    """A MATLAB 5 file with other arrays, packed or not, so that damaged bytes hit what is inside too."""
    with suppress(Exception):
        arrays = {k: v for k, v in scipy.io.loadmat(io.BytesIO(content)).items() if not k.startswith("__")}
        for _ in range(rng.choice((0, 1, 2))):
            name = rng.choice(list(arrays))
            array = _other_array(rng, arrays.pop(name) if rng.random() < 0.3 else arrays[name])
            arrays[rng.choice((name, name, *WORDS))] = array if rng.random() < 0.8 else {"data": array, "unit": "g"}
        out = io.BytesIO()
        scipy.io.savemat(out, arrays, do_compression=rng.random() < 0.5)
        content = out.getvalue()
    return damaged_bytes(rng, content, 3) if rng.random() < 0.6 else content


def damaged_hdf5(rng: random.Random, content: bytes, other: bytes = b"") -> bytes:
    """An HDF5 file with other data sets, attributes, links and groups; else with damaged bytes."""
    if rng.random() < 0.7:
        with suppress(Exception):
            head, out = content[:512], io.BytesIO(content)
            with h5py.File(out, "r+") as file:
                for _ in range(rng.choice((1, 1, 2))):
                    with suppress(ValueError, OSError, RuntimeError, TypeError, KeyError):  # there already, or gone
                        _change_in(rng, file)
            content = (head if head[124:128] == b"\x00\x02IM" else out.getvalue()[:512]) + out.getvalue()[512:]
        if rng.random() < 0.8:
            return content
    return damaged_bytes(rng, content, 3)


def _change_in(rng: random.Random, file: Any) -> None:
    places: list[str] = []
    file.visit(places.append)
    place = rng.choice(places)
    match rng.randrange(14):
        case 0:
            del file[place]
        case 1:
            file.move(place, f"{place}{rng.choice(('x', '/x', *WORDS))}")
        case 2:
            file["soft"] = h5py.SoftLink(rng.choice(("/frf", "/nothing", "/soft")))
        case 3:
            file["outside"] = h5py.ExternalLink(rng.choice(("/etc/passwd", "input.h5")), "/frf")
        case 4:
            file.require_group("/".join(["a"] * rng.choice((2, 31, 33, 100))))["loop"] = file
        case 5:
            shape = rng.choice(((10**6,), (10**9, 12), (0,), (10**15,)))
            file.create_dataset("samples2", shape=shape, dtype="f8", chunks=True)
        case 6:
            file["references"] = np.array([file.ref, file.ref], dtype=h5py.ref_dtype)
        case 7:
            file["odd"] = np.zeros(3, [("real", "<f8"), ("imag", rng.choice(("<f8", "<i4", "S2")))])
        case 8 | 9 | 10:  # an attribute: most of all a text, which may be a record in JSON
            attrs = rng.choice([some for some in (file.attrs, file[place].attrs) if len(some)] or [file.attrs])
            name = rng.choice([*attrs, rng.choice(WORDS)])
            value = attrs.get(name, 1.0)
            if isinstance(value, str) and rng.random() < 0.9:
                attrs[name] = damaged_text(rng, value.encode()).decode(errors="replace")
            else:
                attrs[name] = rng.choice((1, "char", b"\xff", np.zeros((2, 2)), h5py.Empty("f8"), rng.choice(WORDS)))
        case _:
            values = file[place][()]
            del file[place]
            file[place] = _other_array(rng, values)


def _other_array(rng: random.Random, array: Any) -> Any:
    """An array with another value, scale, shape or type, or a text."""
    array = np.asarray(array)
    numbers = array.dtype.kind in "fc" and array.size > 0
    with np.errstate(all="ignore"):
        match rng.randrange(8 if numbers else 5):
            case 0:
                return rng.choice(WORDS)
            case 1:
                return array.astype(rng.choice(("<f8", ">f8", "<f4", "<f2", "<i8", "u1", "<c16", "?", "S3"))) if (
                    array.dtype.kind in "biufc") else array[:0]  # fmt: skip
            case 2:
                return rng.choice((array.T, array[None], array[..., None], array.ravel(), np.float64(rng.random())))
            case 3:
                return np.atleast_1d(array)[: rng.choice((0, 1, 3))]
            case 4:
                return np.concatenate([np.atleast_1d(array)] * 2)
            case 5:
                return array * rng.choice((-1.0, 1 + 1e-6, 1e3, 0.0, 1e308))
            case _:
                changed = array.copy()
                changed.reshape(-1)[rng.randrange(array.size)] = float(rng.choice(EXTREMES[:20]))
                return changed
