"""Vibration measurements: files to records, FRFs and modes with units, errors and warnings.

Names are loaded at first use, so that importing the package costs next to nothing. The one table of them is the stub
next to this file, which type checkers read as well.
"""

from importlib import import_module
from typing import Any

from vibrecords.public_names import homes_in_stub

_HOME_OF = homes_in_stub(__name__)

__all__ = [*_HOME_OF]


def __getattr__(name: str) -> Any:  # noqa: ANN401 (any public name)
    if name not in _HOME_OF:
        raise AttributeError(f"module 'vibrecords' has no attribute {name!r}")
    return getattr(import_module(_HOME_OF[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
