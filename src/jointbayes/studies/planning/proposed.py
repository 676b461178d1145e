"""Set-ups that a case proposes, `[plan.setups.NAME]`, as candidates of its plan."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from jointbayes.case.build import joints_of, noise_law, noise_of, recipe_of
from jointbayes.case.case import Case
from jointbayes.case.case_text import CaseText
from jointbayes.case.combined import CaseSetup
from jointbayes.case.files import as_measured
from jointbayes.case.schema.case import CaseSpec, parse_planned
from jointbayes.case.schema.data import SyntheticFrfSpec
from jointbayes.case.schema.matrices import MatricesSpec
from jointbayes.case.schema.measured import MeasuredSpec
from jointbayes.case.setup_texts import planned_texts
from jointbayes.case.toml_text import fault_start
from jointbayes.errors import CaseError, JointBayesError, ModelError
from jointbayes.frf import Ports
from jointbayes.inference import Problem
from jointbayes.joint import as_joints
from jointbayes.measurement import FrfMeasurement
from jointbayes.studies.planning.candidates import Candidate, estimated_law

#: So many of a set-up's changes are named in a sentence.
_NAMED = 3


def proposed_setups(case: Case) -> tuple[Candidate, ...]:
    """Candidates that are set-ups, in the order of the case file.

    A set-up is measured as its own tables say; beside measured data at their DOFs and lines, with their noise.

    Raises
    ------
    CaseError
        If one cannot be; file, line and key.
    """
    texts, found = planned_texts(case.source), []
    for name, spec in parse_planned(case.source).items():
        try:
            found.append(_candidate(_built(name, texts[name], spec, case), case.problem))
        except JointBayesError as error:
            place = fault_start(*texts[name].place(()))
            raise CaseError(f"{place} plan.setups.{name}: {error}") from error
    return tuple(found)


def _built(name: str, text: CaseText, spec: CaseSpec, case: Case) -> CaseSetup:
    """A proposed set-up as far as it can be without data, of which those of the first present one say what they are."""
    if not case.setups:
        raise ModelError("found a case without its set-ups; expected the case file, of which they are; load it again")
    first = case.setups[0]
    if isinstance(spec.data, MeasuredSpec):
        spec = as_measured(spec, first.measurement)
    if isinstance(spec.structure, MatricesSpec):
        raise ModelError(
            "found a structure given by matrices; expected a beam, a frame or a chain, of which a set-up can change "
            "something; remove it"
        )
    recipe = recipe_of(spec.structure, spec.data, first.measurement)
    joint = as_joints(joints_of(spec))
    joint.require_one_place(lambda label: recipe.positions.get(label.rpartition(":")[0]))
    noise, of_noise = noise_of(spec.noise, first.measurement)
    return CaseSetup(name, text, spec, recipe, (), joint, first.measurement, noise, of_noise)


def _candidate(setup: CaseSetup, problem: Problem) -> Candidate:
    measured, data, name = setup.measurement, setup.spec.data, setup.name
    assert isinstance(measured, FrfMeasurement)
    if isinstance(data, SyntheticFrfSpec):
        ports = Ports(np.array(data.lines_hz()), data.outputs, data.inputs)
        law, quantity = noise_law(data.noise), data.quantity
    else:
        frf = measured.frf
        ports, law, quantity = Ports(frf.frequency_hz, frf.outputs, frf.inputs), estimated_law(measured), frf.quantity
    for label in ports.outputs + ports.inputs:
        lacking = setup.spec.structure.absent(label)
        if lacking is not None:
            raise ModelError(f"found no {label} in its structure; expected the DOFs of the present data; number alike")
    named, of_noise = setup.named_nuisances()
    own = tuple(one for one, known in zip(named, setup.quantities, strict=True) if one.name != known.name)
    known = {nuisance.name for nuisance in problem.prior.nuisances}
    foreign = [one.name for one in named if one not in own and one.name not in known]
    if foreign:
        raise ModelError(
            f"found that {foreign[0]} is uncertain, which it shares with present set-ups that do not have it; expected "
            f"one of its own; state it in [plan.setups.{name}.uncertain]"
        )
    unknown = [one.name for one in of_noise if one.name not in known]
    if unknown:
        raise ModelError(
            f"found that {unknown[0]} of its noise is inferred, which no present set-up shares with it; expected noise "
            'that is known, or as in a present one; state [noise] for all set-ups, or scale = "known"'
        )
    places = map(setup.spec.structure.place, ports.outputs)
    return Candidate(
        name,
        "setup",
        f"the set-up {name}{_changes(setup.source)}",
        setup.structure,
        ports,
        quantity,
        law,
        position=" / ".join(dict.fromkeys(places)),
        setup=name,
        own=own,
        joint=setup.joint,
        noise=setup.noise,
        residual_kind=setup.spec.noise.residuals,
    )


def _changes(text: CaseText) -> str:
    """What a set-up has different from the rest of the file, for a sentence; not how well it is known."""
    keys = [key for key in text.own if key[0] != "uncertain" and all(isinstance(part, str) for part in key)]
    ends = sorted((key for key in keys if not any(o[: len(key)] == key and o != key for o in keys)), key=text.order)
    said = [f"{key[-1]} = {_value(text.data, key)}" for key in ends[:_NAMED]]
    if not said:
        return ""
    return f" ({', '.join(said)}{', …' if len(ends) > _NAMED else ''})"


def _value(data: Mapping[str, Any], key: tuple[str | int, ...]) -> str:
    value: Any = data
    for part in key:
        value = value[part]
    return json.dumps(value, ensure_ascii=False)
