"""The joint that a comparison puts in place of another: with fewer springs or couplings, or with more couplings."""

from jointbayes.errors import ModelError
from jointbayes.joint.coupled import CoupledPair
from jointbayes.joint.full import FullStiffness
from jointbayes.joint.parametrisation import Parametrisation
from jointbayes.joint.plain_springs import PlainSprings, Rigid
from jointbayes.joint.quantities import DIRECTIONS, is_rotation, is_rotation_unit

_PAIR = (False, True)  # a translation and a rotation


def joint_under(joint: Parametrisation, hypothesis: str) -> Parametrisation:
    """One joint without damping under one of `HYPOTHESES`; a rigid one is rigid under all of them.

    Raises
    ------
    ModelError
        If a joint is to be coupled that is no translation and rotation.
    """
    if isinstance(joint, Rigid):
        return joint
    if hypothesis in ("full", "coupled"):
        return _with_couplings(joint, hypothesis)
    springs = [quantity for quantity in joint.quantities if not quantity.may_be_negative]
    yielding = {
        "rigid": [],
        "translation": [quantity for quantity in springs if not is_rotation_unit(quantity.unit)],
        "rotation": [quantity for quantity in springs if is_rotation_unit(quantity.unit)],
        "springs": springs,
    }[hypothesis]
    return PlainSprings(tuple(quantity.name for quantity in yielding), joint.quantities)


def _with_couplings(joint: Parametrisation, hypothesis: str) -> Parametrisation:
    directions = _directions(joint)
    if hypothesis == "coupled" and directions and tuple(map(is_rotation, directions)) != _PAIR:
        raise ModelError(
            f"comparison: found the hypothesis coupled of a joint in {', '.join(directions)}; expected a joint of a "
            "translation and a rotation; compare springs and full"
        )
    return FullStiffness(directions) if isinstance(joint, PlainSprings) and directions else joint


def _directions(joint: Parametrisation) -> tuple[str, ...]:
    """Directions of a joint of springs or of a full one; none of a coupled pair, which is what it is."""
    if isinstance(joint, FullStiffness):
        return joint.directions
    if isinstance(joint, CoupledPair):
        return ()
    named = tuple(name[1:] for name in joint.stiffness_names)
    return named if set(named) <= set(DIRECTIONS) else ()
