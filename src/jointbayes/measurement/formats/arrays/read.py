"""Files of named arrays: npz, never a pickle; HDF5 and MATLAB, in a process of their own.

Damaged bytes make the C code of both libraries crash, hang or reserve gigabytes: of 650 MAT files with flipped bits or
cut ends three ended scipy with a segmentation fault, of as many of version 7.3 one aborted h5py. There that ends the
process, and here it is an error of one line.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import warnings
import zipfile
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.arrays import reader_process
from jointbayes.measurement.formats.arrays.layout import Arrays

#: A compressed file may unpack to this many times its size, which measured FRFs do not come near, or to 1 MiB: small
#: files have headers and constant coherences, which pack well.
_RATIO, _ALWAYS = 20, 2**20
#: Computing that reading may take, beside the loading of libraries.
_PATIENCE_S, _SLOWEST_BYTES_PER_S = 3.0, 2e6
#: How much longer it may take by the clock, on a busy machine or a slow disk.
_BUSY = 20.0
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def _most_unpacked(path: Path) -> int:
    """Bytes that the arrays of a file may take in memory."""
    return max(_ALWAYS, _RATIO * path.stat().st_size)


def read_isolated(path: Path, kind: str) -> Generator[tuple[str, Arrays], None, None]:
    """Blocks of named arrays of a file; `kind` is ``mat``, ``mat73`` or ``hdf5``.

    Raises
    ------
    MeasurementError
        If the file cannot be read, unpacks to far more than its size, or holds what is neither numbers nor text.
    """
    patience = _PATIENCE_S + path.stat().st_size / _SLOWEST_BYTES_PER_S
    command = [sys.executable, "-P", reader_process.__file__, kind, str(path.absolute())]
    command += [str(_most_unpacked(path)), str(patience)]
    with _child(command, _BUSY * patience) as (process, in_time):
        assert process.stdout is not None
        pipe = _Pipe(process.stdout)
        line = process.stdout.readline()
        in_time()
        said = json.loads(line) if line.endswith(b"\n") else {}
        if "refused" in said:
            raise MeasurementError(" ".join(said["refused"].split()))
        for place, names in said.get("blocks", ()):
            try:
                block = {name: np.lib.format.read_array(pipe, allow_pickle=False) for name in names}  # type: ignore[arg-type]
            except ValueError:
                break  # it died while it sent them
            yield place, block
        code = process.wait()
        if code == 0 and said:
            return
    if code == -getattr(signal, "SIGXCPU", 0):
        raise MeasurementError(
            f"content: found nothing readable in {patience:.0f} s of computing; expected a complete file; copy it again"
        )
    raise MeasurementError(
        f"content: found damage that ends the reader (code {code}); expected a complete file; copy it again"
    )


class _Pipe:
    """A pipe from which NumPy reads; not a file to it, which would ask for the position in it."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream

    def read(self, size: int) -> bytes:
        return self._stream.read(size)


@contextmanager
def _child(command: list[str], seconds: float) -> Iterator[tuple["subprocess.Popen[bytes]", Callable[[], None]]]:
    """A process that ends with the block at the latest, and a call that says that it was in time by the clock.

    Raises
    ------
    MeasurementError
        By that call, if it was not.
    """
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | dict.fromkeys(_THREADS, "1"),
    )
    late = threading.Event()

    def stop() -> None:
        late.set()
        process.kill()

    def in_time() -> None:
        timer.cancel()
        if late.is_set():
            raise MeasurementError(
                f"content: found nothing readable in {seconds:.0f} s; expected a complete file; copy it again"
            )

    timer = threading.Timer(seconds, stop)
    timer.daemon = True
    timer.start()
    try:
        yield process, in_time
    finally:
        timer.cancel()
        process.kill()
        assert process.stdout is not None
        process.stdout.close()
        process.wait()


def read_npz(path: Path) -> Generator[tuple[str, Arrays], None, None]:
    """Blocks of named arrays of an npz file; ``record_2/frf`` is the array ``frf`` of the block ``record_2/``.

    Raises
    ------
    MeasurementError
        If the archive is damaged, holds an object array, or unpacks to far more than its size.
    """
    blocks: dict[str, dict[str, Any]] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise MeasurementError(
            f"npz archive: found a damaged archive ({error}); expected a complete one; copy it again"
        ) from None
    unpacked, most = sum(member.file_size for member in members), _most_unpacked(path)
    if unpacked > most:
        raise MeasurementError(
            f"content: found arrays of {unpacked / 1e6:.3g} MB; expected at most {most / 1e6:.3g} MB in a file of this "
            "size; save it again without compression"
        )
    with np.load(path, allow_pickle=False) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of headers as Python 2 wrote them
        for name in archive.files:
            block, _, key = name.rpartition("/")
            try:
                found = archive[name]
            # numpy, zlib and zipfile each raise their own kinds on damaged bytes; which one is of no use to the reader
            except Exception as error:
                reason = " ".join(str(error).split())[:120]
                raise MeasurementError(
                    f"variable '{name}': found an array that cannot be read ({reason}); expected plain numbers or "
                    "text; save it again without objects"
                ) from None
            if not isinstance(found, np.ndarray):
                raise MeasurementError(f"member '{name}': found no NumPy array; expected .npy members; save it again")
            blocks.setdefault(f"{block}/" if block else "", {})[key] = found
    yield from blocks.items()
