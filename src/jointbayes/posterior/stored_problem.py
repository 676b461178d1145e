"""A problem as a JSON description with arrays, and back, to the last bit; and by what a run of it is known."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from importlib import import_module
from pkgutil import iter_modules
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from typing_extensions import TypedDict

import jointbayes.inference.noise
from jointbayes.errors import ModelError
from jointbayes.inference import Problem
from jointbayes.joint.quantities import prefixed
from jointbayes.posterior.run_record import SampledCase, bodies_of, package_versions, sha256_of
from jointbayes.posterior.storage import array_dataset
from jointbayes.sampling import SamplerSettings
from jointbayes.stored_values import REMEDY, stored_value
from vibrecords import Data
from vibrecords.provenance import Provenance

#: Group of its arrays in a posterior file.
PROBLEM_GROUP = "problem"
#: Rooms whose public classes may stand in a description.
_ROOMS = ("jointbayes.structure", "jointbayes.joint", "jointbayes.frf", "vibrecords", "jointbayes.inference")
#: A setting that changes no draw, and tables of a case that are only shown or compared with the result.
_NO_MATTER = frozenset({"budget_s"})
_ONLY_SHOWN = frozenset({"title", "reference", "sampling", "compare", "plan", "virtual_test", "setups"})
_LONGEST = 60  # characters of a part as it is shown; of longer ones a digest
_VERSIONS = ("python", "numpy", "scipy", "numba", "emcee", "jointbayes")


class StoredProblem(TypedDict):
    """A problem without its arrays.

    Parameters
    ----------
    description
        Its parts, each as plain values.
    own
        What could only be named, by its place.
    sha256
        Digest of its arrays.
    """

    description: Mapping[str, Any]
    own: Mapping[str, str]
    sha256: str


def add_problem(tree: xr.DataTree, problem: Problem) -> tuple[xr.DataTree, StoredProblem]:
    """The groups of a posterior with one more for the arrays of its problem, and the problem's description.

    What is no part of this package, a distribution or a function of one's own, is only named in the description: it
    cannot be stored, and whoever loads the posterior passes the problem again.
    """
    description = _Description.describe(problem)
    groups = {name: node.to_dataset() for name, node in tree.children.items()}
    return xr.DataTree.from_dict({**groups, PROBLEM_GROUP: array_dataset(description.arrays)}), description.as_json()


def described(problem: Problem) -> dict[str, Any]:
    """Each part of a problem and its tests as plain values; of an array its digest, of what is one's own its name."""
    parts = {field.name: getattr(problem, field.name) for field in fields(problem) if field.name != "tests"}
    for test in problem.tests:
        parts |= {prefixed(test.name, field.name): getattr(test, field.name) for field in fields(test)}
    plain: dict[str, Any] = {}
    for name, part in parts.items():
        description = _Description()
        taken = description._taken(part, name)
        plain[name] = [taken, *(sha256_of([array]) for array in description.arrays.values())]
    return plain


def problem_from(array: Callable[[str], NDArray[Any]], record: StoredProblem, where: str) -> Problem:
    """The problem from what `add_problem` made of it.

    Parameters
    ----------
    array
        Gives an array of the group that `add_problem` added.
    record
        The description.
    where
        The file, for messages.

    Raises
    ------
    ModelError
        If parts of it could not be stored, this version knows them no more, or they make no problem: which.
    """
    if record["own"]:
        unstored = ", ".join(f"{place} ({kind})" for place, kind in record["own"].items())
        raise ModelError(
            f"{where}: found a posterior with parts that no file can hold: {unstored}; expected the problem that was "
            "sampled; pass it as load_posterior(path, problem=...)"
        )
    problem = _Restoring(array, where).part(record["description"], "problem")
    if not isinstance(problem, Problem):
        raise ModelError(f"{where}: found a {type(problem).__name__}; expected a problem; sample again")
    return problem


def require_same_problem(problem: Problem, record: StoredProblem, where: str) -> None:
    """Refuse a problem that is not the one a posterior was drawn from, as far as its description tells.

    Raises
    ------
    ModelError
        If another part is described, or an array holds other numbers.
    """
    here = _Description.describe(problem).as_json()
    if here["description"] == record["description"] and here["sha256"] == record["sha256"]:
        return
    stated, given = (_parts(plain["description"]) for plain in (record, here))
    names = [name for name in stated if stated[name] != given.get(name)] or ["numbers in its arrays"]
    raise ModelError(
        f"{where}: found a posterior of another problem than the one passed: other {', '.join(names)}; expected the "
        "problem that was sampled; pass that one"
    )


