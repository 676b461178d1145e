"""Every number of a case file is the one that it names in what is built from it, in SI units, and no other.

Each number that the schema knows is moved by a hundredth, in one of `key_cases`. What then changes in the objects must
be what its lines in `KEYS` name, by as much as they say, so that two like keys that were exchanged, a unit or a factor
that was lost, or a new key without a line are found.
"""

import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from copy import deepcopy
from dataclasses import fields, is_dataclass
from functools import reduce
from operator import getitem
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np
import pytest
from pydantic import BaseModel

import jointbayes as jb
from jointbayes import workflow
from jointbayes.case import case as case_module
from jointbayes.case import case_objects
from jointbayes.case.spec.data_table import RotationSpec
from jointbayes.case.spec.prior_tables import PriorsSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import toml_text
from jointbayes.joint import Joints
from jointbayes.structure.recipe import UncertainBody
from tests.case.key_cases import CASES, KeyCase
from tests.case.key_lines import KEYS, expression
from vibrecords import FrequencyData, FrfData, FrfSet, assemble
from vibrecords.measurement_plan import MeasurementPlan
from vibrecords.provenance import Provenance
from vibrecords.rotations import Rotation

KeyPath = tuple[str | int, ...]
_TAGS = ("kind", "shape", "law", "distribution")


def _tag(model: type[BaseModel]) -> str:
    """What tells one kind of table from another, in braces: ``"{circle}"``; nothing where there is one kind."""
    choices = (get_args(model.model_fields[key].annotation) for key in _TAGS if key in model.model_fields)
    return next((f"{{{choice[0]}}}" for choice in choices if len(choice) == 1), "")


def schema_keys(annotation: Any = CaseSpec, path: str = "") -> Iterator[str]:
    """Every key that a number may be given for: names of a user's choice as ``*``, any place in a list as ``[*]``."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for name, field in annotation.model_fields.items():
            key = "*" if annotation is PriorsSpec else name
            yield from schema_keys(field.annotation, f"{path}{_tag(annotation)}.{key}".removeprefix("."))
    elif origin is Annotated:
        yield from schema_keys(inner[0], path)
    elif origin in (Union, UnionType):
        for one in inner:
            yield from schema_keys(one, path)
    elif origin is dict:
        yield from schema_keys(inner[1], f"{path}.*")
    elif origin is tuple:
        entries = [("*", inner[0])] if inner[-1] is ... else list(enumerate(inner))
        for place, one in entries:
            yield from schema_keys(one, f"{path}[{place}]")
    elif annotation in (int, float):
        yield path
    else:  # a kind of annotation that nobody thought of would be left out in silence
        assert annotation in (str, bool, NoneType, Any) or origin is Literal, annotation


TAGS = frozenset(re.findall(r"\{(\w+)\}", " ".join(schema_keys())))


def stated_numbers(data: Any, path: KeyPath = (), name: str = "") -> Iterator[tuple[KeyPath, str, float]]:
    """Place, name and value of each number in the tables of a case."""
    if isinstance(data, Mapping):
        tag = next((f"{{{data[key]}}}" for key in _TAGS if data.get(key) in TAGS), "")
        for key, value in data.items():
            yield from stated_numbers(value, (*path, key), f"{name}{tag}.{key}".removeprefix("."))
    elif isinstance(data, list):
        for place, value in enumerate(data):
            yield from stated_numbers(value, (*path, place), f"{name}[{place}]")
    elif isinstance(data, int | float) and not isinstance(data, bool):
        yield path, name, data


def lines_of(frequency_hz: Any) -> dict[str, float]:
    """Frequency lines by what makes them."""
    first, second, *_ = np.asarray(frequency_hz).tolist()
    return {"first": first, "step": round(second - first, 9), "count": len(frequency_hz)}


def _of_problem(problem: jb.Problem) -> dict[str, Any]:
    several = len(problem.tests) > 1
    parts = (
        {"tests": problem.tests} if several else {key: getattr(problem.test, name) for key, name in _OF_A_TEST.items()}
    )
    first_guess = dict(zip(problem.parametrisation.stiffness_names, np.asarray(problem.initial), strict=True))
    prior = dict(zip(problem.prior.parametrisation.names, problem.prior.marginals, strict=True))
    return parts | {"initial": first_guess, "prior": prior, "nuisance": problem.prior.nuisances}


#: Numbers that follow from several keys: how long a shaker runs, and first guesses where none is stated.
DERIVED = r"shaker_records\[1\]"
_OF_A_TEST = {"structure": "structure", "joint": "joints", "data": "data", "noise": "noise"}
#: What is looked at of an object, where not all of its fields: what is left out follows from the rest, or was made up.
VIEWS: dict[type, Callable[[Any], Any]] = {
    Joints: lambda joints: {joint.name: joint for joint in joints.joints},
    jb.Section: lambda section: section.dimensions,
    UncertainBody: lambda family: {"recipe": family.recipe, "ranges": family.ranges},
    jb.Substructures: lambda bodies: bodies.modelled,
    jb.Ports: lambda ports: lines_of(ports.frequency_hz),
    FrfSet: lambda frf: lines_of(frf.frequency_hz),
    FrfData: lambda measured: measured.frf,
    np.random.Generator: lambda rng: deepcopy(rng).random(),
}


def numbers_of(thing: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Every number in an object and in its parts by its name, such as ``structure.recipe.length``."""
    view = next((view for kind, view in VIEWS.items() if isinstance(thing, kind)), None)
    parts: Iterable[tuple[str, Any]] = ()
    if view is not None:
        yield from numbers_of(view(thing), name)
    elif isinstance(thing, int | float | np.number) and not isinstance(thing, bool):
        yield name, float(thing)
    elif isinstance(thing, np.ndarray):
        parts = ((f"[{','.join(map(str, at))}]", value) for at, value in np.ndenumerate(thing))
    elif isinstance(thing, Mapping):
        parts = ((f".{key or '-'}", value) for key, value in thing.items())
    elif is_dataclass(thing):
        parts = ((f".{field.name}", getattr(thing, field.name)) for field in fields(thing) if field.name[0] != "_")
    elif isinstance(thing, tuple | list):
        for place, one in enumerate(thing):
            if isinstance(one, tuple) and len(one) == 2 and isinstance(one[0], str):  # a pair of name and value
                yield from numbers_of(one[1], f"{name}.{one[0] or '-'}")
            else:
                own = getattr(one, "name", None) or getattr(one, "dof", None)
                yield from numbers_of(one, f"{name}.{own}" if own else f"{name}[{place}]")
    for key, value in parts:
        yield from numbers_of(value, f"{name}{key}".removeprefix("."))


