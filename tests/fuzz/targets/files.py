"""Measurement files of all formats: what `inspect` and `read_frf` make of them."""

import gc
import os
import random
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO

from tests.fuzz.files import arrays, text
from tests.fuzz.target import Target

#: Of HDF5 and MATLAB files one in so many goes through a reading process of its own, as for a user; the others through
#: a copy of this process, which has the libraries loaded and is bounded in the same way.
_REAL_ONE_IN = 100

_real_child: Any = None


class FileTarget(Target):
    """A format of measurement files."""

    def __init__(self, name: str, damage: Callable[[random.Random, bytes], bytes], own_process: bool = False) -> None:
        self.name, self._damage, self._own_process = name, damage, own_process
        self.suffix = f".{name}"

    def mutate(self, rng: random.Random, content: bytes) -> bytes:
        """One to three damages that leave some of the format's structure."""
        return self._damage(rng, content)

    def prepare(self, directory: Path) -> None:
        """Load what readers and inspection load when they need it."""
        from jointbayes.measurement.formats.arrays import read

        global _real_child
        if self._own_process:
            import h5py  # noqa: F401
            import scipy.io  # noqa: F401

            _real_child = read._child
            read._child = _copied_process  # type: ignore[assignment]
        for path in self.corpus()[:6]:
            self._attempted(path)

    def attempt(self, path: Path) -> None:
        """Inspect the file and read its FRFs."""
        error = self._attempted(path)
        if error is not None:
            raise error

    def _attempted(self, path: Path) -> Exception | None:
        from jointbayes.errors import MeasurementError
        from jointbayes.measurement.formats import read_frf
        from jointbayes.measurement.inspection.inspection import inspect_file
        from jointbayes.measurement.inspection.text import text_of

        refused: MeasurementError | None = None
        try:
            inspection = inspect_file(path, 2.0)
        except MeasurementError as error:
            refused = error
        else:
            list(text_of(inspection))
            _maybe_drawn(inspection, path)
        if self._own_process and refused is not None:
            return refused  # reading it once more would refuse it again
        try:
            read_frf(path)
        except MeasurementError as error:
            refused = refused or error
        return refused

    def message_fault(self, message: str, path: Path) -> str:
        """As for all targets; a blank of another width is as good as a blank."""
        from jointbayes.errors import printable

        return super().message_fault("".join(" " if c.isspace() and printable(c) == c else c for c in message), path)


def _maybe_drawn(inspection: Any, path: Path) -> None:
    """Of one file in a hundred the figure as well, which takes longer than all the rest."""
    if sha256(path.read_bytes()).digest()[0] >= 3:
        return
    from jointbayes.report.inspect_figure import inspect_figure

    traces = [(f"{t.channel} hit {t.hit.number}", t.hit.reason, t.time_s, t.force_n) for t in inspection.hits]
    inspect_figure(inspection.frfs, inspection.modes, traces)


class _Copy:
    """A copy of this process that reads, with as much of `subprocess.Popen` as is used."""

    def __init__(self, pid: int, stdout: BinaryIO) -> None:
        self._pid, self.stdout, self._code = pid, stdout, None

    def wait(self) -> int:
        if self._code is None:
            self._code = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
        return self._code

    def kill(self) -> None:
        if self._code is None:
            os.kill(self._pid, 9)


@contextmanager
def _copied_process(command: list[str], seconds: float) -> Iterator[tuple[Any, Callable[[], None]]]:
    """As `_child` of the reader, by fork."""
    if int.from_bytes(sha256(Path(command[4]).read_bytes()).digest()[:4]) % _REAL_ONE_IN == 0:
        with _real_child(command, seconds) as child:
            yield child
        return
    reading, writing = os.pipe()
    gc.disable()  # what is found would be closed here and, once more, in the process that this one is a copy of
    pid = os.fork()
    if pid == 0:
        _read(command[3:], writing)
    gc.enable()
    os.close(writing)
    copy = _Copy(pid, os.fdopen(reading, "rb"))
    try:
        yield copy, lambda: None
    finally:
        copy.kill()
        copy.stdout.close()
        copy.wait()


def _read(arguments: list[str], writing: int) -> None:
    """What the reading process does, and the end of this one."""
    code = 1
    try:
        import faulthandler

        from jointbayes.measurement.formats.arrays import reader_process

        faulthandler.disable()
        nowhere = os.open(os.devnull, os.O_RDWR)
        for descriptor in (0, 2):
            os.dup2(nowhere, descriptor)
        os.dup2(writing, 1)
        sys.stdout = os.fdopen(1, "w", closefd=False)
        code = reader_process.main(arguments)
        sys.stdout.flush()
    finally:
        os._exit(code)


TARGETS = [
    FileTarget("uff58", text.damaged_uff),
    FileTarget("uff58b", text.damaged_uff),
    FileTarget("csv", text.damaged_table),
    FileTarget("tsv", text.damaged_table),
    FileTarget("lvm", text.damaged_lvm),
    FileTarget("npz", arrays.damaged_npz),
    FileTarget("mat", arrays.damaged_mat, own_process=True),
    FileTarget("mat73", arrays.damaged_mat73, own_process=True),
    FileTarget("hdf5", arrays.damaged_hdf5, own_process=True),
]
