"""What a clamp's edge and springs to ground that nobody modelled do to all modes alike, at one joint.

Both move every mode in a pattern of its own, which the errors of single modes cannot follow: the edge as the length of
the overhang does, a spring where the modes move at it, d ln f = φ²/(2 ω²) per N/m with φ in modes of unit modal mass.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointbayes.arrays import Array
from jointbayes.frf import AssembledShapes
from jointbayes.inference.modal_likelihood import ModePrediction, modal_model
from jointbayes.inference.noise.model_error import ModelErrorNoise
from jointbayes.inference.problem import Problem
from jointbayes.inference.test import Test, own_name
from jointbayes.joint import RIGID, Joint, Joints

_PLACES = 12  # of a structure, at which a spring is tried
_STEP = 1e-4  # of the length
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
    overhangs = [_overhang(part.test) for part in parts]
    noises = {}
    for part, clamp, overhang in zip(parts, clamps, overhangs, strict=True):
        noise = part.test.noise
        assert isinstance(noise, ModelErrorNoise)
        of_clamp = [length for length, other in zip(overhangs, clamps, strict=True) if other == clamp]
        size = noise.sizes.edge * float(np.mean(of_clamp)) / overhang if overhang else 0.0
        edges, springs = _edge(part, theta, size), _springs(part, noise, theta)
        noises[id(part.test)] = replace(noise, edges=edges, springs=springs, clamp=clamp)
    tests, left_out = (
        tuple(replace(test, noise=noises.get(id(test), test.noise)) for test in some)
        for some in (problem.tests, problem.left_out)
    )
    return replace(problem, tests=tests, left_out=left_out) if noises else problem


def _overhang(test: Test) -> float:
    """Length of a straight body that one joint holds at its end, m; 0 of any other."""
    body = test.structures
    places, held = ([body.position(label) for label in some] for some in (_places(test), test.joints.labels))
    if not held or not places or any(place is None for place in (*places, *held)):
        return 0.0
    offsets = np.array(places, dtype=float) - np.array(held[0], dtype=float)
    away = np.linalg.norm(offsets, axis=1)
    longest = float(away.max())
    along = offsets @ offsets[away.argmax()] / longest if longest else away
    is_straight = bool((np.abs(along - away) <= _STRAIGHT * longest).all())
    return longest if is_straight and len(set(held)) == 1 else 0.0


def _edge(part: Problem, theta: Array, size: float) -> Array:
    """What a change of the overhang by this fraction does to the residuals, shape (m, 1); (m, 0) without a length."""
    prior, likelihood = part.prior, part.log_posterior.likelihood
    names = [nuisance.name for nuisance in prior.nuisances]
    length = own_name(part.test.name, "length", names)
    if length is None or not size:
        return np.empty((likelihood.n_data, 0))
    steps = np.repeat(prior.factors(theta[None]), 2, axis=0)
    steps[:, names.index(length)] *= (1 + _STEP, 1 - _STEP)
    longer, shorter = likelihood.standardised(prior.matrix(np.vstack([theta, theta])), steps)
    return (size * (longer - shorter) / (2 * _STEP))[:, None]


def _springs(part: Problem, noise: ModelErrorNoise, theta: Array) -> Array:
    """What springs do to the residuals that move the lowest mode, together, by its value, shape (m, places)."""
    data, test = part.test.data.modes, part.test
    assert data is not None
    places = _places(test)
    if not noise.sizes.spring or not places:
        return np.empty((len(data.values), 0))
    matrix, factors = part.prior.matrix(theta[None]), part.structural(part.prior.factors(theta[None]))
    model, numbers = modal_model(data, test.structures, test.joints), np.array(data.numbers)
    if isinstance(model, ModePrediction):
        numbers = model.matched(matrix, factors)[1][0] + 1
    of_mode = dict(zip(map(str, data.numbers), numbers.tolist(), strict=True))
    effect = np.zeros((len(data.values), len(places)))
    stiffness = matrix.batch.stiffness
    free = _relative_effect(test, test.joints, stiffness, factors, places, max(numbers))
    for row, name in enumerate(data.value_names):
        kind, number, *of = name.split()
        if kind in ("frequency", "eigenvalue"):
            effect[row] = free[of_mode[number] - 1]
        elif kind == "zero":
            held = Joints((*_named(test), Joint((of[-1],), name="held")))
            rigid = np.pad(stiffness, ((0, 0), (0, 1), (0, 1)))
            rigid[:, -1, -1] = RIGID
            effect[row] = _relative_effect(test, held, rigid, factors, places, int(number))[int(number) - 1]
    lowest = np.linalg.norm(free[min(numbers) - 1])
    return np.asarray(effect * noise.relative[:, None] / lowest) if lowest else effect[:, :0]


def _relative_effect(
    test: Test, joints: Joint | Joints, stiffness: Array, factors: Array, places: Sequence[str], count: int
) -> Array:
    """d ln f of the lowest modes per N/m of a spring at each place, shape (count, places), m/N."""
    modal = AssembledShapes(test.structures, joints, count, places).modes(stiffness, factors)
    return np.asarray(modal.shapes[0] ** 2 / (2 * (2 * np.pi * modal.frequency_hz[0, :, None]) ** 2))


def _named(test: Test) -> tuple[Joint, ...]:
    joints = test.joints.joints if isinstance(test.joints, Joints) else (test.joints,)
    return tuple(replace(joint, name=f"{place}") for place, joint in enumerate(joints))


def _places(test: Test) -> tuple[str, ...]:
    """DOFs along the structure that move in a direction, but those of the joint: of points that it states, if any."""
    body = test.structures
    points = getattr(getattr(body, "recipe", None), "positions", None) or {
        label.rpartition(":")[0] for label in body.labels
    }
    moving = [label for label in body.labels if label.rpartition(":")[2] in ("x", "y", "z")]
    moving = [label for label in moving if label not in test.joints.labels and label.rpartition(":")[0] in points]
    chosen = np.linspace(0, len(moving) - 1, min(_PLACES, len(moving))).round().astype(int)
    return tuple(moving[place] for place in chosen)
