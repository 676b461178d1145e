"""Posterior files: small ones with other records, arrays and bytes, read, summed up, and a few of them reported."""

import io
import json
import random
import shutil
import string
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any
from unittest.mock import patch

import h5py
import numpy as np

from tests.fuzz.target import Target

_NUMBERS: list[Any] = [
    0, -1, 1, 2, 3, 10**6, 2**31, 2**63, 2**64, 10**30, -(2**63), 0.5, -0.0, 1e-308, 5e-324, 1e-30, 1e30, 1e308, -1e308,
    float("nan"), float("inf"), float("-inf"), 1.0000001,
]  # fmt: skip
_VALUES: list[Any] = [
    None, True, False, "", " ", "x", "k11", "\x00", "\x1b[31m", "\u202e", "<script>alert(1)</script>", "../../x",
    "9" * 500, "{{7*7}}", '#read("/etc/passwd")', "norm", "chi2_contingency", "Path", "LogPosterior", "gain", "array_0",
    [], {}, [[]], [None], {"kind": "Problem"}, {"kind": "Structure"}, {"array": "array_0"}, {"array": 1}, {"own": "x"},
    {"scipy.stats": "norm", "args": [0, -1], "kwds": {"mapping": []}}, {"mapping": [[1]]}, {"": 0},
]  # fmt: skip


class PosteriorTarget(Target):
    """What `jointbayes report` does: load, sum up, and for one file in fifty the whole report."""

    name = "posterior"
    suffix = ".nc"
    patience = 2000

    def seeds(self) -> list[bytes]:
        """The whole files of the corpus; others in it are kept because they were once read wrongly."""
        return [path.read_bytes() for path in self.corpus() if path.name.startswith("whole-")]

    def mutate(self, rng: random.Random, content: bytes) -> bytes:
        """Mostly one change of the record; else of an array, or of the bytes whatever they mean."""
        ways = rng.choices((_with_other_record, _with_other_array, _with_other_bytes), (10, 5, 4), k=2)
        ways.sort(key=lambda way: way is _with_other_bytes)  # what has these is not opened in this process any more
        for way in ways[: rng.choice((1, 1, 1, 2))]:
            try:
                content = way(rng, content)
            except (AttributeError, KeyError, LookupError, TypeError, ValueError):
                break  # nothing there any more that could be damaged in this way
        return content

    def prepare(self, directory: Path) -> None:
        """Compile the loops and load what a report needs."""
        whole = directory / "whole.nc"
        for i, content in enumerate(self.seeds()):
            whole.write_bytes(content)
            self._read(whole, directory.parent / "work" / "report" if i == 0 else None)
        whole.unlink()

    def attempt(self, path: Path) -> None:
        """Read the file, and report it where its bytes say so, so that the same ones do it every time."""
        reported = sha256(path.read_bytes()).digest()[0] < 5
        self._read(path, Path("report") if reported else None)

    def _read(self, path: Path, report: Path | None) -> None:
        import jointbayes as jb
        from jointbayes.posterior import posterior as judged

        posterior = jb.load_posterior(path)
        json.dumps(posterior.summary().to_json(), allow_nan=False)
        if report is not None:
            # draws with other inputs free, and profiles, take a whole file's report beyond the limit of a damaged one
            effect = judged.effect_of_uncertain_inputs
            with (
                patch.object(judged, "effect_of_uncertain_inputs", lambda posterior, *_: effect(posterior)),
                patch.object(judged, "_profiles", lambda *_: ()),
            ):
                jb.write_report(posterior, report)
            shutil.rmtree(report)


def _with_other_record(rng: random.Random, content: bytes) -> bytes:
    """One field of the JSON record deleted, doubled, nested, or of another value or type."""

    def change(file: h5py.File) -> None:
        record = json.loads(file.attrs["jointbayes"])
        holder, key = _somewhere(rng, record)
        old = holder[key]
        way = rng.randrange(7)
        if way == 0:
            del holder[key]
        elif way == 1:
            holder[key] = rng.choice(_VALUES)
        elif way == 2 or (way == 3 and isinstance(old, int | float)):
            holder[key] = rng.choice(_NUMBERS)
        elif way == 4 and isinstance(old, list):
            holder[key] = old * 2 if rng.random() < 0.5 else old[:-1]
        elif way == 5 and isinstance(old, str):
            holder[key] = _other_text(rng, old)
        elif way == 6:
            holder[key] = _nested(rng, old)
        else:
            holder[key] = old * (1 + 10 ** rng.uniform(-12, 0)) if isinstance(old, float) else [old]
        text = _written(record)
        file.attrs["jointbayes"] = text if rng.random() < 0.99 else text[: rng.randrange(9999)]

    return _changed(content, change)


