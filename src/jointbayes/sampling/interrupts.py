"""Signals that wait until a block of steps is whole."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_Handler = Callable[[int, FrameType | None], object]


@contextmanager
def finished_first(*, wait: bool = True) -> Iterator[list[int]]:
    """Let SIGINT, SIGTERM and SIGHUP wait for the end of the body, where Python answers them; a second one does not.

    Whatever the body raises after a signal gives way to what the signal's own handler raises: worker processes get the
    signals of a terminal or a batch system as well, and may be gone before the body is.

    Parameters
    ----------
    wait
        Whether they wait at all.

    Yields
    ------
    list of int
        Signals that have come so far.
    """
    if not wait or threading.current_thread() is not threading.main_thread():
        yield []  # signals come to the main thread only
        return
    answered: dict[int, _Handler] = {}
    for number in (int(signal.SIGINT), int(signal.SIGTERM), int(getattr(signal, "SIGHUP", signal.SIGTERM))):
        handler = signal.getsignal(number)
        if callable(handler):
            answered[number] = handler
    waiting: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        waiting.append(number)
        if len(waiting) > 1:
            answered[number](number, frame)

    for number in answered:
        signal.signal(number, note)
    try:
        yield waiting
    finally:
        for number, handler in answered.items():
            signal.signal(number, handler)
        if waiting:
            answered[waiting[0]](waiting[0], None)
