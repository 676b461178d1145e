"""Files and directories that are ours, and whole or not there, also where the disk is full or the process is killed.

`whole_file` and `whole_directory` write next to the target under a name that none can guess, force it to the disk and
rename it. `OwnDirectory` is marked as ours, and locked by one process at a time. Neither follows a link, and nothing
foreign is removed.
"""

import ctypes
import errno
import os
import re
import secrets
import shutil
import socket
import stat
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Literal, Self

from vibrecords.errors import WriteError

try:
    import fcntl
except ImportError:  # Windows: whether another process is at work is not known
    fcntl = None  # type: ignore[assignment]

HAS_LOCKS = fcntl is not None
#: What files in the formats of other programs say of themselves, and how those begin that may be replaced.
WRITTEN_BY = "written by: jointbayes"
OURS = re.compile(rb"(?:#|\$|\*\*|!) written by: jointbayes\r?\n")
#: File that says that a directory is ours, and of which kind.
MARK = ".jointbayes"
#: File that is locked while a process is at work in a directory; it names that process.
LOCK = "lock"
#: Names of what is being written; a process that is alive holds a lock on it. Of a directory it is the lock alone, and
#: the directory of the same name with this ending goes before it.
_SCRATCH, _SPACE = re.compile(r"\..*\.[0-9a-f]{8}\.jointbayes", re.DOTALL), ".d"
_NAME, _HEAD = 100, 200  # characters of the target's name in its scratch file's, of a mark or lock that are read
_NO_LINK = sum(getattr(os, flag, 0) for flag in ("O_NOFOLLOW", "O_CLOEXEC", "O_BINARY", "O_NONBLOCK"))
_NOT_REGULAR = (errno.ELOOP, errno.EMLINK, errno.EISDIR, errno.ENXIO)
_swept: set[str] = set()  # directories in which this process has swept


class OwnDirectory:
    """A directory that this program made, locked by one process at a time.

    It is ours only if the mark in it says so, or if nothing is in it.

    Parameters
    ----------
    path
        The directory; it is made, with those above it, where it is not there.
    kind
        What it holds, for the mark and for messages: ``"a campaign"``.
    private
        Whether others may not look into it.

    Raises
    ------
    WriteError
        On entering: if it is a link, a file, somebody else's directory or one of another kind, if another process is at
        work in it, if it cannot be made or written to, or if its lock is no regular file. Nothing has changed then.
    """

    def __init__(self, path: str | os.PathLike[str], kind: str, *, private: bool = False) -> None:
        self.path, self._mark = Path(path), f"jointbayes: {kind}\n".encode()
        self._expected = f"expected a new directory, or one of {kind}; choose another --out"
        self._mode = 0o700 if private else 0o777
        self._lock: BinaryIO | None = None

    def __enter__(self) -> Self:
        try:
            if self.take():
                return self
            holder = _read(self.path / LOCK).decode(errors="replace").strip()
        except OSError as error:
            raise self._refusal(f"that it cannot be written ({error.strerror})") from error
        raise WriteError(
            f"{self.path}: found another process at work in it ({holder or 'unknown'}); expected one at a time; wait "
            "for it, or choose another place"
        )

    def __exit__(self, *_error: object) -> None:
        self.leave()

    def take(self) -> bool:
        """Make it if need be, and lock it; False where another process is at work in it."""
        with suppress(FileNotFoundError):  # another process may remove it just as it is opened
            return self._take()
        return self._take()

    def leave(self) -> None:
        """Let other processes in."""
        if self._lock is not None:
            if not HAS_LOCKS:  # Windows removes no open file
                self._lock.close()
            with suppress(OSError):
                os.unlink(self.path / LOCK)
            self._lock.close()
            self._lock = None

    def dissolve(self) -> None:
        """Remove the directory if nothing else is in it."""
        if self._lock is not None:  # else it may be another process's by now
            if set(os.listdir(self.path)) <= {MARK, LOCK}:
                (self.path / MARK).unlink(missing_ok=True)
            self.leave()
        with suppress(OSError):  # it is not empty
            self.path.rmdir()
            _sync(self.path.parent)

    def _take(self) -> bool:
        with suppress(FileExistsError):
            self.path.mkdir(self._mode, parents=True)
        is_new = self._is_new()
        try:
            self._lock = lock_file(self.path / LOCK)
            if self._lock is None:
                return False
            self._lock.truncate(0)
            os.write(self._lock.fileno(), f"process {os.getpid()} on {socket.gethostname()}\n".encode())
            if self._is_new():  # once more: another process may have removed the mark
                with open_regular(self.path / MARK, "a+b") as stream:
                    stream.write(self._mark)
                    stream.flush()
                    os.fsync(stream.fileno())
        except BaseException:
            self.dissolve() if is_new else self.leave()
            raise
        return True

    def _is_new(self) -> bool:
        """Whether nothing is in it yet, or what a process leaves that is killed as it marks it; False if it is ours."""
        mode = os.lstat(self.path).st_mode
        if not stat.S_ISDIR(mode):
            raise self._refusal("a link" if stat.S_ISLNK(mode) else "a file")
        mark, lock = _read(self.path / MARK).strip(), _read(self.path / LOCK)
        if mark == self._mark.strip():  # one may be written by hand
            return False
        if mark.startswith(b"jointbayes: "):
            raise self._refusal(f"a directory of {mark[12:].decode(errors='replace')}")
        if mark or set(os.listdir(self.path)) - {MARK, LOCK} or not b"process ".startswith(lock[:8]):
            raise self._refusal(f"a directory that holds other files, and no mark of jointbayes ({MARK})")
        return True

    def _refusal(self, found: str) -> WriteError:
        return WriteError(f"{self.path}: found {found}; {self._expected}")


