"""Runs the shipped cases and keeps what README and docs quote: `python -m benchmarks.numbers`.

Every case of `configs/` is run by the command line as a user runs it, with its own settings and seed. What came out is
kept in `docs/numbers.json`, and the marked places of README and docs are written from it (`benchmarks.quoted`). What
the figures of an example show is kept beside its page (`benchmarks.example_figures`). Figures, and pages that are made
from the code, are written with them.
"""

import argparse
import hashlib
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import example_data, example_figures, gallery, quoted, readme_figure
from benchmarks.record import environment
from jointbayes.case.case_text import read_case_text

ROOT = Path(__file__).resolve().parents[1]
CONFIGS = ROOT / "configs"
RECORD = ROOT / "docs" / "numbers.json"
STIFFNESSES = ("k11", "k12", "k22")
#: Stiffnesses that made the data of cases which do not state them.
MADE_WITH: dict[str, Callable[[], dict[str, float]]] = {
    "spindle_measured": lambda: truth(shipped()["spindle_tool"]),
    "two_storeys_shape": lambda: dict(zip(("first.kx", "second.kx"), example_data.solutions()[0], strict=True)),
}
#: Cases whose hypotheses docs/comparison.md weighs.
COMPARED = ("clamped_beam_frequencies", "clamped_beam_frequencies_360mm")
#: What docs/method.md shows of the paper's iteration: name, case, and what is changed in it.
ITERATIONS = {
    "clamped_beam_noise_free": ("clamped_beam_noise_free", ()),
    "clamped_beam": ("clamped_beam", ()),
    "as_printed": ("clamped_beam", (("line_weight = 0.5", "line_weight = 0.0"),)),
}


def shipped() -> dict[str, Path]:
    """Case files of the repository by name."""
    return {path.stem: path for path in sorted(CONFIGS.glob("*.toml"))}


def claims(path: Path) -> dict[str, int]:
    """Exit status of each command that the comments of a case file promise."""
    text = path.read_text(encoding="utf-8")
    return {command: int(status) for line in text.splitlines() for command, status in _claimed(line)}


def _claimed(line: str) -> list[tuple[str, str]]:
    return re.findall(r"`(\w+)` exits (\d)", line) if line.startswith("#") else []


def fingerprint(path: Path) -> str:
    """Of what a case file says, with the files it builds on; comments, layout and `[about]` move no number."""
    content = json.dumps({key: of for key, of in read_case_text(path).data.items() if key != "about"}, sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:16]


def truth(path: Path) -> dict[str, float]:
    """The stiffnesses that made the data of a case, or that are published, by name; none where nobody knows."""
    if path.stem in MADE_WITH:
        return MADE_WITH[path.stem]()
    spec = read_case_text(path).data
    known = spec.get("reference") or spec["data"].get("truth") or {}
    lone = {**known, **known.get("stiffness", {})}
    several = {f"{joint}.{k}": v for joint, own in lone.items() if isinstance(own, dict) for k, v in own.items()}
    return {k: v for k, v in {**lone, **several}.items() if isinstance(v, int | float)}


def command(folder: Path, *arguments: str) -> tuple[int, list[str]]:
    """Exit status and output, without the progress, of the command line run in a directory."""
    code = "from jointbayes.cli.commands import main; main()"
    found = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONUTF8": "1", "COLUMNS": "200"},
    )
    if found.returncode not in (0, 1, 3):
        raise SystemExit(f"jointbayes {' '.join(arguments)}: exit {found.returncode}\n{found.stderr}")
    return found.returncode, found.stdout.splitlines()


def run_case(name: str, path: Path) -> dict[str, Any]:
    """What a run of a case found, and its check where the comments promise one."""
    spec = read_case_text(path).data
    with tempfile.TemporaryDirectory() as folder:
        before = _cpu()
        status, printed = command(Path(folder), "run", str(path))
        seconds = _cpu() - before
        left = Path(folder) / "reports" / name
        summary = json.loads((left / "summary.json").read_text(encoding="utf-8"))
        more = example_figures.keep(name, left / "posterior.nc") if name in example_figures.examples() else {}
        more |= gallery.KEPT[name](left / "posterior.nc") if name in gallery.KEPT else {}
        gallery.keep_page_one(name, left / "report.pdf")
        checked = command(Path(folder), "check", str(path)) if "check" in claims(path) else None
    known, known_truth = summary["identifiability"] or {}, truth(path)
    parameters = summary["parameters"]
    return {
        "config": fingerprint(path),
        "title": spec["title"],
        "seed": summary["seed"],
        "exit": status,
        "cpu_s": float(f"{seconds:.2g}"),
        "printed": printed,
        "converged": summary["converged"],
        "explains": summary["check"]["explains"],
        "chi2_per_line": _short(summary["check"]["chi2_per_line"]),
        "mode_agrees": summary["map"]["mode_agrees"],
        "steps": summary["sampler"]["steps"],
        "tau": _short(max(summary["sampler"]["tau"].values())),
        "efficiency": _short(summary["sampler"]["proposal_efficiency"]),
        "combinations": known.get("sentence"),
        **{k: _stiffness(k, entry, known_truth.get(k), printed) for k, entry in parameters.items()},
        "freed": {
            "assumptions": known.get("freed_assumptions"),
            "sentence": known.get("freed_sentence"),
            "rows": [_freed(premises, row) for premises, row in summary["under"].items()],
        },
        **more,
        **({"left_out": summary["left_out"]} if summary["left_out"] else {}),
        **({} if checked is None else {"check": {"exit": checked[0], "printed": checked[1]}}),
    }


