"""Verdicts on a wrong model: `python -m benchmarks.wrong_verdicts --sets 5`.

Data of a beam that is not the one analysed: its length 1 % off, its modulus 5 % off either way, a soft spring at
mid-span that the model lacks; with 3 and 10 % noise; seen at the tip alone, of a joint of two springs to 500 Hz or of
the paper's joint to 2500 Hz. Nothing is admitted. Counted: stiffnesses that are called identified without any condition
(the model explains the data, and with material, length and damping uncertain as in a workshop hardly less is known)
while the truth lies outside the 99.9 % interval. There may be none.

Outcomes are kept in build/wrong_verdicts.jsonl as they come, so that a study that was cut off goes on where it was.
"""

import argparse
import json
import re
import time
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

import jointbayes as jb
from benchmarks.record import kept_lines
from jointbayes.case.case_objects import recipe_of
from jointbayes.case.case_text import read_case_text
from jointbayes.frf import Ports, synthesise_frf
from jointbayes.posterior import gather_knowledge
from jointbayes.structure import Structure
from vibrecords import RelativeNoise

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "build" / "wrong_verdicts.jsonl"
WRONGS = ("length 1 % off", "Young's modulus 5 % off", "a joint missed")
NOISES = (0.03, 0.10)
#: Highest frequency, Hz, with the true joint.
BANDS = {"to 500 Hz": {"ky": 3.0e7, "krz": 5.0e4}, "to 2500 Hz": {"k11": 5.05e9, "k12": 3.44e7, "k22": 1.52e6}}
_SPRINGS = """[joint]
kind = "springs"
dofs = ["1:y", "1:rz"]

[prior]
ky = { distribution = "log_uniform", low = 1e4, high = 1e11 }
krz = { distribution = "log_uniform", low = 1e2, high = 1e8 }

"""


@dataclass(frozen=True)
class Outcome:
    """What one analysis said; `false` are stiffnesses called identified without condition, the truth far outside."""

    wrong: str
    noise: float
    band: str
    index: int
    converged: bool
    explains: bool
    verdicts: dict[str, str]
    missed: tuple[str, ...]
    false: tuple[str, ...]
    seconds: float


def case_of(band: str) -> jb.Case:
    """The case that is analysed, with data that are put in place later."""
    text = read_case_text(ROOT / "configs" / "clamped_beam.toml").text
    text = re.sub(r"(?m)^f_step_hz = \S+", "f_step_hz = 2.0", text)
    if band == "to 500 Hz":
        text = re.sub(r"(?m)^f_max_hz = \S+", "f_max_hz = 500.0", text)
        text = re.sub(r"(?sm)^\[joint\][^\n]*\n.*?(?=^\[data\])", lambda _: _SPRINGS, text)
        text = re.sub(r"(?sm)^\[reference\][^\n]*\n.*?(?=\n\[|\Z)", "", text)
        truth = "".join(f"{name} = {value}\n" for name, value in BANDS[band].items())
        text = re.sub(r"(?sm)^\[data\.truth\][^\n]*\n.*?(?=\n\[)", lambda _: f"[data.truth.stiffness]\n{truth}", text)
    return jb.case_from_text("wrong", text)


def _structure(case: jb.Case, wrong: str, rng: np.random.Generator) -> Structure:
    """The structure that makes the data."""
    recipe, sign = recipe_of(case.spec.structure, case.spec.data), float(rng.choice([-1.0, 1.0]))
    if wrong == WRONGS[0]:
        return replace(recipe, length=recipe.length * (1 + 0.01 * sign)).structure()
    if wrong == WRONGS[1]:
        return recipe.structure({"youngs_modulus": 1 + 0.05 * sign})
    plain = recipe.structure()
    stiffness = plain.stiffness.copy()
    at = plain.index(("6:y",))[0]
    stiffness[at, at] += np.exp(rng.uniform(np.log(3e4), np.log(3e5)))
    return replace(plain, stiffness=stiffness)


def analyse(
    wrong: str, noise: float, band: str, index: int, settings: jb.SamplerSettings | None = None
) -> tuple[Outcome, jb.Posterior]:
    """Make a data set of a wrong structure, analyse it, and ask what the verdicts rest on."""
    began = time.process_time()
    case = case_of(band)
    rng = np.random.default_rng([WRONGS.index(wrong), NOISES.index(noise), list(BANDS).index(band), index])
    truth = BANDS[band]
    true, problem, measured = _structure(case, wrong, rng), case.problem, case.problem.test.data
    ports = Ports(measured.frf.frequency_hz, measured.frf.outputs, measured.frf.inputs)
    matrix = problem.parametrisation.matrix(np.array(list(truth.values())))
    data = synthesise_frf(true, problem.test.joints, matrix, ports, RelativeNoise(noise, noise / 3), rng=rng)
    # the case as if its text stated these data, so that it also states the workshop's uncertainties for them
    (test,) = case.tests
    made = problem.with_test(data=data)
    case = replace(case, problem=made, stated=made, tests=(replace(test, data=data),))
    posterior = jb.sample(case, seed=index, settings=settings or case.sampler)
    exact = gather_knowledge(posterior).exact
    known = {name: posterior.verdict(name) for name in truth}
    missed = []
    for name, value in truth.items():
        low, high = posterior.interval(name, 0.999)
        missed += [] if low <= value <= high else [name]
    unconditional = [
        name
        for name, one in known.items()
        if one.verdict == "identified" and not one.if_model_right and name not in exact
    ]
    verdicts = {name: one.verdict + (exact[name].condition if name in exact else "") for name, one in known.items()}
    return Outcome(
        wrong,
        noise,
        band,
        index,
        posterior.converged,
        posterior.check.explains,
        verdicts,
        tuple(missed),
        tuple(name for name in unconditional if name in missed),
        time.process_time() - began,
    ), posterior


def table(outcomes: list[Outcome]) -> str:
    """Markdown table, one row for each kind of wrongness, noise and band."""
    lines = [
        "| Wrong | Noise | Tip FRF | Data sets | Said to be explained | Truth outside 99.9 %, any stiffness "
        "| Called identified without condition and outside |",
        "|---|---|---|---|---|---|---|",
    ]
    for wrong, noise, band in product(WRONGS, NOISES, BANDS):
        rows = [one for one in outcomes if (one.wrong, one.noise, one.band) == (wrong, noise, band)]
        counts = (len(rows), *(sum(bool(getattr(r, name)) for r in rows) for name in ("explains", "missed", "false")))
        lines.append(f"| {wrong} | {100 * noise:g} % | {band} | {' | '.join(map(str, counts))} |")
    return "\n".join(lines)


def main() -> None:
    """Run what is not yet kept, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=5, help="data sets of each of twelve kinds; default 5")
    options = parser.parse_args()
    outcomes = [
        Outcome(**{**line, "missed": tuple(line["missed"]), "false": tuple(line["false"])})
        for line in kept_lines(KEPT, "wrong verdicts, 1")
    ]
    done = {(one.wrong, one.noise, one.band, one.index) for one in outcomes}
    for index in range(1, options.sets + 1):
        for wrong, noise, band in product(WRONGS, NOISES, BANDS):
            if (wrong, noise, band, index) in done:
                continue
            outcome, _ = analyse(wrong, noise, band, index)
            with KEPT.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(outcome)) + "\n")
            print(outcome, flush=True)
            outcomes.append(outcome)
    print(table(outcomes), flush=True)


if __name__ == "__main__":
    main()
