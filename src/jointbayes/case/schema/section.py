"""Cross-sections in a case file: the tables `section` and `end_section`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from jointbayes.case.errors import Finding
from jointbayes.case.schema.fields import Spec, key_field, positive

_SHAPE = key_field('the shape of the section, "circle", "tube", "rectangle" or "box"', "circle")


class CircleSpec(Spec):
    """Solid circular cross-section."""

    shape: Annotated[Literal["circle"], _SHAPE]
    diameter_mm: Annotated[float, positive("the diameter in mm", 25.0)]


class TubeSpec(Spec):
    """Circular tube."""

    shape: Annotated[Literal["tube"], _SHAPE]
    outer_diameter_mm: Annotated[float, positive("the outer diameter in mm", 40.0)]
    inner_diameter_mm: Annotated[float, positive("the inner diameter in mm", 30.0)]

    def _findings(self) -> Iterator[Finding]:
        if self.inner_diameter_mm >= self.outer_diameter_mm:
            found = f"found {self.inner_diameter_mm!r}, which leaves no wall"
            expected = f"an inner diameter in mm below the outer one, {self.outer_diameter_mm!r}"
            yield Finding(("inner_diameter_mm",), found, expected, "correct one of the two diameters")


class RectangleSpec(Spec):
    """Solid rectangle; the height lies along y, the width along z."""

    shape: Annotated[Literal["rectangle"], _SHAPE]
    width_mm: Annotated[float, positive("the width (along z) in mm", 40.0)]
    height_mm: Annotated[float, positive("the height (along y) in mm", 20.0)]


class BoxSpec(Spec):
    """Rectangular tube of constant wall."""

    shape: Annotated[Literal["box"], _SHAPE]
    width_mm: Annotated[float, positive("the outer width (along z) in mm", 40.0)]
    height_mm: Annotated[float, positive("the outer height (along y) in mm", 20.0)]
    wall_mm: Annotated[float, positive("the thickness of the wall in mm", 2.0)]

    def _findings(self) -> Iterator[Finding]:
        half = min(self.width_mm, self.height_mm) / 2
        if self.wall_mm >= half:
            found, expected = f"found {self.wall_mm!r}, which leaves no hollow", f"a wall below {half!r} mm"
            yield Finding(("wall_mm",), found, f"{expected} (half the smaller side)", "make the wall thinner")


SectionSpec = Annotated[
    CircleSpec | TubeSpec | RectangleSpec | BoxSpec,
    Field(discriminator="shape", description="the cross-section: its shape and dimensions"),
]
