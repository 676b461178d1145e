"""From the text of a case file to its checked tables, each test by itself and then all together.

Rules between the tables of one test stand with `CaseSpec`; here those between the tests of one case, and the words in
which faults are told, ``FILE:LINE: key: found; expected; what to do``. What is expected is the ``description`` of the
field in plain words, with the unit, and the remedy its first of ``examples``: a new field brings its message along.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from typing import Literal, get_args, get_origin

import pydantic
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from jointbayes.case.case_text import CaseText, case_text, drop_inherited, texts_of_tests
from jointbayes.case.spec.fields import (
    DATA_FILE,
    UNITS,
    Finding,
    KeyPath,
    either,
    named_files,
    quoted,
    same_stem,
    show_key,
    stem_of,
    unit_of,
)
from jointbayes.case.spec.prior_tables import JointSpec, joint_table, prior_table, quantity_table
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import toml_value
from jointbayes.errors import WENT, CaseError, similar
from jointbayes.joint.quantities import split_hypothesis

#: Faults that are told, that are compared with each other, and that are looked at: no case has more.
_MOST_TOLD, _MOST_SORTED, _MOST_READ = 20, 100, 5000

#: What a symbol stands for, where somebody writes it instead of the word.
_SYMBOLS = {
    "E": "youngs_modulus",
    "rho": "density",
    "L": "length",
    "zeta": "damping_ratio",
    "eta": "loss_factor",
    "kappa": "shear_coefficient",
    "chains": "ensembles",
    "iterations": "max_steps",
}
#: Law and key of [structure.damping] for a symbol that stands in [structure].
_OF_DAMPING = {"zeta": ("modal", "ratio"), "eta": ("loss_factor", "loss_factor")}
_MIDDLES = ("mean", "median", "value", "nominal")
#: Texts that mean one of the allowed ones.
_SYNONYMS = {"hysteretic": "loss_factor", "structural": "loss_factor"}


def _show(value: object) -> str:
    """Describe a value of a case file in the words of the file, always on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"the text {quoted(value)}" if value else "an empty text"
    if isinstance(value, int | float):
        # The size of an absurdly long integer says enough, and str() refuses more than 4300 digits.
        is_long = isinstance(value, int) and abs(value) > 10**20
        return "an integer of more than 20 digits" if is_long else repr(value)
    if isinstance(value, Mapping):
        return "a table" if value else "an empty table"
    if isinstance(value, Sequence):
        return f"a list of {len(value)}" if value else "an empty list"
    return "a date or time"  # all that TOML has left


