"""What the calibration study found, as tables and figures."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.calibration_data import VARIANTS
from benchmarks.page import table
from jointbayes.studies.calibration import ranks_figure
from jointbayes.studies.data_sets import QuantityCalibration

ROOT = Path(__file__).resolve().parents[1]
SUMMARY = ROOT / "benchmarks" / "calibration.json"
PAGE = ROOT / "docs" / "calibration.md"
FIGURES = ROOT / "docs" / "figures"
BEGIN, END = "<!-- begin: written by the script -->", "<!-- end -->"


def between(page: str, text: str) -> str:
    """The page with other text between its two marks."""
    head, rest = page.split(BEGIN)
    _, tail = rest.split(END)
    return f"{head}{BEGIN}\n\n{text}\n{END}{tail}"


def write_page() -> None:
    """Write what has been measured into docs/calibration.md."""
    found = json.loads(SUMMARY.read_text(encoding="utf-8"))
    text = "\n".join(section(name, found[name]) for name in VARIANTS if name in found)
    PAGE.write_text(between(PAGE.read_text(encoding="utf-8"), text), encoding="utf-8")
    print(f"written: {PAGE.relative_to(ROOT)}", flush=True)


def section(variant: str, data: Mapping[str, Any]) -> str:
    """Table of one variant."""
    where, n = data["environment"], data["data_sets"]
    rows = []
    for name, row in data["quantities"].items():
        low, high = row["coverage_interval95"]
        rows.append(
            (
                name,
                "inside" if row["inside_band"] else "**outside**",
                f"{row['p_value']:.3f}",
                f"{100 * row['covered'] / n:.1f} % ({100 * low:.1f} to {100 * high:.1f})",
            )
        )
    head = ("quantity", "ranks and band", "p-value", "95 % intervals that hold the truth")
    lines = [
        f"### {variant.capitalize()}",
        "",
        f"{n} data sets, seed {data['seed']}; {where['date']}, {where['cpu']}; median {data['median_seconds']:.1f} s. "
        f"Converged: {data['converged']} of {n}; joint mode and MAP agree: {data['mode_agrees']} of {n}; "
        f"failed: {data['failed']}. All quantities together: p = {data['p_value']:.2g}.",
        "",
        *table(head, rows),
        "",
        f"![ECDF differences of the ranks, {variant}](figures/{figure_name(variant)})",
        "",
    ]
    return "\n".join(lines)


def figure_name(variant: str) -> str:
    """File name of a variant's figure."""
    return f"calibration-{variant.replace(' ', '-')}.svg"


def write_figure(variant: str, judged: Sequence[QuantityCalibration]) -> None:
    """Draw the empirical distributions of the ranks less the uniform one, each with its simultaneous band."""
    FIGURES.mkdir(exist_ok=True)
    (FIGURES / figure_name(variant)).write_text(ranks_figure(judged), encoding="utf-8")
