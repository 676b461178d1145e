"""The text of a case: its own, or the one that a file and the base files it builds on make together.

``extends = "base.toml"`` takes all keys of another file, of which the case then states only what differs. Tables are
merged key by key. Every other value, a list too, replaces the base's, and so does a table of another kind. Each key
keeps the file and line that it stands in.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from jointbayes.case.spec.fields import Finding, rename_files, show_key
from jointbayes.case.toml_text import KeyPath, fault_line, key_lines, parse_toml, read_text, toml_text
from jointbayes.errors import CaseError, similar
from vibrecords.errors import printable

_MOST_FILES = 10  # that build on each other
_EXTENDS, _TESTS = "extends", "tests"
#: Keys by which a table says of which kind it is, and what a table is that does not say it.
_KINDS = ("kind", "law", "shape", "distribution", "source")
_UNSTATED = {"structure": {"kind": "beam"}, "joint": {"kind": "coupled", "parametrisation": "log"}}
_UNSTATED["joints"] = _UNSTATED["joint"]

Place = tuple[str, int]


@dataclass(frozen=True, slots=True)
class InputWarning:
    """A value that no rule forbids and that is probably a slip.

    Parameters
    ----------
    file, line
        Where it stands: the case file, or one that it builds on.
    key
        Its key, with its tables.
    code
        Kind of slip, by which programs know it.
    found, advice
        What was found; what is expected, and the likely slip.
    """

    file: str
    line: int
    key: str
    code: str
    found: str
    advice: str

    @property
    def text(self) -> str:
        """What was found, what is expected, and the likely slip."""
        return f"{self.found}; {self.advice}"

    def __str__(self) -> str:
        return f"{self.key}: {self.text}"


@dataclass(frozen=True, slots=True, eq=False)
class CaseText:
    """Text of a case, with the file and line of each of its keys.

    Parameters
    ----------
    name
        The file that is the case, as messages show it.
    text
        TOML text that needs no other file: the file's own, or the text of all its files together.
    data
        What it is parsed to.
    places
        File and line of each key, table and list entry.
    bases, test, at, own
        Files that it builds on; of a test its name, the key of its own table, and the keys that stand in that.
    """

    name: str
    text: str
    data: Mapping[str, Any]
    places: Mapping[KeyPath, Place]
    test: str = ""
    at: KeyPath = ()
    own: frozenset[KeyPath] = frozenset()
    bases: tuple[Path, ...] = ()

    @property
    def files(self) -> list[Path]:
        """Itself, the files that it builds on, and the measurement files that it names."""
        home, found = Path(self.name).parent, [Path(self.name), *self.bases]

        def note(name: str) -> str:
            found.append(home / name)
            return name

        rename_files(self.data, note)
        return found

    def written(self, path: KeyPath) -> KeyPath:
        """A key as the file has it, or may have it: in the table of the test where that says anything of it."""
        written = next((path[:n] for n in range(len(path), 0, -1) if path[:n] in self.places), ())
        return path if not self.test or (written and written not in self.own) else (*self.at, *path)

    def place(self, path: KeyPath) -> Place:
        """File and line of a key, or of the innermost table around it that is written."""
        places = (self.places[path[:n]] for n in range(len(path), -1, -1) if path[:n] in self.places)
        return next(places, (self.name, 1))

    def inherits(self, path: KeyPath) -> bool:
        """Whether a key stands in the file that this one builds on, or of a test in the rest of the file."""
        return path not in self.own if self.test else self.place(path)[0] != self.name

    def order(self, path: KeyPath) -> tuple[bool, str, int]:
        """What sorts keys as they are read: those of the case's own file first."""
        file, line = self.place(path)
        return file != self.name, file, line

    def fault(self, path: KeyPath, found: str, expected: str = "", remedy: str = "") -> str:
        """One line of a `CaseError` on a key: file, line, key as it is written, then found; expected; what to do."""
        return fault_line(*self.place(path), show_key(self.written(path)), _sentence(found, expected, remedy))

    def warnings(self, code: str, findings: Iterable[Finding]) -> tuple[InputWarning, ...]:
        """Findings of one kind as warnings, each at the file and line of its key."""
        placed = ((self.place(f.loc), ".".join(map(str, self.written(f.loc))), f) for f in findings)
        advised = ((*at, key, code, f.found, _sentence("", f.expected, f.remedy)) for at, key, f in placed)
        return tuple(InputWarning(*each) for each in advised)


def _sentence(found: str, expected: str, remedy: str) -> str:
    return "; ".join(filter(None, (found, expected and f"expected {expected}", remedy)))


