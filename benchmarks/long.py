"""Long work in one process: what it holds after each run, over many steps and over many tasks.

    python -m benchmarks.long runs --count 1000      # the same process loads, samples and reports a case so often
    python -m benchmarks.long posteriors --count 1000
    python -m benchmarks.long tasks --count 10000    # the driver of a campaign, trivial tasks on two workers
    python -m benchmarks.long steps --count 1000000  # one sampler that never stops

Each prints, at some twenty points, resident memory, open files, threads, child processes, temporary files and the
Python objects that the collector knows, and at last how much each grows with every run. Exit status 1 if any grows by
more than `LIMITS` allow.
"""

import argparse
import gc
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

import jointbayes as jb
from jointbayes.progress import Progress
from jointbayes.sampling import SamplerSettings, run_ensembles
from jointbayes.studies.workers import run_tasks

_CASE = Path(__file__).parent.parent / "configs" / "clamped_beam.toml"
_POINTS = 20


@dataclass(frozen=True, slots=True)
class Held:
    """What a process holds, or by how much that grows with each run."""

    memory_kb: float
    files: float
    threads: float
    children: float
    temporary: float
    objects: float


#: Growth with each run that counts as none: the allocator's breathing, divided by the number of runs.
LIMITS = Held(memory_kb=40.0, files=0.02, threads=0.02, children=0.02, temporary=0.0, objects=2.0)


def held(temporary: Path) -> Held:
    """What this process holds now; `temporary` is the directory for its temporary files."""
    gc.collect()
    _give_back()
    pid = os.getpid()
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    memory = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
    return Held(
        memory_kb=memory,
        files=len(os.listdir(f"/proc/{pid}/fd")),
        threads=threading.active_count(),
        children=len(children),
        temporary=sum(1 for _ in temporary.rglob("*")),
        objects=len(gc.get_objects()),
    )


def _give_back() -> None:
    """Let the C library return what is free, so that its habits do not pass for a leak."""
    import ctypes

    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def watch(
    work: Callable[[int], object], count: int, warm_up: int, temporary: Path, points: int = _POINTS
) -> Iterator[tuple[int, Held]]:
    """Do some work so often and yield after how often the process holds what.

    Parameters
    ----------
    work
        Called with 0, 1, 2 and so on.
    count, warm_up
        How often, and how often before the first look: caches fill up.
    temporary
        Where its temporary files go.
    points
        How often to look.
    """
    for number in range(warm_up):
        work(number)
    yield 0, held(temporary)
    every = max(1, count // points)
    for number in range(1, count + 1):
        work(warm_up + number - 1)
        if number % every == 0 or number == count:
            yield number, held(temporary)


def growth(looks: Sequence[tuple[int, Held]]) -> Held:
    """By how much each quantity grows with every run: the median slope between two looks (Theil and Sen)."""
    at = np.array([number for number, _ in looks], dtype=float)
    values = np.array([astuple(one) for _, one in looks], dtype=float)
    first, second = np.triu_indices(len(at), 1)
    slopes = (values[second] - values[first]) / (at[second] - at[first])[:, None]
    return Held(*np.median(slopes, axis=0).tolist())


def excess(grown: Held, limits: Held = LIMITS) -> tuple[str, ...]:
    """What grows by more than is allowed, in words."""
    return tuple(
        f"{one.name} grows by {getattr(grown, one.name):.3g} with every run, {getattr(limits, one.name):g} is allowed"
        for one in fields(Held)
        if getattr(grown, one.name) > getattr(limits, one.name)
    )


def report_of_case(path: Path, out: Path, seed: int, settings: SamplerSettings | None = None) -> None:
    """What `jointbayes run` does."""
    jb.write_report(jb.sample(jb.load_case(path), seed=seed, settings=settings), out)


def _posterior_of_case(path: Path, out: Path, seed: int) -> None:
    posterior = jb.sample(jb.load_case(path), seed=seed)
    posterior.summary()
    posterior.save(out.with_suffix(".nc"))


def doubled(number: int) -> int:
    """A task that takes no time."""
    return 2 * number


def _steps(count: int, place: Path) -> Iterator[tuple[int, Held]]:
    """A Gaussian that is sampled for so many steps, whatever the stop rule says."""
    settings = SamplerSettings(max_steps=count, tau_factor=1e9)
    rng = np.random.default_rng(1)
    looks: list[tuple[int, Held]] = []
    every = max(settings.check_every, count // _POINTS // settings.check_every * settings.check_every)

    def look(progress: Progress) -> None:
        if progress.done % every == 0:
            looks.append((progress.done, held(place)))
            _print_row(*looks[-1])

    start = rng.normal(size=(settings.ensembles, settings.walkers, 3))
    chains = run_ensembles(lambda x: -0.5 * (x**2).sum(axis=1), start, rng, settings, look)
    print(f"{chains.steps} steps: {chains.reason}")
    yield from looks[len(looks) // 4 :]


def _tasks(count: int, place: Path) -> Iterator[tuple[int, Held]]:
    """The driver of a campaign with tasks that take no time, on two processes."""
    every, done, total = max(1, count // _POINTS), 0, 0
    for outcome in run_tasks(doubled, ((str(i), (i,)) for i in range(count)), workers=2):
        done, total = done + 1, total + (outcome.value or 0)
        if done % every == 0:
            yield done, held(place)
    assert total == count * (count - 1), "a task is lost or double"


def _print_row(number: int, one: Held) -> None:
    print(f"{number:9d} {one.memory_kb / 1024:10.1f} MB", *(f"{v:9.0f}" for v in astuple(one)[1:]), flush=True)


def main() -> None:
    """Do it and print what the process holds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["runs", "posteriors", "tasks", "steps"])
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--case", type=Path, default=_CASE)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        if chosen.what in ("runs", "posteriors"):
            tempfile.tempdir = scratch  # whatever stays behind is counted
        place, out = Path(scratch), Path(scratch) / "run"
        print(f"{'':9} {'memory':>13}", *(f"{one.name:>9}" for one in fields(Held)[1:]))
        looks = []
        match chosen.what:
            case "runs":
                look = watch(lambda n: report_of_case(chosen.case, out, n), chosen.count, 10, place)
            case "posteriors":
                look = watch(lambda n: _posterior_of_case(chosen.case, out, n), chosen.count, 10, place)
            case "tasks":
                look = _tasks(chosen.count, place)
            case _:
                look = _steps(chosen.count, place)
        for number, one in look:
            looks.append((number, one))
            if chosen.what != "steps":
                _print_row(number, one)
    grown = growth(looks)
    print("growth with each: " + ", ".join(f"{one.name} {getattr(grown, one.name):.3g}" for one in fields(Held)))
    too_much = excess(grown)
    print("\n".join(too_much) or "nothing grows")
    sys.exit(1 if too_much else 0)


if __name__ == "__main__":
    main()
