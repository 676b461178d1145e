"""What a clamp's edge and springs to ground that are not in the model do to all modes alike, at one joint.

Both move every mode in a pattern of its own, which the errors of single modes cannot follow: the edge as the length of
the overhang does, a spring where the modes move at it, d ln f = φ²/(2 ω²) per N/m with φ in modes of unit modal mass.
Shapes follow: a spring mixes the modes, and sensors stay where they are on the body when its clamp's edge is elsewhere.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf import AssembledShapes, Modal, held_at
from jointbayes.inference.modal_likelihood import ModePrediction, modal_model
from jointbayes.inference.noise.model_error import ModelErrorNoise
from jointbayes.inference.problem import Problem
from jointbayes.inference.test import Test, own_name
from jointbayes.joint import RIGID, Joint, Joints
from vibrecords import ModalData
from vibrecords.arrays import Array

_PLACES = 12  # of a structure, at which a spring is tried
_STEP = 1e-4  # of the length
_AXES = "xyz"
_SAME = 1e-6  # of eigenvalues: modes so close are turned by anything, not mixed
_MORE = 10  # modes above the highest measured one, of which a spring mixes the shapes
_STRAIGHT = 1e-6  # of its length, that a straight body's points may lie off a line


def with_common_errors(problem: Problem, theta: Array) -> Problem:
    """The problem with what a clamp's edge and unmodelled springs do to its modes, where their errors have a place.

    The edge moves modes as the factor on the length does, of a straight body that a joint holds at its end and whose
    length is uncertain. Several tests of one clamp have one edge, the same in mm. Both are of first order.

    Parameters
    ----------
    problem
        With modes as data, and errors of the model in these.
    theta
        Where its model is differentiated: the best joint that is known, shape (d,).
    """
    parts = [part for part in (*problem.parts, *problem.left_out_parts) if part.test.data.modes is not None]
    parts = [part for part in parts if isinstance(part.test.noise, ModelErrorNoise)]
    clamps = [", ".join(quantity.name for quantity in part.quantities if quantity.places) for part in parts]
    overhangs = [float(np.linalg.norm(_overhang(part.test))) for part in parts]
    noises = {}
    for part, clamp, overhang in zip(parts, clamps, overhangs, strict=True):
        noise = part.test.noise
        assert isinstance(noise, ModelErrorNoise)
        of_clamp = [length for length, other in zip(overhangs, clamps, strict=True) if other == clamp]
        size = noise.sizes.edge * float(np.mean(of_clamp)) / overhang if overhang else 0.0
        # what a change of the overhang by this fraction does to the residuals
        prior, likelihood, length = part.prior, part.log_posterior.likelihood, _length_of(part)
        edges = np.empty((likelihood.n_data, 0))
        if length is not None and size:
            steps = np.repeat(prior.factors(theta[None]), 2, axis=0)
            steps[:, length] *= (1 + _STEP, 1 - _STEP)
            longer, shorter = likelihood.standardised(prior.matrix(np.vstack([theta, theta])), steps)
            of_length = (longer - shorter) / (2 * _STEP)
            edges = (size * (of_length + _of_sensors_left_behind(part, theta)))[:, None]
        noises[id(part.test)] = replace(noise, edges=edges, springs=_springs(part, noise, theta), clamp=clamp)
    tests, left_out = (
        tuple(replace(test, noise=noises.get(id(test), test.noise)) for test in some)
        for some in (problem.tests, problem.left_out)
    )
    return replace(problem, tests=tests, left_out=left_out) if noises else problem


def has_edge(part: Problem) -> bool:
    """Whether the modes of a test have a place for an edge of its clamp that is not where it is modelled."""
    return bool(_overhang(part.test).any()) and _length_of(part) is not None


def _length_of(part: Problem) -> int | None:
    """Place of the length's factor among the factors of a test; None if the length has none."""
    names = [nuisance.name for nuisance in part.prior.nuisances]
    length = own_name(part.test.name, "length", names)
    return None if length is None else names.index(length)


