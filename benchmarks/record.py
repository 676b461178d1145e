"""Results of the benchmarks: kept as JSON with where they were measured, printed, and written as a page."""

import argparse
import datetime
import json
import os
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from benchmarks.page import page, section

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results.json"
PAGE = ROOT / "docs" / "trust.md"

#: Packages whose versions the figures depend on.
PACKAGES = (
    *("jointbayes", "numpy", "scipy", "numba", "emcee", "arviz"),
    *("dynesty", "nautilus-sampler", "jax", "jaxlib", "blackjax"),
)


def environment() -> dict[str, Any]:
    """Date, machine and package versions."""
    return {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "cpu": _cpu_model(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES},
    }


def _cpu_model() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    names = [line.split(":", 1)[1].strip() for line in text.splitlines() if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that every benchmark has."""
    parser.add_argument("--quick", action="store_true", help="few lines and short runs, to try the script")
    parser.add_argument("--json", type=Path, help="where to keep the results; a quick run keeps none by default")


def merged(path: Path | None, name: str, data: Mapping[str, Any], quick: bool) -> dict[str, Any]:
    """The results kept at `path`, with this section replaced."""
    kept = json.loads(path.read_text(encoding="utf-8")) if path is not None and path.exists() else {}
    return {**kept, name: {"environment": environment(), "quick": quick, **data}}


def write_between(page: Path, script: str, text: str) -> None:
    """Write what a script found into a page, between its marks."""
    begin, end = f"<!-- begin: written by benchmarks/{script} -->", "<!-- end -->"
    head, rest = page.read_text(encoding="utf-8").split(begin)
    _, tail = rest.split(end, 1)
    page.write_text(f"{head}{begin}\n\n{text}\n{end}{tail}", encoding="utf-8")
    print(f"written: {page.relative_to(ROOT)}")


def keep(name: str, data: Mapping[str, Any], options: argparse.Namespace) -> None:
    """Print one section; keep it among the others in the JSON file and write the page from all of them."""
    json_path = options.json if options.quick else options.json or RESULTS
    results = merged(json_path, name, data, options.quick)
    print(section(name, results[name]))
    if json_path is not None:
        json_path.write_text(json.dumps(results, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        print(f"written: {json_path}")
    if not options.quick:
        write_between(PAGE, "record.py", page(results))
