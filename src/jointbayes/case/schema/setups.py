"""The `[setups.NAME]` and `[level]` tables of a case file, and the rules between the set-ups of one case."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, Strict

from jointbayes.case.case_text import CaseText
from jointbayes.case.errors import Finding
from jointbayes.case.schema.fields import Spec, either, key_field
from jointbayes.case.toml_text import similar
from jointbayes.joint.quantities import prefixed, without_damping

if TYPE_CHECKING:
    from jointbayes.case.schema.case import CaseSpec
    from jointbayes.case.schema.joint import JointSpec


#: What must be the same in joints that share their quantities.
ALIKE = ("kind", "directions", "parametrisation", "viscous", "loss_factors")

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")
_LEVEL = key_field("the level of the test in the unit of [level], a number", 2.0)
_LEVEL_NAME = Field(
    min_length=1,
    max_length=60,
    pattern=r"^[^\r\n]+$",
    description="what the level is, a short text",
    examples=["torque"],
)
_LEVEL_UNIT = Field(
    max_length=20, pattern=r"^[^\r\n]*$", description="the unit of the level, a short text", examples=["N m"]
)
_REMOVE = key_field("a list of keys or tables of the rest of the file that this set-up does not take", ["prior.k12"])


def _changes(of: str) -> object:
    return Field(description=f"what is different in {of}, a table")


_Table = dict[str, Any] | None


class SetupSpec(Spec):
    """One test of several: what is different from the rest of the file, whose tables these are."""

    level: Annotated[float | None, _LEVEL] = None
    remove: Annotated[tuple[str, ...], Strict(False), _REMOVE] = ()
    structure: Annotated[_Table, _changes("the structure")] = None
    joint: Annotated[_Table, _changes("the joint")] = None
    joints: Annotated[_Table, _changes("the joints")] = None
    bodies: Annotated[_Table, _changes("the measured bodies")] = None
    prior: Annotated[_Table, _changes("the priors of a joint of its own")] = None
    uncertain: Annotated[_Table, _changes("what else is uncertain")] = None
    data: Annotated[_Table, _changes("the data")] = None
    noise: Annotated[_Table, _changes("how residuals are judged")] = None
    virtual_test: Annotated[_Table, _changes("how `simulate` measures")] = None


class PlannedSetupSpec(Spec):
    """A test that could be made: what is different from the rest of the file, whose tables these are."""

    remove: Annotated[tuple[str, ...], Strict(False), _REMOVE] = ()
    structure: Annotated[_Table, _changes("the structure")] = None
    joint: Annotated[_Table, _changes("the joint")] = None
    joints: Annotated[_Table, _changes("the joints")] = None
    uncertain: Annotated[_Table, _changes("what else is uncertain")] = None
    data: Annotated[_Table, _changes("the data")] = None


class LevelSpec(Spec):
    """What the levels of the set-ups are: a torque, a drive level, a temperature."""

    name: Annotated[str, _LEVEL_NAME]
    unit: Annotated[str, _LEVEL_UNIT] = ""


def setups_findings(spec: CaseSpec) -> Iterator[Finding]:
    """Yield names of set-ups that are none or another's, levels of some only, and `own` in a case of one test."""
    others = {"joint": set(spec.joints), "body": {*spec.bodies, *getattr(spec.structure, "bodies", {})}}
    for name in spec.setups:
        if not _NAME.fullmatch(name):
            expected = "a name of letters, digits, _ and -, at most 40, a letter first"
            yield Finding(("setups", name), "found a name that tables and figures cannot show", expected, "rename it")
        for what, names in others.items():
            if name in names:
                found = f"found the name of a {what}, so that {name}.k11 would be two things"
                yield Finding(("setups", name), found, "a name of its own", "rename one of the two")
    levels = {name: setup.level for name, setup in spec.setups.items()}
    given = [name for name, level in levels.items() if level is not None]
    if given and spec.level is None:
        found, expected = f"found a level of {given[0]}, of nothing that is named", '[level] with a name, as "torque"'
        yield Finding(("setups", given[0], "level"), found, expected, "add a table [level]")
    elif spec.level is not None and (len(given) < len(levels) or not levels):
        without = next((name for name, level in levels.items() if level is None), "")
        found = f"found no level of set-up {without}" if without else "found no set-ups"
        yield Finding(("level",), found, "a level in the table of each set-up", "add level = 2.0 or remove [level]")
    elif given and len({levels[name] for name in given}) < 2:
        found = f"found the level {levels[given[0]]:g} alone, so that there is nothing to compare"
        yield Finding(("level",), found, "two levels at least that differ", "correct the levels or remove [level]")
    yield from planned_findings(spec)
    if not spec.setups and not spec.plan.setups:
        yield from _own_of_one(spec)


