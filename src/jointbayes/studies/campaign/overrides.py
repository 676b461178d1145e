"""One row of a table over a base case: the text of the case that it makes, and what is wrong with it."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import pydantic

from jointbayes.case.case_text import CaseText, read_case_text
from jointbayes.case.errors import fault_lines
from jointbayes.case.schema.case import CaseSpec
from jointbayes.case.toml_text import key_parts
from jointbayes.errors import CaseError

_MARK = "row"  # stands in fault lines for the file, until it is known whether the row or the base is at fault


@dataclass(frozen=True, eq=False)
class BaseCase:
    """The case over which rows of a table are laid.

    Parameters
    ----------
    path
        Its file; data files are looked for beside it.
    source
        Its text, with that of what it builds on.
    """

    path: Path
    source: CaseText

    def overridden(self, cells: Mapping[str, str], where: str) -> tuple[dict[str, Any], CaseSpec]:
        """The tables of the case with other values for some keys, and the same checked.

        A value is what TOML makes of a cell, ``0.5``, ``true`` or ``["11:y"]``; what is no TOML, and what the key wants
        as text, is text: names of files need no quotes. An empty cell leaves the base's value.

        Parameters
        ----------
        cells
            Cell of the table by dotted key.
        where
            Table and row, for messages.

        Raises
        ------
        CaseError
            One line for each fault, with the row and the column, or the line of the base.
        """
        given = {key: cell.strip() for key, cell in cells.items() if cell.strip()}
        values = {key: _parsed(cell) for key, cell in given.items()}
        data, spec, faults = self._judged(values, where)
        if spec is None:
            # a serial number as a title, say, is no number
            texts = {key: given[key] if _at_fault(key, faults) else value for key, value in values.items()}
            again = self._judged(texts, where)
            if again[1] is not None:
                data, spec, faults = again
        if spec is None:
            raise CaseError("\n".join(self._placed(fault, given, where) for fault in faults))
        return data, spec

    def _judged(self, values: Mapping[str, Any], where: str) -> tuple[dict[str, Any], CaseSpec | None, list[str]]:
        data = dict(self.source.data)
        for key, value in values.items():
            _set(data, key, value, where)
        try:
            return data, CaseSpec.model_validate(data), []
        except pydantic.ValidationError as error:
            return data, None, fault_lines(error, CaseSpec, self._marked(data))

    @cached_property
    def _files(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((str(self.path), *(file for file, _ in self.source.places.values()))))

    def _marked(self, data: dict[str, Any]) -> CaseText:
        """Other data with the places of the base's, each file under a mark with its number."""
        number = {file: f"{_MARK}{i}" for i, file in enumerate(self._files)}
        places = {path: (number[file], line) for path, (file, line) in self.source.places.items()}
        return CaseText(f"{_MARK}0", "", data, places)

    def _placed(self, fault: str, given: Mapping[str, str], where: str) -> str:
        """A fault with the row in place of the base's line, where the row gives that key."""
        match = re.fullmatch(rf"{_MARK}(\d+):(\d+): ([^:]*): (.*)", fault, re.DOTALL)
        if match is None:  # a key in quotes that holds a colon
            return re.sub(rf"^{_MARK}\d+", lambda _: where, fault)
        number, line, key, words = match.groups()
        if any(key == column or key.startswith(f"{column}.") for column in given):
            return f"{where}: {key}: {words}"
        return f"{where}: {key}, {self._files[int(number)]}:{line}: {words}"


def _at_fault(key: str, faults: list[str]) -> bool:
    return any(f": {key}: " in fault for fault in faults)


def _parsed(cell: str) -> Any:  # noqa: ANN401 (whatever TOML knows)
    try:
        parsed = tomllib.loads(f"value = {cell}")
    except (ValueError, RecursionError):
        return cell
    return parsed["value"] if parsed.keys() == {"value"} else cell


def _set(data: dict[str, Any], key: str, value: object, where: str) -> None:
    parts = key_parts(key)
    if not parts:
        raise CaseError(
            f"{where}: column {key!r}: found no key of a case file; expected one such as structure.length_mm, or key, "
            "serial, date or case; correct the first line of the table"
        )
    *above, last = parts
    table = data
    for part in above:
        below = table.get(part, {})
        table[part] = table = dict(below) if isinstance(below, dict) else below  # the base keeps its own
        if not isinstance(table, dict):
            raise CaseError(
                f"{where}: {key}: found that {part} is no table in the base case; expected one that holds {last}; "
                "correct the column's name"
            )
    table[last] = value


@lru_cache(maxsize=1000)
def read_base(path: Path, allow_outside: bool = False) -> BaseCase:
    """Read a base case; each file once.

    What it builds on must lie in its directory or below unless `allow_outside`.

    Raises
    ------
    CaseError
        If it cannot be read or is no TOML; whether it is a case is seen with the row.
    """
    return BaseCase(path, read_case_text(path, allow_outside))