def read_case_text(path: str | os.PathLike[str], allow_outside: bool = False) -> CaseText:
    """Read a case file and the files it builds on.

    Parameters
    ----------
    path
        The file.
    allow_outside
        Whether files it builds on may lie outside its directory.

    Raises
    ------
    CaseError
        If a file cannot be read or is no TOML, lies outside the directory of the case and may not, or builds on itself.
    """
    file = Path(path)
    return case_text(read_text(file), os.fspath(path), file, allow_outside)


def case_text(text: str, name: str, file: Path | None = None, allow_outside: bool = False) -> CaseText:
    """The text of a case with the texts of the files it builds on.

    Parameters
    ----------
    text, name
        The text, and the file that messages show.
    file
        The file that it is, or one of that directory; None of a text that stands alone and must name no other.
    allow_outside
        Whether files it builds on may lie outside the directory of `file`.

    Raises
    ------
    CaseError
        As `read_case_text`; or if the text names a file and stands alone.
    """
    source = _parsed(text, name)
    if _EXTENDS not in source.data:
        return source
    if file is None:
        mistake = "found a text that is no file and builds on one"
        raise CaseError(source.fault((_EXTENDS,), mistake, "a text that is whole", "load it as a file"))
    # 1. Read the files that it builds on, the last of which builds on none.
    home, here, current = file.parent, file, source
    read, chain = [_real(file)], [source]
    while (base := current.data.get(_EXTENDS)) is not None:
        if not isinstance(base, str) or not base:
            expected, remedy = "the name of a case file, a text", f'write for example {_EXTENDS} = "base.toml"'
            raise CaseError(current.fault((_EXTENDS,), f"found {type(base).__name__}", expected, remedy))
        here = here.parent / base
        if not allow_outside and not _inside(here, home):
            raise CaseError(current.fault((_EXTENDS,), *_words_of_outside(base, "case file")))
        name = os.path.join(os.path.dirname(current.name), base)  # as the user would write it
        if _real(here) in read:
            circle = " → ".join(printable(visited.name) for visited in (*read[read.index(_real(here)) :], here))
            words = f"found a circle, {circle}", "files that end at one that extends none", "remove one extends"
            raise CaseError(current.fault((_EXTENDS,), *words))
        if len(chain) == _MOST_FILES:
            words = f"found more than {_MOST_FILES} files that build on each other", "fewer", "merge some"
            raise CaseError(current.fault((_EXTENDS,), *words))
        read.append(_real(here))
        if not here.exists():
            near = similar(here.name, (p.name for p in here.parent.glob("*.toml") if p != file))
            remedy = f'did you mean "{near}"?' if near else "check the name; it is relative to this file"
            words = f'found "{printable(base)}", which is no file', "a case file to build on", remedy
            raise CaseError(current.fault((_EXTENDS,), *words))
        current = _parsed(read_text(here), name)
        if here.parent != home:
            current = replace(current, data=rename_files(current.data, partial(_moved, here.parent, home)))
        chain.append(current)
    # 2. Merge them, the last one first.
    *chain, whole = chain
    bases = tuple(Path(text.name) for text in (*chain[1:], whole))
    for over in reversed(chain):
        whole = _merged(whole, over)
    names = ", ".join(dict.fromkeys(printable(Path(file).name) for file, _ in whole.places.values()))
    return replace(whole, text=f"# Merged from {names}\n{toml_text(whole.data)}", bases=bases)


def _parsed(text: str, name: str) -> CaseText:
    """A text by itself."""
    return CaseText(name, text, parse_toml(text, name), {path: (name, line) for path, line in key_lines(text).items()})


def _real(file: Path) -> Path:
    try:
        return file.resolve()
    except (OSError, RuntimeError, ValueError):  # links in a circle, a null byte: found again on reading
        return file


def _inside(file: Path, home: Path) -> bool:
    """Whether a file lies in a directory or below; where it leads by ``..`` or by links is what counts."""
    try:
        return file.resolve().is_relative_to(home.resolve())
    except (OSError, RuntimeError, ValueError):  # links in a circle, a null byte: found again on reading
        return True


def _words_of_outside(name: str, what: str) -> tuple[str, str, str]:
    return (
        f'found "{printable(name)}", which leads out of the directory of the case file',
        f"a {what} in it or below",
        "move the file there, or allow it: --allow-outside, in Python allow_outside=True",
    )


def find_outside(directory: Path, names: Sequence[str]) -> tuple[int, tuple[str, str, str]] | None:
    """The first of some measurement files outside the directory of their case, whose author may be somebody else.

    Its number among the names, and what was found, what is expected and what to do; None where all lie inside.
    """
    number = next((number for number, name in enumerate(names) if not _inside(directory / name, directory)), None)
    return None if number is None else (number, _words_of_outside(names[number], "measurement file"))


def _moved(here: Path, home: Path, name: str) -> str:
    """A name of a file that is relative to one directory, relative to another."""
    return Path(os.path.relpath(here / name, home)).as_posix()