def _models(annotation: object) -> list[type[BaseModel]]:
    """List the tables an annotation allows: none for a plain value, several for a discriminated union."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for arg in get_args(annotation) for m in _models(arg)]


def _choices(annotation: object) -> list[str]:
    """List the texts an annotation allows."""
    if get_origin(annotation) is Literal:
        return [c for c in get_args(annotation) if isinstance(c, str)]
    return [c for arg in get_args(annotation) for c in _choices(arg)]


@cache
def _tags(model: type[BaseModel]) -> dict[str, str]:
    """Give the keys whose only allowed text tells this kind of table from its siblings."""
    words = {k: get_args(f.annotation) for k, f in model.model_fields.items() if get_origin(f.annotation) is Literal}
    return {key: texts[0] for key, texts in words.items() if len(texts) == 1}


@dataclass(frozen=True)
class _Place:
    """A position in the file (path, value) together with what the schema says about it."""

    tables: list[type[BaseModel]]  # the kinds of table possible here; empty at a plain value
    value: object
    path: KeyPath = ()
    owner: tuple[type[BaseModel], ...] = ()  # the kinds of table the last key belongs to
    siblings: Mapping[str, object] = field(default_factory=dict)  # the table of the file that holds the last key
    info: FieldInfo | None = None
    free_keys: bool = False  # whether the keys below are the user's own names, each with a table of one kind

    def enter(self, step: str | int, tagged: bool) -> _Place:
        """Follow one part of a pydantic location; parts that are not in the file change nothing else."""
        if isinstance(step, int):
            inside = isinstance(self.value, list) and step < len(self.value)
            return replace(self, path=(*self.path, step), value=self.value[step]) if inside else self  # type: ignore[index]
        if self.free_keys:
            value = self.value.get(step) if isinstance(self.value, Mapping) else None
            return replace(self, path=(*self.path, step), value=value, free_keys=False)
        if tagged and len(self.tables) > 1:  # pydantic names the chosen kind of table after the key
            return replace(self, tables=[m for m in self.tables if step in _tags(m).values()])
        given = self.value if isinstance(self.value, Mapping) else {}
        fitting = [m for m in self.tables if any(given.get(k) == tag for k, tag in _tags(m).items())]
        owner = [m for m in fitting or self.tables if step in m.model_fields]
        if not owner and step not in given:
            return self  # the name of a type inside a union of plain values
        info = owner[0].model_fields[step] if owner else None
        tables, kin = _models(info.annotation) if info else [], tuple(fitting or self.tables)
        free_keys = info is not None and get_origin(info.annotation) is dict
        return _Place(tables, given.get(step), (*self.path, step), kin, given, info, free_keys)


@dataclass
class _Fault:
    """A fault at its place; ``kind`` decides the wording, ``meant`` is the key an unknown one stands for."""

    kind: Literal["missing", "unknown", "value"]
    place: _Place
    finding: Finding = field(default_factory=lambda: Finding(()))
    meant: str | None = None
    home: KeyPath = ()  # where a key or table belongs that is missing there


def _faults(error: ErrorDetails, root: _Place) -> Iterator[_Fault]:
    """Turn one pydantic error, or the findings it carries, into faults."""
    place = root
    for step in error["loc"]:
        place = place.enter(step, tagged=True)
    context = error.get("ctx", {})
    if error["type"] == "case_findings":
        for finding in context["findings"]:
            spot = place
            for step in finding.loc:
                spot = spot.enter(step, tagged=False)
            yield _Fault("missing" if finding.missing else "value", spot, finding)
    elif error["type"].startswith("union_tag_"):
        spot = place.enter(context["discriminator"].strip("'"), tagged=False)
        keys = {key for m in spot.owner for key in m.model_fields}
        misspelt = similar(str(spot.path[-1]), set(spot.siblings) - keys)
        if error["type"] == "union_tag_invalid":
            yield _Fault("value", spot)
        elif misspelt:
            yield _Fault("unknown", place.enter(misspelt, tagged=False), meant=str(spot.path[-1]))
        else:
            yield _Fault("missing", spot)
    elif error["type"] == "missing" and isinstance(error["loc"][-1], int):  # a list that is too short lacks no key
        yield _Fault("value", place, Finding((), remedy="write every number, also those that are 0"))
    else:
        kinds: dict[str, Literal["missing", "unknown"]] = {"missing": "missing", "extra_forbidden": "unknown"}
        yield _Fault(kinds.get(error["type"], "value"), place)


def _pair_renamed(faults: list[_Fault]) -> list[_Fault]:
    """Say what unknown keys were meant to be, and drop the "missing" faults that a misspelt key explains."""
    unknown = [f for f in faults if f.kind == "unknown"]
    missing = [f.place.path for f in faults if f.kind == "missing"]
    for fault in unknown:
        table, key = fault.place.path[:-1], str(fault.place.path[-1])
        inside = fault.place.value if isinstance(fault.place.value, Mapping) else {}
        here = [str(p[-1]) for p in missing if p[:-1] == table]
        below = [str(p[-2]) for p in missing if len(p) > 1 and p[:-2] == table and p[-1] in inside]
        alone = sum(f.place.path[:-1] == table for f in unknown) == 1
        offered = [k for m in fault.place.owner for k in m.model_fields]
        # The surest sign first: a missing key, then a table whose missing keys are inside, a symbol, a unit, likeness.
        fault.meant = (
            fault.meant
            or similar(key, here)
            or (here[0] if alone and len(here) == 1 else None)
            or (below[0] if below else None)
            or next((k for k in offered if _SYMBOLS.get(key) in (k, stem_of(k))), None)
            or same_stem(key, offered)
            or similar(key, [k for k in offered if k not in fault.place.siblings])
            or similar(key, offered)
        )
        fault.home = next((path for path in missing if path[-1] == key), ())
        meant = (*table, fault.meant)
        missing = [p for p in missing if p not in (meant, fault.home) and not (p[:-1] == meant and p[-1] in inside)]
    return [f for f in faults if f.kind != "missing" or f.place.path in missing]


def _homes(model: type[BaseModel], key: str, table: KeyPath = ()) -> Iterator[str]:
    """Name the tables of the schema that know a key."""
    if key in model.model_fields:
        tags = "".join(f' with {k} = "{tag}"' for k, tag in _tags(model).items())
        yield f"[{show_key(table)}]{tags}" if table else "the part above the first table"
    for name, info in model.model_fields.items():
        for inner in _models(info.annotation):
            yield from _homes(inner, key, (*table, name))


def _unknown_wording(fault: _Fault, root: type[BaseModel]) -> tuple[str, str, str]:
    place, meant = fault.place, fault.meant
    fields_by_key = {k: f for m in place.owner for k, f in m.model_fields.items()}
    key = str(place.path[-1])
    stem = _SYMBOLS.get(key, stem_of(key))
    surely = meant is not None and (meant.startswith(key) or stem in (meant, stem_of(meant)))
    homes = [] if surely else list(dict.fromkeys(_homes(root, key)))
    homes = [home for home in homes if home.startswith(f"[{show_key(place.path[:-1])}] with ")][:1] or homes[:3]
    hints = [f"it belongs in {' or '.join(homes)}"] if homes else []
    if not meant and place.path[0] in ("data", "reference") and set(homes) <= {"[prior]", "[joints.prior]"}:
        hints = ["name the stiffnesses of this joint"]
    expected = f"one of {', '.join(fields_by_key)}"
    elsewhere = f"write [{show_key(fault.home)}]" if fault.home else _elsewhere(place, root)
    if elsewhere or (" with " in "".join(homes[:1]) and len(homes) == 1):
        hints, meant = [elsewhere or hints[0]], None
    elif meant:
        expected = f"{meant} ({fields_by_key[meant].description})"
        twin, clash = place.siblings.get(meant), meant in place.siblings
        if isinstance(twin, Mapping) and isinstance(place.value, Mapping):
            # Tables with no key in common are one table in two spellings: [structure], [strcture.section].
            clash = not twin.keys().isdisjoint(place.value)
        rename = f'"{meant}" is given already, drop one of the two' if clash else _converted(place, meant)
        hints.insert(0, f'did you mean "{meant}"? {rename}')
    mistake = f"unknown {'table' if isinstance(place.value, Mapping) else 'key'}"
    return mistake, expected, ", or ".join(hints) or "correct or remove it"


def _elsewhere(place: _Place, root: type[BaseModel]) -> str:
    """What to write instead of a key whose meaning is stated in another table under another name; or empty."""
    path, key = place.path, str(place.path[-1])
    if path == ("data", "noise"):
        return "the noise of measured data is that of [data.variance]"
    if path[:-1] == ("joint",) and isinstance(place.value, Mapping):
        return f"one of several joints is a table [joints.{key}]"
    if (instead := WENT.get(".".join(map(str, path[2:] if path[0] == "tests" else path)))) is not None:
        return f"it was removed: {instead}"
    if path[:-1] == ("structure",) and key in _OF_DAMPING:
        return 'write {1} in [structure.damping] with law = "{0}"'.format(*_OF_DAMPING[key])
    if path[0] == "uncertain" and len(path) == 3 and key in _MIDDLES:
        tables = _models(root.model_fields["structure"].annotation)
        stated = same_stem(str(path[1]), [name for table in tables for name in table.model_fields])
        return f"remove it: the middle is {f'that of {stated} in [structure]' if stated else 'the nominal value'}"
    return ""


def _converted(place: _Place, meant: str) -> str:
    """What to do with the value of a key that is named otherwise: nothing, unless it is in another unit or a radius."""
    key, value = str(place.path[-1]), place.value
    ours, theirs = unit_of(meant), unit_of(key)
    twice = "radius" in key.lower() and "diameter" in meant
    in_si = UNITS[theirs][1] if theirs else 1.0  # of stiffnesses, which have no unit in their names
    if not ours and in_si != 1 and isinstance(value, int | float):
        return f"write {meant} = {in_si * value:.6g}, the value in SI units"
    if not ours or (ours == theirs and not twice):
        return "rename it"
    kind, size, words = UNITS[ours]
    their_kind, given, _ = UNITS.get(theirs, ("", 1.0, ""))
    if their_kind != kind or not isinstance(value, int | float) or isinstance(value, bool):
        return f"rename it and give {'twice ' if twice else ''}its value {words}"
    why = "a diameter is twice the radius" if twice else f"the value {words}"
    return f"write {meant} = {(2 if twice else 1) * given / size * value:.6g}, {why}"


def _missing_wording(place: _Place) -> tuple[str, str, str]:
    key, table, info = str(place.path[-1]), place.path[:-1], place.info
    expected = (info and info.description) or key
    if place.tables:
        return "missing table", expected, f"add a table [{show_key(place.path)}]"
    where = f"to [{show_key(table)}]" if table else "above the first table"
    words = [f'"{choice}"' for choice in _choices(info.annotation)] if info else []
    example = either(words) if len(words) > 1 and get_origin(info and info.annotation) is Literal else _example(info)
    return "missing", expected, f"add {key} = {example} {where}"


def _value_remedy(place: _Place) -> str:
    key = next((str(p) for p in reversed(place.path) if isinstance(p, str)), "")
    value, example = place.value, _example(place.info)
    fields = [m.model_fields[key] for m in place.owner if key in m.model_fields]
    if place.tables and not isinstance(value, Mapping):
        is_array = isinstance(value, list) and value and isinstance(value[0], dict)
        return f"write {'single brackets' if is_array else 'a table'}: [{show_key(place.path)}]"
    if isinstance(value, str):
        choices = [c for f in fields for c in _choices(f.annotation)]
        synonym = _SYNONYMS.get(value.lower())
        choice = similar(value, choices) or (synonym if synonym in choices else None)
        if choice:
            return f'did you mean "{choice}"?'
        number = re.fullmatch(r"([-+]?[\d.]+([eE][-+]?\d+)?) *[^\d.,;]*", value)
        if number and example[0] not in '"[':
            return f"write the number without quotes: {key} = {number[1]}"
    if isinstance(value, float) and example.isdigit() and value.is_integer() and 0 < value < 1e6:
        return f"write it without a decimal point: {key} = {int(value)}"
    return f"write for example {key} = {example}"


def _example(field: FieldInfo | None) -> str:
    """The example value of a field as TOML."""
    return toml_value(field.examples[0]) if field and field.examples else "…"


def fault_lines(error: ValidationError, model: type[BaseModel], source: CaseText) -> list[str]:
    """Describe every fault that pydantic found in a case file.

    Parameters
    ----------
    error : pydantic.ValidationError
        What validating ``data`` against ``model`` raised.
    model : type of pydantic.BaseModel
        The schema; the ``description`` of its fields completes "expected …".
    source : CaseText
        The text of the case and where its keys stand.

    Returns
    -------
    list of str
        One line per fault, in the order of the file; of many the first, and how many there are besides.
    """
    root = _Place([model], source.data)
    # A union of plain values reports once for each of its types: the first says it all.
    each: dict[KeyPath, _Fault] = {}
    errors = error.errors(include_url=False)
    for fault in (f for e in errors[:_MOST_READ] for f in _faults(e, root)):
        each.setdefault(fault.place.path, fault)
    # Pairing what is unknown with what is missing compares each with each.
    first = sorted(each.values(), key=lambda fault: source.order(fault.place.path))[:_MOST_SORTED]
    paired = _pair_renamed(first)
    left_out = len(errors[_MOST_READ:]) + len(each) - len(first) + max(0, len(paired) - _MOST_TOLD)
    shown = []
    for fault in paired[:_MOST_TOLD]:
        place, finding = fault.place, fault.finding
        if fault.kind == "unknown":
            words = _unknown_wording(fault, model)
        elif fault.kind == "missing":
            words = _missing_wording(place)
        else:
            entry = f" as entry {place.path[-1] + 1}" if place.path and isinstance(place.path[-1], int) else ""
            mistake = finding.found or f"found {_show(place.value)}{entry}"
            if mistake.startswith(('found "?"', 'found the text "?"')):
                mistake = 'found "?", a question still open'
            expected = finding.expected or (place.info.description if place.info else "") or ""
            words = mistake, expected, finding.remedy or _value_remedy(place)
        shown.append(source.fault(place.path, *words))
    return [*shown, f"and {left_out} more"] if left_out else shown


def needs_files(specs: Mapping[str, CaseSpec]) -> bool:
    """Whether a case cannot be built from its text and the data of a lone test: it names files besides these.

    Parameters
    ----------
    specs
        Its tests, as `parse_tests` gives them.
    """
    return any(test or key != DATA_FILE for test, spec in specs.items() for key in named_files(spec.model_dump()))


def parse_case(text: str | CaseText, name: str = "case") -> CaseSpec:
    """Read a case from TOML text; of several tests the first that is joined, see `parse_tests`.

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
    return first_joined(parse_tests(text, name).values())


