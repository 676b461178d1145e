"""The case file: its TOML schema as frozen models, and the reader that names every fault by file, line, key.

Each field's ``description`` is also the "expected …" of its error messages, and its first example the remedy.
Units are in the keys; nothing is converted here. Importing this module loads pydantic.

The tables stand in modules of their own; here they come together, with the rules between them: what one table says must
be possible with what another one says.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from typing import TYPE_CHECKING, Annotated

from pydantic import BeforeValidator, Field

from jointbayes.case.spec import data_table
from jointbayes.case.spec import settings_tables as settings
from jointbayes.case.spec.fields import (
    JOINED,
    Finding,
    KeyPath,
    Name,
    Spec,
    Word,
    key_field,
    listed,
    show_key,
    table_field,
)
from jointbayes.case.spec.prior_tables import (
    JointSpec,
    NamedJointSpec,
    NamedStiffnessSpec,
    PriorsSpec,
    UncertainSpec,
    joint_table,
    prior_table,
    quantity_table,
)
from jointbayes.case.spec.structure_tables import (
    BeamSpec,
    ChainSpec,
    FrameSpec,
    ImportedSpec,
    MatricesSpec,
    StructureBase,
)
from jointbayes.joint import COORDINATES
from jointbayes.joint.quantities import prefixed

if TYPE_CHECKING:
    from jointbayes.joint import Joint, Parametrisation


_TITLE = key_field(
    "a text of one line, at most 200 characters", "Clamped beam", min_length=1, max_length=200, pattern=r"^[^\r\n]*$"
)


_EXTENDS = key_field("the name of the case file whose keys this one starts from, relative to this file", "base.toml")


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
    """A whole case file; of one that builds on another what both are together, without `extends`.

    Of several tests it is the case of one: the rest of the file with what the test changes.
    """

    extends: Annotated[str, _EXTENDS] = ""
    title: Annotated[str, _TITLE] = ""
    about: settings.AboutSpec = table_field(
        "what was tested: specimen, date, operator, instruments", settings.AboutSpec()
    )
    tests: dict[Name, settings.TestSpec] = table_field(
        "several tests of the same joints, a table for each, as [tests.long]", {}
    )
    structure: StructureSpec
    joined: Annotated[bool, JOINED] = True
    joint: JointSpec | None = table_field("the joint: dofs, initial", None)
    joints: dict[Name, NamedJointSpec] = table_field(
        "several joints, a table for each by its name, as [joints.left]", {}
    )
    bodies: dict[Word, data_table.MeasuredBodySpec] = table_field(
        "bodies given by their measured FRFs, a table for each by its name, as [bodies.spindle]", {}
    )
    prior: PriorsSpec | None = table_field("a table for the prior of each parameter, as [prior.k11]", None)
    uncertain: UncertainSpec = table_field(
        "a table for each uncertain quantity, as [uncertain.length]", UncertainSpec()
    )
    data: data_table.DataSpec
    noise: settings.NoiseModelSpec = table_field("how residuals are judged", settings.NoiseModelSpec())
    left_out: settings.LeftOutSpec = table_field(
        "data that are left out: modes, bands_hz, tests", settings.LeftOutSpec()
    )
    identification: settings.IdentificationSpec = table_field(
        "settings of the iteration", settings.IdentificationSpec()
    )
    sampling: settings.SamplingSpec = table_field("settings of the sampler", settings.SamplingSpec())
    compare: settings.CompareSpec = table_field("the hypotheses to compare", settings.CompareSpec())
    predict: settings.PredictSpec | None = table_field(
        "what `predict` is to compute of this structure: DOFs and lines", None
    )
    reference: settings.ReferenceSpec | None = table_field("published values to compare with", None)
    verdict: dict[str, settings.VerdictSpec] = table_field(
        "thresholds of verdicts, a table for a stiffness, as [verdict.k22]", {}
    )

    @property
    def all_joints(self) -> dict[str, JointSpec]:
        """Every joint by its name; a lone one has none. None where nothing is joined."""
        if not self.joined:
            return {}
        return dict(self.joints) if self.joint is None else {"": self.joint}

    @property
    def synthetic(self) -> data_table.SyntheticFrfSpec | None:
        """The table of the data, if a stated truth makes them."""
        return self.data if isinstance(self.data, data_table.SyntheticFrfSpec) else None

    @property
    def files(self) -> data_table.MeasuredFrfSpec | data_table.MeasuredFrequenciesSpec | None:
        """The table of the data, if they are in measurement files."""
        return self.data if isinstance(self.data, data_table.MeasuredSpec) else None

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
        """Joints that share the quantities of another joint, by name."""
        joints = self.joints.items() if self.joined and self.joint is None else ()
        return {name: joint.shared for name, joint in joints if joint.shared is not None}

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

    def built(self) -> Parametrisation:
        """What the joints are together, some with the quantities of another."""
        return self.parametrisation

    def leaves_out(self, test: str) -> bool:
        """Whether a test does not enter the estimate."""
        return test in self.left_out.tests

    def joint_of_test(self, test: str, name: str) -> tuple[str, str]:
        """Names of a joint of a test, and of the one whose quantities it has, among the joints of all tests."""
        owner = self.sharing.get(name, name)
        if not self.all_joints[owner].own:
            return name, owner
        return prefixed(test, name) if name else test, prefixed(test, owner) if owner else test

    def _findings(self) -> Iterator[Finding]:
        """Yield what no structure is, else DOFs it lacks, else what no object can be, else where tables disagree."""
        BEFORE_OBJECTS.get()()
        yield from (
            list(self.structure.object_findings(("structure",)))
            or list(_dof_findings(self))
            or list(self.object_findings())
            or [finding for rule in _RULES for finding in rule(self)]
        )


_SUPPORTS = "structure", "supports"
_FRF_ONLY = 'data of kind = "synthetic_frf" or "measured_frf"'


def _dof_findings(case: CaseSpec) -> Iterator[Finding]:
    """Yield DOFs that the structure does not have or that cannot move, and frequencies it has too few DOFs for."""
    structure, data = case.structure, case.data
    labelled: dict[KeyPath, tuple[str, ...]] = {_SUPPORTS: structure.supports}
    for name, joint in case.all_joints.items():
        place = joint_table(name)
        labelled |= {(*place, "dofs"): joint.dofs, (*place, "against"): joint.against}
    free = structure.free_dofs
    for key_path, count in data.least_modes.items():
        refined = structure.spans is None and getattr(structure, "element", "") == "converged"  # as far as it takes
        if count > free and not refined:
            remedy = "raise structure.elements" if structure.spans else "remove the highest"
            yield Finding(key_path, f"{count} frequencies for {free} free DOFs", f"at most {free} frequencies", remedy)
    yield from _immovable_dofs(case, {**labelled, **data.labelled})
    yield from _loose_masses(case)
    if case.files is not None:
        yield from _channel_findings(structure, case.files)


def _loose_masses(case: CaseSpec) -> Iterator[Finding]:
    """Yield the first mass of a chain that no spring, damper, support or joint holds, because it moves by itself."""
    structure = case.structure
    if not isinstance(structure, ChainSpec) or len(structure.masses_kg) == 1:
        return
    joints = case.all_joints.values()
    labels = [*structure.supports, *(label for joint in joints for label in (*joint.dofs, *joint.against))]
    joined = {label.rpartition(":")[0] for label in labels}
    pairs = [*(spring.between for spring in structure.springs), *(damper.between for damper in structure.dampers)]
    joined |= {name for pair in pairs for name in pair}
    if loose := [name for name in structure.masses_kg if name not in joined]:
        found = f"found a mass that is joined to nothing, one of {len(loose)}"
        yield Finding(("structure", "masses_kg", loose[0]), found, "a spring or a joint at each mass", "add it")


def _immovable_dofs(case: CaseSpec, labelled: Mapping[KeyPath, Sequence[str]]) -> Iterator[Finding]:
    """Yield DOFs, by their keys, that neither the structure nor a measured body has, or that cannot move."""
    for loc, i, label in ((loc, i, label) for loc, labels in labelled.items() for i, label in enumerate(labels)):
        absent = None if label in case.measured_labels else case.structure.absent(label)
        if absent is not None:
            yield Finding((*loc, i), *absent)
        elif label in case.structure.supports and loc != _SUPPORTS:
            fault = f'found "{label}", which is held fixed by structure.supports'
            yield Finding((*loc, i), fault, "a DOF that can move", "choose another or free this one")


def _channel_findings(structure: StructureBase, data: data_table.MeasuredSpec) -> Iterator[Finding]:
    """Yield masses that are counted twice or at a rotation, and rotations of a structure without such points."""
    for name, channel in data.channels.items():
        loc = ("data", "channels", name)
        if channel.accelerometer_mass_g > 0 and structure.accelerometer_mass_g > 0:
            fault = "accelerometer_mass_g is given here and in [structure]"
            expected = "the mass taken out of the data or put into the model, not both"
            yield Finding((*loc, "accelerometer_mass_g"), fault, expected, "remove one of the two")
        if channel.accelerometer_mass_g > 0 and ":r" in channel.label:
            fault = f'found a mass at "{channel.label}", a rotation'
            yield Finding((*loc, "accelerometer_mass_g"), fault, "a mass at a translation", "remove it")
    if data.accelerometers == "roving" and structure.accelerometer_mass_g > 0:
        fault = 'found "roving" with a mass in [structure], which the model carries at every measured DOF at once'
        expected = "the mass of a roving sensor at its channels, to be taken out of the data"
        yield Finding(
            ("data", "accelerometers"), fault, expected, "move the mass to accelerometer_mass_g of the channels"
        )
    rotations = getattr(data, "rotations", {})
    if rotations and structure.spans is None:
        fault = f'found rotations in a structure of kind = "{structure.kind}"'
        yield Finding(("data", "rotations"), fault, 'kind = "beam", whose points are evenly spaced', "remove it")
        return
    for label, rotation in rotations.items():
        loc, last = ("data", "rotations", label), (structure.spans or 0) + 1
        nodes = [int(station.split(":")[0]) for station in rotation.stations]
        steps = {b - a for a, b in itertools.pairwise(nodes)}
        if len(steps) != 1 or 0 in steps or max(nodes) > last:
            fault = f"found nodes {', '.join(map(str, nodes))}"
            expected = f"different nodes, evenly spaced in one direction, from 1 to {last}"
            yield Finding((*loc, "stations"), fault, expected, "correct the stations")
        if (words := structure.absent(label)) is not None:
            yield Finding(loc, *words)


def _test_findings(case: CaseSpec) -> Iterator[Finding]:
    """Yield names of tests that are another thing's, and `own` in a case of one test."""
    others = {"joint": set(case.joints), "body": {*case.bodies, *getattr(case.structure, "bodies", {})}}
    for name in case.tests:
        for what, names in others.items():
            if name in names:
                fault = f"found the name of a {what}, so that {name}.k11 would be two things"
                yield Finding(("tests", name), fault, "a name of its own", "rename one of the two")
    if not case.tests:
        owned = [
            *(joint_table(name) for name, joint in case.all_joints.items() if joint.own),
            *(quantity_table(name) for name, prior in case.uncertain.given.items() if prior.own),
            *([("noise",)] if case.noise.own else []),
            *([quantity_table("model_error")] if (error := case.uncertain.model_error) and error.own else []),
        ]
        for table in owned:
            fault, expected = "found true in a case of one test", "several, as [tests.long]"
            yield Finding((*table, "own"), fault, expected, "remove it")


