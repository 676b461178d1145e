"""Does every kind of run end with a report, and how soon? `python -m benchmarks.every_kind --count 2`.

Joints, structures and slips of ten kinds, as FRFs and as natural frequencies: each data set is made by
`benchmarks.exact_beam`, which has no mesh and shares no code with the package, written to a file, and analysed by
`jointbayes run` in a process of its own, with nothing stated of modulus, density, length and damping. Counted: exit
status, whether there is a report, and processor time over that of the main case, which runs before each twenty. What
was done is kept in build/every_kind.jsonl, so that a study that was cut off goes on where it was; the table goes to
docs/run-times.md.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.coverage import write_between
from benchmarks.exact_beam import ExactBeam, rectangle
from benchmarks.page import table
from benchmarks.record import ROOT, environment, kept_lines

Array = NDArray[np.float64]
KEPT = ROOT / "build" / "every_kind.jsonl"
PAGE = ROOT / "docs" / "run-times.md"
MAIN = ROOT / "configs" / "clamped_beam.toml"
LONGEST_S = 600  # of wall time, after which a run is stopped and counts as one without an end

LENGTH, WIDTH, HEIGHT, LOSS = 0.3, 0.03, 0.016, 0.01
STEEL = 2.1e11, 0.3, 7850.0
#: Stiffnesses ky, krz of the truth, drawn between these; k12 where the joint is coupled.
JOINTS = {
    "usual": ((2e7, 2e4), (5e8, 2.5e5)),
    "soft": ((1e5, 1e2), (1e6, 1e3)),
    "stiff": ((1e10, 1e7), (1e11, 1e8)),
    "free": ((1.0, 1e-3), (10.0, 1e-2)),
}
#: Of each kind: joint of the truth, parts by which length and modulus are more than stated, and joint of the case.
KINDS = {
    "usual": ("usual", 0.0, 0.0, "springs"),
    "soft": ("soft", 0.0, 0.0, "springs"),
    "stiff": ("stiff", 0.0, 0.0, "springs"),
    "free": ("free", 0.0, 0.0, "springs"),
    "coupled": ("usual", 0.0, 0.0, "coupled"),
    "signed": ("usual", 0.0, 0.0, "signed"),
    "length 1 % off": ("usual", 0.01, 0.0, "springs"),
    "length 5 % off": ("usual", 0.05, 0.0, "springs"),
    "modulus 20 % off": ("usual", 0.0, 0.2, "springs"),
    "two sensors": ("usual", 0.0, 0.0, "springs"),
}
#: Analysed as FRFs and as natural frequencies.
FORMS = ("FRFs", "frequencies")
_JOINT = {
    "springs": 'joint = { kind = "springs", dofs = ["1:y", "1:rz"] }',
    "coupled": 'joint = { dofs = ["1:y", "1:rz"] }',
    "signed": 'joint = { dofs = ["1:y", "1:rz"], parametrisation = "signed" }',
}
_CASE = """title = "{title}"
structure = {{ length_mm = {length_mm}, section = {{ shape = "rectangle", width_mm = 30.0, height_mm = 16.0 }}, \
youngs_modulus_gpa = 210.0, density_kg_m3 = 7850.0, damping = {{ law = "loss_factor", loss_factor = {loss} }} }}
{joint}
"""


def case_of(kind: str, form: str, index: int, folder: Path) -> Path:
    """Write the case of one data set, and its files."""
    joint, longer, stiffer, model = KINDS[kind]
    rng = np.random.default_rng([list(KINDS).index(kind), FORMS.index(form), index])
    ky, krz = np.exp(rng.uniform(*np.log(JOINTS[joint])))
    k12 = 0.3 * np.sqrt(ky * krz) if model == "coupled" else 0.0
    length, modulus = LENGTH * (1 + longer), STEEL[0] * (1 + stiffer)
    points = {1: 0.0, 6: length / 2, 11: length}
    beam = ExactBeam(
        length, rectangle(WIDTH, HEIGHT, STEEL[1]), modulus, *STEEL[1:], points, (float(ky), float(k12), float(krz))
    )
    text = _CASE.format(title=f"{kind}, {form} {index}", length_mm=1e3 * LENGTH, loss=LOSS, joint=_JOINT[model])
    if form == "FRFs":
        dofs = ("11:y", "6:y") if kind == "two sensors" else ("11:y",)
        lines = np.arange(20.0, 4001.0, 4.0)
        exact = beam.receptance(lines, dofs, ("11:y",), loss_factor=LOSS)[:, :, 0]
        accelerance = -((2 * np.pi * lines[:, None]) ** 2) * exact
        noise = rng.standard_normal((2, *exact.shape))
        measured = accelerance * (1 + 0.02 / np.sqrt(2) * (noise[0] + 1j * noise[1]))
        np.savez(folder / "frf.npz", frequency_hz=lines, frf=measured, outputs=list(dofs), inputs=["hammer"])
        channels = ", ".join(f'"{dof}" = "{dof}"' for dof in dofs)
        text += (
            f'data = {{ kind = "measured_frf", file = "frf.npz", quantity = "accelerance", '
            f'channels = {{ {channels}, hammer = "11:y" }}, '
            "variance = { source = 'relative', relative = 0.02, floor = 0.001 } }\n"
        )
    else:
        omega = beam.modes(12e3).omega
        hz = omega[omega > 50.0][:4] / (2 * np.pi) * (1 + 1e-3 * rng.standard_normal(4))
        listed = ", ".join(f"{f:.6g}" for f in hz)
        text += f'data = {{ kind = "natural_frequencies", frequencies_hz = [{listed}], sd_relative = 0.001 }}\n'
    file = folder / "case.toml"
    file.write_text(text, encoding="utf-8")
    return file


def run(case: Path, out: Path) -> tuple[int | None, float]:
    """Exit status of `jointbayes run`, None where it was stopped, and its processor time, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    alone = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "jointbayes", "run", str(case), "--out", str(out)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    try:
        status = subprocess.run(command, env=alone, timeout=LONGEST_S, check=False, **quiet).returncode  # type: ignore[call-overload]
    except subprocess.TimeoutExpired:
        status = None
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return status, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def outcome(kind: str, form: str, index: int) -> dict[str, Any]:
    """What became of one run: status, whether it left a report, its processor time."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        status, seconds = run(case_of(kind, form, index, folder), folder / "out")
        report = (folder / "out" / "report.html").is_file()
    return {"kind": kind, "form": form, "index": index, "status": status, "report": report, "seconds": seconds}


def section(rows: Sequence[dict[str, Any]]) -> str:
    """The table of all kinds, and what holds for all."""
    main = statistics.median(row["seconds"] for row in rows if row["kind"] == "main case")
    runs, lines = [row for row in rows if row["kind"] != "main case"], []
    for kind in KINDS:
        some = {form: [row for row in runs if (row["kind"], row["form"]) == (kind, form)] for form in FORMS}
        if any(some.values()):
            lines.append((kind, *(_figures(rows, main) for rows in some.values())))
    ratios = np.array([row["seconds"] / main for row in runs])
    whole = (
        f"Of {len(runs)} runs {sum(row['report'] for row in runs)} left a report; {int((ratios <= 2).sum())} took at "
        f"most 2 times, {int((ratios <= 4).sum())} at most 4 times the processor time of the main case, {main:.1f} s."
    )
    where = environment()
    head = ("kind", *(f"{form}: median, longest; reports of runs" for form in FORMS))
    return "\n".join([*table(head, lines), "", f"{whole} {where['date']}, {where['cpu']}, Python {where['python']}."])


def _figures(rows: Sequence[dict[str, Any]], main: float) -> str:
    """Times over that of the main case, and how many runs ended with a report."""
    if not rows:
        return "–"
    times = [row["seconds"] / main for row in rows]
    ended = sum(row["report"] and row["status"] in (0, 3) for row in rows)
    return f"{statistics.median(times):.2f}, {max(times):.2f}; {ended} of {len(rows)}"


def main() -> None:
    """Make what is missing of so many data sets a kind, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10, help="data sets of each kind and form")
    count = parser.parse_args().count
    rows = kept_lines(KEPT, "every kind, 1")
    done = {(row["kind"], row["form"], row["index"]) for row in rows}
    for index in range(count):
        wanted = [("main case", "", index), *((kind, form, index) for kind in KINDS for form in FORMS)]
        for kind, form, number in wanted:
            if (kind, form, number) in done:
                continue
            began = time.perf_counter()
            if kind == "main case":
                with tempfile.TemporaryDirectory() as place:
                    status, seconds = run(MAIN, Path(place) / "out")
                row = {
                    "kind": kind,
                    "form": form,
                    "index": number,
                    "status": status,
                    "report": True,
                    "seconds": seconds,
                }
            else:
                row = outcome(kind, form, number)
            rows.append(row)
            with KEPT.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            print(f"{json.dumps(row)} ({time.perf_counter() - began:.0f} s)", flush=True)
    write_between(PAGE, "every_kind.py", section(rows))


if __name__ == "__main__":
    main()
