"""Stability lobes with a probability, for a tool that was never tapped.

A tap test with one tool identifies the joints of spindle, holder and tool. The same joints hold a tool that reaches
30 mm further: its tip FRF is predicted, and from each draw of it the stability lobes of slotting. What is stable in 95
of 100 draws is stable with a probability of 95 %.

    python examples/stability_lobes.py lobes.svg

Altintas, Y., Budak, E. (1995). Analytical prediction of stability lobes in milling. CIRP Annals 44(1), 357-362.
DOI 10.1016/S0007-8506(07)62342-7
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import jointbayes as jb
from jointbayes.structure import FrameRecipe

CASE = Path(__file__).resolve().parents[1] / "configs" / "spindle_tool.toml"
LONGER = {"shank": (0.370, 0.0, 0.0), "tip": (0.480, 0.0, 0.0)}  # the tapped tool's tip is at 0.450 m
LINES = np.arange(200.0, 4000.0, 2.0)
TEETH, PRESSURE, RADIAL = 4, 800e6, 0.3  # N, K_t in Pa, K_r = K_r/K_t: an aluminium alloy
SPEEDS = np.linspace(6000.0, 20000.0, 241)  # rev/min


def averaged_coefficients(start: float, end: float) -> np.ndarray:
    """The averaged directional coefficients α of a cut from `start` to `end`, rad, shape (2, 2)."""

    def primitive(angle: float) -> np.ndarray:
        two, turn = 2 * angle, np.array([np.sin(2 * angle), np.cos(2 * angle)])
        return 0.5 * np.array([
            [turn[1] - RADIAL * two + RADIAL * turn[0], -turn[0] - two + RADIAL * turn[1]],
            [-turn[0] + two + RADIAL * turn[1], -turn[1] - RADIAL * two - RADIAL * turn[0]],
        ])  # fmt: skip

    return primitive(end) - primitive(start)


def limiting_depth(frf: np.ndarray, alpha: np.ndarray, lobes: int = 40) -> np.ndarray:
    """Depth of cut in m at which chatter begins, shape (speeds,), of a tool with one FRF in both directions.

    det(1 + Λ α G) = 0 has two eigenvalues Λ at each chatter frequency; each gives a depth and, for every whole number
    of waves between teeth, a speed (Altintas and Budak 1995, zero order).
    """
    omega, depth = 2 * np.pi * LINES, np.full(SPEEDS.size, np.inf)
    for gain in np.linalg.eigvals(alpha):  # G is a scalar: Λ = −1/(G gain)
        eigenvalue = -1 / (frf * gain)
        ratio = eigenvalue.imag / eigenvalue.real
        a = -2 * np.pi * eigenvalue.real / (TEETH * PRESSURE) * (1 + ratio**2)
        phase = np.pi - 2 * np.arctan(ratio)
        for wave in range(lobes):
            with np.errstate(divide="ignore"):  # no wave at all takes a tooth no time
                speed = 60 * omega / (TEETH * (phase + 2 * np.pi * wave))
            low, high = np.minimum(speed[1:], speed[:-1]), np.maximum(speed[1:], speed[:-1])
            cut = (low <= SPEEDS[:, None]) & (high > SPEEDS[:, None]) & (a[1:] > 0) & (a[:-1] > 0)
            cut &= np.abs(np.diff(phase)) < 1.0  # no step across a branch of the arc tangent
            share = (SPEEDS[:, None] - speed[:-1]) / np.where(np.diff(speed) == 0, 1.0, np.diff(speed))
            at = np.where(cut, a[:-1] + share * np.diff(a), np.inf)
            depth = np.minimum(depth, at.min(axis=1))
    return depth


def longer_tool(case: jb.Case) -> FrameRecipe:
    """The structure with the longer tool, and no accelerometer at its tip."""
    recipe = case.problem.test.structures.recipe
    bodies = dict(recipe.bodies)
    bodies["tool"] = replace(bodies["tool"], points=tuple(LONGER.items()))
    return replace(recipe, bodies=tuple(bodies.items()), accelerometer_mass=0.0)


def main(figure: str) -> None:
    """Identify the joints, predict the longer tool's tip, draw the lobes."""
    case = jb.load_case(CASE)
    posterior = jb.sample(case, seed=1)  # the joints, from the tap test of the shorter tool
    tip = jb.Ports(LINES, ("tool.tip:y",), ("tool.tip:y",))
    found = posterior.predict(longer_tool(case), tip, max_draws=200)
    alpha = averaged_coefficients(0.0, np.pi)  # a slot
    depths = 1e3 * np.array([limiting_depth(frf[:, 0, 0], alpha) for frf in found.values])
    low, middle, high = np.quantile(depths, [0.05, 0.5, 0.95], axis=0)
    print(f"first mode of the tip: {found.rows()[0][1]} ({found.rows()[0][2]})")
    best = int(low.argmax())
    print(f"stable with 95 %: {low[best]:.2f} mm at {SPEEDS[best]:.0f} rev/min, {low.min():.3f} mm at any speed")
    print(f"width of the 90 % band of the depth: {100 * np.median(high / low - 1):.1f} % in the median")
    canvas = Figure(figsize=(7.2, 3.6), layout="constrained")
    axes = canvas.subplots()
    axes.fill_between(SPEEDS, low, high, alpha=0.35, lw=0, label="90 % of draws")
    axes.plot(SPEEDS, middle, lw=1.2, label="median")
    axes.plot(SPEEDS, low, "k--", lw=0.8, label="stable with 95 %")
    axes.set(xlabel="Spindle speed (rev/min)", ylabel="Limiting depth of cut (mm)", ylim=(0, 1.2 * float(low.max())))
    axes.legend(loc="upper left")
    canvas.savefig(figure)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "lobes.svg")
