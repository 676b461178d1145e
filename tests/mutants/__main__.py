"""python -m tests.mutants [ID ...] [--resume] [--copies N] [--outcomes FILE]."""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tests.mutants.harness import LIST, ROOT, Trials, copy_tree, read_list, rooms_of


def main(arguments: Sequence[str] | None = None, root: Path = ROOT, listed: Path = LIST) -> int:
    """Put each mutant into a copy of the tree and run its tests; 1 where one survives or no longer fits the tree."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=main.__doc__)
    parser.add_argument("ids", nargs="*", metavar="ID", help="mutants; by default all of the list")
    parser.add_argument("--resume", action="store_true", help="take over outcomes that the file has of the same code")
    parser.add_argument("--copies", type=int, default=2, help="how many at a time, by default 2")
    parser.add_argument("--outcomes", type=Path, default=Path("mutants.jsonl"), help="file that outcomes are added to")
    given = parser.parse_args(arguments)
    mutants = read_list(listed)
    if unknown := set(given.ids) - {mutant.id for mutant in mutants}:
        parser.error(f"found {', '.join(sorted(unknown))}; expected names of mutants in {listed.name}")
    chosen = [mutant for mutant in mutants if not given.ids or mutant.id in given.ids]
    if faults := [fault for mutant in chosen for fault in mutant.faults(root)]:
        print("\n".join(faults))
        return 1
    begun, rooms = time.monotonic(), rooms_of(chosen)
    with tempfile.TemporaryDirectory(prefix="jointbayes-mutants-") as place:
        copies = [copy_tree(root, Path(place, str(number))) for number in range(given.copies)]
        trials = Trials(root, copies, given.outcomes, resume=given.resume)
        trials.run(rooms.values())
        sound = [mutant for mutant in chosen if trials.good(rooms[mutant.room])]
        trials.run(sound)
    left = [mutant.id for mutant in chosen if mutant not in sound or not trials.good(mutant)]
    names = f": {', '.join(left)}" if left else ""
    print(f"{len(chosen) - len(left)} mutants killed, {len(left)} not{names}; {time.monotonic() - begun:.0f} s")
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
