"""The texts of the set-ups of a case: of each its own table merged over the rest of the file.

``[setups.long.structure]`` states what is different in the test that is called long, as a case states what is
different from the one that it extends: tables are merged key by key, other values replaced, ``remove`` takes keys out.
What a set-up says of an uncertain quantity, or of the noise, is its own; what the file says holds for all, unless it
says `own`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from jointbayes.case.case_text import CaseText, merged
from jointbayes.case.toml_text import KeyPath

SETUPS = "setups"
_OF_THE_WHOLE = ("level",)  # keys of a set-up that are none of its case
_OWN = "own"


def setup_texts(source: CaseText) -> dict[str, CaseText]:
    """The text of each set-up by its name; a case of one test is that of a set-up without a name.

    Raises
    ------
    CaseError
        If a set-up removes what the rest of the file does not have.
    """
    stated = source.data.get(SETUPS)
    tables = stated if isinstance(stated, Mapping) else {}
    found = {
        name: _of_setup(source, table, (SETUPS, name)) for name, table in tables.items() if isinstance(table, Mapping)
    }
    return found or {"": source}


def planned_texts(source: CaseText) -> dict[str, CaseText]:
    """The text of each set-up that a plan proposes, ``[plan.setups.NAME]``, by its name.

    Raises
    ------
    CaseError
        If a set-up removes what the rest of the file does not have.
    """
    plan = source.data.get("plan")
    stated = plan.get(SETUPS) if isinstance(plan, Mapping) else None
    tables = stated if isinstance(stated, Mapping) else {}
    found = {
        name: _of_setup(source, table, ("plan", SETUPS, name))
        for name, table in tables.items()
        if isinstance(table, Mapping)
    }
    return {name: replace(one, data=_as_proposed(one.data, name)) for name, one in found.items()}


def _as_proposed(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The tables of a proposed set-up, which is one beside those of the case."""
    return {key: value for key, value in data.items() if key not in ("plan", "level", "reference")} | {
        SETUPS: {name: {}}
    }


def _of_setup(source: CaseText, stated: Mapping[str, Any], at: KeyPath) -> CaseText:
    table = {key: value for key, value in stated.items() if key not in _OF_THE_WHOLE}
    depth = len(at)
    of_case = ((path[depth:], place) for path, place in source.places.items() if path[:depth] == at)
    inside = {path: place for path, place in of_case if path and path[0] not in _OF_THE_WHOLE}
    over = CaseText(source.name, "", _with_own(table), inside, str(at[-1]), at, frozenset(inside))
    data, places = merged(source, over)
    places[()] = source.place(at)
    return replace(over, data=data, places=places)


def _with_own(table: Mapping[str, Any]) -> dict[str, Any]:
    """The table of a set-up, whose uncertain quantities and noise are its own."""
    own = dict(table)
    if isinstance(own.get("noise"), Mapping):
        own["noise"] = {_OWN: True, **own["noise"]}
    if isinstance(own.get("uncertain"), Mapping):
        own["uncertain"] = {
            key: {body: _each_own(one) for body, one in value.items()}
            if key == "bodies" and isinstance(value, Mapping)
            else _own(value)
            for key, value in own["uncertain"].items()
        }
    return own


def _each_own(value: object) -> object:
    return {key: _own(one) for key, one in value.items()} if isinstance(value, Mapping) else value


def _own(value: object) -> object:
    return {_OWN: True, **value} if isinstance(value, Mapping) else value


def without_inherited(text: CaseText, path: KeyPath) -> tuple[KeyPath, CaseText] | None:
    """The text of a set-up without a table that stands for all, and its key; None where it is not such a table.

    An uncertain quantity that a set-up does not have, a plan, a virtual test: those of the others are none of it.
    """
    depths = {"uncertain": 4 if path[1:2] == ("bodies",) else 2, "plan": 1, "virtual_test": 1}
    depth = depths.get(str(path[0])) if path else None
    key = path[:depth]
    if not text.setup or depth is None or len(key) < depth or any(one[:depth] == key for one in text.own):
        return None
    return key, replace(text, data=_without(text.data, key))


def _without(table: Mapping[str, Any], key: KeyPath) -> dict[str, Any]:
    first, *rest = key
    if rest:
        return {**table, str(first): _without(table[str(first)], tuple(rest))}
    return {name: value for name, value in table.items() if name != first}
