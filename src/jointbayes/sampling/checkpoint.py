"""A run on disk while it is not finished: where it stands, in a directory beside the result, so that it can go on."""

import hashlib
import json
import os
import shutil
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from jointbayes.errors import CheckpointError
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.ensemble import Block, EnsembleState, MoveCount
from jointbayes.sampling.stage import Stage
from jointbayes.sampling.stopping import Check, EndError
from jointbayes.whole_file import claimed, sync_directory

__all__ = ["SECONDS_BETWEEN", "UnfinishedRun", "require_same_density"]

#: Least time between two checkpoints, and how many times as long as writing the last one took: it costs less than 2 %.
SECONDS_BETWEEN = 5.0
_TIMES_THE_COST = 50

_VERSION = 1
_NEWEST, _PREVIOUS, _NEW, _LOCK = "checkpoint", "checkpoint.previous", "checkpoint.new", "lock"


@dataclass(slots=True)
class _Draws:
    """What of a stage is on disk: so many bytes of a file that only grows."""

    rows: int = 0  # of the stage's blocks
    step: int = 0
    size: int = 0
    digest: Any = field(default_factory=hashlib.sha256)
    moves: list[dict[str, list[int]]] = field(default_factory=list)
    singular: int = 0

    def take(self, rows: list[list[Block]], content: bytes) -> None:
        """Count blocks that have been written."""
        self.rows += len(rows)
        self.step += _steps(rows)
        self.size += len(content)
        self.digest.update(content)
        for row in rows:
            self.moves = self.moves or [{} for _ in row]
            for known, block in zip(self.moves, row, strict=True):
                self.singular += block.singular
                for name, count in block.moves.items():
                    accepted, proposed = known.get(name, (0, 0))
                    known[name] = [accepted + count.accepted, proposed + count.proposed]