@contextmanager
def whole_file(path: str | os.PathLike[str], size: int | None = None) -> Iterator[Path]:
    """Have a file written next to the target, force it to the disk and rename; what was there before stays until then.

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
    try:
        with scratch_file(target) as scratch:
            yield scratch
            with scratch.open("rb+") as stream:
                os.fsync(stream.fileno())  # a full disk may say so only now
            scratch.replace(target)
            _sync(target.parent)
    except OSError as error:
        raise WriteError(
            f"{target}: found that it cannot be written ({error.strerror or error}); expected a place with room"
            f"{'' if size is None else f' for {size / 1e6:.1f} MB'}; make room or choose another place"
        ) from error


def write_whole_file(path: str | os.PathLike[str], content: bytes | memoryview) -> None:
    """Write bytes as `whole_file` does."""
    with whole_file(path, len(content)) as scratch:
        scratch.write_bytes(content)


@contextmanager
def whole_directory(target: Path) -> Iterator[Path]:
    """Have a directory written next to the target, and put it there at one stroke where the system can exchange names.

    Else the older one is moved aside first; it comes back if anything fails, at the latest as the next process sweeps.

    Yields
    ------
    Path
        Of the directory to write; it is there already, and empty.

    Raises
    ------
    OSError
        If the directory cannot be put there; the older one is then where it was.
    """
    with scratch_file(target) as scratch:
        new, older = (_space(scratch) / name / target.name for name in ("new", "old"))
        new.mkdir(parents=True)
        yield new
        at_once = target.exists() and _swapped_at_once(new, target)
        if target.exists() and not at_once:
            older.parent.mkdir()
            target.replace(older)
        if not at_once:
            new.replace(target)
        _sync(target.parent)


def _swapped_at_once(first: Path, second: Path) -> bool:
    """Whether the system could exchange two names, as Linux can on most disks."""
    with suppress(OSError, AttributeError, TypeError):  # other systems; −100 is AT_FDCWD, 2 is RENAME_EXCHANGE
        return not ctypes.CDLL(None).renameat2(-100, os.fsencode(first), -100, os.fsencode(second), 2)
    return False


@contextmanager
def scratch_file(target: Path) -> Iterator[Path]:
    """Make an empty file next to a target, locked, which goes when the body ends, if it has its name still.

    Yields
    ------
    Path
        The file. A process that dies leaves it, and the next one sweeps it.
    """
    sweep(target.parent, once=True)
    lock = None
    while lock is None:
        scratch = target.with_name(f".{target.name[:_NAME]}.{secrets.token_hex(4)}.jointbayes")
        lock = lock_file(scratch)
    with closing(lock):
        if not HAS_LOCKS:  # Windows renames no open file
            lock.close()
        try:
            yield scratch
        finally:
            _remove(scratch)


def _space(scratch: Path) -> Path:
    return scratch.with_name(scratch.name + _SPACE)


def _remove(scratch: Path) -> None:
    """Remove a scratch file, and before it its directory, from which an older one comes back if its place is empty."""
    older = _space(scratch) / "old"
    for name in os.listdir(older) if older.is_dir() and not (older.is_symlink() or older.parent.is_symlink()) else ():
        if not os.path.lexists(scratch.with_name(name)):
            (older / name).replace(scratch.with_name(name))
    shutil.rmtree(_space(scratch), ignore_errors=True)
    if not os.path.lexists(_space(scratch)):
        scratch.unlink(missing_ok=True)


def sweep(folder: Path, *, once: bool = False) -> None:
    """Remove what processes that died while they wrote into a directory have left there.

    What a process that is alive writes is locked by it and stays, on any machine or in any container. An older
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
    with suppress(OSError):
        for scrap in [folder / name for name in os.listdir(folder) if _SCRATCH.fullmatch(name)]:
            with suppress(OSError, WriteError):  # WriteError: it is not ours
                if lock := lock_file(scrap, surely=True):
                    with lock:
                        _remove(scrap)


