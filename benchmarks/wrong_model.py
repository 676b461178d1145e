"""What a wrong model does to the joint, and what admitting it mends: `python -m benchmarks.wrong_model`.

Data of another structure than the one analysed: 360 mm long instead of 383 mm; a second joint, a soft spring at
mid-span; a modulus 5 % off either way; all measured at tip and mid-span. The true joint is drawn about that of the
paper's Table 3. Each set is analysed with nothing admitted, with a model discrepancy along frequency, and with that and
uncertain natural frequencies. Counted: how often the check says that the model explains the data, how often the 95 %
band of the first three natural frequencies holds

- "joint": those that the analysed model gives the *true* joint, in the band that it gives the posterior's joints;
- "structure": those of the true structure, in the band predicted for the structure as measured.

The band is a simultaneous one: equal-tailed intervals of one level for each frequency, wide enough that 95 % of the
draws lie in all three at once. Three intervals of 95 % each would hold all three in as few as 86 % of cases.
"""

import argparse
import re
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from jointbayes.case.case_objects import recipe_of
from jointbayes.frf import NaturalFrequencies, Ports
from jointbayes.joint import LogStiffness
from jointbayes.measurement import RelativeNoise, synthesise_frf
from jointbayes.structure import Structure

Array = NDArray[np.float64]
CASE = Path(__file__).resolve().parents[1] / "configs" / "clamped_beam.toml"
SETTINGS = jb.SamplerSettings(walkers=48, max_steps=1000)
MODES = 3

DISCREPANCY = "\n[noise.discrepancy]\nlength_low_hz = 5.0\nlength_high_hz = 500.0\n"
FREQUENCIES = "\n[uncertain.mode_frequencies]\nsd_percent = 10.0\n"
MODELS = {
    "nothing admitted": "",
    "discrepancy": DISCREPANCY,
    "discrepancy, natural frequencies to 10 %": FREQUENCIES + DISCREPANCY,
}
WRONGS = ("360 mm analysed as 383 mm", "second joint", "Young's modulus 5 % off")


@dataclass(frozen=True)
class Outcome:
    """What one analysis said."""

    wrong: str
    model: str
    index: int
    converged: bool
    explains: bool
    joint: bool
    structure: bool


def analyse(wrong: str, model: str, index: int) -> Outcome:
    """Make data set number so many of a wrong structure, and analyse it."""
    text = re.sub(r"(?m)^f_step_hz = \S+", "f_step_hz = 10.0", CASE.read_text(encoding="utf-8"))
    text = text.replace('outputs = ["11:y"]', 'outputs = ["11:y", "6:y"]')
    case = jb.case_from_text("wrong model", text + MODELS[model])
    rng = np.random.default_rng([WRONGS.index(wrong), index])
    stiffness = _joint(rng)
    true = _structure(case, wrong, rng)
    problem, old = case.problem, case.problem.test.data.joint_frf
    assert old is not None
    ports = Ports(old.frequency_hz, old.outputs, old.inputs)
    data = synthesise_frf(
        true, problem.test.joints, LogStiffness().matrix(stiffness), ports, RelativeNoise(0.03, 0.01), rng=rng
    )
    used = replace(data.select(("11:y", "6:y"), ("11:y",)), joint_frf=data.frf)
    made = replace(case, problem=problem.with_test(data=used))
    posterior = jb.sample(made, seed=index, settings=SETTINGS)

    def holds(frequency: Array, *, of_model: bool) -> bool:
        return in_band(posterior.predict_natural_frequencies(MODES, 2000, of_model=of_model), frequency)

    by_model = problem.natural_frequencies_hz(stiffness, MODES)[0]
    of_truth = NaturalFrequencies(true, problem.test.joints, MODES).frequency_hz(LogStiffness().matrix(stiffness))[0]
    return Outcome(
        wrong,
        model,
        index,
        posterior.converged,
        posterior.check.explains,
        holds(by_model, of_model=True),
        holds(of_truth, of_model=False),
    )


def in_band(draws: Array, point: Array, level: float = 0.95) -> bool:
    """Whether a point (m,) lies in the simultaneous band of draws (n, m)."""
    below = np.sort(draws, axis=0)
    # how far out each draw is: the smaller share of draws beyond it, of its most extreme coordinate
    rank = np.stack([np.searchsorted(below[:, j], draws[:, j], side="right") for j in range(draws.shape[1])], axis=1)
    tail = np.minimum(rank, len(draws) + 1 - rank).min(axis=1) / len(draws)
    share = np.quantile(tail, 1 - level)
    low, high = np.quantile(draws, [share, 1 - share], axis=0)
    return bool(((low <= point) & (point <= high)).all())


def _joint(rng: np.random.Generator) -> Array:
    """Stiffnesses about those of Table 3, sd of ln k 0.7."""
    while True:
        k: Array = np.exp(np.log([5.05e9, 3.44e7, 1.52e6]) + 0.7 * rng.normal(size=3))
        if k[1] ** 2 < 0.9 * k[0] * k[2]:
            return k


def _structure(case: jb.Case, wrong: str, rng: np.random.Generator) -> Structure:
    """The structure that makes the data."""
    recipe = recipe_of(case.spec.structure, case.spec.data)
    if wrong == WRONGS[0]:
        return replace(recipe, length=0.36).structure()
    if wrong == WRONGS[2]:
        return recipe.structure({"youngs_modulus": float(rng.choice([0.95, 1.05]))})
    plain = recipe.structure()
    stiffness = plain.stiffness.copy()
    at = plain.index(("6:y",))[0]
    stiffness[at, at] += np.exp(rng.uniform(np.log(3e4), np.log(3e5)))
    return replace(plain, stiffness=stiffness)


def table(found: list[Outcome]) -> str:
    """Markdown table, one row for each kind of wrongness and model."""
    lines = [
        "| Data of | Admitted | Cases | Converged | Said to be explained | Joint's band | Structure's band |",
        "|---|---|---|---|---|---|---|",
    ]
    for wrong in WRONGS:
        for model in MODELS:
            rows = [one for one in found if (one.wrong, one.model) == (wrong, model)]
            counts = [
                sum(getattr(one, name) for one in rows) for name in ("converged", "explains", "joint", "structure")
            ]
            lines.append(f"| {wrong} | {model} | {len(rows)} | {' | '.join(map(str, counts))} |")
    return "\n".join(lines)


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=34, help="data sets of each kind; default 34")
    parser.add_argument("--processes", type=int, default=1, help="worker processes; default 1")
    options = parser.parse_args()
    jobs = [(wrong, model, index) for index in range(options.cases) for wrong in WRONGS for model in MODELS]
    found = []
    with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as executor:
        for outcome in executor.map(analyse, *zip(*jobs, strict=True)):
            found.append(outcome)
            print(outcome, flush=True)
    print(table(found), flush=True)


if __name__ == "__main__":
    main()
