"""Tasks for the tests of `run_tasks`: functions at the top of a module that workers can load."""

import os
import signal
import time
from pathlib import Path

import jointbayes as jb
from vibrecords.files import whole_file


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


def pretend_case(work):
    """In place of sampling: a file and a row from the seed alone; what a case does besides stands in its title."""
    title = next(line for line in work.text.splitlines() if line.startswith("title = "))
    tries = Path(work.file).parent.parent.parent / "tries"
    tries.mkdir(exist_ok=True)
    (tries / f"{work.key}-{time.monotonic_ns()}").touch()
    if "kill" in title:
        os.kill(os.getpid(), signal.SIGKILL)
    if "fail" in title and not (tries.parent / "mended").exists():
        raise jb.SamplingError(f"{work.key}: found no start; expected one; correct the case")
    with whole_file(work.file) as scratch:
        scratch.write_text(f"{work.seed}")
    return {
        "seconds": 0.0, "converged": "far" not in title, "reason": "so", "explains": True, "misfit_p_value": 0.5,
        "k11.unit": "N/m", "k11.median": 1.0 + work.seed, "k11.verdict": "identified",
    }  # fmt: skip
