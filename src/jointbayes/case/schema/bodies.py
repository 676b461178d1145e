"""The `[bodies.NAME]` tables of a case file: bodies given by their measured FRFs, beside those of `[structure]`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from jointbayes.case.errors import Finding
from jointbayes.case.schema.damping import ModalDampingSpec
from jointbayes.case.schema.fields import Label, key_field
from jointbayes.case.schema.measured import MeasuredFrfSpec, MeasuredSpec, RotationSpec, VarianceSpec
from jointbayes.case.schema.structure_parts import POINT

if TYPE_CHECKING:
    from jointbayes.case.schema.data import DataSpec
    from jointbayes.case.schema.joint import JointSpec
    from jointbayes.case.schema.priors import UncertainSpec
    from jointbayes.case.schema.structure import StructureSpec


_KIND = key_field('the kind of body, "measured"', "measured")
_VARIANCE = Field(description="the variance of the FRFs: source")
_PROPAGATE = key_field(
    "true (the noise of the FRFs counts in the likelihood) or false (it is ignored: intervals are too narrow)", True
)
_ROTATIONS = key_field('a table for each rotation, as [bodies.spindle.rotations."spindle:rz"]', {})


class MeasuredBodySpec(MeasuredSpec):
    """A body given by its FRFs between the DOFs that its channels stand for, and rotations between them."""

    kind: Annotated[Literal["measured"], _KIND]
    variance: Annotated[VarianceSpec, _VARIANCE]
    rotations: Annotated[dict[Label, RotationSpec], _ROTATIONS] = {}  # noqa: RUF012 (frozen model)
    propagate: Annotated[bool, _PROPAGATE] = True

    @property
    def labels(self) -> tuple[str, ...]:
        """DOFs that the body has: those of its channels, and its rotations."""
        return tuple(dict.fromkeys((*(channel.label for channel in self.channels.values()), *self.rotations)))

    def _findings(self) -> Iterator[Finding]:
        yield from super()._findings()
        measured = {channel.label for channel in self.channels.values()}
        for label, rotation in self.rotations.items():
            if ":r" not in label:
                yield Finding(("rotations", label), f'found "{label}"', "a rotation", 'write for example "spindle:rz"')
            else:
                yield from rotation.wrong_directions(label)
            if rotation.spacing_mm is None:
                yield Finding(("rotations", label, "spacing_mm"), missing=True)
            if rotation.in_likelihood:
                expected = "false: a rotation of a body stands beside its stations, with the noise that they share"
                yield Finding(("rotations", label, "in_likelihood"), "found true", expected, "remove it")
            for i, station in enumerate(rotation.stations):
                if station not in measured:
                    found = f'found "{station}", which no channel of the body stands for'
                    place = ("rotations", label, "stations", i)
                    yield Finding(place, found, "a DOF of the body", "map its channel or correct the station")


def labels_of_bodies(bodies: Mapping[str, MeasuredBodySpec]) -> frozenset[str]:
    """DOFs of all bodies."""
    return frozenset(label for body in bodies.values() for label in body.labels)


def bodies_findings(
    bodies: Mapping[str, MeasuredBodySpec], structure: StructureSpec, data: DataSpec, uncertain: UncertainSpec
) -> Iterator[Finding]:
    """Yield what measured bodies cannot stand beside."""
    known: dict[str, str] = {}
    for name, body in bodies.items():
        if not POINT.fullmatch(name):
            expected = "a name of letters, digits, _ and -, a letter first"
            yield Finding(("bodies", name), f'found the name "{re.sub(r"[^ -~]", "?", name)[:40]}"', expected, "rename")
        for label in body.labels:
            other = known.setdefault(label, name)
            where = f"[bodies.{other}]" if other != name else "[structure]" if structure.absent(label) is None else ""
            if where:
                found = f'found "{label}", which is a DOF of {where} as well'
                yield Finding(("bodies", name, "channels"), found, "labels of its own", "give it another point")
        if body.propagate != next(iter(bodies.values())).propagate:
            expected = "the same in all bodies"
            yield Finding(("bodies", name, "propagate"), f"found {str(body.propagate).lower()}", expected, "change it")
    if not bodies:
        return
    beside = "beside a body that is given by its FRFs and has no modes"
    if not isinstance(data, MeasuredFrfSpec):
        yield Finding(("data", "kind"), f'found "{data.kind}" {beside}', 'kind = "measured_frf"', "write it so")
    if uncertain.given.get("mode_frequencies") is not None:
        yield Finding(("uncertain", "mode_frequencies"), f"found it {beside}", "other quantities", "remove it")
    damping = structure.damping
    if isinstance(damping, ModalDampingSpec) and damping.measured:
        expected = "damping ratios of the modelled structure by itself"
        yield Finding(("structure", "damping", "ratio"), f'found "measured" {beside}', expected, "state them")


def unknown_size_findings(
    joints: Mapping[str, JointSpec], structure: StructureSpec, priors: Mapping[str, object]
) -> Iterator[Finding]:
    """Yield joints between measured bodies alone that have no priors: default ones come from a model's stiffness."""
    for name, joint in joints.items():
        sides = [side for side in (joint.dofs, joint.against) if side]
        modelled = any(structure.absent(side[0]) is None for side in sides)
        if joint.coordinates and priors[name] is None and not modelled:
            place = ("joints", name, "prior") if name else ("prior",)
            expected = "one for a joint that no modelled body has a side of, whose size nobody knows"
            yield Finding(place, "found no prior", expected, "state it")
