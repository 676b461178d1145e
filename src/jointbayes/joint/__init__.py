"""A joint: a few springs between DOFs, and the coordinates that it is inferred in.

Names and units cost nothing; what computes is loaded with NumPy at first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from jointbayes.joint.quantities import COORDINATES as COORDINATES
from jointbayes.joint.quantities import COUPLED as COUPLED
from jointbayes.joint.quantities import DIRECTIONS as DIRECTIONS
from jointbayes.joint.quantities import HYPOTHESES as HYPOTHESES
from jointbayes.joint.quantities import KINDS as KINDS
from jointbayes.joint.quantities import USUAL_HYPOTHESES as USUAL_HYPOTHESES
from jointbayes.joint.quantities import Coordinate as Coordinate
from jointbayes.joint.quantities import Quantity as Quantity
from jointbayes.joint.quantities import damping_quantities as damping_quantities
from jointbayes.joint.quantities import full_coordinates as full_coordinates
from jointbayes.joint.quantities import full_stiffnesses as full_stiffnesses
from jointbayes.joint.quantities import spring_stiffnesses as spring_stiffnesses

if TYPE_CHECKING:
    from jointbayes.joint.blocks import Block as Block
    from jointbayes.joint.blocks import Blocks as Blocks
    from jointbayes.joint.blocks import blocks_of as blocks_of
    from jointbayes.joint.damped import Damped as Damped
    from jointbayes.joint.elastic_centre import ElasticCentre as ElasticCentre
    from jointbayes.joint.full import FullStiffness as FullStiffness
    from jointbayes.joint.joint import AnyJoint as AnyJoint
    from jointbayes.joint.joint import Joint as Joint
    from jointbayes.joint.joint import Joints as Joints
    from jointbayes.joint.joint import joints_of as joints_of
    from jointbayes.joint.kinds import joint_under_hypothesis as joint_under_hypothesis
    from jointbayes.joint.kinds import parametrisation_named as parametrisation_named
    from jointbayes.joint.log import LogStiffness as LogStiffness
    from jointbayes.joint.matrix import AnyJointMatrix as AnyJointMatrix
    from jointbayes.joint.matrix import JointMatrix as JointMatrix
    from jointbayes.joint.matrix import joint_matrix_of as joint_matrix_of
    from jointbayes.joint.matrix import symmetric_changes as symmetric_changes
    from jointbayes.joint.parametrisation import RIGID as RIGID
    from jointbayes.joint.parametrisation import ComplianceCoordinates as ComplianceCoordinates
    from jointbayes.joint.parametrisation import CondensedCoordinates as CondensedCoordinates
    from jointbayes.joint.parametrisation import Cone as Cone
    from jointbayes.joint.parametrisation import Parametrisation as Parametrisation
    from jointbayes.joint.plain_springs import PlainSprings as PlainSprings
    from jointbayes.joint.plain_springs import Rigid as Rigid
    from jointbayes.joint.signed import SignedCoupling as SignedCoupling

_COMPUTING = (
    "matrix", "joint", "parametrisation", "plain_springs", "full", "damped", "blocks", "kinds", "log", "signed",
    "elastic_centre",
)  # fmt: skip


def __getattr__(name: str) -> Any:  # noqa: ANN401 (any name of the room)
    for module in (import_module(f"{__name__}.{home}") for home in _COMPUTING):
        if hasattr(module, name):
            return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
