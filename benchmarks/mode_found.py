"""How often `find_map` ends at the mode, and at what cost, for random joints on four beams.

The truth is drawn from the prior of each case; the mode counts as found where the search ends no more than one in log
posterior below a climb from the truth.
"""

import argparse
import re
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from jointbayes.identification import MapEstimate, refine

ROOT = Path(__file__).resolve().parents[1]
BASE = ROOT / "configs" / "clamped_beam.toml"
Array = NDArray[np.float64]

#: Of a case, (k11, k12, k22) of the true joint, and a seed for the noise: the same case with data of that joint.
DataSource = Callable[[jb.Case, Array, int], jb.Case]

#: Log posterior that the search may end below a climb from the truth.
TOLERANCE = 1.0
#: Of 200 cases so many are to be found, at this many seconds of CPU in the median.
WANTED, OF, SECONDS = 198, 200, 1.0

_SECTION = re.compile(r"(?ms)^\[structure\.section\].*?(?=^\[)")


def _priors(k11: tuple[float, float], k12: tuple[float, float], k22: tuple[float, float]) -> str:
    ends = zip(("k11", "k12", "k22"), (k11, k12, k22), strict=True)
    return "".join(
        f'[prior.{name}]\ndistribution = "log_uniform"\nlow = {low:.1e}\nhigh = {high:.1e}\n\n'
        for name, (low, high) in ends
    )


@dataclass(frozen=True)
class Beam:
    """A beam of the study as edits of the main case: keys by name, the section, and the bounds of the prior."""

    keys: Mapping[str, str]
    section: str = ""
    priors: str = ""

    def case(self, name: str) -> jb.Case:
        """The main case with these edits, measured at tip and mid-span."""
        text = BASE.read_text(encoding="utf-8")
        for key, value in {"outputs": '["11:y", "6:y"]', **self.keys}.items():
            text, count = re.subn(rf"(?m)^{key} = [^\n#]*[^\s#]", f"{key} = {value}", text)
            if count != 1:
                raise ValueError(f"{BASE}: expected {key} once, found it {count} times")
        if self.section:
            text = _SECTION.sub(f"[structure.section]\n{self.section}\n\n", text, count=1)
        if self.priors:
            text = re.sub(r"(?ms)^\[prior\.k11\].*?(?=^\[data\])", self.priors, text, count=1)
        return jb.case_from_text(name, text)


#: Bounds as wide as the main case's beside the beam's own stiffness, EI/L³, EI/L² and EI/L.
BEAMS = {
    "main beam": Beam({}),
    "rod 50 × 5 mm": Beam(
        {
            "length_mm": "50.0",
            "diameter_mm": "5.0",
            "ratio": "0.005",  # half-power width 15 Hz at the first mode of the rod held rigidly, 1450 Hz
            "f_min_hz": "100.0",
            "f_max_hz": "20000.0",
            "f_step_hz": "20.0",
        },
        priors=_priors((1e4, 1e10), (1e1, 1e8), (1e0, 1e6)),
    ),
    "aluminium tube 1 m": Beam(
        {
            "length_mm": "1000.0",
            "youngs_modulus_gpa": "70.0",
            "poissons_ratio": "0.33",
            "density_kg_m3": "2700.0",
            "shear_coefficient": "0.53",
            "f_min_hz": "5.0",
            "f_max_hz": "1000.0",
            "f_step_hz": "0.5",
        },
        'shape = "tube"\nouter_diameter_mm = 40.0\ninner_diameter_mm = 36.0',
        _priors((1e4, 1e10), (1e3, 1e9), (1e2, 1e7)),
    ),
    "bar 300 × 20 × 10 mm": Beam(
        {"length_mm": "300.0", "shear_coefficient": "0.85"},
        'shape = "rectangle"\nwidth_mm = 20.0\nheight_mm = 10.0',
        _priors((1e5, 1e11), (1e3, 1e10), (1e2, 1e7)),
    ),
}


