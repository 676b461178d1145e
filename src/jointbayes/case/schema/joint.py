"""The `[joint]` table of a case file, and the joint matrices that other tables state."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from jointbayes.case.errors import Finding
from jointbayes.case.schema.fields import Labels, Spec, key_field, not_negative

__all__ = ["JointSpec", "StiffnessSpec"]


class StiffnessSpec(Spec):
    """A positive semidefinite joint matrix [[k11, k12], [k12, k22]]."""

    k11: Annotated[float, not_negative("the translational stiffness in N/m", 1e8)]
    k12: Annotated[float, key_field("the coupling stiffness in N, a number with k12² ≤ k11·k22", 0.0)]
    k22: Annotated[float, not_negative("the rotational stiffness in N m/rad", 1e6)]

    def _findings(self) -> Iterator[Finding]:
        bound = math.sqrt(self.k11) * math.sqrt(self.k22)  # not sqrt(k11 k22), which may overflow
        if abs(self.k12) > bound * (1 + 1e-12):
            squares = f"k12² = {self.k12 * self.k12:.6g} exceeds k11·k22 = {self.k11 * self.k22:.6g}"
            found = f"{squares}: the joint matrix is not positive semidefinite"
            yield Finding(("k12",), found, "k12² ≤ k11·k22", f"lower |k12| below {bound:.6g} N")


_DOFS = key_field("the translation and then the rotation, two DOF labels", ["1:y", "1:rz"])
_AGAINST = key_field("no DOF (joint to ground) or two, the other side's translation and rotation", ["9:y", "9:rz"])
_PARAMETRISATION = key_field('"log" (ln k11, ln k12, ln k22) or "signed" (ln k11, ln k22, rho)', "log")


class JointSpec(Spec):
    """The joint: where it acts, how it is parametrised, and the first guess of the paper's iteration."""

    dofs: Annotated[Labels, Field(min_length=2, max_length=2), _DOFS]
    against: Annotated[Labels, _AGAINST] = ()
    parametrisation: Annotated[Literal["log", "signed"], _PARAMETRISATION] = "log"
    initial: Annotated[StiffnessSpec | None, Field(description="the first guess: k11, k12, k22")] = None

    @property
    def parameters(self) -> tuple[str, str, str]:
        """Names of the parameters, each of which needs a prior."""
        return ("k11", "k12", "k22") if self.parametrisation == "log" else ("k11", "k22", "rho")

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
