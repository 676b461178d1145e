"""Is the damping of a joint found, and is it said where it cannot be? Simulated tests of a clamped rod.

Three studies, each of 100 data sets. In every one the truth is drawn from the prior of the analysis: two springs, their
damping, and the loss factor of the rod, which is uncertain by a factor of three either way. Counted is how often each
95 % credible interval holds the truth, and which verdict the damping got.

- yielding: springs that take part in all modes, one loss factor on both;
- stiff: springs a thousand times stiffer, which hold so little of the strain energy that the damping of the modes is
  the rod's own: the loss factor of the joint cannot be found, and its verdict must say so;
- dashpot: as yielding, with a dashpot beside the rotational spring in place of the loss factor.

The data do not come from the package: the rod is the exact dynamic stiffness of a Timoshenko beam
(`benchmarks/exact_beam.py`), the joint a complex matrix added to it at every line, solved line by line. Data sets are
kept in build/joint_damping as they come, so that a run that was cut off goes on where it was; the table goes to
docs/joint-damping.md.

    python -m benchmarks.joint_damping --sets 100
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

import jointbayes as jb
from benchmarks.coverage import kept_rows, measured_where, of_sets, row_of, summary
from benchmarks.exact_beam import ExactBeam, circle
from benchmarks.page import table
from benchmarks.record import write_between
from jointbayes.inference import JointPrior, Nuisance, Problem, Uniform
from jointbayes.joint import Damped, Joint, parametrisation_named
from jointbayes.posterior import Posterior
from jointbayes.sampling import SamplerSettings
from jointbayes.structure import BeamFamily, BeamMaterial, BeamRecipe, LossFactor, Section
from vibrecords import FrfData, FrfSet

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks" / "joint_damping.json", ROOT / "docs" / "joint-damping.md"
KEPT = ROOT / "build" / "joint_damping"
SETS, ENTROPY = 100, 20150787

LENGTH, DIAMETER, POINTS = 0.383, 0.025, 10
MATERIAL = BeamMaterial(2.1e11, 0.3, 7800.0)
LINES = np.arange(20.0, 2500.0, 20.0)
OUTPUTS, INPUTS = ("11:y", "6:y"), ("11:y",)
NOISE = 0.03  # of |H| at the line, of each part; and a third of that of the median |H|
LOSS_FACTOR, EITHER_WAY = 0.005, 3.0  # of the rod, and by which factor it is uncertain
SETTINGS = SamplerSettings(walkers=24, max_steps=4000).for_one_of_many()

_SPRINGS = parametrisation_named("springs", ("y", "rz"))


@dataclass(frozen=True)
class Study:
    """What is unknown of the joint, and between which bounds, of ky, krz and the damping, all orders alike."""

    kind: Damped
    bounds: tuple[tuple[float, float], ...]

    @property
    def damping(self) -> str:
        """Name of the joint's damping."""
        return self.kind.stiffness_names[-1]


STUDIES: Mapping[str, Study] = {
    "yielding": Study(Damped(_SPRINGS, (), ("all",)), ((2e7, 2e8), (2e4, 2e5), (0.01, 0.3))),
    "stiff": Study(Damped(_SPRINGS, (), ("all",)), ((2e10, 2e11), (2e7, 2e8), (0.01, 0.3))),
    "dashpot": Study(Damped(_SPRINGS, ("krz",), ()), ((2e7, 2e8), (2e4, 2e5), (1.0, 30.0))),
}


def exact_frf(study: str, truth: Array, loss_factor: float) -> NDArray[np.complex128]:
    """Receptances, shape (lines, outputs, inputs), of the rod on the springs (ky, krz) with their damping."""
    nodes = {i + 1: LENGTH * i / POINTS for i in range(POINTS + 1)}
    rod = ExactBeam(LENGTH, circle(DIAMETER, 0.3), 2.1e11, 0.3, 7800.0, nodes, (0.0, 0.0, 0.0))
    omega = 2 * np.pi * LINES
    z = rod.dynamic_stiffness(omega**2, 1 + 1j * loss_factor)
    ky, krz, damping = truth
    held = rod.index(["1:y", "1:rz"])
    added = np.array([ky, krz]) * (1 + 1j * (0 if study == "dashpot" else damping)) * np.ones((LINES.size, 1))
    if study == "dashpot":
        added[:, 1] += 1j * omega * damping
    z[:, held, held] += added
    loads = np.eye(z.shape[-1])[:, rod.index(INPUTS)]
    return np.asarray(np.linalg.solve(z, np.broadcast_to(loads, (LINES.size, *loads.shape)))[:, rod.index(OUTPUTS)])