def _body_findings(case: CaseSpec) -> Iterator[Finding]:
    """Yield what measured bodies cannot stand beside: others of one DOF, and data and quantities that need modes."""
    owners: dict[str, str] = {}
    for name, body in case.bodies.items():
        for label in body.labels:
            other, modelled = owners.setdefault(label, name), case.structure.absent(label) is None
            if other != name or modelled:
                where = f"[bodies.{other}]" if other != name else "[structure]"
                fault = f'found "{label}", which is a DOF of {where} as well'
                yield Finding(("bodies", name, "channels"), fault, "labels of its own", "give it another point")
        if body.propagate != next(iter(case.bodies.values())).propagate:
            fault, expected = f"found {str(body.propagate).lower()}", "the same in all bodies"
            yield Finding(("bodies", name, "propagate"), fault, expected, "change it")
    if not case.bodies:
        return
    beside = "beside a body that is given by its FRFs and has no modes"
    if not (case.data.frfs and case.files):
        fault = f'found "{case.data.kind}" {beside}'
        yield Finding(("data", "kind"), fault, 'kind = "measured_frf"', "write it so")
    if case.structure.damping.measured:
        expected = "damping ratios of the modelled structure by itself"
        yield Finding(("structure", "damping", "ratio"), f'found "measured" {beside}', expected, "state them")
    for name, joint in case.stating_joints.items():
        modelled = any(case.structure.absent(side[0]) is None for side in (joint.dofs, joint.against) if side)
        priors = case.priors_of(name)
        lacking = [axis.name for axis in joint.coordinates if getattr(priors, axis.name, None) is None]
        if lacking and not modelled:
            expected = "one for each stiffness of a joint between bodies that are given by their FRFs"
            yield Finding(prior_table(name), f"found no prior of {', '.join(lacking)}", expected, "state it")