def first_joined(specs: Iterable[CaseSpec]) -> CaseSpec:
    """The first test in which a joint acts: what the case says of joints and of the run."""
    return next(spec for spec in specs if spec.joined)


@lru_cache(maxsize=8)  # a case is asked for its tests when it is read, and again for its warnings
def parse_tests(text: str | CaseText, name: str = "case") -> dict[str, CaseSpec]:
    """Read each test of a case by its name; a case of one test has one without a name.

    Parameters and errors are those of `parse_case`. What the file says for all tests of an uncertain quantity
    or a virtual test is left out of those that cannot have it, as long as another one can.
    """
    source = case_text(text, name) if isinstance(text, str) else text
    texts = texts_of_tests(source)
    # 1. Check each test by itself; what it does not take of the whole file is a fault if no test takes it.
    specs: dict[str, CaseSpec] = {}
    faults: list[str] = []
    dropped: dict[KeyPath, list[str]] = {}
    for test, own in texts.items():
        spec, lines, without = _checked(own)
        faults += lines
        for key, line in without.items():
            dropped.setdefault(key, []).append(line)
        if spec is not None:
            specs[test] = spec
    faults += [lines[0] for lines in dropped.values() if len(lines) == len(texts)]
    # 2. Check what stands between the tests.
    if not faults:
        between = [*shared_findings(specs, texts), *integral_findings(specs)]
        if not any(spec.joined for spec in specs.values()):
            expected, remedy = "one test at least with the joint to be identified", "remove it from one"
            between = [(next(iter(specs)), Finding(("joined",), "found false", expected, remedy))]
        every = (*between, *hypotheses_findings(specs))
        faults = [texts[test].fault(f.loc, f.found, f.expected, f.remedy) for test, f in every]
    if faults:
        raise CaseError("\n".join(dict.fromkeys(faults)))
    return specs


