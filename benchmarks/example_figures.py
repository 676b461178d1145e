"""Figures of the pages in `docs/examples/`, which `benchmarks.numbers` draws there.

A page names them ``<case>-<kind>.svg``; the kinds are the keys of `FIGURES`. The sketch of the structure is drawn from
the case file, everything else from ``docs/examples/<case>.json``, the few hundred numbers that `benchmarks.numbers`
keeps of a run. `python -m benchmarks.example_figures FOLDER` writes them all into another folder.
"""

import argparse
import json
import math
import re
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rcParams
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks import example_data
from jointbayes.frf import Ports
from jointbayes.posterior import Posterior
from jointbayes.report.canvas import add_strokes, extremes, logarithmic, panels, points_of_polyline, svg
from jointbayes.report.model import SERIES_COLOURS
from jointbayes.report.sections.fit_to_data import frf_unit
from jointbayes.report.structure_sketch import sketch
from vibrecords import FrfData

Kept = dict[str, Any]

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "examples"
RECORD = ROOT / "docs" / "numbers.json"
#: Points of a curve, and draws, that are kept.
POINTS, DRAWS = 240, 400
_MOST_FRFS = 6  # in one figure
_MARGIN = 28  # characters that fit into that of the intervals
_UNSEEN = 0.05  # of ln |H|: less than a point in every figure
#: Numbers that the page of one case alone quotes.
NUMBERS: dict[str, Callable[[Posterior], dict[str, float]]] = {"two_storeys": example_data.moments}
_BLUE, _ORANGE, _GREEN = SERIES_COLOURS[:3]
_FIGURE = re.compile(r"\]\((\w+)-(\w+)\.svg\)")


def examples() -> dict[str, Path]:
    """Cases of which pages of `docs/examples/` show a figure, and their pages."""
    pages = sorted(FOLDER.glob("*.md"))
    return {name: page for page in pages for name, _ in _FIGURE.findall(page.read_text(encoding="utf-8"))}


def named() -> dict[str, tuple[str, str]]:
    """Case and kind of every figure that a page shows, by its file name."""
    texts = (page.read_text(encoding="utf-8") for page in sorted(FOLDER.glob("*.md")))
    return {f"{case}-{kind}.svg": (case, kind) for text in texts for case, kind in _FIGURE.findall(text)}


def keep(name: str, posterior: Path) -> dict[str, float]:
    """Write what the figures of a case show, from the draws of its run; give the numbers that its page alone has."""
    found = jb.load_posterior(posterior)
    text = json.dumps(kept_of(found), separators=(",", ":"), allow_nan=False)
    (FOLDER / f"{name}.json").write_text(text.replace('},{"', '},\n{"') + "\n", encoding="utf-8")
    return NUMBERS[name](found) if name in NUMBERS else {}


def kept_of(posterior: Posterior) -> Kept:
    """FRFs measured and predicted, of each test, priors and some draws of the stiffnesses."""
    names, problem = posterior.stiffness_names, posterior.problem
    stiffness = posterior.stiffness
    rows = np.linspace(0, len(stiffness) - 1, DRAWS).round().astype(int)
    return {
        "prior": {k: _short(np.quantile(posterior.prior_values(k), [0.025, 0.975])) for k in names},
        "draws": {k: _short(stiffness[rows, i]) for i, k in enumerate(names)},
        "frfs": [frf for part in problem.parts for frf in _frfs(posterior, part.test.name)],
    }


def _frfs(posterior: Posterior, test: str) -> list[Kept]:
    """Each FRF of a test at lines that show its peaks; none where the data are modes."""
    problem = posterior.problem.part(test or None)
    if not isinstance(problem.test.data, FrfData):
        return []
    frf, prior, theta = problem.test.data.frf, problem.prior, posterior.estimate.theta
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    band = posterior.predict_frf(test=test or None)
    best = problem.frfs_as_measured(ports, frf.quantity, prior.values(theta)[None], prior.factors(theta)[None])[0]
    found = []
    for i, j in np.ndindex(len(frf.outputs), len(frf.inputs)):
        at = (slice(None), i, j)
        some = extremes(np.log(np.abs(best[at])), POINTS)
        curves = {"measured": np.abs(frf.values[at]), "map": np.abs(best[at])}
        curves |= {"low": band.magnitude_low[at], "high": band.magnitude_high[at]}
        what = {"test": test, "output": frf.outputs[i], "input": frf.inputs[j], "quantity": frf.quantity}
        found.append({**what, "hz": _short(frf.frequency_hz[some]), **{k: _short(v[some]) for k, v in curves.items()}})
    return found


def _short(values: NDArray[np.float64]) -> list[float]:
    """Four digits: more than a figure shows."""
    return [float(f"{value:.4g}") for value in values]


def light(draw: Callable[[Any], None], width: float, height: float) -> str:
    """A figure for the repository: no small ticks, and characters instead of their outlines, a third of the bytes."""

    def drawn_light(canvas: Any) -> None:
        rcParams.update({"svg.fonttype": "none", "font.sans-serif": ["DejaVu Sans"]})  # `svg` puts back what it found
        draw(canvas)
        for axes in canvas.axes:
            axes.minorticks_off()

    return svg(drawn_light, width, height)


