"""A problem as a JSON description with arrays, and back, to the last bit."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from importlib import import_module
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jointbayes.errors import ModelError
from jointbayes.inference import Problem
from jointbayes.measurement.provenance import Provenance

__all__ = ["problem_from", "require_same_problem", "with_problem"]

_GROUP = "problem"
#: Rooms whose public classes may stand in a description.
_ROOMS = ("structure", "joint", "frf", "measurement", "inference")


def with_problem(tree: xr.DataTree, problem: Problem) -> tuple[xr.DataTree, dict[str, Any]]:
    """The groups of a posterior with one more for the arrays of its problem, and the problem's description.

    What is no part of this package, a distribution or a function of one's own, is only named in the description: it
    cannot be stored, and whoever loads the posterior passes the problem again.
    """
    description = _Description.of(problem)
    variables = {}
    for name, array in description.arrays.items():
        parts = {f"{name}_real": array.real, f"{name}_imag": array.imag} if np.iscomplexobj(array) else {name: array}
        for part, values in parts.items():
            variables[part] = (tuple(f"{name}_{axis}" for axis in range(array.ndim)), values)
    groups = {name: node.to_dataset() for name, node in tree.children.items()}
    return xr.DataTree.from_dict({**groups, _GROUP: xr.Dataset(variables)}), description.as_json()


def problem_from(tree: xr.DataTree, record: Mapping[str, Any], where: str) -> Problem:
    """The problem from what `with_problem` made of it.

    Raises
    ------
    ModelError
        If parts of it could not be stored, or this version knows them no more: which.
    """
    if record["own"]:
        own = ", ".join(f"{place} ({kind})" for place, kind in record["own"].items())
        raise ModelError(
            f"{where}: found a posterior with parts that no file can hold: {own}; expected the problem that was "
            "sampled; pass it as load_posterior(path, problem=...)"
        )
    group = tree[_GROUP].to_dataset()

    def array(name: str) -> NDArray[Any]:
        if name in group:
            return np.array(group[name].values)
        real = group[f"{name}_real"].values
        values = np.empty(real.shape, dtype=np.complex128)
        values.real, values.imag = real, group[f"{name}_imag"].values
        return values

    problem = _restored(record["description"], array, where)
    assert isinstance(problem, Problem)
    return problem


def require_same_problem(problem: Problem, record: Mapping[str, Any], where: str) -> None:
    """Refuse a problem that is not the one a posterior was drawn from, as far as its description tells.

    Raises
    ------
    ModelError
        If another part is described, or an array holds other numbers.
    """
    here = _Description.of(problem).as_json()
    if here["description"] == record["description"] and here["sha256"] == record["sha256"]:
        return
    stated, given = record["description"], here["description"]
    names = [name for name in stated if stated[name] != given.get(name)] or ["numbers in its arrays"]
    raise ModelError(
        f"{where}: found a posterior of another problem than the one passed: other {', '.join(names)}; expected the "
        "problem that was sampled; pass that one"
    )


@dataclass
class _Description:
    """A problem taken apart: plain values, its arrays, and what could only be named, by its place."""

    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    own: dict[str, str] = field(default_factory=dict)
    plain: Any = None

    @classmethod
    def of(cls, problem: Problem) -> "_Description":
        description = cls()
        description.plain = description._taken(problem, "problem")
        return description

    def as_json(self) -> dict[str, Any]:
        digest = hashlib.sha256()
        for array in self.arrays.values():
            digest.update(np.ascontiguousarray(array).tobytes())
        # as a file gives it back: lists for tuples
        plain = json.loads(json.dumps(self.plain))
        return {"description": plain, "own": self.own, "sha256": digest.hexdigest()}

    def _taken(self, value: Any, place: str) -> Any:  # noqa: ANN401 (any part of a problem)
        if value is None or isinstance(value, str | bool | int | float):
            return value
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, np.ndarray):
            name = f"array_{len(self.arrays)}"
            self.arrays[name] = value
            return {"array": name}
        if isinstance(value, list | tuple):
            return [self._taken(one, f"{place}[{i}]") for i, one in enumerate(value)]
        if isinstance(value, Mapping):
            return {"mapping": [[key, self._taken(one, f"{place}[{key}]")] for key, one in value.items()]}
        if isinstance(value, Provenance):
            return {"provenance": value.as_json()}
        if _of_scipy(value):
            given = [self._taken(part, place) for part in (value.args, value.kwds)]
            return {"scipy.stats": value.dist.name, "args": given[0], "kwds": given[1]}
        kind = type(value).__name__
        if is_dataclass(value) and _public_class(kind) is type(value):
            parts = {f.name: self._taken(getattr(value, f.name), f"{place}.{f.name}") for f in fields(value) if f.init}
            return {"kind": kind, **parts}
        name = getattr(value, "__qualname__", type(value).__qualname__)
        self.own[place] = name
        return {"own": name}


def _restored(plain: Any, array: Callable[[str], NDArray[Any]], where: str) -> Any:  # noqa: ANN401
    """A part of a problem from what `_Description` made of it."""
    if isinstance(plain, list):
        return tuple(_restored(one, array, where) for one in plain)
    if not isinstance(plain, dict):
        return plain
    if "kind" in plain:
        kind = _public_class(plain["kind"])
        if kind is None:
            raise ModelError(
                f"{where}: found a part of kind {plain['kind']!r}; expected one that this version of jointbayes has; "
                "read it with the version that wrote it"
            )
        return kind(**{name: _restored(part, array, where) for name, part in plain.items() if name != "kind"})
    if "array" in plain:
        return array(plain["array"])
    if "provenance" in plain:
        return Provenance.from_json(plain["provenance"])
    if "mapping" in plain:
        return {key: _restored(one, array, where) for key, one in plain["mapping"]}
    stats = import_module("scipy.stats")
    law = getattr(stats, str(plain["scipy.stats"]), None)
    if not isinstance(law, stats.rv_continuous):  # a file must not name what is called
        raise ModelError(
            f"{where}: found a prior {plain['scipy.stats']!r}; expected a continuous distribution of scipy.stats; "
            "repair the file or sample again"
        )
    args, kwds = (_restored(plain[key], array, where) for key in ("args", "kwds"))
    return law(*args, **kwds)


def _of_scipy(value: object) -> bool:
    """Whether it is a frozen distribution that scipy.stats itself makes, and can make again."""
    law = getattr(value, "dist", None)
    if law is None or not (hasattr(value, "args") and hasattr(value, "kwds")):
        return False
    return type(getattr(import_module("scipy.stats"), law.name, None)) is type(law)


def _public_class(name: str) -> type | None:
    """The class that a room hands on under this name; None where none does."""
    for room in _ROOMS:
        cls = getattr(import_module(f"jointbayes.{room}"), name, None)
        if isinstance(cls, type):
            return cls
    return None
