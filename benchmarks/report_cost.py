"""CPU of `jointbayes run` and of `jointbayes report` on its draws, each in a process of its own, in turn.

    python -m benchmarks.report_cost [CASE] [--rounds N]

Beside them stand the imports that any program of this kind has, and the ratios, round by round. The first round fills
caches of compiled code and is not counted.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

_IMPORTS = "import numpy, scipy.stats, matplotlib.pyplot"
_RATIOS = (("report", "run"), ("run", "imports"), ("report", "imports"))


def cpu_seconds(*arguments: str) -> float:
    """CPU of a fresh Python with these arguments, user and system."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, env=os.environ | one_thread)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print medians and ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", nargs="?", default="configs/clamped_beam.toml")
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        first, again = (str(Path(directory) / name) for name in ("run", "report"))
        commands = {
            "imports": ("-c", _IMPORTS),
            "run": ("-m", "jointbayes", "run", asked.case, "--out", first, "--quiet"),
            "report": ("-m", "jointbayes", "report", first, "--out", again, "--quiet"),
        }
        rounds = [{name: cpu_seconds(*command) for name, command in commands.items()} for _ in range(asked.rounds + 1)]
    median = {name: statistics.median(each[name] for each in rounds[1:]) for name in commands}
    shares = {f"{name} / {over}": [each[name] / each[over] for each in rounds[1:]] for name, over in _RATIOS}
    for name, seconds in median.items():
        print(f"{name:16} {seconds:6.2f} s of CPU, median of {asked.rounds}")
    for name, values in shares.items():
        print(f"{name:16} {statistics.median(values):6.2f}   ({min(values):.2f} to {max(values):.2f})")


if __name__ == "__main__":
    main()
