"""Draw the figure at the top of README from `docs/numbers.json`: a bar in a vise, and what tests of it tell.

`python -m benchmarks.readme_figure` draws it, and so does `benchmarks.numbers`. `tests/test_numbers.py` compares.
"""

import json
import math

from benchmarks.quoted import ROOT, Record

FIGURE = ROOT / "docs" / "figures" / "clamp.svg"
CASE = "measured_bar"
#: What each stiffness resists, its unit, and the power of ten of that unit.
ROWS = {
    "k11": ("sideways push", "MN/m", 1e6),
    "k12": ("couples push and turn", "MN", 1e6),
    "k22": ("turning", "kN·m/rad", 1e3),
}
COLOURS = {"identified": "#2b7a55", "weakly identified": "#8a6d00"}
OTHER, TRACK, INK, MUTED = "#c1511b", "#e4e9ee", "#1d2733", "#5b6672"
WIDTH, HEIGHT = 800, 330
LEFT, RIGHT, TOP, ROW = 235, 500, 232, 28
#: Ends of the drawn scale, as multiples of the stiffness that made the data.
SPAN = 0.5, 2.0
_ARROW = (
    '<marker id="a" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto-start-reverse">'
)


def _text(x: float, y: float, text: str, style: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" {style}>{text}</text>'


def _x(ratio: float) -> float:
    """Return the place of a multiple of the true value; beyond the scale its end."""
    low, high = SPAN
    share = math.log(min(max(ratio, low), high) / low) / math.log(high / low)
    return LEFT + (RIGHT - LEFT) * share


def object_() -> list[str]:
    """Return the bar in its vise, with hammer, accelerometers and the three stiffnesses."""
    arrow = f'stroke="{OTHER}" stroke-width="2.5" fill="none"'
    lines = [f'<defs>{_ARROW}<path d="M0 0 8 4 0 8z" fill="{OTHER}"/></marker></defs>']
    lines += [f'<rect x="40" y="{y}" width="110" height="34" fill="#b9c2cb" stroke="{INK}"/>' for y in (58, 116)]
    lines += [
        f'<rect x="48" y="92" width="612" height="24" fill="#f4f6f8" stroke="{INK}"/>',
        _text(95, 80, "vise", 'text-anchor="middle"'),
        _text(250, 109, "steel bar, 383 mm free", f'fill="{MUTED}"'),
        # the joint: where the jaws begin to hold
        f'<path d="M165 52V152" {arrow} marker-start="url(#a)" marker-end="url(#a)"/>',
        _text(174, 50, '<tspan font-weight="bold">k11</tspan> resists moving sideways, N/m'),
        f'<path d="M192 146A44 44 0 0 0 192 62" {arrow} marker-start="url(#a)" marker-end="url(#a)"/>',
        _text(216, 148, '<tspan font-weight="bold">k22</tspan> resists turning, N·m/rad'),
        _text(174, 172, '<tspan font-weight="bold">k12</tspan> couples both: pushed sideways, the bar also turns, N'),
    ]
    for x, words in ((404, "accelerometer"), (648, "accelerometer")):
        lines.append(f'<rect x="{x - 6}" y="80" width="12" height="12" fill="{INK}"/>')
        lines.append(_text(x, 72, words, f'text-anchor="middle" fill="{MUTED}"'))
    lines.append(f'<path d="M648 152V120" stroke="{INK}" stroke-width="2.5"/><path d="M641 130 648 117 655 130z"/>')
    lines.append(_text(648, 168, "hammer", f'text-anchor="middle" fill="{MUTED}"'))
    return lines


def drawn(record: Record) -> str:
    """Return the figure as SVG."""
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
        f'font-family="Helvetica, Arial, sans-serif" font-size="13" fill="{INK}">',
        "<title>A bar in a vise, its three stiffnesses, and their 95 % intervals from measured files</title>",
        '<rect width="100%" height="100%" fill="white"/>',
        *object_(),
        _text(40, 212, "Found, with 95 % intervals:", 'font-weight="bold"'),
    ]
    for number, (name, (words, unit, power)) in enumerate(ROWS.items()):
        entry, y = record["cases"][CASE][name], TOP + number * ROW
        colour, truth = COLOURS.get(entry["verdict"], OTHER), entry["reference"]
        low, high = (_x(entry[end] / truth) for end in ("low", "high"))
        limit = entry.get("limit")
        side = "above" if entry["verdict"] == "bounded below" else "below"
        ends = f"{side} {limit / power:.3g}" if limit else f"{entry['low'] / power:.3g} to {entry['high'] / power:.3g}"
        lines += [
            _text(40, y + 4, f'<tspan font-weight="bold">{name}</tspan>  {words}'),
            f'<path d="M{LEFT} {y}H{RIGHT}" stroke="{TRACK}" stroke-width="12"/>',
            f'<path d="M{low:.1f} {y}H{max(high, low + 3):.1f}" stroke="{colour}" stroke-width="8"/>',
            f'<path d="M{_x(1):.1f} {y - 10}v20" stroke="{INK}" stroke-dasharray="3 2"/>',
            _text(RIGHT + 14, y + 4, f"{ends} {unit}: {entry['verdict']}", f'fill="{colour}"'),
        ]
    below = TOP + len(ROWS) * ROW - 2
    lines.append(_text(_x(1), below, "what made the files", f'text-anchor="middle" fill="{MUTED}" font-size="12"'))
    return "\n".join([*lines, "</svg>"]) + "\n"


def main() -> None:
    """Draw the figure from the record."""
    record = json.loads((ROOT / "docs" / "numbers.json").read_text(encoding="utf-8"))
    FIGURE.write_text(drawn(record), encoding="utf-8")


if __name__ == "__main__":
    main()
