"""The further measurements that a case could be given, from its `[plan]` table."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointbayes.case.build import family_of, noise_law, recipe_of
from jointbayes.case.case import Case
from jointbayes.case.schema.data import SyntheticFrfSpec
from jointbayes.errors import CaseError
from jointbayes.frf import Ports
from jointbayes.measurement import FrfMeasurement
from jointbayes.studies.planning.candidates import Candidate, CandidateKind, VarianceLaw, estimated_law, repeated

__all__ = ["candidates_of"]

Array = NDArray[np.float64]
_G = 1e-3


def candidates_of(case: Case) -> tuple[Candidate, ...]:
    """All single candidates of a case, in the order in which its plan names them.

    Each DOF that could be measured and is not, with the present inputs; each that could be excited and is not, with
    the present outputs; both new at once where the plan names inputs; more averages; a wider band; an added mass. A
    pair of DOFs that by reciprocity says what an earlier candidate says is left out where no accelerometer has mass.

    Raises
    ------
    CaseError
        If the data are natural frequencies.
    """
    if not isinstance(case.problem.measurement, FrfMeasurement):
        raise CaseError(
            f"{case.name}: found natural frequencies as data; a plan expects FRFs, whose noise and band it can vary; "
            'write [data] with kind = "synthetic_frf" or "measured_frf"'
        )
    return _Maker(case, case.problem.measurement).all()


class _Maker:
    """Makes candidates from one case; noise at other DOFs is as stated, or like that of the measured FRFs."""

    def __init__(self, case: Case, measurement: FrfMeasurement) -> None:
        data = case.spec.data
        self._case, self._data, self._spec = case, measurement.frf, case.spec
        self._recipe = recipe_of(case.spec.structure, data, case.problem.measurement)
        self._law: VarianceLaw = estimated_law(measurement)
        self._step_hz: float | None = None
        if isinstance(data, SyntheticFrfSpec):
            self._law, self._step_hz = noise_law(data.noise), data.f_step_hz
        self._lines = measurement.frf.frequency_hz

    def all(self) -> tuple[Candidate, ...]:
        seen = {frozenset((o, i)) for o in self._data.outputs for i in self._data.inputs}
        found: list[Candidate] = []
        for candidate in self._at_dofs():
            ports = candidate.ports
            pairs = {frozenset((o, i)) for o in ports.outputs for i in ports.inputs}
            if self._recipe.accelerometer_mass > 0 or not pairs <= seen:
                found.append(candidate)
                seen |= pairs
        noise = self._case.problem.noise
        if noise is None or noise.averages_out:
            found.append(repeated(self._case.problem, self._spec.plan.averages_factor))
        return (*found, *self._band(), *self._mass())

    def _at_dofs(self) -> Iterator[Candidate]:
        here, struck = self._data.outputs, self._data.inputs
        new_outputs = [dof for dof in self._spec.plan_outputs if dof not in here]
        new_inputs = [dof for dof in self._spec.plan_inputs if dof not in struck]
        for dof in new_outputs:
            yield self._measured(dof, "accelerometer", self._sensor(dof), (dof,), struck)
        for dof in new_inputs:
            yield self._measured(f"hammer {dof}", "hammer", self._hammer(dof), here, (dof,))
        for out in new_outputs:
            for dof in new_inputs:
                words = f"{self._sensor(out)} with {self._hammer(dof)}"
                yield self._measured(f"{out} / hammer {dof}", "pair", words, (out,), (dof,))

    def _measured(
        self, name: str, kind: CandidateKind, words: str, outputs: tuple[str, ...], inputs: tuple[str, ...]
    ) -> Candidate:
        """A candidate at other DOFs; a new accelerometer's mass is on the structure beside that of the present ones."""
        loaded = self._recipe.accelerometer_dofs + tuple(
            dof for dof in outputs if dof not in self._recipe.accelerometer_dofs
        )
        recipe = replace(self._recipe, accelerometer_dofs=loaded)
        problem = self._case.problem
        structure = problem.structure
        if recipe.accelerometer_mass > 0 and kind != "hammer":
            structure = family_of(recipe, problem.prior)
        ports = Ports(self._lines, outputs, inputs)
        placed = (outputs if kind != "hammer" else ()) + (inputs if kind != "accelerometer" else ())
        where = self._positions(placed)
        return Candidate(name, kind, words, structure, ports, self._data.quantity, self._law, position=where)

    def _band(self) -> Iterator[Candidate]:
        top, data, problem = self._spec.plan.f_max_hz, self._data, self._case.problem
        if top is None or self._step_hz is None:
            return
        steps = math.floor((top - float(self._lines[0])) / self._step_hz + 1e-9)
        lines: Array = float(self._lines[0]) + self._step_hz * np.arange(steps + 1, dtype=float)
        if lines[-1] <= self._lines[-1]:
            return
        yield Candidate(
            f"band to {top:g} Hz",
            "band",
            f"a band up to {top:g} Hz",
            problem.structure,
            Ports(lines, data.outputs, data.inputs),
            data.quantity,
            self._law,
            above_hz=float(self._lines[-1]),
        )

    def _mass(self) -> Iterator[Candidate]:
        grams = self._spec.plan.added_mass_g
        translations = tuple(dof for dof in self._data.outputs if ":r" not in dof)
        if grams is None or not translations:
            return
        data, problem = self._data, self._case.problem
        yield Candidate(
            f"+{grams:g} g",
            "mass",
            f"a mass of {grams:g} g at {' and '.join(translations)}",
            family_of(replace(self._recipe, added_mass=grams * _G), problem.prior),
            Ports(self._lines, data.outputs, data.inputs),
            data.quantity,
            self._law,
            position=self._positions(translations),
        )

    def _positions(self, dofs: tuple[str, ...]) -> str:
        """Where points are, each place once."""
        return " / ".join(dict.fromkeys(map(self._spec.structure.place, dofs)))

    def _sensor(self, dof: str) -> str:
        kind = "a rotational accelerometer" if ":r" in dof else "an accelerometer"
        return f"{kind} {self._place(dof)} ({dof}, {self._positions((dof,))})"

    def _hammer(self, dof: str) -> str:
        return f"{'a moment' if ':r' in dof else 'a hammer'} {self._place(dof)} ({dof}, {self._positions((dof,))})"

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
