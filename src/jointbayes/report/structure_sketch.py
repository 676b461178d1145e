"""The structure of a test drawn to scale: bodies, joints, sensors and forces where the problem has them; and its modes.

Modes are lines that bend: where members lie, and how each of their points moves.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Annotation

from jointbayes.frf import AssembledShapes
from jointbayes.identification import MapEstimate
from jointbayes.inference import Problem, Test
from jointbayes.joint import DIRECTIONS, Joint
from jointbayes.report.canvas import svg
from jointbayes.report.model import SERIES_COLOURS, Wireframe
from jointbayes.structure import FrameBody, Member, Section
from jointbayes.structure.frame_recipe import BeamRecipe, FrameRecipe
from jointbayes.structure.imported.imported_body import ImportedRecipe
from vibrecords.arrays import Array

Kind = Literal["joint", "force", "sensor"]
_COLOURS: dict[Kind, str] = {"force": SERIES_COLOURS[0], "joint": SERIES_COLOURS[1], "sensor": SERIES_COLOURS[2]}
_GREY = "#5b6672"
#: A place (x, y, z) on paper: how much of the third axis goes to the right and up.
_OBLIQUE = np.array([[1.0, 0.0], [0.0, 1.0], [0.45, 0.3]])
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_WIDTH, _LEAST, _MOST = 3.4, 0.9, 2.2  # inches, of one test
_FOOT = 0.2  # inches below all, for the key
_LABEL = 0.25  # inches above the highest arrow, for its name
_MOST_MASSES = 20  # in a row
_WAYS = {"x": "axial", "y": "vertical", "z": "sideways", "rx": "twist", "ry": "turning", "rz": "turning"}
_MOST_NAMED = 8  # joints, sensors or forces: of more none is named
#: Points of all lines together, and at most on one stretch between points of the structure.
_POINTS, _ON_A_STRETCH = 240, 9
_SWING = 0.15  # of the structure's size, as it is drawn

_End = tuple[str, Array, Array]
"""Of a straight stretch: the point of the structure that it moves with, its place and its offset from there, (3,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """A joint, a force or a sensor on paper: its place (2,), and its direction (2,).

    Of a spring the two ends stand for a direction; a rotation has none. A joint to ground has the way to it, (2,).
    """

    kind: Kind
    place: Array
    text: str
    way: tuple[Array, ...] = ()
    ground: tuple[Array, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Drawing:
    """What is drawn of one test, the corners of its paper, and how high that is in inches."""

    name: str
    outlines: list[tuple[Array, str]]
    marks: list[Mark]
    low: Array
    high: Array
    height: float
    to_scale: bool


def sketch(*problems: Problem) -> str:
    """SVG of the structure of each test with what acts on it; empty where it is not known what any looks like."""
    drawings = [drawing for problem in problems if (drawing := _drawing(problem)) is not None]
    total = _FOOT + sum(drawing.height for drawing in drawings)

    def draw(canvas: Canvas) -> None:
        top = total
        for drawing in drawings:
            top -= drawing.height
            axes = canvas.add_axes((0, top / total, 1, drawing.height / total))
            _draw_test(axes, drawing)
            if len(drawings) > 1:
                axes.annotate(drawing.name, (0.02, 0.98), xycoords="axes fraction", va="top", fontsize=8, color=_GREY)
        kinds = dict.fromkeys(mark.kind for drawing in drawings for mark in drawing.marks)
        for i, kind in enumerate(kinds):
            key = {"joint": "□ joint", "force": "→ force", "sensor": "→ response"}[kind]
            canvas.text(0.98 - 0.22 * i, 0.05 / total, key, ha="right", va="bottom", fontsize=8, color=_COLOURS[kind])

    return svg(draw, _WIDTH, total) if drawings else ""


def _drawing(problem: Problem) -> _Drawing | None:
    places = _Places(problem)
    outlines = list(_outlines(problem, places))
    if not outlines:
        return None
    marks = [*places.joints(), *places.sensors()]
    every = np.concatenate([*(outline for outline, _ in outlines), *([m.place[None] for m in marks])])
    low, high = every.min(axis=0), every.max(axis=0)
    size, half = float((high - low).max()), (high - low) / 2
    if places.to_scale:  # ground is away from what it holds
        for i, mark in enumerate(marks):
            if mark.ground:  # along an axis of the paper, away from the middle, of a corner downwards
                away = np.divide(mark.place - low - half, half, out=np.zeros(2), where=half > 0)  # 0 across a line
                axis = int(abs(away[1]) >= min(abs(away[0]), 0.9))
                marks[i] = replace(mark, ground=(np.eye(2)[axis] * (np.sign(away[axis]) or 1.0),))
    sides = 0.14 if len(outlines) == 1 else 0.26  # next to a frame there is room for names
    low, high = low - np.array([sides, 0.2]) * size, high + np.array([sides, 0.12]) * size
    height = float(np.clip(_WIDTH * (high - low)[1] / (high - low)[0], _LEAST, _MOST))
    high[1] += (high - low)[1] * _LABEL / height
    return _Drawing(problem.test.name, outlines, marks, low, high, height, places.to_scale)


def _draw_test(axes: Axes, drawing: _Drawing) -> None:
    size = float((drawing.high - drawing.low).max()) / (1.28 if len(drawing.outlines) == 1 else 1.5)
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set_xlim(drawing.low[0], drawing.high[0])
    axes.set_ylim(drawing.low[1], drawing.high[1])
    for outline, name in drawing.outlines:
        axes.fill(*outline.T, fc="#c9d3dd", ec=_GREY, lw=0.8, alpha=0.8)
        if name:
            axes.annotate(name, outline.mean(axis=0), ha="center", va="center", fontsize=8, color=_GREY)
    for mark in drawing.marks:
        _draw_mark(axes, mark, 0.08 * size)
    if drawing.to_scale:
        # a bar of a round length, about a fifth of the structure's
        power = 10.0 ** np.floor(np.log10(size / 5))
        length = power * max(step for step in (1, 2, 5) if step * power <= size / 5)
        x, y = drawing.low + np.array([0.2, 0.02]) * size  # not below the name of a joint at the left end
        axes.plot([x, x + length], [y, y], color=_GREY, lw=2, solid_capstyle="butt")
        axes.annotate(f"{1e3 * length:g} mm", (x + length, y), xytext=(4, 0), **(_style(_GREY) | {"ha": "left"}))
    # Move each label that lies on an earlier one, or on a wall, to the first place around its point that is free
    axes.apply_aspect()
    points, taken = 72 / axes.figure.dpi, []  # middle and half size of each wall and label, points
    low, high = np.array([axes.bbox.y0, axes.bbox.y1]) * points
    for place, out in ((mark.place, out) for mark in drawing.marks for out in mark.ground if out[1]):
        ends = [place + 0.08 * size * (far * out + side * out[::-1]) for far in (0.9, 1.2) for side in (-1, 1)]
        box = axes.transData.transform(np.array(ends)) * points
        taken.append((box.mean(axis=0), np.ptp(box, axis=0) / 2))
    for label in (text for text in axes.texts if isinstance(text, Annotation) and text.get_text()):
        at = axes.transData.transform(label.xy) * points
        half = np.array([0.3 * len(label.get_text()), 0.6]) * label.get_fontsize()
        aside = {"left": half[0], "right": -half[0]}.get(label.get_horizontalalignment(), 0.0)
        if label.anncoords != "offset points":  # the name of a body stays inside it
            taken.append((at, half))
            continue
        x, y = label.xyann
        for offset in ((x, y), *((x, y + step) for step in (10, 20, -10, -20, 30, -30)), (-x, -y)):
            middle = at + offset + [aside, 0.0]
            inside = low <= middle[1] <= high - half[1]
            if inside and all((np.abs(middle - other) >= half + size).any() for other, size in taken):
                label.xyann = offset
                break
        else:
            middle = at + np.array([x + aside, y])
        taken.append((middle, half))


def _draw_mark(axes: Axes, mark: Mark, size: float) -> None:
    style, (x, y) = _style(_COLOURS[mark.kind]), mark.place.tolist()
    if mark.kind == "joint":
        if mark.way:
            axes.plot(*np.transpose(mark.way), color=_COLOURS["joint"], lw=1.2, zorder=0)
        if mark.ground:
            # a wall with hatches behind it, across the way to it, and a spring up to it
            out = mark.ground[0]
            along, wall = out[::-1], mark.place + 0.9 * size * out
            steps = np.array([0, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 1.0])[:, None]
            turns = along * np.array([0, 0, 1, -1, 1, -1, 0, 0])[:, None]
            spring = mark.place + steps * (wall - mark.place) + 0.2 * size * turns
            axes.plot(*spring.T, color=_COLOURS["joint"], lw=1.1)
            ends = np.transpose([wall - size * along, wall + size * along])
            axes.plot(*ends, color=_GREY, lw=1.6, solid_capstyle="butt")
            for share in np.linspace(-1, 0.75, 8):
                foot = wall + share * size * along
                axes.plot(*np.transpose([foot, foot + 0.3 * size * (out + along)]), color=_GREY, lw=0.7)
        axes.plot(x, y, "s", ms=7, mfc="none", mec=_COLOURS["joint"], mew=1.8)
        below = bool(mark.ground) and bool(mark.ground[0][1])  # there is its ground
        axes.annotate(mark.text, (x, y), xytext=(-11, 4) if below else (0, -14), **style)
        return
    if not mark.way:  # a rotation or a moment
        axes.plot(x, y, "o", ms=13, mfc="none", mec=_COLOURS[mark.kind], mew=1.4)
        axes.annotate(mark.text, (x, y), xytext=(0, 14), **style)
        return
    along = -mark.way[0] if mark.kind == "force" else mark.way[0]  # from the point outwards
    outer = (x + 1.25 * size * along[0], y + 1.25 * size * along[1])
    start, end = (outer, (x, y)) if mark.kind == "force" else ((x, y), outer)
    axes.annotate("", end, xytext=start, arrowprops={"arrowstyle": "-|>", "color": _COLOURS[mark.kind], "lw": 1.4})
    if abs(along[0]) > abs(along[1]):
        style["ha"] = "left" if along[0] > 0 else "right"
    axes.annotate(mark.text, outer, xytext=(5 * along[0], 10 * along[1]), **style)


def _style(colour: str) -> dict[str, Any]:
    return {"textcoords": "offset points", "ha": "center", "va": "center", "fontsize": 8, "color": colour}


def dof_words(test: Test, label: str) -> str:
    """A DOF of a beam as people call it, such as "tip, vertical"; of anything else its label."""
    recipe, place = getattr(test.structures, "recipe", None), test.structures.position(label)
    point, _, way = label.rpartition(":")
    if not isinstance(recipe, BeamRecipe) or place is None or way not in _WAYS:
        return label
    held = {dof.rpartition(":")[0] for dof in test.joints.labels}
    at_end = min(place[0], recipe.length - place[0]) < 1e-6 * recipe.length
    where = "joint" if point in held else "tip" if at_end and held else f"{1e3 * place[0]:.4g} mm"
    return f"{where}, {_WAYS[way]}"


class _Places:
    """Where DOFs are on paper: by their positions, or side by side where these are not known."""

    def __init__(self, problem: Problem) -> None:
        self._test, self._body = problem.test, problem.test.structures
        self.order = {dof.partition(":")[0]: i for i, dof in enumerate(self._body.labels)}
        self.to_scale = any(self._body.position(dof) is not None for dof in self._body.labels[:1])

    def joints(self) -> Iterator[Mark]:
        """Each joint, at its own point, or between the masses that it connects."""
        every = self._test.joints.joints
        for joint in every:
            ends = [place for place in self._ends(joint) if place is not None]
            if not ends:
                continue
            if not self.to_scale:  # masses in a row: a spring between the two, or before the first
                ends = ends if len(ends) > 1 else [ends[0], ends[0] - [1.0, 0.0]]
            way = () if self.to_scale else tuple(ends)
            name = (joint.name or "joint") if len(every) <= _MOST_NAMED else ""
            ground = () if joint.against or not self.to_scale else (np.array([-1.0, 0.0]),)
            yield Mark("joint", ends[0] if self.to_scale else np.mean(ends, axis=0), name, way, ground)

    def sensors(self) -> Iterator[Mark]:
        """Forces and measured motions of FRFs."""
        measured = self._test.data.shown_frfs
        if measured is None:
            return
        inputs, outputs = measured.frf.inputs, measured.frf.outputs
        sides: tuple[tuple[Kind, tuple[str, ...]], ...] = (("force", inputs), ("sensor", outputs))
        for kind, labels in sides:
            for label in labels:
                place, direction = self.at(label), label.rpartition(":")[2]
                if place is not None:
                    way = (np.array(_AXES[direction]) @ _OBLIQUE,) if direction in _AXES else ()
                    yield Mark(kind, place, dof_words(self._test, label) if len(labels) <= _MOST_NAMED else "", way)

    def at(self, label: str, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> Array | None:
        """A DOF's place on paper, shape (2,); None of a body without a model."""
        point = label.partition(":")[0]
        if point not in self.order:
            return None
        if not self.to_scale:
            return np.array([float(self.order[point]), 0.0])
        place = self._body.position(label)
        return None if place is None else (np.array(place) + offset) @ _OBLIQUE

    def _ends(self, joint: Joint) -> list[Array | None]:
        nowhere = (0.0, 0.0, 0.0)
        ends = [self.at(joint.dofs[0], joint.offset_m or nowhere)]
        return [*ends, self.at(joint.against[0], joint.offset_against_m or nowhere)] if joint.against else ends


def _outlines(problem: Problem, places: _Places) -> Iterator[tuple[Array, str]]:
    """Outlines on paper, each with what is written in it."""
    recipe = getattr(problem.test.structures, "recipe", None)
    if isinstance(recipe, FrameRecipe):
        for name, body in recipe.bodies:
            for i, member in enumerate(body.members):
                stretches = list(_stretches(body, member))
                named = len(stretches) // 2 if i == 0 else -1
                yield from ((outline, name if n == named else "") for n, outline in enumerate(stretches))
    elif isinstance(recipe, BeamRecipe):
        half = _height(recipe.section) / 2
        yield np.array([[0, -half], [recipe.length, -half], [recipe.length, half], [0, half]]), ""
    elif isinstance(recipe, ImportedRecipe):
        lines = _edges(recipe.corners) if recipe.outline is None else recipe.outline.places[recipe.outline.lines]
        yield from ((ends @ _OBLIQUE, "") for ends in lines)
    elif not places.to_scale and len(places.order) <= _MOST_MASSES:
        box = np.array([[-0.2, -0.15], [0.2, -0.15], [0.2, 0.15], [-0.2, 0.15]])
        for name, place in places.order.items():
            yield box + np.array([float(place), 0.0]), name
        yield box * [0.1, 2.0] - [1.0, 0.0], ""


def _edges(corners: Sequence[Sequence[float]]) -> list[Array]:
    """The twelve edges of a box, each by its two ends, shape (2, 3); none without corners."""
    ends = [np.array(place) for place in product(*zip(*corners, strict=True))]
    return [np.array(pair) for pair in combinations(ends, 2) if np.count_nonzero(pair[0] != pair[1]) == 1]


def _stretches(body: FrameBody, member: Member) -> Iterator[Array]:
    """Each stretch of a member with its section's height, as it is seen."""
    for start, end in pairwise(body.stations(member)):
        up = member.axes(np.subtract(end.place, start.place))[1]
        heights = [_height(section) for section in (member.section, member.end_section or member.section)]
        first, last = (np.interp(station.share, (0.0, 1.0), heights) / 2 * up for station in (start, end))
        at_start, at_end = np.array(start.place), np.array(end.place)
        yield np.array([at_start - first, at_end - last, at_end + last, at_start + first]) @ _OBLIQUE


def _height(section: Section) -> float:
    """Height of a section as its constructor was given it, m; of a tube the outer diameter."""
    return section.dimensions[1] if section.shape in ("rectangle", "box") else section.dimensions[0]


def wireframe(problem: Problem, estimate: MapEstimate, names: Sequence[str]) -> Wireframe | None:
    """Shapes of the lowest modes at the MAP; None of a structure whose geometry or modes are not known.

    Parameters
    ----------
    problem
        Of one test.
    estimate
        The MAP.
    names
        Each mode in words, from the lowest.
    """
    test, recipe = problem.test, getattr(problem.test.structures, "recipe", None)
    if not names or test.most_modes < len(names):
        return None
    matrices = problem.prior.matrix(estimate.theta[None])
    if isinstance(recipe, ImportedRecipe):  # its surface, each edge a straight line
        if recipe.outline is None:
            return None
        outlined, lines = recipe.drawn(), recipe.outline.lines
        dofs = [label for label in outlined.labels if label.startswith("~")]
        shapes = AssembledShapes(outlined, test.joints, len(names), dofs).modes(matrices).shapes[0]
        points, swings = recipe.outline.places[lines], shapes.reshape(len(names), -1, 3)[:, lines]
    else:
        stretches = [ends for along in _members(problem) for ends in pairwise(along)]
        if not stretches:
            return None
        # 1. How each point of the structure moves, at the nominal quantities, which change shapes hardly: what is
        #    uncertain takes a table of modes.
        body, there = test.structures, set(test.structures.labels)
        motions = {point: np.zeros((len(names), 6)) for ends in stretches for point, *_ in ends}
        dofs = [dof for point in motions for direction in DIRECTIONS if (dof := f"{point}:{direction}") in there]
        certain = body.at((*dofs, *test.joints.labels), body.reach_hz(len(names))).certain()
        shapes = AssembledShapes(certain, test.joints, len(names), dofs).modes(matrices).shapes[0]
        for dof, motion in zip(dofs, shapes.T, strict=True):
            point, _, direction = dof.rpartition(":")
            motions[point][:, DIRECTIONS.index(direction)] = motion
        # 2. Each stretch bends as a cubic of value and slope at either end.
        s = np.linspace(0.0, 1.0, max(2, min(_ON_A_STRETCH, _POINTS // len(stretches))))
        cubics = np.stack([1 - 3 * s**2 + 2 * s**3, s - 2 * s**2 + s**3, 3 * s**2 - 2 * s**3, s**3 - s**2])
        places, moved = [], []
        for ends in stretches:
            (_, start, _), (_, end, _) = ends
            values = []
            for point, _, offset in ends:
                shift, turn = motions[point][:, :3], motions[point][:, 3:]
                # an end moves as a rigid body with its point; a cross-section stays across the line, v' = θ × e
                values += [shift + np.cross(turn, offset), np.cross(turn, end - start)]
            places.append(start + s[:, None] * (end - start))
            moved.append(np.einsum("kp,kmd->mpd", cubics, np.array(values)))
        points, swings = np.array(places), np.stack(moved, axis=1)
    # 3. Swings so far that they are seen.
    points, swings = points @ _OBLIQUE, swings @ _OBLIQUE
    largest = np.linalg.norm(swings, axis=3, keepdims=True).max(axis=(1, 2), keepdims=True)
    swings = swings * (_SWING * np.ptp(points, axis=(0, 1)).max() / np.maximum(largest, np.finfo(float).tiny))
    return Wireframe(points, tuple(names), swings)


def _members(problem: Problem) -> Iterator[list[_End]]:
    """Ends of the stretches of each member, one after the other."""
    recipe = getattr(problem.test.structures, "recipe", None)
    if isinstance(recipe, BeamRecipe):
        yield [(point, np.array(place), np.zeros(3)) for point, place in recipe.positions.items()]
    for name, body in recipe.bodies if isinstance(recipe, FrameRecipe) else ():
        for member in body.members:
            stations, prefix = body.stations(member), f"{name}." if name else ""
            yield [(f"{prefix}{s.point}", np.array(s.place), np.array(s.offset)) for s in stations]