def _overhang(test: Test) -> Array:
    """From the one joint that holds a straight body at its end to its free end, shape (3,), m; 0 of any other body."""
    body = test.structures
    places, held = ([body.position(label) for label in some] for some in (_places(test), test.joints.labels))
    if not held or not places or any(place is None for place in (*places, *held)):
        return np.zeros(3)
    offsets = np.array(places, dtype=float) - np.array(held[0], dtype=float)
    away = np.linalg.norm(offsets, axis=1)
    end, longest = offsets[away.argmax()], float(away.max())
    along = offsets @ end / longest if longest else away
    is_straight = bool((np.abs(along - away) <= _STRAIGHT * longest).all())
    return end if is_straight and len(set(held)) == 1 else np.zeros(3)


def _of_sensors_left_behind(part: Problem, theta: Array) -> Array:
    """What residuals of shapes change relative to those of a longer body, whose sensors are moved in proportion, (m,).

    With another edge they stay as far from the free end as they were: per change of the overhang, as a fraction of it,
    they are further from the edge by their distance from the free end, and move more by that times the slope there.
    """
    test, data = part.test, part.test.data.modes
    assert data is not None
    change = np.zeros(len(data.values))
    dofs, components = _components(data)
    if not components:
        return change
    end = _overhang(test)
    longest = float(np.linalg.norm(end))
    # 1. how far each sensor is from the free end, and the slope there: a sum of rotations, (ω × t)·e
    slopes, from_free_end = [], []
    for label in dofs:
        sensor, root = (test.structures.position(of) for of in (label, test.joints.labels[0]))
        assert sensor is not None
        assert root is not None
        from_free_end.append(longest - float((np.array(sensor) - np.array(root)) @ end) / longest)
        point, _, direction = label.rpartition(":")
        turns = np.cross(np.eye(3), end / longest)[:, _AXES.index(direction)] if direction in _AXES else np.zeros(3)
        terms = {f"{point}:r{axis}": float(t) for axis, t in zip(_AXES, turns, strict=True) if abs(t) > _STRAIGHT}
        slopes.append({turn: factor for turn, factor in terms.items() if turn in test.structures.labels})
    # 2. what both make of each component
    turning = tuple(dict.fromkeys(label for terms in slopes for label in terms))
    stiffness, factors, numbers = _joint_and_numbers(part, theta)
    motions = _modes_at(test, test.joints, int(max(numbers)), (*dofs, *turning), stiffness, factors).shapes[0]
    for row, place, dof, reference in components:
        motion = motions[numbers[place] - 1]
        turned = dict(zip(turning, motion[len(dofs) :], strict=True))
        slope = [sum(factor * turned[turn] for turn, factor in terms.items()) for terms in slopes]
        moved = np.multiply(from_free_end, slope)
        change[row] = _of_ratio(motion, moved, dof, reference) / data.sd[row]
    return change


def _springs(part: Problem, noise: ModelErrorNoise, theta: Array) -> Array:
    """What springs do to the residuals that move the lowest mode, together, by its value, shape (m, places)."""
    data, test = part.test.data.modes, part.test
    assert data is not None
    places = _places(test)
    if not noise.sizes.spring or not places:
        return np.empty((len(data.values), 0))
    stiffness, factors, numbers = _joint_and_numbers(part, theta)
    of_mode = dict(zip(map(str, data.numbers), numbers.tolist(), strict=True))
    change = np.zeros((len(data.values), len(places)))
    free = _relative_effect(test, test.joints, stiffness, factors, places, max(numbers))
    for row, name in enumerate(data.value_names):
        kind, number, *of = name.split()
        if kind in ("frequency", "eigenvalue"):
            change[row] = free[of_mode[number] - 1] * noise.relative[row]
        elif kind == "zero":
            rigid = np.pad(stiffness, ((0, 0), (0, 1), (0, 1)))
            rigid[:, -1, -1] = RIGID
            held, last = held_at(test.joints, of[-1]), int(number)
            effect = _relative_effect(test, held, rigid, factors, places, last)[last - 1]
            change[row] = effect * noise.relative[row]
    # it mixes the modes: δφ = Σ φₛ φₛ(p) φ(p)/(λ − λₛ) over the other elastic ones
    dofs, components = _components(data)
    if components:
        count = min(int(max(numbers)) + _MORE, test.most_modes)
        modal = _modes_at(test, test.joints, count, (*dofs, *places), stiffness, factors)
        squares, motions = (2 * np.pi * modal.frequency_hz[0]) ** 2, modal.shapes[0]
    for row, place, dof, reference in components:
        own = numbers[place] - 1
        gap: Array = squares[own] - squares
        share = np.divide(1.0, gap, out=np.zeros_like(gap), where=np.abs(gap) > _SAME * squares[own])
        at_springs = motions[:, len(dofs) :]
        moved = (share * motions[:, : len(dofs)].T) @ (at_springs * at_springs[own])
        change[row] = _of_ratio(motions[own], moved, dof, reference) / data.sd[row]
    lowest = np.linalg.norm(free[min(numbers) - 1])
    return np.asarray(change / lowest) if lowest else change[:, :0]


