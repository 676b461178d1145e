"""Posteriors of several modes: are all found, with the right shares? `python -m benchmarks.several_modes [CASE ...]`.

`mirror`: a symmetric portal frame with unlike feet, seen from the middle of its beam alone: the feet exchanged explain
the data as well. `near` and `far`: the sensor 1 and 5 mm off the middle, where the second mode is about 0.5 and 5
lower.
`ring`: three like joints on a wheel seen from its hub, six orders of which explain the data alike.
Each seed is of the run and of the noise. The share that is expected comes from an importance sample of each mode
in θ itself, drawn here. Rows are kept in build/several_modes as they come: what was cut off goes on where it was.
"""

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import jointbayes as jb
from benchmarks.record import kept_lines

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
PARTIAL = ROOT / "build" / "several_modes"
#: Stiffnesses (kx, ky, krz) of both feet.
FEET = ((2e7, 8e7, 3e4), (9e7, 2e8, 1.2e5))
_WHEEL = (3e4, 8e4, 2e5)
_DRAWS = 20_000
_FRAME = """
[structure]
kind = "frame"
directions = ["x", "y", "rz"]
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = { shape = "rectangle", width_mm = 40.0, height_mm = 20.0 }
damping = { law = "loss_factor", loss_factor = 0.005 }
"""


def portal(sensor_mm: float = 250.0, noise_seed: int = 1) -> str:
    """Case text of the portal, 500 mm wide and 400 mm high, with a sensor on its beam."""
    feet = "".join(
        f'[joints.{name}]\nkind = "springs"\ndofs = ["foot{name}:x", "foot{name}:y", "foot{name}:rz"]\n'
        for name in "AB"
    )
    truth = "".join(
        f"{name} = {{ kx = {kx}, ky = {ky}, krz = {krz} }}\n" for name, (kx, ky, krz) in zip("AB", FEET, strict=True)
    )
    return f"""title = "Symmetric portal"
{_FRAME}
members = [
  {{ points = ["footA", "headA"] }},
  {{ points = ["footB", "headB"] }},
  {{ points = ["headA", "mid", "headB"] }},
]
[structure.points]
footA = [0, 0, 0]
headA = [0, 400, 0]
footB = [500, 0, 0]
headB = [500, 400, 0]
mid = [{sensor_mm}, 400, 0]
{feet}
[data]
kind = "synthetic_frf"
outputs = ["mid:x"]
inputs = ["mid:x"]
f_min_hz = 10.0
f_max_hz = 1196.0
f_step_hz = 4.0
noise = {{ relative = 0.03, floor = 0.0, seed = {noise_seed} }}
[data.truth.stiffness]
{truth}"""


def wheel(noise_seed: int = 1) -> str:
    """Case text of a wheel of three spokes, with a joint at each end of one, and a sensor of its hub's rotation."""
    turns = {name: 2 * math.pi * i / 3 for i, name in enumerate("abc")}
    points = "".join(f"{n} = [{300 * math.cos(t):.12f}, {300 * math.sin(t):.12f}, 0]\n" for n, t in turns.items())
    joints = "".join(f'[joints.{name}]\nkind = "springs"\ndofs = ["{name}:rz"]\n' for name in turns)
    truth = "".join(f"{name} = {{ krz = {k} }}\n" for name, k in zip(turns, _WHEEL, strict=True))
    spokes = ", ".join(f'{{ points = ["hub", "{name}"] }}' for name in turns)
    return f"""title = "Wheel"
{_FRAME}
members = [{spokes}, {{ points = ["a", "b", "c", "a"] }}]
[structure.points]
hub = [0, 0, 0]
{points}
{joints}
[data]
kind = "synthetic_frf"
outputs = ["hub:rz"]
inputs = ["hub:rz"]
f_min_hz = 20.0
f_max_hz = 1500.0
f_step_hz = 5.0
noise = {{ relative = 0.03, floor = 0.0, seed = {noise_seed} }}
[data.truth.stiffness]
{truth}"""


#: Case text by name, for a seed of the noise.
CASES = {
    "mirror": lambda seed: portal(noise_seed=seed),
    "near": lambda seed: portal(251.0, seed),
    "far": lambda seed: portal(255.0, seed),
    "ring": wheel,
}


def expected_shares(problem: jb.Problem, places: Sequence[tuple[Array, Array]], seed: int = 1) -> Array:
    """Share of the posterior about each place with its covariance, by importance samples of a Student-t in θ there."""
    rng, log_mass = np.random.default_rng(seed), []
    for place, covariance in places:
        around = stats.multivariate_t(place, 1.3 * covariance, df=5, seed=rng)
        theta = around.rvs(_DRAWS)
        log_weight = problem.log_posterior(theta) - around.logpdf(theta)
        log_mass.append(np.logaddexp.reduce(log_weight))
    mass = np.exp(np.array(log_mass) - max(log_mass))
    return np.asarray(mass / mass.sum())


def row(name: str, seed: int) -> dict[str, Any]:
    """One run: how many modes, their shares, drawn and expected, what was said, and seconds of the processor."""
    case = jb.case_from_text(name, CASES[name](seed))
    began = time.process_time()
    posterior = jb.sample(case, seed=seed)
    seconds = time.process_time() - began
    modes = posterior.estimate.modes
    expected = expected_shares(case.problem, [(mode.theta, mode.covariance) for mode in modes])
    verdicts = [posterior.verdict(q) for q in posterior.stiffness_names]
    return {
        "case": name,
        "seed": seed,
        "modes": len(modes),
        "lower_by": [modes[0].log_posterior - mode.log_posterior for mode in modes],
        "shares": posterior.solutions.shares.tolist(),
        "expected": expected.tolist(),
        "off": float(np.abs(posterior.solutions.shares - expected).max()),
        "converged": posterior.converged,
        "identified": sum(known.verdict == "identified" for known in verdicts),
        "two_solutions": sum("solutions: " in known.verdict_reason for known in verdicts),
        "seconds": seconds,
    }


def study(names: Sequence[str], seeds: int) -> list[dict[str, Any]]:
    """Rows of these cases and so many seeds, those that are kept among them."""
    rows = []
    for name in names:
        kept = PARTIAL / f"{name}.jsonl"
        known = kept_lines(kept, json.dumps(CASES[name](1)))
        for seed in range(len(known) + 1, seeds + 1):
            known.append(row(name, seed))
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(known[-1]) + "\n")
        rows += known[:seeds]
        print(_told(name, known[:seeds]), flush=True)
    return rows


def _told(name: str, rows: Sequence[dict[str, Any]]) -> str:
    """What the rows of one case say, in a line."""
    most = max(row["modes"] for row in rows)
    lower = np.mean([row["lower_by"][1] for row in rows if row["modes"] > 1])
    return (
        f"{name}: {most} modes in {sum(row['modes'] == most for row in rows)} of {len(rows)}, the second {lower:.2f} "
        f"lower in the mean; {sum(row['converged'] for row in rows)} converged; shares off by at most "
        f"{max(row['off'] for row in rows):.3f}; {sum(row['identified'] for row in rows)} quantities identified; at "
        f"most {max(row['seconds'] for row in rows):.0f} s of the processor"
    )


def main() -> None:
    """Run the study, and print one line for each case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", choices=[*CASES, []], help="by default all")
    parser.add_argument("--seeds", type=int, default=20)
    chosen = parser.parse_args()
    study(chosen.cases or list(CASES), chosen.seeds)


if __name__ == "__main__":
    main()
