"""A posterior as xarray groups, as ArviZ wants them, and as a netCDF file.

The edge to ArviZ: its 0.x (InferenceData) and 1.x (DataTree) differ.
"""

import os
import warnings
from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from importlib.metadata import version
from types import ModuleType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jointbayes.inference import JointPrior, Problem
from jointbayes.joint import Blocks
from jointbayes.sampling import Draws
from vibrecords.arrays import Array
from vibrecords.files import write_whole_file

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
