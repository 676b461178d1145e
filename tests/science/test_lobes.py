"""Stability lobes of examples/stability_lobes.py: against the closed form of one mode, and against the exact tool."""

import numpy as np
import pytest
from benchmarks.lobes import example, share_inside


def test_the_least_depth_of_one_mode_is_that_of_its_most_negative_real_part():
    lobes = example()
    stiffness, ratio, natural = 2e7, 0.03, 1000.5
    r = lobes.LINES / natural
    frf = 1 / (stiffness * (1 - r**2 + 2j * ratio * r))
    depth = lobes.limiting_depth(frf, -np.eye(2))
    # Λ = 1/G: a = 2π/(N K_t max(−Re G)), and −Re G is at most 1/(4 k ζ (1 + ζ))
    least = 2 * np.pi * 4 * stiffness * ratio * (1 + ratio) / (lobes.TEETH * lobes.PRESSURE)
    assert depth.min() == pytest.approx(least, rel=2e-3)
    assert (depth >= least * (1 - 1e-3)).all()


def test_the_coefficients_of_a_slot_are_those_of_the_paper():
    lobes = example()
    # (Altintas and Budak 1995) of a full slot: π/2 (−K_r, −1; 1, −K_r) in their signs, by the ends 0 and π
    k = lobes.RADIAL
    expected = np.pi * np.array([[-k, -1.0], [1.0, -k]])
    assert lobes.averaged_coefficients(0.0, np.pi) == pytest.approx(expected, rel=1e-12)


@pytest.mark.science
def test_the_limit_of_the_exact_tool_lies_in_the_band():
    assert share_inside(example(), 120, every=4) >= 0.92