def _joint_findings(case: CaseSpec) -> Iterator[Finding]:
    """Yield joints that are stated twice or not at all, with other priors than theirs, or that share with unlike ones.

    And stiffnesses of a truth, or published ones, that are others than the joints have.
    """
    if case.joined and not case.all_joints:
        yield Finding(("joint",), missing=True)
        return
    if case.joints and case.joint is not None:
        yield Finding(("joint",), "found [joint] and [joints]", "one joint or several", "move [joint] to [joints.NAME]")
    if case.joints and case.prior is not None:
        expected = "the priors of several joints in their tables, as [joints.left.prior.k11]"
        yield Finding(("prior",), "found [prior] with [joints]", expected, "move each to the table of its joint")
    for name, shared in case.joints.items():
        if shared.shared is not None:
            yield from _sharing_findings(name, shared, case.joints)
    for name, joint in case.stating_joints.items():
        if (priors := case.priors_of(name)) is not None:
            yield from _prior_findings(joint, priors, prior_table(name))
    lone_pair = case.joint is not None and case.joint.kind == "coupled" and not case.joint.damping
    truth = case.synthetic.truth if case.synthetic else None
    named: dict[KeyPath, NamedStiffnessSpec | None] = {("data", "truth"): truth, ("reference",): case.reference}
    for loc, spec in named.items() if case.joined else ():
        each = ", ".join(quantities := case.all_quantities)
        if spec is not None and spec.stiffness is None and not lone_pair:
            fault, remedy = "found k11, k12 and k22 of a coupled pair", f"write [{'.'.join(map(str, loc))}.stiffness]"
            yield Finding(loc, fault, f"a table stiffness with {each}", remedy)
        elif spec is not None and spec.stiffness is not None:
            odd = [name for name in spec.stiffness_by_name if name not in quantities]
            missing = [name for name in quantities if name not in spec.stiffness_by_name]
            for fault in (*(f'found "{name}"' for name in odd), *(f"found no {name}" for name in missing)):
                yield Finding((*loc, "stiffness"), fault, f"one number for each of {each}", "correct the names")
    if case.reference is not None and any(joint.own for joint in case.all_joints.values()):
        fault, expected = "found stiffnesses to compare with", "joints that are the same in all tests"
        yield Finding(("reference",), fault, expected, "remove [reference]")


