"""The house in one picture, rooms and who imports whom, and the way of a run in another, drawn from the sources.

A hook of MkDocs, so that a page is that of the sources it is built from: what stands between two comments,
``<!--house-->`` and ``<!--/house-->``, or ``<!--way-->`` and ``<!--/way-->``, is replaced while the site is built.
`python -m benchmarks.house` prints both.
Floors are those of the contract in `pyproject.toml`, a room's sentence is the first of its docstring, its lines are
counted without blanks, comments and docstrings, and an arrow stands for an import that no other arrows lead to.
"""

import ast
import sys
import tomllib
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # MkDocs loads this file by its path

from benchmarks.chains import longest_chain  # noqa: E402
from benchmarks.size import code_lines  # noqa: E402

OPEN, CLOSE = "<!--house-->", "<!--/house-->"
WAY_OPEN, WAY_CLOSE = "<!--way-->", "<!--/way-->"
#: Steps of a run: what comes out of each, and the function that makes it, which must stand in that file.
STEPS = (
    ("FRFs, modes, records", "vibrecords/formats/read.py", "read_frf"),
    ("case", "jointbayes/case/case.py", "load_case"),
    ("problem: tests, prior", "jointbayes/inference/problem.py", "Problem"),
    ("premises", "jointbayes/posterior/decision.py", "decide"),
    ("mode (MAP)", "jointbayes/workflow.py", "find_map"),
    ("draws", "jointbayes/workflow.py", "sample"),
    ("intervals, verdicts", "jointbayes/posterior/verdicts.py", "judge_stiffness"),
    ("report, summary", "jointbayes/report/run_directory.py", "write_report"),
)
READERS = "vibrecords"
_WIDTH, _ROW, _HEIGHT, _GAP = 900, 68, 44, 24
_STYLE = "font-family: sans-serif; fill: currentColor; text-anchor: middle"


@dataclass(frozen=True)
class Room:
    """A package or module that stands on a floor, counted from below, with the rooms that it imports."""

    name: str
    floor: int
    sentence: str
    files: int
    lines: int
    imports: frozenset[str]


def rooms(source: Path = ROOT / "src") -> list[Room]:
    """All rooms, the lowest floor first; the readers stand below all others."""
    settings = tomllib.loads((source.parent / "pyproject.toml").read_text(encoding="utf-8"))
    (floors,) = (c["layers"] for c in settings["tool"]["importlinter"]["contracts"] if c["id"] == "floors")
    stands = {name: floor for floor, row in enumerate(reversed(floors), 1) for name in row.split(" | ")}
    del stands["__main__"]
    return [_room(source / READERS, 0), *(_room(source / "jointbayes" / name, at) for name, at in stands.items())]


def _room(place: Path, floor: int) -> Room:
    files = sorted(place.rglob("*.py")) if place.is_dir() else [place.with_suffix(".py")]
    first = place / "__init__.py" if place.is_dir() else files[0]
    sources = [path.read_text(encoding="utf-8") for path in files]
    sentence = (ast.get_docstring(ast.parse(first.read_text(encoding="utf-8"))) or "").split("\n\n")[0]
    imported = frozenset[str]().union(*map(_imported, sources)) - {place.name}
    return Room(place.name, floor, " ".join(sentence.split()), len(files), sum(map(code_lines, sources)), imported)


def _imported(source: str) -> frozenset[str]:
    """Rooms that a module imports anywhere, within functions and for types too."""
    names = [
        name
        for node in ast.walk(ast.parse(source))
        for name in ([node.module] if isinstance(node, ast.ImportFrom) and node.module else
                     [alias.name for alias in node.names] if isinstance(node, ast.Import) else [])
    ]  # fmt: skip
    parts = [name.split(".") for name in names]
    own = {part[1] for part in parts if part[0] == "jointbayes" and len(part) > 1}
    return frozenset(own | {READERS for part in parts if part[0] == READERS})


def arrows(house: list[Room]) -> set[tuple[str, str]]:
    """Imports between rooms, without those that follow from others."""
    known = {room.name: room.imports & {other.name for other in house} for room in house}

    def below(name: str) -> set[str]:
        return set(known[name]).union(*map(below, known[name]))

    return {
        (name, direct)
        for name, imports in known.items()
        for direct in imports
        if not any(direct in below(other) for other in imports - {direct})
    }


