"""The further measurements that a case could be given, from its `[plan]` table.

Whole tests that it proposes are built as far as they can be without data of their own.
"""

import itertools
import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np

from jointbayes.case.case import Case
from jointbayes.case.case_objects import CaseTest, complete_from_data, noise_of, quantities_of, recipe_of
from jointbayes.case.case_text import CaseText, planned_texts
from jointbayes.case.parse import parse_planned
from jointbayes.case.spec.fields import band_lines
from jointbayes.case.spec.settings_tables import PlanSpec
from jointbayes.case.spec.structure_tables import ImportedSpec, MatricesSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import fault_start
from jointbayes.errors import CaseError, JointBayesError, ModelError
from jointbayes.frf import AnyStructure, Ports
from jointbayes.inference import Problem
from jointbayes.joint import Joints, joints_of
from jointbayes.posterior.first_look import (
    FREE,
    FREE_WORDS,
    RELATIVE_CALIBRATION,
    Candidate,
    FrfCandidate,
    ModalCandidate,
    VarianceLaw,
    as_measured,
    estimated_law,
    is_worth_hitting_free,
    modes_hit_free,
    repeated,
    scatter,
)
from jointbayes.structure import Body, StructureRecipe, family_of_recipe
from vibrecords import ModalData, Quantity

#: So many of a test's changes are named in a sentence.
_NAMED = 3


def proposed_tests(case: Case) -> tuple[Candidate, ...]:
    """Candidates that are tests, in the order of the case file.

    A test is measured as its own tables say; beside measured data at their DOFs and lines, with their noise.

    Raises
    ------
    CaseError
        If one cannot be; file, line and key.
    """
    texts, candidates = planned_texts(case.source), []
    for name, spec in parse_planned(case.source).items():
        try:
            candidates.append(_candidate(_built(name, texts[name], spec, case), case.problem))
        except JointBayesError as error:
            raise CaseError(f"{fault_start(*texts[name].place(()))} plan.tests.{name}: {error}") from error
    return tuple(candidates)


def _built(name: str, text: CaseText, spec: CaseSpec, case: Case) -> CaseTest:
    """A proposed test as far as it can be without data, of which those of the first present one say what they are."""
    if not case.tests:
        raise ModelError("found a case without its tests; expected the case file, of which they are; load it again")
    first = case.tests[0]
    if spec.files is not None:
        spec = complete_from_data(spec, first.data)
    if isinstance(spec.structure, MatricesSpec | ImportedSpec):
        raise ModelError(
            "found a structure given by matrices or imported; expected a beam, a frame or a chain, of which a test "
            "can change something; remove it"
        )
    recipe = recipe_of(spec.structure, spec.data, first.data)
    joint = joints_of(spec.joint_objects)
    joint.require_one_place(lambda label: recipe.positions.get(label.rpartition(":")[0]))
    premises = case.problem.premises
    if not premises.reason:
        return CaseTest(name, text, spec, recipe, (), joint, first.data, *noise_of(spec, first.data))
    # measured as what the present data are taken as, and as uncertain as they are
    data = next((test.data for test in case.problem.tests if test.name == first.name), case.problem.tests[0].data)
    if premises.of_modes:  # which do not see the damping
        certain = spec.uncertain.model_copy(update={"damping_ratio": None, "loss_factor": None})
        spec = spec.model_copy(update={"uncertain": certain})
    built = CaseTest(name, text, spec, recipe, (), joint, data, noise_of(spec, data)[0], ())
    return built.with_workshop_uncertainty(case.largest_damping) if premises.assumed else built