def _sharing_findings(name: str, joint: NamedJointSpec, joints: Mapping[str, NamedJointSpec]) -> Iterator[Finding]:
    """Yield a joint that shares the quantities of an unlike one, or states what that one does."""
    loc, other = ("joints", name, "shared"), joints.get(joint.shared or "")
    if other is not None and (unlike := joint.unlike(other)):
        fault = f'found "{joint.shared}", a joint with another {" and ".join(unlike)}'
        expected = "a joint of the same kind, directions, parametrisation and damping"
        yield Finding(loc, fault, expected, "make them alike or remove it")
    for what in ("prior", "initial"):
        if getattr(joint, what) is not None:
            fault = f'found a {what} with shared = "{joint.shared}"'
            yield Finding(("joints", name, what), fault, f"the {what} of {joint.shared} alone", "remove it")


def _prior_findings(joint: JointSpec, priors: PriorsSpec, at: tuple[str, ...]) -> Iterator[Finding]:
    """Yield priors that the parametrisation of the joint has no use for."""
    needed, parametrisation = [axis.name for axis in joint.coordinates], joint.parametrisation
    given = {name for name in PriorsSpec.model_fields if getattr(priors, name) is not None}
    missing = [name for name in needed if name not in given]
    for name in sorted(given.difference(needed)):
        fault, other = f'there is no {name} with joint.parametrisation = "{parametrisation}"', None
        if joint.kind == "coupled":
            other = next((key for key, axes in COORDINATES.items() if name in {axis.name for axis in axes}), None)
        else:
            fault = f'there is no {name} in a joint of kind = "{joint.kind}" at {", ".join(joint.dofs)}'
        remedy = "remove it"
        if missing:
            meant = missing.pop(-1 if other else 0)
            swap = f'replace it by {meant} or write parametrisation = "{other}"'
            remedy = swap if other else f"rename it to {show_key((*at, meant))}"
        yield Finding((*at, name), fault, f"priors of {', '.join(needed) or 'none'}", remedy)


