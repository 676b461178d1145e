"""The edge to ArviZ, whose 0.x (InferenceData) and 1.x (DataTree) differ; draws themselves are plain xarray."""

import warnings
from importlib.metadata import version
from types import ModuleType
from typing import Any

import numpy as np
import xarray as xr

from jointbayes.arrays import Array


def _arviz() -> ModuleType:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # 0.23 announces 1.0 at every import
        import arviz
    return arviz


def _is_new() -> bool:
    return int(version("arviz").split(".")[0]) >= 1


def to_arviz(tree: xr.DataTree) -> Any:  # noqa: ANN401 (InferenceData or DataTree, by ArviZ version)
    """Return the tree as the installed ArviZ wants it: InferenceData before 1.0, the DataTree itself from 1.0 on."""
    if _is_new():
        return tree
    return _arviz().from_datatree(tree)


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
        loo = _arviz().loo(to_arviz(tree), pointwise=True, reff=efficiency)
    each = loo.elpd_i if hasattr(loo, "elpd_i") else loo.loo_i
    return np.asarray(each, dtype=float).ravel(), np.asarray(loo.pareto_k, dtype=float).ravel()
