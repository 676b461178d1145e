"""What several set-ups of one joint bring, and whether the intervals of two of them hold the truth.

The clamped bar of 25 mm with the paper's joint. Every overhang is measured to ±0.1 mm, the edge of the clamp is known
to ±1.9 mm in all of them alike, E to 2 %, density to 1 %, the damping ratio not; the joint's prior is that of
configs/clamped_beam.toml. The noise of each part of an FRF is 3 % of |H| and 1 % of the median of |H| over all lines
and responses of a set-up: 10 to 2500 Hz in steps of 2 Hz.

- Table: linearised standard deviations at the truth, beside those of sampled posteriors of exact data.
- Coverage: data sets of 383 mm with mid-span and of 200 mm; beam, overhangs and edge are drawn anew from their priors
  for each, and the data come from a beam built for them, not from the family of beams that analyses them.

Data sets are kept in build/setups as they come, one line of JSON each, so that a run that was cut off goes on.

    python -m benchmarks.setups                # the table, 100 data sets, benchmarks/setups.json and the docs' page
    python -m benchmarks.setups --sets 5 --pilot
"""

import argparse
import json
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration_page import between
from benchmarks.exact_page import where_measured
from benchmarks.record import environment, kept_lines
from jointbayes.frf import FrfSet, Ports, receptance_model
from jointbayes.inference import JointPrior, Normal, Nuisance, Problem, Setup, Uniform
from jointbayes.joint import Joint, LogStiffness
from jointbayes.measurement import FrfMeasurement
from jointbayes.posterior import Posterior
from jointbayes.posterior.information.fisher import fisher_information
from jointbayes.sampling import SamplerSettings
from jointbayes.structure import BeamFamily, BeamMaterial, BeamRecipe, ModalDamping, Section
from jointbayes.workflow import sample

