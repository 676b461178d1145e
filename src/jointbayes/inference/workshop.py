"""A problem with material, length, damping and accelerometers as uncertain as in a workshop."""

import math
from collections.abc import Mapping
from dataclasses import replace

from jointbayes.frf import Substructures
from jointbayes.inference.marginals import Normal, Nuisance, Uniform
from jointbayes.inference.problem import Problem
from jointbayes.inference.test import Test, own_name
from jointbayes.joint.quantities import prefixed
from jointbayes.structure import ModalDamping
from jointbayes.structure.recipe import UncertainBody, is_damping_ratio

#: Standard deviations of what a workshop does not know exactly.
WORKSHOP_SD_PERCENT = {"youngs_modulus": 3.0, "density": 1.0, "length": 0.5}
_ACCELEROMETER_SD_PERCENT = 5.0
#: Ends of the factor on damping ratios, and the most that the largest of them may become.
_DAMPING_FACTORS, _MOST_DAMPING = (0.1, 10.0), 0.9
#: Order of a structure's quantities among the coordinates; those of single bodies follow.
_ORDER = ("youngs_modulus", "density", "length", "length_offset", "section_size", "shear_coefficient", "axial_force",
          "damping_ratio", "loss_factor", "accelerometer_mass")  # fmt: skip


def in_workshop(problem: Problem) -> Problem:
    """Return the problem with all uncertain that a workshop does not know exactly.

    E to 3 %, density to 1 %, length to 0.5 %, and of FRFs accelerometers to 5 % and damping ratios to a factor of 10
    either way. What the prior states stays so, and what `Problem.exact` names stays exact. Structures that are given
    by matrices have none of these quantities.
    """
    every, stated = (*problem.tests, *problem.left_out), {n.name: n for n in problem.prior.nuisances}
    largest = max((ratio for test in every for ratio in _damping_ratios(test)), default=0.0)
    nuisances: dict[str, Nuisance] = {}
    bodies: dict[int, UncertainBody] = {}
    for test in every:
        body = test.structures
        if not isinstance(body, UncertainBody) or id(test.structure) in bodies:
            continue
        # 1. What the problem states of this test, and what a workshop adds to it.
        own = {name: named for name in body.names if (named := own_name(test.name, name, stated))}
        of_test = {name: stated[named] for name, named in own.items()}
        for nuisance in _usual(test, body, largest):
            name = "damping_ratio" if is_damping_ratio(nuisance.name) else nuisance.name
            kinds = {"damping_ratio" if is_damping_ratio(known) else known for known in own}
            if "length_offset" in own:  # the error of the length is stated
                kinds.add("length")
            if name not in kinds and not {name, prefixed(test.name, name)} & set(problem.exact):
                of_test[nuisance.name] = stated.get(nuisance.name, nuisance)
        # 2. The structure with their ranges.
        kinds_of = {name: "damping_ratio" if is_damping_ratio(name) else name for name in of_test}
        order = {name: _ORDER.index(kind) if kind in _ORDER else len(_ORDER) for name, kind in kinds_of.items()}
        of_test = {name: of_test[name] for name in sorted(of_test, key=order.__getitem__)}
        ranges: Mapping[str, tuple[float, float]] = {name: nuisance.range for name, nuisance in of_test.items()}
        bodies[id(test.structure)] = replace(body, ranges=ranges)
        # 3. The coordinates, each once; tests that state other values share a factor on them.
        for nuisance in of_test.values():
            first = nuisances.setdefault(nuisance.name, nuisance)
            if (first.unit, first.nominal) != (nuisance.unit, nuisance.nominal):
                nuisances[nuisance.name] = replace(first, unit="× stated", nominal=1.0)
    rest = [nuisance for name, nuisance in stated.items() if name not in nuisances]  # of the measurement and its noise

    def freed(test: Test) -> Test:
        if (body := bodies.get(id(test.structure))) is None:
            return test
        whole = test.structure
        return replace(test, structure=replace(whole, modelled=body) if isinstance(whole, Substructures) else body)

    tests, left_out = (tuple(map(freed, some)) for some in (problem.tests, problem.left_out))
    prior = replace(problem.prior, nuisances=(*nuisances.values(), *rest))
    return replace(problem, tests=tests, left_out=left_out, prior=prior)


def _usual(test: Test, body: UncertainBody, largest: float) -> list[Nuisance]:
    """What a workshop does not know exactly of a structure, where it has such."""
    percent = WORKSHOP_SD_PERCENT | {"accelerometer_mass": _ACCELEROMETER_SD_PERCENT}
    usual = [
        Nuisance(name, unit, value, Normal(0.0, percent[name] / 100))
        for name, (unit, value) in body.recipe.usual.items()
        if name != "accelerometer_mass" or (test.data.frfs is not None and value > 0)
    ]
    ratios = _damping_ratios(test)
    if test.data.frfs is None or not ratios or min(ratios) <= 0:
        return usual
    low, high = _DAMPING_FACTORS
    factor = Uniform(math.log(low), math.log(max(min(high, _MOST_DAMPING / largest), 1.0)))
    names = [f"damping_ratio_{i}" for i in range(1, len(ratios) + 1)] if len(ratios) > 1 else ["damping_ratio"]
    return usual + [Nuisance(name, "1", ratio, factor) for name, ratio in zip(names, ratios, strict=True)]


def _damping_ratios(test: Test) -> tuple[float, ...]:
    law = getattr(test.structures, "recipe", test.structures).damping
    return law.ratios if isinstance(law, ModalDamping) else ()
