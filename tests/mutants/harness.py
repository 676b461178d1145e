"""Put one fault at a time into a copy of the tree, and run there the tests that should fail.

A mutant is killed if a test fails or cannot be set up: pytest ends with 1. Whatever else happens says nothing about the
tests, so it counts as not killed: a line that pytest cannot even import (the list needs another one), a test that takes
too long (a slow machine would do the same), no test to run. That its tests pass without it is checked first.
"""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import SimpleQueue

ROOT = Path(__file__).resolve().parents[2]
LIST = Path(__file__).with_name("mutants.toml")
#: What of the tree the tests need; numba's and Python's caches are copied with it, and valid by their times.
_COPIED = ("src", "tests", "benchmarks", "configs", "docs", "pyproject.toml", "README.md", "Makefile")
#: Marks of the tests that `make test` runs: it is these that must see a fault.
_MARKS = "not science and not docs and not whole"
_TEST_SECONDS, _MOST_SECONDS = 600, 1800  # of one test, which takes a few, and of all that are run together
_EXITS = {0: "survived", 1: "killed", 2: "does not import", 4: "names no test", 5: "runs no test"}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One line of one file as it is and as it would be wrong, and the tests, files or nodes, that see it."""

    id: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]

    @property
    def room(self) -> str:
        """Directory or file in the tests where its first test is."""
        return self.tests[0].partition("::")[0].split("/")[1]

    def faults(self, root: Path) -> list[str]:
        """Why it cannot be put into a tree, each in one line; none where it can."""
        path, found = root / self.file, []
        count = path.read_text(encoding="utf-8").count(self.old) if self.old and path.is_file() else 0
        if count != 1:
            found.append(f"{self.old!r} stands {count} times in {self.file}; expected once; write it as it is now")
        if self.new == self.old or "\n" in self.old + self.new:
            found.append(f"{self.new!r} in the place of {self.old!r}; expected another text, both within one line")
        for test in self.tests or ("",):
            file, *names = test.split("::")
            text = (root / file).read_text(encoding="utf-8") if (root / file).is_file() else ""
            if not text or not all(re.search(rf"\b{re.escape(name.partition('[')[0])}\b", text) for name in names):
                found.append(f"{test!r} is no test; expected a test file, or file::test; name one")
        return [f"{self.id}: {fault}" for fault in found]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of the tests of a mutant; of those of a room, which is no mutant and has no file."""

    mark: str
    id: str
    file: str
    words: str
    seconds: float
    by: str = ""

    @property
    def good(self) -> bool:
        """Whether it is as it should be: tests pass without a mutant and fail with it."""
        return self.words == ("killed" if self.file else "survived")

    def __str__(self) -> str:
        of_room = {"survived": "tests pass", "killed": "tests fail"}
        words = self.words if self.file else of_room.get(self.words, self.words)
        return f"{self.id:<16} {words:<16} {self.seconds:6.1f} s  {self.by}".rstrip()


