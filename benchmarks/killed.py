"""Runs killed with SIGKILL at random moments and resumed: `python -m benchmarks.killed`, a part of `make science`.

Every run is of the same small case, with a checkpoint after each block of steps, and is killed once or more: some after
a random time, some at a random one of the calls that change anything on the disk, just before it or just after. Then it
is resumed until it ends by itself. Its posterior must be that of an undisturbed run bit for bit, every file readable,
and nothing left beside the result. Most runs are forks of one warm process, some the program itself; nothing that
starts a thread may be done in the warm process, as a lock that it holds stays held in a fork. The table goes into
docs/resume.md. What came out of each run is kept line by line (`--kept`): the same command goes on where it was cut
off. Exit code 1 if anything is not as it must be.
"""

import argparse
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import h5py
import numpy as np

import jointbayes.workflow  # noqa: F401  (children are forked with all of it loaded)
from benchmarks.disk_faults import each_change, killed_at
from benchmarks.record import environment
from jointbayes.case.case_text import read_case_text
from jointbayes.studies.study_directory import append_line, read_lines

PAGE = Path(__file__).resolve().parents[1] / "docs" / "resume.md"
CASE = Path(__file__).resolve().parents[1] / "configs" / "clamped_beam_frequencies_360mm.toml"
SMALLER = (("elements = 10", "elements = 4"), ("walkers = 48", "walkers = 8"), ("max_steps = 20000", "max_steps = 500"))
_MOST_CALLS = {"sample": 110, "run": 230}  # that change the disk, in a run, about
_BEGUN = "import jointbayes.sampling.checkpoint as c; c.SECONDS_BETWEEN = 0.0; c._TIMES_THE_COST = 0\n"
_PROGRAM = _BEGUN + "from jointbayes.cli.commands import main; main()"
_TIMINGS = ("seconds", "ess_per_second")

Kill = tuple[str, float]
"""After so many seconds, or at which call."""


def _child(arguments: list[str], at_call: int | None) -> None:
    """Run the command line in a fork of a warm process; kill it at one of its calls."""
    with open(os.devnull, "w", encoding="utf-8") as nothing:
        os.dup2(nothing.fileno(), 1)
        os.dup2(nothing.fileno(), 2)
    exec(_BEGUN)
    from jointbayes.cli.commands import main as program

    try:
        with each_change(Path(arguments[3]).parent, killed_at(at_call)) if at_call is not None else nullcontext():
            program(arguments)
    except SystemExit as ended:
        os._exit(int(ended.code or 0))
    os._exit(0)


def _attempt(kind: str, arguments: list[str], kill: Kill | None) -> int:
    """Exit status of one start; −9 where it was killed."""
    after = kill[1] if kill and kill[0] == "time" else None
    if kind == "program":
        process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            return process.wait(after)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()
    at_call = int(kill[1]) if kill and kill[0] == "call" else None
    child = multiprocessing.get_context("fork").Process(target=_child, args=(arguments, at_call))
    child.start()
    child.join(after)
    if child.is_alive():
        child.kill()
    child.join()
    return int(child.exitcode or 0)


def _content(file: Path) -> dict[str, bytes]:
    """Every array and the record of a posterior file, timings apart."""
    content: dict[str, bytes] = {}

    def take(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset):
            values = np.asarray(node[()])
            content[name] = repr(values.tolist()).encode() if values.dtype.hasobject else values.tobytes()

    with h5py.File(file) as opened:
        opened.visititems(take)
        record = json.loads(opened.attrs["jointbayes"])
    for name in _TIMINGS:
        record["record"]["sampler"].pop(name)
    return content | {"record": json.dumps(record).encode()}


def trials(
    count: int, command: str, kind: str, seed: int, kept: Path, tell: Callable[[str], None] = lambda _: None
) -> Counter[str]:
    """Kill and resume so many runs, but for those that are kept; count what came out.

    Parameters
    ----------
    count
        Number of runs.
    command
        ``"run"`` or ``"sample"``.
    kind
        ``"fork"`` of this process, or the ``"program"`` itself.
    seed
        Of the moments: those of run i are a function of it and i alone.
    kept
        File of what came out of each run, one line each.
    tell
        Called with a line for each run that does not come out as it must.
    """
    done = {line[1]: line[2] for line in read_lines(kept) if line and line[0] == [command, kind, seed]}
    missing = [number for number in range(count) if number not in done]
    found = sum((Counter(done[number]) for number in range(count) if number in done), Counter[str]())
    if not missing:
        return found
    text = read_case_text(CASE).text
    for old, new in SMALLER:
        assert old in text
        text = text.replace(old, new)
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case.toml"
        case.write_text(text, encoding="utf-8")
        whole = Path(folder) / "undisturbed"
        for _ in range(2):  # the first one may compile
            begun = time.perf_counter()
            assert _attempt(kind, [command, str(case), "--out", str(whole)], None) in (0, 3)
            duration = time.perf_counter() - begun
        expected = _content(whole / "posterior.nc" if command == "run" else whole)
        for number in missing:
            place = Path(folder) / f"place-{number}"
            place.mkdir()
            rng = np.random.default_rng([seed, number])
            one = Counter(runs=1) + _trial(kind, command, case, place, expected, duration, rng, tell)
            append_line(kept, [[command, kind, seed], number, one])
            found += one
    return found


