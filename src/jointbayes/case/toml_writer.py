"""TOML text from what a TOML text was parsed to: for cases that are made, not written."""

import json
import math
import re
from collections.abc import Mapping
from typing import Any

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
    lines = [f"{_key(key)} = {_value(value)}" for key, value in table.items() if key not in inside]
    if path and (lines or not inside):
        lines = ["", f"[{'.'.join(map(_key, path))}]", *lines]
    for key, value in inside.items():
        lines += _table(value, (*path, key))
    return lines


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _text(key)


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")  # JSON allows it as it is, TOML not


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{_key(key)} = {_value(one)}' for key, one in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return str(value)  # dates and times, which Python prints as TOML has them
