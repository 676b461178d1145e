"""The `[joint]` and `[joints.NAME]` tables of a case file, and the joint matrices that other tables state."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, Strict

from jointbayes.case.spec.fields import OWN, Finding, Labels, Spec, either, key_field
from jointbayes.case.spec.prior_tables import PriorsSpec, StiffnessSpec
from jointbayes.case.spec.structure_tables import metres
from jointbayes.joint import (
    COORDINATES,
    DIRECTIONS,
    KINDS,
    Coordinate,
    Quantity,
)

if TYPE_CHECKING:
    from jointbayes.joint import Joint, Parametrisation

_DOFS = key_field("the translation and then the rotation, two DOF labels", ["1:y", "1:rz"])
_AGAINST = key_field("no DOF (joint to ground) or as many as dofs, those of the other side", ["9:y", "9:rz"])
_LOG, *_ = COORDINATES
_COUPLED, *_ = KINDS
_KIND = key_field("the kind of joint, " + either(f'"{kind}"' for kind in KINDS), _COUPLED)
_AXES = key_field(
    "the joint's own x, y and z, three lists of three numbers", [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0, 0, 1]]
)
_OFFSET = key_field("the way from the DOFs' point to the joint's in mm, three numbers x, y, z", [25.0, 0.0, 0.0])
_OFFSET_AGAINST = key_field(
    "the way from the other side's point to the joint's in mm, three numbers", [-25.0, 0.0, 0.0]
)
_SHARED = key_field("the name of the joint whose quantities are those of this one", "left")
_PARAMETRISATION = key_field(
    either(
        f'"{key}" ({", ".join(f"ln {axis.name}" if axis.logarithmic else axis.name for axis in axes)})'
        for key, axes in COORDINATES.items()
    ),
    _LOG,
)
if TYPE_CHECKING:
    ParametrisationName = str
    KindName = str
else:
    ParametrisationName = Literal[tuple(COORDINATES)]
    KindName = Literal[KINDS]

_Names = Annotated[tuple[str, ...], Strict(False)]
_VISCOUS = key_field("a list of springs of the joint that have a dashpot beside them", ["k11", "k22"])
_LOSS = key_field('a list of springs of the joint that have a loss factor, or ["all"]', ["all"])
_Vector = Annotated[tuple[float, float, float], Strict(False)]
_Share = Annotated[float, Field(ge=-1, le=1)]
_Unit = Annotated[tuple[_Share, _Share, _Share], Strict(False)]


# What must be the same in joints that share their quantities.
_ALIKE = ("kind", "directions", "parametrisation", "viscous", "loss_factors")


def joint_table(name: str) -> tuple[str, ...]:
    """Key of the table of a joint; of a lone one, which has no name, that of all."""
    return ("joints", name) if name else ("joint",)


def prior_table(name: str) -> tuple[str, ...]:
    """Key of the table of the priors of a joint."""
    return ("joints", name, "prior") if name else ("prior",)


class JointSpec(Spec):
    """A joint: where it acts, of which kind it is, how it is parametrised, and the first guess of the iteration."""

    kind: Annotated[KindName, _KIND] = _COUPLED
    dofs: Annotated[Labels, Field(min_length=1, max_length=len(DIRECTIONS)), _DOFS]
    against: Annotated[Labels, _AGAINST] = ()
    axes: Annotated[Annotated[tuple[_Unit, _Unit, _Unit], Strict(False)] | None, _AXES] = None
    offset_mm: Annotated[_Vector | None, _OFFSET] = None
    offset_against_mm: Annotated[_Vector | None, _OFFSET_AGAINST] = None
    parametrisation: Annotated[ParametrisationName, _PARAMETRISATION] = _LOG
    viscous: Annotated[_Names, _VISCOUS] = ()
    loss_factors: Annotated[_Names, _LOSS] = ()
    initial: Annotated[StiffnessSpec | None, Field(description="the first guess: k11, k12, k22")] = None
    own: Annotated[bool, OWN] = False

    @property
    def directions(self) -> tuple[str, ...]:
        """Directions of its DOFs."""
        return tuple(label.split(":")[1] for label in self.dofs)

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """Its parameters, each of which needs a prior."""
        return self.parametrisation_object.axes

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Its stiffnesses, then its damping."""
        return self.parametrisation_object.quantities

    @property
    def damping(self) -> tuple[Quantity, ...]:
        """Dashpots and loss factors."""
        return self.quantities[len(self.stiffnesses) :]

    @property
    def stiffnesses(self) -> tuple[Quantity, ...]:
        """Its stiffnesses."""
        return self._undamped.quantities

    def unlike(self, other: JointSpec) -> list[str]:
        """What keeps it from sharing its quantities with another joint."""
        return [what for what in _ALIKE if getattr(self, what) != getattr(other, what)]

    def built(self, name: str = "") -> Joint:
        """Where it acts."""
        from jointbayes.joint import Joint

        offsets = [mm and metres(mm) for mm in (self.offset_mm, self.offset_against_mm)]
        return Joint(self.dofs, self.against, name, self.axes, *offsets)

    @property
    def parametrisation_object(self) -> Parametrisation:
        """Its coordinates."""
        from jointbayes.joint import Damped

        kind = self._undamped
        return Damped(kind, self.viscous, self.loss_factors) if self.viscous or self.loss_factors else kind

    @property
    def _undamped(self) -> Parametrisation:
        from jointbayes.joint import parametrisation_named

        return parametrisation_named(self.parametrisation if self.kind == _COUPLED else self.kind, self.directions)

    def try_objects(self) -> None:
        """Where it acts, and its coordinates."""
        self.built()
        _ = self.parametrisation_object

    def _findings(self) -> Iterator[Finding]:
        for key in ("initial", "parametrisation"):
            if self.kind != _COUPLED and key in self.model_fields_set:
                yield Finding((key,), f'found it with kind = "{self.kind}"', f'kind = "{_COUPLED}"', "remove it")
        if self.offset_against_mm is not None and not self.against:
            yield Finding(("offset_against_mm",), "found an offset of no side", "against, the other side", "remove it")


class NamedJointSpec(JointSpec):
    """One of several joints: as `[joint]`, with its own priors, or the quantities of another one."""

    prior: Annotated[
        PriorsSpec | None, Field(description="a table for the prior of each parameter, as [joints.left.prior.k11]")
    ] = None
    shared: Annotated[str | None, _SHARED] = None
