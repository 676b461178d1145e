"""Files that are whole or not there, also where the disk is full or the process is killed; nobody's scraps stay."""

import ctypes
import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from jointbayes.errors import WriteError

try:
    import fcntl
except ImportError:  # Windows: scraps are not swept, and whether another run is at work on a directory is not known
    fcntl = None  # type: ignore[assignment]

__all__ = [
    "LOCK",
    "alone_in",
    "claimed",
    "exchanged",
    "scratch_directory",
    "swept",
    "sync_directory",
    "whole_file",
    "write_whole_file",
]

_LONGEST = 100  # characters of the target's name in that of its scratch file; names end at 255 bytes
#: Names of what is being written; a process that is alive holds a lock on it.
_SCRATCH = re.compile(r"\..*\.[0-9a-f]{8}\.jointbayes", re.DOTALL)
#: Name of the file in a directory that is locked while a process is at work in it.
LOCK = "lock"
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
        if fcntl is None:  # Windows renames no open file
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


def write_whole_file(path: str | os.PathLike[str], content: bytes | memoryview) -> None:
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
    while True:
        scratch = _scratch_name(target)
        try:
            scratch.mkdir()
        except FileExistsError:
            continue
        with suppress(FileNotFoundError):  # another process has swept it before it was claimed
            lock = claimed(scratch / LOCK)
            if lock is not None:
                break
    try:
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        os.close(lock)


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


def _swapped_at_once(one: Path, other: Path) -> bool:
    """Whether the system could exchange two names, as Linux can on most disks."""
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError, TypeError):
        return False
    return bool(rename(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0)


def claimed(path: Path, *, surely: bool = False) -> int | None:
    """Lock a file, which is made if there is none; the system frees it when this process ends, however it ends.

    Parameters
    ----------
    path
        The file.
    surely
        Whether a disk that knows no locks is an error; else the file counts as locked there.

    Returns
    -------
    int or None
        Descriptor to close when done; None where another process has the lock.
    """
    while True:
        lock = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
        try:
            if not _locked(lock, surely=surely):
                os.close(lock)
                return None
            if _still_there(path, lock):
                return lock
        except BaseException:
            os.close(lock)
            raise
        os.close(lock)  # whoever had it before has removed it meanwhile


@contextmanager
def alone_in(directory: Path) -> Iterator[None]:
    """Keep other processes out of a directory; the lock ends with the process, however that ends.

    Raises
    ------
    WriteError
        If another one is at work there.
    """
    path = directory / LOCK
    lock = claimed(path)
    if lock is None:
        raise WriteError(
            f"{directory}: found another process at work in it; expected one at a time; wait, or choose another --out"
        )
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(lock)


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
    if fcntl is None or (once and place in _swept):
        return
    _swept.add(place)
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in [one for one in entries if _SCRATCH.fullmatch(one.name)]:
            with suppress(OSError):
                _sweep(Path(entry.path), is_directory=entry.is_dir(follow_symlinks=False))


def sync_directory(folder: Path) -> None:
    """Force the names in a directory to the disk, where the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _sweep(scrap: Path, *, is_directory: bool) -> None:
    if is_directory:
        lock = claimed(scrap / LOCK, surely=True)
    else:
        lock = os.open(scrap, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
        if not _locked(lock, surely=True):
            os.close(lock)
            lock = None
    if lock is None:
        return
    try:
        if not is_directory:
            scrap.unlink()
            return
        for older in (scrap / _OLD).iterdir() if (scrap / _OLD).is_dir() else ():
            if not os.path.lexists(scrap.parent / older.name):
                older.replace(scrap.parent / older.name)
        shutil.rmtree(scrap)
    finally:
        os.close(lock)


def _claimed_scratch(target: Path) -> tuple[Path, int]:
    """A new file beside the target, locked."""
    while True:
        scratch = _scratch_name(target)
        try:
            lock = os.open(scratch, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0), 0o666)
        except FileExistsError:
            continue
        if fcntl is None or (_locked(lock) and _still_there(scratch, lock)):
            return scratch, lock
        os.close(lock)  # swept before it was locked


def _scratch_name(target: Path) -> Path:
    return target.with_name(f".{target.name[:_LONGEST]}.{secrets.token_hex(4)}.jointbayes")


def _locked(descriptor: int, *, surely: bool = False) -> bool:
    """Whether a lock was free; it is taken now."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        if surely:
            raise
    return True


def _still_there(path: Path, descriptor: int) -> bool:
    try:
        there = os.stat(path, follow_symlinks=False)
    except FileNotFoundError:
        return False
    return os.path.samestat(there, os.fstat(descriptor))
