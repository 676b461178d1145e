"""python -m tests.fuzz TARGET|all --count N | --seconds S | --together S [--seed K] [--first I] [--offenders DIR]."""

import argparse
import sys
from pathlib import Path

from tests.fuzz.harness import fuzz
from tests.fuzz.targets import TARGETS


def main() -> None:
    """Fuzz one target or all, each for so many inputs or so long; exit 1 where the package did what it should not."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=main.__doc__)
    parser.add_argument("target", choices=["all", *TARGETS])
    parser.add_argument("--count", type=int, help="inputs of each target")
    parser.add_argument("--seconds", type=float, help="time for each target")
    parser.add_argument("--together", type=float, metavar="SECONDS", help="time for all targets together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--offenders", type=Path, default=Path("fuzz-offenders"), help="where to keep what failed")
    given = parser.parse_args()
    chosen = list(TARGETS) if given.target == "all" else [given.target]
    seconds = given.seconds if given.together is None else given.together / len(chosen)
    if given.count is None and seconds is None:
        parser.error("--count, --seconds or --together is needed")
    clean = True
    for name in chosen:
        tally = fuzz(
            f"tests.fuzz.targets:{name}",
            seed=given.seed,
            count=given.count,
            seconds=seconds,
            offenders=given.offenders,
            first=given.first,
        )
        print(tally, flush=True)
        clean &= not tally.faults
    sys.exit(0 if clean else 1)


if __name__ == "__main__":
    main()
