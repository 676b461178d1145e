"""NumPy archives: named arrays, never a pickle."""

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.arrays.isolated import most_unpacked
from jointbayes.measurement.formats.arrays.layout import Arrays

__all__ = ["read_npz", "write_npz"]


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
    unpacked, most = sum(member.file_size for member in members), most_unpacked(path)
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


def write_npz(blocks: dict[str, dict[str, Any]], path: Path) -> None:
    """Write blocks of named arrays; exact, uncompressed."""
    arrays = {
        f"{name}/{key}" if name else key: np.asarray(v) for name, block in blocks.items() for key, v in block.items()
    }
    with path.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]  # the stub takes every name for allow_pickle