def _candidate(test: CaseTest, problem: Problem) -> Candidate:
    name = test.name
    named, of_noise = test.named_nuisances()
    each = zip(named, quantities_of(test.spec), strict=True)
    own_nuisances = tuple(nuisance for nuisance, (_, of_test) in each if of_test)
    present_names = {nuisance.name for nuisance in problem.prior.nuisances}
    own_names = {nuisance.name for nuisance in own_nuisances}
    foreign = [nuisance.name for nuisance in named if nuisance.name not in present_names | own_names]
    if foreign:
        raise ModelError(
            f"found that {foreign[0]} is uncertain, which it shares with present tests that do not have it; expected "
            f"one of its own; state it in [plan.tests.{name}.uncertain]"
        )
    unknown = [nuisance.name for nuisance in of_noise if nuisance.name not in present_names]
    if unknown:
        raise ModelError(
            f"found that {unknown[0]} of its noise is inferred, which no present test shares with it; expected noise "
            'that is known, or as in a present one; state [noise] for all tests, or scale = "known"'
        )
    words = f"the test {name}{_changes(test.source)}"
    if test.data.frfs is None:
        modes = test.data.modes
        assert modes is not None
        return ModalCandidate(
            name=name, words=words, test=name, own_nuisances=own_nuisances, joint=test.joint,
            structure=test.structure, numbers=modes.numbers, relative=scatter(modes),
        )  # fmt: skip
    ports, law, quantity = _frfs_of(test)
    places = map(test.spec.structure.place, ports.outputs)
    return FrfCandidate(
        name=name, words=words, structure=test.structure, ports=ports, quantity=quantity, law=law,
        position=" / ".join(dict.fromkeys(places)), test=name, own_nuisances=own_nuisances, joint=test.joint,
        noise=test.noise, residual_kind=test.spec.noise.residuals,
    )  # fmt: skip


def _frfs_of(test: CaseTest) -> tuple[Ports, VarianceLaw, Quantity]:
    """FRFs that a proposed test would give, with their noise: as it states, or those of the present data."""
    measured, data = test.data.frfs, test.spec.synthetic
    assert measured is not None
    frf = measured.frf
    ports, quantity = Ports(frf.frequency_hz, frf.outputs, frf.inputs), frf.quantity
    law: VarianceLaw = estimated_law(measured)
    if data is not None:
        ports, quantity = Ports(np.array(data.lines_hz()), data.outputs, data.inputs), data.quantity
        law = data.noise.built()
    for label in ports.outputs + ports.inputs:
        if test.spec.structure.absent(label) is not None:
            raise ModelError(f"found no {label} in its structure; expected the DOFs of the present data; number alike")
    return ports, law, quantity


def _changes(text: CaseText) -> str:
    """What a test has different from the rest of the file, for a sentence; not how well it is known."""
    keys = [key for key in text.own if key[0] != "uncertain" and all(isinstance(step, str) for step in key)]
    ends = sorted((key for key in keys if not any(o[: len(key)] == key and o != key for o in keys)), key=text.order)
    data: Any = text.data
    changes = [f"{key[-1]} = {json.dumps(reduce(getitem, key, data), ensure_ascii=False)}" for key in ends[:_NAMED]]
    if not changes:
        return ""
    return f" ({', '.join(changes)}{', …' if len(ends) > _NAMED else ''})"


_G = 1e-3
_DOFS = ("outputs", "inputs")


def candidates_of(case: Case) -> tuple[Candidate, ...]:
    """All single candidates of a case, in the order in which its plan names them.

    On each test with FRFs: each DOF that could be measured and is not, with the present inputs; each that could be
    excited and is not, with the present outputs; both new at once where the plan names inputs; more averages; a wider
    band; an added mass. A pair of DOFs that by reciprocity says what an earlier candidate says is left out where no
    accelerometer has mass. On each with modes: their ratios at each DOF that could be measured. On both, where E,
    density or length is uncertain: the structure hit free. Then the tests that the plan proposes. Of several tests
    the names of candidates begin with theirs; on one in which nothing is joined there are none.

    Raises
    ------
    CaseError
        If the data are neither FRFs nor modes, or a proposed test cannot be.
    """
    specs = {test.name: test.spec for test in case.tests} or {"": case.spec}
    sources = {test.name: test.source for test in case.tests}
    stated = next((spec.plan for spec in specs.values() if spec.plan != PlanSpec()), case.spec.plan)
    candidates: list[Candidate] = []
    already = [test.joints.size for test in case.problem.tests] + [test.joined for test in stated.tests.values()]
    for part in case.problem.parts:
        data = part.test.data
        if data.frfs is None and data.modes is None:
            words = f"found {data.words} as data", "FRFs or modes, whose noise a plan can vary", "plan with these"
            raise CaseError(sources.get(part.test.name, case.source).fault(("data", "kind"), *words))
        if not part.test.joints.size:
            continue
        spec = specs.get(part.test.name, case.spec)
        # a test that lacks one of the plan's DOFs reads none of the plan
        dofs = {key: tuple(x for x in getattr(stated, key) if spec.structure.absent(x) is None) for key in _DOFS}
        planned = spec.model_copy(update={"plan": stated.model_copy(update=dofs)})
        candidates += (_FrfMaker if data.frfs else _ModalMaker)(planned, part, hit_free=not all(already)).all()
    return (*candidates, *proposed_tests(case))


