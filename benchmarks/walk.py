"""The files that a call enters from a stored posterior to the text of page one: `python -m benchmarks.walk FILE`.

Each function counts once, where it is first called: calls of the same function again are the same way. The way is the
sequence of files that these first calls enter, one stay for each change of file; the rooms are those of the files. The
first way computes what page one says, checks of the model among it, and the second makes its text of what is computed.
Without FILE the posterior is that of `configs/clamped_beam.toml`.
"""

import argparse
import sys
import tempfile
from collections import Counter
from itertools import groupby
from pathlib import Path
from types import CodeType, FrameType

import jointbayes as jb
from benchmarks.size import ROOT
from jointbayes.report import ReportInputs
from jointbayes.report.sections.lead import lead

SRC = ROOT / "src"


def stays(inputs: ReportInputs) -> list[str]:
    """Files in the order in which making page one enters them, as "jointbayes/report/sections/lead.py"."""
    seen: dict[CodeType, None] = {}

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(str(SRC)):
            seen.setdefault(frame.f_code)

    sys.setprofile(note)
    try:
        lead(inputs)
    finally:
        sys.setprofile(None)
    return [name for name, _ in groupby(str(Path(code.co_filename).relative_to(SRC)) for code in seen)]


def main() -> None:
    """Print the way and how often the most visited files and rooms are entered."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.walk", description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, help="a posterior.nc")
    with tempfile.TemporaryDirectory() as place:
        file = parser.parse_args().file or Path(place, "run", "posterior.nc")
        if not file.exists():
            jb.write_report(jb.sample(jb.load_case(ROOT / "configs" / "clamped_beam.toml"), seed=1), Path(place, "run"))
        inputs = ReportInputs(jb.load_posterior(file))
    for what in ("computed", "written"):
        way = stays(inputs)
        rooms = [room for room, _ in groupby(name.split("/")[1] for name in way)]
        print(f"{what}: {len(way)} stays in {len(set(way))} files, {len(rooms)} in {len(set(rooms))} rooms")
        print(" → ".join(rooms))
        for name, times in Counter(way).most_common(5):
            print(f"{times} times in {name}")


if __name__ == "__main__":
    main()
