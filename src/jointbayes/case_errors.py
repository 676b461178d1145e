"""From faults in a case file to lines a user can act on: ``FILE:LINE: key: found; expected; what to do``.

The expectation of every line is the ``description`` of the schema field (plain words, with the unit) and the
remedy uses its first ``examples`` entry, so a new field brings its own error message along.
"""

from __future__ import annotations

import bisect
import difflib
import json
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from jointbayes.errors import CaseError

__all__ = ["Finding", "fault_lines", "key_lines", "parse_toml", "raise_findings", "read_text"]

_MOST_BYTES = 1_000_000
_START = "start from configs/clamped_beam.toml"
_SYNTAX = {  # what tomllib says: what was found, what to do
    "Cannot overwrite a value": ("this key is given twice", "remove one of the two"),
    "Duplicate inline table key": ("a key is given twice in one inline table", "remove one of the two"),
    "Cannot declare": ("this table is given twice", "put all its keys under one header"),
    "Expected newline or end": (
        "something follows the value",
        "write one key on each line, decimals with a point, comments after #",
    ),
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
_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_COMMA = re.compile(rf"{_BLANK.pattern},?{_BLANK.pattern}")
_EQUALS, _OPEN, _CLOSE = (re.compile(rf"[ \t]*{sign}[ \t]*") for sign in ("=", r"\[{1,2}", r"\]{1,2}"))
_LONGEST = 40  # characters of a user's own text repeated in a message


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
            if self._at("["):
                table = self._header()
            else:
                self._pair(table)
            self._take(_BLANK)
        return self.lines

    def _line(self) -> int:
        return bisect.bisect_left(self._newlines, self.pos) + 1

    def _at(self, *tokens: str) -> bool:
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
        return [tomllib.loads(f"key = {part}")["key"] if part[0] in "\"'" else part for part in raw]

    def _header(self) -> KeyPath:
        line, path = self._line(), KeyPath()
        brackets = len(self._take(_OPEN).strip())
        parts = self._key()
        for number, part in enumerate(parts, 1):
            path = (*path, part)
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
        for part in self._key():
            path = (*path, part)
            self.lines.setdefault(path, line)
        self._take(_EQUALS)
        self._value(path)

    def _value(self, path: KeyPath) -> None:
        if self._at("[", "{"):
            self._entries(path)
        else:
            self._take(_STRING if self._at('"', "'") else _SCALAR)

    def _entries(self, path: KeyPath) -> None:
        """Read the entries of an array or the pairs of an inline table, up to its closing bracket."""
        is_array, index = self._at("["), 0
        self.pos += 1
        self._take(_BLANK)
        while not self._at("]", "}"):
            if is_array:
                self.lines[(*path, index)] = self._line()
                self._value((*path, index))
            else:
                self._pair(path)
            index += 1
            self._take(_COMMA)
        self.pos += 1


def key_lines(text: str) -> dict[KeyPath, int]:
    """Give the line of each key, table and array entry (index as last part) of a valid TOML text."""
    return _Scanner(text).scan()


@dataclass(frozen=True)
class Finding:
    """A fault found by a rule of the schema, placed relative to the value the rule looks at.

    ``expected`` may stay empty where the description of the field says it; a ``missing`` finding needs
    nothing but its place.
    """

    loc: KeyPath
    found: str = ""
    expected: str = ""
    remedy: str = ""
    missing: bool = False


def raise_findings(findings: Iterable[Finding]) -> None:
    """Raise what a schema rule found, if anything, as one `PydanticCustomError` that carries it all."""
    found = list(findings)
    if found:
        text = " | ".join(f"{_show_key(f.loc)}: {f.found or 'missing'}; {f.expected}" for f in found)
        raise PydanticCustomError("case_findings", "{text}", {"text": text, "findings": found})


def _similar(word: str, choices: Iterable[str]) -> str | None:
    """Return the choice a misspelt word was probably meant to be, or None."""
    by_lower = {choice.lower(): choice for choice in choices}
    close = difflib.get_close_matches(word.lower(), by_lower, 1, 0.6)
    return by_lower[close[0]] if close else None


def _show(value: object) -> str:
    """Describe a value of a case file in the words of the file, always on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"the text {_quoted(value)}" if value else "an empty text"
    if isinstance(value, int | float):
        # The size of an absurdly long integer says enough, and str() refuses more than 4300 digits.
        is_long = isinstance(value, int) and abs(value) > 10**20
        return "an integer of more than 20 digits" if is_long else repr(value)
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, Sequence):
        return f"a list of {len(value)}" if value else "an empty list"
    return "a date or time"  # all that TOML has left


def _show_key(path: Sequence[str | int]) -> str:
    """Write a key path as in the file; list positions are left to the text of the message."""
    parts = [p for p in path if isinstance(p, str)]
    return ".".join(p if re.fullmatch(r"[A-Za-z0-9_-]{1,60}", p) else _quoted(p) for p in parts) or "file"


def _quoted(text: str) -> str:
    shown = text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
    return f'"{shown}"' if shown.isprintable() else json.dumps(shown)


def _fault_line(name: str, line: int, key: str, *parts: str) -> str:
    """Compose one line of a `CaseError`: file, line, key, then found; expected; what to do."""
    # The name is the only part a user may fill with line breaks.
    safe_name = name if name.isprintable() else json.dumps(name)
    return f"{safe_name}:{line}: {key}: " + "; ".join(part for part in parts if part)


def _is_literal(annotation: object) -> bool:
    return get_origin(annotation) is Literal


def _models(annotation: object) -> list[type[BaseModel]]:
    """List the tables an annotation allows: none for a plain value, several for a discriminated union."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for arg in get_args(annotation) for m in _models(arg)]


def _choices(annotation: object) -> list[str]:
    """List the texts an annotation allows."""
    if _is_literal(annotation):
        return [c for c in get_args(annotation) if isinstance(c, str)]
    return [c for arg in get_args(annotation) for c in _choices(arg)]


def _tags(model: type[BaseModel]) -> dict[str, str]:
    """Give the keys whose only allowed text tells this kind of table from its siblings."""
    words = {k: get_args(f.annotation) for k, f in model.model_fields.items() if _is_literal(f.annotation)}
    return {key: texts[0] for key, texts in words.items() if len(texts) == 1}


@dataclass(frozen=True)
class _Place:
    """A position in the file (path, value) together with what the schema says about it."""

    tables: list[type[BaseModel]]  # the kinds of table possible here; empty at a plain value
    value: object
    path: KeyPath = ()
    owner: tuple[type[BaseModel], ...] = ()  # the kinds of table the last key belongs to
    siblings: Mapping[str, object] = field(default_factory=dict)  # the table of the file that holds the last key
    info: FieldInfo | None = None

    def enter(self, part: str | int, tagged: bool) -> _Place:
        """Follow one part of a pydantic location; parts that are not in the file change nothing else."""
        if isinstance(part, int):
            inside = isinstance(self.value, list) and part < len(self.value)
            return replace(self, path=(*self.path, part), value=self.value[part]) if inside else self  # type: ignore[index]
        if tagged and len(self.tables) > 1:  # pydantic names the chosen kind of table after the key
            return replace(self, tables=[m for m in self.tables if part in _tags(m).values()])
        given = self.value if isinstance(self.value, Mapping) else {}
        fitting = [m for m in self.tables if any(given.get(k) == tag for k, tag in _tags(m).items())]
        owner = [m for m in fitting or self.tables if part in m.model_fields]
        if not owner and part not in given:
            return self  # the name of a type inside a union of plain values
        info = owner[0].model_fields[part] if owner else None
        tables, kin = _models(info.annotation) if info else [], tuple(fitting or self.tables)
        return _Place(tables, given.get(part), (*self.path, part), kin, given, info)


@dataclass
class _Fault:
    """A fault at its place; ``kind`` decides the wording, ``meant`` is the key an unknown one stands for."""

    kind: Literal["missing", "unknown", "value"]
    place: _Place
    finding: Finding = Finding(())
    meant: str | None = None


def _faults(error: ErrorDetails, root: _Place) -> Iterator[_Fault]:
    """Turn one pydantic error, or the findings it carries, into faults."""
    place = root
    for part in error["loc"]:
        place = place.enter(part, tagged=True)
    context = error.get("ctx", {})
    if error["type"] == "case_findings":
        for finding in context["findings"]:
            spot = place
            for part in finding.loc:
                spot = spot.enter(part, tagged=False)
            yield _Fault("missing" if finding.missing else "value", spot, finding)
    elif error["type"].startswith("union_tag_"):
        spot = place.enter(context["discriminator"].strip("'"), tagged=False)
        known = {key for m in spot.owner for key in m.model_fields}
        misspelt = _similar(str(spot.path[-1]), set(spot.siblings) - known)
        if error["type"] == "union_tag_invalid":
            yield _Fault("value", spot)
        elif misspelt:
            yield _Fault("unknown", place.enter(misspelt, tagged=False), meant=str(spot.path[-1]))
        else:
            yield _Fault("missing", spot)
    else:
        kinds: dict[str, Literal["missing", "unknown"]] = {"missing": "missing", "extra_forbidden": "unknown"}
        yield _Fault(kinds.get(error["type"], "value"), place)


def _pair_renamed(faults: list[_Fault]) -> list[_Fault]:
    """Say what unknown keys were meant to be, and drop the "missing" faults that a misspelt key explains."""
    unknown = [f for f in faults if f.kind == "unknown"]
    missing = [f.place.path for f in faults if f.kind == "missing"]
    for fault in unknown:
        table, key = fault.place.path[:-1], str(fault.place.path[-1])
        inside = fault.place.value if isinstance(fault.place.value, Mapping) else {}
        here = [str(p[-1]) for p in missing if p[:-1] == table]
        below = [str(p[-2]) for p in missing if p[:-2] == table and p[-1] in inside]
        alone = sum(f.place.path[:-1] == table for f in unknown) == 1
        known = [k for m in fault.place.owner for k in m.model_fields]
        # The surest sign first: a missing key, then a table whose missing keys are inside, then likeness.
        fault.meant = (
            fault.meant
            or _similar(key, here)
            or (here[0] if alone and len(here) == 1 else None)
            or (below[0] if below else None)
            or _similar(key, [k for k in known if k not in fault.place.siblings])
            or _similar(key, known)
        )
        meant = (*table, fault.meant)
        missing = [p for p in missing if p != meant and not (p[:-1] == meant and p[-1] in inside)]
    return [f for f in faults if f.kind != "missing" or f.place.path in missing]


def _homes(model: type[BaseModel], key: str, table: KeyPath = ()) -> Iterator[str]:
    """Name the tables of the schema that know a key."""
    if key in model.model_fields:
        tags = "".join(f' with {k} = "{tag}"' for k, tag in _tags(model).items())
        yield f"[{_show_key(table)}]{tags}" if table else "the part above the first table"
    for name, info in model.model_fields.items():
        for inner in _models(info.annotation):
            yield from _homes(inner, key, (*table, name))


def _unknown_wording(fault: _Fault, root: type[BaseModel]) -> tuple[str, str, str]:
    place, meant = fault.place, fault.meant
    known = {k: f for m in place.owner for k, f in m.model_fields.items()}
    homes = list(_homes(root, str(place.path[-1])))[:3]
    hints = [f"it belongs in {' or '.join(homes)}"] if homes else []
    expected = f"one of {', '.join(known)}"
    if meant:
        expected = f"{meant} ({known[meant].description})"
        twin, clash = place.siblings.get(meant), meant in place.siblings
        if isinstance(twin, Mapping) and isinstance(place.value, Mapping):
            # Tables with no key in common are one table in two spellings: [structure], [strcture.section].
            clash = not twin.keys().isdisjoint(place.value)
        rename = f'"{meant}" is given already, drop one of the two' if clash else "rename it"
        hints.insert(0, f'did you mean "{meant}"? {rename}')
    found = f"unknown {'table' if isinstance(place.value, Mapping) else 'key'}"
    return found, f"expected {expected}", ", or ".join(hints) or "remove it"


def _missing_wording(fault: _Fault) -> tuple[str, str, str]:
    place = fault.place
    key, table, info = str(place.path[-1]), place.path[:-1], place.info
    where = f"to [{_show_key(table)}]" if table else "above the first table"
    if place.tables:
        found, remedy = "missing table", f"add a table [{_show_key(place.path)}]"
    else:
        found, remedy = "missing", f"add {key} = {_example(info)} {where}"
    return found, f"expected {info.description if info else key}", remedy


def _value_wording(fault: _Fault) -> tuple[str, str, str]:
    place, finding = fault.place, fault.finding
    entry = f" as entry {place.path[-1] + 1}" if isinstance(place.path[-1], int) else ""
    found = finding.found or f"found {_show(place.value)}{entry}"
    expected = finding.expected or (place.info.description if place.info else "") or ""
    return found, f"expected {expected}", finding.remedy or _value_remedy(place)


def _value_remedy(place: _Place) -> str:
    key = next(str(p) for p in reversed(place.path) if isinstance(p, str))
    value, example = place.value, _example(place.info)
    fields = [m.model_fields[key] for m in place.owner if key in m.model_fields]
    if place.tables:
        is_array = isinstance(value, list) and value and isinstance(value[0], dict)
        return f"write {'single brackets' if is_array else 'a table'}: [{_show_key(place.path)}]"
    if isinstance(value, str):
        choice = _similar(value, [c for f in fields for c in _choices(f.annotation)])
        if choice:
            return f'did you mean "{choice}"?'
        if re.fullmatch(r"[-+]?[\d.]+([eE][-+]?\d+)?", value) and example[0] not in '"[':
            return f"write the number without quotes: {key} = {value}"
    if isinstance(value, float) and example.isdigit() and value.is_integer() and 0 < value < 1e6:
        return f"write it without a decimal point: {key} = {int(value)}"
    return f"write for example {key} = {example}"


def _example(field: FieldInfo | None) -> str:
    """Write the example value of a field as TOML, which agrees with JSON for all that occurs here."""
    return json.dumps(field.examples[0], ensure_ascii=False) if field and field.examples else "…"


def fault_lines(
    error: ValidationError, model: type[BaseModel], data: Mapping[str, object], text: str, name: str
) -> list[str]:
    """Describe every fault that pydantic found in a case file.

    Parameters
    ----------
    error : pydantic.ValidationError
        What validating ``data`` against ``model`` raised.
    model : type of pydantic.BaseModel
        The schema; the ``description`` of its fields completes "expected …".
    data : mapping
        The parsed TOML text.
    text, name : str
        The TOML text itself and the file name to show.

    Returns
    -------
    list of str
        One line per fault, in the order of the file.
    """
    lines, root = key_lines(text), _Place([model], data)
    shown: dict[KeyPath, tuple[int, str]] = {}
    for fault in _pair_renamed([f for e in error.errors(include_url=False) for f in _faults(e, root)]):
        path = fault.place.path
        line = next((lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in lines), 1)
        if fault.kind == "unknown":
            words = _unknown_wording(fault, model)
        else:
            words = _missing_wording(fault) if fault.kind == "missing" else _value_wording(fault)
        # A union of plain values reports once for each of its types: the first says it all.
        shown.setdefault(path, (line, _fault_line(name, line, _show_key(path), *words)))
    return [text for _, text in sorted(shown.values(), key=lambda pair: pair[0])]


def parse_toml(text: str, name: str) -> dict[str, object]:
    """Parse TOML text; a syntax error or a text without any key is a `CaseError` of one line."""
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise CaseError(_fault_line(name, 1, "file", "nested too deeply", "expected a case file", _START)) from None
    except ValueError as error:  # also plain ones, such as an integer of more than 4300 digits
        raise CaseError(_syntax_fault(str(error), text, name)) from None
    if not data:
        raise CaseError(_fault_line(name, 1, "file", "holds no key", "expected a case file in TOML", _START))
    return data


def _syntax_fault(message: str, text: str, name: str) -> str:
    rows = text.splitlines() or [""]
    at = re.search(r"\(at line (\d+), column \d+\)", message)
    line = int(at[1]) if at else len(rows)
    digits = re.search(r"\d{4300}", text)
    if digits and "int_max_str_digits" in message:
        message, line = "an integer of more than 4300 digits", text.count("\n", 0, digits.start()) + 1
    key = re.match(r"\s*([\w.\"'-]+)\s*=", rows[line - 1] if line <= len(rows) else "")
    cause = re.sub(r"\s*\(at .*", "", message)
    plain = next((words for start, words in _SYNTAX.items() if cause.startswith(start)), None)
    found, remedy = plain or (f"no valid TOML ({cause})", "correct the line")
    return _fault_line(name, line, key[1] if key else "syntax", found, "expected TOML: key = value", remedy)


def read_text(path: str | os.PathLike[str]) -> str:
    """Read a case file as text; whatever prevents that is a `CaseError` of one line."""
    name, line = os.fspath(path), 1
    try:
        place = Path(path)
        if place.is_file():
            with place.open("rb") as stream:
                content = stream.read(_MOST_BYTES + 1)
            if len(content) <= _MOST_BYTES:
                return content.decode("utf-8-sig").replace("\r\n", "\n")
            found, remedy = "larger than 1 MB", "keep measurements in files of their own"
        elif place.is_dir():
            found, remedy = "this is a directory", "name the .toml file in it"
        elif place.exists():
            found, remedy = "this is no regular file", "save the case to a file first"
        else:
            near = _similar(place.name, (p.name for p in place.parent.glob("*.toml")))
            found, remedy = "no such file", f'did you mean "{near}"?' if near else "check the path"
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        found, remedy = "not UTF-8 text", "save the file as UTF-8"
    except (OSError, ValueError) as error:  # ValueError: a path with a null byte
        reason = error.strerror if isinstance(error, OSError) else str(error)
        found, remedy = f"cannot be read ({reason})", "check the path and its permissions"
    raise CaseError(_fault_line(name, line, "file", found, "expected a case file in TOML, UTF-8", remedy))
