"""A joint: a few springs between DOFs, and the coordinates that it is inferred in."""

from jointbayes.joint.joint import (
    STIFFNESS_NAMES,
    STIFFNESS_PATTERN,
    STIFFNESS_UNITS,
    ComplianceChart,
    CondensedChart,
    Joint,
    LogStiffness,
    Parametrisation,
    SignedCoupling,
    check_positive_semidefinite,
    is_positive_semidefinite,
    joint_matrix,
    symmetric_changes,
)
from jointbayes.joint.plain_springs import RIGID, PlainSprings

__all__ = [
    "ComplianceChart",
    "CondensedChart",
    "Joint",
    "LogStiffness",
    "Parametrisation",
    "PlainSprings",
    "RIGID",
    "STIFFNESS_NAMES",
    "STIFFNESS_PATTERN",
    "STIFFNESS_UNITS",
    "SignedCoupling",
    "check_positive_semidefinite",
    "is_positive_semidefinite",
    "joint_matrix",
    "symmetric_changes",
]
