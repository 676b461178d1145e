"""All warnings by their key: what is found, with its numbers in braces, and what to do. The table is kinds.toml."""

import tomllib
from pathlib import Path

from vibrecords.provenance import MeasurementWarning

KINDS: dict[str, dict[str, str]] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def warn(key: str, **numbers: object) -> MeasurementWarning:
    """Return the warning of a key with its numbers in words."""
    kind = KINDS[key]
    return MeasurementWarning(key, kind["found"].format(**numbers), kind["remedy"].format(**numbers))
