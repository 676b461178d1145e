"""What the study with an exact beam found, as figures and as tables of docs/trust.md."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.exact_data import NAMES, SUBJECTS
from benchmarks.page import number, table
from benchmarks.record import write_between

PAGE = Path(__file__).resolve().parents[1] / "docs" / "trust.md"
Outcomes = Sequence[Mapping[str, Any]]
#: A mode is found if its log posterior is no more than so much below the end of a climb from the truth.
SAME_MODE = 1.0


def coverage_summary(found: Outcomes) -> dict[str, Any]:
    """How often intervals hold the truth, and how far off stiffnesses called identified are."""
    ended = [one for one in found if not one["error"]]
    return {
        "count": len(found),
        "failed": [one["error"] for one in found if one["error"]],
        "converged": sum(one["converged"] for one in ended),
        "mode_agrees": sum(one["mode_agrees"] for one in ended),
        "explains": sum(one["explains"] for one in ended),
        "median_seconds": float(np.median([one["seconds"] for one in found])),
        "stiffness": {name: _held([one["stiffness"][name] for one in ended]) for name in NAMES},
    }


def _held(rows: Outcomes) -> dict[str, Any]:
    verdicts = sorted({row["verdict"] for row in rows})
    return {
        "held95": sum(_inside(row, "interval95") for row in rows),
        "held999": sum(_inside(row, "interval999") for row in rows),
        "verdicts": {verdict: sum(row["verdict"] == verdict for row in rows) for verdict in verdicts},
        "wrong_identified": sum(row["verdict"] == "identified" and not _inside(row, "interval999") for row in rows),
    }


def _inside(row: Mapping[str, Any], interval: str) -> bool:
    low, high = row[interval]
    return bool(low <= row["truth"] <= high)


def mode_summary(found: Outcomes) -> dict[str, Any]:
    """How often the mode was found, and in what time."""
    ended = [one for one in found if not one["error"]]
    missed = [one for one in ended if one["found"] < one["from_truth"] - SAME_MODE]
    return {
        "count": len(found),
        "found": len(ended) - len(missed),
        "missed": {str(one["index"]): one["from_truth"] - one["found"] for one in missed},
        "failed": [one["error"] for one in found if one["error"]],
        "median_seconds": float(np.median([one["seconds"] for one in found])),
        "longest_seconds": float(np.max([one["seconds"] for one in found])),
    }


def bounds_summary(found: Outcomes) -> dict[str, Any]:
    """Verdicts on stiffnesses whose truth lies beyond a bound, by bound and distance."""
    ended = [one for one in found if not one["error"]]
    rows: dict[str, dict[str, int]] = {}
    for one in ended:
        name, end, factor = one["bound"]
        verdicts = rows.setdefault(f"{name} {end} × {factor:g}", {})
        verdict = one["stiffness"][name]["verdict"]
        if one["stiffness"][name]["if_model_right"]:
            verdict += ", if the model were right"
        verdicts[verdict] = verdicts.get(verdict, 0) + 1
    judged = [one["stiffness"][one["bound"][0]] for one in ended]
    return {
        "count": len(found),
        "failed": [one["error"] for one in found if one["error"]],
        "bounded": sum(one["verdict"] in ("bounded below", "bounded above") for one in judged),
        "called_identified": sum(one["verdict"] in ("identified", "weakly identified") for one in judged),
        "verdicts": rows,
        "reasons": [
            {"bound": one["bound"], "verdict": row["verdict"], "reason": row["verdict_reason"]}
            for one, row in zip(ended, judged, strict=True)
        ],
    }


def seeds_summary(found: Outcomes) -> dict[str, Any]:
    """Scatter over seeds of the ends of 95 % intervals, and the errors that were reported for them."""
    ended = [one for one in found if not one["error"]]
    rows = {}
    for name in NAMES:
        each = [one["stiffness"][name] for one in ended]
        ends = np.array([row["interval95"] for row in each])
        stated = [row["error95"] for row in each if row["error95"] is not None]
        error = np.sqrt(np.mean(np.square(stated), axis=0)) if stated else None
        scatter = ends.std(axis=0, ddof=1) if len(ends) > 1 else np.full(2, np.nan)
        for i, end in enumerate(("lower", "upper")):
            rows[f"{name}, {end} end"] = {
                "mean": float(ends[:, i].mean()),
                "scatter": float(scatter[i]) if np.isfinite(scatter[i]) else None,
                "stated": None if error is None else float(error[i]),
                "ratio": None if error is None or not scatter[i] > 0 else float(error[i] / scatter[i]),
            }
    return {
        "count": len(found),
        "failed": [one["error"] for one in found if one["error"]],
        "converged": sum(one["converged"] for one in ended),
        "median_seconds": float(np.median([one["seconds"] for one in found])),
        "ends": rows,
    }


def page_text(results: Mapping[str, Any]) -> str:
    """The generated part of the page."""
    sections = {"coverage": _coverage, "mode": _mode, "bounds": _bounds}
    lines: list[str] = []
    for part, write in sections.items():
        if part in results:
            title, body = write(results[part]["subjects"])
            lines += [f"### {title}", "", where_measured(results[part]["environment"]), "", *body, ""]
    return "\n".join(lines)


def write_page(results: Path) -> None:
    """Write what is on record into docs/trust.md."""
    write_between(PAGE, "exact_study.py", page_text(json.loads(results.read_text(encoding="utf-8"))))


def where_measured(environment: Mapping[str, Any]) -> str:
    """Date, machine and version of a study, as one sentence."""
    version = environment["packages"]["jointbayes"]
    return f"{environment['date']}, {environment['cpu']}, Python {environment['python']}, jointbayes {version}."


def _failures(subjects: Mapping[str, Any]) -> list[str]:
    return [f"- Failed, {subject}: {error}" for subject, data in subjects.items() for error in data["failed"]]


def _coverage(subjects: Mapping[str, Any]) -> tuple[str, list[str]]:
    rows = []
    for subject, data in subjects.items():
        for i, (name, row) in enumerate(data["stiffness"].items()):
            rows.append(
                (
                    SUBJECTS[subject].title if i == 0 else "",
                    f"{data['count']} ({data['converged']})" if i == 0 else "",
                    name,
                    str(row["held95"]),
                    str(row["held999"]),
                    str(row["verdicts"].get("identified", 0)),
                    str(row["wrong_identified"]),
                    f"{data['median_seconds']:.1f}" if i == 0 else "",
                )
            )
    head = (
        *("structure", "data sets (converged)", "stiffness", "95 % interval holds the truth"),
        *("99.9 % interval holds it", "identified", "of these outside 99.9 %", "CPU seconds, median"),
    )
    return "Do intervals hold the truth?", [*table(head, rows), *_failures(subjects)]


def _mode(subjects: Mapping[str, Any]) -> tuple[str, list[str]]:
    found, count = (sum(data[key] for data in subjects.values()) for key in ("found", "count"))
    medians, longest = ([data[f"{key}_seconds"] for data in subjects.values()] for key in ("median", "longest"))
    missed = [
        f"- Missed, {subject}, data set {index}: {number(depth)} below."
        for subject, data in subjects.items()
        for index, depth in data["missed"].items()
    ]
    lines = [
        f"In {found} of {count} data sets, the same number of each structure, in {min(medians):.2f} to "
        f"{max(medians):.2f} s of CPU in the median, at the longest {max(longest):.2f} s.",
        *missed,
        *_failures(subjects),
    ]
    return "Is the mode found?", lines


def _bounds(subjects: Mapping[str, Any]) -> tuple[str, list[str]]:
    (data,) = subjects.values()
    counts = Counter[str]()
    for verdicts in data["verdicts"].values():
        counts.update(verdicts)
    lines = [
        f"Verdicts: {', '.join(f'{verdict} {count}' for verdict, count in counts.most_common())}.",
        f'Called "identified" or "weakly identified": {data["called_identified"]} of {data["count"]}; '
        f'"bounded below" or "bounded above": {data["bounded"]}.',
        "",
        *_failures(subjects),
    ]
    return "Truths beyond the prior's bounds", lines
