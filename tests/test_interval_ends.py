"""The study of interval ends on rows of known scatter, and on a shipped case."""

import numpy as np
import pytest
from benchmarks.interval_ends import CASES, allowed, measure, ratios, section, verdict

pytestmark = pytest.mark.docs


def rows(seeds, stated, rng):
    """Ends of scatter 1 with this stated error."""
    whole = {"converged": True, "seconds": 1.0, "errors": {"k": [stated, stated]}}
    return [{"seed": seed, "ends": {"k": rng.normal(size=2).tolist()}, **whole} for seed in range(seeds)]


def test_the_ratio_is_scatter_over_stated_error():
    low, high = ratios(rows(4000, 0.5, np.random.default_rng(1)))["k"]
    assert (low, high) == (pytest.approx(2.0, rel=0.05), pytest.approx(2.0, rel=0.05))


def test_the_band_leaves_the_errors_that_are_right_and_fails_those_that_are_wrong():
    rng = np.random.default_rng(2)
    right = {f"case {i}": rows(20, 1.0, rng) for i in range(18)}
    assert verdict(right) == []
    assert verdict(right | {"case 3": rows(20, 0.45, rng)})[0].startswith("case 3: ")
    assert verdict({name: rows(20, 1.4, rng) for name in right})[-1].startswith("all cases: ")
    assert allowed(20)[0] < allowed(100)[0] < 0.8 < 1.25 < allowed(100)[1] < allowed(20)[1]


def test_a_run_that_has_not_converged_is_named():
    right = rows(20, 1.0, np.random.default_rng(3))
    right[4]["converged"] = False
    assert verdict({"beam": right}) == ["beam: not converged at seeds [4]"]


def test_a_shipped_case_is_measured_and_tabled():
    assert len(CASES) >= 18
    measured = [measure("two_storeys_shape", seed) for seed in (1, 2, 3)]
    assert all(row["converged"] for row in measured)
    packages = {"packages": {"jointbayes": "0"}, "date": "d", "cores": 1, "cpu": "c", "machine": "m", "system": "s"}
    assert "| two_storeys_shape | " in section({"two_storeys_shape": measured}, packages | {"python": "3"})
