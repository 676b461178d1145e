"""What a wrong model does to measured FRFs, taken as exact and by their modes: `python -m benchmarks.wrong_model`.

FRFs at tip and mid-span of a beam that is not the one analysed: its length 1 % off or its modulus 5 % off either way; a
soft spring at mid-span, or 20 g there, that the model lacks; a clamp whose edge is 2 % of the length further in; a mass
of 10 g missed at the tip; a joint that is softer the more the tip moves. The true joint is drawn about that of the
paper's Table 3. Each set is analysed as measured FRFs are, with nothing stated of modulus, density and length. Counted:
how often the check says that the model explains the FRFs; how often the FRFs taken as exact, and the answer, hold all
three stiffnesses, and k22, in their 95 % intervals; and stiffnesses that the answer calls identified while the truth
lies outside its 99.9 % interval.

Outcomes are kept in build/wrong_model.jsonl as they come, so that a study that was cut off goes on where it was. The
table goes to docs/wrong-model.md.
"""

import argparse
import json
import re
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks.coverage import write_between
from benchmarks.record import environment, kept_lines
from jointbayes.case.case_objects import recipe_of
from jointbayes.frf import FrfSet, Ports, receptance_model
from jointbayes.joint import LogStiffness
from jointbayes.measurement import FrfData, RelativeNoise, synthesise_frf
from jointbayes.structure import Structure

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
CASE = ROOT / "configs" / "clamped_beam.toml"
KEPT = ROOT / "build" / "wrong_model.jsonl"
PAGE = ROOT / "docs" / "wrong-model.md"
SETTINGS = jb.SamplerSettings(walkers=48, max_steps=2000).for_one_of_many()
WRONGS = (
    "length 1 % off",
    "Young's modulus 5 % off",
    "a joint missed",
    "20 g at mid-span missed",
    "clamp edge 2 % of the length off",
    "10 g at the tip missed",
    "joint softer by up to 20 % at resonance",
)
SOFTENING = 0.2
TABLE_3 = (5.05e9, 3.44e7, 1.52e6)


@dataclass(frozen=True)
class Outcome:
    """What one analysis said; `frfs` and `modes` are the stiffnesses held by FRFs and answer, `false` as above."""

    wrong: str
    index: int
    converged: bool
    explains: bool
    taken_as: str
    frfs: tuple[str, ...]
    modes: tuple[str, ...]
    false: tuple[str, ...]
    width: float
    seconds: float


def analyse(wrong: str, index: int) -> Outcome:
    """Make data set number so many of a wrong structure, and analyse it."""
    began = time.process_time()
    text = re.sub(r"(?m)^f_step_hz = \S+", "f_step_hz = 2.0", CASE.read_text(encoding="utf-8"))
    text = text.replace('outputs = ["11:y"]', 'outputs = ["11:y", "6:y"]')
    case = jb.case_from_text("wrong model", text)
    rng = np.random.default_rng([WRONGS.index(wrong), index])
    stiffness, problem = _joint(rng), case.problem
    old = problem.test.data.joint_frf
    assert old is not None
    data = _measured(case, wrong, stiffness, Ports(old.frequency_hz, old.outputs, old.inputs), rng)
    measured = replace(data.select(("11:y", "6:y"), ("11:y",)), joint_frf=data.frf, synthetic=False)
    (setup,) = case.setups
    made = problem.with_test(data=measured)
    case = replace(case, problem=made, stated=made, setups=(replace(setup, data=measured),))
    posterior = jb.sample(case, seed=index, settings=SETTINGS, take_as="exact")
    of_modes = jb.sample(case, seed=index, settings=SETTINGS)
    truth = dict(zip(posterior.stiffness_names, stiffness.tolist(), strict=True))
    low, high = of_modes.interval("k22")
    return Outcome(
        wrong,
        index,
        posterior.converged and of_modes.converged,
        posterior.check.explains,
        "modes" if of_modes.problem.premises.of_modes else "FRFs",
        _held(posterior, truth, 0.95),
        _held(of_modes, truth, 0.95),
        tuple(
            name
            for name in truth
            if name not in _held(of_modes, truth, 0.999) and of_modes.verdict(name).verdict == "identified"
        ),
        high / low,
        time.process_time() - began,
    )


def _held(posterior: jb.Posterior, truth: dict[str, float], probability: float) -> tuple[str, ...]:
    """Stiffnesses whose interval holds the truth."""
    ends = {name: posterior.interval(name, probability) for name in truth}
    return tuple(name for name, value in truth.items() if ends[name][0] <= value <= ends[name][1])


