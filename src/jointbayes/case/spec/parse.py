"""From the text of a case file to its checked tables, each test by itself and then all together.

Rules between tables stand in `rules`; here they come together, and those between the tests of one case.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import pydantic

from jointbayes.case.case_faults import fault_lines, fault_paths
from jointbayes.case.case_text import CaseText, case_text, drop_inherited, planned_texts, setup_texts
from jointbayes.case.keys import DATA_FILE, named_files
from jointbayes.case.spec import rules
from jointbayes.case.spec.fields import Finding, KeyPath, either, show_key
from jointbayes.case.spec.joint_table import ALIKE, JointSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import similar
from jointbayes.errors import CaseError
from jointbayes.joint.quantities import prefixed, split_hypothesis


class CheckedCaseSpec(CaseSpec):
    """A case that agrees with itself."""

    def _findings(self) -> Iterator[Finding]:
        yield from setups_findings(self)
        if self.joint is None and not self.joints:
            yield Finding(("joint",), missing=True)
            return
        yield from super()._findings()
        yield from rules.joints_findings(self.joint, self.joints, self.prior)
        yield from rules.dof_findings(self.structure, self.all_joints, self.data, self.plan, self.measured_labels)
        if self.prior is not None and self.joint is not None:
            yield from rules.prior_findings(self.joint, self.prior)
        lone_pair = self.joint is not None and self.joint.kind == "coupled" and not self.joint.damping
        yield from rules.truth_names_findings(self.data, self.all_quantities, lone_pair=lone_pair)
        yield from rules.uncertain_findings(self.uncertain, self.structure, self.data)
        yield from rules.truth_findings(self.structure, self.data)
        yield from rules.noise_findings(self.noise, self.data)
        yield from rules.plan_findings(self.plan, self.data)
        if self.reference is not None and (not lone_pair or any(joint.own for joint in self.all_joints.values())):
            fault, expected = "found k11, k12 and k22 to compare with", "one coupled joint, the same in all set-ups"
            yield Finding(("reference",), fault, expected, "remove [reference]")
        yield from rules.virtual_test_findings(self.virtual_test, self.structure, self.data)


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
    specs, faults, dropped = _checked_each(texts)
    faults += [lines[0] for lines in dropped.values() if len(lines) == len(texts)]  # what no set-up can have
    if not faults:
        between = [*shared_findings(specs, texts), *integral_findings(specs), *parameter_findings(specs)]
        faults = [_told(texts[setup], finding) for setup, finding in (*between, *hypotheses_findings(specs))]
    _raise_faults(faults)
    return specs


def parse_planned(source: CaseText) -> dict[str, CaseSpec]:
    """Read each set-up that the plan of a case proposes by its name; errors are those of `parse_case`."""
    texts = planned_texts(source)
    if not texts:
        return {}
    specs, faults, _ = _checked_each(texts)
    faults += [_told(texts[name], finding) for name, spec in specs.items() for finding in _own_unknowns(spec)]
    if not faults:
        between = shared_findings(parse_setups(source) | specs, setup_texts(source) | texts)
        faults = [_told(texts[name], finding) for name, finding in between if name in texts]
    _raise_faults(faults)
    return specs


def _raise_faults(faults: Sequence[str]) -> None:
    if faults:
        raise CaseError("\n".join(dict.fromkeys(faults)))


def _told(text: CaseText, finding: Finding) -> str:
    """A fault between set-ups in one line."""
    key = show_key(text.written(finding.loc))
    return text.fault(finding.loc, key, finding.found, f"expected {finding.expected}", finding.remedy)


def _own_unknowns(spec: CaseSpec) -> Iterator[Finding]:
    """Yield where a proposed set-up says that a joint, or its noise, is its own."""
    ending, remedy = "of its own, of which the present data say nothing", "remove own, or the set-up from the plan"
    for name, joint in spec.all_joints.items():
        if joint.own:
            loc = (*_joint_table(name), "own")
            yield Finding(loc, f"found a joint {ending}", "one that set-ups share", remedy)
    if spec.noise.own and spec.noise.inferred:
        yield Finding(("noise", "own"), f"found parameters of the noise {ending}", "those that set-ups share", remedy)


def _checked_each(
    texts: Mapping[str, CaseText],
) -> tuple[dict[str, CaseSpec], list[str], dict[KeyPath, list[str]]]:
    """Set-ups without fault, faults of the others; and what they do not take of the whole file, with its faults."""
    specs: dict[str, CaseSpec] = {}
    faults: list[str] = []
    dropped: dict[KeyPath, list[str]] = {}
    for setup, text in texts.items():
        spec, lines, without = _checked(text)
        faults += lines
        for key, line in without.items():
            dropped.setdefault(key, []).append(line)
        if spec is not None:
            specs[setup] = spec
    return specs, faults, dropped


def _checked(text: CaseText) -> tuple[CaseSpec | None, list[str], dict[KeyPath, str]]:
    """One set-up, or its faults; and what it does not take of the rest of the file, each with its fault."""
    without: dict[KeyPath, str] = {}
    while True:
        try:
            return CheckedCaseSpec.model_validate(text.data), [], without
        except pydantic.ValidationError as error:
            lines = fault_lines(error, CaseSpec, text)
            left = [drop_inherited(text, path) for path in fault_paths(error, CaseSpec, text)]
        if not all(left):
            return None, lines, without
        key, text = next(inherited for inherited in left if inherited is not None)
        without[key] = lines[0]


def setups_findings(spec: CaseSpec) -> Iterator[Finding]:
    """Yield names of set-ups that are none or another's, levels of some only, and `own` in a case of one test."""
    others = {"joint": set(spec.joints), "body": {*spec.bodies, *getattr(spec.structure, "bodies", {})}}
    for name in spec.setups:
        for what, names in others.items():
            if name in names:
                fault = f"found the name of a {what}, so that {name}.k11 would be two things"
                yield Finding(("setups", name), fault, "a name of its own", "rename one of the two")
    levels = {name: setup.level for name, setup in spec.setups.items()}
    given = [name for name, level in levels.items() if level is not None]
    if given and spec.level is None:
        fault, expected = f"found a level of {given[0]}, of nothing that is named", '[level] with a name, as "torque"'
        yield Finding(("setups", given[0], "level"), fault, expected, "add a table [level]")
    elif spec.level is not None and (len(given) < len(levels) or not levels):
        without = next((name for name, level in levels.items() if level is None), "")
        fault = f"found no level of set-up {without}" if without else "found no set-ups"
        yield Finding(("level",), fault, "a level in the table of each set-up", "add level = 2.0 or remove [level]")
    elif given and len({levels[name] for name in given}) < 2:
        fault = f"found the level {levels[given[0]]:g} alone, so that there is nothing to compare"
        yield Finding(("level",), fault, "two levels at least that differ", "correct the levels or remove [level]")
    yield from planned_findings(spec)
    if not spec.setups and not spec.plan.setups:
        yield from _own_of_one(spec)