def planned_findings(spec: CaseSpec) -> Iterator[Finding]:
    """Yield names of proposed set-ups that are none or a present one's, and data that a plan cannot make."""
    for name, proposed in spec.plan.setups.items():
        loc = ("plan", "setups", name)
        if not _NAME.fullmatch(name):
            expected = "a name of letters, digits, _ and -, at most 40, a letter first"
            yield Finding(loc, "found a name that tables and figures cannot show", expected, "rename it")
        if name in spec.setups:
            yield Finding(loc, "found the name of a present set-up", "a name of its own", "rename it")
        if proposed.data is not None and spec.data.kind != "synthetic_frf":
            found = f'found a table beside data of kind = "{spec.data.kind}"'
            expected = "a set-up that is measured as the present one"
            yield Finding((*loc, "data"), found, expected, "remove it; other DOFs are candidates by themselves")


def _own_of_one(spec: CaseSpec) -> Iterator[Finding]:
    """Yield `own` where there is nothing that others could share."""
    owned: list[tuple[str | int, ...]] = [
        *((("joints", name) if name else ("joint",)) for name, joint in spec.all_joints.items() if joint.own),
        *(_place_of(name) for name, prior in spec.uncertain.given.items() if prior.own),
        *([("noise",)] if spec.noise.own else []),
    ]
    for loc in owned:
        yield Finding((*loc, "own"), "found true in a case of one test", "several, as [setups.long]", "remove it")


def _place_of(quantity: str) -> tuple[str, ...]:
    body, _, name = quantity.rpartition(".")
    return ("uncertain", "bodies", body, name) if body else ("uncertain", name)


def joint_of_setup(setup: str, name: str, spec: CaseSpec) -> tuple[str, str]:
    """Names of a joint of a set-up, and of the one whose quantities it has, among the joints of all set-ups."""
    joints = spec.all_joints
    owner = spec.sharing.get(name, name)
    if not joints[owner].own:
        return name, owner
    named, owning = (prefixed(setup, one) if one else setup for one in (name, owner))
    return named, owning


def _quantities_of_setups(specs: Mapping[str, CaseSpec]) -> tuple[str, ...]:
    """Names of the stiffnesses of the joints of all set-ups, those that are shared once."""
    found = (
        prefixed(joint_of_setup(setup, name, spec)[0], quantity.name)
        for setup, spec in specs.items()
        for name, joint in spec.all_joints.items()
        if name not in spec.sharing
        for quantity in joint.quantities
    )
    return tuple(dict.fromkeys(found))