__all__ = ["CLAMP", "LINES", "RESULTS", "TABLE", "TRUTH", "Test", "data_set", "linearised", "part_sd", "problem_of"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ROOT = Path(__file__).resolve().parents[1]
RESULTS, KEPT = ROOT / "benchmarks" / "setups.json", ROOT / "build" / "setups" / "sets.jsonl"
PAGE = ROOT / "docs" / "examples" / "two-overhangs.md"

CLAMP = Joint(("1:y", "1:rz"))
TRUTH = np.array([5.05e9, 3.44e7, 1.52e6])
BOUNDS = ((1e6, 1e11), (1e4, 1e10), (1e3, 1e8))
LINES = np.arange(10.0, 2501.0, 2.0)
TIP, MID = "25:y", "13:y"
OWN_MM, EDGE_MM = 0.1, 1.9
#: For one of many posteriors; as many walkers as nine to twelve unknowns ask for.
SETTINGS = SamplerSettings().for_one_of_many()


@dataclass(frozen=True, slots=True)
class Test:
    """One test: overhang in mm, where the motion is measured, mass at the tip in kg. The force acts at the tip."""

    length_mm: float
    outputs: tuple[str, ...] = (TIP,)
    tip_kg: float = 0.0

    __test__ = False  # it is no test of pytest

    @property
    def name(self) -> str:
        """Name of its set-up."""
        return f"l{self.length_mm:g}" + ("heavy" if self.tip_kg else "")


LONG, SHORT, BOTH = Test(383), Test(200), Test(383, (TIP, MID))
#: Tests, and sd of (ln k11, ln k12, ln k22) after them by an independent prototype.
TABLE: dict[str, tuple[tuple[Test, ...], tuple[float, float, float]]] = {
    "383 mm alone": ((LONG,), (0.671, 1.640, 1.022)),
    "200 mm alone": ((SHORT,), (1.135, 1.360, 0.859)),
    "383 mm, and with 2 kg at the tip": ((LONG, Test(383, tip_kg=2.0)), (0.663, 1.640, 1.022)),
    "383 + 200 mm": ((LONG, SHORT), (0.475, 1.158, 0.768)),
    "383 + 300 + 200 + 150 + 100 mm": ((LONG, Test(300), SHORT, Test(150), Test(100)), (0.414, 1.150, 0.764)),
    "383 mm with mid-span": ((BOTH,), (0.286, 0.157, 0.017)),
    "383 mm with mid-span, + 150 mm": ((BOTH, Test(150)), (0.260, 0.111, 0.017)),
}
#: The two set-ups of the study of coverage.
STUDIED = (BOTH, SHORT)


def recipe(test: Test, length_mm: float, youngs_modulus: float = 1.0, density: float = 1.0) -> BeamRecipe:
    """The bar in 24 spans, with factors on E and density."""
    steel = BeamMaterial(2.1e11 * youngs_modulus, 0.3, 7800.0 * density)
    return BeamRecipe(
        length_mm / 1000,
        Section.circle(0.025),
        steel,
        ModalDamping((0.01,)),
        elements=24,
        added_mass=test.tip_kg,
        accelerometer_dofs=(TIP,) if test.tip_kg else (),
    )


def part_sd(values: ComplexArray) -> Array:
    """3 % of |H|, and one floor for all channels of a test: 1 % of the median of |H| over lines and responses."""
    return 0.03 * np.abs(values) + 0.01 * float(np.median(np.abs(values)))


def receptance(test: Test, made: BeamRecipe) -> ComplexArray:
    """Exact FRFs of a bar in the paper's joint, shape (lines, outputs, 1)."""
    ports = Ports(LINES, test.outputs, (TIP,))
    matrix = LogStiffness().matrix(TRUTH)
    return receptance_model(BeamFamily(made, {}), CLAMP, ports).receptance(matrix)[0]


@cache
def _family(test: Test) -> BeamFamily:
    ranges = dict.fromkeys(("youngs_modulus", "density"), (-0.12, 0.12))
    own, edge = 6 * OWN_MM / test.length_mm, 6 * EDGE_MM / 1000
    ranges |= {"length": (-own, own), "length_offset": (-edge, edge), "damping_ratio": (np.log(0.1), np.log(10.0))}
    return BeamFamily(recipe(test, test.length_mm), ranges)


@cache
def _exact(test: Test) -> FrfMeasurement:
    values = receptance(test, recipe(test, test.length_mm))
    return measured(test, values, values)


def measured(test: Test, values: ComplexArray, exact: ComplexArray) -> FrfMeasurement:
    """Data of a test with the noise that its exact FRFs make."""
    frf = FrfSet(LINES, values, test.outputs, (TIP,))
    return FrfMeasurement(frf, 2 * part_sd(exact) ** 2, synthetic=True)


def problem_of(tests: tuple[Test, ...], data: tuple[FrfMeasurement, ...] | None = None) -> Problem:
    """The joint from these tests, of exact data unless given; E, density, damping and the edge are common to all."""
    data = data or tuple(map(_exact, tests))
    setups = [Setup(t.name, _family(t), CLAMP, one) for t, one in zip(tests, data, strict=True)]
    nuisances = (
        Nuisance("youngs_modulus", "GPa", 210.0, Normal(0.0, 0.02)),
        Nuisance("density", "kg/m³", 7800.0, Normal(0.0, 0.01)),
        Nuisance("damping_ratio", "1", 0.01, Uniform.of_logarithm(0.1, 10.0)),
        Nuisance("length_offset", "mm", 1000.0, Normal(0.0, EDGE_MM / 1000)),
        *(Nuisance(f"{t.name}.length", "mm", t.length_mm, Normal(0.0, OWN_MM / t.length_mm)) for t in tests),
    )
    priors = tuple(Uniform.of_logarithm(low, high) for low, high in BOUNDS)
    return Problem(setups=tuple(setups), prior=JointPrior(LogStiffness(), priors, nuisances), name="set-ups")


def linearised(tests: tuple[Test, ...]) -> Array:
    """Linearised sd of (ln k11, ln k12, ln k22) at the truth, shape (3,)."""
    problem = problem_of(tests)
    point = np.concatenate([np.log(TRUTH), np.zeros(len(problem.names) - 3)])
    spread = fisher_information(problem, point).with_bounds().stiffness_sd()
    return np.array([spread[name] for name in problem.parametrisation.stiffness_names])


def data_set(seed: int, tests: tuple[Test, ...] = STUDIED) -> Problem:
    """Noisy data of a beam drawn from the priors, in the paper's joint."""
    rng = np.random.default_rng([seed, 14])
    modulus, density = np.exp(rng.normal(0.0, [0.02, 0.01]))
    edge_mm = rng.normal(0.0, EDGE_MM)
    data = []
    for test in tests:
        length_mm = test.length_mm * np.exp(rng.normal(0.0, OWN_MM / test.length_mm)) + edge_mm
        exact = receptance(test, recipe(test, float(length_mm), float(modulus), float(density)))
        white = rng.standard_normal((*exact.shape, 2)) @ [1, 1j]
        data.append(measured(test, exact + part_sd(exact) * white, exact))
    return problem_of(tests, tuple(data))


def spreads(posterior: Posterior) -> Array:
    """sd of ln k of each stiffness, shape (3,)."""
    return np.array([float(np.log(posterior.values(name)).std()) for name in posterior.stiffness_names])


def analysed(seed: int) -> dict[str, Any]:
    """One data set: which 95 % intervals hold the truth, how wide the posterior is, whether it converged."""
    begun = time.process_time()
    posterior = sample(data_set(seed), seed=seed, settings=SETTINGS)
    ends = [posterior.interval(name) for name in posterior.stiffness_names]
    return {
        "seed": seed,
        "held": [bool(low <= k <= high) for (low, high), k in zip(ends, TRUTH, strict=True)],
        "sd": spreads(posterior).round(5).tolist(),
        "converged": posterior.converged,
        "explains": bool(posterior.check.explains),
        "seconds": round(time.process_time() - begun, 1),
    }


def kept_sets(seeds: range, kept: Path | None) -> list[dict[str, Any]]:
    """Every data set, those of an earlier run as they were kept."""
    done = {one["seed"]: one for one in (kept_lines(kept, json.dumps([t.name for t in STUDIED])) if kept else [])}
    for seed in seeds:
        if seed not in done:
            done[seed] = analysed(seed)
            print(json.dumps(done[seed]), flush=True)
            if kept is not None:
                with kept.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(done[seed]) + "\n")
    return [done[seed] for seed in seeds]