def _written(record: dict[str, Any]) -> str:
    """The record as text; one nested twice, deeper than Python writes, as a text that is deeper still."""
    try:
        return json.dumps(record)
    except RecursionError:
        return "[" * 9000 + "]" * 9000


def _somewhere(rng: random.Random, record: dict[str, Any]) -> tuple[Any, Any]:
    """A container in the record and a key of it, at any depth: each level as likely as the last."""
    holder: Any = record
    key: Any = rng.choice(list(record))
    while isinstance(holder[key], dict | list) and holder[key] and rng.random() < 0.85:
        holder = holder[key]
        key = rng.choice(list(holder)) if isinstance(holder, dict) else rng.randrange(len(holder))
    return holder, key


def _other_text(rng: random.Random, text: str) -> str:
    at = rng.randrange(len(text) + 1)
    one, value = rng.choice(string.printable), rng.choice([v for v in _VALUES if isinstance(v, str)])
    before, after = text[:at], text[at + 1 :]
    return rng.choice(
        (before + one + after, before + value + text[at:], f"{before}{rng.choice(_NUMBERS)}{after}", before)
    )


def _nested(rng: random.Random, old: Any) -> Any:
    for _ in range(rng.choice((1, 3, 200, 900))):
        old = [old] if rng.random() < 0.5 else {"kind": old} if rng.random() < 0.5 else {"x": old}
    return old


def _with_other_array(rng: random.Random, content: bytes) -> bytes:
    """One array deleted, renamed, of another shape or type, or with other numbers."""

    def change(file: h5py.File) -> None:
        places: list[str] = []
        file.visititems(lambda name, item: places.append(name) if isinstance(item, h5py.Dataset) else None)
        place = rng.choice(places)
        values = file[place][()]
        way = rng.randrange(6)
        if way == 0 or values.dtype.kind == "O":
            del file[rng.choice((place, place.partition("/")[0]))]
        elif way == 1:
            file.move(place, place + "x")
        elif way == 2:
            _replace(file, place, rng.choice(_shapes(values)))
        elif way == 3:
            _replace(file, place, values.astype(rng.choice(("f4", "i8", "u1", "c16", "S8", "f2"))))
        else:
            flat = values.astype(float).ravel()
            for _ in range(rng.choice((1, 1, 10))):
                at = rng.randrange(len(flat)) if len(flat) else 0
                flat[at : at + 1] = rng.choice([float(n) for n in _NUMBERS if abs(n) < 1e300 or n != n])
            if way == 5:
                flat = flat * rng.choice((-1.0, 1 + 1e-6, 1e3, 0.0))
            _replace(file, place, flat.reshape(values.shape))

    with np.errstate(all="ignore"):
        return _changed(content, change)


def _shapes(values: Any) -> list[Any]:
    others = [values[None], values.ravel(), values[:0], values[:1], np.concatenate([values, values])]
    return [*others, values.T, values.ravel()[:3], np.zeros((0, 0)), np.float64(0)] if values.ndim else [values[None]]


def _replace(file: h5py.File, place: str, values: Any) -> None:
    del file[place]
    file[place] = values


def _changed(content: bytes, change: Callable[[h5py.File], None]) -> bytes:
    stream = io.BytesIO(content)
    with h5py.File(stream, "r+") as file:
        change(file)
    return stream.getvalue()


def _with_other_bytes(rng: random.Random, content: bytes) -> bytes:
    damaged = bytearray(content)
    way = rng.randrange(5)
    if way == 0:
        return bytes(damaged[: rng.randrange(len(damaged))])
    if way == 1:
        at = rng.randrange(len(damaged))
        damaged[at : at + rng.choice((1, 8, 512, 4096))] = rng.randbytes(rng.choice((0, 1, 8, 512)))
        return bytes(damaged)
    most = 4096 if rng.random() < 0.4 else len(damaged)  # the front holds what tells of the rest
    for _ in range(rng.choice((1, 2, 8, 64))):
        at = rng.randrange(min(most, len(damaged)))
        damaged[at] = rng.choice((0, 255, rng.randrange(256), damaged[at] ^ (1 << rng.randrange(8))))
    return bytes(damaged)


TARGETS = [PosteriorTarget()]
