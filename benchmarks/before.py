"""Is the main case as fast as it was? Another copy of the package and this one, in turn: `--before PATH`.

    git worktree add ../before COMMIT
    python -m benchmarks.before --before ../before

Each copy has a process of its own, which waits while the other one works; a round times both. Times are of the
processor, so that a busy machine does not count.
"""

import argparse
import os
import statistics
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

#: What a process does: reads what to time, prints a figure, the more the better.
_WORKER = """
import sys, time
from pathlib import Path
import numpy as np
import jointbayes as jb
assert Path(jb.__file__).is_relative_to(Path(sys.argv[1]).resolve()), jb.__file__
case = jb.load_case(Path(sys.argv[1]) / "configs" / "clamped_beam.toml")
density = case.problem.log_posterior
theta = np.log([5.05e9, 3.44e7, 1.52e6]) + 0.01 * np.random.default_rng(0).normal(size=(64, 3))
def likelihoods():
    for _ in range(2000):
        density(theta)
    return 2000 * len(theta)
def draws():
    return min(jb.sample(case, seed=1).record.sampler["ess"].values())
density(theta)
for line in sys.stdin:
    began = time.process_time()
    count = {"likelihoods": likelihoods, "draws": draws}[line.strip()]()
    print(count / (time.process_time() - began), flush=True)
"""


class Copy:
    """A copy of the package in a process of its own."""

    def __init__(self, root: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(root / "src"), "OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-c", _WORKER, str(root)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=root,
            env=environment,
        )

    def per_second(self, what: str) -> float:
        """Likelihoods, or effective draws, a second."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(what + "\n")
        self._process.stdin.flush()
        return float(self._process.stdout.readline())

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def ratios(before: Path, rounds: int) -> dict[str, tuple[float, float, float]]:
    """Median per second before and now, and the median ratio of now to before, of likelihoods and draws."""
    copies = [Copy(before.resolve()), Copy(ROOT)]
    found = {}
    for what in ("likelihoods", "draws"):
        for copy in copies:
            copy.per_second(what)  # compiles, and fills caches
        pairs = []
        for number in range(rounds):
            order = copies if number % 2 == 0 else copies[::-1]
            values = {id(copy): copy.per_second(what) for copy in order}
            pairs.append([values[id(copy)] for copy in copies])
        then, now = (statistics.median(column) for column in zip(*pairs, strict=True))
        found[what] = then, now, statistics.median(b / a for a, b in pairs)
    for copy in copies:
        copy.close()
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, required=True, help="root of the other copy")
    parser.add_argument("--rounds", type=int, default=11, help="default 11")
    parser.add_argument("--least", type=float, default=0.95, help="ratio that is asked for; default 0.95")
    options = parser.parse_args()
    found = ratios(options.before, options.rounds)
    for what, (then, now, ratio) in found.items():
        print(f"{what} a second of the processor: {then:.4g} before, {now:.4g} now, ratio {ratio:.3f}")
    sys.exit(not all(ratio >= options.least for *_, ratio in found.values()))


if __name__ == "__main__":
    main()
