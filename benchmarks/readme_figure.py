"""The figure at the top of README, drawn from `docs/numbers.json`: `python -m benchmarks.readme_figure`.

Three cases of the same beam: all but the joint exactly known, material, length and damping uncertain, and a second
accelerometer. `benchmarks.numbers` draws it anew with every record; `tests/test_numbers.py` compares.
"""

import json
import math
import tomllib
from typing import Any

from benchmarks.quoted import MINUS, ROOT, Record, stiffness

FIGURE = ROOT / "docs" / "figures" / "clamped_beam.svg"
#: What the rows of each stiffness say, by case; the priors of k11 and k22 are the same in all three.
ROWS = {
    "clamped_beam": "tip FRF, beam exactly known",
    "clamped_beam_uncertain": "tip FRF, beam uncertain",
    "clamped_beam_midspan": "the same, and mid-span FRF",
}
COLOURS = {"identified": "#2b7a55", "weakly identified": "#8a6d00"}
OTHER, PRIOR, INK, MUTED = "#c1511b", "#e4e9ee", "#1d2733", "#5b6672"
LEFT, RIGHT, TOP, ROW, WIDTH = 195, 555, 30, 20, 800
DECADES = -4, 3


def _x(ratio: float) -> float:
    """Place of a ratio to the true value."""
    low, high = DECADES
    return LEFT + (RIGHT - LEFT) * (math.log10(ratio) - low) / (high - low)


def _text(x: float, y: float, text: str, style: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" {style}>{text}</text>'


def _bar(y: float, height: float, ends: tuple[float, float], colour: str) -> str:
    low, high = map(_x, ends)
    return (
        f'<rect x="{low:.1f}" y="{y:.1f}" width="{max(high - low, 2):.1f}" height="{height}" rx="1" fill="{colour}"/>'
    )


def _rows(name: str, top: float, record: Record, prior: dict[str, Any]) -> list[str]:
    """One stiffness: its prior and a bar for each case."""
    truth = record["cases"]["clamped_beam"][name]["reference"]
    heading = f"{name}, {record['cases']['clamped_beam'][name]['unit']}"
    # the prior of k12 is log-uniform in the first case alone; the others state one of the coupling k12/√(k11 k22)
    band = ROW * (1 if name == "k12" else len(ROWS))
    lines = [
        _text(12, top - 5, heading, 'font-weight="bold"'),
        _bar(top, band, (prior["low"] / truth, prior["high"] / truth), PRIOR),
    ]
    for number, (case, words) in enumerate(ROWS.items()):
        entry, y = record["cases"][case][name], top + number * ROW
        limit = entry.get("limit")
        interval = f"above {stiffness(limit)}" if limit else f"{stiffness(entry['low'])} to {stiffness(entry['high'])}"
        colour = COLOURS.get(entry["verdict"], OTHER)
        lines += [
            _text(24, y + 14, words, f'fill="{MUTED}"'),
            _bar(y + 5, ROW - 10, (entry["low"] / truth, entry["high"] / truth), colour),
            f'<circle cx="{_x(entry["median"] / truth):.1f}" cy="{y + ROW / 2}" r="3" fill="white" stroke="{colour}" '
            'stroke-width="2"/>',
            _text(RIGHT + 12, y + 14, f"{interval}: {entry['verdict']}", f'fill="{colour}"'),
        ]
    return lines


def drawn(record: Record) -> str:
    """The figure as SVG."""
    priors = tomllib.loads((ROOT / "configs" / "clamped_beam.toml").read_text(encoding="utf-8"))["prior"]
    block = ROW * (len(ROWS) + 1.5)
    bottom = TOP + block * len(priors) - 8
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {bottom + 44:.0f}" width="{WIDTH}" '
        f'font-family="Helvetica, Arial, sans-serif" font-size="12" fill="{INK}">',
        "<title>Medians and 95 % credible intervals of the three stiffnesses over their priors</title>",
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for place, (name, prior) in enumerate(priors.items()):
        lines += _rows(name, TOP + block * place, record, prior)
    lines.append(f'<path d="M{_x(1):.1f} {TOP - 12}V{bottom:.0f}" stroke="{INK}" stroke-dasharray="3 3"/>')
    for decade in range(DECADES[0], DECADES[1] + 1):
        x = _x(10.0**decade)
        power = str(decade).replace("-", MINUS)
        label = "1" if decade == 0 else f'10<tspan dy="-5" font-size="9">{power}</tspan>'
        lines.append(f'<path d="M{x:.1f} {bottom:.0f}v5" stroke="{MUTED}"/>')
        lines.append(_text(x, bottom + 19, label, f'text-anchor="middle" fill="{MUTED}"'))
    caption = "stiffness / true value; bar: 95 % credible interval, dot: median, grey: prior"
    lines.append(_text((LEFT + RIGHT) / 2, bottom + 37, caption, f'text-anchor="middle" fill="{MUTED}"'))
    return "\n".join([*lines, "</svg>"]) + "\n"


def main() -> None:
    """Draw the figure from the record."""
    record = json.loads((ROOT / "docs" / "numbers.json").read_text(encoding="utf-8"))
    FIGURE.write_text(drawn(record), encoding="utf-8")


if __name__ == "__main__":
    main()