def _trial(
    kind: str,
    command: str,
    case: Path,
    place: Path,
    expected: dict[str, bytes],
    duration: float,
    rng: np.random.Generator,
    tell: Callable[[str], None],
) -> Counter[str]:
    found: Counter[str] = Counter()
    target = place / "out"
    arguments = [command, str(case), "--out", str(target), "--resume"]
    kills: list[Kill] = []
    for _ in range(1 + int(rng.integers(3) == 0)):  # one kill, or two in a row
        by_time = kind == "program" or rng.random() < 0.5
        kills.append(
            ("time", rng.uniform(0.02, 1.05 * duration)) if by_time
            else ("call", float(rng.integers(2, 2 * _MOST_CALLS[command])))
        )  # fmt: skip
    for kill in kills:
        status = _attempt(kind, arguments, kill)
        found[f"killed ({kill[0]})" if status == -signal.SIGKILL else "ended before"] += 1
        found["hidden after the kill"] += any(p.name.startswith(".") for p in place.iterdir())
    status = _attempt(kind, arguments, None)
    try:
        content = _content(target / "posterior.nc" if command == "run" else target)
    except Exception as error:  # whatever it is, it counts
        found["unreadable"] += 1
        tell(f"{kills}: exit {status}, {error}; {sorted(p.name for p in place.rglob('*'))}")
        return found
    found["identical"] += content == expected
    left = sorted(p.name for p in place.iterdir() if p != target)
    found["with leftovers"] += bool(left)
    if content != expected or left:
        tell(f"{kills}: exit {status}, left {left}, identical {content == expected}")
    return found


def main() -> int:
    """Kill, resume, count, and write the table; 1 if anything is not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="number of runs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--no-page", action="store_true", help="print only")
    parser.add_argument("--kept", type=Path, default=Path("killed.jsonl"), help="file of the runs that are done")
    options = parser.parse_args()
    parts = [("sample", "fork", 0.55), ("run", "fork", 0.35), ("sample", "program", 0.1)]
    counts = [round(options.count * share) for *_, share in parts[:-1]]
    counts.append(options.count - sum(counts))
    rows = []
    for (command, kind, _), count in zip(parts, counts, strict=True):
        found = trials(count, command, kind, options.seed, options.kept, lambda line: print(line, flush=True))
        rows.append((f"`{command}`, {'a fork of a warm process' if kind == 'fork' else 'the program'}", found))
        print(rows[-1], flush=True)
    total: Counter[str] = Counter()
    for _, found in rows:
        total.update(found)
    text = _table([*rows, ("all", total)])
    print(text)
    if not options.no_page:
        page = PAGE.read_text(encoding="utf-8")
        begin, end = "<!-- begin: written by the script -->", "<!-- end -->"
        before, rest = page.split(begin)
        PAGE.write_text(f"{before}{begin}\n\n{text}\n{end}{rest.split(end)[1]}", encoding="utf-8")
    wrong = total["runs"] - total["identical"] + total["unreadable"] + total["with leftovers"]
    return int(wrong > 0)


def _table(rows: list[tuple[str, Counter[str]]]) -> str:
    made = environment()
    heads = ("runs", "killed (time)", "killed (call)", "identical", "unreadable", "with leftovers")
    titles = (
        "runs",
        "kills at a random time",
        "kills at a call",
        "identical posteriors",
        "unreadable files",
        "leftovers",
    )
    lines = [
        f"{made['date']}, {made['cpu']}, Python {made['python']}.",
        "",
        f"| | {' | '.join(titles)} |",
        f"|---|{'---|' * len(titles)}",
    ]
    lines += [f"| {name} | {' | '.join(str(found[head]) for head in heads)} |" for name, found in rows]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
