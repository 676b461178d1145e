"""Campaigns whose workers are killed: nothing lost, nothing double, nothing changed; and what two workers bring.

Parts, each kept in benchmarks/campaign.json as it ends, from which docs/campaigns.md has its table:

``serial``      the first cases by one worker, without kills: what the others are compared with
``efficiency``  the same cases by two workers, without kills
``local``       all cases on two local processes, one of them killed with SIGKILL every so many seconds
``dask``        the same on a Dask LocalCluster of two processes
"""

import argparse
import hashlib
import json
import random
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import psutil

from benchmarks.record import ROOT, environment
from jointbayes.progress import Progress
from jointbayes.studies.campaign.campaign_run import campaign
from jointbayes.studies.campaign.index import INDEX

RESULTS = ROOT / "benchmarks" / "campaign.json"
PAGE = ROOT / "docs" / "campaigns.md"
BASE = ROOT / "configs" / "clamped_beam.toml"
PARTS = ("serial", "efficiency", "local", "dask")

#: A case of half a second, for trying the script and for its test.
CHEAP = {"data.noise.relative": 0.003, "data.f_step_hz": 2, "sampling.walkers": 16}
_MARKS = "<!-- campaign -->", "<!-- /campaign -->"
_NOT_COMPARED = ("seconds", "attempts", "fingerprint")  # of a row: what may differ from run to run