def _parts(description: Mapping[str, Any]) -> dict[str, Any]:
    """What a description says of a problem and of each of its tests, by names."""
    parts = {name: value for name, value in description.items() if name != "tests"}
    for test in description.get("tests", ()):
        parts |= {prefixed(str(test.get("name", "")), name): value for name, value in test.items()}
    return parts


@dataclass
class _Description:
    """A problem taken apart: plain values, its arrays, and what could only be named, by its place."""

    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    unstored: dict[str, str] = field(default_factory=dict)
    plain: Any = None

    @classmethod
    def describe(cls, problem: Problem) -> "_Description":
        description = cls()
        description.plain = description._taken(problem, "problem")
        return description

    def as_json(self) -> StoredProblem:
        # as a file gives it back: lists for tuples
        plain = json.loads(json.dumps(self.plain))
        return {"description": plain, "own": self.unstored, "sha256": sha256_of(self.arrays.values())}

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
            return [self._taken(entry, f"{place}[{i}]") for i, entry in enumerate(value)]
        if isinstance(value, Mapping):
            return {"mapping": [[key, self._taken(entry, f"{place}[{key}]")] for key, entry in value.items()]}
        if isinstance(value, Provenance):
            return {"provenance": value.as_json()}
        if _is_scipy_distribution(value):
            given = [self._taken(arguments, place) for arguments in (value.args, value.kwds)]
            return {"scipy.stats": value.dist.name, "args": given[0], "kwds": given[1]}
        kind = type(value).__name__
        if is_dataclass(value) and _public_class(kind) is type(value):
            parts = {f.name: self._taken(getattr(value, f.name), f"{place}.{f.name}") for f in fields(value) if f.init}
            return {"kind": kind, **parts}
        name = getattr(value, "__qualname__", type(value).__qualname__)
        self.unstored[place] = name
        return {"own": name}


@dataclass(frozen=True)
class _Restoring:
    """Makes the parts of a problem from what `_Description` made of them.

    Nothing that a file names is called but data classes of this package and continuous distributions of scipy.stats,
    these with numbers only.
    """

    array: Callable[[str], NDArray[Any]]
    where: str

    def part(self, plain: Any, place: str) -> Any:  # noqa: ANN401 (any part of a problem)
        if isinstance(plain, list):
            return tuple(self.part(entry, f"{place}[{i}]") for i, entry in enumerate(plain))
        if not isinstance(plain, dict):
            return plain
        if "kind" in plain:
            return self._instance(plain, place)
        if "array" in plain:
            return self.array(str(plain["array"]))
        if "provenance" in plain:
            return stored_value(Provenance, plain["provenance"], f"{self.where}: {place}")
        if "mapping" in plain:
            return self._mapping(plain["mapping"], place)
        if "scipy.stats" in plain:
            return self._distribution(plain, place)
        raise self._fault(place, f"a table of {', '.join(map(str, plain)) or 'nothing'}", "a part of a problem")

    def _instance(self, plain: Mapping[str, Any], place: str) -> Any:  # noqa: ANN401
        kind = _public_class(str(plain["kind"]))
        if kind is None:
            raise ModelError(
                f"{self.where}: found a part of kind {plain['kind']!r}; expected one that this version of jointbayes "
                "has; read it with the version that wrote it"
            )
        given = {name: self.part(entry, f"{place}.{name}") for name, entry in plain.items() if name != "kind"}
        hints = get_type_hints(kind)
        for name, value in given.items():
            if not _fits(value, hints.get(name, Any)):
                raise self._fault(f"{place}.{name}", f"{value!r:.60}", str(hints[name]))
        try:
            return kind(**given)
        except (TypeError, ValueError, ArithmeticError, AttributeError, LookupError) as error:
            raise self._fault(
                place, f"parts of which no {kind.__name__} can be made ({error})", "whole ones"
            ) from error

    def _mapping(self, pairs: Any, place: str) -> dict[Any, Any]:  # noqa: ANN401
        if not isinstance(pairs, list) or not all(isinstance(p, list) and len(p) == 2 for p in pairs):
            raise self._fault(place, "no pairs", "a list of names and values")
        return {str(key): self.part(entry, f"{place}.{key}") for key, entry in pairs}

    def _distribution(self, plain: Mapping[str, Any], place: str) -> Any:  # noqa: ANN401
        stats = import_module("scipy.stats")
        law = getattr(stats, str(plain["scipy.stats"]), None)
        if not isinstance(law, stats.rv_continuous):  # a file must not name what is called
            raise ModelError(
                f"{self.where}: found a prior {plain['scipy.stats']!r}; expected a continuous distribution of "
                "scipy.stats; repair the file or sample again"
            )
        args, kwds = self.part(plain.get("args", []), place), self.part(plain.get("kwds", {"mapping": []}), place)
        if not isinstance(args, tuple) or not isinstance(kwds, dict):
            raise self._fault(place, "no arguments", "numbers of a distribution")
        if not all(_fits(value, float) for value in (*args, *kwds.values())):
            raise self._fault(place, "other arguments than numbers", "numbers of a distribution")
        try:
            return law(*args, **kwds)
        except (TypeError, ValueError) as error:
            raise self._fault(place, f"a prior {law.name} that cannot be ({error})", "its own parameters") from error

    def _fault(self, place: str, found: str, expected: str) -> ModelError:
        return ModelError(f"{self.where}: {place}: found {found}; expected {expected}; {REMEDY}")


