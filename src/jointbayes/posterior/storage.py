"""A posterior as xarray groups, as ArviZ wants them, and as a netCDF file.

A problem is kept as a JSON description with arrays, and comes back to the last bit. A file may be damaged, of another
version, or made by somebody else on purpose: of its record each number is checked here by its range; what must agree
with the problem, by `jointbayes.posterior.stored_file`. ArviZ's 0.x (InferenceData) and
1.x (DataTree) differ; that is known here alone.
"""

import json
import os
import re
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from enum import Enum
from importlib import import_module
from importlib.metadata import version
from numbers import Real
from pkgutil import iter_modules
from tempfile import TemporaryDirectory
from types import ModuleType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from typing_extensions import TypedDict

import jointbayes.inference.noise
from jointbayes.errors import MeasurementError, ModelError, require, require_count
from jointbayes.identification import MapEstimate
from jointbayes.inference import JointPrior, Problem
from jointbayes.joint import Blocks
from jointbayes.joint.quantities import prefixed
from jointbayes.posterior.prediction import replicate
from jointbayes.posterior.run_record import sha256_of
from jointbayes.posterior.sampled import KEPT, BestDraw, RunRecord
from jointbayes.sampling import Draws
from jointbayes.stored_values import REMEDY, stored_value
from vibrecords import Data
from vibrecords.arrays import Array
from vibrecords.files import write_whole_file
from vibrecords.provenance import Provenance

#: What the values of an array stand for along each of its axes, by its name.
Axes = Mapping[str, Mapping[str, NDArray[Any]]]
_SEED = 9  # of the replicated data: the same at every look
_FEWEST = 20  # draws of a chain that stay, however many values the data have
_BY_DRAW = ("chain", "draw")
_CHAINS = (
    "each chain is an ensemble: the first half of every walker's draws, walker after walker, then the second half; "
    "sample_stats has walker and step of each draw"
)


def fold_chains(values: NDArray[np.intp], ensembles: int) -> NDArray[np.intp]:
    """What belongs to draws of walkers, shape (walkers, steps), by ensemble, (ensembles, walkers of one · steps).

    Neighbours in a chain are neighbours of one walker, so that slow walkers show as autocorrelation, and each half of a
    chain is one half of the run, so that a drift shows in R̂.
    """
    halves = np.array_split(values.reshape(ensembles, -1, values.shape[1]), 2, axis=2)
    return np.concatenate([half.reshape(ensembles, -1) for half in halves], axis=1)


def _measured(data: Data, suffix: str) -> tuple[NDArray[Any], dict[str, NDArray[Any]]]:
    """Values that were measured and what each stands for, by axis; none of data that are neither FRFs nor modes."""
    if data.frfs is not None:
        frf = data.frfs.frf
        axes = {"frequency": frf.frequency_hz, "output": frf.outputs, "input": frf.inputs}
        return frf.values, {f"{axis}{suffix}": np.array(labels) for axis, labels in axes.items()}
    values, names = (np.empty(0), ()) if data.modes is None else (data.modes.values, data.modes.value_names)
    return values, {f"quantity{suffix}": np.array(names, dtype=object)}


def _with_axes(arrays: Mapping[str, NDArray[Any]], axes: Axes, *leading: str) -> xr.Dataset:
    """Data by name with their axes after the leading ones: a complex NAME as its magnitude, NAME_real and NAME_imag."""
    variables: dict[str, Any] = {}
    for name, values in arrays.items():
        dims = (*leading, *axes.get(name, ()))
        variables[name] = dims, np.abs(values) if np.iscomplexobj(values) else values
        if np.iscomplexobj(values):
            variables |= {f"{name}_real": (dims, values.real), f"{name}_imag": (dims, values.imag)}
    return xr.Dataset(variables, {axis: labels for name in arrays for axis, labels in axes.get(name, {}).items()})


def _log_prior(prior: JointPrior, theta: Array) -> dict[str, Array]:
    """ln of the prior's density over θ, (n, d), and what makes of it that over the quantities, each shape (n,)."""
    first = len(prior.marginals)
    logarithmic = [first + i for i, nuisance in enumerate(prior.nuisances) if not nuisance.additive]
    slope = prior.parametrisation.log_slope(prior.joint(theta)) + theta[:, logarithmic].sum(axis=1)
    return {"coordinates": prior.log_density(theta), "to_quantities": -slope}