def open_regular(path: str | os.PathLike[str], mode: Literal["rb", "a+b"]) -> BinaryIO:
    """Open a regular file that has one name, and follow no link; what `open` does otherwise.

    Raises
    ------
    WriteError
        If there is something else: a link, a directory, a pipe, or a file with a second name elsewhere.
    OSError
        If it cannot be opened.
    """
    flags = os.O_RDONLY if mode == "rb" else os.O_RDWR | os.O_CREAT | os.O_APPEND
    try:
        if not os.path.islink(path):  # Windows has no flag for it
            descriptor = os.open(path, flags | _NO_LINK, 0o666)
            status = os.fstat(descriptor)
            if stat.S_ISREG(status.st_mode) and status.st_nlink < 2:
                return os.fdopen(descriptor, mode)
            os.close(descriptor)
    except OSError as error:
        if error.errno not in _NOT_REGULAR:
            raise
    raise WriteError(
        f"{path}: found a link, a file of several names, or no file at all; expected a regular file that "
        "jointbayes made; see what it is, and remove it"
    )


def lock_file(path: Path, *, surely: bool = False) -> BinaryIO | None:
    """Lock a file, which is made if there is none; the system frees it when this process ends, however it ends.

    Parameters
    ----------
    path
        The file.
    surely
        Whether a disk that knows no locks counts as locked by another process; else as locked by this one.

    Returns
    -------
    BinaryIO or None
        To close when done; None where another process has the lock.

    Raises
    ------
    WriteError
        If it is no regular file.
    """
    while True:
        lock = open_regular(path, "a+b")
        try:
            if fcntl is not None:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if surely or isinstance(error, BlockingIOError):
                lock.close()
                return None
        with suppress(FileNotFoundError):  # whoever had the lock may have removed the file meanwhile
            if os.path.samestat(os.lstat(path), os.fstat(lock.fileno())):
                return lock
        lock.close()


def _read(path: Path) -> bytes:
    """The beginning of a regular file; nothing where there is none."""
    with suppress(FileNotFoundError), open_regular(path, "rb") as stream:
        return stream.read(_HEAD)
    return b""


def real_directory(path: Path) -> Path:
    """Make a directory where there is none, and refuse a link in its place.

    Raises
    ------
    WriteError
        If there is something else than a directory.
    """
    with suppress(FileExistsError):
        path.mkdir()
    if not stat.S_ISDIR(os.lstat(path).st_mode):
        raise WriteError(f"{path}: found a link or a file; expected a directory; see what it is, and remove it")
    return path


def _sync(folder: Path) -> None:
    """Force the names in a directory to the disk, where the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
