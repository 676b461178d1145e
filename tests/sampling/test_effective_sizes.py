"""Effective sizes and Pareto shapes are ArviZ's, without loading it."""

import arviz
import numpy as np
import pytest
import xarray as xr

from jointbayes.sampling.diagnostics import effective_sizes, pareto_k


def _autoregressive(rng: np.random.Generator, chains: int, draws: int, memory: float) -> np.ndarray:
    noise = rng.standard_normal((chains, draws))
    for step in range(1, draws):
        noise[:, step] += memory * noise[:, step - 1]
    return noise


def _sizes_of_arviz(chains: np.ndarray) -> list[float]:
    data = xr.Dataset({"x": (("chain", "draw"), chains)})
    # ArviZ 1.x has other tails unless they are named
    found = arviz.ess(data, method="bulk"), arviz.ess(data, method="tail", prob=(0.05, 0.95))
    return [float(one["x"]) for one in found]


def _shape_of_arviz(log_weight: np.ndarray) -> float:
    if int(arviz.__version__.split(".")[0]) >= 1:
        pytest.skip("ArviZ 1.x fits a tail of another length")
    return float(arviz.psislw(log_weight.copy())[1])


@pytest.mark.parametrize("memory", [-0.6, 0.0, 0.5, 0.95])
@pytest.mark.parametrize("shape", [(1, 7), (4, 100), (24, 51), (96, 230)])
def test_effective_sizes_are_those_of_arviz(shape: tuple[int, int], memory: float) -> None:
    chains = _autoregressive(np.random.default_rng([*shape, 5]), *shape, memory)
    assert effective_sizes(chains) == pytest.approx(_sizes_of_arviz(chains), rel=1e-9)


def test_effective_sizes_with_equal_draws_are_those_of_arviz() -> None:
    chains = np.round(np.random.default_rng(3).standard_normal((4, 200)), 1)
    assert effective_sizes(chains) == pytest.approx(_sizes_of_arviz(chains), rel=1e-9)


def test_effective_sizes_of_too_short_or_broken_chains_are_not_numbers() -> None:
    assert np.isnan(effective_sizes(np.zeros((4, 3)))).all()
    assert np.isnan(effective_sizes(np.full((4, 30), np.nan))).all()


@pytest.mark.parametrize("shape", [0.1, 0.5, 0.9, 1.5])
@pytest.mark.parametrize("count", [100, 1000, 8000])
def test_pareto_shape_is_that_of_arviz(shape: float, count: int) -> None:
    log_weight = np.log(np.random.default_rng(count).pareto(1 / shape, count) + 1) - 700
    assert pareto_k(log_weight) == pytest.approx(_shape_of_arviz(log_weight), rel=1e-9)


def test_pareto_shape_of_weights_that_vanish_is_that_of_arviz() -> None:
    log_weight = -np.random.default_rng(1).exponential(300, 500)
    assert pareto_k(log_weight) == pytest.approx(_shape_of_arviz(log_weight), rel=1e-9)
