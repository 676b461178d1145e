"""What each noise model costs on given residuals, and how it grows with lines: `python -m benchmarks.noise`."""

import argparse
import os

import numpy as np

from benchmarks.timing import Contestant, interleaved, log_log_slope
from jointbayes.inference import GaussianNoise, IntegratedScale, NoiseModel, ScaledNoise, StudentNoise

BATCH = 64
LINES = (1250, 5000, 20000)
#: Each model with typical values of its hyperparameters.
MODELS: dict[str, tuple[NoiseModel, tuple[float, ...]]] = {
    "Gaussian": (GaussianNoise(2), ()),
    "noise scale": (ScaledNoise(2), (1.1,)),
    "noise scale, integrated out": (IntegratedScale(2), ()),
    "Student-t": (StudentNoise(2, 4.0), ()),
}


def contestants(lines: int, batch: int) -> dict[str, Contestant]:
    """The likelihood of a batch of residuals by each model."""
    rng = np.random.default_rng(2)
    z = (rng.standard_normal((batch, lines, 1)) + 1j * rng.standard_normal((batch, lines, 1))) / np.sqrt(2)
    entries = {}
    for name, (model, hyper) in MODELS.items():
        rows = np.tile(np.array(hyper), (batch, 1))
        entries[name] = Contestant(lambda m=model, h=rows: m.log_likelihood(z, h), batch)
    return entries


def main() -> None:
    """Print the table of docs/noise.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few rounds, to try the script")
    # the least, since this is no comparison within a round and other work only ever adds
    rounds = 2 if parser.parse_args().quick else 25
    times = [interleaved(contestants(n, BATCH if n < LINES[-1] else 8), rounds) for n in LINES]
    print(f"{os.cpu_count()} cores, one used; batch of {BATCH}; least of {rounds} rounds\n")
    print("| model | " + " | ".join(f"µs, {n} lines" for n in LINES) + " | growth |")
    print("|---" * (len(LINES) + 2) + "|")
    for name in times[0]:
        least = [t[name].least for t in times]
        slope = log_log_slope(list(LINES), least)
        print(f"| {name} | " + " | ".join(f"{m:.3g}" for m in least) + f" | {slope:.2f} |")


if __name__ == "__main__":
    main()
