"""Modes of a structure with its joints as lines that bend: where members lie, and how each of their points moves."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from jointbayes.frf import AssembledShapes
from jointbayes.identification import MapEstimate
from jointbayes.inference import Problem
from jointbayes.report.line_plot import OBLIQUE, Wireframe
from jointbayes.structure.frame_recipe import BeamRecipe, FrameRecipe
from jointbayes.structure.imported.imported_body import ImportedRecipe
from vibrecords.arrays import Array

#: Points of all lines together, and at most on one stretch between points of the structure.
_POINTS, _ON_A_STRETCH = 240, 9
_SWING = 0.15  # of the structure's size, as it is drawn
_DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")

_End = tuple[str, Array, Array]
"""Of a straight stretch: the point of the structure that it moves with, its place and its offset from there, (3,)."""


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
    recipe = getattr(problem.test.structures, "recipe", None)
    if isinstance(recipe, ImportedRecipe):
        return _of_outline(problem, estimate, names, recipe)
    test, stretches = problem.test, [ends for along in _members(problem) for ends in pairwise(along)]
    if not stretches or not names or test.most_modes < len(names):
        return None
    body, there = test.structures, set(test.structures.labels)
    motions = {point: np.zeros((len(names), 6)) for ends in stretches for point, *_ in ends}
    dofs = [dof for point in motions for direction in _DIRECTIONS if (dof := f"{point}:{direction}") in there]
    # at the nominal quantities, which change shapes hardly: what is uncertain takes a table of modes
    certain = body.at((*dofs, *test.joints.labels), body.reach_hz(len(names))).certain()
    matrices = problem.prior.matrix(estimate.theta[None])
    shapes = AssembledShapes(certain, test.joints, len(names), dofs).modes(matrices).shapes[0]
    for dof, motion in zip(dofs, shapes.T, strict=True):
        point, _, direction = dof.rpartition(":")
        motions[point][:, _DIRECTIONS.index(direction)] = motion
    s = np.linspace(0.0, 1.0, max(2, min(_ON_A_STRETCH, _POINTS // len(stretches))))
    # cubics of value and slope at either end
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
    points, swings = np.array(places) @ OBLIQUE, np.stack(moved, axis=1) @ OBLIQUE
    return _drawn(points, names, swings)


def _of_outline(
    problem: Problem, estimate: MapEstimate, names: Sequence[str], recipe: ImportedRecipe
) -> Wireframe | None:
    """The same of an imported model: its surface, each edge a straight line."""
    test = problem.test
    if recipe.outline is None or not names or test.most_modes < len(names):
        return None
    body, lines = recipe.drawn(), recipe.outline.lines
    dofs = [label for label in body.labels if label.startswith("~")]
    matrices = problem.prior.matrix(estimate.theta[None])
    shapes = AssembledShapes(body, test.joints, len(names), dofs).modes(matrices).shapes[0]
    moved = shapes.reshape(len(names), -1, 3)[:, lines]
    return _drawn(recipe.outline.places[lines] @ OBLIQUE, names, moved @ OBLIQUE)


def _drawn(points: Array, names: Sequence[str], swings: Array) -> Wireframe:
    """Lines (lines, points, 2) and how they move in each mode, so far that it is seen."""
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