def _cpu() -> float:
    """Return the CPU time of all processes started and ended so far, s: it depends little on what else runs."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _stiffness(name: str, entry: dict[str, Any], reference: float | None, printed: list[str]) -> dict[str, Any]:
    """One stiffness; the Monte Carlo errors and the one-sided limit where the summary has them."""
    low, high = entry["interval95"]
    errors = dict(zip(("low_error", "high_error"), entry.get("interval95_error", ()), strict=False))
    optional = {**errors, "limit": entry["limit"]}
    return {
        "unit": entry["unit"],
        "reference": reference,
        "median": _short(entry["median"]),
        "low": _short(low),
        "high": _short(high),
        "ratio": _short(max(high / low, low / high)) if low * high > 0 else None,
        "mode": _short(entry["map"]),
        **{key: _short(value) for key, value in optional.items() if value is not None},
        "verdict": entry["verdict"],
        "words": words_of(name, printed),
    }


def _freed(premises: str, row: dict[str, Any]) -> dict[str, Any]:
    """What is left of the intervals under other premises."""
    ends = {name: [_short(end) for end in known["interval95"]] for name, known in row.items()}
    verdicts = {name: known["verdict"] for name, known in row.items()}
    return {"freed": premises, "interval95": ends, "verdict": verdicts}


def words_of(name: str, printed: list[str]) -> str:
    """The verdict on a stiffness as the terminal words it."""
    line = next(line for line in printed if line.startswith((f"{name} = ", f"{name} above ", f"{name} below ")))
    return line.partition(": ")[2]


def _short(value: float) -> float:
    """Six digits: more than any page prints."""
    return float(f"{value:.6g}")


def run_compare() -> dict[str, Any]:
    """What the comparison of `COMPARED` found, best first."""
    files = [str(CONFIGS / f"{name}.toml") for name in COMPARED]
    with tempfile.TemporaryDirectory() as folder:
        status, _ = command(Path(folder), "compare", *files, "--out", "compared")
        gallery.keep_page_one("comparison", Path(folder) / "compared" / "report.pdf")
        found = json.loads((Path(folder) / "compared" / "compare.json").read_text(encoding="utf-8"))
    kept = ("hypothesis", "case", "log_z", "log_z_error", "method", "two_log_b", "words", "at_prior_edge")
    rows = sorted(found["candidates"], key=lambda c: -c["log_z"])
    candidates = [{key: _short(row[key]) if isinstance(row[key], float) else row[key] for key in kept} for row in rows]
    return {"seed": found["seed"], "exit": status, "finding": found["finding"], "candidates": candidates}


def run_iteration(name: str, changes: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    """What `identify --paper` prints, and how far the paper's iteration ends from the truth, %."""
    text = read_case_text(CONFIGS / f"{name}.toml").text  # with that of the case it builds on
    truth = tomllib.loads(text)["data"]["truth"]
    for old, new in changes:
        if old not in text:
            raise SystemExit(f"{name}: found no {old!r} to change")
        text = text.replace(old, new, 1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.toml"
        path.write_text(text, encoding="utf-8")
        _, printed = command(Path(folder), "identify", path.name, "--paper")
    last = [line for line in printed if re.match(r" *\d+ ", line)][-1].split()
    off = {k: _short(100 * (float(value) / truth[k] - 1)) for k, value in zip(STIFFNESSES, last[2:], strict=True)}
    return {"printed": printed, "steps": int(last[0]), "off_percent": off}


def renewed(record: dict[str, Any], part: str) -> dict[str, Any]:
    """The record with one part run again."""
    found = environment()
    packages = {name: version for name, version in found["packages"].items() if version}
    made = {**{key: found[key] for key in ("date", "cpu", "system", "python")}, "packages": packages}
    if part == "compare":
        return {**record, "environment": made, "compare": run_compare()}
    if part == "identify":
        return {**record, "environment": made, "identify": {k: run_iteration(*what) for k, what in ITERATIONS.items()}}
    cases = {**record["cases"], part: run_case(part, shipped()[part])}
    return {**record, "environment": made, "cases": {name: cases[name] for name in runnable() if name in cases}}


def runnable() -> list[str]:
    """Cases whose comments say that they run."""
    return [name for name, path in shipped().items() if "run" in claims(path)]


def made_files(record: dict[str, Any]) -> dict[Path, str]:
    """Return the figures of runs, as text by their files."""
    files = {example_figures.FOLDER / name: text for name, text in example_figures.drawn().items()}
    return files | {readme_figure.FIGURE: readme_figure.drawn(record), gallery.FIGURE: gallery.drawn(record)}


def main() -> None:
    """Run what is asked for, keep it, and write README and docs from the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = [*runnable(), "compare", "identify"]
    parser.add_argument("part", nargs="*", help=f"what to run again; by default all of {', '.join(parts)}")
    only = "run nothing; write pages and figures from the record and the code"
    parser.add_argument("--write-only", action="store_true", help=only)
    options = parser.parse_args()
    unknown = set(options.part) - set(parts)
    if unknown:
        parser.error(f"found {', '.join(sorted(unknown))}; expected some of {', '.join(parts)}")
    record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {"cases": {}}
    for part in [] if options.write_only else options.part or parts:
        print(part, flush=True)
        record = renewed(record, part)
        RECORD.write_text(json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")
    quoting = {page: quoted.written(page.read_text(encoding="utf-8"), record) for page in quoted.pages()}
    for path, text in (quoting | made_files(record)).items():
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            print(f"written: {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
