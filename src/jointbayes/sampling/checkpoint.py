"""A run on disk while it is not finished: its blocks of steps, beside the result, so that it can go on."""

import hashlib
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from jointbayes.errors import CheckpointError, WriteError
from jointbayes.own_directory import OwnDirectory, sync_directory
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.ensemble import EnsembleState, MoveCount, StepBlock

#: Least time between two writings, and how many times as long as the last one took: they cost less than 2 %.
SECONDS_BETWEEN = 5.0
_TIMES_THE_COST = 50

_VERSION = 2
_BLOCKS, _DRAWS = "blocks", "draws"
_FILES = (_BLOCKS, _DRAWS, "posterior.nc")  # the last one while the report is written

_Count = Annotated[int, Field(ge=0, lt=2**62)]


class _SignedLine(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")

    def written(self) -> bytes:
        """The line, with its digest before it."""
        text = json.dumps(self.model_dump()).encode()
        return hashlib.sha256(text).hexdigest().encode() + b" " + text + b"\n"


class _HeadLine(_SignedLine):
    """What all blocks are of."""

    version: int
    fingerprint: dict[str, str]


class _EstimateLine(_SignedLine):
    """What was found before the first step."""

    estimate: dict[str, Any]


class _BlockLine(_SignedLine):
    """A block of steps of all ensembles: where it is in the file of draws, and its digest."""

    stage: _Count
    block: _Count
    offset: _Count
    shape: tuple[_Count, _Count, _Count, _Count]  # steps, ensembles, walkers, θ and log-density
    sha256: str
    moves: tuple[dict[str, tuple[_Count, _Count]], ...]
    singular: _Count
    seconds: Annotated[float, Field(ge=0, allow_inf_nan=False)]  # spent on the stage so far

    @property
    def size(self) -> int:
        """Bytes of draws."""
        return 8 * math.prod(self.shape)


_ANY_LINE = TypeAdapter[_HeadLine | _EstimateLine | _BlockLine](_HeadLine | _EstimateLine | _BlockLine)


class UnfinishedRun:
    """The directory of a run that is not finished, locked by the process that is at work on it.

    ``draws`` has the draws of blocks of steps, one after the other. ``blocks`` has a line for each, with its digest,
    and before them what the run is of, twice, and the mode that was found. Both only grow, the draws first. The random
    numbers of a block are a function of its number: one that is damaged is made again, bit for bit, and the others
    stay.

    Parameters
    ----------
    path
        The directory; it is made if it is not there. One that somebody else made is refused.
    resume
        Go on with what is there; where nothing is, begin.
    tell
        Called with one line where blocks are damaged, where there is no run to go on with, and where none can be
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
        path: str | os.PathLike[str],
        *,
        resume: bool = False,
        tell: Callable[[str], None] = lambda _: None,
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
        self._resume, self._tell, self._remedy = resume, tell, remedy
        self._head: _HeadLine | None = None
        self._blocks: dict[tuple[int, int], _BlockLine] = {}  # by stage and number
        self._rows: dict[int, int] = {}  # of each stage: so many blocks from its first one on are on disk
        self._end = dict.fromkeys((_BLOCKS, _DRAWS), 0)  # what comes after it was not written whole
        self._begun = self._kept_estimate = self._failed = self._discarded = False
        self._saved = self._cost = 0.0

    def __enter__(self) -> Self:
        self._own.__enter__()
        try:
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
    def holds_a_run(self) -> bool:
        """Whether there is anything to go on from."""
        return self._end[_BLOCKS] > 0

    @property
    def steps(self) -> int:
        """Steps of each ensemble that are on disk, of all stages."""
        return sum(block.shape[0] for block in self._blocks.values())

    def begin(self, fingerprint: Mapping[str, str]) -> None:
        """Say what this is a run of: parts by name, each as a short text.

        Raises
        ------
        CheckpointError
            If what is there is of something else: which parts.
        """
        kept = dict(fingerprint) if self._head is None else self._head.fingerprint
        self._head = _HeadLine(version=_VERSION, fingerprint=dict(fingerprint))
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
        self.estimate, self._kept_estimate = estimate, False
        if self._due(now=False):
            with self._timed():
                self._write([], b"")

    def block(self, stage: int, number: int, shape: tuple[int, ...]) -> list[StepBlock] | None:
        """A block of all ensembles of a stage, if it is on disk and of this shape."""
        kept = self._blocks.get((stage, number))
        if kept is None or kept.shape != shape:
            self._blocks.pop((stage, number), None)
            return None
        values = np.frombuffer(self._content(_DRAWS, kept.offset, kept.size), dtype="<f8").reshape(kept.shape)
        return [
            StepBlock(
                np.ascontiguousarray(values[:, e, :, :-1], dtype=float),
                np.ascontiguousarray(values[:, e, :, -1], dtype=float),
                {name: MoveCount(*count) for name, count in moves.items()},
                kept.singular if e == 0 else 0,
            )
            for e, moves in enumerate(kept.moves)
        ]

    def ends_with(self, stage: int, rows: int) -> bool:
        """Whether the last of so many blocks of a stage is on disk, and the next one is not."""
        return (stage, rows - 1) in self._blocks and (stage, rows) not in self._blocks

    def seconds(self, stage: int) -> float:
        """Time that was spent on a stage before this process went on with it."""
        return max((block.seconds for (of, _), block in self._blocks.items() if of == stage), default=0.0)

    def keep(self, number: int, first: int, rows: list[list[StepBlock]], seconds: float, *, now: bool = False) -> None:
        """Write the blocks that are not on disk if the last writing is long enough ago, or now.

        Parameters
        ----------
        number : int
            Number of the stage.
        first : int
            Number of the first of these rows.
        rows : list of list of StepBlock
            The last blocks of all ensembles, and all that are not on disk among them.
        seconds : float
            Time spent on it.
        now : bool
            Write whenever there is something new.
        """
        new = [(n, row) for n, row in enumerate(rows, first) if (number, n) not in self._blocks]
        if not new or not self._due(now=now):
            return
        with self._timed():
            blocks, content = list[_BlockLine](), bytearray()
            for n, row in new:
                draws = _bytes(row)
                blocks.append(
                    _BlockLine(
                        stage=number,
                        block=n,
                        offset=self._end[_DRAWS] + len(content),
                        shape=(len(row[0].theta), len(row), row[0].theta.shape[1], row[0].theta.shape[2] + 1),
                        sha256=hashlib.sha256(draws).hexdigest(),
                        moves=tuple({k: (int(c.accepted), int(c.proposed)) for k, c in b.moves.items()} for b in row),
                        singular=sum(int(block.singular) for block in row),
                        seconds=seconds,
                    )
                )
                content += draws
            self._write(blocks, bytes(content))

    def rows_on_disk(self, number: int) -> int:
        """Blocks of a stage that have been written, from its first one to the first that has not."""
        count = self._rows.get(number, 0)
        while (number, count) in self._blocks:
            count += 1
        self._rows[number] = count
        return count

    def discard(self) -> None:
        """Remove the directory: the run is finished, or was never begun. What is not ours in it stays."""
        self._own.dissolve(*_FILES)
        self._discarded = True

    def _look(self) -> None:
        """Read what is there, and leave out what is damaged."""
        names = self._own.names()
        text = self._content(_BLOCKS) if _BLOCKS in names else b""
        self._end[_BLOCKS] = text.rfind(b"\n") + 1
        if not text:
            if self._resume:
                self._tell(f"{self.path}: found no unfinished run; beginning one")
            return
        if not self._resume:
            raise CheckpointError(
                f"{self.path}: found an unfinished run; expected none; to go on with it {self._remedy}, or remove that "
                "directory to begin anew"
            )
        lines = [_parsed(line) for line in text[: self._end[_BLOCKS]].split(b"\n")[:-1]]
        damaged = lines.count(None)
        for line in lines:
            if isinstance(line, _HeadLine):
                self._head, self._begun = line, True
            elif isinstance(line, _EstimateLine):
                self.estimate, self._kept_estimate = line.estimate, True
            elif isinstance(line, _BlockLine):
                if _DRAWS in names and self._is_whole(line):
                    self._blocks[line.stage, line.block] = line
                    self._end[_DRAWS] = max(self._end[_DRAWS], line.offset + line.size)
                else:
                    damaged += 1
        if self._head is None or self._head.version != _VERSION:
            state = "a damaged checkpoint" if self._head is None else f"checkpoint version {self._head.version}"
            raise CheckpointError(
                f"{self.path}: found {state}; expected version {_VERSION}; remove that directory to begin anew"
            )
        if damaged:
            self._tell(f"{self.path}: found {damaged} damaged blocks of steps; they are made again")

    def _is_whole(self, block: _BlockLine) -> bool:
        """Whether the draws of a block are as they were written."""
        if not block.size or len(block.moves) != block.shape[1] or block.shape[3] < 2:
            return False
        content = self._content(_DRAWS, block.offset, block.size)
        if hashlib.sha256(content).hexdigest() != block.sha256:
            return False
        return bool(np.isfinite(np.frombuffer(content, dtype="<f8")).all())

    def _content(self, name: str, offset: int = 0, size: int | None = None) -> bytes:
        """What is in a file, or so many bytes of it; nothing if it has not as many."""
        with os.fdopen(self._own.open(name, os.O_RDONLY), "rb") as stream:
            if size is not None and offset + size > os.fstat(stream.fileno()).st_size:
                return b""
            stream.seek(offset)
            return stream.read(-1 if size is None else size)

    def _due(self, *, now: bool) -> bool:
        return now or time.monotonic() - self._saved >= max(SECONDS_BETWEEN, _TIMES_THE_COST * self._cost)

    @contextmanager
    def _timed(self) -> Iterator[None]:
        """Time what is written; a disk that takes nothing costs no draws, they are still in memory."""
        begun = time.monotonic()
        try:
            yield
        except (OSError, WriteError) as error:
            reason = getattr(error, "strerror", None) or error
            if not self._failed:
                self._tell(f"{self.path}: no checkpoint could be written ({reason}); going on without")
            self._failed = True
        self._saved = time.monotonic()
        self._cost = self._saved - begun

    def _write(self, blocks: list[_BlockLine], draws: bytes) -> None:
        """Append draws, and then the lines that say what they are."""
        assert self._head is not None
        lines = [] if self._begun else [self._head.written()] * 2  # either will do
        if self.estimate is not None and not self._kept_estimate:
            lines.append(_EstimateLine(estimate=self.estimate).written())
        lines += [block.written() for block in blocks]
        text = b"".join(lines)
        for name, content in ((_DRAWS, draws), (_BLOCKS, text)):
            with os.fdopen(self._own.open(name, os.O_WRONLY | os.O_CREAT), "wb") as stream:
                stream.truncate(self._end[name])
                stream.seek(self._end[name])
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
        if not self._begun:
            sync_directory(self.path)
        self._end = {_DRAWS: self._end[_DRAWS] + len(draws), _BLOCKS: self._end[_BLOCKS] + len(text)}
        self._begun, self._kept_estimate = True, self.estimate is not None
        self._blocks |= {(block.stage, block.block): block for block in blocks}


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


def _bytes(row: list[StepBlock]) -> bytes:
    """A block of all ensembles as it is kept: θ and log-density, the steps slowest."""
    values = [np.concatenate([block.theta, block.log_density[..., None]], axis=-1) for block in row]
    return np.stack(values, axis=1).astype("<f8", copy=False).tobytes()


def _parsed(written: bytes) -> _HeadLine | _EstimateLine | _BlockLine | None:
    """What a line says; None where it is not what was written."""
    digest, _, text = written.partition(b" ")
    if hashlib.sha256(text).hexdigest().encode() != digest:
        return None
    try:
        return _ANY_LINE.validate_json(text)
    except ValueError:
        return None
