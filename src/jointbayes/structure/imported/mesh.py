"""Where nodes are: a CSV ``node,x,y,z``, ``*NODE`` of Abaqus or CalculiX, GRID of Nastran, NBLOCK of Ansys."""

import csv
import re
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from jointbayes.structure.imported.entries import Exported, direction_of, fault
from vibrecords.arrays import Indices

_NODE = re.compile(r"[0-9]{1,15}")
#: Elements of Abaqus and CalculiX by their names, with the count of their nodes behind the last letter.
_ELEMENT = re.compile(r"(C3D|S|M3D|CPS|CPE|CAX|STRI|T3D|B3)(\d+)")
#: Faces of solids by their corners: hexahedra, tetrahedra, wedges.
_HEX = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
_TET = ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3))
_WEDGE = ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))
_FACES = {8: _HEX, 20: _HEX, 4: _TET, 10: _TET, 6: _WEDGE, 15: _WEDGE}


def read_nodes(path: Path) -> Exported:
    """Nodes, their places and edges of the surface from a file of coordinates.

    Raises
    ------
    ModelError
        If a line is of another kind, a node is told twice, or stands in a system of its own.
    """
    with path.open(encoding="latin-1") as lines:
        marks = (line[:5].upper() for line in lines)
        kind = next((mark for mark in marks if mark in ("*NODE", "GRID ", "GRID*", "GRID,", "NBLOC")), "")
    if kind == "NBLOC":
        return _of_block(path)
    read = _of_cards if kind.startswith("GRID") else _of_keywords if kind else _of_table
    try:
        nodes, places, *edges = read(path)
    except csv.Error as error:
        raise fault(path, f"a table that cannot be read ({error})", "node,x,y,z", "correct it") from None
    _require_once(path, nodes)
    return Exported(nodes=np.array(nodes, dtype=np.intp), places=np.array(places), edges=edges[0] if edges else None)


def read_map(path: Path) -> Indices:
    """Map of the DOFs from a CSV ``node,direction``, a line for each row of K.

    Raises
    ------
    ModelError
        If a line is of another kind.
    """
    pairs = [(node, direction_of(way, where)) for where, node, (way,) in _rows(path, 2)]
    if not pairs:
        raise fault(path, "no DOF", "node,direction", "give a line for each row of K")
    return np.array(pairs, dtype=np.intp)


