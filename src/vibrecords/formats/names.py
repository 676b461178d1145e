"""The names and words that readers know, whose table is names.toml, and how numbers are written."""

import re
import tomllib
from pathlib import Path
from typing import Any

NAMES: dict[str, Any] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def words_of(table: str) -> dict[str, frozenset[str]]:
    """Words of each key of a table."""
    return {key: frozenset(text.split()) for key, text in NAMES[table].items()}


def factors_of(table: dict[str, float]) -> dict[str, float]:
    """Factor of each name, of which several may stand in one key."""
    return {name: factor for names, factor in table.items() for name in names.split()}


NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)


def float_of(text: str) -> float | None:
    """Number of a text with a decimal point; None where it is none."""
    return float(text) if NUMBER.fullmatch(text) and "," not in text else None
