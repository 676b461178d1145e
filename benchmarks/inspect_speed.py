"""What a look into a large measurement file costs: `python -m benchmarks.inspect_speed [--lines 4097 25000]`.

FRFs of 25 random modes with the coherence of 20 averages, some modes within each other's half-power width, are written
in several formats. Printed are the seconds until channels, units and warnings stand on the screen, those of the fit of
resonances after that, and how many times that is one best fit of the residues alone: a ratio hardly depends on the
machine. After that come kinds of files of which nothing was simplified: hits on a structure whose frequencies fall with
the level, hum of the mains and noise, a force that ends below the last line or does not. At most 5 s are asked of each.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchmarks.written_files import write_records
from vibrecords.arrays import Array
from vibrecords.inspection import contents_of, contents_of_records, with_resonances
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


@dataclass(frozen=True)
class HitFile:
    """FRFs of one or more hits on a structure with a joint: the level moves each frequency by up to `bend` of it."""

    name: str
    frfs: int
    lines: int
    hits: int
    highest_hz: float
    modes: int = 20
    #: First zero of the force's spectrum over the highest line.
    reach: float = 0.35
    bend: float = 0.002
    seed: int = 1

    def records(self) -> tuple[list[FrfRecord], Array]:
        """FRFs, and the natural frequencies at the lowest level, Hz."""
        rng, rate, samples = np.random.default_rng(self.seed), 2 * self.highest_hz, 2 * self.lines
        time_s, frequency = np.arange(samples) / rate, np.fft.rfftfreq(samples, 1 / rate)[: self.lines]
        natural = np.sort(self.highest_hz * np.exp(rng.uniform(np.log(0.005), np.log(0.95), self.modes)))
        damping = np.exp(rng.uniform(np.log(0.001), np.log(0.01), self.modes))
        damping = np.maximum(damping, 0.5 * rate / samples / natural)  # most rings down within the block
        shapes, width = rng.standard_normal((self.frfs, self.modes)), 1.3 / (self.reach * self.highest_hz)
        forces, responses = [], []
        for _ in range(self.hits):
            level = rng.uniform(0.7, 1.4)
            force = np.where(time_s < width, level * np.sin(np.pi * time_s / width) ** 2, 0.0)
            response = np.zeros((self.frfs, samples))
            for omega, zeta, shape in zip(2 * np.pi * natural, damping, shapes.T, strict=True):
                fall = np.exp(-zeta * omega * time_s)
                phase = omega * time_s - self.bend * level**2 * (1 - fall**2) / (2 * zeta)
                free = -omega * fall * np.sin(phase)
                one = np.fft.irfft(np.fft.rfft(free, 2 * samples) * np.fft.rfft(force, 2 * samples))[:samples]
                response += np.outer(shape * shape[0], one)
            largest = np.abs(response).max()
            response += 1e-4 * largest * rng.standard_normal(response.shape)
            response += 3e-4 * largest * np.sin(2 * np.pi * 50 * time_s + rng.uniform(0, 2 * np.pi))
            noisy = force + 2e-4 * rng.standard_normal(samples)
            forces.append(np.fft.rfft(noisy)[: self.lines])
            responses.append(np.fft.rfft(response)[:, : self.lines])
        x, y = np.array(forces)[:, None], np.array(responses)
        power = np.mean(np.abs(x) ** 2, axis=0)
        h1 = np.mean(y * x.conj(), axis=0) / power
        coherence = np.clip(np.abs(h1) ** 2 * power / np.mean(np.abs(y) ** 2, axis=0), 1e-9, 1)
        told = self.hits > 1
        return [
            FrfRecord(
                f"{k + 1}:z", "1:z", frequency, h1[k], "accelerance", "m/s^2/N", *([c, self.hits] if told else [])
            )
            for k, c in enumerate(coherence)
        ], natural


HIT_FILES = (
    HitFile("one hit", 1, 19_542, 1, 12_800.0),
    HitFile("one hit, to the last line", 1, 19_542, 1, 12_800.0, 30, 1.2, seed=3),
    HitFile("five hits", 5, 8193, 5, 6400.0),
    HitFile("five hits, to the last line", 5, 8193, 5, 6400.0, 30, 1.2, seed=3),
    HitFile("five hits, long blocks", 1, 51_201, 5, 12_800.0),
    HitFile("five hits, long blocks, to the last line", 1, 51_201, 5, 12_800.0, 40, 1.2, seed=3),
)
#: A mode within this fraction of a frequency is that mode: the level moves it by less.
_SAME = 0.004


def print_hit_files() -> None:
    """What `inspect` takes for each, and how many modes of the structure it finds, names or invents."""
    print("\n| Hits | FRFs × lines | CPU s | True modes | Found | Named | Neither | Modes that are none |")
    print("|---|---|---|---|---|---|---|---|")
    for file in HIT_FILES:
        records, natural = file.records()
        found, cpu, _ = timed(lambda records=records: with_resonances(contents_of_records(records)))
        modes, named = ([m.frequency_hz for m in some] for some in (found.modes, found.doubtful))
        is_found, is_named = (np.isclose(natural[:, None], some, rtol=_SAME).any(axis=1) for some in (modes, named))
        none = sum(not np.isclose(natural, mode, rtol=_SAME).any() for mode in modes)
        print(
            f"| {file.name} | {file.frfs} × {file.lines} | {cpu:.1f} | {natural.size} | {is_found.sum()} | "
            f"{(is_named & ~is_found).sum()} | {(~is_named & ~is_found).sum()} | {none} |",
            flush=True,
        )


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
    print_hit_files()


if __name__ == "__main__":
    main()
