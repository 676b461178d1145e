"""Directories that are ours: marked, reached by descriptor; no link is followed, nothing foreign removed."""

import errno
import os
import socket
import stat
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from vibrecords.errors import UserError, WriteError

try:
    import fcntl
except ImportError:  # Windows: whether another process is at work on a directory is not known
    fcntl = None  # type: ignore[assignment]

HAS_LOCKS = fcntl is not None


#: File that says that a directory is ours, and of which kind.
MARK = ".jointbayes"
#: File that is locked while a process is at work in a directory; it names that process.
LOCK = "lock"

_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
_AS_IT_IS = getattr(os, "O_BINARY", 0)  # Windows would put a carriage return before each byte 10
_NO_WAIT = getattr(os, "O_NONBLOCK", 0)  # a pipe would wait for its other end
_BY_DESCRIPTOR = {os.open, os.unlink, os.stat} <= os.supports_dir_fd and os.listdir in os.supports_fd
_NOT_REGULAR = (errno.ELOOP, errno.EMLINK, errno.EISDIR, errno.ENXIO)
_LONGEST = 200  # bytes of a mark, or of what a lock says, that are read
_TRIES = 5  # another process may remove a directory just as it is opened


class OwnDirectory:
    """A directory that this program made, locked by one process at a time.

    It is ours only if the mark in it says so, or if nothing is in it. Names in it are reached by the descriptor of the
    directory, where the system has that, so that neither a link in its own place nor one in the place of a file is
    followed.

    Parameters
    ----------
    path
        The directory; it is made, with those above it, where it is not there.
    kind
        What it holds, for the mark and for messages: ``"a campaign"``.
    remedy
        What to do about a directory that is not ours, for messages.
    error
        Raised where it is not ours, or another process is at work in it.
    private
        Whether nobody else may look into it.

    Raises
    ------
    UserError
        On entering, as `error`: if it is a link, a file, somebody else's directory or one of another kind, or if
        another process is at work in it; as `WriteError`, if it cannot be made or written to, or its lock is no
        regular file. Nothing has changed then.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        kind: str,
        remedy: str = "choose another --out",
        *,
        error: type[UserError] = WriteError,
        private: bool = False,
    ) -> None:
        self.path = Path(path)
        self._mark = f"jointbayes: {kind}\n".encode()
        self._expected = f"expected a new directory, or one of {kind}; {remedy}"
        self._error, self._mode = error, 0o700 if private else 0o777
        self._marked = False
        self._descriptor: int | None = None
        self._lock: int | None = None
        self._holder = "unknown"

    def __enter__(self) -> Self:
        try:
            free = self.take()
        except OSError as error:
            raise WriteError(
                f"{self.path}: found that it cannot be written ({error.strerror}); {self._expected}"
            ) from error
        if not free:
            raise self._error(
                f"{self.path}: found another process at work in it ({self._holder}); expected one at a time; wait for "
                "it, or choose another place"
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.leave()

    def take(self, *, surely: bool = False) -> bool:
        """Make it or open it, and lock it, `surely` as for `locked`; False where another process is at work in it."""
        for _ in range(_TRIES - 1):
            with suppress(FileNotFoundError):
                return self._take(surely)
        return self._take(surely)

    def leave(self) -> None:
        """Let other processes in."""
        if self._lock is not None:
            if fcntl is None:  # Windows removes no open file
                os.close(self._lock)
            self.remove(LOCK)
            if fcntl is not None:
                os.close(self._lock)
        if self._descriptor is not None:
            os.close(self._descriptor)
        self._lock = self._descriptor = None

    def dissolve(self, *names: str) -> None:
        """Remove files of these names, and the directory if nothing else is in it."""
        for name in names:
            self.remove(name)
        empty = self.names() <= {MARK, LOCK}
        if empty:
            self.remove(MARK)
        self.leave()
        if empty:
            with suppress(OSError):
                self.path.rmdir()
            sync_directory(self.path.parent)

    def names(self) -> set[str]:
        """Names of all that is in it."""
        return set(os.listdir(self.path if self._descriptor is None else self._descriptor))

    def open(self, name: str, flags: int) -> int:
        """Descriptor of a regular file in it, as `open_regular` gives it."""
        place = name if self._descriptor is not None else self.path / name
        return open_regular(place, flags, at=self._descriptor, shown=self.path / name)

    def remove(self, name: str) -> None:
        """Remove a file in it, if it is there."""
        with suppress(OSError):
            os.unlink(name if self._descriptor is not None else self.path / name, dir_fd=self._descriptor)

    def _take(self, surely: bool) -> bool:
        made = False
        try:
            with suppress(FileExistsError):
                self.path.mkdir(self._mode, parents=True)
                made = True
            self._open()
            self._require_ours()
            place = LOCK if self._descriptor is not None else self.path / LOCK
            self._lock = locked(place, at=self._descriptor, shown=self.path / LOCK, surely=surely)
            if self._lock is None:
                self._holder = self._read(LOCK).decode(errors="replace").strip() or self._holder
                self.leave()
                return False
            self._write()
        except OSError as error:
            if self._lock is not None and not self._marked:
                self.dissolve()
            self.leave()
            if made:
                with suppress(OSError):  # where the lock could not even be made
                    self.path.rmdir()
            raise OSError(error.errno, error.strerror, os.fspath(self.path)) from error
        except BaseException:
            self.leave()
            raise
        return True

    def _open(self) -> None:
        mode = os.lstat(self.path).st_mode
        if not stat.S_ISDIR(mode):
            what = "a link" if stat.S_ISLNK(mode) else "a file"
            raise self._error(f"{self.path}: found {what}; {self._expected}")
        if _BY_DESCRIPTOR:
            self._descriptor = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY | _NO_LINK)

    def _require_ours(self) -> None:
        names = self.names()
        mark = self._read(MARK) if MARK in names else b""
        self._marked = mark.strip() == self._mark.strip()  # one may be written by hand
        if mark.startswith(b"jointbayes: ") and not self._marked:
            kind = mark[12:].decode(errors="replace").strip()
            raise self._error(f"{self.path}: found a directory of {kind}; {self._expected}")
        if not self._marked and (mark or names - {MARK, LOCK} or (LOCK in names and not self._is_our_lock())):
            raise self._error(
                f"{self.path}: found a directory that holds other files, and no mark of jointbayes ({MARK}); "
                f"{self._expected}"
            )

    def _is_our_lock(self) -> bool:
        """Whether a lock in a directory without a mark is what a process left that was killed as it made the mark."""
        text = self._read(LOCK)
        return not text or text.startswith(b"process ")

    def _read(self, name: str) -> bytes:
        with os.fdopen(self.open(name, os.O_RDONLY), "rb") as stream:
            return stream.read(_LONGEST)

    def _write(self) -> None:
        """Say in the lock who is at work, and mark the directory if it is not marked yet."""
        assert self._lock is not None
        os.ftruncate(self._lock, 0)
        os.write(self._lock, f"process {os.getpid()} on {socket.gethostname()}\n".encode())
        if not self._marked:
            with os.fdopen(self.open(MARK, os.O_WRONLY | os.O_CREAT), "wb") as stream:
                stream.write(self._mark)
                stream.flush()
                os.fsync(stream.fileno())
            self._marked = True


def open_regular(name: str | os.PathLike[str], flags: int, *, at: int | None = None, shown: Path | None = None) -> int:
    """Open a regular file that has one name, and follow no link; what `os.open` does otherwise.

    Parameters
    ----------
    name
        The file.
    flags
        For `os.open`.
    at
        Descriptor of the directory that it is in.
    shown
        Its name in messages.

    Raises
    ------
    WriteError
        If there is something else: a link, a directory, a pipe, or a file with a second name elsewhere.
    OSError
        If it cannot be opened.
    """
    status, refused = None, not _NO_LINK and os.path.islink(name)
    if not refused:
        try:
            descriptor = os.open(name, flags | _NO_LINK | _NO_WAIT | _AS_IT_IS, 0o666, dir_fd=at)
        except OSError as error:
            if error.errno not in _NOT_REGULAR:
                raise
        else:
            status = os.fstat(descriptor)
            if stat.S_ISREG(status.st_mode) and status.st_nlink < 2:
                return descriptor
            os.close(descriptor)
    raise WriteError(
        f"{shown or name}: found a link, a file of several names, or no file at all; expected a regular file that "
        "jointbayes made; see what it is, and remove it"
    )


def locked(
    name: str | os.PathLike[str], *, at: int | None = None, shown: Path | None = None, surely: bool = False
) -> int | None:
    """Lock a file, which is made if there is none; the system frees it when this process ends, however it ends.

    Parameters
    ----------
    name, at, shown
        The file, as for `open_regular`.
    surely
        Whether a disk that knows no locks is an error; else the file counts as locked there.

    Returns
    -------
    int or None
        Descriptor to close when done; None where another process has the lock.

    Raises
    ------
    WriteError
        If it is no regular file.
    """
    while True:
        lock = open_regular(name, os.O_RDWR | os.O_CREAT, at=at, shown=shown)
        try:
            if not lock_taken(lock, surely=surely):
                os.close(lock)
                return None
            if still_there(name, lock, at):
                return lock
        except BaseException:
            os.close(lock)
            raise
        os.close(lock)  # whoever had it before has removed it meanwhile


def lock_taken(descriptor: int, *, surely: bool = False) -> bool:
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


def still_there(name: str | os.PathLike[str], descriptor: int, at: int | None = None) -> bool:
    """Whether an open file has that name still."""
    try:
        there = os.stat(name, dir_fd=at, follow_symlinks=False)
    except FileNotFoundError:
        return False
    return os.path.samestat(there, os.fstat(descriptor))


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


def sync_directory(folder: Path) -> None:
    """Force the names in a directory to the disk, where the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
