"""The case file: its TOML schema as frozen models, and the reader that names every fault by file, line, key.

Each field's ``description`` is also the "expected …" of its error messages, and its first example the remedy.
Units are in the keys; nothing is converted here. Importing this module loads pydantic.

The tables stand in modules of their own; here they come together, with the rules between them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import TYPE_CHECKING, Annotated

from pydantic import BeforeValidator, Field, Strict

from jointbayes.case.spec import rules
from jointbayes.case.spec.data_table import DataSpec, SyntheticFrfSpec, files_table, synthetic_table
from jointbayes.case.spec.fields import JOINED, Finding, KeyPath, Name, Spec, key_field
from jointbayes.case.spec.frame_table import FrameSpec
from jointbayes.case.spec.imported_table import ImportedSpec
from jointbayes.case.spec.joint_table import JointSpec, NamedJointSpec, joint_table, prior_table
from jointbayes.case.spec.measured_table import MeasuredBodySpec, MeasuredSpec
from jointbayes.case.spec.prior_tables import NamedStiffnessSpec, PriorsSpec, UncertainSpec, quantity_table
from jointbayes.case.spec.settings_tables import (
    AssemblySpec,
    CompareSpec,
    IdentificationSpec,
    LeftOutSpec,
    LevelSpec,
    NoiseModelSpec,
    PlanSpec,
    PredictSpec,
    ReferenceSpec,
    SamplingSpec,
    SetupSpec,
    VirtualTestSpec,
)
from jointbayes.case.spec.structure_kinds import BeamSpec, ChainSpec, MatricesSpec
from jointbayes.case.spec.structure_table import POINT
from jointbayes.joint.quantities import prefixed

if TYPE_CHECKING:
    from jointbayes.joint import Joint, Parametrisation

_TITLE = Field(
    min_length=1,
    max_length=200,
    pattern=r"^[^\r\n]*$",
    description="a text of one line, at most 200 characters",
    examples=["Clamped beam"],
)


_EXTENDS = key_field("the name of the case file whose keys this one starts from, relative to this file", "base.toml")
_REMOVE = key_field("a list of keys or tables of that file that this one does not take", ["prior.k12"])


def _beam_unless_stated(table: object) -> object:
    return {"kind": "beam", **table} if isinstance(table, dict) else table


StructureSpec = Annotated[
    BeamSpec | FrameSpec | ChainSpec | MatricesSpec | ImportedSpec,
    Field(discriminator="kind", description="the structure without its joint"),
    BeforeValidator(_beam_unless_stated),
]

#: Called when the tables of a case are right in themselves, before objects are made of them, which takes NumPy.
BEFORE_OBJECTS: ContextVar[Callable[[], None]] = ContextVar("BEFORE_OBJECTS", default=lambda: None)


class CaseSpec(Spec):
    """A whole case file; of one that builds on another what both are together, without `extends` and `remove`.

    Of several set-ups it is that of one: the rest of the file with what the set-up changes.
    """

    extends: Annotated[str, _EXTENDS] = ""
    remove: Annotated[tuple[str, ...], Strict(False), _REMOVE] = ()
    title: Annotated[str, _TITLE] = ""
    setups: Annotated[
        dict[Name, SetupSpec], Field(description="several tests of the same joints, a table for each, as [setups.long]")
    ] = {}  # noqa: RUF012 (pydantic copies it)
    level: Annotated[LevelSpec | None, Field(description="what the levels of the set-ups are: name, unit")] = None
    assembly: Annotated[
        AssemblySpec | None, Field(description="that each set-up is an assembly of its own: scatter, scatter_factor")
    ] = None
    structure: StructureSpec
    joined: Annotated[bool, JOINED] = True
    joint: Annotated[JointSpec | None, Field(description="the joint: dofs, initial")] = None
    joints: Annotated[
        dict[Name, NamedJointSpec], Field(description="several joints, a table for each by its name, as [joints.left]")
    ] = {}  # noqa: RUF012 (pydantic copies it)
    bodies: Annotated[
        dict[str, MeasuredBodySpec],
        Field(description="bodies given by their measured FRFs, a table for each by its name, as [bodies.spindle]"),
    ] = {}  # noqa: RUF012 (pydantic copies it)
    prior: Annotated[
        PriorsSpec | None, Field(description="a table for the prior of each parameter, as [prior.k11]")
    ] = None
    uncertain: Annotated[
        UncertainSpec,
        Field(description="a table for each uncertain quantity, as [uncertain.length]"),
    ] = UncertainSpec()
    data: DataSpec
    noise: Annotated[NoiseModelSpec, Field(description="how residuals are judged")] = NoiseModelSpec()
    left_out: Annotated[LeftOutSpec, Field(description="data that are left out: modes, bands_hz, setups")] = (
        LeftOutSpec()
    )
    identification: Annotated[IdentificationSpec, Field(description="settings of the iteration")] = IdentificationSpec()
    sampling: Annotated[SamplingSpec, Field(description="settings of the sampler")] = SamplingSpec()
    compare: Annotated[CompareSpec, Field(description="the hypotheses to compare")] = CompareSpec()
    plan: Annotated[PlanSpec, Field(description="the further measurements to rank")] = PlanSpec()
    predict: Annotated[
        PredictSpec | None, Field(description="what `predict` is to compute of this structure: DOFs and lines")
    ] = None
    virtual_test: Annotated[VirtualTestSpec, Field(description="how `simulate` measures")] = VirtualTestSpec()
    reference: Annotated[ReferenceSpec | None, Field(description="published values to compare with")] = None

    @property
    def all_joints(self) -> dict[str, JointSpec]:
        """Every joint by its name; a lone one has none. None where nothing is joined."""
        if not self.joined:
            return {}
        return dict(self.joints) if self.joint is None else {"": self.joint}

    @property
    def synthetic(self) -> SyntheticFrfSpec | None:
        """The table of the data, if a stated truth makes them."""
        return synthetic_table(self.data)

    @property
    def files(self) -> MeasuredSpec | None:
        """The table of the data, if they are in measurement files."""
        return files_table(self.data)

    @property
    def measured_labels(self) -> frozenset[str]:
        """DOFs of all bodies that are given by their FRFs."""
        return frozenset(label for body in self.bodies.values() for label in body.labels)

    @property
    def all_quantities(self) -> tuple[str, ...]:
        """Names of the stiffnesses of all joints, those that are shared once."""
        joints = self.stating_joints.items()
        return tuple(prefixed(name, quantity.name) for name, joint in joints for quantity in joint.quantities)

    @property
    def stating_joints(self) -> dict[str, JointSpec]:
        """Joints that state their quantities: all but those that have another's."""
        return {name: joint for name, joint in self.all_joints.items() if name not in self.sharing}

    def priors_of(self, name: str) -> PriorsSpec | None:
        """Priors that are stated for a joint."""
        joint = self.all_joints[name]
        return joint.prior if isinstance(joint, NamedJointSpec) else self.prior

    @property
    def sharing(self) -> dict[str, str]:
        """Joints whose quantities are those of another one, by name."""
        joints = self.joints.items() if self.joined else ()
        return {name: joint.shared for name, joint in joints if joint.shared is not None}

    @property
    def plan_outputs(self) -> tuple[str, ...]:
        """DOFs that a further measurement may add: those of the plan, or each translation along that of the joint."""
        joint = self.joint or next(iter(self.joints.values()), None)
        if joint is None:  # of a set-up in which nothing is joined
            return self.plan.outputs
        direction = joint.directions[0]
        every = (f"{point}:{direction}" for point in self.structure.points_in_order)
        free = (label for label in every if label not in self.structure.supports)
        return self.plan.outputs or tuple(label for label in free if self.structure.absent(label) is None)

    @property
    def plan_inputs(self) -> tuple[str, ...]:
        """DOFs that may be excited for a further measurement: those of the plan, or the inputs of FRF data."""
        return self.plan.inputs or getattr(self.data, "inputs", ())

    @property
    def joint_objects(self) -> Joint | tuple[Joint, ...]:
        """Where the joints act; a lone one without a name by itself."""
        joints = tuple(joint.built(name) for name, joint in self.all_joints.items())
        return joints[0] if joints and self.joint is not None else joints

    @property
    def parametrisation(self) -> Parametrisation:
        """Coordinates of all joints."""
        from jointbayes.joint import blocks_of

        by_name = {name: joint.parametrisation_object for name, joint in self.all_joints.items()}
        return blocks_of({**by_name, **self.sharing})

    def leaves_out(self, setup: str) -> bool:
        """Whether a set-up does not enter the estimate."""
        return setup in self.left_out.setups

    def joint_of_setup(self, setup: str, name: str) -> tuple[str, str]:
        """Names of a joint of a set-up, and of the one whose quantities it has, among the joints of all set-ups."""
        owner = self.sharing.get(name, name)
        if not self.all_joints[owner].own:
            return name, owner
        return prefixed(setup, name) if name else setup, prefixed(setup, owner) if owner else setup

    def _findings(self) -> Iterator[Finding]:
        """Yield DOFs that do not exist, else what no object can be, else where tables do not agree with each other."""
        found = list(self._dof_findings())
        if not found:
            BEFORE_OBJECTS.get()()
            found = list(self.object_findings()) or list(self._table_findings())
        yield from found

    def _dof_findings(self) -> Iterator[Finding]:
        return rules.dof_findings(self.structure, self.all_joints, self.data, self.plan, self.measured_labels)

    def _table_findings(self) -> Iterator[Finding]:
        yield from self._setup_findings()
        if self.joined and not self.all_joints:
            yield Finding(("joint",), missing=True)
            return
        yield from self._body_findings()
        yield from rules.joints_findings(self.joint, self.joints, self.prior)
        if self.prior is not None and self.joint is not None:
            yield from rules.prior_findings(self.joint, self.prior)
        truth = self.synthetic.truth if self.synthetic else None
        lone_pair = self.joint is not None and self.joint.kind == "coupled" and not self.joint.damping
        named: dict[KeyPath, NamedStiffnessSpec | None] = {("data", "truth"): truth, ("reference",): self.reference}
        for loc, stated in named.items():
            if stated is not None and self.joined:
                yield from rules.stiffness_names_findings(loc, stated, self.all_quantities, lone_pair=lone_pair)
        yield from rules.uncertain_findings(self.uncertain, self.structure, self.data)
        yield from rules.truth_findings(self.structure, self.data)
        yield from rules.noise_findings(self.noise, self.uncertain.model_error, self.data)
        yield from rules.left_out_findings(
            self.left_out, self.data, self.noise, list(self.setups), self.all_joints.values()
        )
        yield from rules.plan_findings(self.plan, self.data)
        if self.reference is not None and any(joint.own for joint in self.all_joints.values()):
            fault, expected = "found stiffnesses to compare with", "joints that are the same in all set-ups"
            yield Finding(("reference",), fault, expected, "remove [reference]")
        yield from rules.virtual_test_findings(self.virtual_test, self.structure, self.data)

    def _setup_findings(self) -> Iterator[Finding]:
        """Yield names of set-ups that are another thing's, levels of some only, and `own` in a case of one test."""
        others = {"joint": set(self.joints), "body": {*self.bodies, *getattr(self.structure, "bodies", {})}}
        for name in self.setups:
            for what, names in others.items():
                if name in names:
                    fault = f"found the name of a {what}, so that {name}.k11 would be two things"
                    yield Finding(("setups", name), fault, "a name of its own", "rename one of the two")
        joined = {name: setup for name, setup in self.setups.items() if setup.joined}
        levels = {name: setup.level for name, setup in joined.items()}
        yield from rules.level_findings(self.level, levels)
        if self.assembly is not None and self.joined:
            yield from rules.assembly_findings(levels, self.all_joints)
        for name, proposed in self.plan.setups.items():
            loc = ("plan", "setups", name)
            if name in self.setups:
                yield Finding(loc, "found the name of a present set-up", "a name of its own", "rename it")
            if proposed.data is not None and self.data.kind != "synthetic_frf":
                fault = f'found a table beside data of kind = "{self.data.kind}"'
                expected = "a set-up that is measured as the present one"
                yield Finding((*loc, "data"), fault, expected, "remove it; other DOFs are candidates by themselves")
        if not self.setups and not self.plan.setups:
            owned = [
                *(joint_table(name) for name, joint in self.all_joints.items() if joint.own),
                *(quantity_table(name) for name, prior in self.uncertain.given.items() if prior.own),
                *([("noise",)] if self.noise.own else []),
                *([quantity_table("model_error")] if (error := self.uncertain.model_error) and error.own else []),
            ]
            for table in owned:
                fault, expected = "found true in a case of one test", "several, as [setups.long]"
                yield Finding((*table, "own"), fault, expected, "remove it")

    def _body_findings(self) -> Iterator[Finding]:
        """Yield what measured bodies cannot stand beside."""
        owners: dict[str, str] = {}
        for name, body in self.bodies.items():
            if not POINT.fullmatch(name):
                fault = f'found the name "{re.sub(r"[^ -~]", "?", name)[:40]}"'
                expected = "a name of letters, digits, _ and -, a letter first"
                yield Finding(("bodies", name), fault, expected, "rename")
            for label in body.labels:
                other, modelled = owners.setdefault(label, name), self.structure.absent(label) is None
                if other != name or modelled:
                    where = f"[bodies.{other}]" if other != name else "[structure]"
                    fault = f'found "{label}", which is a DOF of {where} as well'
                    yield Finding(("bodies", name, "channels"), fault, "labels of its own", "give it another point")
            if body.propagate != next(iter(self.bodies.values())).propagate:
                fault, expected = f"found {str(body.propagate).lower()}", "the same in all bodies"
                yield Finding(("bodies", name, "propagate"), fault, expected, "change it")
        if self.bodies:
            yield from self._measured_body_findings()

    def _measured_body_findings(self) -> Iterator[Finding]:
        """Yield data and quantities that need modes, and joints between measured bodies alone without priors."""
        beside = "beside a body that is given by its FRFs and has no modes"
        if not (self.data.frfs and self.files):
            fault = f'found "{self.data.kind}" {beside}'
            yield Finding(("data", "kind"), fault, 'kind = "measured_frf"', "write it so")
        if self.structure.damping.measured:
            expected = "damping ratios of the modelled structure by itself"
            yield Finding(("structure", "damping", "ratio"), f'found "measured" {beside}', expected, "state them")
        for name, joint in self.stating_joints.items():
            modelled = any(self.structure.absent(side[0]) is None for side in (joint.dofs, joint.against) if side)
            if joint.coordinates and self.priors_of(name) is None and not modelled:
                expected = "one for a joint that no modelled body has a side of, whose size nobody knows"
                yield Finding(prior_table(name), "found no prior", expected, "state it")