def planned_findings(spec: CaseSpec) -> Iterator[Finding]:
    """Yield names of proposed set-ups that are none or a present one's, and data that a plan cannot make."""
    for name, proposed in spec.plan.setups.items():
        loc = ("plan", "setups", name)
        if name in spec.setups:
            yield Finding(loc, "found the name of a present set-up", "a name of its own", "rename it")
        if proposed.data is not None and spec.data.kind != "synthetic_frf":
            fault = f'found a table beside data of kind = "{spec.data.kind}"'
            expected = "a set-up that is measured as the present one"
            yield Finding((*loc, "data"), fault, expected, "remove it; other DOFs are candidates by themselves")


def _own_of_one(spec: CaseSpec) -> Iterator[Finding]:
    """Yield `own` where there is nothing that others could share."""
    owned: list[tuple[str | int, ...]] = [
        *(_joint_table(name) for name, joint in spec.all_joints.items() if joint.own),
        *(_place_of(name) for name, prior in spec.uncertain.given.items() if prior.own),
        *([("noise",)] if spec.noise.own else []),
    ]
    for loc in owned:
        yield Finding((*loc, "own"), "found true in a case of one test", "several, as [setups.long]", "remove it")


def _joint_table(name: str) -> tuple[str, ...]:
    return ("joints", name) if name else ("joint",)


def _place_of(quantity: str) -> tuple[str, ...]:
    body, _, name = quantity.rpartition(".")
    return ("uncertain", "bodies", body, name) if body else ("uncertain", name)


def _quantities_of_setups(specs: Mapping[str, CaseSpec]) -> tuple[str, ...]:
    """Names of the stiffnesses of the joints of all set-ups, those that are shared once."""
    names = (
        prefixed(spec.joint_of_setup(setup, name)[0], quantity.name)
        for setup, spec in specs.items()
        for name, joint in spec.all_joints.items()
        if name not in spec.sharing
        for quantity in joint.quantities
    )
    return tuple(dict.fromkeys(names))