class _Maker(ABC):
    """Makes candidates on one test; `hit_free` is whether a test of the free structure is there or proposed."""

    def __init__(self, spec: CaseSpec, problem: Problem, *, hit_free: bool) -> None:
        self._problem, self._spec = problem, spec
        self._hits_free = not hit_free and is_worth_hitting_free(problem)
        self._recipe = recipe_of(spec.structure, spec.data, problem.test.data)

    @abstractmethod
    def _kinds(self) -> Iterable[Iterator[Candidate]]:
        """What further kinds of candidates are is one more of these, with a method that yields its candidates."""

    def all(self) -> Iterator[Candidate]:
        """Candidates of all kinds."""
        for candidates in self._kinds():
            yield from map(self._name_after_test, candidates)

    def _name_after_test(self, candidate: Candidate) -> Candidate:
        """A candidate with the name of its test, if it is one of several."""
        name = self._problem.test.name
        if not name:
            return candidate
        words = f"{candidate.words} in test {name}"
        return replace(candidate, name=f"{name} {candidate.name}", words=words, test=name)

    def _positions(self, dofs: tuple[str, ...]) -> str:
        """Where points are, each place once."""
        return " / ".join(dict.fromkeys(map(self._spec.structure.place, dofs)))

    def _sensor(self, dof: str) -> str:
        kind = "a rotational accelerometer" if ":r" in dof else "an accelerometer"
        return f"{kind} {self._place(dof)} ({dof}, {self._positions((dof,))})"

    def _place(self, dof: str) -> str:
        """Where a point is, in words."""
        spans = self._spec.structure.spans
        held = (label for joint in self._spec.all_joints.values() for label in joint.dofs + joint.against)
        points = {label.split(":")[0] for label in held}
        point = dof.split(":")[0]
        if point in points:
            return "at the joint"
        if spans is None:
            return "on the structure"
        share = (int(point) - 1) / spans
        if share in (0.0, 1.0) and points <= {"1", str(spans + 1)} and len(points) == 1:
            return "at the tip"
        return "at mid-span" if share == 0.5 else "on the beam"


class _ModalMaker(_Maker):
    """Makes candidates beside modes: natural frequencies as well known as the present ones, ratios to 1 %."""

    def _kinds(self) -> Iterable[Iterator[Candidate]]:
        modes = self._problem.test.data.modes
        assert modes is not None
        return self._at_dofs(modes), self._free(modes)

    def _at_dofs(self, modes: ModalData) -> Iterator[Candidate]:
        shown = self._problem.test.data.dofs
        every = self._spec.model_copy(update={"plan": PlanSpec()}).plan_outputs
        reference = next(iter((*getattr(modes, "references", ()), *self._spec.plan_inputs)), self._farthest(every))
        for dof in self._spec.plan_outputs:
            if dof != reference and dof not in shown:
                words = f"{self._sensor(dof)}, calibrated with the one at {reference}"
                yield ModalCandidate(
                    name=dof, words=words, position=self._positions((dof,)), numbers=modes.numbers,
                    relative=RELATIVE_CALIBRATION, dof=dof, reference=reference,
                )  # fmt: skip

    def _farthest(self, dofs: Sequence[str]) -> str:
        """The DOF that is farthest from the first joint; of masses whose place nobody knows the last."""
        places = self._recipe.positions
        if not places:
            return dofs[-1]
        here = np.array(places[next(iter(self._spec.all_joints.values())).dofs[0].rpartition(":")[0]])
        return max(dofs, key=lambda dof: float(np.linalg.norm(np.array(places[dof.rpartition(":")[0]]) - here)))

    def _free(self, modes: ModalData) -> Iterator[Candidate]:
        if self._hits_free:
            yield from modes_hit_free(self._problem.test, modes, FREE)


