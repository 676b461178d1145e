"""What a look into a large measurement file costs: `python -m benchmarks.inspect_speed [--lines 4097 25000]`.

FRFs of 25 random modes with the coherence of 20 averages, some modes within each other's half-power width, are written
in several formats. Printed are the seconds until channels, units and warnings stand on the screen, those of the fit of
resonances after that, and how many times that is one best fit of the residues alone: a ratio hardly depends on the
machine.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from vibrecords.formats import write_records
from vibrecords.inspection import contents_of, with_resonances
from vibrecords.modal_problem import ModalProblem
from vibrecords.records import FrfRecord

FORMATS = ("uff58b", "mat", "npz", "csv")
AVERAGES, MODES = 20, 25
T = TypeVar("T")


def large_file(frfs: int, lines: int, seed: int = 1, highest_hz: float = 2048.0) -> list[FrfRecord]:
    """FRFs over one force of a structure with as many modes beyond the band as ten."""
    rng = np.random.default_rng(seed)
    f = np.linspace(highest_hz / lines, highest_hz, lines)
    modes = np.concatenate([np.sort(rng.uniform(20, 0.98 * highest_hz, MODES)), highest_hz * np.linspace(1.1, 3, 10)])
    damping = np.exp(rng.uniform(np.log(0.001), np.log(0.02), modes.size))
    shapes = rng.standard_normal((frfs, modes.size))
    modal = -(f[:, None] ** 2) / (modes**2 - f[:, None] ** 2 + 2j * damping * modes * f[:, None])
    exact = modal @ (shapes * shapes[:1]).T
    sd = 0.02 * np.abs(exact) + 0.01 * np.median(np.abs(exact), axis=0)
    total, power = np.zeros(exact.shape, dtype=complex), np.zeros(exact.shape)
    for _ in range(AVERAGES):
        noise = rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape)
        each = exact + sd * np.sqrt(AVERAGES / 2) * noise
        total, power = total + each, power + np.abs(each) ** 2
    mean = total / AVERAGES
    coherence = np.abs(mean) ** 2 / (power / AVERAGES)
    return [
        FrfRecord(f"{k + 1}:z", "1:z", f, mean[:, k], "accelerance", "m/s^2/N", coherence[:, k], AVERAGES)
        for k in range(frfs)
    ]


def timed(call: Callable[[], T]) -> tuple[T, float, float]:
    """What a call returns, its CPU seconds and its seconds by the clock."""
    clock, cpu = time.perf_counter(), time.process_time()
    result = call()
    return result, time.process_time() - cpu, time.perf_counter() - clock


def main() -> None:
    """Write the files, look into them, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lines", type=int, nargs="*", default=[4097, 25_000])
    parser.add_argument("--frfs", type=int, default=18)
    options = parser.parse_args()
    print(
        "| FRFs × lines | Format | MB | Contents, s | Contents, CPU s | Fit, CPU s | Modes | Fit over one linear fit |"
    )
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        for lines in options.lines:
            records = large_file(options.frfs, lines)
            for form in FORMATS:
                path = Path(scratch) / f"large.{form}"
                write_records(records, path, form)
                contents, cpu, clock = timed(lambda path=path: contents_of(path))
                row = (
                    f"| {options.frfs} × {lines} | {form} | {path.stat().st_size / 1e6:.0f} | {clock:.2f} | {cpu:.2f} |"
                )
                if form != FORMATS[0]:
                    print(row, "| | |")
                    continue
                fitted, fit_cpu, _ = timed(lambda contents=contents: with_resonances(contents))
                values = np.column_stack([record.values for record in contents.frfs[:3]])
                problem = ModalProblem(records[0].frequency_hz, values, np.ones(values.shape), "accelerance")
                poles = np.array([2 * np.pi * m.frequency_hz * (1j - m.damping_ratio) for m in fitted.modes])
                _, linear, _ = timed(lambda problem=problem, poles=poles: problem.chi2(poles))
                print(row, f"{fit_cpu:.1f} | {len(fitted.modes)} | {fit_cpu / linear:.0f} |", flush=True)


if __name__ == "__main__":
    main()
