"""python -m tests.same [NAME ...] [--update] [--all]: runs the cases, says what differs from what is kept, exits 1."""

import argparse
import sys
from itertools import chain

from tests.same import runs
from tests.same.cases import IN_CI, NAMES
from tests.same.compare import judged, other_arithmetic
from tests.same.record import Record

_SHOWN = 25


def lines_of(kept: Record, found: Record, shown: int) -> tuple[list[str], list[str]]:
    """What differs from what is kept of a case, and what was not compared or may differ, a line each."""
    if not kept:
        return ["nothing is kept of it; --update keeps what was found"], []
    differ, may_differ = judged(kept, found)
    lines, other = [str(each) for each in differ], other_arithmetic(kept, found)
    if len(lines) > shown:
        lines = [*lines[:shown], f"… {len(lines)} differences; --all shows them"]
    notes = [f"******** NOT COMPARED: draws, and numbers but for intervals; kept with {other}"] if other else []
    return lines, notes + [f"not counted, by another arithmetic: {each}" for each in may_differ]


def main() -> None:
    """Run cases, two at a time, and print what differs from what is kept; exit 1 if anything does."""
    parser = argparse.ArgumentParser(prog="python -m tests.same", description=main.__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"cases, or ci for {', '.join(IN_CI)}; default all")
    parser.add_argument("--update", action="store_true", help="keep what is found, or was by the last run")
    parser.add_argument("--all", action="store_true", help=f"show all differences, not the first {_SHOWN} of a case")
    given = parser.parse_args()
    names = list(dict.fromkeys(one for name in given.names or NAMES for one in (IN_CI if name == "ci" else (name,))))
    if unknown := [name for name in names if name not in NAMES]:
        parser.error(f"found {', '.join(unknown)}; expected some of: {', '.join(NAMES)}")
    fingerprint, shown, spent, differ = runs.sources(), sys.maxsize if given.all else _SHOWN, 0.0, []
    ready = [name for name in names if given.update and runs.is_found(name, fingerprint)]
    ended = ((name, 0.0, "") for name in ready)
    for name, seconds, failure in chain(ended, runs.run_all(set(names) - set(ready), fingerprint)):
        kept, found = runs.read(runs.KEPT / f"{name}.json"), runs.read(runs.FOUND / f"{name}.json")
        lines, notes = ([f"ended with {failure}"], []) if failure else lines_of(kept, found, shown)
        verdict = "differs" if lines else "same"
        print(f"{name}: {verdict} ({seconds:.1f} s of CPU)", *notes, *lines, sep="\n  ", flush=True)
        if given.update and not failure:
            runs.write(runs.KEPT / f"{name}.json", {key: found[key] for key in found if key != "sources"})
        elif lines:
            differ.append(name)
        spent += seconds
    gone = sorted(path.stem for path in runs.KEPT.glob("*.json") if path.stem not in NAMES)
    print(f"{len(names)} cases, {spent:.0f} s of CPU; {', '.join(differ) or 'none'} differ")
    if gone:
        print(f"no such case, remove from {runs.KEPT}: {', '.join(gone)}")
    sys.exit(1 if differ or gone else 0)


if __name__ == "__main__":
    main()
