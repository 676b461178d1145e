"""CPU time of `run` on few measured frequencies, over that of the main case: `python -m benchmarks.small_data`.

Each case is a process of its own, from the case file to the report, as a user starts it; the main case runs first and
last. About two minutes of CPU. `--portal` adds the portal frame of twelve unknowns, a minute more.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.record import ROOT, add_options, keep

MAIN = "clamped_beam"
SHIPPED = ("clamped_beam_frequencies", "clamped_beam_frequencies_360mm", "two_storeys")

_CLAMP = """title = "One clamp at two overhangs, one natural frequency each"
[structure]
kind = "beam"
length_mm = 383.0
elements = 10
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = { shape = "circle", diameter_mm = 25.0 }
damping = { law = "modal", ratio = 0.01 }
[joint]
JOINT
[data]
kind = "natural_frequencies"
sd_relative = 0.005
sd_hz = 0.5
[tests.long.data]
frequencies_hz = [120.0]
[tests.short.structure]
length_mm = 200.0
[tests.short.data]
frequencies_hz = [415.0]
"""
_STRIP = """title = "A clamped strip as a plane frame, three natural frequencies"
[structure]
kind = "frame"
directions = ["x", "y", "rz"]
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = { shape = "rectangle", width_mm = 20.0, height_mm = 1.0 }
members = [{ points = ["root", "tip"] }]
points = { root = [0, 0, 0], tip = [200, 0, 0] }
damping = { law = "loss_factor", loss_factor = 0.01 }
[joint]
kind = "springs"
dofs = ["root:x", "root:y", "root:rz"]
[data]
kind = "natural_frequencies"
frequencies_hz = [20.3, 127.5, 357.0]
sd_relative = 0.01
sd_hz = 0.5
"""
_LENGTH = "[uncertain.length]\nsd_mm = 0.5\n"

_TWICE = _CLAMP.replace("[120.0]", "[120.0, 762.0]").replace("[415.0]", "[415.0, 2560.0]")

#: Case texts by name.
CASES = {
    "two overhangs, two frequencies each": _TWICE.replace("JOINT", 'dofs = ["1:y", "1:rz"]')
    + "[uncertain.model_error]\n",
    "two overhangs, two springs": _CLAMP.replace("JOINT", 'kind = "springs"\ndofs = ["1:y", "1:rz"]'),
    "two overhangs, k11 k12 k22": _CLAMP.replace("JOINT", 'dofs = ["1:y", "1:rz"]'),
    "strip as a frame": _STRIP,
    "strip as a frame, uncertain length": _STRIP + _LENGTH,
}


def cpu_of_run(case: Path, out: Path) -> float:
    """Seconds of CPU, user and system, of `jointbayes run` on a case, in a process of its own."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    quiet = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "jointbayes", "run", str(case), "--out", str(out)]
    subprocess.run(command, env=quiet, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Time the cases and keep the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    parser.add_argument("--portal", action="store_true", help="the portal frame of twelve unknowns too")
    options = parser.parse_args()
    seconds: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        cases = {name: ROOT / "configs" / f"{name}.toml" for name in (MAIN, *SHIPPED)}
        for i, (name, text) in enumerate(list(CASES.items())[: 1 if options.quick else None]):
            cases[name] = here / f"case_{i}.toml"
            cases[name].write_text(text, encoding="utf-8")
        if options.portal:
            cases["portal_frame"] = ROOT / "configs" / "portal_frame.toml"
        cpu_of_run(cases[MAIN], here / "first")  # which may compile
        for i, name in enumerate((*cases, MAIN)):
            seconds.setdefault(name, []).append(cpu_of_run(cases[name], here / f"run-{i}"))
            print(f"{name}: {seconds[name][-1]:.1f} s of CPU", flush=True)
    least = statistics.mean(seconds[MAIN])
    rows = {name: {"cpu_s": min(each), "ratio": statistics.mean(each) / least} for name, each in seconds.items()}
    for name, row in rows.items():
        print(f"{name:40} {row['ratio']:.2f} times the main case")
    keep("small_data", {"cases": rows}, options)


if __name__ == "__main__":
    main()
