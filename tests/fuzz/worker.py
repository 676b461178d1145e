"""The process that attempts inputs, one after the other, until it dies: python -m tests.fuzz.worker TARGET ROOT FD."""

import importlib
import json
import logging
import os
import resource
import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from jointbayes.errors import JointBayesError
from tests.fuzz.targets import Target


@dataclass(frozen=True)
class Verdict:
    """What an input did: "accepted" and "refused" are right, anything else is a fault of the package."""

    kind: str
    text: str = ""
    where: str = ""

    @property
    def right(self) -> bool:
        """Whether the package did what it should."""
        return self.kind in ("accepted", "refused")


def load_target(place: str) -> Target:
    """The target at ``module:name``, of the `TARGETS` of a module."""
    module, name = place.split(":")
    return importlib.import_module(module).TARGETS[name]


def computing_seconds() -> float:
    """Computing time of this process and of those that it has waited for, s."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def _files(root: Path) -> Iterator[str]:
    for folder, folders, files in os.walk(root):
        yield from (os.path.join(folder, name) for name in (*folders, *files))


@contextmanager
def _memory(most: int) -> Iterator[None]:
    """Address space bound while an input is attempted, so that a bomb ends in MemoryError and not in the machine's."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, ((most if hard == resource.RLIM_INFINITY else min(most, hard)), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _where(error: BaseException) -> str:
    """File and function of the packages where an error was raised: faults at one place are one fault."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = tuple(f"{os.sep}{package}{os.sep}" for package in ("jointbayes", "vibrecords"))
    last = ([frame for frame in frames if any(package in frame.filename for package in ours)] or frames)[-1]
    return f"{type(error).__name__} in {Path(last.filename).name}:{last.name}"


def _attempted(target: Target, path: Path) -> Verdict:
    try:
        target.attempt(path)
    except JointBayesError as error:
        fault = target.message_fault(str(error), path)
        return Verdict("message", f"{fault}: {error!s}", fault) if fault else Verdict("refused")
    except MemoryError as error:
        return Verdict("memory", traceback.format_exc(), _where(error))
    except BaseException as error:
        return Verdict("traceback", traceback.format_exc(), _where(error))
    return Verdict("accepted")


def judge(target: Target, path: Path, root: Path) -> Verdict:
    """Attempt one input and look at all that it did."""
    before = set(_files(root))
    printed = sum(os.fstat(stream).st_size for stream in (1, 2))
    begun = computing_seconds()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with _memory(target.memory):
            verdict = _attempted(target, path)
    spent = computing_seconds() - begun
    sys.stdout.flush()
    sys.stderr.flush()
    left = sorted(set(_files(root)) - before)
    for name in reversed(left):
        os.rmdir(name) if os.path.isdir(name) and not os.path.islink(name) else os.unlink(name)
    if not verdict.right:
        return verdict
    if left:
        return Verdict("file left", ", ".join(os.path.relpath(name, root) for name in left), verdict.kind)
    if caught:
        first = caught[0]
        place = f"{first.category.__name__} in {Path(first.filename).name}"
        return Verdict("warning", f"{first.filename}:{first.lineno}: {first.message}", place)
    if sum(os.fstat(stream).st_size for stream in (1, 2)) > printed:
        return Verdict("printed", (root / "printed").read_text(errors="replace")[printed // 2 :], verdict.kind)
    if spent > target.seconds:
        return Verdict("slow", f"{spent:.1f} s of computing", verdict.kind)
    return verdict


def main() -> None:
    """Attempt the inputs that are named on standard input, one path a line; answer one line of JSON each."""
    place, root, answers = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
    target = load_target(place)
    logging.getLogger("jointbayes").setLevel(logging.ERROR)  # that loops are compiled, once after an installation
    target.prepare(root / "in")
    with os.fdopen(answers, "w") as out:
        print(json.dumps({"ready": True}), file=out, flush=True)
        for line in sys.stdin:
            print(json.dumps(asdict(judge(target, Path(json.loads(line)), root))), file=out, flush=True)


if __name__ == "__main__":
    main()
