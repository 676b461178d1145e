"""A posterior as ArviZ takes it: a chain for each ensemble, and what its functions ask for besides the draws."""

from collections.abc import Mapping
from numbers import Real
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jointbayes.errors import ModelError, require, require_count
from jointbayes.inference import JointPrior, Problem
from jointbayes.posterior.prediction import replicate
from vibrecords import Data
from vibrecords.arrays import Array

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
