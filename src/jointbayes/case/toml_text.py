"""TOML text: reading and writing it, where its keys stand, and what is wrong where it is not TOML at all."""

from __future__ import annotations

import bisect
import json
import os
import re
import tomllib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from jointbayes.errors import CaseError, similar
from vibrecords.errors import path_fault, printable

_MOST_BYTES = 1_000_000
#: Tables in tables; a case file has five. Beyond, reading takes time and memory that grow with the square of the depth.
_MOST_DEPTH = 20
_MEASURED = (".csv", ".tsv", ".uff", ".unv", ".uf", ".mat", ".npz", ".npy", ".h5", ".hdf5", ".lvm")
_START = "start from what `jointbayes init my_case.toml` writes"
_SYNTAX = {  # what tomllib says: what was found, what to do
    "Cannot overwrite a value": ("this key is given twice", "remove one of the two"),
    "Duplicate inline table key": ("a key is given twice in one inline table", "remove one of the two"),
    "Cannot declare": ("this table is given twice", "put all its keys under one header"),
    "Expected newline or end": (
        "something follows the value",
        "write one key on each line, texts in quotes, decimals with a point, no unit, comments after #",
    ),
    "Unclosed inline table": ("a table without its brace, or a unit after a number", "write no unit, and close with }"),
    "Expected '='": ("a key without an equals sign", "write key = value, or [table] for a table"),
    "Invalid value": ("no value that TOML knows", 'write a number, true, false, "a text" or [a, list]'),
    "Invalid statement": ("neither a key nor a table", "write key = value, or [table] for a table"),
    "Illegal character '\\n'": ("a text without its closing quote", "close the quote"),
    "Unterminated string": ("a text without its closing quote", "close the quote"),
    "Unclosed array": ("a list without its closing bracket", "close the list with ]"),
}

KeyPath = tuple[str | int, ...]

_KEY_PART = re.compile(r'"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|[A-Za-z0-9_-]+')
_KEY = re.compile(rf"(?:{_KEY_PART.pattern})(?:[ \t]*\.[ \t]*(?:{_KEY_PART.pattern}))*")
_STRING = re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'', re.DOTALL)
_SCALAR = re.compile(r"[^,\]}#\n]+")
_DOTTED = re.compile(rf"{_STRING.pattern}|#[^\n]*|(?P<keys>{_KEY.pattern})", re.DOTALL)
_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_COMMA = re.compile(rf"{_BLANK.pattern},?{_BLANK.pattern}")
_EQUALS, _OPEN, _CLOSE = (re.compile(rf"[ \t]*{sign}[ \t]*") for sign in ("=", r"\[{1,2}", r"\]{1,2}"))


class _Scanner:
    """Reads the line numbers of all keys, tables and array entries of a text that ``tomllib`` has accepted.

    Only positions are read: the grammar has been checked, so anything that is no string, array or inline
    table is skipped as a scalar.
    """

    def __init__(self, text: str) -> None:
        self.text, self.pos = text, 0
        self.lines: dict[KeyPath, int] = {}
        self._newlines = [m.start() for m in re.finditer("\n", text)]
        self._last_entry: dict[KeyPath, int] = {}  # arrays of tables: index of the entry now open

    def scan(self) -> dict[KeyPath, int]:
        table: KeyPath = ()
        self._take(_BLANK)
        while self.pos < len(self.text):
            if self._sees("["):
                table = self._header()
            else:
                self._pair(table)
            self._take(_BLANK)
        return self.lines

    def _line(self) -> int:
        return bisect.bisect_left(self._newlines, self.pos) + 1

    def _sees(self, *tokens: str) -> bool:
        return self.text.startswith(tokens, self.pos)

    def _take(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.pos)
        if match is None:
            raise ValueError(f"no {pattern.pattern} at offset {self.pos}")
        self.pos = match.end()
        return match[0]

    def _key(self) -> list[str]:
        """Read a possibly dotted, possibly quoted key."""
        raw = _KEY_PART.findall(self._take(_KEY))
        return [tomllib.loads(f"key = {raw_key}")["key"] if raw_key[0] in "\"'" else raw_key for raw_key in raw]

    def _header(self) -> KeyPath:
        line, path = self._line(), KeyPath()
        brackets = len(self._take(_OPEN).strip())
        parts = self._key()
        for number, key in enumerate(parts, 1):
            path = (*path, key)
            self.lines.setdefault(path, line)
            if number < len(parts) and path in self._last_entry:
                path = (*path, self._last_entry[path])
        self._take(_CLOSE)
        if brackets == 2:
            self._last_entry[path] = self._last_entry.get(path, -1) + 1
            path = (*path, self._last_entry[path])
        self.lines[path] = line  # a table's own header counts, not an earlier [table.child]
        return path

    def _pair(self, table: KeyPath) -> None:
        line, path = self._line(), table
        for key in self._key():
            path = (*path, key)
            self.lines.setdefault(path, line)
        self._take(_EQUALS)
        self.toml_value(path)

    def toml_value(self, path: KeyPath) -> None:
        if self._sees("[", "{"):
            self._entries(path)
        else:
            self._take(_STRING if self._sees('"', "'") else _SCALAR)

    def _entries(self, path: KeyPath) -> None:
        """Read the entries of an array or the pairs of an inline table, up to its closing bracket."""
        is_array, index = self._sees("["), 0
        self.pos += 1
        self._take(_BLANK)
        while not self._sees("]", "}"):
            if is_array:
                self.lines[(*path, index)] = self._line()
                self.toml_value((*path, index))
            else:
                self._pair(path)
            index += 1
            self._take(_COMMA)
        self.pos += 1