# Why natural frequencies say nothing about a quantity.
_UNSEEN = {
    "damping_ratio": "undamped natural frequencies do not depend on the damping",
    "loss_factor": "undamped natural frequencies do not depend on the damping",
    "accelerometer_mass": "natural frequencies come without measured DOFs, so the accelerometers are nowhere",
    "gain": "natural frequencies do not depend on the gain",
}


def _uncertain_findings(case: CaseSpec) -> Iterator[Finding]:
    """Yield uncertain quantities that the structure does not have or that the data cannot depend on."""
    uncertain, structure, data = case.uncertain, case.structure, case.data
    mass = structure.accelerometer_mass_g
    yield from _foreign_quantities(uncertain, structure)
    if uncertain.length_offset and not case.joined:  # it would move the free part by the error of the clamp's edge
        fault, expected = "found it in a test with joined = false", "tests in which a clamp holds the part at its edge"
        yield Finding(("uncertain", "length_offset"), fault, expected, "state [uncertain.length] for the free part")
    if uncertain.length and uncertain.length.sd_mm and structure.stated.get("length", ("mm",))[0] != "mm":
        expected = "sd_percent, or [uncertain.bodies.NAME.length] for an error of each body in mm"
        fault = "found one factor for bodies of different lengths"
        yield Finding(("uncertain", "length", "sd_mm"), fault, expected, "choose one of the two")
    if not data.frfs:
        seen = data.depends_on
        if mass > 0 and "accelerometer_mass" not in seen:
            fault = f"found {mass!r}, but {_UNSEEN['accelerometer_mass']}"
            yield Finding(("structure", "accelerometer_mass_g"), fault, f"0, or {_FRF_ONLY}", "remove it")
        for name in uncertain.given:
            if name in _UNSEEN and name not in seen:
                yield Finding(("uncertain", name), _UNSEEN[name], _FRF_ONLY, f"remove [uncertain.{name}]")
        if "damping_ratio" in seen:
            yield from _damping_findings(uncertain, structure)
        return
    yield from _damping_findings(uncertain, structure)
    translations = [label for label in data.loaded if ":r" not in label]
    if mass > 0 and not translations:
        fault = f"found {mass!r}, but data.outputs holds rotations only"
        yield Finding(("structure", "accelerometer_mass_g"), fault, "0, or a measured translation", "remove it")
    if uncertain.accelerometer_mass and mass == 0:
        fault = "factor on structure.accelerometer_mass_g, which is 0"
        remedy = "write for example accelerometer_mass_g = 2.0 in [structure]"
        yield Finding(("uncertain", "accelerometer_mass"), fault, "a mass above 0", remedy)