def arviz_tree(
    problem: Problem, tree: xr.DataTree, theta: Array, seed: int, megabytes: float, max_draws: int
) -> xr.DataTree:
    """The groups of `Posterior.to_arviz`.

    Parameters
    ----------
    problem, tree, theta
        What was sampled, its draws, a chain for each walker, and their coordinates, shape (walkers, steps, d).
    seed, megabytes, max_draws
        Seed of the replicated data; size of the groups with a value for each datum, 0 for none of them; and the most
        draws of a chain that stay with them.
    """
    require_count(max_draws, "max_draws: found")
    require(megabytes, Real, "to_arviz: found megabytes", "a number, 0 or more", lambda given: 0 <= given < np.inf)
    ensembles, (walkers, steps) = len(np.unique(tree["posterior"]["ensemble"])), theta.shape[:2]
    parts = {f"data_{part.test.name}".strip("_").replace("/", "_"): part for part in problem.parts}
    known = {name: _measured(part.test.data, name.removeprefix("data")) for name, part in parts.items()}
    measured = {name: values for name, (values, _) in known.items()}
    axes: Axes = {name: labels for name, (_, labels) in known.items()}
    length = most = walkers * steps // ensembles
    if megabytes:  # ln L of each value, and as many numbers as were measured
        numbers = sum(values.size * (3 if np.iscomplexobj(values) else 1) for values in measured.values())
        size = 8 * (problem.log_posterior.likelihood.n_data + numbers)
        most = min(max_draws, max(_FEWEST, int(1e6 * megabytes / size) // ensembles))
    kept = np.linspace(0, length - 1, min(most, length)).round().astype(int)
    walker, step = (fold_chains(index, ensembles)[:, kept] for index in np.indices((walkers, steps)))
    place = {"chain": xr.DataArray(walker, dims=_BY_DRAW), "draw": xr.DataArray(step, dims=_BY_DRAW)}
    by_walker = [tree[name].to_dataset().drop_vars([*_BY_DRAW, "ensemble"]) for name in ("posterior", "sample_stats")]
    posterior, stats = (group.isel(place) for group in by_walker)
    rows = theta[walker, step].reshape(walker.size, -1)

    def by_draw(values: Mapping[str, NDArray[Any]], axes: Axes) -> xr.Dataset:
        shaped = {name: each.reshape(*walker.shape, *each.shape[1:]) for name, each in values.items()}
        return _with_axes(shaped, axes, *_BY_DRAW)

    groups = {
        "posterior": posterior.assign_attrs(chains=_CHAINS),
        "sample_stats": stats.assign(walker=(_BY_DRAW, walker), step=(_BY_DRAW, step)),
        "log_prior": by_draw(_log_prior(problem.prior, rows), {}),
        "observed_data": _with_axes(measured, axes),
    }
    if megabytes:
        rng = np.random.default_rng([seed, _SEED])
        replicated = {name: replicate(problem, part, rows, rng) for name, part in parts.items() if measured[name].size}
        groups["posterior_predictive"] = by_draw(replicated, axes)
        try:
            each, (name, *others) = problem.log_posterior.pointwise(rows), measured
            shape = measured[name].shape
            if others or each[0].size != measured[name].size:
                name, shape, axes = "data", each[0].shape, {"data": {"value": np.arange(each[0].size)}}
            groups["log_likelihood"] = by_draw({name: each.reshape(-1, *shape)}, axes)
        except ModelError as error:  # values that depend on each other
            groups["posterior"].attrs["log_likelihood"] = f"left out: {error}"
    places = {axis: np.arange(size) for axis, size in zip(_BY_DRAW, walker.shape, strict=True)}
    sampled = {name: group.assign_coords(places) for name, group in groups.items() if "chain" in group.dims}
    return xr.DataTree.from_dict({**groups, **sampled, "prior": tree["prior"].to_dataset()})


#: Attribute that holds the record.
RECORD = "jointbayes"


def imported_arviz() -> ModuleType:
    """Import ArviZ without its announcement.

    ArviZ 0.23 announces 1.0 once a day and notes the day in the user's cache. That fails where the cache cannot be
    written, and where two processes note the day at the same moment. Then a scratch directory takes the note.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        with suppress(OSError):
            return import_module("arviz")
        before = os.environ.get("XDG_CACHE_HOME")
        try:
            with TemporaryDirectory(prefix="jointbayes-") as scratch:
                os.environ["XDG_CACHE_HOME"] = scratch
                return import_module("arviz")
        finally:
            del os.environ["XDG_CACHE_HOME"]
            if before is not None:
                os.environ["XDG_CACHE_HOME"] = before


def to_arviz(tree: xr.DataTree) -> Any:  # noqa: ANN401 (InferenceData or DataTree, by ArviZ version)
    """Return the tree as the installed ArviZ wants it: InferenceData before 1.0, the DataTree itself from 1.0 on."""
    return tree if int(version("arviz").split(".")[0]) >= 1 else imported_arviz().from_datatree(tree)


def draws_tree(problem: Problem, draws: Draws, prior_theta: Array) -> xr.DataTree:
    """Groups posterior, sample_stats, prior and observed_data from draws of θ."""
    before = _values(problem, prior_theta[None])
    return values_tree(problem, _values(problem, draws.theta), draws.log_density, draws.ensemble, before)


def _values(problem: Problem, theta: Array) -> Array:
    """Stiffnesses, and values of all else that is uncertain, from θ of shape (chains, draws, d)."""
    prior = problem.prior
    return np.concatenate([prior.values(theta), prior.nuisance_values(theta)], axis=-1)


def value_units(problem: Problem) -> dict[str, str]:
    """Names of the stiffnesses, then of all else that is uncertain, each with its unit."""
    return {q.name: q.unit for q in problem.quantities} | {n.name: n.unit for n in problem.prior.nuisances}


def values_tree(
    problem: Problem, values: Array, log_density: Array, ensemble: NDArray[Any], before: Array
) -> xr.DataTree:
    """Groups posterior, sample_stats, prior and observed_data, of several tests one observed_data_NAME for each.

    Parameters
    ----------
    problem
        Gives names, units and data.
    values, log_density, ensemble
        Of the draws, shape (chains, draws, quantities), (chains, draws) and (chains,).
    before
        Draws from the prior, shape (1, draws, quantities).
    """
    posterior = _values_dataset(problem, values).assign_coords(ensemble=("chain", ensemble))
    groups = {
        "/posterior": posterior,
        "/sample_stats": xr.Dataset({"lp": (("chain", "draw"), log_density)}, coords=posterior.coords),
        "/prior": _values_dataset(problem, before),
    }
    for test in problem.tests:
        suffix = f"_{test.name.replace('/', '_')}" if test.name else ""
        groups[f"/observed_data{suffix}"] = array_dataset(test.data.arrays)
    return xr.DataTree.from_dict(groups)


def _values_dataset(problem: Problem, values: Array) -> xr.Dataset:
    units = value_units(problem).items()
    variables = {name: (("chain", "draw"), values[..., i], {"units": unit}) for i, (name, unit) in enumerate(units)}
    chains, draws = values.shape[:2]
    return xr.Dataset(variables, coords={"chain": np.arange(chains), "draw": np.arange(draws)})


def array_dataset(arrays: Mapping[str, NDArray[Any]]) -> xr.Dataset:
    """Arrays by name, each with axes of its own; a complex one as NAME_real and NAME_imag."""
    variables: dict[str, Any] = {}
    for name, array in arrays.items():
        parts = {f"{name}_real": array.real, f"{name}_imag": array.imag} if np.iscomplexobj(array) else {name: array}
        axes = tuple(f"{name}_{axis}" for axis in range(array.ndim))
        variables |= {variable: (axes, values) for variable, values in parts.items()}
    return xr.Dataset(variables)


def log_prior_of_joint(prior: JointPrior, theta: Array) -> xr.Dataset:
    """ln of the prior's density over the joint's coordinates alone, up to a constant, at θ of shape (chains, draws, d).

    With it draws can be reweighted to another prior by whoever knows the coordinates, which are named beside it with
    the prior's mean, standard deviation and ends in each; those of one joint that all tests share are its own.
    """
    of_joint = prior.parametrisation
    if isinstance(of_joint, Blocks) and len(of_joint.blocks) == 1 and not of_joint.blocks[0].name:
        of_joint = of_joint.blocks[0].parametrisation
    density = sum(marginal.log_density(theta[..., i]) for i, marginal in enumerate(prior.marginals))
    count = len(prior.marginals)
    low, high = prior.support
    attrs = {
        "coordinates": of_joint.key,
        "mean": prior.mean[:count],
        "sd": prior.sd[:count],
        "low": low[:count],
        "high": high[:count],
    }
    return xr.Dataset({"joint": (("chain", "draw"), density)}, attrs=attrs)


def write_tree(tree: xr.DataTree, more: Mapping[str, xr.Dataset], record: str, path: str | os.PathLike[str]) -> None:
    """Write groups, more of them and the record, whole or not at all; the record, JSON text, goes into one attribute.

    NetCDF knows neither booleans nor dictionaries as attributes. The file is made in memory: where a disk is full,
    the HDF5 library ends the whole process.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    groups = {name: node.to_dataset() for name, node in tree.children.items()}
    stored = xr.DataTree.from_dict({**groups, **more})
    stored.attrs = {RECORD: record}
    view = stored.to_netcdf(None, engine="h5netcdf")
    assert isinstance(view, memoryview)
    content = bytes(view)
    view.release()  # an error would keep it alive beyond its buffer, and Python complain at its end
    write_whole_file(path, content)


#: Group of its arrays in a posterior file.
PROBLEM_GROUP = "problem"
#: Rooms whose public classes may stand in a description.
_ROOMS = ("jointbayes.structure", "jointbayes.joint", "jointbayes.frf", "vibrecords", "jointbayes.inference")


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


def problem_arrays(problem: Problem) -> tuple[xr.Dataset, StoredProblem]:
    """The arrays of a problem, for a group of their own, and its description.

    What is no part of this package, a distribution or a function of one's own, is only named in the description: it
    cannot be stored, and whoever loads the posterior passes the problem again.
    """
    description = _Description.describe(problem)
    return array_dataset(description.arrays), description.as_json()


def problem_from(
    array: Callable[[str], NDArray[Any]], record: StoredProblem, where: str, passed: Problem | None = None
) -> Problem:
    """The problem from what `problem_arrays` made of it.

    Parameters
    ----------
    array
        Gives one of its arrays.
    record
        The description.
    where
        The file, for messages.
    passed
        The problem as it was stated, which has the parts that could not be stored.

    Raises
    ------
    ModelError
        If parts of it could not be stored and are not passed, this version knows them no more, or they make no problem:
        which.
    """
    if record["own"] and passed is None:
        unstored = ", ".join(f"{place} ({kind})" for place, kind in record["own"].items())
        raise ModelError(
            f"{where}: found a posterior with parts that no file can hold: {unstored}; expected the problem that was "
            "sampled; pass it as load_posterior(path, problem=...)"
        )
    problem = _Restoring(array, where, passed).part(record["description"], "problem")
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
    if record["description"]["premises"][
        "reason"
    ]:  # the answer is of another problem, which follows from the stated one
        decided = {"tests", "prior", "premises", "left_out", "known_modes"}
        names = [name for name in here["description"].keys() - decided if name in names]
        joint = [
            plain["description"]["prior"][part] for plain in (record, here) for part in ("parametrisation", "marginals")
        ]
        names += ["prior"] if joint[:2] != joint[2:] else []
    if not names:
        return
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
    def describe(cls, part: Any, place: str = "problem") -> "_Description":  # noqa: ANN401 (any part of a problem)
        description = cls()
        description.plain = description._taken(part, place)
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
    passed: Problem | None = None

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
        if "own" in plain and self.passed is not None:
            return self._own(str(plain["own"]), place)
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
        plain = {"test" if name == "setup" else name: entry for name, entry in plain.items()}  # the word of older files
        given = {
            name: self.part(entry, f"{place}.{name}")
            for name, entry in plain.items()
            if name not in ("kind", "residual_kind")
        }
        hints = get_type_hints(kind)
        # what an earlier version had and this one has not may be dropped if it says nothing
        for name in [name for name in given if name not in hints and given[name] in ((), None, {})]:
            del given[name]
        for name, value in given.items():
            if not _fits(value, hints.get(name, Any)):
                raise self._fault(f"{place}.{name}", f"{value!r:.60}", str(hints[name]))
        try:
            return kind(**given)
        except (TypeError, ValueError, ArithmeticError, AttributeError, LookupError) as error:
            raise self._fault(
                place, f"parts of which no {kind.__name__} can be made ({error})", "whole ones"
            ) from error

    def _own(self, name: str, place: str) -> Any:  # noqa: ANN401
        """The part at a place of the problem that was passed."""
        part: Any = self.passed
        for step in re.findall(r"\w+", place)[1:]:
            whole = step.isdecimal()
            part = (part[int(step)] if int(step) < len(part) else None) if whole else getattr(part, step, None)
        if getattr(part, "__qualname__", type(part).__qualname__) != name:
            raise self._fault(place, f"{type(part).__name__} in the problem passed", name)
        return part

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


#: Of the file: raised when an older reader would misread it. Version 1 held the text of a case instead of a problem.
FILE_VERSION = 4


@dataclass(frozen=True, slots=True, eq=False)
class FileRecord:
    """Everything of a posterior file that is not an array of draws, or of its problem.

    Parameters
    ----------
    record
        How the draws came about.
    mode, map
        Joint mode, and MAP estimate without the paper's iteration.
    problem
        Description of the problem.
    found
        What took time to find, by the names of the studies.
    of_case_text
        Whether the text of the case states the problem.
    """

    record: RunRecord
    mode: BestDraw
    map: MapEstimate
    problem: StoredProblem
    found: Mapping[str, Any] = field(default_factory=dict)
    of_case_text: bool = False

    def as_text(self) -> str:
        """JSON text, of which `parse_record` makes the record again."""
        plain = asdict(self) | {"file_version": FILE_VERSION, "map": estimate_record(self.map)}
        return json.dumps(plain, default=lambda value: value.value if isinstance(value, Enum) else value.tolist())


def estimate_record(estimate: MapEstimate) -> dict[str, Any]:
    """JSON-ready form of a MAP estimate, but for its arrays."""
    plain = asdict(replace(estimate, iteration=None))
    return {"stiffness": plain.pop("values"), **plain}  # the name that the quantities had first


def _with_values(plain: Any) -> Any:  # noqa: ANN401
    named = isinstance(plain, dict) and "stiffness" in plain
    return {**plain, "values": plain["stiffness"], "iteration": None} if named else plain


def parse_record(text: str, where: str) -> FileRecord:
    """Record from the JSON text in a file.

    Parameters
    ----------
    text
        What `FileRecord.as_text` gave.
    where
        The file, for messages.

    Raises
    ------
    MeasurementError
        If it is no record, of another version, or any field of it is not what it must be: which.
    """
    try:
        plain = json.loads(text)
        version = plain["file_version"]
        json.dumps(plain, ensure_ascii=False).encode()  # no report can be written of half a character
    except (ValueError, RecursionError, KeyError, TypeError) as error:
        raise MeasurementError(
            f"{where}: found no posterior in it ({type(error).__name__}); expected a posterior.nc written by "
            "jointbayes; give the path of one"
        ) from None
    if version == 1:
        raise MeasurementError(
            f"{where}: found file version 1, which holds the text of a case instead of a problem; expected "
            f"{FILE_VERSION}; sample again"
        )
    if version not in (2, 3, FILE_VERSION) or isinstance(version, float):
        raise MeasurementError(
            f"{where}: found file version {version!r:.60}; expected {FILE_VERSION} or less; "
            "read it with the jointbayes that wrote it, or a later one"
        )
    plain |= {"map": _with_values(plain.get("map"))}
    if version < FILE_VERSION:  # its findings were of other forms: they are found from the draws again
        plain = {key: value for key, value in plain.items() if key != "knowledge"} | {"found": {}}
    record = stored_value(FileRecord, plain, f"{where}: record")
    found = {
        name: stored_value(
            get_type_hints(KEPT[name], include_extras=True)["return"], finding, f"{where}: record.{name}"
        )
        for name, finding in record.found.items()
        if name in KEPT
    }
    return replace(record, found=found)
