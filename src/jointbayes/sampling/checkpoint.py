"""A run on disk while it is not finished: all of it in one file beside the result, so that it can go on."""

import io
import json
import signal
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from os import PathLike, path
from pathlib import Path
from types import FrameType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import CheckpointError, WriteError
from jointbayes.progress import Progress, ProgressCallback, tell_nobody
from jointbayes.sampling.chains import HeldSteps, Stage, spacing
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.ensemble import EnsembleState, MoveCount
from jointbayes.sampling.stopping import Check, EndError
from vibrecords.arrays import Array
from vibrecords.files import OwnDirectory, open_regular, sweep, write_whole_file

#: Least time between two writings, and how many times as long as the last one took: they cost less than 2 %.
SECONDS_BETWEEN = 1.0
_TIMES_THE_COST = 50

_VERSION = 4
_FILE = "run.npz"
_DRAWS = "posterior.nc"  # while the report is written

KeptStage = tuple[Stage, list[EnsembleState], float]
"""A stage so far, where its ensembles stand, and the seconds spent on it."""


class UnfinishedRun:
    """The directory of a run that is not finished, locked by the process that is at work on it.

    ``run.npz`` says what the run is of, and has the mode that was found and the steps of all stages so far. It is
    written whole or not at all, and its archive has check sums. The random numbers of a block of steps are a function
    of its number: where the file is damaged, the run is made again, bit for bit.

    Parameters
    ----------
    path
        The directory; it is made if it is not there. One that somebody else made is refused.
    resume
        Go on with what is there; where nothing is, begin.
    progress
        Called with a remark where the file is damaged, where there is no run to go on with, and where nothing can be
        written.
    remedy
        What a user should do who did not ask to go on.

    Raises
    ------
    CheckpointError
        On entering: if the directory is not ours, if another process is at work on it, if a run is there and `resume`
        is false, or if it is one of another version.
    WriteError
        On entering: if a link or anything but a regular file has the name of one of its files.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        *,
        resume: bool = False,
        progress: ProgressCallback = tell_nobody,
        remedy: str = "pass resume=True",
    ) -> None:
        self.path = Path(path)
        #: The mode that was found, as it was kept.
        self.estimate: Any = None
        #: Whether there is anything to go on from.
        self.holds_a_run = False
        what_to_do = "choose another place, or remove it if an older jointbayes left it"
        self._own = OwnDirectory(path, "an unfinished run", what_to_do, error=CheckpointError, private=True)
        self._resume, self._progress, self._remedy = resume, progress, remedy
        self._fingerprint: dict[str, str] | None = None
        self._stages: dict[int, KeptStage] = {}
        self._steps: dict[int, int] = {}  # of each stage, on disk
        self._failed, self._saved, self._cost = False, 0.0, 0.0

    def __enter__(self) -> Self:
        self._own.__enter__()
        try:
            sweep(self.path)
            self._look()
        except BaseException:
            self._own.leave()
            raise
        self._saved = time.monotonic()
        return self

    def __exit__(self, *_error: object) -> None:
        if not self.holds_a_run:
            self.discard()
        self._own.leave()

    @property
    def steps(self) -> int:
        """Steps of each ensemble that are on disk, of all stages."""
        return sum(self._steps.values())

    def begin(self, fingerprint: Mapping[str, str]) -> None:
        """Say what this is a run of: parts by name, each as a short text.

        Raises
        ------
        CheckpointError
            If what is there is of something else: which parts.
        """
        kept = dict(fingerprint) if self._fingerprint is None else self._fingerprint
        self._fingerprint = dict(fingerprint)
        names = [name for name in {**kept, **fingerprint} if kept.get(name) != fingerprint.get(name)]
        if names:
            differences = "; ".join(
                f"{name}: found {fingerprint.get(name, 'nothing')}, expected {kept.get(name, 'nothing')} as in the "
                "checkpoint"
                for name in names
            )
            raise CheckpointError(
                f"{self.path}: found an unfinished run of something else: {differences}; undo the change, or remove "
                "that directory to begin anew"
            )

    def keep_estimate(self, estimate: dict[str, Any]) -> None:
        """Keep what was found before the first step; written at once where finding it took long."""
        self.estimate = estimate
        self._save()

    def stage(self, number: int) -> KeptStage | None:
        """A stage that was on disk; None where it was not."""
        return self._stages.get(number)

    def keep(
        self, number: int, stage: Stage, states: list[EnsembleState], seconds: float, *, now: bool = False
    ) -> None:
        """Write the run if a stage has new steps and the last writing is long enough ago, or now.

        Parameters
        ----------
        number : int
            Number of the stage.
        stage : Stage
            All steps so far.
        states : list of EnsembleState
            Where its ensembles stand.
        seconds : float
            Time spent on it.
        now : bool
            Write whenever there is something new.
        """
        if self._steps.get(number, 0) != stage.step:
            self._stages[number] = stage, states, seconds
            self._save(now=now)

    def discard(self) -> None:
        """Remove the directory: the run is finished, or was never begun. What is not ours in it stays."""
        self.holds_a_run = False
        self._own.dissolve(_FILE, _DRAWS)

    def _look(self) -> None:
        """Read what is there."""
        self.holds_a_run = path.lexists(self.path / _FILE)
        if not self.holds_a_run:
            if self._resume:
                self._tell("found no unfinished run; beginning one")
            return
        if not self._resume:
            raise CheckpointError(
                f"{self.path}: found an unfinished run; expected none; to go on with it {self._remedy}, or remove that "
                "directory to begin anew"
            )
        found = self._read()
        if found is None:
            self._tell(f"found a damaged {_FILE}; its steps are made again")
            return
        record, self._stages = found
        if record.get("version") != _VERSION:
            raise CheckpointError(
                f"{self.path}: found checkpoint version {record.get('version')}; expected version {_VERSION}; remove "
                "that directory to begin anew"
            )
        self._fingerprint, self.estimate = record.get("fingerprint", {}), record.get("estimate")
        self._steps = {number: stage.step for number, (stage, _, _) in self._stages.items()}

    def _read(self) -> tuple[dict[str, Any], dict[int, KeptStage]] | None:
        """The record and the stages of the file; None where they are not what was written."""
        with open_regular(self.path / _FILE, "rb") as stream:
            try:
                with np.load(stream, allow_pickle=False) as archive:
                    arrays = dict(archive)
                record = json.loads(str(arrays["record"]))
                stages = record.get("stages", {}).items()
                return record, {int(number): _stage_from_record(plain, arrays, number) for number, plain in stages}
            except Exception:  # a flipped bit may lead to any
                return None

    def _tell(self, remark: str) -> None:
        self._progress(Progress("checkpoint", f"{self.path}: {remark}"))

    def _save(self, *, now: bool = False) -> None:
        """Write all, now or if the time has come; a disk that takes nothing costs no draws, they are in memory."""
        begun = time.monotonic()
        if not now and begun - self._saved < max(SECONDS_BETWEEN, _TIMES_THE_COST * self._cost):
            return
        stages = {number: _stage_record(*kept) for number, kept in self._stages.items()}
        record = {
            "version": _VERSION,
            "fingerprint": self._fingerprint,
            "estimate": self.estimate,
            "stages": {number: plain for number, (plain, _) in stages.items()},
        }
        arrays: dict[str, Any] = {f"{n}.{name}": array for n, (_, of) in stages.items() for name, array in of.items()}
        text, content = json.dumps(record, default=lambda value: value.tolist()), io.BytesIO()
        np.savez(content, record=np.array(text), **arrays)
        try:
            write_whole_file(self.path / _FILE, content.getbuffer())
        except WriteError as error:
            reason = getattr(error.__cause__, "strerror", None) or error
            if not self._failed:
                self._tell(f"no checkpoint could be written ({reason}); going on without")
            self._failed = True
        else:
            self.holds_a_run = True
            self._steps = {number: stage.step for number, (stage, _, _) in self._stages.items()}
        self._saved = time.monotonic()
        self._cost = self._saved - begun


@contextmanager
def finished_first(*, wait: bool = True) -> Iterator[list[int]]:
    """Let SIGINT, SIGTERM and SIGHUP wait for the end of the body, where Python answers them; a second one does not.

    Whatever the body raises after a signal gives way to what the signal's own handler raises.

    Parameters
    ----------
    wait
        Whether they wait at all.

    Yields
    ------
    list of int
        Signals that have come so far.
    """
    if not wait or threading.current_thread() is not threading.main_thread():
        yield []  # signals come to the main thread only
        return
    numbers = (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM))
    answered = {int(number): handler for number in numbers if callable(handler := signal.getsignal(number))}
    waiting: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        waiting.append(number)
        if len(waiting) > 1:
            answered[number](number, frame)

    for number in answered:
        signal.signal(number, note)
    try:
        yield waiting
    finally:
        for number, handler in answered.items():
            signal.signal(number, handler)
        if waiting:
            answered[waiting[0]](waiting[0], None)


def _stage_record(stage: Stage, states: list[EnsembleState], seconds: float) -> tuple[dict[str, Any], dict[str, Array]]:
    """A stage as plain values and arrays: of a long one the steps that it holds, and always the last."""
    every = spacing(stage.step)
    theta, log_density = stage.held.joined(stage.blocks, every)
    record = {
        "step": stage.step,
        "every": every,
        "checks": [asdict(check) for check in stage.checks],
        "counts": {name: (count.accepted, count.proposed) for name, count in stage.counts.items()},
        "accepted": stage.accepted,
        "singular": stage.singular,
        "seconds": seconds,
    }
    return record, {
        "theta": theta,
        "log_density": log_density,
        "end": np.stack([state.theta for state in states]),
        "end_log_density": np.stack([state.log_density for state in states]),
    }


def _stage_from_record(record: dict[str, Any], arrays: Mapping[str, NDArray[Any]], number: str) -> KeptStage:
    """A stage from what `_stage_record` made of it."""
    theta, log_density, end, end_log_density = (
        arrays[f"{number}.{name}"] for name in ("theta", "log_density", "end", "end_log_density")
    )
    stage = Stage(
        checks=[_check(plain) for plain in record["checks"]],
        step=record["step"],
        held=HeldSteps(record["step"], record["every"], [theta], [log_density]),
        counts={name: MoveCount(*count) for name, count in record["counts"].items()},
        accepted=list(record["accepted"]),
        singular=record["singular"],
    )
    return stage, list(map(EnsembleState, end, end_log_density)), record["seconds"]


def _check(plain: dict[str, Any]) -> Check:
    arrays = {name: np.array(plain[name], dtype=float) for name in ("tau", "r_hat")}
    return Check(**{**plain, **arrays, "end_error": plain["end_error"] and EndError(**plain["end_error"])})


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
