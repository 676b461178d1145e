"""Every call of this process that changes what is on a disk, one after the other: a fault at each of them."""

import builtins
import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vibrecords import files

#: Calls that need room.
SPACE = frozenset({"open", "mkdir", "write", "fsync", "rename", "replace"})
_CALLS = ("open", "mkdir", "rename", "replace", "unlink", "rmdir", "truncate", "ftruncate", "write", "fsync")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT

Answer = Callable[[str, bool], None]
"""Called before (False) and after (True) each call, with its name; what it raises the call raises."""


@contextmanager
def each_change(folder: Path, answer: Answer) -> Iterator[None]:
    """Have something done before and after each call that changes anything below a folder (Linux).

    Parameters
    ----------
    folder
        The folder.
    answer
        What is done.
    """
    root = os.path.realpath(folder)
    kept = {name: getattr(os, name) for name in _CALLS}
    opening, exchange = io.open, files._swapped_at_once

    def is_below(place: Any, at: int | None = None) -> bool:
        if isinstance(place, int):
            place = os.readlink(f"/proc/self/fd/{place}")
        elif at is not None:
            place = os.path.join(os.readlink(f"/proc/self/fd/{at}"), os.fspath(place))
        return f"{os.path.abspath(os.fsdecode(place))}/".startswith(f"{root}/")

    def watched(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def made(*arguments: Any, **options: Any) -> Any:
            is_change = name != "open" or bool(arguments[1] & _WRITING)
            at = options.get("dir_fd", options.get("src_dir_fd"))
            if not is_change or not is_below(arguments[0], at):
                return call(*arguments, **options)
            answer(name, False)
            result = call(*arguments, **options)
            answer(name, True)
            return result

        return made

    class Raw(io.FileIO):
        def write(self, content: Any) -> int:
            answer("write", False)
            count = super().write(content)
            answer("write", True)
            return count

    def opened(file: Any, mode: str = "r", buffering: int = -1, *arguments: Any, **options: Any) -> Any:
        if not set(mode) & set("wxa+") or not is_below(file):
            return opening(file, mode, buffering, *arguments, **options)
        if not isinstance(file, int):
            answer("open", False)
        raw = Raw(file, mode.replace("b", "").replace("t", ""))
        buffered: Any = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        if "b" in mode:
            return raw if buffering == 0 else buffered
        return io.TextIOWrapper(buffered, options.get("encoding"), options.get("errors"), options.get("newline"))

    try:
        for name, call in kept.items():
            setattr(os, name, watched(name, call))
        io.open = builtins.open = opened
        files._swapped_at_once = watched("exchange", exchange)
        yield
    finally:
        for name, call in kept.items():
            setattr(os, name, call)
        io.open = builtins.open = opening
        files._swapped_at_once = exchange


def full_from(number: int) -> Answer:
    """A disk on which there is no room from a call on."""
    count = 0

    def answer(name: str, after: bool) -> None:
        nonlocal count
        if not after and name in SPACE:
            count += 1
            if count >= number:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    return answer