def write_table(path: Path, n: int, cheap: bool = False) -> Path:
    """Write n joints of one population, each measured with noise of its own."""
    rng = np.random.default_rng(1)
    more = CHEAP if cheap else {}
    lines = [",".join(["key", "data.noise.seed", "data.truth.k11", "data.truth.k12", "data.truth.k22", *more])]
    for i in range(n):
        scatter = np.exp(0.1 * rng.standard_normal())  # one factor keeps the joint positive definite
        truth = [f"{k * scatter:.6g}" for k in (5.05e9, 3.44e7, 1.52e6)]
        lines.append(",".join([f"joint-{i:05d}", str(i + 1), *truth, *map(str, more.values())]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


class Killer(threading.Thread):
    """Kills a worker: one at random every so many seconds, or the oldest each time that so many more cases are done."""

    def __init__(self, workers: Callable[[], list[int]], seconds: float | None, cases: int | None) -> None:
        super().__init__(daemon=True)
        self._workers, self._seconds, self._cases, self._ended = workers, seconds, cases, threading.Event()
        self._rng, self._next, self.kills = random.Random(1), cases or 0, 0

    def run(self) -> None:
        """Kill until told to end."""
        while self._seconds is not None and not self._ended.wait(self._seconds):
            self._kill()

    def note(self, done: int) -> None:
        """Kill if so many more cases are done."""
        if self._cases is not None and done >= self._next:
            self._next += self._cases
            self._kill()

    def _kill(self) -> None:
        with suppress(IndexError, ValueError, ProcessLookupError, psutil.NoSuchProcess):
            found = [psutil.Process(pid) for pid in self._workers()]
            if self._cases is not None:  # kills so close: the newest may be at the case that the last one interrupted
                found = [min(found, key=psutil.Process.create_time)]
            self._rng.choice(found).send_signal(signal.SIGKILL)
            self.kills += 1

    def stop(self) -> None:
        """Kill no more."""
        self._ended.set()
        self.join()


def local_workers() -> list[int]:
    """Worker processes of this process, which the process that starts them has as children."""
    me = psutil.Process()
    return [p.pid for p in me.children(recursive=True) if p.ppid() != me.pid]


@contextmanager
def dask_cluster() -> Iterator[tuple[str, Callable[[], list[int]]]]:
    """A Dask cluster of two processes, and its workers."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0, silence_logs=50
    ) as cluster:

        def at_work() -> list[int]:
            # a nanny whose worker is killed before it has begun gives up, and there is one worker fewer for good
            known = {worker.nanny for worker in list(cluster.scheduler.workers.values())}
            return [n.pid for n in list(cluster.workers.values()) if n.pid and n.address in known]

        yield cluster.scheduler_address, at_work


def measured(
    table: Path, directory: Path, seconds: float | None = None, cases: int | None = None, **workers: Any
) -> dict[str, Any]:
    """Run a campaign, with a kill every so many seconds or cases; what it took and what it left."""
    pids = workers.pop("pids", local_workers)
    me, memory = psutil.Process(), []

    def note(now: Progress) -> None:
        if now.done >= len(memory) * max(1, (now.total or 0) // 20):
            memory.append((now.done, round(me.memory_info().rss / 1e6, 1)))
        killer.note(now.done)

    killer = Killer(pids, seconds, cases)
    begin = time.monotonic()
    killer.start()
    try:
        campaign(table, directory, base=BASE, progress=note, **workers)
    finally:
        took = time.monotonic() - begin
        killer.stop()
    return {"seconds": round(took, 1), "kills": killer.kills, "memory_mb": memory}


def results(directory: Path) -> dict[str, tuple[str, Any]]:
    """Row and digest of the draws of each case by key; a case that is not done has neither."""
    found: dict[str, tuple[str, Any]] = {}
    for row in _rows(directory):
        assert row["key"] not in found, f"{row['key']} is in the index twice"
        if row["status"] == "done":
            cells = {name: cell for name, cell in row.items() if name not in _NOT_COMPARED}
            found[row["key"]] = draws_digest(directory / row["file"]), cells
    return found


def _rows(directory: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (directory / INDEX).read_text(encoding="utf-8").splitlines()]


def draws_digest(file: Path) -> str:
    """Digest of all draws of a posterior file."""
    digest = hashlib.sha256()
    with h5py.File(file) as stored:
        for group in ("posterior", "sample_stats", "prior"):
            for name in sorted(stored[group]):
                if stored[f"{group}/{name}"].dtype.kind == "f":
                    digest.update(stored[f"{group}/{name}"][...].tobytes())
    return digest.hexdigest()


def counted(directory: Path, n: int, expected: dict[str, tuple[str, Any]]) -> dict[str, Any]:
    """Cases that are done, lost, double, left half written, and equal to those of `expected`."""
    found = results(directory)
    rows = _rows(directory)
    names = {f"{key}.nc" for key in found}
    both = found.keys() & expected.keys()
    return {
        "cases": n,
        "done": len(found),
        "lost": n - len(rows),
        "set_aside": sum(row["status"] != "done" for row in rows),
        "double": len(rows) - len({row["key"] for row in rows}),
        "left_over": sum(file.name not in names for file in (directory / "cases").iterdir()),
        "begun": sum(row["attempts"] for row in rows),
        "compared": len(both),
        "equal": sum(found[key] == expected[key] for key in both),
    }


def run_part(
    part: str, place: Path, n: int, *, seconds: float | None = None, cases: int | None = None, cheap: bool = False
) -> dict[str, Any]:
    """One part of n cases, in directories of its own below `place`; kills in the last two as for `measured`."""
    table, directory = write_table(place / f"{part}.csv", n, cheap), place / part
    if part == "dask":
        with dask_cluster() as (address, pids):
            took = measured(table, directory, seconds, cases, scheduler=address, pids=pids)
    elif part == "local":
        took = measured(table, directory, seconds, cases, workers=2)
    else:
        took = measured(table, directory, workers=1 if part == "serial" else 2)
    serial = results(place / "serial") if (place / "serial" / INDEX).exists() else {}
    found = {**took, **counted(directory, n, serial), "killed_every": seconds}
    if part == "dask" and (place / "local" / INDEX).exists():
        found["equal_to_local"] = counted(directory, n, results(place / "local"))["equal"]
    return {**found, "environment": environment()}


def as_text(kept: dict[str, Any]) -> str:
    """The table of docs/campaigns.md."""
    names = {"local": "local processes", "dask": "Dask `LocalCluster` of processes"}
    heads = (
        "",
        "Cases",
        "Kills",
        "Done",
        "Lost",
        "Double",
        "Set aside",
        "Left over",
        "Equal to one worker's",
        "Minutes",
    )
    lines = [f"| {' | '.join((*heads, 'Memory of the driver, MB'))} |", "|---" * (len(heads) + 1) + "|"]
    for part in ("local", "dask"):
        if part in kept:
            k = kept[part]
            memory = [mb for _, mb in k["memory_mb"]]
            cells = (
                *(names[part], k["cases"], f"{k['kills']}, one every {k['killed_every']:g} s"),
                *(k[name] for name in ("done", "lost", "double", "set_aside", "left_over")),
                *(f"{k['equal']} of {k['compared']}", f"{k['seconds'] / 60:.1f}"),
                f"{memory[len(memory) // 4]:.0f} at a quarter, {memory[-1]:.0f} at the end",
            )
            lines.append(f"| {' | '.join(map(str, cells))} |")
    if "dask" in kept and "equal_to_local" in kept["dask"]:
        same = kept["dask"]
        lines += ["", f"Of the two, {same['equal_to_local']} of {same['cases']} cases have the same draws bit for bit."]
    if "serial" in kept and "efficiency" in kept:
        one, two = kept["serial"], kept["efficiency"]
        share = one["seconds"] / two["seconds"] / 2
        times = f"{one['seconds']:.0f} s by one worker, {two['seconds']:.0f} s by two"
        lines += ["", f"{two['cases']} cases without kills: {times}, a parallel efficiency of {share:.2f}."]
    where = next(iter(kept.values()))["environment"]
    lines += [
        "",
        f"{where['date']}, {where['cpu']}, {where['cores']} cores, {where['system']}, Python {where['python']}.",
    ]
    return "\n".join(lines)


def main() -> None:
    """Run parts, keep what they found and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="20 cheap cases, kept nowhere")
    parser.add_argument("--n", type=int, default=1000, help="cases with kills")
    parser.add_argument("--few", type=int, default=60, help="cases without kills")
    parser.add_argument("--every", type=float, default=20.0, help="seconds between kills")
    parser.add_argument("--part", choices=PARTS, action="append", help="this one only; may be repeated")
    parser.add_argument("--place", type=Path, help="where the campaigns are kept between parts; by default nowhere")
    chosen = parser.parse_args()
    n, few, every = (20, 8, 5.0) if chosen.quick else (chosen.n, chosen.few, chosen.every)
    place = chosen.place or Path(tempfile.mkdtemp(prefix="campaign-"))
    place.mkdir(parents=True, exist_ok=True)
    kept = json.loads(RESULTS.read_text()) if RESULTS.exists() and not chosen.quick else {}
    try:
        for part in chosen.part or PARTS:
            shutil.rmtree(place / part, ignore_errors=True)
            many = n if part in ("local", "dask") else few
            kept[part] = run_part(part, place, many, seconds=every, cheap=chosen.quick)
            print(part, {name: value for name, value in kept[part].items() if name != "environment"}, flush=True)
            if not chosen.quick:
                RESULTS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
                before, _, rest = PAGE.read_text(encoding="utf-8").partition(_MARKS[0])
                after = rest.partition(_MARKS[1])[2]
                page = f"{before}{_MARKS[0]}\n{as_text(kept)}\n{_MARKS[1]}{after}"
                PAGE.write_text(page, encoding="utf-8")
    finally:
        if chosen.place is None:
            shutil.rmtree(place, ignore_errors=True)
    print(as_text(kept))


if __name__ == "__main__":
    main()
