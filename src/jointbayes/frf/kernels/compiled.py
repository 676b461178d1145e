"""How the hot loops are compiled, and kept for the next process."""

# mypy: disable-error-code="attr-defined, no-untyped-call"
import hashlib
import logging
import math
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
import numpy as np
from numba.core.caching import FunctionCache, IndexDataCacheFile

from jointbayes.errors import WriteError
from vibrecords.arrays import Array
from vibrecords.files import OwnDirectory

P = ParamSpec("P")
R = TypeVar("R")

#: Lines that a loop runs over at once: long enough to hide its start, short enough to stay in the first cache.
LANES = 64


# Sums may be reordered, which is what vector units need, but NaN and infinity keep their meaning: a singular line
# must be seen.
_FAST = {"contract", "arcp", "nsz"}

_THIS_FILE = hashlib.sha256(Path(__file__).read_bytes()).digest()
_REMEDY = "set NUMBA_CACHE_DIR to a directory of yours"
_said: set[str] = set()


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile to machine code at the first call, kept on disk for the next process.

    The kept code is compiled again when the function's own file changes or this one, so its parts belong into the same
    file. Where it is kept can be chosen by NUMBA_CACHE_DIR.
    """
    dispatcher = numba.njit(nogil=True, fastmath=_FAST | {"reassoc"}, error_model="numpy")(function)
    try:
        dispatcher._cache = _cache(function)
    except (OSError, RuntimeError) as error:
        _say("place", f"found no place to keep machine code ({error}); each run compiles it again; {_REMEDY}")
    return cast("Callable[P, R]", dispatcher)


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """A part of compiled functions, written into each of them.

    As a function of its own it would be there twice, optimised by itself and within its caller: the first process would
    run the one and all later ones, which load what was kept, the other, with other last bits.
    """
    fast = _FAST | {"reassoc"}
    return cast("Callable[P, R]", numba.njit(nogil=True, inline="always", fastmath=fast, error_model="numpy")(function))


def keep_order(function: Callable[P, R]) -> Callable[P, R]:
    """A part of compiled functions whose sums are taken as written, (a − b) − c not as a − (b + c)."""
    return cast("Callable[P, R]", numba.njit(nogil=True, fastmath=_FAST, error_model="numpy")(function))


class _File(IndexDataCacheFile):
    """Machine code with a digest at its end: what a full disk or a power cut left of a file must not be run."""

    def _dump(self, obj: object) -> bytes:
        data: bytes = super()._dump(obj)
        return data + hashlib.sha256(data).digest()

    def _load_data(self, name: str) -> object:
        data = Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(data[: -len(_THIS_FILE)]).digest() != data[-len(_THIS_FILE) :]:
            raise ValueError
        return super()._load_data(name)


class _Cache(FunctionCache):
    """numba's cache of one function, but what is damaged is replaced, and a full disk is no reason to stop."""

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _File(self._cache_path, self._impl.filename_base, (stamp, _THIS_FILE))

    def load_overload(self, sig: object, target_context: object) -> Any:  # noqa: ANN401 (numba's own signature)
        try:
            loaded = super().load_overload(sig, target_context)
        except Exception as error:  # unpickling damaged bytes raises anything
            what = f"found damaged machine code ({type(error).__name__}); compiling it again, some seconds"
            _say("compiling", f"{self._cache_path}: {what}")
            with suppress(OSError):
                Path(self._cache_file._index_path).unlink()
            return None
        if loaded is None:
            _say("compiling", "compiling the loops that this run needs, once after an installation: some seconds")
        return loaded

    def save_overload(self, sig: object, data: object) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _say("place", f"{self._cache_path}: machine code cannot be kept ({error.strerror}); {_REMEDY}")


def _cache(function: Callable[..., object]) -> _Cache:
    """Cache next to the package, else in the user's cache directory, else in a temporary directory."""
    try:
        return _Cache(function)
    except RuntimeError:  # numba's "no locator available"
        path = _temporary_directory()
        numba.config.CACHE_DIR = str(path)
        _say("place", f"{path}: machine code is kept here, for want of another directory to write to; {_REMEDY}")
        return _Cache(function)


def _temporary_directory() -> Path:
    """A directory of ours in the temporary one: code is loaded from there, so no other user may write to it.

    Raises
    ------
    OSError
        If none can be made, or other things have all the names that are tried.
    """
    user = getattr(os, "getuid", int)()
    names = [f"jointbayes-{user}", *(f"jointbayes-{user}-{number}" for number in range(2, 10))]
    for path in (Path(tempfile.gettempdir()) / name for name in names):
        with suppress(OSError, WriteError):  # what is there is not ours
            directory = OwnDirectory(path, "compiled loops", private=True)
            directory.take()  # or another process is making it just now
            directory.leave()
            status = path.lstat()
            if status.st_uid == user and (os.name == "nt" or not status.st_mode & 0o077):
                return path
    raise OSError(f"{path} and those before it are not ours")


def _say(kind: str, text: str) -> None:
    """One line on standard error, once a process, unless the program that imports this handles logging otherwise."""
    if kind not in _said:
        _said.add(kind)
        logging.getLogger("jointbayes").warning("jointbayes: %s", text)


def aligned_zeros(shape: tuple[int, ...]) -> Array:
    """Zeros that begin at a cache line: a vector load across two lines costs a third of the kernel's speed."""
    size = math.prod(shape)
    buffer = np.zeros(size + 8)
    start = -(buffer.ctypes.data // 8) % 8
    return buffer[start : start + size].reshape(shape)


def lane_blocks(rows: Array, width: int = LANES) -> Array:
    """Rows over lines, shape (..., k, lines), as blocks of `width` lines, shape (..., blocks·k·width), zero-padded.

    One block holds its k rows one after the other, so that a loop reads a single stretch of memory.
    """
    *lead, k, lines = rows.shape
    blocks = -(-lines // width)
    aligned = aligned_zeros((*lead, blocks * k * width))
    padded = np.zeros((*lead, k, blocks * width))
    padded[..., :lines] = rows
    aligned[:] = padded.reshape(*lead, k, blocks, width).swapaxes(-3, -2).reshape(*lead, -1)
    return aligned