def _checked(text: CaseText) -> tuple[CaseSpec | None, list[str], dict[KeyPath, str]]:
    """One test, or its faults; and what it does not take of the rest of the file, each with its fault."""
    without: dict[KeyPath, str] = {}
    while True:
        try:
            return CaseSpec.model_validate(text.data), [], without
        except pydantic.ValidationError as error:
            lines = fault_lines(error, CaseSpec, text)
            root = _Place([CaseSpec], text.data)
            faults = itertools.chain.from_iterable(_faults(each, root) for each in error.errors(include_url=False))
            left = [drop_inherited(text, fault.place.path) for fault in faults]
        if not all(left):
            return None, lines, without
        key, text = next(inherited for inherited in left if inherited is not None)
        without[key] = lines[0]


def hypotheses_findings(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield test and finding where a hypothesis leaves out a damping that no joint has."""
    if any(joint.damping for spec in specs.values() for joint in spec.all_joints.values()):
        return
    for test, spec in specs.items():
        for i, name in enumerate(spec.compare.hypotheses):
            undamped, springs = split_hypothesis(name)
            if undamped:
                fault = f'found "{name}" of joints without damping, which is "{springs}"'
                expected = "hypotheses on the springs, or viscous or loss_factors in the joint"
                yield test, Finding(("compare", "hypotheses", i), fault, expected, "remove it")


def shared_findings(specs: Mapping[str, CaseSpec], texts: Mapping[str, CaseText]) -> Iterator[tuple[str, Finding]]:
    """Yield test and finding where tests share what cannot be one: quantities of unlike joints, priors, spreads."""
    if list(specs) == [""]:
        return
    first_by_quantity: dict[str, tuple[str, JointSpec]] = {}
    for test, spec in specs.items():
        for name, joint in spec.all_joints.items():
            for stated in () if joint.own else (prior_table(name), (*joint_table(name), "initial")):
                if stated in texts[test].own:
                    fault, expected = (
                        "found it for one test, of a joint that all tests share",
                        "it for all, or own = true",
                    )
                    yield test, Finding(stated, fault, expected, "state it for all tests, or make the joint their own")
            if name in spec.sharing:
                continue
            first, other = first_by_quantity.setdefault(spec.joint_of_test(test, name)[1], (test, joint))
            unlike = joint.unlike(other)
            if unlike:
                key = "dofs" if unlike[0] == "directions" else unlike[0]
                other_kind, remedy = " and ".join(unlike), "make them alike or add own = true"
                fault = f"found another {other_kind} than in test {first}, with which it shares its quantities"
                yield test, Finding((*joint_table(name), key), fault, "joints alike, or own = true", remedy)
    yield from _unlike_spreads(specs)
    yield from _unlike_priors(specs)
    yield from _shared_bodies(specs)


def _shared_bodies(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield a body whose one measurement several tests have, so that its errors would be counted as independent."""
    first: dict[tuple[str, str], str] = {}
    for test, spec in specs.items():
        for name, body in spec.bodies.items():
            if not body.propagate:
                continue
            read = [(file, channel) for file in body.file for channel in body.channels]
            other, (file, _) = next(((first[column], column) for column in read if column in first), (test, ("", "")))
            if other != test:
                fault = f"found {file} in tests {other} and {test}, with one error that would count as one of each"
                expected = "a measurement of the body for each test, or one test"
                yield test, Finding(("bodies", name), fault, expected, "state another file, or remove a test")
            first |= {column: first.get(column, test) for column in read}


def integral_findings(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield one factor on the noise of several tests to be integrated out: each likelihood integrates its own."""
    sharing = [name for name, spec in specs.items() if spec.noise.scale == "integrated" and not spec.noise.own]
    for test in sharing[1:]:
        fault = 'found "integrated" for one factor of several tests, of which each has its own'
        expected = 'own = true for a factor of each, or scale = "sampled" for one of all'
        yield test, Finding(("noise", "scale"), fault, expected, "add own = true to [noise]")


def _unlike_priors(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield a prior of an uncertain quantity, or of the noise, that tests share and of which they state others."""
    first: dict[tuple[str, ...], tuple[str, object]] = {}
    for test, spec in specs.items():
        shared: dict[tuple[str, ...], object] = {
            quantity_table(name): prior for name, prior in spec.uncertain.given.items() if not prior.own
        }
        noise, error = spec.noise, spec.uncertain.model_error
        if noise.scale == "sampled" and not noise.own:
            shared["noise",] = noise.scale_low_factor, noise.scale_high_factor
        if error is not None and not error.own:
            shared[quantity_table("model_error")] = error
        for place, prior in shared.items():
            other, there = first.setdefault(place, (test, prior))
            if prior != there:
                fault = f"found another prior than in test {other}, with which it shares the quantity"
                yield test, Finding(place, fault, "one for all, or own = true", "state one, or add own = true")


def _unlike_spreads(specs: Mapping[str, CaseSpec]) -> Iterator[tuple[str, Finding]]:
    """Yield a factor that several tests share with a standard deviation in mm of lengths that differ."""
    first: dict[str, tuple[str, float]] = {}
    for test, spec in specs.items():
        for name, prior in spec.uncertain.given.items():
            if prior.own or name.rpartition(".")[2] != "length" or getattr(prior, "sd_mm", None) is None:
                continue
            length = spec.structure.stated[name][1]
            other, there = first.setdefault(name, (test, length))
            if length != there:
                fault = f"found one factor for lengths of {there:g} mm in {other} and {length:g} mm in {test}"
                expected = "sd_percent, own = true for an error of each, or [uncertain.length_offset] for one of all"
                yield test, Finding((*quantity_table(name), "sd_mm"), fault, expected, "choose one of these")
