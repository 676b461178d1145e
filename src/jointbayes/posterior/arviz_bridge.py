"""The edge to ArviZ, whose 0.x (InferenceData) and 1.x (DataTree) differ; draws themselves are plain xarray."""

import warnings
from importlib.metadata import version
from types import ModuleType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

__all__ = ["effective_sizes", "loo_pointwise", "pareto_k", "to_arviz"]


_FEWEST = 100  # weights, whose largest fifth is fitted


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


def effective_sizes(chains: NDArray[np.float64]) -> tuple[float, float]:
    """Effective sample sizes (bulk, tail) of one parameter's draws, shape (chains, draws).

    References
    ----------
    Vehtari, A. et al. (2021). Bayesian Analysis 16(2), 667-718. DOI 10.1214/20-BA1221
    """
    arviz = _arviz()
    sizes = []
    for method in ("bulk", "tail"):
        result = arviz.ess(xr.Dataset({"x": (("chain", "draw"), chains)}), method=method)
        sizes.append(float(result["x"]))
    return sizes[0], sizes[1]


def pareto_k(log_weight: NDArray[np.float64]) -> float:
    """Shape of the generalised Pareto distribution fitted to the largest importance weights.

    Above 0.7 the mean of the weights cannot be trusted, however many there are.

    Parameters
    ----------
    log_weight : ndarray, shape (n,)
        ln of the weights above zero, up to a constant.

    Returns
    -------
    float
        −inf if all weights are equal; inf if there are too few of them.

    References
    ----------
    Vehtari, A. et al. (2024). Pareto smoothed importance sampling. Journal of Machine Learning Research 25(72), 1-58.
    """
    if log_weight.size < _FEWEST:
        return float("inf")
    if np.ptp(log_weight) < 1e-9:
        return float("-inf")
    if _is_new():
        from arviz_stats.base import array_stats

        return float(array_stats.psislw(-log_weight)[1])  # it asks for the negative, as for leaving one out
    return float(_arviz().psislw(log_weight)[1])


def loo_pointwise(log_likelihood: NDArray[np.float64], efficiency: float) -> tuple[NDArray[np.float64], ...]:
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
        found = _arviz().loo(to_arviz(tree), pointwise=True, reff=efficiency)
    each = found.elpd_i if hasattr(found, "elpd_i") else found.loo_i
    return np.asarray(each, dtype=float).ravel(), np.asarray(found.pareto_k, dtype=float).ravel()