def _joint(rng: np.random.Generator) -> Array:
    """Stiffnesses about those of Table 3, sd of ln k 0.7."""
    while True:
        k: Array = np.exp(np.log(TABLE_3) + 0.7 * rng.normal(size=3))
        if k[1] ** 2 < 0.9 * k[0] * k[2]:
            return k


def _measured(case: jb.Case, wrong: str, stiffness: Array, ports: Ports, rng: np.random.Generator) -> FrfData:
    """FRFs of the true structure; of a joint that softens those of the stiffness that each line's motion leaves."""
    structure, joints, law = _structure(case, wrong, rng), case.problem.test.joints, RelativeNoise(0.03, 0.01)
    if wrong != WRONGS[6]:
        return synthesise_frf(structure, joints, LogStiffness().matrix(stiffness), ports, law, rng=rng)
    lost = np.linspace(0.0, SOFTENING, 41)
    matrices = LogStiffness().matrix(stiffness * (1 - lost[:, None]))
    values = receptance_model(structure, joints, ports).receptance(matrices)
    moves = np.abs(values[:, :, ports.outputs.index("11:y"), 0])
    goal = SOFTENING * (moves / moves[0].max()) ** 2
    at = np.argmax(lost[:, None] >= np.minimum(goal, SOFTENING), axis=0)
    true = values[at, np.arange(len(at))]
    variance = law.variance(true)
    noise = np.sqrt(variance / 2) * (rng.normal(size=true.shape) + 1j * rng.normal(size=true.shape))
    return FrfData(FrfSet(ports.frequency_hz, true + noise, ports.outputs, ports.inputs), variance)


def _structure(case: jb.Case, wrong: str, rng: np.random.Generator) -> Structure:
    """The structure that makes the data."""
    recipe, sign = recipe_of(case.spec.structure, case.spec.data), float(rng.choice([-1.0, 1.0]))
    if wrong == WRONGS[0]:
        return replace(recipe, length=recipe.length * (1 + 0.01 * sign)).structure()
    if wrong == WRONGS[1]:
        return recipe.structure({"youngs_modulus": 1 + 0.05 * sign})
    if wrong == WRONGS[4]:
        return replace(recipe, length=recipe.length * 1.02).structure()
    plain = recipe.structure()
    if wrong == WRONGS[6]:
        return plain
    stiffness, mass = plain.stiffness.copy(), plain.mass.copy()
    at = plain.index(("11:y" if wrong == WRONGS[5] else "6:y",))[0]
    if wrong == WRONGS[2]:
        stiffness[at, at] += np.exp(rng.uniform(np.log(3e4), np.log(3e5)))
    else:
        mass[at, at] += 0.010 if wrong == WRONGS[5] else 0.020
    return replace(plain, stiffness=stiffness, mass=mass)


def table(outcomes: Sequence[Outcome]) -> str:
    """Markdown table, one row for each kind of wrongness."""
    lines = [
        "| Wrong | Data sets | Said to be explained | All three held by the FRFs | k22 | All three held by the modes "
        "| k22 | Upper/lower of k22, modes | Identified and outside 99.9 % |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for wrong in WRONGS:
        rows = [one for one in outcomes if one.wrong == wrong]
        if not rows:
            continue
        held = [
            count
            for answer in ("frfs", "modes")
            for count in (
                sum(len(getattr(one, answer)) == len(TABLE_3) for one in rows),
                sum("k22" in getattr(one, answer) for one in rows),
            )
        ]
        width, false = f"{np.median([one.width for one in rows]):.2f}", sum(bool(one.false) for one in rows)
        cells = (len(rows), sum(one.explains for one in rows), *held, width, false)
        lines.append(f"| {wrong} | {' | '.join(map(str, cells))} |")
    where = environment()
    lines += ["", f"{where['date']}, {where['cpu']}, Python {where['python']}, one core."]
    return "\n".join(lines)


def main() -> None:
    """Run what is not yet kept, and print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=15, help="data sets of each of seven kinds; default 15")
    parser.add_argument("--pilot", action="store_true", help="print only: leave the page as it is")
    options = parser.parse_args()
    tuples = ("frfs", "modes", "false")
    kept = kept_lines(KEPT, "wrong model, 3")
    outcomes = [Outcome(**{**line, **{name: tuple(line[name]) for name in tuples}}) for line in kept]
    done = {(one.wrong, one.index) for one in outcomes}
    for index in range(1, options.sets + 1):
        for wrong in WRONGS:
            if (wrong, index) in done:
                continue
            outcome = analyse(wrong, index)
            with KEPT.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(outcome)) + "\n")
            print(outcome, flush=True)
            outcomes.append(outcome)
    print(table(outcomes), flush=True)
    if not options.pilot:
        write_between(PAGE, "wrong_model.py", table(outcomes))


if __name__ == "__main__":
    main()