def picture(house: list[Room]) -> str:
    """The house as SVG: a box a room, floor over floor, an arrow down to each room that it imports."""
    top = max(room.floor for room in house)
    place: dict[str, tuple[float, float, float]] = {}  # middle, upper edge, width
    for floor in range(top + 1):
        row = [room for room in house if room.floor == floor]
        width = (_WIDTH - _GAP) if floor == 0 else min(190.0, (_WIDTH - _GAP) / len(row) - _GAP)
        for i, room in enumerate(row):
            place[room.name] = (_WIDTH * (i + 1) / (len(row) + 1), _GAP + (top - floor) * _ROW, width)
    parts = [
        f'<path d="M{place[a][0]:.0f} {place[a][1] + _HEIGHT} L{place[b][0]:.0f} {place[b][1]}" fill="none" '
        'stroke="currentColor" stroke-opacity="0.35"/>'
        for a, b in sorted(arrows(house))
    ]
    for room in house:
        x, y, width = place[room.name]
        parts.append(
            f'<g><title>{escape(room.sentence)}</title><rect x="{x - width / 2:.0f}" y="{y}" width="{width:.0f}" '
            f'height="{_HEIGHT}" rx="4" fill="var(--md-default-bg-color, white)" stroke="currentColor"/>'
            f'<text x="{x:.0f}" y="{y + 19}" style="{_STYLE}; font-size: 14px">{room.name}</text>'
            f'<text x="{x:.0f}" y="{y + 35}" style="{_STYLE}; font-size: 11px">{room.lines:,} lines</text></g>'
        )
    height = (top + 1) * _ROW + _GAP
    return (
        f'<svg viewBox="0 0 {_WIDTH} {height}" role="img" aria-label="Rooms of the house, floor over floor" '
        f'xmlns="http://www.w3.org/2000/svg">{"".join(parts)}</svg>'
    )


def chapter() -> str:
    """What stands between the two comments: the picture, and a table of the rooms."""
    house = rooms()
    lines = [
        f"| {room.floor} | `{room.name}` | {room.sentence} | {room.files} | {_chain(room.name)} | {room.lines:,} |"
        for room in sorted(house, key=lambda room: -room.floor)
    ]
    total = f"| | | all | {sum(room.files for room in house)} | | {sum(room.lines for room in house):,} |"
    head = ["| Floor | Room | What is in it | Files | Longest chain | Code lines |", "|---|---|---|---|---|---|"]
    return "\n".join([OPEN, "", picture(house), "", *head, *lines, total, "", CLOSE])


def _chain(name: str) -> int:
    """Files of the longest chain of imports inside a room; a module alone is one."""
    if name == READERS:
        return len(longest_chain(name))
    return len(longest_chain(f"jointbayes.{name}")) if (ROOT / "src" / "jointbayes" / name).is_dir() else 1


def way() -> str:
    """The way of a run as SVG: a box a step, with the function that makes it and the file where that stands."""
    columns, width, height = len(STEPS) // 2, 200, 64
    step, parts = _WIDTH / columns, list[str]()
    for i, (made, file, name) in enumerate(STEPS):
        defined = {getattr(node, "name", "") for node in ast.parse((ROOT / "src" / file).read_text("utf-8")).body}
        if name not in defined:
            raise SystemExit(f"the way of a run: found no {name} in src/{file}; change STEPS in benchmarks/house.py")
        x, y = step * (i % columns) + step / 2, _GAP / 2 + (height + 2 * _GAP) * (i // columns)
        parts.append(
            f'<rect x="{x - width / 2:.0f}" y="{y:.0f}" width="{width}" height="{height}" rx="4" fill="none" '
            f'stroke="currentColor"/><text x="{x:.0f}" y="{y + 20:.0f}" style="{_STYLE}; font-size: 14px">{made}</text>'
            f'<text x="{x:.0f}" y="{y + 38:.0f}" style="{_STYLE}; font-size: 12px">{name}</text>'
            f'<text x="{x:.0f}" y="{y + 54:.0f}" style="{_STYLE}; font-size: 10px">{file}</text>'
        )
        if i % columns:
            parts.append(_arrow(x - step + width / 2, y + height / 2, x - width / 2, y + height / 2))
        elif i:
            parts.append(_arrow(_WIDTH - step / 2, y - 2 * _GAP, x, y))
    below = 2 * height + 3 * _GAP
    return (
        f'<svg viewBox="0 0 {_WIDTH} {below}" role="img" aria-label="The way of a run, from file to report" '
        'xmlns="http://www.w3.org/2000/svg"><defs><marker id="tip" markerWidth="8" markerHeight="8" refX="7" refY="4" '
        f'orient="auto"><path d="M0 0 L8 4 L0 8 z" fill="currentColor"/></marker></defs>{"".join(parts)}</svg>'
    )


def _arrow(x: float, y: float, to_x: float, to_y: float) -> str:
    return f'<path d="M{x:.0f} {y:.0f} L{to_x:.0f} {to_y:.0f}" stroke="currentColor" marker-end="url(#tip)"/>'


def on_page_markdown(markdown: str, **_: Any) -> str:
    """A page with the pictures in their places; called by MkDocs with every page."""
    for opened, closed, made in ((OPEN, CLOSE, chapter), (WAY_OPEN, WAY_CLOSE, way)):
        before, marked, rest = markdown.partition(opened)
        markdown = f"{before}{made()}{rest.partition(closed)[2]}" if marked else markdown
    return markdown


if __name__ == "__main__":
    print(chapter(), way(), sep="\n\n")
