"""What commands cost: CPU of `run` and of `report` on its draws, and seconds to the first line.

`python -m benchmarks.commands [CASE...]`, by default the two cases that README shows; processes one after the other.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.numbers import ROOT

MAIN = "from jointbayes.cli.commands import main; main()"
SHOWN = ("clamped_beam", "clamped_beam_uncertain")


def cost(folder: Path, *arguments: str) -> tuple[float, float]:
    """Seconds of CPU of a command, and seconds until its first line."""
    begun, before = time.perf_counter(), os.times()
    process = subprocess.Popen(
        [sys.executable, "-c", MAIN, *arguments],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    process.stderr.readline()
    first = time.perf_counter() - begun
    process.communicate()
    if process.returncode not in (0, 3):
        raise SystemExit(f"{' '.join(arguments)}: exit {process.returncode}")
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system, first


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", default=SHOWN)
    for name in parser.parse_args().cases:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            run, first = cost(folder, "run", str(ROOT / "configs" / f"{name}.toml"), "--out", "out")
            report, first_of_report = cost(folder, "report", "out/posterior.nc", "--out", "again")
            identify, _ = cost(folder, "identify", str(ROOT / "configs" / f"{name}.toml"))
        print(f"{name}: run {run:.1f} s of CPU, report {report:.1f} s ({report / run:.2f} of it)")
        print(f"  identify {identify:.1f} s of CPU")
        print(f"  first line of run after {first:.2f} s, of report after {first_of_report:.2f} s")


if __name__ == "__main__":
    main()
