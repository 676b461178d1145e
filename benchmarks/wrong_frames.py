"""What a wrong model of a frame does to the answer by modes: `python -m benchmarks.wrong_frames`.

Frames of a column and an arm on four springs, `benchmarks.random_frames`, whose FRFs are exact, without a mesh and
without the package: right, with a modulus 5 % or 20 % off, members 1 % or 5 % longer, or a spring to ground at the
middle of the arm that the model lacks. Each is analysed as measured FRFs are: by their modes, with the usual error of
the model, modulus and density uncertain as in a workshop. Counted, of all springs: how many the printed 95 % interval
holds, how many lie outside the 99.9 % interval of the draws, and what light stood there.

Outcomes are kept in build/wrong_frames.jsonl as they come; the table goes to docs/wrong-model.md.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np

import jointbayes as jb
from benchmarks import random_frames
from benchmarks.coverage import write_between
from benchmarks.page import table
from benchmarks.random_frames import NOISE, Frame, Spring
from benchmarks.record import ROOT, environment, kept_lines
from benchmarks.wrong_model import judged
from vibrecords import FrfData, FrfSet

KEPT = ROOT / "build" / "wrong_frames.jsonl"
PAGE = ROOT / "docs" / "wrong-model.md"
#: Parts by which modulus and lengths are more than stated, and a spring at the middle of the arm, N/m.
WRONGS = {
    "nothing": (0.0, 0.0, 0.0),
    "Young's modulus 5 % off": (0.05, 0.0, 0.0),
    "members 1 % longer": (0.0, 0.01, 0.0),
    "a spring to ground missed": (0.0, 0.0, 3e5),
    "Young's modulus 20 % off": (0.20, 0.0, 0.0),
    "members 5 % longer": (0.0, 0.05, 0.0),
}
_SPRINGS = 5  # every so many frames has four springs
_UNCERTAIN = "\n[uncertain.youngs_modulus]\nsd_percent = 3.0\n[uncertain.density]\nsd_percent = 1.0\n"


def measured(wrong: str, frame: Frame, frequency_hz: np.ndarray, seed: int) -> FrfData:
    """FRFs of the frame as it is, with their noise."""
    stiffer, longer, spring = WRONGS[wrong]
    true = Frame(frame.seed)
    true.points = {name: ((1 + longer) * x, (1 + longer) * y) for name, (x, y) in true.points.items()}
    if spring:
        middle = true.outputs[1].split(":")[0]
        true.springs.append(Spring("hidden", "y", f"{middle}:y"))
        true.stiffness = np.append(true.stiffness, spring)
    with mock.patch.object(random_frames, "YOUNGS_MODULUS", (1 + stiffer) * random_frames.YOUNGS_MODULUS):
        exact = true.receptance(frequency_hz)
    sd, rng = NOISE * np.abs(exact), np.random.default_rng([seed, 77])
    values = exact + sd * (rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape))
    return FrfData(FrfSet(frequency_hz, values, true.outputs, (true.input,), "receptance"), 2 * sd**2)


def analyse(wrong: str, index: int) -> dict[str, Any]:
    """What one analysis said of the four springs."""
    began, frame = time.process_time(), Frame(_SPRINGS * index)
    case = jb.case_from_text("wrong frame", frame.case().text + _UNCERTAIN)
    lines = case.problem.test.data.frfs
    assert lines is not None
    data = measured(wrong, frame, lines.frf.frequency_hz, index)
    problem = case.problem.with_test(data=data)
    posterior = jb.sample(replace(case, problem=problem, stated=problem, tests=()), seed=index)
    held, outside, identified = map(len, judged(posterior, frame.stiffness))
    grade = "none" if posterior.model_error is None else posterior.model_error.grade
    counts = {"springs": len(frame.stiffness), "held": held, "outside": outside, "identified": identified}
    seconds = time.process_time() - began
    return {"wrong": wrong, "index": index, **counts, "grade": grade, "seconds": seconds}


def section(rows: Sequence[dict[str, Any]]) -> str:
    """The table, one row for each kind of wrongness."""
    lines = []
    for wrong in WRONGS:
        some = [row for row in rows if row["wrong"] == wrong]
        if some:
            warned = [row["grade"] in ("large", "impossible") for row in some]
            out = [row["outside"] > 0 for row in some]
            sums = [sum(row[key] for row in some) for key in ("springs", "held", "outside", "identified")]
            both = sum(w and o for w, o in zip(warned, out, strict=True))
            lines.append((wrong, *map(str, (len(some), *sums[:3], f"{both} of {sum(out)}", sums[3], sum(warned)))))
    head = (
        *("Wrong", "Frames", "Springs", "held at 95 %", "outside 99.9 %", "amber or red where any is outside"),
        *("identified and outside", "Amber or red of all frames"),
    )
    where = environment()
    return "\n".join([*table(head, lines), "", f"{where['date']}, {where['cpu']}, Python {where['python']}, one core."])


def main() -> None:
    """Run what is not yet kept, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=10, help="frames of each kind; default 10")
    rows = kept_lines(KEPT, "wrong frames, 1")
    done = {(row["wrong"], row["index"]) for row in rows}
    for index in range(1, parser.parse_args().sets + 1):
        for wrong in WRONGS:
            if (wrong, index) in done:
                continue
            rows.append(analyse(wrong, index))
            with KEPT.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
            print(rows[-1], flush=True)
    write_between(PAGE, "wrong_frames.py", section(rows))


if __name__ == "__main__":
    main()
