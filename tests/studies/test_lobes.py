"""Stability lobes: against encirclements of the determinant, which know no lobe numbers."""

import numpy as np
import pytest

from jointbayes.studies.lobes import Cut, Lobes, limiting_depth

LINES = np.arange(100.0, 4000.0, 0.25)
SPEEDS = np.linspace(3000.0, 20000.0, 35)


def receptance(lines, *modes):
    """Sum of modes, each stiffness, damping ratio and natural frequency."""
    return sum(1 / (k * (1 - (lines / f) ** 2 + 2j * ratio * lines / f)) for k, ratio, f in modes)


def along(lines):
    return receptance(lines, (2e7, 0.03, 600.0), (4e7, 0.02, 1500.0))


def across(lines):
    return receptance(lines, (1.5e7, 0.02, 700.0), (6e7, 0.03, 1200.0))


def depth_by_encirclements(cut, speed):
    """Least depth at which det(1 + Λ α G) goes around zero once, m: bisection, and no lobe is counted."""
    lines = np.arange(100.0, 4000.0, 0.05)
    x, y, alpha = along(lines), across(lines), cut.coefficients()
    delay = 1 - np.exp(-2j * np.pi * lines * 60 / (cut.teeth * speed))
    low, high = 1e-6, 0.1
    while high / low > 1 + 1e-6:
        middle = np.sqrt(low * high)
        gain = -cut.teeth / (4 * np.pi) * middle * cut.tangential_pa * delay
        coupled = gain**2 * alpha[0, 1] * alpha[1, 0] * x * y
        angle = np.unwrap(np.angle((1 + gain * alpha[0, 0] * x) * (1 + gain * alpha[1, 1] * y) - coupled))
        low, high = (low, middle) if abs(angle[-1] - angle[0]) > np.pi else (middle, high)
    return high


@pytest.mark.parametrize("up", [True, False])
@pytest.mark.parametrize("immersion", [0.3, 0.7, 1.0])
def test_the_depth_is_that_at_which_the_determinant_goes_around_zero(up, immersion):
    cut = Cut(4, 8e8, 0.3, immersion, up)
    depth = limiting_depth(cut, LINES, along(LINES), across(LINES), SPEEDS)
    exact = [depth_by_encirclements(cut, speed) for speed in SPEEDS[::6]]
    assert depth[::6] == pytest.approx(exact, rel=1e-3)


def test_the_coefficients_of_a_slot_are_those_of_the_paper():
    """Altintas and Budak (1995): −π K_r on the diagonal and ∓π beside it, halved, of cuts from 0 to π."""
    k = 0.3
    expected = np.pi * np.array([[-k, -1.0], [1.0, -k]])
    assert Cut(4, 8e8, k, 1.0, True).coefficients() == pytest.approx(expected, rel=1e-12)
    assert Cut(4, 8e8, k, 1.0, False).coefficients() == pytest.approx(expected, rel=1e-12)


def test_up_and_down_milling_mirror_each_other_about_the_feed():
    """φ → π − φ: the parts that are odd in it change sides, the couple of equal sign stays."""
    up, down = (Cut(4, 8e8, 0.0, 0.4, way).coefficients() for way in (True, False))
    assert np.diag(up) == pytest.approx(-np.diag(down))
    assert (up[0, 1], up[1, 0]) == pytest.approx((down[0, 1], down[1, 0]))


def test_rows_name_the_least_depth_first_and_the_band_holds_the_draws():
    speeds = np.linspace(6000.0, 7000.0, 5)
    depths = np.array([[1.0, 3.0, 1.0, 2.0, 0.5]]) * np.linspace(0.9, 1.1, 41)[:, None] / 1e3
    lobes = Lobes(speeds, depths)
    assert [row[0] for row in lobes.rows()] == ["7000", "6250", "6750"]
    assert lobes.rows()[1][1] == "3"
    inside = (lobes.bands[0] <= depths) & (depths <= lobes.bands[4])
    assert inside.mean(axis=0) == pytest.approx(39 / 41, abs=0.03)


def test_a_structure_that_no_line_limits_says_so():
    assert "no line" in Lobes(SPEEDS, np.full((3, SPEEDS.size), np.inf)).lines()[0]
