"""Is the damping of a joint found, and is it said where it cannot be? Simulated tests of a clamped rod.

Three studies, each of 100 data sets. In every one the truth is drawn from the prior of the analysis: two springs, their
damping, and the loss factor of the rod, which is uncertain by a factor of three either way. Counted is how often each
95 % credible interval holds the truth, and which verdict the damping got.

- yielding: springs that take part in all modes, one loss factor on both;
- stiff: springs a thousand times stiffer, which hold so little of the strain energy that the damping of the modes is
  the rod's own: the loss factor of the joint cannot be found, and its verdict must say so;
- dashpot: as yielding, with a dashpot beside the rotational spring in place of the loss factor.

The data do not come from the package: the rod is the exact dynamic stiffness of a Timoshenko beam
(`benchmarks/exact_beam.py`), the joint a complex matrix added to it at every line, solved line by line. The table
goes to docs/joint-damping.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

import jointbayes as jb
from benchmarks.exact_beam import ExactBeam, circle
from benchmarks.page import table
from benchmarks.study import Row, Study, coverage, outcome, share
from jointbayes.inference import JointPrior, Nuisance, Problem, Uniform
from jointbayes.joint import Damped, Joint, parametrisation_named
from jointbayes.posterior import Posterior
from jointbayes.sampling import SamplerSettings
from jointbayes.structure import BeamFamily, BeamMaterial, BeamRecipe, LossFactor, Section
from vibrecords import FrfData, FrfSet

Array = NDArray[np.float64]

ENTROPY = 20150787

LENGTH, DIAMETER, POINTS = 0.383, 0.025, 10
MATERIAL = BeamMaterial(2.1e11, 0.3, 7800.0)
LINES = np.arange(20.0, 2500.0, 20.0)
OUTPUTS, INPUTS = ("11:y", "6:y"), ("11:y",)
NOISE = 0.03  # of |H| at the line, of each part; and a third of that of the median |H|
LOSS_FACTOR, EITHER_WAY = 0.005, 3.0  # of the rod, and by which factor it is uncertain
SETTINGS = SamplerSettings(walkers=24, max_steps=4000).for_one_of_many()

_SPRINGS = parametrisation_named("springs", ("y", "rz"))


@dataclass(frozen=True)
class Unknown:
    """What is unknown of the joint, and between which bounds, of ky, krz and the damping, all orders alike."""

    kind: Damped
    bounds: tuple[tuple[float, float], ...]

    @property
    def damping(self) -> str:
        """Name of the joint's damping."""
        return self.kind.stiffness_names[-1]


STUDIES: Mapping[str, Unknown] = {
    "yielding": Unknown(Damped(_SPRINGS, (), ("all",)), ((2e7, 2e8), (2e4, 2e5), (0.01, 0.3))),
    "stiff": Unknown(Damped(_SPRINGS, (), ("all",)), ((2e10, 2e11), (2e7, 2e8), (0.01, 0.3))),
    "dashpot": Unknown(Damped(_SPRINGS, ("krz",), ()), ((2e7, 2e8), (2e4, 2e5), (1.0, 30.0))),
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


def analysed(study: str, index: int) -> Row:
    """What a run says of each quantity of a data set."""
    return outcome(*analyse(study, index))


def tables(results: Mapping[str, Row]) -> list[str]:
    """The table, and how unusual its lowest count is."""
    rows, words = [], {"loss_factor": "rod's loss factor"}
    for study, data in results.items():
        damping, held = STUDIES[study].damping, data["held"]
        others = ", ".join(f"{words.get(k, k)} {n}" for k, n in held.items() if k != damping)
        verdicts = ", ".join(f"{verdict}: {count}" for verdict, count in data["verdicts"][damping].items())
        rows.append(
            (study, f"`{damping}`", share(held[damping], data["sets"]), others, verdicts, str(data["converged"]))
        )
    head = ("joint", "damping", "its 95 % interval holds the truth", "of the others", "its verdict", "converged")
    counts = {(study, k): n for study, data in results.items() for k, n in data["held"].items()}
    (study, name), lowest = min(counts.items(), key=lambda item: item[1])
    chance = 1 - float(binom.sf(lowest, min(data["sets"] for data in results.values()), 0.95)) ** len(counts)
    note = (
        f"The {lowest} of {name} ({study}) is the lowest of {len(counts)} counts; with right intervals the lowest of "
    )
    return [*table(head, rows), "", f"{note}so many is {lowest} or less in {100 * chance:.0f} % of such studies."]


STUDY = Study("joint_damping", "joint-damping.md", dict.fromkeys(STUDIES, 100), analysed, coverage, tables)

if __name__ == "__main__":
    STUDY.main()
