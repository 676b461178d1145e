"""Runs of cases, two at a time, and the files in which they are kept."""

import hashlib
import json
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from benchmarks.size import ROOT

from tests.same.cases import DEAR
from tests.same.record import Record, arithmetic, record

KEPT = Path(__file__).parent / "kept"
#: What the last run found: `--update` takes from here what nothing has changed since.
FOUND = ROOT / "build" / "same"
_SOURCES = (
    *("src/**/*", "configs/**/*"),
    *("tests/same/cases.py", "tests/same/record.py", "tests/conftest.py", "benchmarks/*.py"),
)


def sources() -> str:
    """Fingerprint of all that decides about what is found."""
    digest = hashlib.sha256(json.dumps(arithmetic()).encode())
    for path in sorted(path for pattern in _SOURCES for path in ROOT.glob(pattern)):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def read(path: Path) -> Record:
    """A record; empty where there is none."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def write(path: Path, kept: Record) -> None:
    """A record, a line for each value: version control then shows what changed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(kept, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")


def is_found(name: str, fingerprint: str) -> bool:
    """Whether the last run of a case was of these very sources."""
    return read(FOUND / f"{name}.json").get("sources") == fingerprint


def run(name: str, fingerprint: str) -> float:
    """Write down what a case gives; the CPU seconds that it took."""
    began = time.process_time()
    write(FOUND / f"{name}.json", {"sources": fingerprint, **record(name)})
    return time.process_time() - began


def run_all(names: Iterable[str], fingerprint: str) -> Iterator[tuple[str, float, str]]:
    """Run cases, two at a time, the dearest first: name, CPU seconds, and how it failed, as each ends."""
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        runs = {pool.submit(run, name, fingerprint): name for name in sorted(names, key=lambda n: n not in DEAR)}
        for done in as_completed(runs):
            error = done.exception()
            yield runs[done], 0.0 if error else done.result(), f"{type(error).__name__}: {error}" if error else ""