def _rows(path: Path, count: int) -> Iterator[tuple[str, int, list[str]]]:
    """Place, number of the node and other fields of each line of a table below its title."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as lines:
        text = lines.readline(1000)
        lines.seek(0)
        delimiter = next((sign for sign in ";\t," if sign in text), ",")
        for number, cells in enumerate(csv.reader(lines, delimiter=delimiter), 1):
            words = [cell.strip() for cell in cells]
            if not any(words) or words[0].startswith("#") or (number == 1 and not _NODE.fullmatch(words[0])):
                continue
            where = f"{path}, line {number}"
            if len(words) != count or not _NODE.fullmatch(words[0]):
                titles = "node,direction" if count == 2 else "node,x,y,z"
                raise fault(where, repr(delimiter.join(words)[:40]), titles, "correct the line")
            yield where, int(words[0]), words[1:]


def _number(word: str, where: str) -> float:
    try:
        value = float(word or 0)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise fault(where, repr(word[:20]), "a coordinate", "correct it")
    return value


def _of_table(path: Path) -> tuple[list[int], list[list[float]]]:
    rows = list(_rows(path, 4))
    return [node for _, node, _ in rows], [[_number(word, where) for word in place] for where, _, place in rows]


def _of_cards(path: Path) -> tuple[list[int], list[list[float]]]:
    """Of GRID cards in small, large or free fields, whose systems are the basic one."""
    nodes, places = [], []
    with path.open(encoding="latin-1") as lines:
        for number, line in enumerate(lines, 1):
            if line[:5] not in ("GRID ", "GRID*", "GRID,"):
                continue
            where, line = f"{path}, line {number}", line.rstrip("\r\n")
            if line[4] == "*":
                line = line.ljust(72)[:72] + next(lines, "").rstrip("\r\n")[8:]
            width = 16 if line[4] == "*" else 8
            fields = line.split(",")[1:] if "," in line else [line[8 + i * width :][:width] for i in range(6)]
            node, system, *place, output = [field.strip() for field in [*fields, *[""] * 6][:6]]
            if not _NODE.fullmatch(node) or system not in ("", "0") or output not in ("", "0"):
                found = f"grid {node[:16]!r} in system {system or output!r}"
                raise fault(where, found, "a number, and the basic system", "leave fields CP and CD empty")
            nodes.append(int(node))
            words = (word.upper().replace("D", "E") for word in place)  # 1.5-3 is 1.5E-3
            places.append([_number(re.sub(r"(?<=[\d.])E?([+-])", r"E\1", word), where) for word in words])
    return nodes, places


def _of_block(path: Path) -> Exported:
    """Of NBLOCK of a ``.cdb``: nodes, places, and the axes of nodes that are turned by THXY, THYZ and THZX."""
    nodes, numbers, form = [], [], None
    with path.open(encoding="latin-1") as lines:
        for number, line in enumerate(lines, 1):
            where = f"{path}, line {number}"
            if line[:6].upper() == "NBLOCK":
                form = re.fullmatch(r"\((\d)i(\d+),\d[eg](\d+)\.\d+(?:e\d)?\)", next(lines, "").strip().lower())
                if form is None:
                    raise fault(where, "no format such as (3i9,6e21.13e3) below it", "one", "write it with CDWRITE")
            elif form is not None and re.match(r"\s*(N,|-1\b)", line):
                form = None
            elif form is not None:
                count, narrow, wide = map(int, form.groups())
                start = count * narrow
                words = [
                    line[:narrow].strip(),
                    *(line[at : at + wide].strip() for at in range(start, start + 6 * wide, wide)),
                ]
                if not _NODE.fullmatch(words[0]):
                    raise fault(where, repr(line.strip()[:40]), "a node and its place", "write it with CDWRITE")
                nodes.append(int(words[0]))
                numbers.append([_number(word, where) for word in words[1:]])
    _require_once(path, nodes)
    table = np.array(numbers)
    axes = {}
    for node, row in zip(nodes, table, strict=True):
        if row[3:].any():  # turned about z, then about its new x, then about its new y
            (cz, cx, cy), (sz, sx, sy) = (wave(np.deg2rad(row[3:])) for wave in (np.cos, np.sin))
            z, x = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]), np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
            axes[node] = z @ x @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return Exported(nodes=np.array(nodes, dtype=np.intp), places=table[:, :3], axes=axes)


def _require_once(path: Path, nodes: list[int]) -> None:
    if not nodes:
        raise fault(path, "no node", "node,x,y,z", "give the file that has the coordinates")
    numbers, counts = np.unique(nodes, return_counts=True)
    if counts.max() > 1:
        remedy = "give the flat input file, not parts with instances"
        raise fault(path, f"node {numbers[counts.argmax()]} {counts.max()} times", "each node once", remedy)


def _of_keywords(path: Path) -> tuple[list[int], list[list[float]], Indices | None]:
    """Of the blocks ``*NODE`` and ``*ELEMENT``; an element may go on over lines."""
    nodes: list[int] = []
    places: list[list[float]] = []
    blocks: list[tuple[str, list[int]]] = []
    keyword = ""
    with path.open(encoding="latin-1") as lines:
        for number, line in enumerate(lines, 1):
            where, text = f"{path}, line {number}", line.strip()
            if text.startswith("*"):
                keyword, *options = [word.strip().upper() for word in text.split(",")]
                if keyword == "*NODE" and any(re.match(r"SYSTEM\s*=\s*[^R]", option) for option in options):
                    raise fault(where, repr(text[:40]), "rectangular coordinates", "write the nodes in these")
                if keyword == "*ELEMENT":
                    kinds = [word.partition("=")[2].strip() for word in options if word.startswith("TYPE")]
                    blocks.append(((kinds or [""])[0], []))
            elif text and keyword == "*NODE":
                words = [word.strip() for word in text.split(",")]
                if not _NODE.fullmatch(words[0]):
                    raise fault(where, repr(text[:40]), "node, x, y, z", "correct the line")
                nodes.append(int(words[0]))
                places.append([_number(word, where) for word in [*words[1:4], "", "", ""][:3]])
            elif text and keyword == "*ELEMENT":
                words = [word.strip() for word in text.split(",") if word.strip()]
                if not all(map(_NODE.fullmatch, words)):
                    raise fault(where, repr(text[:40]), "numbers of an element and its nodes", "correct the line")
                blocks[-1][1].extend(map(int, words))
    # Edges of faces that belong to one element only, shells and lines
    faces: dict[tuple[int, ...], tuple[int, ...]] = {}
    count: Counter[tuple[int, ...]] = Counter()
    edges: set[tuple[int, int]] = set()
    for kind, numbers in blocks:
        family, digits = found.groups() if (found := _ELEMENT.match(kind)) else ("", "0")
        size = int(digits[0]) + 1 if family == "B3" else int(digits)
        if size < 2 or len(numbers) % (size + 1):
            continue  # of another kind, such as springs
        shapes = _FACES.get(size, ()) if family == "C3D" else (range(3 if size in (3, 6) else 4),)
        for element in np.array(numbers, dtype=np.intp).reshape(-1, size + 1)[:, 1:].tolist():
            if family in ("B3", "T3D"):
                edges.add((min(element[0], element[-1]), max(element[0], element[-1])))
                continue
            for shape in shapes:
                face = tuple(element[i] for i in shape)
                faces[tuple(sorted(face))] = face
                count[tuple(sorted(face))] += 1
    for key, face in faces.items():
        if count[key] == 1:
            edges |= {(min(pair), max(pair)) for pair in pairwise((*face, face[0]))}
    return nodes, places, (np.array(sorted(edges), dtype=np.intp).reshape(-1, 2) if edges else None)
