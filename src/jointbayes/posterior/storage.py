"""A posterior as xarray groups, as ArviZ wants them, and as a netCDF file.

The edge to ArviZ: its 0.x (InferenceData) and 1.x (DataTree) differ.
"""

import os
import warnings
from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from importlib.metadata import version
from numbers import Real
from types import ModuleType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jointbayes.errors import ModelError, require, require_count
from jointbayes.inference import JointPrior, Problem
from jointbayes.joint import Blocks
from jointbayes.posterior.prediction import replicate
from jointbayes.sampling import Draws
from vibrecords import Data
from vibrecords.arrays import Array
from vibrecords.files import write_whole_file

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
_TRIES = 3  # to import ArviZ


def imported_arviz() -> ModuleType:
    """ArviZ, without what it announces.

    0.23 announces 1.0 once a day and keeps the day in a file, by a temporary one whose name all processes share: where
    two begin the day at the same moment one of them does not find it.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        for _ in range(_TRIES):
            with suppress(FileNotFoundError):
                return import_module("arviz")
        return import_module("arviz")


def to_arviz(tree: xr.DataTree) -> Any:  # noqa: ANN401 (InferenceData or DataTree, by ArviZ version)
    """Return the tree as the installed ArviZ wants it: InferenceData before 1.0, the DataTree itself from 1.0 on."""
    return tree if int(version("arviz").split(".")[0]) >= 1 else imported_arviz().from_datatree(tree)


def loo_pointwise(log_likelihood: Array, efficiency: float) -> tuple[Array, ...]:
    """Leave-one-out log density (values,) and Pareto shape (values,) from ln L value by value, shape (draws, values).

    `efficiency` is the number of effective draws over that of draws.

    References
    ----------
    Vehtari, A., Gelman, A., Gabry, J. (2017). Statistics and Computing 27(5), 1413-1432.
    DOI 10.1007/s11222-016-9696-4
    """
    values = xr.Dataset({"data": (("chain", "draw", "value"), log_likelihood[None])})
    tree = xr.DataTree.from_dict({"/log_likelihood": values})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of large Pareto shapes, which are returned
        loo = imported_arviz().loo(to_arviz(tree), pointwise=True, reff=efficiency)
    each = loo.elpd_i if hasattr(loo, "elpd_i") else loo.loo_i
    return np.asarray(each, dtype=float).ravel(), np.asarray(loo.pareto_k, dtype=float).ravel()


def draws_tree(problem: Problem, draws: Draws, prior_theta: Array) -> xr.DataTree:
    """Groups posterior, sample_stats, prior and observed_data from draws of θ."""
    before = _values(problem, prior_theta[None])
    return values_tree(problem, _values(problem, draws.theta), draws.log_density, draws.ensemble, before)


def _values(problem: Problem, theta: Array) -> Array:
    """Stiffnesses, and values of whatever else is uncertain, from θ of shape (chains, draws, d)."""
    prior = problem.prior
    return np.concatenate([prior.values(theta), prior.nuisance_values(theta)], axis=-1)


def value_units(problem: Problem) -> dict[str, str]:
    """Names of the stiffnesses, then of whatever else is uncertain, each with its unit."""
    return {q.name: q.unit for q in problem.quantities} | {n.name: n.unit for n in problem.prior.nuisances}


def values_tree(
    problem: Problem,
    values: Array,
    log_density: Array,
    ensemble: NDArray[Any],
    before: Array,
) -> xr.DataTree:
    """Groups posterior, sample_stats, prior and observed_data, of several set-ups one observed_data_NAME for each.

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
    the prior's mean, standard deviation and ends in each; those of one joint that all set-ups share are its own.
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


def write_tree(tree: xr.DataTree, record: str, path: str | os.PathLike[str]) -> None:
    """Write groups and record, whole or not at all; the record, JSON text, goes into one attribute.

    NetCDF knows neither booleans nor dictionaries as attributes. The file is made in memory: where a disk is full,
    the HDF5 library ends the whole process.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    stored = tree.copy()
    stored.attrs = {RECORD: record}
    view = stored.to_netcdf(None, engine="h5netcdf")
    assert isinstance(view, memoryview)
    content = bytes(view)
    view.release()  # an error would keep it alive beyond its buffer, and Python complain at its end
    write_whole_file(path, content)
