"""Which keys of a case name files: all that reads, moves or watches the files of a case asks here."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

_ANY = "*"  # each key of a table
DATA_FILE = ("data", "file")
_KEYS: tuple[tuple[str, ...], ...] = (
    DATA_FILE,
    ("bodies", _ANY, "file"),
    ("structure", "stiffness"),  # and so on: numbers, or the name of a file
    ("structure", "mass"),
    ("structure", "damping", "damping_matrix"),
)
#: Tables that state the same keys again, as tables of the file.
_WITHIN: tuple[tuple[str, ...], ...] = ((), ("setups", _ANY), ("plan", "setups", _ANY))


def named_files(case: object) -> dict[tuple[str, ...], tuple[str, ...]]:
    """Names of files that a case states, by key.

    Parameters
    ----------
    case
        The checked case; of several set-ups that of one.
    """
    found = ((path, _names(value)) for key in _KEYS for path, value in _values(case, key))
    return {path: names for path, names in found if names}


def _values(table: object, key: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], object]]:
    if not key:
        yield (), table
        return
    first, *rest = key
    inner = table if first == _ANY else {first: getattr(table, first, None)}
    for name, value in inner.items() if isinstance(inner, Mapping) else ():
        yield from (((name, *path), one) for path, one in _values(value, tuple(rest)))


def _names(value: object) -> tuple[str, ...]:
    if isinstance(value, str):
        return (value,)
    return tuple(one for one in value if isinstance(one, str)) if isinstance(value, tuple) else ()


def with_files(data: Mapping[str, Any], change: Callable[[str], str]) -> dict[str, Any]:
    """Tables of a case file as they are read, with every name of a file changed.

    Parameters
    ----------
    data
        What the text is parsed to; not necessarily a case.
    change
        Gives the new name of a file.
    """
    whole: Any = dict(data)
    for within in _WITHIN:
        for key in _KEYS:
            whole = _changed(whole, (*within, *key), change)
    return dict(whole)


def _changed(value: Any, key: tuple[str, ...], change: Callable[[str], str]) -> Any:  # noqa: ANN401 (whatever TOML knows)
    if not key:
        if isinstance(value, list):
            return [change(one) if isinstance(one, str) else one for one in value]
        return change(value) if isinstance(value, str) else value
    if not isinstance(value, Mapping):
        return value
    first, *rest = key
    names = value if first == _ANY else {first} & value.keys()
    return {**value, **{name: _changed(value[name], tuple(rest), change) for name in names}}