def read_list(path: Path = LIST) -> list[Mutant]:
    """The mutants of a list."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))["mutant"]
    return [Mutant(**(table | {"tests": tuple(table["tests"])})) for table in tables]


def rooms_of(mutants: Iterable[Mutant]) -> dict[str, Mutant]:
    """All tests of the mutants by the room of their first one, as a mutant that changes nothing."""
    tests: dict[str, dict[str, None]] = {}
    for mutant in mutants:
        tests.setdefault(mutant.room, {}).update(dict.fromkeys(mutant.tests))
    return {room: Mutant(f"({room})", "", "", "", tuple(each)) for room, each in tests.items()}


def fingerprint(root: Path) -> str:
    """Of all code of a tree: outcomes of another are not taken for those of this one."""
    digest = hashlib.sha256()
    code = [path for part in ("src", "tests") for kind in ("py", "toml") for path in (root / part).rglob(f"*.{kind}")]
    for path in sorted(code):
        digest.update(f"{path.relative_to(root)}\n".encode() + path.read_bytes())
    return digest.hexdigest()


def copy_tree(root: Path, to: Path) -> Path:
    """Copy what the tests need, with the times of all files."""
    for name in _COPIED:
        if (root / name).is_dir():
            shutil.copytree(root / name, to / name)
        elif (root / name).exists():
            shutil.copy2(root / name, to / name)
    return to


def run_tests(tree: Path, tests: Sequence[str], *, unmutated: bool) -> tuple[int | None, str]:
    """Exit code of pytest on these tests of a tree, None where it had to be ended, and what it printed.

    Bytecode is kept of files as they are alone: it is told from that of a mutant by the second and the size only.
    """
    environment = os.environ | {"PYTHONPATH": str(tree / "src"), "PYTHONDONTWRITEBYTECODE": "" if unmutated else "1"}
    options = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "-m", _MARKS, f"--timeout={_TEST_SECONDS}"]
    command = [sys.executable, "-m", "pytest", *options, *tests]
    try:
        run = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, timeout=_MOST_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return None, ""
    return run.returncode, run.stdout


def judge(code: int | None, printed: str) -> tuple[str, str]:
    """What an exit code of pytest says of a mutant, and the first test that failed."""
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", printed, re.MULTILINE)
    if code is None or "from pytest-timeout" in printed:
        return "takes too long", failed[1] if failed else ""
    if code == 1 and not failed:
        return "broke pytest", ""
    return _EXITS.get(code, f"pytest ended with {code}"), failed[1] if failed else ""


def attempt(mutant: Mutant, root: Path, copy: Path, mark: str) -> Outcome:
    """Run the tests of a mutant in a copy of the tree with it, and leave the copy as it was."""
    begun, path = time.monotonic(), copy / mutant.file
    try:
        if mutant.file:
            path.write_text(path.read_text(encoding="utf-8").replace(mutant.old, mutant.new), encoding="utf-8")
        words, by = judge(*run_tests(copy, mutant.tests, unmutated=not mutant.file))
    finally:
        if mutant.file:
            shutil.copy2(root / mutant.file, path)  # with its time: what was compiled of it is valid again
    return Outcome(mark, mutant.id, mutant.file, words, round(time.monotonic() - begun, 1), by)


class Trials:
    """Runs mutants in copies of a tree, as many at a time as there are copies, and adds the outcomes to a file.

    To resume takes over those that the file has of the same mutant in the same code; a line that was cut off is none.
    """

    def __init__(self, root: Path, copies: Sequence[Path], kept: Path, *, resume: bool) -> None:
        self._root, self._copies, self._kept, self._tree = root, copies, kept, fingerprint(root)
        self._done: dict[str, Outcome] = {}
        for line in kept.read_text(encoding="utf-8").splitlines() if resume and kept.exists() else []:
            with suppress(ValueError, TypeError):
                outcome = Outcome(**json.loads(line))
                self._done[outcome.mark] = outcome

    def _mark(self, mutant: Mutant) -> str:
        return hashlib.sha256(f"{self._tree} {mutant}".encode()).hexdigest()[:16]

    def good(self, mutant: Mutant) -> bool:
        """Whether its outcome is there, and as it should be."""
        outcome = self._done.get(self._mark(mutant))
        return outcome is not None and outcome.good

    def run(self, mutants: Iterable[Mutant]) -> None:
        """Run those that are not done, and print each outcome as it comes."""
        free: SimpleQueue[Path] = SimpleQueue()
        for copy in self._copies:
            free.put(copy)

        def one(mutant: Mutant) -> Outcome:
            copy = free.get()
            try:
                return attempt(mutant, self._root, copy, self._mark(mutant))
            finally:
                free.put(copy)

        pool = ThreadPoolExecutor(len(self._copies))
        try:
            left = [mutant for mutant in mutants if self._mark(mutant) not in self._done]
            for done in as_completed([pool.submit(one, mutant) for mutant in left]):
                outcome = done.result()
                self._done[outcome.mark] = outcome
                with self._kept.open("a", encoding="utf-8") as file:
                    file.write(f"\n{json.dumps(asdict(outcome))}")  # after what may have been cut off
                print(outcome, flush=True)
        finally:
            pool.shutdown(cancel_futures=True)