# Uncertain quantities that are no structure's, or are judged by the damping law.
_OF_NO_STRUCTURE = {"damping_ratio", "loss_factor", "gain"}


def _foreign_quantities(uncertain: UncertainSpec, structure: StructureBase) -> Iterator[Finding]:
    """Yield uncertain quantities that a structure of this kind, or with these bodies, does not have."""
    offered = structure.stated
    for name in uncertain.given:
        if name not in offered and name not in _OF_NO_STRUCTURE:
            fault = f'a structure of kind = "{structure.kind}" without this quantity'
            if name.rpartition(".")[2] == "length" and structure.kind == "frame":
                fault = "a body with members in several directions, offsets or inertias at points, or no such body"
            if name.rpartition(".")[2] == "axial_force":
                fault = "factor on axial_force_n, which is 0 or of no such body"
            expected = f"one of {listed([*offered, *sorted(_OF_NO_STRUCTURE)])}"
            yield Finding(quantity_table(name), fault, expected, "remove it or correct the name of the body")


def _damping_findings(uncertain: UncertainSpec, structure: StructureBase) -> Iterator[Finding]:
    """Yield uncertain damping that the structure does not have, is a factor on zero, or passes the critical one."""
    damping = structure.damping
    for name, law in (("damping_ratio", "modal"), ("loss_factor", "loss_factor")):
        prior, values = getattr(uncertain, name), damping.values.get(name)
        if prior is None or values == ():  # ratios to be measured are above 0 once they are known
            continue
        loc, expected = ("uncertain", name), f'law = "{law}" with a {name.replace("_", " ")} above 0'
        if values is None:
            fault, remedy = f'structure.damping has law = "{damping.law}"', f"remove [uncertain.{name}]"
            if damping.law == "rayleigh":
                fault += ", and uncertain Rayleigh damping is not offered"
            yield Finding(loc, fault, expected, f"{remedy} or change the law")
        elif min(values) == 0:
            fault = f"factor on structure.damping, where a {name.replace('_', ' ')} is 0"
            yield Finding(loc, fault, expected, "state a value above 0 to which the factor applies")
        elif name == "damping_ratio" and prior.high_factor and max(values) * prior.high_factor >= 1:
            fault = f"found {prior.high_factor!r}, which takes the ratio {max(values)!r} to 1 or above"
            remedy = f"lower high_factor below {1 / max(values):.6g}"
            yield Finding((*loc, "high_factor"), fault, "a factor that leaves the damping ratio below 1", remedy)


