"""Bounds on what a file may make us hold in memory."""

from pathlib import Path

from jointbayes.errors import MeasurementError

__all__ = ["check_unpacked"]

#: A compressed file may unpack to this many times its size; measured FRFs do not come near it …
_RATIO = 20
#: … but small files may: their headers and constant coherences pack well.
_ALWAYS = 8 * 2**20


def check_unpacked(path: Path, unpacked: int) -> None:
    """Refuse a file whose content is said to be far larger than the file.

    Raises
    ------
    MeasurementError
        If `unpacked` bytes are above 8 MiB and above 20 times the size of the file.
    """
    size = path.stat().st_size
    if unpacked > max(_ALWAYS, _RATIO * size):
        raise MeasurementError(
            f"content: found arrays of {unpacked / 1e6:.0f} MB in a file of {size / 1e6:.3g} MB; expected at most "
            f"{_RATIO} times its size; save it again without compression"
        )