class UnfinishedRun:
    """The directory of a run that is not finished, locked by the process that is at work on it.

    ``checkpoint`` says where the run stands: what it is a run of, the mode that was found, and how many bytes of the
    files ``draws-0``, ``draws-1`` … count, with their digests; these files only grow. It is written beside, forced to
    the disk and renamed, and the one before stays as ``checkpoint.previous``. ``lock`` is locked while a process is at
    work and names it.

    Parameters
    ----------
    path
        The directory; it is made if it is not there.
    resume
        Go on with what is there; where nothing is, begin.
    tell
        Called with one line where the newest checkpoint is damaged, where there is none to go on with, and where none
        can be written.
    remedy
        What a user should do who did not ask to go on.

    Raises
    ------
    CheckpointError
        On entering: if another process is at work on it, if a run is there and `resume` is false, or if both its
        checkpoints are damaged.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        resume: bool = False,
        tell: Callable[[str], None] = lambda _: None,
        remedy: str = "pass resume=True",
    ) -> None:
        self.path = Path(path)
        self.estimate: Any = None
        self._resume, self._tell, self._remedy = resume, tell, remedy
        self._lock: int | None = None
        self._fingerprint: dict[str, str] | None = None
        self._known: dict[str, Any] | None = None
        self._stages: list[dict[str, Any]] = []
        self._draws: dict[int, _Draws] = {}
        self._saved = self._cost = 0.0
        self._failed = self._discarded = False

    def __enter__(self) -> Self:
        self._claim()
        try:
            self._look()
        except BaseException:
            self._free()
            raise
        self._saved = time.monotonic()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._discarded and not self.holds_a_run:
            self.discard()
        self._free()

    @property
    def holds_a_run(self) -> bool:
        """Whether there is a checkpoint to go on from."""
        return any((self.path / name).exists() for name in (_NEWEST, _PREVIOUS))

    @property
    def steps(self) -> int:
        """Steps of each ensemble that are on disk, of all stages."""
        return sum(stage["step"] for stage in self._stages)

    def begin(self, fingerprint: Mapping[str, str]) -> None:
        """Say what this is a run of: parts by name, each as a short text.

        Raises
        ------
        CheckpointError
            If the checkpoint is of something else: which parts.
        """
        self._fingerprint = dict(fingerprint)
        if self._known is None:
            return
        known: dict[str, str] = self._known["fingerprint"]
        names = [name for name in {**known, **fingerprint} if known.get(name) != fingerprint.get(name)]
        if names:
            other = "; ".join(
                f"{name}: found {fingerprint.get(name, 'nothing')}, expected {known.get(name, 'nothing')} as in the "
                "checkpoint"
                for name in names
            )
            raise CheckpointError(
                f"{self.path}: found an unfinished run of something else: {other}; undo the change, or remove that "
                "directory to begin anew"
            )
        self.estimate = self._known["estimate"]
        self._stages = self._known["stages"]

    def keep_estimate(self, estimate: Any) -> None:  # noqa: ANN401 (anything that JSON holds)
        """Keep what was found before the first step; written at once where finding it took long."""
        self.estimate = estimate
        if self._due(now=False):
            with self._timed():
                self._write()

    def stage(self, number: int) -> Stage | None:
        """What was made of a stage, or None."""
        if number >= len(self._stages):
            return None
        kept = self._stages[number]
        ensembles, walkers, dimension = kept["shape"]
        content = self._content(number, kept)
        values = np.frombuffer(content, dtype="<f8").reshape(-1, ensembles, walkers, dimension + 1)
        row = [
            Block(
                np.ascontiguousarray(values[:, e, :, :-1], dtype=float),
                np.ascontiguousarray(values[:, e, :, -1], dtype=float),
                {name: MoveCount(*count) for name, count in kept["moves"][e].items()},
                kept["singular"] if e == 0 else 0,
            )
            for e in range(ensembles)
        ]
        self._draws[number] = _Draws(
            1, kept["step"], len(content), hashlib.sha256(content), kept["moves"], kept["singular"]
        )
        return Stage([row], [_check(check) for check in kept["checks"]], kept["step"], kept["seconds"])

    def keep(self, number: int, stage: Stage, seconds: float, *, now: bool = False) -> None:
        """Write a checkpoint if the last one is long enough ago, or now.

        Parameters
        ----------
        number : int
            Number of the stage.
        stage : Stage
            All its steps so far.
        seconds : float
            Time spent on it.
        now : bool
            Write it whenever there is something new.
        """
        draws = self._draws.setdefault(number, _Draws())
        rows = stage.rows_from(draws.rows)
        if not stage.blocks or not self._due(now=now) or draws.step + _steps(rows) != stage.step:
            return
        if not rows and number < len(self._stages) and len(self._stages[number]["checks"]) == len(stage.checks):
            return
        with self._timed():
            self._append(number, draws, rows)
            ensembles, (_, walkers, dimension) = len(stage.blocks[0]), stage.blocks[0][0].theta.shape
            entry = {
                "shape": (ensembles, walkers, dimension),
                "step": draws.step,
                "size": draws.size,
                "sha256": draws.digest.hexdigest(),
                "moves": draws.moves,
                "singular": draws.singular,
                "seconds": seconds,
                "checks": [{**asdict(c), "tau": c.tau.tolist(), "r_hat": c.r_hat.tolist()} for c in stage.checks],
            }
            self._stages[number:] = [entry]
            self._write()

    def rows_on_disk(self, number: int) -> int:
        """Rows of a stage's blocks that have been written."""
        return self._draws[number].rows if number in self._draws else 0

    def discard(self) -> None:
        """Remove the directory: the run is finished, or was never begun."""
        for name in (_NEWEST, _PREVIOUS):  # what is left of it if this process is killed here is no run
            (self.path / name).unlink(missing_ok=True)
        shutil.rmtree(self.path, ignore_errors=True)
        self._discarded = True
        sync_directory(self.path.parent)

    def _claim(self) -> None:
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._lock = claimed(self.path / _LOCK)
        except FileNotFoundError:  # the process that had it has just removed it
            self.path.mkdir(parents=True, exist_ok=True)
            self._lock = claimed(self.path / _LOCK)
        if self._lock is None:
            other = (self.path / _LOCK).read_text(encoding="utf-8", errors="replace").strip() or "unknown"
            raise CheckpointError(
                f"{self.path}: found another run at work on it ({other}); expected none; wait for it, or choose "
                "another place"
            )
        os.truncate(self._lock, 0)
        os.pwrite(self._lock, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)

    def _free(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _look(self) -> None:
        """Read the newest whole checkpoint."""
        if not self.holds_a_run:
            if self._resume:
                self._tell(f"{self.path}: found no unfinished run; beginning one")
            return
        if not self._resume:
            raise CheckpointError(
                f"{self.path}: found an unfinished run; expected none; to go on with it {self._remedy}, or remove that "
                "directory to begin anew"
            )
        for name in (_NEWEST, _PREVIOUS):
            try:
                known = _read(self.path / name)
                for number, kept in enumerate(known["stages"]):
                    self._content(number, kept)
            except (OSError, ValueError, KeyError, TypeError) as error:
                if isinstance(error, FileNotFoundError) and name == _NEWEST:
                    continue  # killed between two renames
                self._tell(f"{self.path / name}: damaged ({type(error).__name__}); looking at the one before")
                (self.path / name).unlink(missing_ok=True)  # it must not take the place of the other
                continue
            self._known = known
            return
        raise CheckpointError(
            f"{self.path}: found both checkpoints damaged; expected one that is whole; remove that directory to begin "
            "anew"
        )

    def _content(self, number: int, kept: Mapping[str, Any]) -> bytes:
        """Draws of a stage, as they were written."""
        with self._file(number).open("rb") as stream:
            content = stream.read(kept["size"])
        if hashlib.sha256(content).hexdigest() != kept["sha256"]:
            raise ValueError(number)
        return content

    def _file(self, number: int) -> Path:
        return self.path / f"draws-{number}"

    def _due(self, *, now: bool) -> bool:
        return now or time.monotonic() - self._saved >= max(SECONDS_BETWEEN, _TIMES_THE_COST * self._cost)

    @contextmanager
    def _timed(self) -> Iterator[None]:
        """Time what is written; a disk that takes nothing costs no draws, they are still in memory."""
        begun = time.monotonic()
        try:
            yield
        except OSError as error:
            if not self._failed:
                self._tell(f"{self.path}: no checkpoint could be written ({error.strerror or error}); going on without")
            self._failed = True
        self._saved = time.monotonic()
        self._cost = self._saved - begun

    def _append(self, number: int, draws: _Draws, rows: list[list[Block]]) -> None:
        content = b"".join(_bytes(row) for row in rows)
        with open(os.open(self._file(number), os.O_WRONLY | os.O_CREAT, 0o666), "wb") as stream:
            stream.truncate(draws.size)  # what came after it belongs to no checkpoint
            stream.seek(draws.size)
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        draws.take(rows, content)

    def _write(self) -> None:
        """Write a checkpoint beside, force it to the disk and rename; the one before stays."""
        known = {
            "version": _VERSION,
            "fingerprint": self._fingerprint,
            "estimate": self.estimate,
            "stages": self._stages,
        }
        text = json.dumps(known).encode()
        newest, new = self.path / _NEWEST, self.path / _NEW
        with new.open("wb") as stream:
            stream.write(text + b"\n" + hashlib.sha256(text).hexdigest().encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())
        if newest.exists():
            newest.replace(self.path / _PREVIOUS)
        new.replace(newest)
        sync_directory(self.path)


def require_same_density(log_density: LogDensity, states: list[EnsembleState]) -> None:
    """Refuse to go on with draws of another density, as far as the last of them tell.

    Raises
    ------
    CheckpointError
        If the log-density there is another than the one that was kept.
    """
    for state in states:
        computed = log_density(state.theta)
        if not np.allclose(computed, state.log_density, rtol=1e-9, atol=1e-6):
            worst = int(np.argmax(np.abs(computed - state.log_density)))
            raise CheckpointError(
                f"checkpoint: found ln p = {computed[worst]:.6g} where the unfinished run had "
                f"{state.log_density[worst]:.6g}; expected the same density; undo the change, or begin anew"
            )


def _steps(rows: list[list[Block]]) -> int:
    return sum(len(row[0].theta) for row in rows)


def _bytes(row: list[Block]) -> bytes:
    """A block of all ensembles as it is kept: θ and log-density, the steps slowest."""
    values = [np.concatenate([block.theta, block.log_density[..., None]], axis=-1) for block in row]
    return np.stack(values, axis=1).astype("<f8", copy=False).tobytes()


def _read(path: Path) -> dict[str, Any]:
    text, digest, _ = path.read_bytes().rsplit(b"\n", 2)
    if hashlib.sha256(text).hexdigest().encode() != digest:
        raise ValueError(path)
    known: dict[str, Any] = json.loads(text)
    if known["version"] != _VERSION:
        raise CheckpointError(
            f"{path}: found checkpoint version {known['version']}; expected {_VERSION}; go on with the jointbayes that "
            "wrote it"
        )
    return known


def _check(kept: Mapping[str, Any]) -> Check:
    error = kept["end_error"]
    return Check(
        step=kept["step"],
        burn_in=kept["burn_in"],
        tau=np.array(kept["tau"]),
        r_hat=np.array(kept["r_hat"]),
        end_error=EndError(**error) if error else None,
        modes_tau=kept["modes_tau"],
        modes_r_hat=kept["modes_r_hat"],
    )