def parameter_findings(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield set-up and finding where the plan wants to know a stiffness that no set-up has."""
    known = _quantities_of_setups(specs)
    for setup, spec in specs.items():
        wanted = spec.plan.parameter
        if not wanted or wanted in known:
            continue
        nearest = similar(wanted, known)
        expected, remedy = "no plan, since no joint has a stiffness", "remove it"
        if known:
            expected = "the stiffness to be known best, " + either(f'"{name}"' for name in known)
            remedy = f'did you mean "{nearest}"?' if nearest else f'write for example parameter = "{known[0]}"'
        yield setup, Finding(("plan", "parameter"), f'found "{wanted}"', expected, remedy)


def hypotheses_findings(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield set-up and finding where a hypothesis leaves out a damping that no joint has."""
    if any(joint.damping for spec in specs.values() for joint in spec.all_joints.values()):
        return
    for setup, spec in specs.items():
        for i, name in enumerate(spec.compare.hypotheses):
            undamped, springs = without_damping(name)
            if undamped:
                found = f'found "{name}" of joints without damping, which is "{springs}"'
                expected = "hypotheses on the springs, or viscous or loss_factors in the joint"
                yield setup, Finding(("compare", "hypotheses", i), found, expected, "remove it")


def between_setups(specs: Mapping[str, CaseSpec], texts: Mapping[str, CaseText]) -> Iterator[tuple[str, Finding]]:
    """Yield set-up and finding where set-ups share what cannot be one: quantities of unlike joints, priors, spreads."""
    if list(specs) == [""]:
        return
    known: dict[str, tuple[str, JointSpec]] = {}
    for setup, spec in specs.items():
        for name, joint in spec.all_joints.items():
            place = ("joints", name) if name else ("joint",)
            if not joint.own:
                yield from ((setup, one) for one in _stated_alone(texts[setup], joint, place))
            if name in spec.sharing:
                continue
            first, other = known.setdefault(joint_of_setup(setup, name, spec)[1], (setup, joint))
            unlike = [what for what in ALIKE if getattr(joint, what) != getattr(other, what)]
            if unlike:
                key = "dofs" if unlike[0] == "directions" else unlike[0]
                found = (
                    f"found another {' and '.join(unlike)} than in set-up {first}, with which it shares its quantities"
                )
                yield (
                    setup,
                    Finding((*place, key), found, "joints alike, or own = true", "make them alike or add own = true"),
                )
    yield from _unlike_spreads(specs)
    yield from _unlike_priors(specs)
    yield from _shared_bodies(specs)


def _shared_bodies(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield a body whose one measurement several set-ups have, so that its errors would be counted as independent."""
    first: dict[tuple[str, str], str] = {}
    for setup, spec in specs.items():
        for name, body in spec.bodies.items():
            if not body.propagate:
                continue
            read = [(file, channel) for file in body.file for channel in body.channels]
            other, (file, _) = next(((first[one], one) for one in read if one in first), (setup, ("", "")))
            if other != setup:
                found = f"found {file} in set-ups {other} and {setup}, with one error that would count as one of each"
                expected = "a measurement of the body for each set-up, or one set-up"
                yield setup, Finding(("bodies", name), found, expected, "state another file, or remove a set-up")
            first |= {one: first.get(one, setup) for one in read}


def integral_findings(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield one factor on the noise of several set-ups to be integrated out: each likelihood integrates its own."""
    sharing = [name for name, spec in specs.items() if spec.noise.scale == "integrated" and not spec.noise.own]
    for setup in sharing[1:]:
        found = 'found "integrated" for one factor of several set-ups, of which each has its own'
        expected = 'own = true for a factor of each, or scale = "sampled" for one of all'
        yield setup, Finding(("noise", "scale"), found, expected, "add own = true to [noise]")


def _stated_alone(text: CaseText, joint: JointSpec, place: tuple[str, ...]) -> Iterator[Finding]:
    """Yield a prior or a first guess that a set-up states of a joint which is that of all."""
    priors = ("prior",) if place == ("joint",) else (*place, "prior")
    for key in (priors, (*place, "initial")):
        if key in text.own:
            found = "found it for one set-up, of a joint that all set-ups share"
            yield Finding(key, found, "own = true in the table of the joint", "add it, or state this for all set-ups")


def _unlike_priors(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield a prior of an uncertain quantity, or of the noise, that set-ups share and of which they state others."""
    first: dict[tuple[str, ...], tuple[str, object]] = {}
    for setup, spec in specs.items():
        shared: dict[tuple[str, ...], object] = {
            _place_of(name): prior for name, prior in spec.uncertain.given.items() if not prior.own
        }
        if spec.noise.inferred and not spec.noise.own:
            noise = spec.noise
            if noise.scale == "sampled":
                shared["noise",] = noise.scale_low_factor, noise.scale_high_factor
            if noise.discrepancy is not None:
                shared["noise", "discrepancy"] = noise.discrepancy
        for place, prior in shared.items():
            other, there = first.setdefault(place, (setup, prior))
            if prior != there:
                found = f"found another prior than in set-up {other}, with which it shares the quantity"
                yield setup, Finding(place, found, "one for all, or own = true", "state one, or add own = true")


def _unlike_spreads(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield a factor that several set-ups share with a standard deviation in mm of lengths that differ."""
    first: dict[str, tuple[str, float]] = {}
    for setup, spec in specs.items():
        for name, prior in spec.uncertain.given.items():
            if prior.own or name.rpartition(".")[2] != "length" or getattr(prior, "sd_mm", None) is None:
                continue
            length = spec.structure.stated[name][1]
            other, there = first.setdefault(name, (setup, length))
            if length != there:
                found = f"found one factor for lengths of {there:g} mm in {other} and {length:g} mm in {setup}"
                expected = "sd_percent, own = true for an error of each, or [uncertain.length_offset] for one of all"
                yield setup, Finding((*_place_of(name), "sd_mm"), found, expected, "choose one of these")
