"""The targets: each module here has a list `TARGETS` of instances of `tests.fuzz.target.Target`."""

import importlib
import pkgutil

__all__ = ["places"]


def places() -> dict[str, str]:
    """Where each target is, by its name, in the order of the names."""
    found = {}
    for module in pkgutil.iter_modules(__path__):
        home = f"{__name__}.{module.name}"
        for number, target in enumerate(importlib.import_module(home).TARGETS):
            found[target.name] = f"{home}:TARGETS:{number}"
    return dict(sorted(found.items()))