def structure(name: str) -> str:
    """What is where: bodies, joints, sensors and forces."""
    return sketch(jb.load_case(ROOT / "configs" / f"{name}.toml").problem.parts[0])


def fit(name: str) -> str:
    """Magnitude of the FRFs, of no more than six: data, MAP and 95 % band."""
    frfs = _kept(name)["frfs"][:_MOST_FRFS]
    columns = min(2, len(frfs))
    rows = math.ceil(len(frfs) / columns)

    def draw(canvas: Any) -> None:
        grid = panels(canvas, rows, columns, top=0.55, apart=(0.75, 0.7)).ravel()
        for axes in grid[len(frfs) :]:
            axes.remove()
        for axes, frf in zip(grid, frfs, strict=False):
            _dots(axes, frf["hz"], frf["measured"], lw=1.2, ec=_ORANGE)
            axes.plot([], [], ".", ms=2.5, color=_ORANGE, label="data")  # the entry of the legend
            hz, curves = np.array(frf["hz"]), np.stack([frf[k] for k in ("low", "high", "map")], axis=1)
            some = points_of_polyline(hz, np.log(curves), _UNSEEN)
            low, high, best = curves[some].T
            axes.fill_between(hz[some], low, high, color=_BLUE, alpha=0.35, lw=0, label="95 % band")
            axes.plot(hz[some], best, lw=0.9, color=_BLUE, label="MAP")
            logarithmic(axes)
            axes.set_xlabel("Frequency (Hz)")
            axes.set_ylabel(f"|H| ({frf_unit(frf['quantity'], frf['output'], frf['input'])})")
            test = f"{frf['test']}: " if frf["test"] else ""
            axes.set_title(f"{test}{frf['output']} / {frf['input']}", fontsize=9, loc="right")
        canvas.legend(*grid[0].get_legend_handles_labels(), ncols=3, loc="upper left")

    return light(draw, 7.4, 0.55 + 2.5 * rows)


def _dots(axes: Any, x: list[float], y: list[float], **style: Any) -> None:
    """Points in one path, a fifth of the bytes of markers."""
    add_strokes(axes, np.array(x), np.array(y), np.array(y), zorder=2, **style)
    axes.update_datalim(np.stack([x, y], axis=1))
    axes.autoscale_view()


def intervals(name: str) -> str:
    """Each stiffness over its prior: median, 95 % interval, true value."""
    case, kept = json.loads(RECORD.read_text(encoding="utf-8"))["cases"][name], _kept(name)
    names = [k for k in kept["prior"] if case[k]["low"] > 0 < kept["prior"][k][0]]

    def draw(canvas: Any) -> None:
        grid = panels(canvas, len(names), left=1.7, bottom=0.3, apart=(0.42, 0.1))[:, 0]
        for axes, k in zip(grid, names, strict=True):
            entry, (low, high) = case[k], kept["prior"][k]
            axes.axvspan(low, high, color="#5b6672", alpha=0.15, lw=0)
            axes.plot([entry["low"], entry["high"]], [0, 0], lw=5, color=_BLUE, solid_capstyle="butt")
            axes.plot(entry["median"], 0, "o", ms=5, mfc="white", mec=_BLUE)
            if entry["reference"] is not None:
                axes.axvline(entry["reference"], color=_GREEN, ls="--", lw=1)
            axes.set_xscale("log")
            axes.set_xlim(low / 1.5, high * 1.5)
            axes.set_ylim(-1, 1)
            axes.set_yticks([0], [f"{k}, {entry['unit']}\n{textwrap.fill(entry['words'], _MARGIN)}"])

    return light(draw, 7.4, 0.3 + 0.75 * len(names))


def draws(name: str) -> str:
    """Draws of the first two stiffnesses."""
    case, kept = json.loads(RECORD.read_text(encoding="utf-8"))["cases"][name], _kept(name)
    one, other = list(kept["draws"])[:2]

    def draw(canvas: Any) -> None:
        axes = panels(canvas, top=0.3)[0, 0]
        _dots(axes, kept["draws"][one], kept["draws"][other], lw=1.5, alpha=0.5, ec=_BLUE)
        known = [[case[k]["reference"] for k in (one, other)]]
        for pair in example_data.solutions() if name == "two_storeys" else known:
            axes.plot(*pair, "+", ms=14, mew=1.5, color=_GREEN)
        axes.set_xlabel(f"{one} ({case[one]['unit']})")
        axes.set_ylabel(f"{other} ({case[other]['unit']})")

    return light(draw, 5.0, 3.4)


#: Kinds of figures by the word in their file name.
FIGURES: dict[str, Callable[[str], str]] = {
    "structure": structure,
    "fit": fit,
    "intervals": intervals,
    "draws": draws,
}


def _kept(name: str) -> Kept:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def drawn(case: str = "") -> dict[str, str]:
    """Every figure that a page shows, or those of one case, as SVG text by its file name."""
    return {file: FIGURES[kind](name) for file, (name, kind) in named().items() if case in ("", name)}


def main() -> None:
    """Write the figures into a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("case", nargs="?", default="", help="of this case alone")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for file, text in drawn(options.case).items():
        (options.folder / file).write_text(text, encoding="utf-8")
        print(options.folder / file)


if __name__ == "__main__":
    main()
