"""Files that are refused: each by one line that names the place and what was found there. The table is refusals.txt."""

import json
import re
from pathlib import Path

import pytest

from tests.vibrecords.array_trees import made
from tests.vibrecords.reading import refusal
from tests.vibrecords.test_array_layouts import ARRAYS
from vibrecords.formats import iter_records, read_frf

_CONTROL = {b"n": b"\n", b"t": b"\t", b"r": b"\r"}


def raw(text):
    """Bytes of a text with the escapes of the table."""
    return re.sub(
        rb"\\x(..)|\\(.)", lambda m: bytes.fromhex(m[1].decode()) if m[1] else _CONTROL.get(m[2], m[2]), text.encode()
    )


def rows():
    table = Path(__file__).with_name("refusals.txt").read_text(encoding="utf-8")
    for part in table.split("\n== ")[1:]:
        head, _, faults = part.partition("--\n")
        name, _, base = head.partition("\n")
        for row in filter(None, faults.split("\n")):
            yield pytest.param(
                None if name == "arrays" else base.encode(), *row.rsplit(" ;; ", 2), id=f"{name}: {row[:60]}"
            )


def faulty(content, changes):
    """The file after changes old=>new, each of which must find what it replaces."""
    for old, new in (map(raw, change.split("=>")) for change in changes.split(" && ")):
        before, found, behind = content.partition(old.removesuffix(b"..")) if old else (content, True, b"")
        assert found, old
        content = before + new + (b"" if old.endswith(b"..") else behind)
    return content


def read(path):
    return [*iter_records(path)] and read_frf(path)


@pytest.mark.parametrize(("base", "changes", "where", "found"), [*rows()])
def test_a_fault_is_one_line_with_its_place_and_what_was_found(tmp_path, base, changes, where, found):
    path, content = (
        tmp_path / "measurement",
        faulty(base, changes) if base is not None else made(json.loads(changes), ARRAYS),
    )
    message = refusal(path, content, re.escape(raw(found).decode()), read=read)
    assert message.startswith(f"{path}: {where}: found " if where else f"{path}: found ")
