"""The case file: its TOML schema as frozen models, and the reader that names every fault by file, line, key.

Each field's ``description`` is also the "expected …" of its error messages, and its first example the remedy.
Units are in the keys; nothing is converted here. Importing this module loads pydantic.

The tables stand in modules of their own; here they come together, with the rules between them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated

import pydantic
from pydantic import Field, Strict

from jointbayes.case.case_text import CaseText, case_text
from jointbayes.case.errors import Finding, fault_lines, fault_paths, show_key
from jointbayes.case.named_files import DATA_FILE, named_files
from jointbayes.case.schema.bodies import MeasuredBodySpec, bodies_findings, labels_of_bodies, unknown_size_findings
from jointbayes.case.schema.data import DataSpec, SyntheticFrfSpec
from jointbayes.case.schema.fields import Spec, key_field
from jointbayes.case.schema.joint import JointSpec, NamedJointSpec
from jointbayes.case.schema.measured import MeasuredFrfSpec
from jointbayes.case.schema.noise import NoiseModelSpec
from jointbayes.case.schema.priors import PriorsSpec, UncertainSpec
from jointbayes.case.schema.rules import (
    dof_findings,
    joints_findings,
    noise_findings,
    plan_findings,
    prior_findings,
    truth_findings,
    truth_names_findings,
    uncertain_findings,
    virtual_test_findings,
)
from jointbayes.case.schema.settings import CompareSpec, IdentificationSpec, PlanSpec, ReferenceSpec, SamplingSpec
from jointbayes.case.schema.setups import (
    LevelSpec,
    SetupSpec,
    between_setups,
    hypotheses_findings,
    integral_findings,
    parameter_findings,
    setups_findings,
)
from jointbayes.case.schema.structure import StructureSpec
from jointbayes.case.schema.virtual_test import VirtualTestSpec
from jointbayes.case.setup_texts import planned_texts, setup_texts, without_inherited
from jointbayes.case.toml_text import KeyPath
from jointbayes.errors import CaseError
from jointbayes.joint import Coordinate
from jointbayes.joint.quantities import prefixed

_TITLE = Field(
    min_length=1,
    max_length=200,
    pattern=r"^[^\r\n]*$",
    description="a text of one line, at most 200 characters",
    examples=["Clamped beam"],
)


_EXTENDS = key_field("the name of the case file whose keys this one starts from, relative to this file", "base.toml")
_REMOVE = key_field("a list of keys or tables of that file that this one does not take", ["prior.k12"])


class CaseSpec(Spec):
    """A whole case file; of one that builds on another what both are together, without `extends` and `remove`.

    Of several set-ups it is that of one: the rest of the file with what the set-up changes.
    """

    extends: Annotated[str, _EXTENDS] = ""
    remove: Annotated[tuple[str, ...], Strict(False), _REMOVE] = ()
    title: Annotated[str, _TITLE] = ""
    setups: Annotated[
        dict[str, SetupSpec], Field(description="several tests of the same joints, a table for each, as [setups.long]")
    ] = {}  # noqa: RUF012 (pydantic copies it)
    level: Annotated[LevelSpec | None, Field(description="what the levels of the set-ups are: name, unit")] = None
    structure: StructureSpec
    joint: Annotated[JointSpec | None, Field(description="the joint: dofs, initial")] = None
    joints: Annotated[
        dict[str, NamedJointSpec], Field(description="several joints, a table for each by its name, as [joints.left]")
    ] = {}  # noqa: RUF012 (pydantic copies it)
    bodies: Annotated[
        dict[str, MeasuredBodySpec],
        Field(description="bodies given by their measured FRFs, a table for each by its name, as [bodies.spindle]"),
    ] = {}  # noqa: RUF012 (pydantic copies it)
    prior: Annotated[
        PriorsSpec | None, Field(description="a table for the prior of each parameter, as [prior.k11]")
    ] = None
    uncertain: Annotated[
        UncertainSpec, Field(description="a table for each uncertain quantity, as [uncertain.length]")
    ] = UncertainSpec()
    data: DataSpec
    noise: Annotated[NoiseModelSpec, Field(description="how residuals are judged")] = NoiseModelSpec()
    identification: Annotated[IdentificationSpec, Field(description="settings of the iteration")] = IdentificationSpec()
    sampling: Annotated[SamplingSpec, Field(description="settings of the sampler")] = SamplingSpec()
    compare: Annotated[CompareSpec, Field(description="the hypotheses to compare")] = CompareSpec()
    plan: Annotated[PlanSpec, Field(description="the further measurements to rank")] = PlanSpec()
    virtual_test: Annotated[VirtualTestSpec, Field(description="how `simulate` measures")] = VirtualTestSpec()
    reference: Annotated[ReferenceSpec | None, Field(description="published values to compare with")] = None

    @property
    def all_joints(self) -> dict[str, JointSpec]:
        """Every joint by its name; a lone one has none."""
        return dict(self.joints) if self.joint is None else {"": self.joint}

    @property
    def all_coordinates(self) -> tuple[Coordinate, ...]:
        """Coordinates of all joints, those that are shared once."""
        own = ((name, joint) for name, joint in self.all_joints.items() if name not in self.sharing)
        return tuple(axis.of_joint(name) for name, joint in own for axis in joint.coordinates)

    @property
    def all_quantities(self) -> tuple[str, ...]:
        """Names of the stiffnesses of all joints, those that are shared once."""
        own = ((name, joint) for name, joint in self.all_joints.items() if name not in self.sharing)
        return tuple(prefixed(name, quantity.name) for name, joint in own for quantity in joint.quantities)

    @property
    def sharing(self) -> dict[str, str]:
        """Joints whose quantities are those of another one, by name."""
        return {name: joint.shared for name, joint in self.joints.items() if joint.shared is not None}

    @property
    def plan_outputs(self) -> tuple[str, ...]:
        """DOFs that a further measurement may add: those of the plan, or each translation along that of the joint."""
        direction = next(iter(self.all_joints.values())).directions[0]
        every = (f"{point}:{direction}" for point in self.structure.points_in_order)
        return self.plan.outputs or tuple(label for label in every if label not in self.structure.supports)

    @property
    def plan_inputs(self) -> tuple[str, ...]:
        """DOFs that may be excited for a further measurement: those of the plan, or the inputs of FRF data."""
        return self.plan.inputs or (
            self.data.inputs if isinstance(self.data, SyntheticFrfSpec | MeasuredFrfSpec) else ()
        )

    def _findings(self) -> Iterator[Finding]:
        yield from setups_findings(self)
        if self.joint is None and not self.joints:
            yield Finding(("joint",), missing=True)
            return
        yield from joints_findings(self.joint, self.joints, self.prior)
        elsewhere = labels_of_bodies(self.bodies)
        yield from dof_findings(self.structure, self.all_joints, self.data, self.plan, elsewhere)
        yield from bodies_findings(self.bodies, self.structure, self.data, self.uncertain)
        if self.bodies:
            alone = {name: one for name, one in self.joints.items() if one.shared is None} or self.all_joints
            priors = {name: one.prior for name, one in self.joints.items()} or {"": self.prior}
            yield from unknown_size_findings(alone, self.structure, priors)
        if self.prior is not None and self.joint is not None:
            yield from prior_findings(self.joint, self.prior)
        lone_pair = self.joint is not None and self.joint.kind == "coupled" and not self.joint.damping
        yield from truth_names_findings(self.data, self.all_quantities, lone_pair=lone_pair)
        yield from uncertain_findings(self.uncertain, self.structure, self.data)
        yield from truth_findings(self.structure, self.data)
        yield from noise_findings(self.noise, self.data)
        yield from plan_findings(self.plan, self.data)
        if self.reference is not None and (not lone_pair or any(joint.own for joint in self.all_joints.values())):
            found, expected = "found k11, k12 and k22 to compare with", "one coupled joint, the same in all set-ups"
            yield Finding(("reference",), found, expected, "remove [reference]")
        yield from virtual_test_findings(self.virtual_test, self.structure, self.data)


def needs_files(specs: Mapping[str, CaseSpec]) -> bool:
    """Whether a case cannot be built from its text and the data of a lone test: it names files besides these.

    Parameters
    ----------
    specs
        Its set-ups, as `parse_setups` gives them.
    """
    return any(setup or key != DATA_FILE for setup, spec in specs.items() for key in named_files(spec))


def parse_case(text: str | CaseText, name: str = "case") -> CaseSpec:
    """Read a case from TOML text; of several set-ups the first, see `parse_setups`.

    Parameters
    ----------
    text : str or CaseText
        The TOML text, which stands alone; or one with the files that it builds on.
    name : str
        The file name that error messages show, of a text alone.

    Returns
    -------
    CaseSpec
        The checked case.

    Raises
    ------
    CaseError
        If anything is wrong; one line for each fault, ``FILE:LINE: key: found; expected; what to do``.
    """
    return next(iter(parse_setups(text, name).values()))


def parse_setups(text: str | CaseText, name: str = "case") -> dict[str, CaseSpec]:
    """Read each set-up of a case by its name; a case of one test is that of one without a name.

    Parameters and errors are those of `parse_case`. What the file says for all set-ups of an uncertain quantity, a plan
    or a virtual test is left out of those that cannot have it, as long as another one can.
    """
    source = case_text(text, name) if isinstance(text, str) else text
    texts = setup_texts(source)
    specs: dict[str, CaseSpec] = {}
    faults: list[str] = []
    dropped: dict[KeyPath, list[str]] = {}
    for setup, one in texts.items():
        spec, lines, without = _checked(one)
        faults += lines
        for key, told in without.items():
            dropped[key] = [*dropped.get(key, []), told]
        if spec is not None:
            specs[setup] = spec
    faults += (told[0] for told in dropped.values() if len(told) == len(texts))  # which no set-up can have
    if not faults:
        between = (
            *between_setups(specs, texts),
            *integral_findings(specs),
            *parameter_findings(specs),
            *hypotheses_findings(specs),
        )
        faults += (_told(texts[setup], finding) for setup, finding in between)
    if faults:
        raise CaseError("\n".join(dict.fromkeys(faults)))
    return specs


def _told(text: CaseText, finding: Finding) -> str:
    """A fault between set-ups in one line."""
    key = show_key(text.written(finding.loc))
    return text.fault(finding.loc, key, finding.found, f"expected {finding.expected}", finding.remedy)


def parse_planned(source: CaseText) -> dict[str, CaseSpec]:
    """Read each set-up that the plan of a case proposes by its name; errors are those of `parse_case`."""
    texts = planned_texts(source)
    if not texts:
        return {}
    specs: dict[str, CaseSpec] = {}
    faults: list[str] = []
    for name, one in texts.items():
        spec, lines, _ = _checked(one)
        faults += lines
        if spec is not None:
            specs[name] = spec
        faults += [one.fault(loc, show_key(one.written(loc)), *words) for loc, words in _own_unknowns(spec)]
    if not faults:
        for name, finding in between_setups(parse_setups(source) | specs, setup_texts(source) | texts):
            if name in texts:
                faults.append(_told(texts[name], finding))
    if faults:
        raise CaseError("\n".join(dict.fromkeys(faults)))
    return specs


def _own_unknowns(spec: CaseSpec | None) -> Iterator[tuple[tuple[str, ...], tuple[str, str, str]]]:
    """Yield where a proposed set-up says that a joint, or its noise, is its own, and what is wrong with it."""
    if spec is None:
        return
    owned = [(*(("joints", name) if name else ("joint",)), "own") for name, one in spec.all_joints.items() if one.own]
    own, remedy = "of its own, of which the present data say nothing", "remove own, or the set-up from the plan"
    for loc in owned:
        yield loc, (f"found a joint {own}", "expected one that set-ups share", remedy)
    if spec.noise.own and spec.noise.inferred:
        yield ("noise", "own"), (f"found parameters of the noise {own}", "expected those that set-ups share", remedy)


def _checked(text: CaseText) -> tuple[CaseSpec | None, list[str], dict[KeyPath, str]]:
    """One set-up, or its faults; and what it does not take of the rest of the file, each with its fault."""
    without: dict[KeyPath, str] = {}
    while True:
        try:
            return CaseSpec.model_validate(text.data), [], without
        except pydantic.ValidationError as error:
            lines = fault_lines(error, CaseSpec, text)
            left = [without_inherited(text, path) for path in fault_paths(error, CaseSpec, text)]
        if not all(left):
            return None, lines, without
        key, text = next(one for one in left if one is not None)
        without[key] = lines[0]