def _merged(base: CaseText, over: CaseText) -> CaseText:
    """What builds on a base, with data and places of that base where it states nothing else."""
    data, places = dict(base.data), dict(base.places)
    stated = {key: value for key, value in over.data.items() if key != _EXTENDS}
    joint, old = stated.get("joint"), data.get("joint")
    measured = stated.get("bodies")
    gone: list[KeyPath] = [("structure", "bodies", body) for body in measured] if isinstance(measured, Mapping) else []
    if _differs(joint, old, ("joint",), ("kind", "parametrisation")):  # its quantities have other names
        gone.append(("prior",))
    for path in gone:
        data = without_key(data, path)
        places = {place: line for place, line in places.items() if place[: len(path)] != path}
    _lay_over(data, stated, (), places)
    return replace(over, data=data, places=places | {k: v for k, v in over.places.items() if k[:1] != (_EXTENDS,)})


def without_key(data: Mapping[str, Any], path: KeyPath) -> dict[str, Any]:
    """The same tables without a key, where they have it."""
    first, *below = path
    if not below:
        return {key: value for key, value in data.items() if key != first}
    inside = data.get(str(first))
    return {**data, str(first): without_key(inside, tuple(below))} if isinstance(inside, Mapping) else dict(data)


def _differs(table: object, old: object, path: KeyPath, keys: Iterable[str]) -> bool:
    """Whether both are tables, and the first states one of these keys with another value than the second has."""
    if not isinstance(table, Mapping) or not isinstance(old, Mapping):
        return False
    old = {**_UNSTATED.get(str(path[0]), {}), **old}
    return any(key in table and table[key] != old.get(key, table[key]) for key in keys)


def _lay_over(data: dict[str, Any], over: Mapping[str, Any], path: KeyPath, places: dict[KeyPath, Place]) -> None:
    """Put values in the place of a base's, table by table; where those stood is forgotten."""
    for key, value in over.items():
        here, old = (*path, key), data.get(key)
        if isinstance(value, Mapping) and isinstance(old, Mapping) and not _differs(value, old, here, _KINDS):
            data[key] = dict(old)
            _lay_over(data[key], value, here, places)
            continue
        for covered in [covered for covered in places if covered[: len(here)] == here]:
            del places[covered]
        data[key] = value


def texts_of_tests(source: CaseText) -> dict[str, CaseText]:
    """The text of each test by its name; a case of one test has one without a name.

    Of each test its own table, ``[tests.NAME]``, is merged over the rest of the file, as a case over the one that it
    extends. What a test says of an uncertain quantity, or of the noise, is its own; what the file says holds for all,
    unless it says `own`.
    """
    stated = source.data.get(_TESTS)
    tables = stated.items() if isinstance(stated, Mapping) else ()
    texts = {name: _text_of_test(source, table, (_TESTS, name)) for name, table in tables if isinstance(table, Mapping)}
    return texts or {"": source}


def _text_of_test(source: CaseText, stated: Mapping[str, Any], at: KeyPath) -> CaseText:
    table, depth = dict(stated), len(at)
    below = {path[depth:]: place for path, place in source.places.items() if path[:depth] == at}
    inside = {path: place for path, place in below.items() if path}
    if "noise" in table:
        table["noise"] = _own(table["noise"])
    if isinstance(uncertain := table.get("uncertain"), Mapping):
        bodies = uncertain.get("bodies")
        each = {name: _each_own(body) for name, body in bodies.items()} if isinstance(bodies, Mapping) else bodies
        table["uncertain"] = {**_each_own(uncertain), **({"bodies": each} if "bodies" in uncertain else {})}
    test = _merged(source, CaseText(source.name, "", table, inside, str(at[-1]), at, frozenset(inside)))
    return replace(test, places={**test.places, (): source.place(at)})


def _own(table: object) -> object:
    return {"own": True, **table} if isinstance(table, Mapping) else table


def _each_own(tables: object) -> Any:  # noqa: ANN401 (anything TOML knows)
    return {key: _own(table) for key, table in tables.items()} if isinstance(tables, Mapping) else tables


def drop_inherited(text: CaseText, path: KeyPath) -> tuple[KeyPath, CaseText] | None:
    """The text of a test without a table that stands for all, and its key; None where it is not such a table.

    An uncertain quantity that a test does not have: those of the others are none of it.
    """
    depths = {"uncertain": 4 if path[1:2] == ("bodies",) else 2}
    depth = depths.get(str(path[0])) if path else None
    key = tuple(map(str, path[:depth]))
    if not text.test or depth is None or len(key) < depth or any(place[:depth] == key for place in text.own):
        return None
    return key, replace(text, data=without_key(text.data, key))
