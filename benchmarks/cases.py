"""The cases that are benchmarked, at any number of lines, and joints at which to evaluate them."""

import os
import re
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from jointbayes.case.case_text import read_case_text
from jointbayes.joint import LogStiffness

ROOT = Path(__file__).resolve().parents[1]

#: Case file and damping law by short name.
CASES = {"modal": "clamped_beam", "loss_factor": "clamped_beam_loss_factor"}


def case_with_lines(law: str, f_min_hz: float | None = None, f_step_hz: float | None = None) -> jb.Case:
    """Load the case with this damping law; other lines than the file's if given."""
    name = CASES[law]
    text = read_case_text(ROOT / "configs" / f"{name}.toml").text
    for key, value in (("f_min_hz", f_min_hz), ("f_step_hz", f_step_hz)):
        if value is not None:
            text, count = re.subn(rf"(?m)^{key} = \S+", f"{key} = {float(value)}", text)
            if count != 1:
                raise ValueError(f"configs/{name}.toml: found {key} {count} times; expected it once")
    return jb.case_from_text(name, text)


def quick_case(law: str) -> jb.Case:
    """Load the case with this damping law at 50 lines, for tests and for trying the scripts."""
    return case_with_lines(law, f_step_hz=50.0)


def joints(case: jb.Case, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates θ (count, 3) about the true joint, as wide as its posterior, and their K^J (count, 2, 2)."""
    assert case.reference is not None
    rng = np.random.default_rng(0)
    theta = np.log(case.reference) + rng.normal(size=(count, 3)) * [0.25, 0.1, 0.004]
    return theta, LogStiffness().matrix(np.exp(theta)).stiffness


def one_core() -> None:
    """Keep this process, and whatever threads its libraries start, on the core that is least busy now."""
    if hasattr(os, "sched_setaffinity"):
        before = _idle_ticks()
        time.sleep(0.5)
        after = _idle_ticks()
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {max(cores, key=lambda core: after.get(core, 0) - before.get(core, 0))})
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")


def _idle_ticks() -> dict[int, int]:
    """Ticks for which each core has been idle, by number of the core; empty where the system does not tell."""
    try:
        lines = Path("/proc/stat").read_text(encoding="ascii").splitlines()
    except OSError:
        return {}
    return {int(c[0][3:]): int(c[4]) for c in map(str.split, lines) if c and re.fullmatch(r"cpu\d+", c[0])}
