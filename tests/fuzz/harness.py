"""Runs a target on many inputs in a process of its own, which is replaced when an input kills it."""

import json
import os
import random
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.fuzz.targets import Target
from tests.fuzz.worker import Verdict, load_target

_ROOT = Path(__file__).resolve().parents[2]
#: An input that neither ends nor computes, s; and one that a busy machine has not let compute.
_IDLE_SECONDS, _WALL_SECONDS = 30.0, 300.0
_KILL = 1.5  # times the target's computing time: those between are told slow by the worker itself
_LOOK_SECONDS = 0.5
_MINIMISE_SECONDS, _MINIMISE_ATTEMPTS = 15.0, 300
_KEPT_OF_A_KIND = 3


class Attacker:
    """One worker process, started when it is needed, with a directory that holds all it may write."""

    def __init__(self, place: str) -> None:
        self.place, self.target = place, load_target(place)
        self.root = Path(tempfile.mkdtemp(prefix="jointbayes-fuzz-"))
        self._process: subprocess.Popen[bytes] | None = None
        self._answers = -1
        self._buffer = b""
        self._attempts = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._end()
        shutil.rmtree(self.root, ignore_errors=True)

    def attempt(self, content: bytes, suffix: str | None = None) -> Verdict:
        """Have the target read this content from a file, of another ending than its own if one is given."""
        if self._process is None or self._attempts >= self.target.patience:
            self._end()
            self._begin()
        assert self._process is not None
        assert self._process.stdin is not None
        path = self.root / "in" / f"input{self.target.suffix if suffix is None else suffix}"
        path.write_bytes(content)
        self._attempts += 1
        try:
            self._process.stdin.write(json.dumps(str(path)).encode() + b"\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            return self._death("crash")
        answer = self._answer()
        if answer is None:
            return self._death("crash")
        if isinstance(answer, str):
            return self._death(answer)
        return Verdict(**answer)

    def _begin(self) -> None:
        for name in ("in", "tmp", "work"):
            shutil.rmtree(self.root / name, ignore_errors=True)
            (self.root / name).mkdir()
        answers, child_end = os.pipe()
        paths = [str(_ROOT), str(_ROOT / "src"), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
        one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        environment = os.environ | one_thread | {
            "PYTHONPATH": os.pathsep.join(path for path in paths if path),
            "PYTHONFAULTHANDLER": "1",
            "TMPDIR": str(self.root / "tmp"),
        }  # fmt: skip
        with (self.root / "printed").open("wb") as printed:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tests.fuzz.worker", self.place, str(self.root), str(child_end)],
                stdin=subprocess.PIPE, stdout=printed, stderr=subprocess.STDOUT, cwd=self.root / "work",
                env=environment, pass_fds=[child_end], start_new_session=True,
            )  # fmt: skip
        os.close(child_end)
        self._answers, self._buffer, self._attempts = answers, b"", 0
        if not isinstance(self._answer(patient=True), dict):
            raise RuntimeError(f"{self.place} cannot be prepared:\n{self._printed()}")

    def _answer(self, patient: bool = False) -> dict[str, str] | str | None:
        """The next line of the worker; None if it died, the name of the fault if it takes too long."""
        begun, spent_before = time.monotonic(), self._spent()
        while b"\n" not in self._buffer:
            ready, _, _ = select.select([self._answers], [], [], _LOOK_SECONDS)
            if ready:
                part = os.read(self._answers, 1 << 16)
                if not part:
                    return None
                self._buffer += part
                continue
            wall, spent = time.monotonic() - begun, self._spent() - spent_before
            idle = wall > _IDLE_SECONDS and spent < 0.01 * wall
            if not patient and (spent > _KILL * self.target.seconds or idle or wall > _WALL_SECONDS):
                return "hang"
        line, _, self._buffer = self._buffer.partition(b"\n")
        return json.loads(line)

    def _spent(self) -> float:
        """Computing time of the worker and of the processes it has waited for, s."""
        assert self._process is not None
        try:
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0
        return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")

    def _printed(self) -> str:
        return (self.root / "printed").read_text(errors="replace")[-3000:]

    def _death(self, kind: str) -> Verdict:
        """The verdict on an input that the worker did not survive; the next one gets a fresh worker."""
        assert self._process is not None
        code = self._end()
        name = signal.Signals(-code).name if code < 0 else f"exit status {code}"
        where = name if kind == "crash" else f"more than {_KILL * self.target.seconds:g} s of computing, or no end"
        return Verdict(kind, f"{where}\n{self._printed()}", where)

    def _end(self) -> int:
        if self._process is None:
            return 0
        assert self._process.stdin is not None
        if not select.select([self._answers], [], [], 0.0)[0]:  # alive: it and all it has started
            os.killpg(self._process.pid, signal.SIGKILL)
        try:
            code = self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            os.killpg(self._process.pid, signal.SIGKILL)
            code = self._process.wait()
        with suppress(BrokenPipeError):
            self._process.stdin.close()
        os.close(self._answers)
        self._process = None
        return code


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

    @property
    def count(self) -> int:
        """Inputs attempted."""
        return sum(self.kinds.values())

    def __str__(self) -> str:
        each = ", ".join(f"{number} {kind}" for kind, number in sorted(self.kinds.items()))
        speed = self.count / self.seconds if self.seconds > 0 else 0.0
        lines = [f"{self.name}: {self.count} inputs in {self.seconds:.0f} s ({speed:.0f} a second): {each}"]
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
    begun = time.monotonic()
    with Attacker(place) as attacker:
        target = attacker.target
        seeds, tally = target.seeds(), Tally(target.name)
        number = first
        while count is None or number < first + count:
            if seconds is not None and time.monotonic() - begun > seconds:
                break
            content = made_input(target, seeds, seed, number)
            verdict = attacker.attempt(content)
            tally.kinds[verdict.kind] += 1
            if not verdict.right:
                numbers = tally.faults.setdefault((verdict.kind, verdict.where), [])
                numbers.append(number)
                if len(numbers) <= _KEPT_OF_A_KIND:
                    small = _minimised(attacker, content, verdict) if len(numbers) == 1 else content
                    tally.saved.append(_saved(offenders / target.name, target.suffix, small, verdict))
            number += 1
        tally.seconds = time.monotonic() - begun
    return tally


def _minimised(attacker: Attacker, content: bytes, verdict: Verdict) -> bytes:
    """The content without the parts that the fault does not need, as far as some seconds go."""
    end, attempts = time.monotonic() + _MINIMISE_SECONDS, 0
    parts = 2
    while parts <= max(2, len(content)):
        size = max(1, -(-len(content) // parts))
        for at in range(0, len(content), size):
            if time.monotonic() > end or attempts >= _MINIMISE_ATTEMPTS:
                return content
            attempts += 1
            shorter = content[:at] + content[at + size :]
            found = attacker.attempt(shorter)
            if (found.kind, found.where) == (verdict.kind, verdict.where):
                content = shorter
                break
        else:
            if size == 1:
                break
            parts *= 2
    return content


def _saved(folder: Path, suffix: str, content: bytes, verdict: Verdict) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{verdict.kind.replace(' ', '-')}-{sha256(content).hexdigest()[:12]}{suffix}"
    path.write_bytes(content)
    path.with_name(path.name + ".txt").write_text(f"{verdict.kind}: {verdict.where}\n\n{verdict.text}\n")
    return path