@dataclass(frozen=True)
class Outcome:
    """One search: how far it ended above a climb from the truth in log posterior, and its seconds of CPU."""

    beam: str
    seed: int
    truth: tuple[float, ...]
    above: float
    seconds: float
    further: bool

    @property
    def found(self) -> bool:
        """Whether the search ended at the mode."""
        return self.above > -TOLERANCE


def model_data(case: jb.Case, truth: Array, seed: int) -> jb.Case:
    """The case with synthetic data of its own beam and this joint, and its own noise from this seed."""
    text = case.text
    for name, value in zip(("k11", "k12", "k22"), truth, strict=True):
        text, count = re.subn(rf"(?ms)(^\[data\.truth\].*?^{name} = )\S+", rf"\g<1>{float(value)!r}", text, count=1)
        if count != 1:
            raise ValueError(f"{case.name}: found no {name} in [data.truth]")
    text = re.sub(r"(?ms)(^\[data\.noise\].*?^seed = )\d+", rf"\g<1>{seed}", text, count=1)
    return jb.case_from_text(f"{case.name} {seed}", text)


def random_joint(case: jb.Case, seed: int) -> Array:
    """A joint drawn from the case's prior, (k11, k12, k22)."""
    prior = case.problem.prior
    return prior.values(prior.sample(np.random.default_rng([seed, 77]), 1)[0])


def search(
    beam: str, seed: int, data: DataSource = model_data, find: Callable[[jb.Case], MapEstimate] = jb.find_map
) -> Outcome:
    """Draw a joint, make data, search the mode, and climb from the truth to compare."""
    base = BEAMS[beam].case(beam)
    truth = random_joint(base, seed)
    case = data(base, truth, seed)
    began = time.process_time()
    estimate = find(case)
    seconds = time.process_time() - began
    prior, log_posterior = case.problem.prior, case.problem.log_posterior
    start = np.concatenate([prior.parametrisation.coordinates(truth), prior.mean[3:]])
    _, from_truth = refine(log_posterior, start)
    further = estimate.effort is not None and estimate.effort.rounds > 0
    return Outcome(beam, seed, tuple(truth.tolist()), estimate.log_posterior - from_truth, seconds, further)


def run(beams: Iterable[str], seeds: Iterable[int], data: DataSource = model_data) -> list[Outcome]:
    """Search every beam at every seed."""
    seeds = list(seeds)
    return [search(beam, seed, data) for beam in beams for seed in seeds]


def table(outcomes: list[Outcome]) -> str:
    """Markdown table: cases, modes found, the worst miss, CPU time, and how often the search went on by itself."""
    rows = ["| Beam | Found | Worst | CPU median | largest | Searched further |", "|---|---|---|---|---|---|"]
    for beam in dict.fromkeys(o.beam for o in outcomes):
        some = [o for o in outcomes if o.beam == beam]
        seconds = [o.seconds for o in some]
        rows.append(
            f"| {beam} | {sum(o.found for o in some)} of {len(some)} | {min(o.above for o in some):.3g} | "
            f"{statistics.median(seconds):.2f} s | {max(seconds):.2f} s | {sum(o.further for o in some)} |"
        )
    return "\n".join(rows)


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=OF // len(BEAMS), help="cases of each beam; default 50")
    parser.add_argument("--seed", type=int, default=0, help="of the first case; default 0")
    options = parser.parse_args()
    search(next(iter(BEAMS)), options.seed)  # compiles
    outcomes = run(BEAMS, range(options.seed, options.seed + options.count))
    print(table(outcomes))
    for miss in (o for o in outcomes if not o.found):
        print(f"missed: {miss.beam}, seed {miss.seed}, truth {miss.truth}, {miss.above:.3g} in log posterior")
    found, median = sum(o.found for o in outcomes), statistics.median(o.seconds for o in outcomes)
    enough = found * OF >= WANTED * len(outcomes) and median <= SECONDS
    print(
        f"{found} of {len(outcomes)} modes found, {median:.2f} s of CPU in the median: {'ok' if enough else 'FAILED'}"
    )
    sys.exit(not enough)


if __name__ == "__main__":
    main()