class _FrfMaker(_Maker):
    """Makes candidates beside FRFs; noise at other DOFs is as stated, or like that of the measured ones."""

    def __init__(self, spec: CaseSpec, problem: Problem, *, hit_free: bool) -> None:
        super().__init__(spec, problem, hit_free=hit_free)
        measurement, made = problem.test.data.frfs, spec.synthetic
        assert measurement is not None
        self._data, self._lines = measurement.frf, measurement.frf.frequency_hz
        self._law: VarianceLaw = estimated_law(measurement)
        self._step_hz: float | None = None
        if made is not None:
            self._law, self._step_hz = made.noise.built(), made.f_step_hz

    def _kinds(self) -> Iterable[Iterator[Candidate]]:
        return self._at_dofs(), self._averages(), self._band(), self._mass(), self._free()

    def _family(self, recipe: StructureRecipe) -> Body:
        """Structures of a recipe that the prior thinks possible."""
        nuisances = self._problem.prior.nuisances
        names, columns = self._problem.test.structures.names, self._problem.structural_columns
        return family_of_recipe(recipe, {name: nuisances[i].range for name, i in zip(names, columns, strict=True)})

    def _candidate(self, name: str, words: str, **changes: Any) -> FrfCandidate:  # noqa: ANN401 (fields of it)
        """A candidate like the present measurement but for some fields, with noise as it is stated."""
        return as_measured(self._problem, name, words, law=self._law, **changes)

    def _free(self) -> Iterator[Candidate]:
        if self._hits_free:
            yield self._candidate(FREE, FREE_WORDS, test=FREE, joint=Joints(()))

    def _at_dofs(self) -> Iterator[Candidate]:
        """New sensors, new hammers and both, without those whose pairs of DOFs say what is said already."""
        new_outputs = [dof for dof in self._spec.plan_outputs if dof not in self._data.outputs]
        new_inputs = [dof for dof in self._spec.plan_inputs if dof not in self._data.inputs]
        measured = [self._measured(dof, self._sensor(dof), (dof,), ()) for dof in new_outputs]
        measured += [self._measured(f"hammer {dof}", self._hammer(dof), (), (dof,)) for dof in new_inputs]
        for output, dof in itertools.product(new_outputs, new_inputs):
            words = f"{self._sensor(output)} with {self._hammer(dof)}"
            measured.append(self._measured(f"{output} / hammer {dof}", words, (output,), (dof,)))
        seen = {frozenset((o, i)) for o in self._data.outputs for i in self._data.inputs}
        for candidate in measured:
            pairs = {frozenset((o, i)) for o in candidate.ports.outputs for i in candidate.ports.inputs}
            if self._recipe.accelerometer_mass > 0 or not pairs <= seen:
                yield candidate
                seen |= pairs

    def _measured(self, name: str, words: str, sensors: tuple[str, ...], hammers: tuple[str, ...]) -> FrfCandidate:
        """A candidate at other DOFs; a new accelerometer's mass is on the structure beside that of the present ones."""
        structure: AnyStructure = self._problem.test.structure
        if self._recipe.accelerometer_mass > 0 and sensors:
            loaded = dict.fromkeys((*self._recipe.accelerometer_dofs, *sensors))
            structure = self._family(replace(self._recipe, accelerometer_dofs=tuple(loaded)))
        ports = Ports(self._lines, sensors or self._data.outputs, hammers or self._data.inputs)
        return self._candidate(
            name, words, structure=structure, ports=ports, position=self._positions(sensors + hammers)
        )

    def _averages(self) -> Iterator[Candidate]:
        yield repeated(self._problem, self._spec.plan.averages_factor)

    def _band(self) -> Iterator[Candidate]:
        top, data = self._spec.plan.f_max_hz, self._data
        if top is None or self._step_hz is None:
            return
        lines = np.array(band_lines(float(self._lines[0]), top, self._step_hz))
        if lines[-1] > self._lines[-1]:
            ports, new = Ports(lines, data.outputs, data.inputs), float(self._lines[-1])
            yield self._candidate(f"band to {top:g} Hz", f"a band up to {top:g} Hz", ports=ports, above_hz=new)

    def _mass(self) -> Iterator[Candidate]:
        grams = self._spec.plan.added_mass_g
        translations = tuple(dof for dof in self._data.outputs if ":r" not in dof)
        if grams is None or not translations:
            return
        words = f"a mass of {grams:g} g at {' and '.join(translations)}"
        structure = self._family(replace(self._recipe, added_mass=grams * _G))
        yield self._candidate(f"+{grams:g} g", words, structure=structure, position=self._positions(translations))

    def _hammer(self, dof: str) -> str:
        return f"{'a moment' if ':r' in dof else 'a hammer'} {self._place(dof)} ({dof}, {self._positions((dof,))})"
