"""A run on disk while it is not finished: its stages so far, beside the result, so that it can go on."""

import io
import json
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from os import O_RDONLY, PathLike, fdopen
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import CheckpointError, WriteError
from jointbayes.progress import Progress, ProgressCallback, tell_nobody
from jointbayes.sampling.chains import HeldSteps, Stage, spacing
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.ensemble import EnsembleState, MoveCount
from jointbayes.sampling.stopping import Check, EndError
from vibrecords.arrays import Array
from vibrecords.own_directory import OwnDirectory
from vibrecords.whole_file import swept, write_whole_file

#: Least time between two writings, and how many times as long as the last one took: they cost less than 2 %.
SECONDS_BETWEEN = 5.0
_TIMES_THE_COST = 50

_Made = TypeVar("_Made")

_VERSION = 3
_RUN, _STAGE = "run.npz", "stage-{}.npz"
_OLDER = {"blocks", "draws"}  # files of version 2
_DRAWS = "posterior.nc"  # while the report is written


class UnfinishedRun:
    """The directory of a run that is not finished, locked by the process that is at work on it.

    ``run.npz`` says what the run is of, and has the mode that was found; ``stage-N.npz`` has the steps of a stage so
    far. Each is written whole or not at all, and its archive has a check sum. The random numbers of a block of steps
    are a function of its number: a stage whose file is damaged is made again, bit for bit.

    Parameters
    ----------
    path
        The directory; it is made if it is not there. One that somebody else made is refused.
    resume
        Go on with what is there; where nothing is, begin.
    progress
        Called with a remark where a stage is damaged, where there is no run to go on with, and where nothing can be
        written.
    remedy
        What a user should do who did not ask to go on.

    Raises
    ------
    CheckpointError
        On entering: if the directory is not ours, if another process is at work on it, if a run is there and `resume`
        is false, or if what it is a run of cannot be read or is of another version.
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
        self.estimate: Any = None
        self._own = OwnDirectory(
            path,
            "an unfinished run",
            "choose another place, or remove it if an older jointbayes left it",
            error=CheckpointError,
            private=True,
        )
        self._resume, self._progress, self._remedy = resume, progress, remedy
        self._fingerprint: dict[str, str] | None = None
        self._stages: dict[int, tuple[Stage, list[EnsembleState], float]] = {}  # as they were read
        self._steps: dict[int, int] = {}  # of each stage, on disk
        #: Whether there is anything to go on from.
        self.holds_a_run = False
        self._run_is_written = self._failed = self._discarded = False
        self._saved = self._cost = 0.0

    def __enter__(self) -> Self:
        self._own.__enter__()
        try:
            swept(self.path)
            self._look()
        except BaseException:
            self._own.leave()
            raise
        self._saved = time.monotonic()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._discarded and not self.holds_a_run:
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
        self.estimate, self._run_is_written = estimate, False
        if self._due(now=False):
            with self._timed():
                self._write_run()

    def stage(self, number: int) -> tuple[Stage, list[EnsembleState], float] | None:
        """A stage that was on disk, where its ensembles stand, and the seconds spent on it; None where it was not."""
        return self._stages.pop(number, None)

    def keep(self, number: int, stage: Stage, seconds: float, *, now: bool = False) -> None:
        """Write a stage if it has new steps and the last writing is long enough ago, or now.

        Parameters
        ----------
        number : int
            Number of the stage.
        stage : Stage
            All steps so far.
        seconds : float
            Time spent on it.
        now : bool
            Write whenever there is something new.
        """
        if self._steps.get(number, 0) == stage.step or not self._due(now=now):
            return
        with self._timed():
            self._write_run()
            self._write(_STAGE.format(number), *_stage_record(stage, seconds))
            self._steps[number] = stage.step

    def discard(self) -> None:
        """Remove the directory: the run is finished, or was never begun. What is not ours in it stays."""
        self._own.dissolve(_RUN, _DRAWS, *(_STAGE.format(number) for number in self._stage_numbers()))
        self._discarded = True

    def _stage_numbers(self) -> list[int]:
        matches = (re.fullmatch(r"stage-(\d{1,3})\.npz", name) for name in self._own.names())
        return sorted(int(match[1]) for match in matches if match)

    def _look(self) -> None:
        """Read what is there, and leave out what is damaged."""
        names = self._own.names()
        self.holds_a_run = bool(names & {_RUN, *_OLDER})
        if not self.holds_a_run:
            for number in self._stage_numbers():  # of a run whose end was killed as it removed them
                self._own.remove(_STAGE.format(number))
            if self._resume:
                self._tell("found no unfinished run; beginning one")
            return
        if not self._resume:
            raise CheckpointError(
                f"{self.path}: found an unfinished run; expected none; to go on with it {self._remedy}, or remove that "
                "directory to begin anew"
            )
        record: dict[str, Any] | None
        record = self._read(_RUN, lambda plain, _: dict(plain)) if _RUN in names else {"version": 2}
        if record is None or record.get("version") != _VERSION:
            state = "a damaged checkpoint" if record is None else f"checkpoint version {record.get('version')}"
            raise CheckpointError(
                f"{self.path}: found {state}; expected version {_VERSION}; remove that directory to begin anew"
            )
        self._fingerprint, self.estimate = record.get("fingerprint", {}), record.get("estimate")
        self._run_is_written = True
        for number in self._stage_numbers():
            stage = self._read(_STAGE.format(number), _stage_from_record)
            if stage is None:
                self._tell(f"found a damaged {_STAGE.format(number)}; its steps are made again")
            else:
                self._stages[number], self._steps[number] = stage, stage[0].step

    def _tell(self, remark: str) -> None:
        self._progress(Progress("checkpoint", f"{self.path}: {remark}"))

    def _read(self, name: str, make: Callable[[dict[str, Any], dict[str, NDArray[Any]]], _Made]) -> _Made | None:
        """What is made of the record and the arrays of a file; None where they are not what was written."""
        with fdopen(self._own.open(name, O_RDONLY), "rb") as stream:
            try:
                with np.load(stream, allow_pickle=False) as archive:
                    arrays = dict(archive)
                return make(json.loads(str(arrays.pop("record"))), arrays)
            except Exception:  # a flipped bit may lead to any
                return None

    def _due(self, *, now: bool) -> bool:
        return now or time.monotonic() - self._saved >= max(SECONDS_BETWEEN, _TIMES_THE_COST * self._cost)

    @contextmanager
    def _timed(self) -> Iterator[None]:
        """Time what is written; a disk that takes nothing costs no draws, they are still in memory."""
        begun = time.monotonic()
        try:
            yield
        except WriteError as error:
            reason = getattr(error.__cause__, "strerror", None) or error
            if not self._failed:
                self._tell(f"no checkpoint could be written ({reason}); going on without")
            self._failed = True
        self._saved = time.monotonic()
        self._cost = self._saved - begun

    def _write_run(self) -> None:
        if not self._run_is_written:
            record = {"version": _VERSION, "fingerprint": self._fingerprint, "estimate": self.estimate}
            self._write(_RUN, record, {})
            self._run_is_written = True

    def _write(self, name: str, record: dict[str, Any], arrays: Mapping[str, Any]) -> None:
        content = io.BytesIO()
        text = json.dumps(record, default=lambda value: value.tolist())
        np.savez(content, record=np.array(text), **arrays)
        write_whole_file(self.path / name, content.getvalue())
        self.holds_a_run = True


def _stage_record(stage: Stage, seconds: float) -> tuple[dict[str, Any], dict[str, Array]]:
    """A stage as plain values and arrays: of a long one the steps that it holds, and always the last."""
    every, ends = spacing(stage.step), [block.end for block in stage.blocks[-1]]
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
        "end": np.stack([state.theta for state in ends]),
        "end_log_density": np.stack([state.log_density for state in ends]),
    }


def _stage_from_record(
    record: dict[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> tuple[Stage, list[EnsembleState], float]:
    """A stage, where its ensembles stand, and the seconds spent on it, from what `_stage_record` made of it."""
    stage = Stage(
        checks=[_check(plain) for plain in record["checks"]],
        step=record["step"],
        held=HeldSteps(record["step"], record["every"], [arrays["theta"]], [arrays["log_density"]]),
        counts={name: MoveCount(*count) for name, count in record["counts"].items()},
        accepted=list(record["accepted"]),
        singular=record["singular"],
    )
    pairs = zip(arrays["end"], arrays["end_log_density"], strict=True)
    return stage, [EnsembleState(theta, log_density) for theta, log_density in pairs], record["seconds"]


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
