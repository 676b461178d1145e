"""Does the published point lie in the 95 % region for 95 % of the noise seeds? Run by `make science`.

The main case is synthesised anew with each of 100 noise seeds, none of them the case's own, and sampled; the level of
the highest-density region that holds the true (published) joint is noted. Writes docs/calibration.md.
"""

import argparse
import datetime
import os
import platform
import re
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import jointbayes as jb

ROOT = Path(__file__).resolve().parents[1]
CASE = ROOT / "configs" / "clamped_beam.toml"
TABLE = ROOT / "docs" / "calibration.md"
FIRST_SEED = 1000

#: Shorter than a production run: about 1300 effective draws place a region level to within 0.01.
SETTINGS = jb.SamplerSettings(walkers=16, tau_factor=20.0, tau_tolerance=0.1)


@dataclass(frozen=True)
class Outcome:
    """What became of one noise seed."""

    noise_seed: int
    converged: bool
    mode_agrees: bool
    level: float
    covered: tuple[bool, bool, bool]
    k22_error: float


def with_noise_seed(text: str, seed: int) -> str:
    """Case text with another noise seed."""
    changed, count = re.subn(r"(?m)^seed = \d+(?=[^\n]*\nadded)", f"seed = {seed}", text)
    if count != 1:
        raise ValueError(f"{CASE}: expected one noise seed above 'added', found {count}")
    return changed


def analyse(noise_seed: int) -> Outcome:
    """Sample the main case with other noise."""
    case = jb.case_from_text(f"noise seed {noise_seed}", with_noise_seed(CASE.read_text(encoding="utf-8"), noise_seed))
    assert case.reference is not None
    posterior = jb.sample(case, seed=1, settings=SETTINGS)
    covered = []
    for name, true in zip(("k11", "k12", "k22"), case.reference, strict=True):
        low, high = posterior.interval(name, 0.95)
        covered.append(bool(low <= true <= high))
    return Outcome(
        noise_seed,
        posterior.converged,
        posterior.mode_agrees,
        posterior.region_level(case.reference),
        (covered[0], covered[1], covered[2]),
        posterior.mode["k22"] / case.reference[2] - 1,
    )


def analyse_many(count: int) -> list[Outcome]:
    """Analyse the first `count` noise seeds on all cores."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(analyse, range(FIRST_SEED, FIRST_SEED + count)))


def table(outcomes: list[Outcome]) -> str:
    """Markdown page with the figures."""
    level = np.array([o.level for o in outcomes])
    covered = np.array([o.covered for o in outcomes]).mean(axis=0)
    n = len(outcomes)
    lines = [
        "# Calibration of the main case",
        "",
        f"Printed by `make science` on {datetime.datetime.now(datetime.UTC).date()}, "
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}.",
        "",
        f"The main case (`configs/clamped_beam.toml`, synthetic) was synthesised and sampled with {n} noise seeds, "
        f"{FIRST_SEED} to {FIRST_SEED + n - 1}; the seed of the case itself is not among them.",
        "",
        "| figure | value |",
        "|---|---|",
        f"| published point inside the joint 95 % region | {np.sum(level <= 0.95)} of {n} |",
        f"| inside the joint 99 % region | {np.sum(level <= 0.99)} of {n} |",
        f"| inside the joint 50 % region | {np.sum(level <= 0.5)} of {n} |",
    ]
    lines += [
        f"| 95 % interval of {name} holds the published value | {round(n * share)} of {n} |"
        for name, share in zip(("k11", "k12", "k22"), covered, strict=True)
    ]
    error = np.array([o.k22_error for o in outcomes])
    lines += [
        f"| k22's mode within 2 % of the published value | {np.sum(np.abs(error) <= 0.02)} of {n} |",
        f"| median and largest error of k22's mode | {100 * np.median(np.abs(error)):.2f} %, "
        f"{100 * np.abs(error).max():.2f} % |",
        f"| runs that converged | {sum(o.converged for o in outcomes)} of {n} |",
        f"| runs whose joint mode is the MAP | {sum(o.mode_agrees for o in outcomes)} of {n} |",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    """Run, print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    count = parser.parse_args().seeds
    page = table(analyse_many(count))
    print(page)
    if count >= 100:
        TABLE.write_text(page, encoding="utf-8")
        print(f"written: {TABLE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
