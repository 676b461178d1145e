"""The house in one picture: rooms, their lines and who imports whom, drawn from the sources.

A hook of MkDocs, so that the page is that of the sources it is built from: what stands between two comments,
``<!--house-->`` and ``<!--/house-->``, is replaced while the site is built. `python -m benchmarks.house` prints it.
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


def on_page_markdown(markdown: str, **_: Any) -> str:
    """A page with the picture in its place; called by MkDocs with every page."""
    before, marked, rest = markdown.partition(OPEN)
    return before + chapter() + rest.partition(CLOSE)[2] if marked else markdown


if __name__ == "__main__":
    print(chapter())