def key_lines(text: str) -> dict[KeyPath, int]:
    """Give the line of each key, table and array entry (index as last part) of a valid TOML text, as named today."""
    return {_name_of_today(path): line for path, line in _Scanner(text).scan().items()}


@lru_cache(maxsize=1000)
def key_parts(key: str) -> tuple[str, ...]:
    """Parts of a dotted key of today, in which parts may stand in quotes; none of what is no key."""
    try:
        inside: Any = tomllib.loads(f"{key} = 0")
    except (ValueError, RecursionError):
        return ()
    parts: list[str] = []
    while isinstance(inside, dict) and len(inside) == 1:
        name = next(iter(inside))
        parts.append(name)
        inside = inside[name]
    return _name_of_today(tuple(parts)) if inside == 0 else ()


def fault_line(name: str, line: int, key: str, *parts: str) -> str:
    """Compose one line of a `CaseError`: file, line, key, then found; expected; what to do."""
    return f"{fault_start(name, line)} {key}: " + "; ".join(words for words in parts if words)


def fault_start(name: str, line: int) -> str:
    """File and line; the name is the only part of a message that a user may fill with line breaks."""
    return f"{printable(name)}:{line}:"


_Part = TypeVar("_Part", str, str | int)
#: Tables in which older case files say `setups` for `tests`.
_TABLES_OF_TESTS: tuple[KeyPath, ...] = ((), ("left_out",))


def _name_of_today(path: tuple[_Part, ...]) -> tuple[_Part, ...]:
    """The key of today for one of an older case file, which calls the tests of a joint set-ups."""
    return tuple("tests" if part == "setups" and path[:n] in _TABLES_OF_TESTS else part for n, part in enumerate(path))


def parse_toml(text: str, name: str) -> dict[str, object]:
    """Parse TOML text to keys of today; a syntax error or a text without any key is a `CaseError` of one line."""
    deep = next((m for m in _DOTTED.finditer(text) if m["keys"] and m["keys"].count(".") >= _MOST_DEPTH), None)
    if deep is not None:  # tomllib's time grows with the square of the parts, too
        raise CaseError(_too_deep(name, text.count("\n", 0, deep.start()) + 1))
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise CaseError(_too_deep(name, 1)) from None
    except ValueError as error:  # also plain ones, such as an integer of more than 4300 digits
        raise CaseError(_syntax_fault(str(error), text, name)) from None
    if not data:
        raise CaseError(fault_line(name, 1, "file", "holds no key", "expected a case file in TOML", _START))
    if _depth(data) > _MOST_DEPTH:
        raise CaseError(_too_deep(name, 1))
    for place in _TABLES_OF_TESTS:  # where both names are there neither changes
        table: Any = data
        for part in place:
            table = table.get(part, {})
        if isinstance(table, dict) and "setups" in table and "tests" not in table:
            table["tests"] = table.pop("setups")
    return data


def _too_deep(name: str, line: int) -> str:
    return fault_line(
        name, line, "file", "nested too deeply", f"expected a case file, no more than {_MOST_DEPTH} levels deep", _START
    )


