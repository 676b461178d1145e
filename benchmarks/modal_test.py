"""A usual modal test, and a large one from a file: CPU, memory and sizes of a run.

    python -m benchmarks.modal_test                                          # ten FRFs of 9921 lines
    python -m benchmarks.modal_test --responses 200 --lines 10000 --format npz
    python -m benchmarks.modal_test --responses 200 --lines 10000 --format uff58b --variance coherence

The case is `configs/clamped_beam_midspan.toml` with as many outputs and lines. With `--format` its noisy FRFs are
written to a measurement file first, which the run then reads.
"""

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.written_files import FORMATS, write_frf
from jointbayes.case.case import case_from_text
from jointbayes.case.case_text import read_case_text
from vibrecords import FrfData

_CASE = Path(__file__).parent.parent / "configs" / "clamped_beam_midspan.toml"
_BAND_HZ = 20.0, 2500.0
_AVERAGES = 20  # behind the coherence of a file


class Test:
    """How large a modal test is.

    Parameters
    ----------
    responses, lines
        Numbers of outputs and of lines. Outputs are the nodes after the clamp, the force acts at the tip.
    """

    def __init__(self, responses: int = 10, lines: int = 9921) -> None:
        self.nodes = range(2, responses + 2)
        low, high = _BAND_HZ
        # the upper end falls between two lines, so that rounding takes none away
        self.step_hz = (high - low) / (lines - 0.5)
        self.responses, self.lines = responses, lines


def modal_test_text(test: Test | None = None) -> str:
    """Text of the case with synthetic data."""
    test = test or Test()
    tip = max(test.nodes)
    text = read_case_text(_CASE).text
    outputs = ", ".join(f'"{node}:y"' for node in test.nodes)
    low, high = _BAND_HZ
    for pattern, new in (
        (r"^elements = \d+", f"elements = {tip - 1}"),
        (r"^outputs = \[.*?\]", f"outputs = [{outputs}]"),
        (r"^inputs = \[.*?\]", f'inputs = ["{tip}:y"]'),
        (r"^f_min_hz = [\d.]+", f"f_min_hz = {low}"),
        (r"^f_max_hz = [\d.]+", f"f_max_hz = {high}"),
        (r"^f_step_hz = [\d.]+", f"f_step_hz = {test.step_hz!r}"),
    ):
        text, changed = re.subn(pattern, new, text, flags=re.MULTILINE)
        assert changed == 1, "the shipped case has other keys than this script expects"
    return text


def file_case(test: Test, directory: Path, form: str, variance: str) -> Path:
    """Write measurement file and case file of a test, and return the latter.

    Parameters
    ----------
    test
        Size.
    directory
        Where both go.
    form
        Format of the file, one of `FORMATS`.
    variance
        ``"relative"`` or ``"coherence"``: where the case takes the variance from.
    """
    text = modal_test_text(test)
    measurement = case_from_text("modal_test", text).problem.test.data
    assert isinstance(measurement, FrfData)
    frf = measurement.frf
    ratio = measurement.variance / np.abs(frf.values) ** 2
    frf = replace(frf, coherence=1 / (1 + ratio * (_AVERAGES - 1)), averages=_AVERAGES)
    write_frf(frf, directory / f"measured.{form}", form)
    channels = "\n".join(f'"{node}:y" = "{node}:y"' for node in test.nodes)
    law = {"relative": 'source = "relative"\nrelative = 0.03\nfloor = 0.01', "coherence": 'source = "coherence"'}
    low, high = _BAND_HZ
    data = (
        f'[data]\nkind = "measured_frf"\nfile = "measured.{form}"\nf_min_hz = {low}\nf_max_hz = {high}\n\n'
        f"[data.channels]\n{channels}\n\n[data.variance]\n{law[variance]}\n\n"
    )
    before, rest = text.split("[data]\n", 1)
    _, after = rest.split("[identification]", 1)
    case = directory / "modal_test.toml"
    case.write_text(f"{before}{data}[identification]{after}", encoding="utf-8")
    return case


def run_case(case: Path, out: Path) -> dict[str, Any]:
    """Run a case in a process of its own: exit status, CPU, peak memory, and sizes of what it wrote, MB."""
    command = [sys.executable, "-c", "from jointbayes.cli.commands import main; main()", "run", os.fspath(case)]
    done = subprocess.run([*command, "--out", os.fspath(out)], check=False)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    sizes = {
        name: round((out / name).stat().st_size / 1e6, 2)
        for name in ("report.html", "report.pdf", "posterior.nc", "summary.json")
        if (out / name).exists()
    }
    return {
        "exit status": done.returncode,
        "CPU s": round(used.ru_utime + used.ru_stime, 1),
        "system s": round(used.ru_stime, 1),
        "peak memory MB": round(used.ru_maxrss / 1024),
        **sizes,
    }


def main() -> None:
    """Run the case and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--responses", type=int, default=10)
    parser.add_argument("--lines", type=int, default=9921)
    parser.add_argument("--format", choices=FORMATS, help="write a measurement file first, and read it")
    parser.add_argument("--variance", choices=["relative", "coherence"], default="relative")
    parser.add_argument("--keep", type=Path, help="directory for case, file and run; a temporary one by default")
    chosen = parser.parse_args()
    test = Test(chosen.responses, chosen.lines)
    with tempfile.TemporaryDirectory() as scratch:
        place = chosen.keep or Path(scratch)
        place.mkdir(parents=True, exist_ok=True)
        if chosen.format is None:
            case = place / "modal_test.toml"
            case.write_text(modal_test_text(test), encoding="utf-8")
        else:
            case = file_case(test, place, chosen.format, chosen.variance)
            print(f"measurement file {(place / f'measured.{chosen.format}').stat().st_size / 1e6:.1f} MB")
        print(f"{test.responses} responses of {test.lines} lines")
        for what, value in run_case(case, place / "run").items():
            print(f"{what}: {value}")


if __name__ == "__main__":
    main()