def _joint_and_numbers(part: Problem, theta: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """Matrices of one joint (1, r, r), factors on the structure (1, q), and numbers of the modes compared (n,)."""
    data, test = part.test.data.modes, part.test
    assert data is not None
    matrix, factors = part.prior.matrix(theta[None]), part.structural(part.prior.factors(theta[None]))
    model, numbers = modal_model(data, test.structures, test.joints), np.array(data.numbers)
    if isinstance(model, ModePrediction):
        numbers = model.matched(matrix, factors)[1][0] + 1
    return matrix.batch.stiffness, factors, numbers


def _modes_at(
    test: Test, joints: Joint | Joints, count: int, dofs: Sequence[str], stiffness: Array, factors: Array
) -> Modal:
    """The lowest modes at one joint, a batch of one: a table over all that is uncertain would cost far more."""
    return AssembledShapes(test.structures.solved_anew(), joints, count, dofs).modes(stiffness, factors)


def _relative_effect(
    test: Test, joints: Joint | Joints, stiffness: Array, factors: Array, places: Sequence[str], count: int
) -> Array:
    """d ln f of the lowest modes per N/m of a spring at each place, shape (count, places), m/N."""
    modal = _modes_at(test, joints, count, places, stiffness, factors)
    return np.asarray(modal.shapes[0] ** 2 / (2 * (2 * np.pi * modal.frequency_hz[0, :, None]) ** 2))


def _components(data: ModalData) -> tuple[tuple[str, ...], Sequence[tuple[int, int, int, int]]]:
    """DOFs of shapes; and of each component its row among all values, and the places of mode, DOF and reference."""
    split = [(row, name.split()) for row, name in enumerate(data.value_names)]
    shapes = [(row, int(of[0]), of[1], of[-1]) for row, (kind, *of) in split if kind == "shape"]
    dofs = tuple(dict.fromkeys(label for *_, dof, reference in shapes for label in (dof, reference)))
    place, mode = ({name: i for i, name in enumerate(names)} for names in (dofs, data.numbers))
    return dofs, [(row, mode[number], place[dof], place[reference]) for row, number, dof, reference in shapes]


def _of_ratio(motion: Array, change: Array, dof: int, reference: int) -> Array:
    """Change of the ratio of two motions by the changes of both."""
    ratio = motion[dof] / motion[reference]
    return np.asarray((change[dof] - ratio * change[reference]) / motion[reference])


def _places(test: Test) -> tuple[str, ...]:
    """Return DOFs along the structure that move in a direction, without the joint's; of stated points, if any."""
    body = test.structures
    points = getattr(getattr(body, "recipe", None), "positions", None) or {
        label.rpartition(":")[0] for label in body.labels
    }
    moving = [label for label in body.labels if label.rpartition(":")[2] in ("x", "y", "z")]
    moving = [label for label in moving if label not in test.joints.labels and label.rpartition(":")[0] in points]
    chosen = np.linspace(0, len(moving) - 1, min(_PLACES, len(moving))).round().astype(int)
    return tuple(moving[place] for place in chosen)