def _depth(data: object) -> int:
    """Levels of tables and lists, counted no further than is allowed."""
    level: list[Any] = [data]
    for depth in range(_MOST_DEPTH + 1):
        entries = (entry.values() if isinstance(entry, dict) else entry for entry in level)
        level = [inner for each in entries for inner in each if isinstance(inner, dict | list)]
        if not level:
            return depth + 1
    return _MOST_DEPTH + 1


def _syntax_fault(message: str, text: str, name: str) -> str:
    rows = text.splitlines() or [""]
    at = re.search(r"\(at line (\d+), column \d+\)", message)
    line = int(at[1]) if at else len(rows)
    digits = re.search(r"\d{4300}", text)
    if digits and "int_max_str_digits" in message:
        message, line = "an integer of more than 4300 digits", text.count("\n", 0, digits.start()) + 1
    row = rows[line - 1] if line <= len(rows) else ""
    key = re.match(r"\s*([\w.\"'-]+)\s*=", row)
    cause = re.sub(r"\s*\(at .*", "", message)
    plain = next((words for start, words in _SYNTAX.items() if cause.startswith(start)), None)
    fault, remedy = plain or (f"no valid TOML ({cause})", "correct the line")
    if re.search(r'"[^"]*\\[^"]*"', row) and plain is None:
        fault = "a backslash in a text in double quotes"
        remedy = "write a Windows path with / or in single quotes: file = 'C:\\data\\tip.uff'"
    if (comma := re.search(r"=\s*([+-]?\d+),(\d+)(?=\s*(?:[,}#]|$))", row)) is not None:
        fault, remedy = f"found a decimal comma in {comma[1]},{comma[2]}", f"write {comma[1]}.{comma[2]} with a point"
    if re.search("[“”„‘’]", row):
        fault, remedy = "quotes of a word processor", 'write straight quotes: "text"'
    return fault_line(name, line, key[1] if key else "syntax", fault, "expected TOML: key = value", remedy)


def read_text(path: str | os.PathLike[str]) -> str:
    """Read a case file as text; any fault is a `CaseError` of one line."""
    name, line = os.fspath(path), 1
    try:
        place = Path(path)
        if place.is_file() and place.suffix.lower() in _MEASURED:
            fault, remedy = "this is a measurement file", f"write a case for it: jointbayes init --from {name}"
        elif place.is_file():
            with place.open("rb") as stream:
                content = stream.read(_MOST_BYTES + 1)
            if len(content) <= _MOST_BYTES:
                return content.decode("utf-8-sig").replace("\r\n", "\n")
            fault, remedy = "larger than 1 MB", "keep measurements in files of their own"
        elif place.is_dir():
            fault, remedy = "this is a directory", "name the .toml file in it"
        elif place.exists():
            fault, remedy = "this is no regular file", "save the case to a file first"
        else:
            near = similar(place.name, (p.name for p in place.parent.glob("*.toml")))
            fault, remedy = "no such file", f'did you mean "{near}"?' if near else "check the path"
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        fault, remedy = "not UTF-8 text", "save the file as UTF-8"
    except (OSError, ValueError) as error:  # ValueError: a path with a null byte
        fault, remedy = f"cannot be read ({path_fault(error)})", "check the path and its permissions"
    raise CaseError(fault_line(name, line, "file", fault, "expected a case file in TOML, UTF-8", remedy))


_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(data: Mapping[str, Any]) -> str:
    """Write tables, values and lists as TOML; comments of a text they came from are lost.

    Parameters
    ----------
    data
        What `tomllib.loads` gives.

    Examples
    --------
    >>> print(toml_text({"title": "A", "data": {"f_min_hz": 20.0, "file": ["a.csv"]}}), end="")
    title = "A"
    <BLANKLINE>
    [data]
    f_min_hz = 20.0
    file = ["a.csv"]
    """
    return "\n".join(_table(data, ())) + "\n"


def _table(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    inside = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    lines = [f"{_key(key)} = {toml_value(value)}" for key, value in table.items() if key not in inside]
    if path and (lines or not inside):
        lines = ["", f"[{'.'.join(map(_key, path))}]", *lines]
    for key, value in inside.items():
        lines += _table(value, (*path, key))
    return lines


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _text(key)


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")  # JSON allows it as it is, TOML not


def toml_value(value: object) -> str:
    """A value, list or table as TOML has it on one line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{_key(key)} = {toml_value(entry)}' for key, entry in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    return str(value)  # numbers, dates and times, which Python prints as TOML has them
