"""A joint: a few springs between DOFs, and the coordinates that it is inferred in.

Names and units cost nothing; what computes is loaded with NumPy at first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from jointbayes.joint.quantities import (
    COORDINATES,
    HYPOTHESES,
    STIFFNESS_NAMES,
    STIFFNESSES,
    Coordinate,
    Quantity,
)

if TYPE_CHECKING:
    from jointbayes.joint.elastic_centre import ElasticCentre
    from jointbayes.joint.joint import Joint
    from jointbayes.joint.log import LogStiffness
    from jointbayes.joint.matrix import (
        STIFFNESS_PATTERN,
        check_positive_semidefinite,
        is_positive_semidefinite,
        joint_matrix,
        symmetric_changes,
    )
    from jointbayes.joint.parametrisation import (
        ComplianceCoordinates,
        CondensedCoordinates,
        Cone,
        Parametrisation,
        parametrisation_named,
    )
    from jointbayes.joint.plain_springs import RIGID, PlainSprings
    from jointbayes.joint.signed import SignedCoupling

__all__ = [
    "COORDINATES",
    "ComplianceCoordinates",
    "CondensedCoordinates",
    "Cone",
    "Coordinate",
    "ElasticCentre",
    "HYPOTHESES",
    "Joint",
    "LogStiffness",
    "Parametrisation",
    "PlainSprings",
    "Quantity",
    "RIGID",
    "STIFFNESSES",
    "STIFFNESS_NAMES",
    "STIFFNESS_PATTERN",
    "SignedCoupling",
    "check_positive_semidefinite",
    "is_positive_semidefinite",
    "joint_matrix",
    "parametrisation_named",
    "symmetric_changes",
]

_COMPUTING = ("matrix", "joint", "parametrisation", "plain_springs", *COORDINATES)


def __getattr__(name: str) -> Any:  # noqa: ANN401 (any name of the room)
    for module in (import_module(f"{__name__}.{home}") for home in _COMPUTING) if name in __all__ else ():
        if name in module.__all__:
            globals()[name] = getattr(module, name)
            return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
