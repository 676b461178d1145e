"""From the text of a case file to its checked tables, each test by itself and then all together.

Rules between the tables of one test stand in `rules`; here those between the tests of one case.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import pydantic

from jointbayes.case.case_faults import fault_lines, fault_paths
from jointbayes.case.case_text import CaseText, case_text, drop_inherited, planned_texts, setup_texts
from jointbayes.case.spec.fields import DATA_FILE, Finding, KeyPath, either, named_files
from jointbayes.case.spec.joint_table import JointSpec, joint_table, prior_table
from jointbayes.case.spec.prior_tables import quantity_table
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import similar
from jointbayes.errors import CaseError
from jointbayes.joint.quantities import prefixed, split_hypothesis


def needs_files(specs: Mapping[str, CaseSpec]) -> bool:
    """Whether a case cannot be built from its text and the data of a lone test: it names files besides these.

    Parameters
    ----------
    specs
        Its set-ups, as `parse_setups` gives them.
    """
    return any(setup or key != DATA_FILE for setup, spec in specs.items() for key in named_files(spec.model_dump()))


def parse_case(text: str | CaseText, name: str = "case") -> CaseSpec:
    """Read a case from TOML text; of several set-ups the first that is joined, see `parse_setups`.

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
    return first_joined(parse_setups(text, name).values())


def first_joined(specs: Iterable[CaseSpec]) -> CaseSpec:
    """The first set-up in which a joint acts: what the case says of joints and of the run."""
    return next(spec for spec in specs if spec.joined)


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
        if not any(spec.joined for spec in specs.values()):
            expected, remedy = "one test at least with the joint to be identified", "remove it from one"
            between = [(next(iter(specs)), Finding(("joined",), "found false", expected, remedy))]
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
    return text.fault(finding.loc, finding.found, finding.expected, finding.remedy)


def _own_unknowns(spec: CaseSpec) -> Iterator[Finding]:
    """Yield where a proposed set-up says that a joint, or its noise, is its own."""
    ending, remedy = "of its own, of which the present data say nothing", "remove own, or the set-up from the plan"
    for name, joint in spec.all_joints.items():
        if joint.own:
            yield Finding((*joint_table(name), "own"), f"found a joint {ending}", "one that set-ups share", remedy)
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
            return CaseSpec.model_validate(text.data), [], without
        except pydantic.ValidationError as error:
            lines = fault_lines(error, CaseSpec, text)
            left = [drop_inherited(text, path) for path in fault_paths(error, CaseSpec, text)]
        if not all(left):
            return None, lines, without
        key, text = next(inherited for inherited in left if inherited is not None)
        without[key] = lines[0]


def parameter_findings(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield set-up and finding where the plan wants to know a stiffness that no set-up has."""
    stiffnesses = [
        prefixed(spec.joint_of_setup(setup, name)[0], quantity.name)
        for setup, spec in specs.items()
        for name, joint in spec.stating_joints.items()
        for quantity in joint.quantities
    ]
    for setup, spec in specs.items():
        wanted = spec.plan.parameter
        if not wanted or wanted in stiffnesses:
            continue
        nearest = similar(wanted, stiffnesses)
        expected, remedy = "no plan, since no joint has a stiffness", "remove it"
        if stiffnesses:
            expected = "the stiffness to be known best, " + either(f'"{name}"' for name in dict.fromkeys(stiffnesses))
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
            if not joint.own:
                yield from ((setup, finding) for finding in _stated_alone(texts[setup], name))
            if name in spec.sharing:
                continue
            first, other = first_by_quantity.setdefault(spec.joint_of_setup(setup, name)[1], (setup, joint))
            unlike = joint.unlike(other)
            if unlike:
                key = "dofs" if unlike[0] == "directions" else unlike[0]
                other_kind, remedy = " and ".join(unlike), "make them alike or add own = true"
                fault = f"found another {other_kind} than in set-up {first}, with which it shares its quantities"
                yield setup, Finding((*joint_table(name), key), fault, "joints alike, or own = true", remedy)
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


def _stated_alone(text: CaseText, name: str) -> Iterator[Finding]:
    """Yield a prior or a first guess that a set-up states of a joint which is that of all."""
    for key in (prior_table(name), (*joint_table(name), "initial")):
        if key in text.own:
            fault = "found it for one set-up, of a joint that all set-ups share"
            yield Finding(key, fault, "own = true in the table of the joint", "add it, or state this for all set-ups")


def _unlike_priors(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield a prior of an uncertain quantity, or of the noise, that set-ups share and of which they state others."""
    first: dict[tuple[str, ...], tuple[str, object]] = {}
    for setup, spec in specs.items():
        shared: dict[tuple[str, ...], object] = {
            quantity_table(name): prior for name, prior in spec.uncertain.given.items() if not prior.own
        }
        noise, error = spec.noise, spec.uncertain.model_error
        if noise.scale == "sampled" and not noise.own:
            shared["noise",] = noise.scale_low_factor, noise.scale_high_factor
        if error is not None and not error.own:
            shared[quantity_table("model_error")] = error
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
                yield setup, Finding((*quantity_table(name), "sd_mm"), fault, expected, "choose one of these")
