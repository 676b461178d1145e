"""What the calibration study found, as tables and figures."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration_data import VARIANTS
from benchmarks.page import table
from jointbayes.studies.calibration import CalibrationResult

__all__ = ["FIGURES", "PAGE", "SUMMARY", "between", "section", "write_figure", "write_page"]

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
    where, n = data["environment"], data["count"]
    ended = n - len(data["failed"])
    rows = []
    for name, row in data["parameters"].items():
        low, high = row["coverage_interval95"]
        rows.append(
            (
                name,
                "yes" if row["inside_band"] else "**no**",
                f"{row['p_value']:.3f}",
                f"{row['largest_deviation']:+.3f}",
                f"{100 * row['covered'] / ended:.1f} % ({100 * low:.1f} to {100 * high:.1f})",
            )
        )
    head = ("parameter", "inside the 95 % band", "p-value", "largest deviation", "95 % intervals that hold the truth")
    lines = [
        f"### {variant.capitalize()}",
        "",
        f"{n} data sets; {where['date']}, {where['cpu']}, Python {where['python']}; "
        f"median {data['median_seconds']:.1f} s of one core and {data['median_ess']:.0f} effective draws each. "
        f"Converged: {data['converged']} of {n}; joint mode and MAP agree: {data['mode_agrees']} of {n}; "
        f"failed: {len(data['failed'])}.",
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


def write_figure(variant: str, judged: Sequence[CalibrationResult]) -> None:
    """Draw the empirical distributions of the ranks less the uniform one, each with its simultaneous band."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    columns = min(4, len(judged))
    rows = -(-len(judged) // columns)
    with mpl.rc_context({"svg.hashsalt": variant, "font.size": 8, "svg.fonttype": "none"}):
        figure = Figure(figsize=(2.4 * columns, 1.9 * rows), layout="constrained")
        axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True)).ravel()
        for ax, one in zip(axes, judged, strict=False):
            u, band = one.band.position, one.band
            ax.fill_between(u, band.low - u, band.high - u, step="post", color="0.85", linewidth=0)
            ax.step(u, one.shares - u, where="post", linewidth=1.0, color="C0" if one.inside_band else "C3")
            ax.axhline(0.0, color="0.5", linewidth=0.5)
            ax.set_title(one.name, fontsize=8)
        for ax in axes[len(judged) :]:
            ax.set_axis_off()
        figure.supxlabel("rank of the truth / number of draws")
        figure.supylabel("ECDF − uniform")
        FIGURES.mkdir(exist_ok=True)
        figure.savefig(FIGURES / figure_name(variant), metadata={"Date": None})
