"""The `[joint]` table of a case file, and the joint matrices that other tables state."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from jointbayes.case.errors import Finding
from jointbayes.case.schema.fields import Labels, Spec, ascii_unit, either, key_field, not_negative
from jointbayes.joint import COORDINATES, COUPLED

__all__ = ["JointSpec", "StiffnessSpec"]

_K11, _K12, _K22 = COUPLED
_IN = {quantity.name: f"{quantity.words} in {ascii_unit(quantity.unit)}" for quantity in COUPLED}


class StiffnessSpec(Spec):
    """A positive semidefinite joint matrix [[k11, k12], [k12, k22]]."""

    k11: Annotated[float, not_negative(_IN[_K11.name], 1e8)]
    k12: Annotated[float, key_field(f"{_IN[_K12.name]}, a number with k12² ≤ k11·k22", 0.0)]
    k22: Annotated[float, not_negative(_IN[_K22.name], 1e6)]

    def _findings(self) -> Iterator[Finding]:
        bound = math.sqrt(self.k11) * math.sqrt(self.k22)  # not sqrt(k11 k22), which may overflow
        if abs(self.k12) > bound * (1 + 1e-12):
            squares = f"k12² = {self.k12 * self.k12:.6g} exceeds k11·k22 = {self.k11 * self.k22:.6g}"
            found = f"{squares}: the joint matrix is not positive semidefinite"
            yield Finding((_K12.name,), found, "k12² ≤ k11·k22", f"lower |k12| below {bound:.6g} N")


_DOFS = key_field("the translation and then the rotation, two DOF labels", ["1:y", "1:rz"])
_AGAINST = key_field("no DOF (joint to ground) or two, the other side's translation and rotation", ["9:y", "9:rz"])
_LOG, *_ = COORDINATES
_PARAMETRISATION = key_field(
    either(
        f'"{key}" ({", ".join(f"ln {axis.name}" if axis.logarithmic else axis.name for axis in axes)})'
        for key, axes in COORDINATES.items()
    ),
    _LOG,
)
if TYPE_CHECKING:
    ParametrisationName = str
else:
    ParametrisationName = Literal[tuple(COORDINATES)]


class JointSpec(Spec):
    """The joint: where it acts, how it is parametrised, and the first guess of the paper's iteration."""

    dofs: Annotated[Labels, Field(min_length=2, max_length=2), _DOFS]
    against: Annotated[Labels, _AGAINST] = ()
    parametrisation: Annotated[ParametrisationName, _PARAMETRISATION] = _LOG
    initial: Annotated[StiffnessSpec | None, Field(description="the first guess: k11, k12, k22")] = None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, each of which needs a prior."""
        return tuple(axis.name for axis in COORDINATES[self.parametrisation])

    def _findings(self) -> Iterator[Finding]:
        if len(self.against) not in (0, 2):
            yield Finding(("against",))
        for name, labels in (("dofs", self.dofs), ("against", self.against)):
            for i, (label, kind) in enumerate(zip(labels, ("translation", "rotation"), strict=False)):
                if (":r" in label) != (kind == "rotation"):
                    found = f'found entry {i + 1} = "{label}", which is no {kind}'
                    yield Finding((name, i), found, "", 'write for example ["1:y", "1:rz"]')
                    break  # two labels in the wrong order are one fault
        for i, (here, there) in enumerate(zip(self.dofs, self.against, strict=False)):
            if here.split(":")[1] != there.split(":")[1] or here == there:
                expected = f"the direction of joint.dofs, {here.split(':')[1]}, at another node"
                yield Finding(("against", i), f'found "{there}" against "{here}"', expected, "correct the label")