class _Stop(Exception):
    """All that is looked at has been seen."""


class Bench:
    """Builds cases with whatever reads files or computes FRFs replaced by what only notes what it was asked for."""

    def __init__(self, monkeypatch: Any, directory: Path) -> None:
        self.seen: dict[str, Any] = {}
        monkeypatch.setattr(jb.Problem, "log_posterior", None)
        monkeypatch.setattr(case_objects, "synthesise_frf", self._synthesised)
        monkeypatch.setattr(assemble, "read_measurement", self._read)
        monkeypatch.setattr(case_module, "split_data", self._split)
        monkeypatch.setattr(RotationSpec, "rotation", self._rotation_of(RotationSpec.rotation))
        monkeypatch.setattr(workflow, "sensitivity_iteration", self._iterated)

    def numbers(self, data: Mapping[str, Any], act: str = "") -> dict[str, float]:
        """Numbers of what a case makes, and of what is asked of the step of a run that `act` names."""
        self.seen.clear()
        text = toml_text(data)
        case = jb.case_from_text("case", text)
        with suppress(_Stop):
            if act == "identify":
                workflow.identify(case)
        settings = {"sampler": case.sampler, "seed": workflow._seed(case, None)}
        settings |= {"model_error": case.problem.model_error, "rules": case.verdict_rules}
        published = {"reference": case.reference, "published": case.spec.reference and case.measured_frequencies_hz}
        named = numbers_of(_of_problem(case.problem) | settings | published | self.seen)
        derived = DERIVED if "initial" in text else f"initial|{DERIVED}"
        return {name: number for name, number in named if not re.match(derived, name)}

    def _iterated(self, *_: Any, **settings: Any) -> None:
        self.seen["iteration"] = settings
        raise _Stop

    def _synthesised(
        self, family: Any, joint: Any, matrix: Any, ports: jb.Ports, law: Any, quantity: Any, rng: Any, gain: float
    ) -> FrfData:
        self.seen["truth"] = {"structure": family, "matrix": matrix, "ports": ports, "law": law, "gain": gain}
        self.seen["truth"]["rng"] = deepcopy(rng)
        return self._measured(ports.frequency_hz, ports.outputs, ports.inputs)

    def _measured(self, lines: Any, outputs: tuple[str, ...], inputs: tuple[str, ...]) -> FrfData:
        shape = (len(lines), len(outputs), len(inputs))
        provenance = Provenance((), "receptance", len(lines), (1.0, 2.0), None, (), (), "")
        frf = FrfSet(np.asarray(lines), np.ones(shape, dtype=complex), outputs, inputs)
        return FrfData(frf, np.ones(shape), provenance=provenance)

    def _read(self, file: tuple[str, ...], directory: Path, asked: MeasurementPlan) -> Any:
        self.seen.setdefault("files", {})[file[0].partition(".")[0]] = asked
        if asked.frequencies:
            return FrequencyData(np.array([30.0, 200.0]), np.array([1.0, 2.0]))
        labels = tuple(channel.dof for channel in asked.channels.values())
        return self._measured([10.0, 20.0], asked.outputs or labels, asked.inputs or labels)

    def _split(self, data: Any, left_out: Any) -> tuple[Any, None]:
        self.seen["left_out"] = {"modes": left_out.modes, "bands_hz": left_out.bands_hz}
        return data, None

    def _rotation_of(self, built: Callable[..., Rotation]) -> Callable[..., Rotation]:
        def note(spec: RotationSpec, label: str, spacing_mm: float) -> Rotation:
            rotation = built(spec, label, spacing_mm)
            if label[0].isalpha() and spacing_mm == spec.spacing_mm:  # of a body: those of the data are in their plan
                self.seen.setdefault("rotations", []).append(rotation)
            return rotation

        return note


