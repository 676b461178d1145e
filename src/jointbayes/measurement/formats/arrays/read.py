"""Files of named arrays: npz, never a pickle; HDF5 and MATLAB, in a process of their own.

Damaged bytes make the C code of both libraries crash, hang or reserve gigabytes: of 650 MAT files with flipped bits or
cut ends three ended scipy with a segmentation fault, of as many of version 7.3 one aborted h5py. There that ends the
process, and here it is an error of one line.
"""

import json
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.arrays import reader_process
from jointbayes.measurement.formats.arrays.layout import Arrays

__all__ = ["read_isolated", "read_npz"]

#: A compressed file may unpack to this many times its size, which measured FRFs do not come near, or to 1 MiB: small
#: files have headers and constant coherences, which pack well.
_RATIO, _ALWAYS = 20, 2**20
_PATIENCE_S = 30.0
_SLOWEST_BYTES_PER_S = 1e6


def _most_unpacked(path: Path) -> int:
    """Bytes that the arrays of a file may take in memory."""
    return max(_ALWAYS, _RATIO * path.stat().st_size)


def read_isolated(path: Path, kind: str) -> Iterator[tuple[str, Arrays]]:
    """Blocks of named arrays of a file; `kind` is ``mat``, ``mat73`` or ``hdf5``.

    Raises
    ------
    MeasurementError
        If the file cannot be read, unpacks to far more than its size, or holds what is neither numbers nor text.
    """
    with tempfile.TemporaryDirectory(prefix="jointbayes-") as directory:
        target = Path(directory) / "arrays.npz"
        command = [sys.executable, "-P", reader_process.__file__, kind, str(path.absolute()), str(target)]
        command.append(str(_most_unpacked(path)))
        patience = _PATIENCE_S + path.stat().st_size / _SLOWEST_BYTES_PER_S
        try:
            done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=patience, check=False)
        except subprocess.TimeoutExpired:
            raise MeasurementError(
                f"content: found nothing readable in {patience:.0f} s; expected a complete file; copy it again"
            ) from None
        if done.returncode == reader_process.REFUSED:
            raise MeasurementError(" ".join(done.stdout.decode("utf-8", errors="replace").split()))
        if done.returncode != 0:
            raise MeasurementError(
                f"content: found damage that ends the reader (code {done.returncode}); expected a complete file; copy "
                "it again"
            )
        with np.load(target, allow_pickle=False) as arrays:
            for place, names in json.loads(str(arrays["manifest"])):
                yield place, {name: arrays[key] for name, key in names}


def read_npz(path: Path) -> Iterator[tuple[str, Arrays]]:
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
    with np.load(path, allow_pickle=False) as archive:
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
