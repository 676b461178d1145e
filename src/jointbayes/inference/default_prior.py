"""The prior of a joint of which nothing is stated: far softer than the structure to far stiffer, any coupling."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.frf import AnyStructure
from jointbayes.frf.measured_body import substructures
from jointbayes.inference.marginals import Marginal, Uniform, marginal_of
from jointbayes.inference.prior import JointPrior
from jointbayes.joint import COUPLED, AnyJoint, Coordinate, Parametrisation, Quantity, blocks_of, parametrisation_named
from jointbayes.joint.quantities import is_rotation, is_rotation_unit, prefixed
from jointbayes.structure import Body
from vibrecords import Data
from vibrecords.peaks import resonances_hz

#: Bounds of the default prior relative to the structure's own stiffnesses. At its lower
#: one no spring moves an elastic frequency further from that without it than a model's usual error, at the upper ones
#: all are that near those of a rigid joint, so that both are inside: 0.1 EI/L would raise that of a free beam by 0.7 %.
DEFAULT_PRIOR_FACTORS = 0.1, 1e6
DEFAULT_ROTATION_FACTORS = 0.01, 1e6
#: Bounds of the default priors of a loss factor, and of a dashpot relative to the beam's own stiffness times a second.
DEFAULT_LOSS = 1e-4, 1.0
DEFAULT_DASHPOT_FACTORS = 1e-6, 100.0


@dataclass(frozen=True, slots=True)
class OwnStiffness:
    """A structure's stiffness by itself where one of a joint acts, and the softest joint that default priors expect."""

    size: float
    softest: float


def own_stiffnesses(
    sides: Sequence[Sequence[str]], quantities: Sequence[Quantity], body: Body, data: Data, *, softest: bool = True
) -> dict[str, OwnStiffness]:
    """The structure's stiffness by itself where each stiffness and dashpot of a joint acts, by their names.

    A structure may hang on a joint far softer than itself. The spring on which its inertia m has the lowest measured
    natural frequency is then m ω²: the softest joint is expected there where the default range would not reach so far.
    Where nothing holds a mass that spring is its stiffness as well. Empty where both sides are measured bodies: `sides`
    are the DOFs on each side of the joint that is modelled. Without `softest` that joint is not looked at, and peaks of
    the data are not looked for where the structure's stiffness is known.
    """
    sizes = {}
    shown = cache(lambda: resonances_hz(data))
    for quantity in quantities if sides else ():
        if quantity.unit == "1":
            continue
        i, j = quantity.places[0]
        size = body.own_stiffness(sides[0][i], sides[0][j])
        if size and not softest:
            sizes[quantity.name] = OwnStiffness(size, size)
            continue
        lowest = float(shown().min()) if shown().size else data.band_hz[0]
        inertias = (math.sqrt(body.own_inertia(side[i]) * body.own_inertia(side[j])) for side in sides)
        spring = min(inertias) * (2 * math.pi * lowest) ** 2
        size = size or spring
        beyond = shown().size and spring < _prior_factors(quantity.unit)[0] * size
        sizes[quantity.name] = OwnStiffness(size, spring if beyond else size)
    return sizes


def _prior_factors(unit: str) -> tuple[float, float]:
    return DEFAULT_ROTATION_FACTORS if is_rotation_unit(unit) else DEFAULT_PRIOR_FACTORS


def default_marginal(axis: Coordinate, sizes: Mapping[str, OwnStiffness], length: float) -> Marginal:
    """Prior where none is stated: far softer than the beam to far stiffer, any coupling, an arm on it."""
    if axis.logarithmic and axis.unit not in [quantity.unit for quantity in COUPLED]:  # a loss factor, or a dashpot
        if axis.unit == "1":
            return Uniform(*np.log(DEFAULT_LOSS))
        return Uniform(*np.log([end * sizes[axis.quantity].size for end in DEFAULT_DASHPOT_FACTORS]))
    if axis.logarithmic:
        low, high = _prior_factors(axis.unit)
        return Uniform(*np.log([low * sizes[axis.quantity].softest, high * sizes[axis.quantity].size]))
    return Uniform(*axis.bounds) if axis.bounded else Uniform(-length, length)


def default_prior(
    tests: Sequence[tuple[AnyStructure, AnyJoint, Data]], stated: Mapping[str, object] | None = None
) -> JointPrior:
    """Return the prior of a case file that states none, or only some, for the joints of tests in Python.

    Each test is its structure, joints and data. Of several joints of one name the first decides. `stated` has marginals
    by the names of their coordinates, as ``"k22"``, or ``"left.k22"`` of a joint with a name.

    A joint of one translation and one rotation is `LogStiffness`, any other a spring for each of its DOFs. The range is
    relative to the structure's own stiffness: of matrices that of a static deformation, of beams EI/L³ and EI/L.

    Raises
    ------
    ModelError
        If a joint without a prior holds only measured bodies, or a stated prior is of no coordinate.
    """
    stated = stated or {}
    kinds: dict[str, Parametrisation | str] = {}
    marginals: list[Marginal] = []
    for structure, joints, data in tests:
        body = substructures(structure).modelled
        for joint in joints.joints:
            if joint.name in kinds:
                continue
            directions = tuple(label.rpartition(":")[2] for label in joint.dofs)
            pair = list(map(is_rotation, directions)) == [False, True]
            kind = parametrisation_named("log" if pair else "springs", directions)
            sides = [side for side in (joint.dofs, joint.against) if side and side[0] in body.labels]
            names = [prefixed(joint.name, axis.name) for axis in kind.axes]
            if not sides and not stated.keys() >= set(names):
                found = f"found no prior of joint {joint.name or joint.dofs[0]!r} between measured bodies"
                expected = "one, since no modelled structure says how stiff it may be"
                raise ModelError.of("problem", (), found, expected, "pass prior=jb.JointPrior(…)")
            sizes = own_stiffnesses(sides, kind.quantities, body, data)
            extent = getattr(getattr(body, "recipe", None), "extent", 1.0)
            for name, axis in zip(names, kind.axes, strict=True):
                known = marginal_of(stated[name]) if name in stated else None
                marginals.append(known or default_marginal(axis, sizes, extent))
            kinds[joint.name] = kind
    blocks = blocks_of(kinds)
    if odd := [name for name in stated if name not in blocks.names]:
        expected = f"priors of {', '.join(blocks.names)}"
        raise ModelError.of("problem", (), f"found a prior of {odd[0]!r}", expected, "correct the name")
    return JointPrior(blocks, tuple(marginals))
