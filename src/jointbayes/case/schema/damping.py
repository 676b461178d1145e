"""Damping laws in a case file: the table `[structure.damping]`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidatorFunctionWrapHandler, WrapValidator

from jointbayes.case.schema.fields import Ratios, Spec, key_field, not_negative

LAW = key_field('the damping law, "modal", "loss_factor" or "rayleigh"', "modal")
_RATIO = key_field("the damping ratio, a number from 0 to below 1 (0.01 is 1 %), or a list of them", 0.01)


def _or_measured(value: object, ratios: ValidatorFunctionWrapHandler) -> object:
    """No ratio where they are to be those that the data show."""
    return () if value == "measured" else ratios(value)


class ModalDampingSpec(Spec):
    """Damping ratios of the modes of structure with joint; the last one holds for all further modes.

    ``ratio = "measured"`` leaves them empty until the data have been read.
    """

    law: Annotated[Literal["modal"], LAW]
    ratio: Annotated[Ratios, WrapValidator(_or_measured), _RATIO]

    @property
    def measured(self) -> bool:
        """Whether the ratios are those that the data show."""
        return not self.ratio


class LossFactorDampingSpec(Spec):
    """Structural (hysteretic) damping, K(1 + jη)."""

    law: Annotated[Literal["loss_factor"], LAW]
    loss_factor: Annotated[float, not_negative("the structural loss factor", 0.01)]


class RayleighDampingSpec(Spec):
    """Viscous damping, C = alpha M + beta K."""

    law: Annotated[Literal["rayleigh"], LAW]
    alpha_per_s: Annotated[float, not_negative("the factor of the mass matrix in 1/s", 1.0)]
    beta_s: Annotated[float, not_negative("the factor of the stiffness matrix in s", 1e-6)]


DampingSpec = Annotated[
    ModalDampingSpec | LossFactorDampingSpec | RayleighDampingSpec,
    Field(discriminator="law", description="the damping: its law and constants"),
]