def data_set(study: str, index: int) -> tuple[Problem, Array]:
    """A simulated test of a joint drawn from the prior, and the truth: ky, krz, damping, loss factor of the rod."""
    spec = STUDIES[study]
    rng = np.random.default_rng([ENTROPY, list(STUDIES).index(study), index])
    ends = np.log([*spec.bounds, (LOSS_FACTOR / EITHER_WAY, LOSS_FACTOR * EITHER_WAY)])
    truth = np.exp(rng.uniform(*ends.T))
    exact = exact_frf(study, truth[:3], float(truth[3]))
    size = np.abs(exact)
    sd = NOISE * (size + np.median(size, axis=0) / 3)
    values = exact + sd * (rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape))
    data = FrfData(FrfSet(LINES, values, OUTPUTS, INPUTS), 2 * sd**2, synthetic=True)
    around = float(np.log(EITHER_WAY))
    of_rod = Nuisance("loss_factor", "1", LOSS_FACTOR, Uniform(-around, around))
    prior = JointPrior(spec.kind, tuple(Uniform(*end) for end in ends[:3].tolist()), (of_rod,))
    recipe = BeamRecipe(LENGTH, Section.circle(DIAMETER), MATERIAL, LossFactor(LOSS_FACTOR), elements=POINTS)
    family = BeamFamily(recipe, {"loss_factor": (-around, around)})
    return Problem(
        structure=family, joint=Joint(("1:y", "1:rz")), data=data, prior=prior, name=f"{study} {index}"
    ), truth


def analyse(study: str, index: int) -> tuple[Posterior, dict[str, float]]:
    """Posterior of one data set, and the truth."""
    problem, truth = data_set(study, index)
    posterior = jb.sample(problem, seed=index, settings=SETTINGS)
    return posterior, dict(zip((*posterior.stiffness_names, "loss_factor"), truth.tolist(), strict=True))


def section(results: Mapping[str, Any]) -> str:
    """What stands in docs/joint-damping.md."""
    words = {"loss_factor": "rod's loss factor"}
    rows = []
    for study, data in results.items():
        damping = data["judged"]
        others = [f"{words.get(k, k)} {v['held']}" for k, v in data["coverage"].items() if k != damping]
        verdicts = ", ".join(f"{verdict}: {count}" for verdict, count in data["verdicts"].items())
        rows.append((study, f"`{damping}`", of_sets(data, damping), ", ".join(others), verdicts, data["converged"]))
    head = ("joint", "damping", "its 95 % interval holds the truth", "of the others", "its verdict", "converged")
    return "\n".join(
        [*table(head, (map(str, row) for row in rows)), "", measured_where(results), "", _lowest(results), ""]
    )


def _lowest(results: Mapping[str, Any]) -> str:
    """The lowest count of all, and how often one of so many is as low where every interval is right."""
    sets = min(data["data_sets"] for data in results.values())
    counts = {(study, k): v["held"] for study, data in results.items() for k, v in data["coverage"].items()}
    (study, name), lowest = min(counts.items(), key=lambda item: item[1])
    chance = 1 - float(binom.sf(lowest, sets, 0.95)) ** len(counts)
    return (
        f"The {lowest} of {name} ({study}) is the lowest of {len(counts)} counts; with right intervals the lowest of "
        f"so many is {lowest} or less in {100 * chance:.0f} % of such studies."
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=SETS)
    parser.add_argument("--study", choices=[*STUDIES], action="append", help="only this one; prints, writes nothing")
    options = parser.parse_args(arguments)
    results: dict[str, Any] = {}
    for study in options.study or STUDIES:
        damping = STUDIES[study].damping
        head = json.dumps([ENTROPY, repr(STUDIES[study].bounds), LINES.size, NOISE, repr(SETTINGS)])
        outcome = partial(row_of, analyse=partial(analyse, study), judged=damping)
        results[study] = summary(kept_rows(KEPT / f"{study}.jsonl", head, options.sets, outcome), damping)
    print(section(results))
    if options.study is None and options.sets >= SETS:
        RESULTS.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        write_between(PAGE, "joint_damping.py", section(results))


if __name__ == "__main__":
    main()