def lines_of_key(key: str, numbers: dict[str, float]) -> dict[str, Callable[[float], float]]:
    """What the lines of a key name among numbers."""
    named: dict[str, Callable[[float], float]] = {}
    for pattern, target, value in KEYS:
        match = expression(pattern).fullmatch(key)
        if match is not None:
            for place, name in enumerate(match.groups()):
                target = target.replace(f"{{{place}}}", name)
            named |= {number: value for number in numbers if expression(target).fullmatch(number)}
    return named


def moves(key: str, value: float) -> list[float]:
    """What a number may be moved to: by a hundredth, a whole one by one or two, and as little as unit vectors bear."""
    if isinstance(value, int):
        return [value + 1, value + 2]
    return [value * (1 + 1e-7)] if ".axes" in key else [value * 1.01]


def moved_numbers(bench: Bench, case: KeyCase, path: KeyPath, key: str, value: float) -> tuple[float, dict[str, float]]:
    """What a number was moved to, and all numbers then."""
    for moved in moves(key, value):
        data: Any = tomllib.loads(case.text)
        *tables, last = path
        reduce(getitem, tables, data)[last] = moved
        if key.startswith("structure{matrices}") and isinstance(tables[-1], int):
            reduce(getitem, (*tables[:-1], last), data)[tables[-1]] = moved  # as it stays symmetric
        try:
            return moved, bench.numbers(data, case.act)
        except jb.CaseError as error:
            refused = error
    raise AssertionError(f"{key}: {refused}")


def faults_of(key: str, before: float, after: float, old: dict[str, float], new: dict[str, float]) -> list[str]:
    """What is wrong about what a key moved."""
    named = lines_of_key(key, old)
    if not named:
        return [f"{key}: no line names its number"]
    changed = {name for name in old.keys() | new.keys() if old.get(name) != new.get(name)}
    faults = [f"{key}: moves {name} as well" for name in sorted(changed - named.keys())]
    for name, value in named.items():
        for stated, numbers in ((before, old), (after, new)):
            if numbers.get(name) != pytest.approx(value(stated), rel=1e-9, abs=0):
                faults.append(f"{key} = {stated:g}: {name} is {numbers.get(name)}, not {value(stated)}")
    if not changed:
        faults.append(f"{key}: moves nothing")
    return faults


def checked_keys() -> list[list[tuple[KeyPath, str, float]]]:
    """Of each case the numbers that are moved in it: those that it is for, or all that no case before it has."""
    known: set[str] = set()
    chosen = []
    for case in CASES:
        stated = [one for one in stated_numbers(tomllib.loads(case.text)) if one[2]]
        chosen.append([one for one in stated if (re.match(case.keys, one[1]) if case.keys else one[1] not in known)])
        known.update(key for _, key, _ in chosen[-1])
    return chosen


CHECKED = checked_keys()


@pytest.mark.parametrize("number", range(len(CASES)))
def test_each_number_of_a_case_is_the_one_that_it_names_and_no_other(number, monkeypatch, tmp_path):
    bench, case = Bench(monkeypatch, tmp_path), CASES[number]
    old = bench.numbers(tomllib.loads(case.text), case.act)
    faults = []
    for path, key, value in CHECKED[number]:
        moved, new = moved_numbers(bench, case, path, key, value)
        faults += faults_of(key, value, moved, old, new)
    assert faults == []


#: Numbers of imported models, which need files, and of predictions: `test_imported.py`, `test_other_structure.py`.
ELSEWHERE = re.compile(r"structure\{imported\}.*|predict\..*|uncertain\.bodies\.\*\.thickness\..*")


def test_every_number_that_the_schema_knows_is_moved():
    moved = {key for each in CHECKED for _, key, _ in each}
    numbers = sorted(key for key in set(schema_keys()) if not ELSEWHERE.fullmatch(key))
    unmoved = [key for key in numbers if not any(map(expression(key).fullmatch, moved))]
    assert unmoved == [], "state them in a case of key_cases.py, with a line of key_lines.txt each"
    assert [line for line in KEYS if not any(map(expression(line[0]).fullmatch, moved))] == []
