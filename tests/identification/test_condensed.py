"""Many residuals are condensed before they are solved, and the climb on them ends where that on all of them does."""

import sys

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.identification.refine import condensed, refine


def test_condensed_residuals_have_the_same_sums_of_products():
    rng = np.random.default_rng(1)
    residual, jacobian = rng.normal(size=150_001), rng.normal(size=(150_001, 3)) * [1.0, 1e6, 1e-3]
    few, slopes = condensed(residual, jacobian)
    assert (few.shape, slopes.shape) == ((4,), (4, 3))
    assert few @ few == pytest.approx(residual @ residual, rel=1e-12)
    np.testing.assert_allclose(slopes.T @ slopes, jacobian.T @ jacobian, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(slopes.T @ few, jacobian.T @ residual, rtol=1e-8)


def test_few_residuals_stay_as_they_are():
    residual, jacobian = np.ones(1000), np.ones((1000, 2))
    kept = condensed(residual, jacobian)
    assert kept[0] is residual
    assert kept[1] is jacobian


def test_the_climb_ends_at_the_same_mode(cheap_case, monkeypatch):
    density = cheap_case.problem.log_posterior
    start = jb.find_map(cheap_case).theta + 0.05
    mode, height = refine(density, start)
    module = sys.modules[refine.__module__]  # the package has the function by the module's name
    monkeypatch.setattr(module, "_LONG", 0)
    monkeypatch.setattr(module, "_AT_ONCE", 100)
    again, again_height = refine(density, start)
    np.testing.assert_allclose(again, mode, atol=1e-6)
    assert again_height == pytest.approx(height, abs=1e-9)
