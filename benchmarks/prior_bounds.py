"""Verdicts where the true joint lies outside its prior: `python -m benchmarks.prior_bounds`.

The main case with truth 10 and 100 times beyond each bound, once by moving the truth and once by moving the bound, from
the tip alone and with mid-span. A stiffness whose truth its prior excludes must never be called identified.
"""

import argparse
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import jointbayes as jb
from jointbayes.case.case import case_from_text
from jointbayes.errors import JointBayesError
from jointbayes.posterior.verdicts import lines_of

CASE = Path("configs/clamped_beam.toml")
OUTPUTS = {"tip": '["11:y"]', "tip and mid-span": '["11:y", "6:y"]'}
FACTORS = (10.0, 100.0)
#: Where no joint of the prior comes near the data, walkers stay in many places; such a run need not be waited for.
SETTINGS = jb.SamplerSettings(max_steps=1000)
_STIFFEST = 1e15  # the limit of a case file
_COUPLING = 0.39  # of Table 3: k12/√(k11 k22)


@dataclass(frozen=True, slots=True)
class OutsideCase:
    """A case whose truth one bound of one prior excludes: its name, the stiffness, and the case file's text."""

    name: str
    stiffness: str
    text: str


def outside_cases(outputs: str, coarse: bool = True) -> Iterator[OutsideCase]:
    """Cases for one set of measured DOFs, truth moved first, then bounds moved; `coarse` takes every fourth line."""
    text = CASE.read_text(encoding="utf-8").replace('outputs = ["11:y"]', f"outputs = {OUTPUTS[outputs]}", 1)
    if coarse:
        text = text.replace("f_step_hz = 1.0", "f_step_hz = 4.0", 1)
    numbers = tomllib.loads(text)
    truth, prior = numbers["data"]["truth"], numbers["prior"]
    for name in ("k11", "k12", "k22"):
        for side, factor in ((side, factor) for side in ("low", "high") for factor in FACTORS):
            shift = factor if side == "high" else 1 / factor
            label = f"{name} {factor:g} times {'above' if side == 'high' else 'below'}"
            if (name, side) != ("k12", "high"):  # no such joint: k12² would exceed k11·k22
                moved = truth | {name: prior[name][side] * shift}
                if name != "k12":
                    moved["k12"] = min(moved["k12"], _COUPLING * float(np.sqrt(moved["k11"] * moved["k22"])))
                yield OutsideCase(f"{outputs}, truth {label}", name, _with(text, "[data.truth]", moved))
            if (name, side, factor) == ("k12", "low", FACTORS[-1]):
                continue  # no such prior: it would leave hardly a positive definite joint
            by = truth[name] / shift / prior[name][side]  # both bounds move: as many decades lie between them
            bounds = {end: min(by * prior[name][end], _STIFFEST) for end in ("low", "high")}
            yield OutsideCase(f"{outputs}, bound {label}", name, _with(text, f"[prior.{name}]", bounds))


def _with(text: str, table: str, numbers: dict[str, float]) -> str:
    """The case file with other numbers in one of its tables."""
    head, tail = text.split(f"\n{table}", 1)
    for name, value in numbers.items():
        before, after = tail.split(f"\n{name} = ", 1)
        tail = f"{before}\n{name} = {value!r} #{after}"
    return f"{head}\n{table}{tail}"


def main() -> None:
    """Print the verdict of every case, and how many are wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fine", action="store_true", help="all lines of the case, not every fourth")
    arguments = parser.parse_args()
    wrong = count = 0
    for outputs in OUTPUTS:
        for one in outside_cases(outputs, coarse=not arguments.fine):
            count += 1
            try:
                posterior = jb.sample(case_from_text(one.name, one.text), settings=SETTINGS)
            except JointBayesError as error:
                print(f"{one.name}: refused: {error}", flush=True)
                continue
            wrong += posterior.verdict(one.stiffness).verdict in ("identified", "weakly identified")
            print(f"{one.name}:", *lines_of(one.stiffness, posterior.verdict(one.stiffness)), flush=True)
    print(f"{wrong} of {count} call a stiffness identified that its prior excludes")


if __name__ == "__main__":
    main()
