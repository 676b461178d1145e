"""The set-ups that the plan of a case proposes, each built as far as it can be without data of its own."""

import json
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np

from jointbayes.case.case import Case
from jointbayes.case.case_objects import CaseSetup, complete_from_data, noise_of, quantities_of, recipe_of
from jointbayes.case.case_text import CaseText, planned_texts
from jointbayes.case.parse import parse_planned
from jointbayes.case.spec.imported_table import ImportedSpec
from jointbayes.case.spec.structure_kinds import MatricesSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import fault_start
from jointbayes.errors import CaseError, JointBayesError, ModelError
from jointbayes.frf import Ports
from jointbayes.inference import Problem
from jointbayes.joint import joints_of
from jointbayes.posterior.candidate import Candidate, FrfCandidate, ModalCandidate, VarianceLaw, estimated_law, scatter
from vibrecords import Quantity

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
    texts, candidates = planned_texts(case.source), []
    for name, spec in parse_planned(case.source).items():
        try:
            candidates.append(_candidate(_built(name, texts[name], spec, case), case.problem))
        except JointBayesError as error:
            raise CaseError(f"{fault_start(*texts[name].place(()))} plan.setups.{name}: {error}") from error
    return tuple(candidates)


def _built(name: str, text: CaseText, spec: CaseSpec, case: Case) -> CaseSetup:
    """A proposed set-up as far as it can be without data, of which those of the first present one say what they are."""
    if not case.setups:
        raise ModelError("found a case without its set-ups; expected the case file, of which they are; load it again")
    first = case.setups[0]
    if spec.files is not None:
        spec = complete_from_data(spec, first.data)
    if isinstance(spec.structure, MatricesSpec | ImportedSpec):
        raise ModelError(
            "found a structure given by matrices or imported; expected a beam, a frame or a chain, of which a set-up "
            "can change something; remove it"
        )
    recipe = recipe_of(spec.structure, spec.data, first.data)
    joint = joints_of(spec.joint_objects)
    joint.require_one_place(lambda label: recipe.positions.get(label.rpartition(":")[0]))
    premises = case.problem.premises
    if not premises.reason:
        return CaseSetup(name, text, spec, recipe, (), joint, first.data, *noise_of(spec, first.data))
    # measured as what the present data are taken as, and as uncertain as they are
    data = next((test.data for test in case.problem.tests if test.name == first.name), case.problem.tests[0].data)
    if premises.of_modes:  # which do not see the damping
        certain = spec.uncertain.model_copy(update={"damping_ratio": None, "loss_factor": None})
        spec = spec.model_copy(update={"uncertain": certain})
    setup = CaseSetup(name, text, spec, recipe, (), joint, data, noise_of(spec, data)[0], ())
    return setup.with_workshop_uncertainty(case.largest_damping) if premises.assumed else setup


def _candidate(setup: CaseSetup, problem: Problem) -> Candidate:
    name = setup.name
    named, of_noise = setup.named_nuisances()
    each = zip(named, quantities_of(setup.spec), strict=True)
    own_nuisances = tuple(nuisance for nuisance, (_, of_setup) in each if of_setup)
    present_names = {nuisance.name for nuisance in problem.prior.nuisances}
    own_names = {nuisance.name for nuisance in own_nuisances}
    foreign = [nuisance.name for nuisance in named if nuisance.name not in present_names | own_names]
    if foreign:
        raise ModelError(
            f"found that {foreign[0]} is uncertain, which it shares with present set-ups that do not have it; expected "
            f"one of its own; state it in [plan.setups.{name}.uncertain]"
        )
    unknown = [nuisance.name for nuisance in of_noise if nuisance.name not in present_names]
    if unknown:
        raise ModelError(
            f"found that {unknown[0]} of its noise is inferred, which no present set-up shares with it; expected noise "
            'that is known, or as in a present one; state [noise] for all set-ups, or scale = "known"'
        )
    words = f"the set-up {name}{_changes(setup.source)}"
    if setup.data.frfs is None:
        modes = setup.data.modes
        assert modes is not None
        return ModalCandidate(
            name=name, words=words, setup=name, own_nuisances=own_nuisances, joint=setup.joint,
            structure=setup.structure, numbers=modes.numbers, relative=scatter(modes),
        )  # fmt: skip
    ports, law, quantity = _frfs_of(setup)
    places = map(setup.spec.structure.place, ports.outputs)
    return FrfCandidate(
        name=name, words=words, structure=setup.structure, ports=ports, quantity=quantity, law=law,
        position=" / ".join(dict.fromkeys(places)), setup=name, own_nuisances=own_nuisances, joint=setup.joint,
        noise=setup.noise, residual_kind=setup.spec.noise.residuals,
    )  # fmt: skip


def _frfs_of(setup: CaseSetup) -> tuple[Ports, VarianceLaw, Quantity]:
    """FRFs that a proposed set-up would give, with their noise: as it states, or those of the present data."""
    measured, data = setup.data.frfs, setup.spec.synthetic
    assert measured is not None
    frf = measured.frf
    ports, quantity = Ports(frf.frequency_hz, frf.outputs, frf.inputs), frf.quantity
    law: VarianceLaw = estimated_law(measured)
    if data is not None:
        ports, quantity = Ports(np.array(data.lines_hz()), data.outputs, data.inputs), data.quantity
        law = data.noise.law()
    for label in ports.outputs + ports.inputs:
        if setup.spec.structure.absent(label) is not None:
            raise ModelError(f"found no {label} in its structure; expected the DOFs of the present data; number alike")
    return ports, law, quantity


def _changes(text: CaseText) -> str:
    """What a set-up has different from the rest of the file, for a sentence; not how well it is known."""
    keys = [key for key in text.own if key[0] != "uncertain" and all(isinstance(step, str) for step in key)]
    ends = sorted((key for key in keys if not any(o[: len(key)] == key and o != key for o in keys)), key=text.order)
    data: Any = text.data
    changes = [f"{key[-1]} = {json.dumps(reduce(getitem, key, data), ensure_ascii=False)}" for key in ends[:_NAMED]]
    if not changes:
        return ""
    return f" ({', '.join(changes)}{', …' if len(ends) > _NAMED else ''})"