def _truth_findings(case: CaseSpec) -> Iterator[Finding]:
    """Yield a truth about damping ratios where the structure has none, and ratios to be measured without a file."""
    structure, made = case.structure, case.synthetic
    if structure.damping.measured and case.files is None:
        fault = f'found "measured" with data of kind = "{case.data.kind}"'
        remedy = "state the ratio: ratio = 0.01"
        expected = 'data of kind = "measured_frf" or "measured_frequencies"'
        yield Finding(("structure", "damping", "ratio"), fault, expected, remedy)
    if made is None:
        return
    truth = made.truth
    for name, key in (("youngs_modulus", "youngs_modulus_gpa"), ("density", "density_kg_m3"), ("length", "length_mm")):
        offered = name in structure.stated and (name != "length" or structure.spans is not None)
        if getattr(truth, key) is not None and not offered:
            fault = f'no {name.replace("_", " ")} of its own in a structure of kind = "{structure.kind}"'
            yield Finding(("data", "truth", key), fault, "the structure as it is analysed", "remove it")
    if truth.damping_ratio is not None and structure.damping.law != "modal":
        fault = f'damping ratio with law = "{structure.damping.law}" in structure.damping'
        yield Finding(("data", "truth", "damping_ratio"), fault, 'law = "modal"', "remove it or change the law")


def _noise_findings(case: CaseSpec) -> Iterator[Finding]:
    """Yield how residuals cannot be judged where the data are natural frequencies, or computed."""
    noise, model_error = case.noise, case.uncertain.model_error
    if case.data.frfs:
        if model_error is not None and case.synthetic is not None:
            fault = "found the model's errors in modes, where the data are computed FRFs"
            yield Finding(
                quantity_table("model_error"), fault, "measured FRFs, modes or natural frequencies", "remove it"
            )
        return
    if model_error is not None and noise.scale != "known":
        fault = f'found "{noise.scale}" with [uncertain.model_error], whose errors would take up the same misfit'
        yield Finding(("noise", "scale"), fault, '"known"', "remove one of the two")
    if noise.distribution != "gaussian":
        fault = f'found "{noise.distribution}", which is offered for FRFs only'
        yield Finding(("noise", "distribution"), fault, _FRF_ONLY, "remove it")


def _verdict_findings(case: CaseSpec) -> Iterator[Finding]:
    """Yield thresholds of a stiffness that there is none of, and such that do not rise."""
    names = list(case.all_quantities)
    names += [prefixed(test, name) for test in case.tests for name in names]
    for name, rule in case.verdict.items():
        if name not in names:
            expected = f"a stiffness of the joint, such as {names[0] if names else 'k11'}"
            yield Finding(("verdict", name), f"found {show_key((name,))}", expected, "correct the name")
        elif rule.identified > rule.weakly_identified:
            found = f"found {rule.identified:g}, above weakly_identified = {rule.weakly_identified:g}"
            remedy = "state both"
            yield Finding(("verdict", name, "identified"), found, "at most weakly_identified", remedy)


def _left_out_findings(case: CaseSpec) -> Iterator[Finding]:
    """Yield what cannot be left out: modes of FRFs, lines of modes, tests that are none, all, or have own joints."""
    left_out, tests = case.left_out, list(case.tests)
    key, other, what = ("modes", "bands_hz", "FRFs") if case.data.frfs else ("bands_hz", "modes", "modes")
    if getattr(left_out, key):
        yield Finding(("left_out", key), f"found it for data that are {what}", other, "write that, or remove it")
    if case.noise.scale == "integrated" and (left_out.modes or left_out.bands_hz or left_out.tests):
        fault = 'found data to be predicted with noise of scale = "integrated"'
        yield Finding(("left_out",), fault, '"known" or "sampled"', 'write scale = "sampled"')
    if left_out.tests and (set(tests) <= set(left_out.tests) or not set(left_out.tests) <= set(tests)):
        fault, expected = f"found {listed(left_out.tests)}", f"some of {listed(tests) or 'several tests'}, not all"
        yield Finding(("left_out", "tests"), fault, expected, "correct the names")
    elif left_out.tests and any(joint.own for joint in case.all_joints.values()):
        fault = "found tests with joints of their own, of which the others say nothing"
        yield Finding(("left_out", "tests"), fault, "joints that tests share", "remove it")


#: Rules between tables that are each right by themselves.
_RULES = (
    _test_findings,
    _body_findings,
    _joint_findings,
    _uncertain_findings,
    _truth_findings,
    _noise_findings,
    _left_out_findings,
    _verdict_findings,
)
