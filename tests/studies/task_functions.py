"""Tasks for the tests of `run_tasks`: functions at the top of a module that workers can load."""

import os
import signal
import time
from pathlib import Path

import jointbayes as jb


def square(number):
    return number**2


def slow_square(number, seconds):
    time.sleep(seconds)
    return number**2


def settings_of_worker(_number):
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
    return os.getpid(), [os.environ.get(name) for name in names], signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def kill_some(number, directory, once, always):
    """Square of a number; some kill their worker the first time, some each time. Each attempt leaves a mark."""
    attempts = len(list(Path(directory).glob(f"{number}.*")))
    (Path(directory) / f"{number}.{attempts}").touch()
    if number in always or (number in once and attempts == 0):
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def fail_some(number, bad):
    if number in bad:
        raise jb.ModelError(f"task {number}: found a wrong number; expected another; change it")
    return 1 / (number - 1)


def hang_some(number, slow):
    if number in slow:
        time.sleep(600)
    return number**2


def unsendable(_number):
    return lambda: None


def leave(_number):
    raise SystemExit(3)


def write_then_wait(number, directory):
    """Begin a file, and wait for the end with it half written; what is left behind is seen by the test."""
    scratch = Path(directory) / f".half-{number}"
    (Path(directory) / f"pid-{number}-{os.getpid()}").touch()
    try:
        scratch.touch()
        time.sleep(600)
    finally:
        scratch.unlink()