def parameter_findings(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield set-up and finding where the plan wants to know a stiffness that no set-up has."""
    stiffnesses = _quantities_of_setups(specs)
    for setup, spec in specs.items():
        wanted = spec.plan.parameter
        if not wanted or wanted in stiffnesses:
            continue
        nearest = similar(wanted, stiffnesses)
        expected, remedy = "no plan, since no joint has a stiffness", "remove it"
        if stiffnesses:
            expected = "the stiffness to be known best, " + either(f'"{name}"' for name in stiffnesses)
            remedy = f'did you mean "{nearest}"?' if nearest else f'write for example parameter = "{stiffnesses[0]}"'
        yield setup, Finding(("plan", "parameter"), f'found "{wanted}"', expected, remedy)


def hypotheses_findings(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield set-up and finding where a hypothesis leaves out a damping that no joint has."""
    if any(joint.damping for spec in specs.values() for joint in spec.all_joints.values()):
        return
    for setup, spec in specs.items():
        for i, name in enumerate(spec.compare.hypotheses):
            undamped, springs = split_hypothesis(name)
            if undamped:
                fault = f'found "{name}" of joints without damping, which is "{springs}"'
                expected = "hypotheses on the springs, or viscous or loss_factors in the joint"
                yield setup, Finding(("compare", "hypotheses", i), fault, expected, "remove it")


def shared_findings(specs: Mapping[str, CaseSpec], texts: Mapping[str, CaseText]) -> Iterator[tuple[str, Finding]]:
    """Yield set-up and finding where set-ups share what cannot be one: quantities of unlike joints, priors, spreads."""
    if list(specs) == [""]:
        return
    first_by_quantity: dict[str, tuple[str, JointSpec]] = {}
    for setup, spec in specs.items():
        for name, joint in spec.all_joints.items():
            place = _joint_table(name)
            if not joint.own:
                yield from ((setup, finding) for finding in _stated_alone(texts[setup], joint, place))
            if name in spec.sharing:
                continue
            first, other = first_by_quantity.setdefault(spec.joint_of_setup(setup, name)[1], (setup, joint))
            unlike = [what for what in ALIKE if getattr(joint, what) != getattr(other, what)]
            if unlike:
                key = "dofs" if unlike[0] == "directions" else unlike[0]
                fault = (
                    f"found another {' and '.join(unlike)} than in set-up {first}, with which it shares its quantities"
                )
                yield (
                    setup,
                    Finding((*place, key), fault, "joints alike, or own = true", "make them alike or add own = true"),
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
            other, (file, _) = next(((first[column], column) for column in read if column in first), (setup, ("", "")))
            if other != setup:
                fault = f"found {file} in set-ups {other} and {setup}, with one error that would count as one of each"
                expected = "a measurement of the body for each set-up, or one set-up"
                yield setup, Finding(("bodies", name), fault, expected, "state another file, or remove a set-up")
            first |= {column: first.get(column, setup) for column in read}


def integral_findings(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield one factor on the noise of several set-ups to be integrated out: each likelihood integrates its own."""
    sharing = [name for name, spec in specs.items() if spec.noise.scale == "integrated" and not spec.noise.own]
    for setup in sharing[1:]:
        fault = 'found "integrated" for one factor of several set-ups, of which each has its own'
        expected = 'own = true for a factor of each, or scale = "sampled" for one of all'
        yield setup, Finding(("noise", "scale"), fault, expected, "add own = true to [noise]")


def _stated_alone(text: CaseText, joint: JointSpec, place: tuple[str, ...]) -> Iterator[Finding]:
    """Yield a prior or a first guess that a set-up states of a joint which is that of all."""
    priors = ("prior",) if place == ("joint",) else (*place, "prior")
    for key in (priors, (*place, "initial")):
        if key in text.own:
            fault = "found it for one set-up, of a joint that all set-ups share"
            yield Finding(key, fault, "own = true in the table of the joint", "add it, or state this for all set-ups")


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
                fault = f"found another prior than in set-up {other}, with which it shares the quantity"
                yield setup, Finding(place, fault, "one for all, or own = true", "state one, or add own = true")


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
                fault = f"found one factor for lengths of {there:g} mm in {other} and {length:g} mm in {setup}"
                expected = "sd_percent, own = true for an error of each, or [uncertain.length_offset] for one of all"
                yield setup, Finding((*_place_of(name), "sd_mm"), fault, expected, "choose one of these")
