"""Whether the variance from coherence is the scatter of repeated tests: `python -m benchmarks.coherence`."""

import argparse
import time

import numpy as np

from benchmarks.cases import ROOT
from benchmarks.virtual_test import VirtualTest, simulate
from jointbayes.case.case import Case, case_from_text
from vibrecords import FrfSet
from vibrecords.records import FrfRecord
from vibrecords.variance import coherence_variance

AVERAGES = (3, 10, 50)
METHODS = ("impact", "shaker", "frf")


def beam() -> Case:
    """The clamped beam, accelerance at lines 20 Hz apart."""
    text = (ROOT / "configs" / "clamped_beam.toml").read_text(encoding="utf-8")
    text = text.replace('quantity = "receptance"', 'quantity = "accelerance"', 1)
    return case_from_text("beam", text.replace("f_step_hz = 1.0", "f_step_hz = 20.0", 1))


def as_set(record: FrfRecord) -> FrfSet:
    """One record as a set."""
    coherence = None if record.coherence is None else record.coherence[:, None, None]
    values = record.values[:, None, None]
    return FrfSet(record.frequency_hz, values, ("1",), ("2",), record.quantity, coherence, record.averages)


def ratio(case: Case, settings: VirtualTest, tests: int) -> np.ndarray:
    """Mean predicted variance over the scatter of the tests, shape (lines,)."""
    values, predicted = [], []
    for seed in range(tests):
        (record,) = simulate(case, settings, seed=seed)
        values.append(record.values)
        predicted.append(coherence_variance(as_set(record)).ravel())
    return np.mean(predicted, axis=0) / np.var(values, axis=0, ddof=1)


def main() -> None:
    """Print the table of docs/records.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few tests, to try the script")
    parser.add_argument("--method", choices=METHODS, action="append", help="this one only; may be repeated")
    chosen = parser.parse_args()
    tests = 20 if chosen.quick else 500
    case = beam()
    print(f"{tests} tests of each kind; a scatter over so many is itself uncertain by {100 / tests**0.5:.1f} %\n")
    print("| method | averages | predicted/scatter, mean over lines | 2.5 % and 97.5 % of lines | s |")
    print("|---|---|---|---|---|")
    for method in chosen.method or METHODS:
        noise = {} if method == "frf" else {"force_noise": 0.0005, "response_noise": 0.003}
        for averages in AVERAGES:
            start = time.perf_counter()
            found = ratio(case, VirtualTest(method=method, averages=averages, **noise), tests)
            low, high = np.quantile(found, [0.025, 0.975])
            seconds = time.perf_counter() - start
            print(
                f"| {method} | {averages} | {found.mean():.3f} | {low:.2f} to {high:.2f} | {seconds:.0f} |", flush=True
            )


if __name__ == "__main__":
    main()
