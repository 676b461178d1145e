"""A usual modal test: CPU, memory and sizes of a run with ten FRFs of 9921 lines.

    python -m benchmarks.modal_test

The case is `configs/clamped_beam_midspan.toml` with outputs at ten nodes and lines 0.25 Hz apart.
"""

import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

__all__ = ["main", "modal_test_text"]

_CASE = Path(__file__).parent.parent / "configs" / "clamped_beam_midspan.toml"
#: Nodes of the outputs, and the step between lines, Hz.
OUTPUTS, STEP_HZ = range(2, 12), 0.25


def modal_test_text() -> str:
    """Text of the case."""
    text = _CASE.read_text(encoding="utf-8")
    outputs = ", ".join(f'"{node}:y"' for node in OUTPUTS)
    text, changed = re.subn(r"^outputs = \[.*?\]", f"outputs = [{outputs}]", text, flags=re.MULTILINE)
    text, stepped = re.subn(r"^(f_step_hz|step_hz) = [\d.]+", rf"\1 = {STEP_HZ}", text, flags=re.MULTILINE)
    assert changed == stepped == 1, "the shipped case has other keys than this script expects"
    return text


def main() -> None:
    """Run the case in a process of its own and print what it took."""
    with tempfile.TemporaryDirectory() as scratch:
        case, out = Path(scratch) / "modal_test.toml", Path(scratch) / "run"
        case.write_text(modal_test_text(), encoding="utf-8")
        command = [sys.executable, "-c", "from jointbayes.cli.commands import main; main()", "run", os.fspath(case)]
        done = subprocess.run([*command, "--out", os.fspath(out)], check=False)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(f"exit status {done.returncode}")
        print(f"CPU {used.ru_utime + used.ru_stime:.1f} s, of which system {used.ru_stime:.1f} s")
        print(f"peak memory {used.ru_maxrss / 1024:.0f} MB")
        for name in ("report.html", "report.pdf", "posterior.nc"):
            print(f"{name} {(out / name).stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