def _fits(value: Any, hint: Any) -> bool:  # noqa: ANN401
    """Whether a value is of a plain type; of other hints nothing is said."""
    kinds = get_args(hint)
    if get_origin(hint) is Literal:
        return any(type(value) is type(choice) and value == choice for choice in kinds)
    if hint is float and type(value) is int:
        return abs(value) < 10**300
    if hint in (float, int, bool, str):
        return type(value) is hint
    if get_origin(hint) in (Union, UnionType):
        return any(_fits(value, kind) for kind in kinds)
    if get_origin(hint) is tuple:
        inner = kinds[:1] * len(value) if kinds[-1:] == (...,) and isinstance(value, tuple) else kinds
        return isinstance(value, tuple) and len(value) == len(inner) and all(map(_fits, value, inner))
    if isinstance(hint, type) and (hint is type(None) or is_dataclass(hint) or issubclass(hint, Data)):
        return isinstance(value, hint)
    return True


def _is_scipy_distribution(value: object) -> bool:
    """Whether it is a frozen distribution that scipy.stats itself makes, and can make again."""
    law = getattr(value, "dist", None)
    if law is None or not (hasattr(value, "args") and hasattr(value, "kwds")):
        return False
    return type(getattr(import_module("scipy.stats"), law.name, None)) is type(law)


def _public_class(name: str) -> type | None:
    """The data class that a room hands on under this name, or a noise model in its module; None where none is."""
    models = (
        f"jointbayes.inference.noise.{module.name}" for module in iter_modules(jointbayes.inference.noise.__path__)
    )
    for room in (*_ROOMS, *models):
        cls = getattr(import_module(room), name, None)
        if isinstance(cls, type) and is_dataclass(cls) and cls.__module__.startswith(("jointbayes.", "vibrecords.")):
            return cls
    return None


def run_fingerprint(problem: Problem, case: SampledCase | None, seed: int, settings: SamplerSettings) -> dict[str, str]:
    """Parts of a run by name: seed, settings, versions, data, and the keys of the case or the parts of the problem.

    Parameters
    ----------
    problem
        What is sampled.
    case
        The case that states it, if one does.
    seed, settings
        Of the run.
    """
    parts = {"seed": str(seed), "data": "".join(sha256_of(test.data.arrays.values())[:16] for test in problem.tests)}
    for part in problem.parts:
        if (joint_frf := part.test.data.joint_frf) is not None:
            name = f"data at the joint in {part.test.name}" if part.test.name else "data at the joint"
            parts[name] = sha256_of([joint_frf.values])[:16]
    for name, body in bodies_of(problem).items():
        parts[f"measured body {name}"] = sha256_of(body.arrays)[:16]
    parts |= {
        f"sampling.{setting.name}": str(getattr(settings, setting.name))
        for setting in fields(settings)
        if setting.name not in _NO_MATTER
    }
    if case is not None and case.stated is problem and case.setups:
        for setup in case.setups:
            tables = json.loads(setup.spec.model_dump_json(exclude=set(_ONLY_SHOWN)))
            parts |= _flat(tables, f"setups.{setup.name}." if setup.name else "")
    else:
        parts |= {name: _shortened(plain) for name, plain in described(problem).items() if name != "name"}
    versions = package_versions()
    return parts | {f"version of {name}": versions[name] for name in _VERSIONS}


def _flat(table: Mapping[str, Any], above: str = "") -> dict[str, str]:
    """Values by dotted key."""
    flat: dict[str, str] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{above}{key}.")
        elif value is not None:
            flat[f"{above}{key}"] = _shortened(value)
    return flat


def _shortened(value: object) -> str:
    """A value as a message may show it; of a long one its digest."""
    text = json.dumps(value, ensure_ascii=False, sort_keys=True)
    return text if len(text) <= _LONGEST else hashlib.sha256(text.encode()).hexdigest()[:16]
