"""Time and memory of calls that are compared with each other."""

import statistics
import time
import tracemalloc
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Contestant:
    """A call that evaluates so many joints."""

    run: Callable[[], object]
    joints: int


@dataclass(frozen=True)
class Timing:
    """Microseconds per joint over the rounds: median and least of the clock, and the median of the processor."""

    median: float
    least: float
    cpu: float
    rounds: int


def interleaved(contestants: Mapping[str, Contestant], rounds: int, seconds: float = 0.02) -> dict[str, Timing]:
    """Time all contestants in turn, round by round, so that a busy spell of the machine meets all of them.

    In each round a contestant is called as often as fits into `seconds`, at least once; its first call, which may
    compile or fill caches, is not timed.
    """
    calls = {}
    for name, one in contestants.items():
        one.run()
        began = time.perf_counter()
        one.run()
        calls[name] = max(1, int(seconds / (time.perf_counter() - began)))
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, one in contestants.items():
            wall, cpu, scale = time.perf_counter(), time.process_time(), 1e6 / (calls[name] * one.joints)
            for _ in range(calls[name]):
                one.run()
            times[name].append((scale * (time.perf_counter() - wall), scale * (time.process_time() - cpu)))
    found = {name: tuple(zip(*rows, strict=True)) for name, rows in times.items()}
    return {n: Timing(statistics.median(w), min(w), statistics.median(c), rounds) for n, (w, c) in found.items()}


def peak_megabytes(run: Callable[[], object]) -> float:
    """Largest memory that Python and NumPy hold at once during a call, beyond what they hold before, MB."""
    run()  # caches and compiled code are not part of a likelihood's own memory
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        run()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return (peak - before) / 1e6


def resident_peak_megabytes(run: Callable[[], object]) -> float | None:
    """Growth of the process's resident memory during a call, compiled code's own arrays included, MB; Linux only."""
    try:
        Path("/proc/self/clear_refs").write_text("5")  # sets the high-water mark back to what is resident now
        before = _status("VmRSS")
        run()
        return (_status("VmHWM") - before) / 1e3
    except (OSError, KeyError):
        return None


def _status(key: str) -> float:
    """One figure of the kernel's record of this process, kB."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return float(dict(line.split(":", 1) for line in lines)[key].split()[0])


def log_log_slope(sizes: list[float], values: list[float]) -> float:
    """Exponent p of values ∝ sizes**p by least squares in logarithms."""
    import numpy as np

    slope, _ = np.polyfit(np.log(sizes), np.log(values), 1)
    return float(slope)
