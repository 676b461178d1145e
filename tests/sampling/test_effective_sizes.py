"""Effective sizes are ArviZ's, without loading it."""

import arviz
import numpy as np
import pytest
import xarray as xr

from jointbayes.sampling.diagnostics import effective_sizes


def _autoregressive(rng, chains, draws, memory):
    noise = rng.standard_normal((chains, draws))
    for step in range(1, draws):
        noise[:, step] += memory * noise[:, step - 1]
    return noise


def _sizes_of_arviz(chains):
    data = xr.Dataset({"x": (("chain", "draw"), chains)})
    # ArviZ 1.x has other tails unless they are named
    found = arviz.ess(data, method="bulk"), arviz.ess(data, method="tail", prob=(0.05, 0.95))
    return [float(one["x"]) for one in found]


SHAPES = [(1, 7), (4, 100), (24, 51), (96, 230)]


@pytest.mark.parametrize("memory", [-0.6, 0.0, 0.5, 0.95])
@pytest.mark.parametrize("shape", SHAPES)
def test_effective_sizes_are_those_of_arviz(shape, memory):
    chains = _autoregressive(np.random.default_rng([*shape, 5]), *shape, memory)
    for values in (chains, np.round(chains, 1)):  # also with equal draws
        assert effective_sizes(values) == pytest.approx(_sizes_of_arviz(values), rel=1e-9)


def test_effective_sizes_of_too_short_or_broken_chains_are_not_numbers():
    assert np.isnan([effective_sizes(np.zeros((4, 3))), effective_sizes(np.full((4, 30), np.nan))]).all()
