"""Files that are whole or not there, also where the disk is full or the process is killed; nobody's scraps stay."""

import ctypes
import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from vibrecords.errors import WriteError
from vibrecords.own_directory import (
    HAS_LOCKS,
    LOCK,
    MARK,
    OwnDirectory,
    lock_taken,
    open_regular,
    still_there,
    sync_directory,
)

#: What files in the formats of other programs say of themselves, and how those begin that may be replaced.
WRITTEN_BY = "written by: jointbayes"
OURS = re.compile(
    rb"(?:#|\$|\*\*|!) written by: jointbayes\r?\n|written by: jointbayes\0|    -1\r?\n   151\r?\njointbayes\r?\n|"
    rb"MATLAB (?:5\.0|7\.3) MAT-file, Platform: jointbayes,"
)
_LONGEST = 100  # characters of the target's name in that of its scratch file; names end at 255 bytes
#: Names of what is being written; a process that is alive holds a lock on it.
_SCRATCH = re.compile(r"\..*\.[0-9a-f]{8}\.jointbayes", re.DOTALL)
_KIND = "files that are being written"
_OLD = "old"
_HERE, _EXCHANGE = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of Linux
_swept: set[str] = set()  # directories in which this process has swept


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
        Of the file to write; it is there already, and empty.

    Raises
    ------
    WriteError
        If there is something else than a regular file, or the file cannot be written.
    """
    target = Path(path)
    if os.path.lexists(target) and not target.is_file():
        raise WriteError(f"{target}: found no regular file; expected a file or nothing there; choose another place")
    scratch, lock = None, None
    try:
        swept(target.parent, once=True)
        scratch, lock = _claimed_scratch(target)
        yield scratch
        with scratch.open("rb+") as stream:
            os.fsync(stream.fileno())  # a full disk may say so only now
        if not HAS_LOCKS:  # Windows renames no open file
            os.close(lock)
            lock = None
        scratch.replace(target)
        sync_directory(target.parent)
    except OSError as error:
        raise WriteError(
            f"{target}: found that it cannot be written ({error.strerror or error}); expected a place with room"
            f"{'' if size is None else f' for {size / 1e6:.1f} MB'}; make room or choose another place"
        ) from error
    finally:
        if scratch is not None:
            scratch.unlink(missing_ok=True)
        if lock is not None:
            os.close(lock)


def write_whole_file(path: str | os.PathLike[str], content: bytes) -> None:
    """Write bytes as `whole_file` does."""
    with whole_file(path, len(content)) as scratch:
        scratch.write_bytes(content)


@contextmanager
def scratch_directory(target: Path) -> Iterator[Path]:
    """Make a directory beside a target to write the new content of the target in; it goes when the body ends.

    Yields
    ------
    Path
        The directory. A process that dies leaves it, and the next one sweeps it.
    """
    swept(target.parent, once=True)
    scratch = OwnDirectory(_scratch_name(target), _KIND)
    while os.path.lexists(scratch.path) or not scratch.take():  # another process may sweep it before it is locked
        scratch = OwnDirectory(_scratch_name(target), _KIND)
    try:
        yield scratch.path
    finally:
        with suppress(OSError):
            _remove_marked(scratch.path)
        scratch.leave()


def exchanged(new: Path, target: Path, scratch: Path) -> None:
    """Put a directory in the place of another at one stroke, or so that the older one is never lost.

    Parameters
    ----------
    new
        The new directory, in `scratch`; the older one, if any, takes its place there.
    target
        Where it is to be.
    scratch
        From `scratch_directory` of the target.

    Raises
    ------
    OSError
        If the directory cannot be put there; the older one is then where it was.
    """
    if not target.exists():
        new.replace(target)
    elif not _swapped_at_once(new, target):
        (scratch / _OLD).mkdir()
        older = scratch / _OLD / target.name
        target.replace(older)
        try:
            new.replace(target)
        except BaseException:
            older.replace(target)
            raise
    sync_directory(target.parent)


def _swapped_at_once(first: Path, second: Path) -> bool:
    """Whether the system could exchange two names, as Linux can on most disks."""
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError, TypeError):
        return False
    return bool(rename(_HERE, os.fsencode(first), _HERE, os.fsencode(second), _EXCHANGE) == 0)


def swept(folder: Path, *, once: bool = False) -> None:
    """Remove what processes that died while they wrote into a directory have left there.

    What a process that is alive writes is locked by it and stays, whatever machine or container it runs in. An older
    directory that was moved aside, and whose place is empty, comes back.

    Parameters
    ----------
    folder
        The directory.
    once
        Do nothing if this process has swept there already.
    """
    place = os.path.abspath(folder)
    if not HAS_LOCKS or (once and place in _swept):
        return
    _swept.add(place)
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in [e for e in entries if _SCRATCH.fullmatch(e.name)]:
            with suppress(OSError, WriteError):  # WriteError: it is not ours
                _sweep(Path(entry.path), is_directory=entry.is_dir(follow_symlinks=False))


def _sweep(scrap: Path, *, is_directory: bool) -> None:
    if not is_directory:
        lock = open_regular(scrap, os.O_RDWR)
        try:
            if lock_taken(lock, surely=True):
                scrap.unlink()
        finally:
            os.close(lock)
        return
    directory = OwnDirectory(scrap, _KIND)
    if not directory.take(surely=True):
        return
    try:
        for name in os.listdir(scrap / _OLD) if _OLD in directory.names() and not (scrap / _OLD).is_symlink() else ():
            if not os.path.lexists(scrap.parent / name):
                (scrap / _OLD / name).replace(scrap.parent / name)
        _remove_marked(scrap)
    finally:
        directory.leave()


def _remove_marked(directory: Path) -> None:
    """Remove a directory of ours, its mark last: whatever is left of it by a kill can still be told to be ours."""
    for entry in list(os.scandir(directory)):
        if entry.is_dir(follow_symlinks=False):
            shutil.rmtree(entry.path)
        elif entry.name not in {MARK, LOCK}:
            os.unlink(entry.path)
    shutil.rmtree(directory)


def _claimed_scratch(target: Path) -> tuple[Path, int]:
    """A new file beside the target, locked."""
    while True:
        scratch = _scratch_name(target)
        try:
            lock = os.open(scratch, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0), 0o666)
        except FileExistsError:
            continue
        if not HAS_LOCKS or (lock_taken(lock) and still_there(scratch, lock)):
            return scratch, lock
        os.close(lock)  # swept before it was locked


def _scratch_name(target: Path) -> Path:
    return target.with_name(f".{target.name[:_LONGEST]}.{secrets.token_hex(4)}.jointbayes")
