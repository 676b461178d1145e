"""Published stiffnesses and our intervals, the figure of docs/trust.md, and pictures of reports for docs/gallery.md."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import jointbayes as jb
from benchmarks.example_figures import light
from benchmarks.quoted import OBJECTIVES, ROOT, Record, stiffnesses
from jointbayes.report.canvas import panels
from jointbayes.report.model import SERIES_COLOURS

#: Cases of the page, in its order.
CASES = (
    "beam_on_springs",
    "tied_beams",
    "rotor_bearings",
    "rotor_dampers",
    "two_machines",
    "three_storeys",
    "four_storeys",
    "eighteen_storeys",
)
FIGURE = ROOT / "docs" / "figures" / "published.svg"
PICTURES = ROOT / "docs" / "figures" / "gallery"
_KNOWN = 0.1  # standard deviation of ln k along a direction that counts as known
_BLUE, _ORANGE, _GREEN = SERIES_COLOURS[:3]


def known_directions(posterior: Path) -> dict[str, Any]:
    """Standard deviations of ln k along the principal axes of the draws, and how many of them are below 10 %."""
    stiffness = jb.load_posterior(posterior).stiffness
    sd = np.sqrt(np.linalg.eigvalsh(np.cov(np.log(stiffness).T)))
    return {"directions": {"known": int((sd < _KNOWN).sum()), "sd": [float(f"{value:.3g}") for value in sd]}}


#: What is kept of the draws of a case beside what is kept of all.
KEPT = {"eighteen_storeys": known_directions}


def keep_page_one(name: str, report: Path) -> None:
    """Keep page one of a report, as docs/gallery.md shows it, of a case that has its picture there; by pdftoppm."""
    picture = PICTURES / f"{name}.png"
    if picture.exists():
        page = ["pdftoppm", "-r", "92", "-f", "1", "-singlefile", "-png", str(report), str(picture.with_suffix(""))]
        subprocess.run(page, check=True)
        Image.open(picture).quantize(128, Image.Quantize.FASTOCTREE).save(picture, optimize=True)


def drawn(record: Record) -> str:
    """Interval and median of each stiffness over its published value, and all published ones, as SVG text."""
    rows = [(name, i, k) for name in CASES for i, k in enumerate(stiffnesses(record["cases"][name]))]

    def draw(canvas: Any) -> None:
        axes = panels(canvas, left=2.2, bottom=0.55, top=0.1)[0, 0]
        places = np.arange(len(rows))[::-1]
        for y, (name, i, k) in zip(places, rows, strict=True):
            entry = record["cases"][name][k]
            reference = entry["reference"]
            theirs = [values[i] for values in OBJECTIVES.get(name, {"": (reference,) * (i + 1)}).values()]
            axes.plot(np.array([entry["low"], entry["high"]]) / reference, [y, y], lw=5, color=_BLUE, alpha=0.6)
            axes.plot(entry["median"] / reference, y, "o", ms=5, mfc="white", mec=_BLUE)
            axes.plot(np.array(theirs) / reference, [y] * len(theirs), "|", ms=11, mew=1.6, color=_ORANGE)
        axes.set_xscale("log")
        axes.set_xlim(0.5, 3.3)
        axes.set_xticks([0.6, 0.8, 1, 1.25, 1.5, 2, 3], ["0.6", "0.8", "1", "1.25", "1.5", "2", "3"])
        axes.set_yticks(places, [f"{name}: {k}" for name, _, k in rows])
        axes.set_xlabel("Stiffness over its published value")

    return light(draw, 7.4, 0.75 + 0.27 * len(rows))
