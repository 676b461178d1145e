"""Runs a target on many inputs in a process of its own, which is replaced when an input kills it."""

import faulthandler
import importlib
import logging
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from jointbayes.errors import JointBayesError
from tests.fuzz.targets import Target

_WALL_SECONDS = 120.0  # an input that has neither ended nor computed its time until then
_KILL = 1.5  # times the target's computing time: those between are told slow by the worker itself
_MINIMISE_ATTEMPTS = 300
_KEPT_OF_A_KIND = 3


@dataclass(frozen=True)
class Verdict:
    """What an input did: "accepted" and "refused" are right, anything else is a fault of the package."""

    kind: str
    text: str = ""
    where: str = ""

    @property
    def right(self) -> bool:
        """Whether the package did what it should."""
        return self.kind in ("accepted", "refused")


def load_target(place: str) -> Target:
    """The target at ``module:name``, of the `TARGETS` of a module."""
    module, name = place.split(":")
    return importlib.import_module(module).TARGETS[name]


# ---- in the process that attempts inputs


def _files(root: Path) -> Iterator[str]:
    for folder, folders, files in os.walk(root):
        yield from (os.path.join(folder, name) for name in (*folders, *files))


@contextmanager
def _memory(most: int) -> Iterator[None]:
    """Address space bound while an input is attempted, so that a bomb ends in MemoryError and not in the machine's."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, ((most if hard == resource.RLIM_INFINITY else min(most, hard)), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _where(error: BaseException) -> str:
    """File and function of the packages where an error was raised: faults at one place are one fault."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = tuple(f"{os.sep}{package}{os.sep}" for package in ("jointbayes", "vibrecords"))
    last = ([frame for frame in frames if any(package in frame.filename for package in ours)] or frames)[-1]
    return f"{type(error).__name__} in {Path(last.filename).name}:{last.name}"


def _attempted(target: Target, path: Path) -> Verdict:
    try:
        target.attempt(path)
    except JointBayesError as error:
        fault = target.message_fault(str(error), path)
        return Verdict("message", f"{fault}: {error!s}", fault) if fault else Verdict("refused")
    except BaseException as error:
        kind = "memory" if isinstance(error, MemoryError) else "traceback"
        return Verdict(kind, traceback.format_exc(), _where(error))
    return Verdict("accepted")


def judge(target: Target, path: Path, root: Path) -> Verdict:
    """Attempt one input and look at all that it did."""
    before, printed, begun = set(_files(root)), os.fstat(1).st_size, os.times()
    with warnings.catch_warnings(record=True) as caught, _memory(target.memory):
        warnings.simplefilter("always")
        verdict = _attempted(target, path)
    spent = sum(os.times()[:4]) - sum(begun[:4])  # with that of processes that were waited for
    sys.stdout.flush()
    sys.stderr.flush()
    left = sorted(set(_files(root)) - before)
    for name in reversed(left):
        os.rmdir(name) if os.path.isdir(name) and not os.path.islink(name) else os.unlink(name)
    if not verdict.right:
        return verdict
    if left:
        return Verdict("file left", ", ".join(os.path.relpath(name, root) for name in left), verdict.kind)
    if caught:
        first = caught[0]
        place = f"{first.category.__name__} in {Path(first.filename).name}"
        return Verdict("warning", f"{first.filename}:{first.lineno}: {first.message}", place)
    if os.fstat(1).st_size > printed:
        return Verdict("printed", (root / "printed").read_text(errors="replace")[printed:], verdict.kind)
    if spent > target.seconds:
        return Verdict("slow", f"{spent:.1f} s of computing", verdict.kind)
    return verdict


