"""Joints by the name of their kind, and those that a comparison puts in their place."""

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module

from jointbayes.errors import ModelError
from jointbayes.joint.blocks import Blocks
from jointbayes.joint.coupled import CoupledPair
from jointbayes.joint.damped import Damped
from jointbayes.joint.full import FullStiffness
from jointbayes.joint.parametrisation import Parametrisation
from jointbayes.joint.plain_springs import PlainSprings, Rigid
from jointbayes.joint.quantities import (
    COORDINATES,
    DIRECTIONS,
    is_rotation,
    is_rotation_unit,
    split_hypothesis,
    spring_stiffnesses,
)

_PAIR = (False, True)  # a translation and a rotation


def parametrisation_named(key: str, directions: Sequence[str] = ()) -> Parametrisation:
    """The coordinates that a case file calls so: one of `COORDINATES`, or a kind of joint between DOFs.

    Parameters
    ----------
    key
        One of `COORDINATES` for a joint of one translation and one rotation, ``"rigid"``, ``"springs"`` or ``"full"``.
    directions
        Directions of the joint's DOFs, as ``("y", "rz")``; those of `COORDINATES` need none.

    Raises
    ------
    ModelError
        If the directions are not those of such a joint.
    """
    if key in COORDINATES:
        if directions and tuple(map(is_rotation, directions)) != _PAIR:
            found, expected = f"found DOFs in {', '.join(directions)}", "a translation and then a rotation, as y, rz"
            raise ModelError.of("coupled joint", ("dofs",), found, expected, 'correct them, or the kind: "springs"')
        import_module(f"jointbayes.joint.{key}")
        return CoupledPair.kinds[key]()
    if key == "rigid":
        return Rigid(len(directions))
    if key == "springs":
        springs = spring_stiffnesses(directions)
        return PlainSprings(tuple(spring.name for spring in springs), springs)
    return FullStiffness(tuple(directions))


def joint_under_hypothesis(joint: Parametrisation, name: str, only: str = "") -> Parametrisation:
    """Joints under one of `HYPOTHESES` or ``"absent"``: simpler ones, some with more couplings, or these themselves.

    Of several joints each is; a rigid one is rigid under all. Damping stays with the springs that yield, unless the
    hypothesis is an undamped joint. With `only` it is about the joint of that name alone.

    Raises
    ------
    ModelError
        If a joint is to be coupled that is no translation and rotation.
    """
    if isinstance(joint, Blocks):
        blocks = (
            replace(block, parametrisation=joint_under_hypothesis(block.parametrisation, name))
            if only in ("", block.name)
            else block
            for block in joint.blocks
        )
        return Blocks(tuple(blocks))
    undamped, hypothesis = split_hypothesis(name)
    if isinstance(joint, Damped):
        other = joint_under_hypothesis(joint.of, name)
        # where couplings come in, springs have other names: they are known by their places
        moving = {axis.quantity for axis in other.axes}
        places = {q.places: q.name for q in other.quantities if q.name in moving}
        names = {q.name: places[q.places] for q in joint.of.quantities if q.places in places}
        names |= {"all": "all"} if moving else {}
        viscous, loss = (
            tuple(names[spring] for spring in springs if spring in names)
            for springs in (joint.viscous, joint.loss_factors)
        )
        return Damped(other, viscous, loss) if (viscous or loss) and not undamped else other
    if isinstance(joint, Rigid):
        return joint
    if hypothesis in ("full", "coupled"):
        # none of a coupled pair, which is what it is
        directions = joint.directions if isinstance(joint, FullStiffness) else ()
        if isinstance(joint, PlainSprings):
            named = tuple(name[1:] for name in joint.stiffness_names)
            directions = named if set(named) <= set(DIRECTIONS) else ()
        if hypothesis == "coupled" and directions and tuple(map(is_rotation, directions)) != _PAIR:
            found = f"found the hypothesis coupled of a joint in {', '.join(directions)}"
            expected = "a joint of a translation and a rotation"
            raise ModelError.of("comparison", (), found, expected, "compare springs and full")
        return FullStiffness(directions) if isinstance(joint, PlainSprings) and directions else joint
    if hypothesis == "absent":
        return PlainSprings((), joint.quantities, absent=True)
    springs = [quantity for quantity in joint.quantities if not quantity.may_be_negative]
    yielding = {
        "rigid": [],
        "translation": [quantity for quantity in springs if not is_rotation_unit(quantity.unit)],
        "rotation": [quantity for quantity in springs if is_rotation_unit(quantity.unit)],
        "springs": springs,
    }[hypothesis]
    return PlainSprings(tuple(quantity.name for quantity in yielding), joint.quantities)
