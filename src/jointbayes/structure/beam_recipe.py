"""A uniform straight beam as a recipe: a frame of one member along x, in one plane or in two and along its axis.

A user numbers equally spaced points. The elements between them are nobody's business: their ends lie at the joint,
supports, accelerometers, measured and excited points only, and their number and order follow from the highest line.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Integral
from typing import ClassVar, Literal

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.structure.damping import DampingLaw
from jointbayes.structure.frame import FrameBody, Member
from jointbayes.structure.frame_element import Stretch
from jointbayes.structure.frame_mesh import segments_of
from jointbayes.structure.frame_recipe import FrameMesh, MemberRecipe
from jointbayes.structure.matrices import Structure
from jointbayes.structure.recipe import HALF_WAVES, ElementKind
from jointbayes.structure.section import BeamMaterial, Section
from vibrecords.arrays import Array

_DIRECTIONS: dict[int, tuple[str, ...]] = {2: ("y", "rz"), 5: ("x", "y", "z", "ry", "rz")}  # by the DOFs of a node
_LEAST, _MOST, _MOST_SPANS = 1e-6, 1e6, 10_000  # of a length in m, a coefficient; and equal spans

#: Quantities of a beam that may be uncertain, beside ``damping_ratio_1`` and so on.
STRUCTURE_QUANTITIES = (
    "youngs_modulus",
    "density",
    "length",
    "length_offset",
    "section_size",
    "shear_coefficient",
    "axial_force",
    "accelerometer_mass",
    "damping_ratio",
    "loss_factor",
)


@dataclass(frozen=True)
class BeamRecipe(MemberRecipe):
    """What a uniform straight beam is made from: DOFs ``"node:direction"``, nodes numbered from 1 at x = 0.

    Parameters
    ----------
    length
        Length, m.
    section, material, damping
        Cross-section, material and damping law.
    elements
        Equal spans between the numbered points 1 to elements + 1; with the paper's element also the finite elements.
    dofs_per_node
        2: deflection ``y`` and rotation ``rz`` in the x-y plane.  5: ``x, y, z, ry, rz``, two bending planes and axial
        motion, no torsion.
    shear_coefficient
        κ for both planes; None takes Cowper's formula for the section.
    richer
        Whether elements are four orders richer than it takes, one where points are many: a reference for others. No
        matter to the paper's element.
    axial_force
        Force along it at rest, N, tension positive, see `Member`.
    supports, accelerometer_mass, added_mass, accelerometer_dofs, element
        See `Recipe`.

    Raises
    ------
    ModelError
        If a number is not possible or a DOF does not exist.
    """

    length: float
    section: Section
    material: BeamMaterial
    damping: DampingLaw
    elements: int = 10
    dofs_per_node: Literal[2, 5] = 2
    shear_coefficient: float | None = None
    supports: tuple[str, ...] = ()
    accelerometer_mass: float = 0.0
    added_mass: float = 0.0
    accelerometer_dofs: tuple[str, ...] = ()
    element: ElementKind = "converged"
    richer: bool = False
    axial_force: float = 0.0

    kind: ClassVar[str] = "beam"
    quantities: ClassVar[tuple[str, ...]] = STRUCTURE_QUANTITIES
    #: A beam of so many has a hundred modes below the highest line: no test is made so.
    most_dofs: ClassVar[tuple[int, int]] = (500, 10)
    most_are: ClassVar[str] = ", a hundred natural frequencies"

    def __post_init__(self) -> None:
        if not _LEAST <= self.length <= _MOST:
            raise ModelError(f"beam: found a length of {self.length:g} m; expected a finite length above 0; correct it")
        self._require_masses()
        kappa = self.shear_coefficient
        if not (kappa is None or _LEAST <= kappa <= _MOST):
            raise ModelError(
                f"beam: found a shear coefficient of {kappa:g}; expected one above 0, about 0.9; correct it"
            )
        if not (isinstance(self.elements, Integral) and 1 <= self.elements <= _MOST_SPANS):
            raise ModelError(
                f"beam: found {self.elements} elements; expected a whole number from 1 to {_MOST_SPANS}; correct it"
            )
        if self.dofs_per_node not in _DIRECTIONS:
            raise ModelError(f"beam: found {self.dofs_per_node} DOFs per node; expected 2 or 5; correct them")
        for label in (*self.supports, *self.accelerometer_dofs):
            self.require_dof(label)

    @property
    def what(self) -> str:
        """The beam by its length."""
        return f"{1e3 * self.length:g} mm"

    @property
    def directions(self) -> tuple[str, ...]:
        """Directions of the DOFs of each node."""
        return _DIRECTIONS[self.dofs_per_node]

    @cached_property
    def bodies(self) -> tuple[tuple[str, FrameBody], ...]:
        """Its one member, through all numbered points."""
        last = str(self.elements + 1)
        shear, force = self.shear_coefficient, self.axial_force
        member = Member(("1", last), self.section, self.material, shear_coefficient=shear, axial_force=force)
        return (("", FrameBody((("1", (0.0, 0.0, 0.0)), (last, (self.length, 0.0, 0.0))), (member,))),)

    @cached_property
    def positions(self) -> dict[str, tuple[float, float, float]]:
        """Place of every numbered point, m."""
        return {str(i + 1): (self.length * i / self.elements, 0.0, 0.0) for i in range(self.elements + 1)}

    @cached_property
    def whole(self) -> Stretch:
        """All of it as one piece."""
        return segments_of(self.bodies[0][1], ())[0].stretch

    def own_stiffness(self, row: str, column: str) -> float:
        """EI/L³ (N/m), EI/L² (N) or EI/L (N·m/rad) of two DOFs, of bending in the plane of the first."""
        across_y = row.rpartition(":")[2] in ("z", "ry")
        inertia = self.section.inertia_y if across_y else self.section.inertia_z
        return self.material.youngs_modulus * inertia / self.length ** (3 - (":r" in row) - (":r" in column))

    def body_factor(self, number: int, factors: Mapping[str, Array], quantity: str) -> Array:
        """Factor on a quantity from those by name; its offset, in m, is added to the length."""
        factor = super().body_factor(number, factors, quantity)
        if quantity == "length" and "length_offset" in factors:
            return factor + np.log(factors["length_offset"]) / self.length
        return factor

    def mesh(
        self, dofs: Iterable[str] | None = None, top_hz: float | None = None, forces: Sequence[float] = ()
    ) -> FrameMesh:
        """Elements as those of frames; no `top_hz` takes the frequency of ten half waves along the whole beam."""
        return super().mesh(dofs, self.whole.bending_frequency_hz(HALF_WAVES) if top_hz is None else top_hz, forces)


def beam(
    length: float,
    section: Section,
    material: BeamMaterial,
    damping: DampingLaw,
    *,
    elements: int = 10,
    dofs_per_node: Literal[2, 5] = 2,
    shear_coefficient: float | None = None,
) -> Structure:
    """Free-free straight beam along x of equal elements of the paper's kind, see `BeamRecipe`.

    Its points have no places, so that a joint may connect any two.

    Raises
    ------
    ModelError
        If a number is not possible.

    Examples
    --------
    >>> from jointbayes.structure import ModalDamping
    >>> steel = BeamMaterial(2.1e11, 0.3, 7800.0)
    >>> rod = beam(0.383, Section.circle(0.025), steel, ModalDamping((0.01,)))
    >>> rod.fixed(["1:y", "1:rz"]).modes().frequency_hz[:2].round(2).tolist()
    [123.41, 762.62]
    """
    recipe = BeamRecipe(length, section, material, damping, elements, dofs_per_node, shear_coefficient, element="paper")
    return replace(recipe.structure(), positions={})
