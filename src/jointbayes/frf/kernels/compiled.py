"""How the hot loops are compiled."""

import math
from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["LANES", "compiled", "in_order", "inner", "lane_blocks"]

P = ParamSpec("P")
R = TypeVar("R")

#: Lines that a loop runs over at once: long enough to hide its start, short enough to stay in the first cache.
LANES = 64


# Sums may be reordered, which is what vector units need, but NaN and infinity keep their meaning: a singular line
# must be seen.
_FAST = {"contract", "arcp", "nsz"}


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile to machine code at the first call, kept on disk for the next process.

    What is kept is compiled anew when the function's own file changes, so its parts belong into the same file.
    """
    fast = _FAST | {"reassoc"}
    return cast("Callable[P, R]", numba.njit(cache=True, nogil=True, fastmath=fast, error_model="numpy")(function))


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """A part of compiled functions, written into each of them.

    As a function of its own it would be there twice, optimised by itself and within its caller: the first process would
    run the one and all later ones, which load what was kept, the other, with other last bits.
    """
    fast = _FAST | {"reassoc"}
    return cast("Callable[P, R]", numba.njit(nogil=True, inline="always", fastmath=fast, error_model="numpy")(function))


def in_order(function: Callable[P, R]) -> Callable[P, R]:
    """A part of compiled functions whose sums are taken as written, (a − b) − c not as a − (b + c)."""
    return cast("Callable[P, R]", numba.njit(nogil=True, fastmath=_FAST, error_model="numpy")(function))


def _aligned(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Zeros that begin at a cache line: a vector load across two lines costs a third of the kernel's speed."""
    size = math.prod(shape)
    buffer = np.zeros(size + 8)
    start = -(buffer.ctypes.data // 8) % 8
    return buffer[start : start + size].reshape(shape)


def lane_blocks(rows: NDArray[np.float64], width: int = LANES) -> NDArray[np.float64]:
    """Rows over lines, shape (..., k, lines), as blocks of `width` lines, shape (..., blocks·k·width), zero-padded.

    One block holds its k rows one after the other, so that a loop reads a single stretch of memory.
    """
    *lead, k, lines = rows.shape
    blocks = -(-lines // width)
    out = _aligned((*lead, blocks * k * width))
    padded = np.zeros((*lead, k, blocks * width))
    padded[..., :lines] = rows
    out[:] = padded.reshape(*lead, k, blocks, width).swapaxes(-3, -2).reshape(*lead, -1)
    return out