def _serve(place: str, root: Path, pipe: Connection) -> None:
    """Attempt the files whose paths come, and answer with a verdict each; too much computing ends the process."""
    os.setsid()
    os.chdir(root / "work")
    os.environ["TMPDIR"] = tempfile.tempdir = str(root / "tmp")
    printed = os.open(root / "printed", os.O_CREAT | os.O_TRUNC | os.O_RDWR | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(printed, stream)
    faulthandler.enable()
    logging.getLogger("jointbayes").setLevel(logging.ERROR)  # that loops are compiled, once after an installation
    target = load_target(place)
    target.prepare(root / "in")
    pipe.send(None)
    while True:
        path = pipe.recv()
        signal.setitimer(signal.ITIMER_PROF, _KILL * target.seconds)
        verdict = judge(target, path, root)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        pipe.send(verdict)


# ---- in the one that makes them


class Attacker(AbstractContextManager["Attacker"]):
    """One worker process, started when it is needed, with a directory that holds all it may write."""

    def __init__(self, place: str) -> None:
        self.place, self.target, self._worker, self._attempts = place, load_target(place), None, 0
        self.root = Path(tempfile.mkdtemp(prefix="jointbayes-fuzz-"))

    def __exit__(self, *_: object) -> None:
        self._end()
        shutil.rmtree(self.root, ignore_errors=True)

    def attempt(self, content: bytes, suffix: str | None = None) -> Verdict:
        """Have the target read this content from a file, of another ending than its own if one is given."""
        if self._worker is None or self._attempts >= self.target.patience:
            self._end()
            self._begin()
        path = self.root / "in" / f"input{self.target.suffix if suffix is None else suffix}"
        path.write_bytes(content)
        self._attempts += 1
        try:
            self._pipe.send(path)
            if self._pipe.poll(_WALL_SECONDS):
                return self._pipe.recv()
            kind, where = "hang", "no end"
        except (EOFError, OSError):
            self._worker.join(10.0)
            code = self._worker.exitcode or 0
            where = signal.Signals(-code).name if code < 0 else f"exit status {code}"
            kind = "hang" if where == "SIGPROF" else "crash"
        self._end()  # the next one gets a fresh worker
        return Verdict(kind, f"{where}\n{(self.root / 'printed').read_text(errors='replace')[-3000:]}", where)

    def _begin(self) -> None:
        for name in ("in", "tmp", "work"):
            shutil.rmtree(self.root / name, ignore_errors=True)
            (self.root / name).mkdir()
        self._pipe, theirs = get_context("spawn").Pipe()
        self._worker = get_context("spawn").Process(target=_serve, args=(self.place, self.root, theirs))
        self._worker.start()
        theirs.close()
        self._attempts = 0
        self._pipe.recv()  # ready

    def _end(self) -> None:
        """End the worker and all that it has started."""
        if self._worker is not None:
            if self._worker.is_alive():
                os.killpg(self._worker.pid, signal.SIGKILL)
            self._worker.join()
            self._pipe.close()
            self._worker = None


def made_input(target: Target, seeds: list[bytes], seed: int, number: int) -> bytes:
    """Input of a number: the same for the same seed, target and seeds, whatever was attempted before."""
    rng = random.Random(f"{target.name} {seed} {number}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return target.damage(rng, rng.choice(seeds), rng.choice(seeds))


@dataclass
class Tally:
    """What the inputs of one target did."""

    name: str
    kinds: Counter[str] = field(default_factory=Counter)
    faults: dict[tuple[str, str], list[int]] = field(default_factory=dict)
    saved: list[Path] = field(default_factory=list)
    seconds: float = 0.0

    def __str__(self) -> str:
        each = ", ".join(f"{number} {kind}" for kind, number in sorted(self.kinds.items()))
        lines = [f"{self.name}: {self.kinds.total()} inputs in {self.seconds:.0f} s: {each}"]
        for (kind, where), numbers in self.faults.items():
            lines.append(f"  {kind}: {where}: {len(numbers)} times, first input {numbers[0]}")
        return "\n".join([*lines, *(f"  kept: {path}" for path in self.saved)])


def fuzz(place: str, *, seed: int, count: int | None, seconds: float | None, offenders: Path, first: int = 0) -> Tally:
    """Attempt inputs until so many are done or so much time is over.

    Parameters
    ----------
    place
        Of the target, as `load_target` takes it.
    seed, first
        Of the inputs, and number of the first.
    count, seconds
        When to end, whichever is first.
    offenders
        Directory for inputs that did what they should not, made as small as they quickly can be.
    """
    begun, number = time.monotonic(), first
    with Attacker(place) as attacker:
        seeds, tally = attacker.target.seeds(), Tally(attacker.target.name)
        while (count is None or number < first + count) and (seconds is None or tally.seconds < seconds):
            content = made_input(attacker.target, seeds, seed, number)
            verdict = attacker.attempt(content)
            tally.kinds[verdict.kind] += 1
            if not verdict.right:
                numbers = tally.faults.setdefault((verdict.kind, verdict.where), [])
                numbers.append(number)
                if len(numbers) <= _KEPT_OF_A_KIND:
                    small = _minimised(attacker, content, verdict) if len(numbers) == 1 else content
                    tally.saved.append(_saved(offenders / tally.name, attacker.target.suffix, small, verdict))
            number, tally.seconds = number + 1, time.monotonic() - begun
    return tally


def _minimised(attacker: Attacker, content: bytes, verdict: Verdict) -> bytes:
    """The content without the parts that the fault does not need, as far as some attempts go."""
    size, left = len(content), _MINIMISE_ATTEMPTS
    while (size := size // 2) and left:
        at = 0
        while at < len(content) and left:
            left, shorter = left - 1, content[:at] + content[at + size :]
            found = attacker.attempt(shorter)
            if (found.kind, found.where) == (verdict.kind, verdict.where):
                content = shorter
            else:
                at += size
    return content


def _saved(folder: Path, suffix: str, content: bytes, verdict: Verdict) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{verdict.kind.replace(' ', '-')}-{sha256(content).hexdigest()[:12]}{suffix}"
    path.write_bytes(content)
    path.with_name(path.name + ".txt").write_text(f"{verdict.kind}: {verdict.where}\n\n{verdict.text}\n")
    return path