def counts(sets: list[dict[str, Any]]) -> dict[str, Any]:
    """What the study of coverage claims."""
    names = LogStiffness().stiffness_names
    return {
        "sets": len(sets),
        "held": dict(zip(names, np.sum([one["held"] for one in sets], axis=0).tolist(), strict=True)),
        "median_sd": dict(zip(names, np.median([one["sd"] for one in sets], axis=0).round(4).tolist(), strict=True)),
        "linearised_sd": dict(zip(names, linearised(STUDIED).round(4).tolist(), strict=True)),
        "converged": sum(one["converged"] for one in sets),
        "explained": sum(one["explains"] for one in sets),
        "cpu_seconds_each": round(float(np.median([one["seconds"] for one in sets])), 1),
    }


def table_rows() -> list[dict[str, Any]]:
    """Linearised and sampled standard deviations of each row of the table."""
    rows = []
    for name, (tests, printed) in TABLE.items():
        posterior = sample(problem_of(tests), seed=1, settings=SETTINGS)
        row = {"tests": name, "linearised": linearised(tests).round(4).tolist(), "prototype": list(printed)}
        row |= {"sampled": spreads(posterior).round(4).tolist(), "converged": posterior.converged}
        print(json.dumps(row), flush=True)
        rows.append(row)
    return rows


def page(found: dict[str, Any]) -> str:
    """The table and the counts for the docs."""
    lines = [
        "| Tests | sd of ln k11 | sd of ln k12 | sd of ln k22 |",
        "|---|---|---|---|",
    ]
    for row in found["table"]:
        cells = [f"{a:.3g} ({b:.3g})" for a, b in zip(row["sampled"], row["linearised"], strict=True)]
        lines.append(f"| {row['tests']} | {' | '.join(cells)} |")
    n = found["coverage"]
    held = ", ".join(f"{name} {count}" for name, count in n["held"].items())
    return "\n".join([
        where_measured(found["environment"]),
        "",
        "Standard deviation of the draws from data without errors, and linearised at the truth (in brackets).",
        "",
        *lines,
        "",
        f"{n['sets']} data sets of 383 mm with mid-span and of 200 mm, each with a beam, overhangs and an edge of its "
        f"own: the 95 % intervals hold the true joint in {held}; {n['converged']} converged, and in {n['explained']} "
        f"the check finds that the model explains the data ({n['cpu_seconds_each']} s of CPU each).",
        "",
    ])  # fmt: skip


def main() -> None:
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--pilot", action="store_true", help="print only, keep nothing")
    parser.add_argument("--coverage", action="store_true", help="the data sets alone, which are kept")
    options = parser.parse_args()
    sets = kept_sets(range(1, options.sets + 1), None if options.pilot else KEPT)
    print(json.dumps(counts(sets), indent=1))
    if options.coverage:
        return
    found = {"environment": environment(), "coverage": counts(sets), "table": table_rows()}
    text = page(found)
    print(text)
    if not options.pilot:
        RESULTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        PAGE.write_text(between(PAGE.read_text(encoding="utf-8"), text), encoding="utf-8")


if __name__ == "__main__":
    main()
