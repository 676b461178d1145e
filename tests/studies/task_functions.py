"""Tasks for the tests of `run_tasks`: functions at the top of a module that workers can load."""

import json
import os
import signal
import sys
import time
from pathlib import Path

import jointbayes as jb


def square(number):
    return number**2


def has_module(name):
    return name in sys.modules


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


def store(number):
    """What a posterior does when it is saved: netCDF made in memory."""
    import xarray as xr

    view = xr.DataTree.from_dict({"/a": xr.Dataset({"x": ("i", [number])})}).to_netcdf(None, engine="h5netcdf")
    size = len(bytes(view))
    view.release()
    return size


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


def pretend_case(key, text, _home, seed, target, _allow_outside, _full):
    """In place of sampling: a run directory from the seed alone; what a case does besides stands in its title."""
    title = next(line for line in text.splitlines() if line.startswith("title = "))
    run = Path(target)
    tries = run.parent.parent.parent / "tries"
    tries.mkdir(exist_ok=True)
    (tries / f"{key}-{time.monotonic_ns()}").touch()
    if "kill" in title:
        os.kill(os.getpid(), signal.SIGKILL)
    if "fail" in title and not (tries.parent / "mended").exists():
        raise jb.SamplingError(f"{key}: found no start; expected one; correct the case")
    k22 = {"unit": "N·m/rad", "map": 1e6, "median": 1e6 + seed, "interval95": [9e5, 1.1e6], "verdict": "identified"}
    summary = {"converged": "far" not in title, "reason": "so", "check": {"explains": "odd" not in title}}
    run.mkdir(exist_ok=True)
    (run / "summary.json").write_text(json.dumps(summary | {"parameters": {"k22": k22}}), encoding="utf-8")
    return 0.5
