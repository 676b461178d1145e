"""A posterior as ArviZ takes it: a chain for each ensemble, and what its functions ask for besides the draws."""

from collections.abc import Mapping
from numbers import Real
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import ModelError, require
from jointbayes.inference import JointPrior, Problem
from jointbayes.measurement import Data
from jointbayes.posterior.prediction import replicate
from jointbayes.posterior.storage import array_dataset

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


def _measured(data: Data) -> NDArray[Any]:
    """Values that were measured; none of a kind of data that is neither FRFs nor modes."""
    if data.frfs is not None:
        return data.frfs.frf.values
    return np.empty(0) if data.modes is None else data.modes.values


def _log_prior(prior: JointPrior, theta: Array) -> dict[str, Array]:
    """ln of the prior's density over θ, (n, d), and what makes of it that over the quantities, each shape (n,)."""
    first = len(prior.marginals)
    logarithmic = [first + i for i, nuisance in enumerate(prior.nuisances) if not nuisance.additive]
    slope = prior.parametrisation.log_slope(prior.joint(theta)) + theta[:, logarithmic].sum(axis=1)
    return {"coordinates": prior.log_density(theta), "to_quantities": -slope}


def arviz_tree(problem: Problem, tree: xr.DataTree, theta: Array, seed: int, megabytes: float) -> xr.DataTree:
    """The groups of `Posterior.to_arviz`.

    Parameters
    ----------
    problem, tree, theta
        What was sampled, its draws, a chain for each walker, and their coordinates, shape (walkers, steps, d).
    seed, megabytes
        Seed of the replicated data; size of the groups with a value for each datum, 0 for none of them.
    """
    size = "to_arviz: found megabytes"
    require(megabytes, Real, size, "a number, 0 or more; correct it", lambda given: 0 <= given < np.inf)
    ensembles, (walkers, steps) = len(np.unique(tree["posterior"]["ensemble"])), theta.shape[:2]
    parts = {f"data_{part.test.name}".strip("_").replace("/", "_"): part for part in problem.parts}
    measured = {name: _measured(part.test.data) for name, part in parts.items()}
    length = most = walkers * steps // ensembles
    if megabytes:  # ln L of each value, and as many numbers as were measured
        per_draw = problem.log_posterior.likelihood.n_data + sum(values.nbytes // 8 for values in measured.values())
        most = max(_FEWEST, int(1e6 * megabytes / (8 * per_draw)) // ensembles)
    kept = np.linspace(0, length - 1, min(most, length)).round().astype(int)
    walker, step = (fold_chains(index, ensembles)[:, kept] for index in np.indices((walkers, steps)))
    place = {"chain": xr.DataArray(walker, dims=_BY_DRAW), "draw": xr.DataArray(step, dims=_BY_DRAW)}
    by_walker = [tree[name].to_dataset().drop_vars([*_BY_DRAW, "ensemble"]) for name in ("posterior", "sample_stats")]
    posterior, stats = (group.isel(place) for group in by_walker)
    rows = theta[walker, step].reshape(walker.size, -1)

    def by_draw(values: Mapping[str, NDArray[Any]]) -> xr.Dataset:
        shaped = {name: each.reshape(*walker.shape, *each.shape[1:]) for name, each in values.items()}
        return array_dataset(shaped, _BY_DRAW)

    groups = {
        "posterior": posterior.assign_attrs(chains=_CHAINS),
        "sample_stats": stats.assign(walker=(_BY_DRAW, walker), step=(_BY_DRAW, step)),
        "log_prior": by_draw(_log_prior(problem.prior, rows)),
        "observed_data": array_dataset(measured),
    }
    if megabytes:
        rng = np.random.default_rng([seed, _SEED])
        replicated = {name: replicate(problem, part, rows, rng) for name, part in parts.items() if measured[name].size}
        groups["posterior_predictive"] = by_draw(replicated)
        try:
            groups["log_likelihood"] = by_draw({"data": problem.log_posterior.pointwise(rows)})
        except ModelError as error:  # values that depend on each other
            groups["posterior"].attrs["log_likelihood"] = f"left out: {error}"
    numbers = {axis: np.arange(size) for axis, size in zip(_BY_DRAW, walker.shape, strict=True)}
    sampled = {name: group.assign_coords(numbers) for name, group in groups.items() if "chain" in group.dims}
    return xr.DataTree.from_dict({**groups, **sampled, "prior": tree["prior"].to_dataset()})
