"""What a likelihood costs, as ratios within one run. Run by `make bench`; writes docs/benchmarks.md.

The main case's log-posterior over 48 joints is timed against what a user would write first: assemble, and solve the
dense dynamic stiffness line by line.
"""

import datetime
import os
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import jointbayes as jb
from jointbayes.frf import DirectSolve
from jointbayes.joint import joint_matrix
from jointbayes.measurement import FrfMeasurement

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs" / "benchmarks.md"
BATCH = 48


def seconds(run: Callable[[], object], repeats: int) -> float:
    """Median wall time of one call, after one to warm up."""
    run()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def measure() -> list[tuple[str, float]]:
    """Microseconds per joint of each way to compute the same thing."""
    case = jb.load_case(ROOT / "configs" / "clamped_beam.toml")
    problem = case.problem
    assert isinstance(problem.measurement, FrfMeasurement)
    assert case.reference is not None
    frf = problem.measurement.frf
    rng = np.random.default_rng(0)
    theta = np.log(case.reference) + rng.normal(size=(BATCH, 3)) * [0.2, 0.05, 0.004]
    one = theta[0]
    direct = DirectSolve(problem.structure, problem.joint, jb.Ports(frf.frequency_hz, frf.outputs, frf.inputs))
    stiffness = joint_matrix(np.exp(one))
    micro = 1e6
    return [
        ("dense solve of the assembled beam at each line", micro * seconds(lambda: direct.receptance(stiffness), 5)),
        ("log-posterior, one joint", micro * seconds(lambda: problem.log_posterior(one), 50)),
        (f"log-posterior, batch of {BATCH}", micro * seconds(lambda: problem.log_posterior(theta), 20) / BATCH),
        ("residuals with exact Jacobian, one joint", micro * seconds(lambda: problem.log_posterior.residuals(one), 20)),
    ]


def main() -> None:
    """Measure, print and write the table."""
    rows = measure()
    dense = rows[0][1]
    lines = [
        "# Benchmarks",
        "",
        f"Printed by `make bench` on {datetime.datetime.now(datetime.UTC).date()}, {platform.machine()}, "
        f"{os.cpu_count()} cores (one used), Python {platform.python_version()}, NumPy {np.__version__}.",
        "",
        "Main case: 22 DOFs, 2481 lines, one FRF, modal damping of the assembled structure. Times vary from machine to",
        "machine and with its load; the ratios within one run are what counts.",
        "",
        "| what | µs per joint | dense solve takes |",
        "|---|---|---|",
        *(f"| {name} | {t:.0f} | {dense / t:.1f} times as long |" for name, t in rows),
        "",
    ]
    page = "\n".join(lines)
    print(page)
    TABLE.write_text(page, encoding="utf-8")
    print(f"written: {TABLE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
