"""Sketch of the structure of a case: bodies to scale, joints, forces and sensors where the case file has them."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from jointbayes.inference import Problem
from jointbayes.joint import Joint
from jointbayes.measurement import FrfData
from jointbayes.report.canvas import svg
from jointbayes.report.model import SERIES_COLOURS
from jointbayes.structure import FrameBody, Member, Section
from jointbayes.structure.beam_recipe import BeamRecipe
from jointbayes.structure.frame_recipe import FrameRecipe

Array = NDArray[np.float64]
_BLUE, _ORANGE, _GREEN = SERIES_COLOURS[:3]
_GREY = "#5b6672"
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
#: How much of the third axis goes to the right and up.
_OBLIQUE = np.array([[1.0, 0.0], [0.0, 1.0], [0.45, 0.3]])
_WIDTH, _LEAST, _MOST = 7.4, 1.7, 4.2  # inches


def sketch(case: jb.Case) -> str:
    """SVG of the structure, of the first set-up where there are several."""
    part = case.problem.parts[0]
    places = _Places(part)
    shapes = list(_shapes(part, places))
    marks = [*places.joints(), *places.sensors()]
    every = np.concatenate([*(shape for shape, _ in shapes), [xy for _, xy, *_ in marks]])
    low, high = every.min(axis=0), every.max(axis=0)
    size = float((high - low).max())
    low, high = low - 0.09 * size, high + 0.09 * size
    height = float(np.clip(_WIDTH * (high - low)[1] / (high - low)[0], _LEAST, _MOST))

    def draw(canvas: Any) -> None:
        axes = canvas.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.set_aspect("equal")
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        for outline, text in shapes:
            axes.fill(*outline.T, fc="#c9d3dd", ec=_GREY, lw=0.8, alpha=0.8)
            if text:
                axes.annotate(text, outline.mean(axis=0), ha="center", va="center", fontsize=8, color=_GREY)
        for kind, place, text, *way in marks:
            _mark(axes, kind, place, text, way, 0.06 * size)

    return svg(draw, _WIDTH, height)


def _mark(axes: Any, kind: str, place: Array, text: str, way: Sequence[Array], size: float) -> None:
    """One joint, force or sensor with its name."""
    colour = {"joint": _ORANGE, "force": _BLUE, "sensor": _GREEN}[kind]
    along = way[0] if way else np.zeros(2)
    if kind == "joint":
        if way:
            axes.plot(*np.transpose(way), color=colour, lw=1.2, zorder=0)
        axes.plot(*place, "s", ms=6, mfc="none", mec=colour, mew=1.6)
        axes.annotate(text, place, xytext=(0, 13), textcoords="offset points", ha="center", fontsize=8, color=colour)
        return
    tail = place - (1.25 if kind == "force" else -1.25) * size * along
    ends = (place, tail) if kind == "force" else (tail, place)
    axes.annotate("", ends[0], xytext=ends[1], arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.2})
    style = {"textcoords": "offset points", "ha": "center", "va": "center", "fontsize": 8, "color": colour}
    axes.annotate(text, tail, xytext=tuple((-9 if kind == "force" else 9) * along), **style)


class _Places:
    """Where DOFs are on paper: by their positions, or one beside the other where these are not known."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._structure = problem.test.structures
        self._order = {dof.partition(":")[0]: i for i, dof in enumerate(self._structure.labels)}
        self.known = all(self._structure.position(dof) is not None for dof in self._structure.labels[:1])

    def joints(self) -> Iterator[tuple[Any, ...]]:
        """Each joint, at its own point, or between the masses that it connects."""
        for joint in _each(self.problem.test.joints):
            sides = [self.at(labels[0], offset) for labels, offset in _sides(joint)]
            there = [side for side in sides if side is not None]
            if self.known:
                yield "joint", there[0], joint.name or "joint"
                continue
            # masses in a row: a spring between the two, or before the first
            ends = there if len(there) > 1 else [there[0], there[0] - [1.0, 0.0]]
            yield "joint", np.mean(ends, axis=0), joint.name or "joint", *ends

    def sensors(self) -> Iterator[tuple[Any, ...]]:
        """Forces and measured motions of FRFs."""
        measured = self.problem.test.data
        if not isinstance(measured, FrfData):
            return
        for kind, labels in (("force", measured.frf.inputs), ("sensor", measured.frf.outputs)):
            for label in labels:
                place, direction = self.at(label), label.rpartition(":")[2]
                if place is not None and direction in _AXES:
                    yield kind, place, label, np.array(_AXES[direction]) @ _OBLIQUE

    def at(self, label: str, offset: Iterable[float] = (0.0, 0.0, 0.0)) -> Array | None:
        """A DOF's place on paper; None of a body without a model."""
        point = label.partition(":")[0]
        if not self.known:
            return np.array([float(self._order[point]), 0.0]) if point in self._order else None
        place = self._structure.position(label)
        return None if place is None else (np.array(place) + list(offset)) @ _OBLIQUE


def _each(joints: Any) -> tuple[Joint, ...]:
    return tuple(getattr(joints, "joints", (joints,)))


def _sides(joint: Joint) -> list[tuple[tuple[str, ...], tuple[float, float, float]]]:
    nothing = (0.0, 0.0, 0.0)
    sides = [(joint.dofs, joint.offset_m or nothing)]
    return [*sides, (joint.against, joint.offset_against_m or nothing)] if joint.against else sides


def _shapes(problem: Problem, places: _Places) -> Iterator[tuple[Array, str]]:
    """Outlines on paper, each with what is written in it."""
    recipe = problem.test.structures.recipe
    if isinstance(recipe, FrameRecipe):
        for name, body in recipe.bodies:
            for i, member in enumerate(body.members):
                outlines = list(_outlines(body, member))
                texts = [""] * len(outlines)
                texts[len(outlines) // 2] = name if i == 0 else ""
                yield from zip(outlines, texts, strict=True)
    elif isinstance(recipe, BeamRecipe):
        half = _height(recipe.section) / 2
        yield np.array([[0, -half], [recipe.length, -half], [recipe.length, half], [0, half]]), ""
    elif places.known:
        return
    else:
        box = np.array([[-0.2, -0.15], [0.2, -0.15], [0.2, 0.15], [-0.2, 0.15]])
        for place, name in enumerate(problem.test.structures.labels):
            yield box + np.array([place, 0.0]), name
        yield box * [0.1, 2.0] - [1.0, 0.0], ""


def _outlines(body: FrameBody, member: Member) -> Iterator[Array]:
    """Each stretch of a member with its section's height, as it is seen."""
    for one, other in pairwise(body.stations(member)):
        along = np.subtract(other.place, one.place)
        up = member.axes(along)[1]
        ends = [np.array(end.place) for end in (one, other)]
        halves = [_height_at(member, end.share) / 2 * up for end in (one, other)]
        corners = [ends[0] - halves[0], ends[1] - halves[1], ends[1] + halves[1], ends[0] + halves[0]]
        yield np.array(corners) @ _OBLIQUE


def _height_at(member: Member, share: float) -> float:
    first = _height(member.section)
    return first if member.end_section is None else (1 - share) * first + share * _height(member.end_section)


def _height(section: Section) -> float:
    """Height of a section as its constructor was given it, m; of a tube the outer diameter."""
    return section.dimensions[1] if section.shape in ("rectangle", "box") else section.dimensions[0]
