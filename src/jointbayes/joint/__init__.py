"""A joint: a few springs between DOFs, and the coordinates that it is inferred in.

Names and units cost nothing; what computes is loaded with NumPy at first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from jointbayes.joint.quantities import COORDINATES as COORDINATES
from jointbayes.joint.quantities import HYPOTHESES as HYPOTHESES
from jointbayes.joint.quantities import STIFFNESS_NAMES as STIFFNESS_NAMES
from jointbayes.joint.quantities import STIFFNESSES as STIFFNESSES
from jointbayes.joint.quantities import Coordinate as Coordinate
from jointbayes.joint.quantities import Quantity as Quantity

if TYPE_CHECKING:
    from jointbayes.joint.elastic_centre import ElasticCentre as ElasticCentre
    from jointbayes.joint.joint import Joint as Joint
    from jointbayes.joint.log import LogStiffness as LogStiffness
    from jointbayes.joint.matrix import STIFFNESS_PATTERN as STIFFNESS_PATTERN
    from jointbayes.joint.matrix import check_positive_semidefinite as check_positive_semidefinite
    from jointbayes.joint.matrix import is_positive_semidefinite as is_positive_semidefinite
    from jointbayes.joint.matrix import joint_matrix as joint_matrix
    from jointbayes.joint.matrix import symmetric_changes as symmetric_changes
    from jointbayes.joint.parametrisation import ComplianceCoordinates as ComplianceCoordinates
    from jointbayes.joint.parametrisation import CondensedCoordinates as CondensedCoordinates
    from jointbayes.joint.parametrisation import Cone as Cone
    from jointbayes.joint.parametrisation import Parametrisation as Parametrisation
    from jointbayes.joint.parametrisation import parametrisation_named as parametrisation_named
    from jointbayes.joint.plain_springs import RIGID as RIGID
    from jointbayes.joint.plain_springs import PlainSprings as PlainSprings
    from jointbayes.joint.signed import SignedCoupling as SignedCoupling

_COMPUTING = ("matrix", "joint", "parametrisation", "plain_springs", *COORDINATES)


def __getattr__(name: str) -> Any:  # noqa: ANN401 (any name of the room)
    for module in (import_module(f"{__name__}.{home}") for home in _COMPUTING):
        if name in module.__all__:
            return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
