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
    text = page_text(found)
    PAGE.write_text(between(PAGE.read_text(encoding="utf-8"), text), encoding="utf-8")
    print(f"written: {PAGE.relative_to(ROOT)}", flush=True)


def page_text(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Table and figures of all variants."""
    known = [name for name in VARIANTS if name in found]
    head = (
        "uncertain",
        "data sets (converged)",
        "ranks outside their band",
        "p, all together",
        "95 % intervals hold, %",
    )
    figures = [f"![ECDF differences of the ranks, {name}](figures/{figure_name(name)})" for name in known]
    return "\n\n".join(["\n".join(table(head, (row_of(name, found[name]) for name in known))), *figures]) + "\n"


def row_of(variant: str, data: Mapping[str, Any]) -> tuple[str, ...]:
    """What came out of one variant."""
    n, quantities = data["data_sets"], data["quantities"]
    outside = ", ".join(name for name, row in quantities.items() if not row["inside_band"]) or "none"
    held = [100 * row["covered"] / n for row in quantities.values()]
    counts = f"{n} ({data['converged']})"
    return (
        variant,
        counts,
        f"{outside} of {len(quantities)}",
        f"{data['p_value']:.2g}",
        f"{min(held):.1f} to {max(held):.1f}",
    )


def figure_name(variant: str) -> str:
    """File name of a variant's figure."""
    return f"calibration-{variant.replace(' ', '-')}.svg"


def write_figure(variant: str, judged: Sequence[QuantityCalibration]) -> None:
    """Draw the empirical distributions of the ranks less the uniform one, each with its simultaneous band."""
    FIGURES.mkdir(exist_ok=True)
    (FIGURES / figure_name(variant)).write_text(ranks_figure(judged), encoding="utf-8")
