"""Files that are whole or not there, also where the disk is full."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jointbayes.errors import WriteError

__all__ = ["whole_file", "write_whole_file"]

_LONGEST = 100  # characters of the target's name in that of its scratch file; names end at 255 bytes


@contextmanager
def whole_file(path: str | os.PathLike[str], size: int | None = None) -> Iterator[Path]:
    """Have a file written beside the target, force it to the disk and rename; what was there before stays until then.

    Parameters
    ----------
    path
        The file to be; an older one is replaced.
    size
        Bytes it will have, if known, for the message.

    Yields
    ------
    Path
        Of the file to write.

    Raises
    ------
    WriteError
        If there is something else than a regular file, or the file cannot be written.
    """
    target = Path(path)
    if target.exists() and not target.is_file():
        raise WriteError(f"{target}: found no regular file; expected a file or nothing there; choose another place")
    scratch = target.with_name(f".{target.name[:_LONGEST]}.{secrets.token_hex(4)}")
    try:
        yield scratch
        with scratch.open("rb") as stream:
            os.fsync(stream.fileno())  # a full disk may say so only now
        scratch.replace(target)
    except OSError as error:
        raise WriteError(
            f"{target}: found that it cannot be written ({error.strerror or error}); expected a place with room"
            f"{'' if size is None else f' for {size / 1e6:.1f} MB'}; make room or choose another place"
        ) from error
    finally:
        scratch.unlink(missing_ok=True)


def write_whole_file(path: str | os.PathLike[str], content: bytes | memoryview) -> None:
    """Write bytes as `whole_file` does."""
    with whole_file(path, len(content)) as scratch:
        scratch.write_bytes(content)
