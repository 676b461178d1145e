"""Bounds on what a file may make us hold in memory."""

from pathlib import Path

from jointbayes.errors import MeasurementError

__all__ = ["check_unpacked", "most_unpacked"]

#: A compressed file may unpack to this many times its size; measured FRFs do not come near it …
_RATIO = 20
#: … but small files may: their headers and constant coherences pack well.
_ALWAYS = 2**20


def most_unpacked(path: Path) -> int:
    """Bytes that the content of a file may have: 20 times the file's size, or 1 MiB."""
    return max(_ALWAYS, _RATIO * path.stat().st_size)


def check_unpacked(path: Path, unpacked: int) -> None:
    """Refuse a file whose content is said to be far larger than the file.

    Raises
    ------
    MeasurementError
        If `unpacked` bytes are more than `most_unpacked`.
    """
    if unpacked > most_unpacked(path):
        raise MeasurementError(
            f"content: found arrays of {unpacked / 1e6:.3g} MB or more in {path.stat().st_size / 1e6:.3g} MB of "
            f"file; expected at most {_RATIO} times its size; save it again without compression"
        )
