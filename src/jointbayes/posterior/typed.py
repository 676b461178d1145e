"""Values of a type from what JSON has of them: what a file says is checked before anything is made of it."""

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NoReturn, Union, get_args, get_origin, get_type_hints, is_typeddict

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError

#: What to do about any file that holds no whole posterior.
REMEDY = "sample again, or take another copy of the file"
_WORDS = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}
_SHOWN = 60  # characters of a wrong value in a message
_NOTHING = object()


def typed(hint: Any, plain: Any, place: str) -> Any:  # noqa: ANN401 (any type)
    """A value of a type.

    Parameters
    ----------
    hint
        The type: a number, a text, a tuple, a mapping, an array of finite numbers, a data class or a typed dictionary,
        of these. ``Annotated[int, (0, 9)]`` are the whole numbers from 0 to 9.
    plain
        What JSON has of it. Fields that a later version of a data class adds do not matter, and a field that has a
        default may be missing.
    place
        Where it stands, for the message.

    Raises
    ------
    MeasurementError
        If it is something else: where, and what.
    """
    origin, kinds = get_origin(hint), get_args(hint)
    if origin is Annotated:
        (low, high), value = kinds[1], typed(kinds[0], plain, place)
        return value if low <= value <= high else _refuse(plain, f"{low:g} to {high:g}", place)
    if origin in (Union, UnionType):
        return None if plain is None else typed(next(kind for kind in kinds if kind is not NoneType), plain, place)
    if origin is np.ndarray:
        return _finite_numbers(plain, place)
    if origin is tuple and isinstance(plain, list):
        inner = kinds[:1] * len(plain) if kinds[-1] is Ellipsis else kinds
        if len(inner) == len(plain):
            pairs = zip(inner, plain, strict=True)
            return tuple(typed(kind, entry, f"{place}.{i}") for i, (kind, entry) in enumerate(pairs))
    if origin is Mapping and isinstance(plain, dict):
        return {key: typed(kinds[1], entry, f"{place}.{key}") for key, entry in plain.items()}
    if (is_dataclass(hint) or is_typeddict(hint)) and isinstance(plain, dict):
        return _with_fields(hint, plain, place)
    if hint is Any or (plain is not _NOTHING and is_plain(plain, hint)):
        return plain
    return _refuse(plain, _WORDS.get(hint, f"one of {', '.join(map(str, kinds))}" if kinds else "a table"), place)


def is_plain(value: Any, hint: Any) -> bool:  # noqa: ANN401
    """Whether a value is a number, text or choice of this type; a whole number is also a number."""
    if get_origin(hint) is Literal:
        return any(type(value) is type(choice) and value == choice for choice in get_args(hint))
    if hint is float and isinstance(value, int):
        return not isinstance(value, bool) and abs(value) < 10**300
    return hint in _WORDS and type(value) is hint


def _with_fields(hint: Any, plain: Mapping[str, Any], place: str) -> Any:  # noqa: ANN401
    hints = get_type_hints(hint, include_extras=True)
    if is_typeddict(hint):  # what else is there stays
        required = hint.__required_keys__
        return {**plain, **{n: typed(hints[n], plain.get(n, _NOTHING), f"{place}.{n}") for n in required}}
    optional = {f.name for f in fields(hint) if not (f.default is MISSING and f.default_factory is MISSING)}
    given = {
        f.name: typed(hints[f.name], plain.get(f.name, _NOTHING), f"{place}.{f.name}")
        for f in fields(hint)
        if f.init and (f.name in plain or f.name not in optional)
    }
    return hint(**given)


def _finite_numbers(plain: Any, place: str) -> Array:  # noqa: ANN401
    if not isinstance(plain, list):
        _refuse(plain, "an array of numbers", place)
    rows = dict(enumerate(plain)) if plain and isinstance(plain[0], list) else {"": plain}
    for i, row in rows.items():
        for j, value in enumerate(row if isinstance(row, list) else [row]):
            if not (is_plain(value, float) and math.isfinite(value)):
                _refuse(value, "a finite number", f"{place}.{i}{'.' if i != '' else ''}{j}")
    try:
        return np.array(plain, dtype=float)
    except ValueError:
        return _refuse(plain, "rows of one length", place)


def _refuse(plain: Any, expected: str, place: str) -> NoReturn:  # noqa: ANN401
    shown = "nothing" if plain is _NOTHING else repr(plain)
    shown = shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]}…"
    raise MeasurementError(f"{place}: found {shown}; expected {expected}; {REMEDY}")
