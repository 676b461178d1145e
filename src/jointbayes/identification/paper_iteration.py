"""The sensitivity iteration of Cao, Li and He, Eqs. (3)-(9).

References
----------
Cao, H., Li, B., He, Z. A joint stiffness identification method based on finite element modeling and
frequency response functions.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.frf import Ports, receptance_model
from jointbayes.inference import Problem
from jointbayes.joint import AnyJoint, Parametrisation, parametrisation_named
from jointbayes.stored_values import StoredArray
from jointbayes.structure import Body
from vibrecords import FrfSet
from vibrecords.arrays import Array, ComplexArray

SensitivityKind = Literal["measured", "analytical"]

_MOST_LISTED = 12  # quantities in a line of text
_RUNAWAY = 1e18  # a stiffness beyond any joint, in N/m: the iteration has left for good


def listed_values(units: Mapping[str, str], values: Array) -> str:
    """Quantities, shape (q,), with names and units: those that come first, and how many more there are."""
    each = zip(units.items() or [("", "")] * values.size, values, strict=True)
    named = [f"{name} = {value:.4g} {unit}".strip(" =") for (name, unit), value in each]
    return ", ".join(named[:_MOST_LISTED]) + f" and {values.size - _MOST_LISTED} more" * (values.size > _MOST_LISTED)


@dataclass(frozen=True, slots=True)
class IterationHistory:
    """What the iteration did; step 0 is the first guess.

    Parameters
    ----------
    stiffness_history
        The joint's quantities at each step, shape (steps + 1, q); those not `iterated` stay at the first guess.
    residual_norm
        ‖ε‖ at each step relative to the norm of the measured FRFs, shape (steps + 1,).
    converged
        Whether ‖ε‖ fell to the threshold.
    left_cone
        Steps at which K^J was not positive semidefinite, which no passive joint is.
    reason
        One sentence on how it ended.
    iterated
        Which of the quantities act in the data, by their places: of several tests those of `test`.
    test
        The test whose data they are; empty where there is one test.
    units
        Name and unit of each quantity.
    """

    stiffness_history: StoredArray
    residual_norm: StoredArray
    converged: bool
    left_cone: tuple[int, ...]
    reason: str
    iterated: tuple[int, ...]
    test: str = ""
    units: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"IterationHistory({listed_values(self.units, self.stiffness)}{self.on_test}; {self.reason})"

    @property
    def on_test(self) -> str:
        """Words that name the test, to stand behind "the paper's iteration"; empty where there is one test."""
        return f" on test {self.test}" if self.test else ""

    @property
    def stiffness(self) -> Array:
        """Last quantities, shape (q,)."""
        return self.stiffness_history[-1]

    @property
    def steps(self) -> int:
        """Number of steps taken."""
        return len(self.residual_norm) - 1


def sensitivity_iteration(
    structure: Body,
    joint: AnyJoint,
    measured: FrfSet,
    outputs: tuple[str, ...],
    initial: ArrayLike,
    *,
    threshold: float = 1e-9,
    max_steps: int = 30,
    sensitivity: SensitivityKind = "measured",
    line_weight: float = 0.0,
    parametrisation: Parametrisation | None = None,
) -> IterationHistory:
    """Identify the stiffnesses of a joint by the paper's iteration, Eqs. (3)-(9).

    1. Predict the FRFs of the joint at hand, and take the residual ε_H; end where it is below the threshold.
    2. Solve S Δu = −ε_H for the change of the stiffnesses, by least squares over all lines, and go on with that joint.
    3. Say how it ended.

    Parameters
    ----------
    structure, joint
        Body without the joint, at its nominal quantities, and where the joint acts.
    measured
        Measured receptances H^x. Outputs: `outputs` and every DOF of the joint, rotation included; inputs: the
        excitations v.
    outputs
        DOFs at which the residual FRF ε_H = H^a − H^x is taken (the paper takes H21,21).
    initial
        First guess of the joint's quantities, shape (q,); the paper starts at (1e8, 0, 0).
    threshold
        The threshold e on ‖ε‖, as a fraction of ‖H^x‖ over the same FRFs. Of a reduced model it is ten times what its
        finer reduction differs by, where that is more: no joint brings it nearer to the FRFs of the whole.
    max_steps
        Step limit.
    sensitivity
        ``"measured"``: S_i = −H^a K_i H^x, as in the paper.  ``"analytical"``: S_i = −H^a K_i H^a, the derivative
        of the predicted FRF (Gauss-Newton).
    line_weight
        Exponent p of row weights |H^x|⁻ᵖ in the least squares. 0 is the paper as printed: the lines at resonance
        outweigh all others, and a few per cent of noise make the iteration run away. 1/2 balances them.
    parametrisation
        Says what the quantities are; by default the paper's k11, k12 and k22 of a joint of two DOFs.

    Raises
    ------
    ModelError
        If a DOF does not exist.
    """
    kind = parametrisation or parametrisation_named("log")
    system = _System(structure, joint, measured.converted("receptance"), outputs, kind)
    size, weight = np.linalg.norm(system.target), np.abs(system.target) ** -line_weight
    k = np.asarray(initial, dtype=float)
    made = structure.discretisation
    if made is not None and made.kind == "reduced":
        richer = structure.reference(solved=False)
        finer = _System(richer, joint, measured.converted("receptance"), outputs, kind)
        difference = system.residual(system.predict(k)) - finer.residual(finer.predict(k))
        threshold = max(threshold, 10 * float(np.linalg.norm(difference) / size))
    history: list[Array] = []
    norms: list[float] = []
    while len(norms) <= max_steps and np.abs(k).max() < _RUNAWAY:
        # 1. residual
        predicted = system.predict(k)
        residual = system.residual(predicted)
        history.append(k)
        norms.append(float(np.linalg.norm(residual) / size))
        if norms[-1] <= threshold:
            break
        # 2. Cao et al. Eq. (9): S_i = −H^a K_i H^x_v, here for every output and input at once; real and imaginary
        # parts stacked, columns scaled
        response = system.deformation(system.measured if sensitivity == "measured" else predicted)
        to_joint = system.response_to_joint(predicted)
        columns = -(weight * np.einsum("lro,irs,lsv->ilov", to_joint, kind.pattern, response)).reshape(len(k), -1)
        matrix = np.concatenate([columns.real, columns.imag], axis=1).T
        right = -(weight * residual).ravel()
        right = np.concatenate([right.real, right.imag])
        length = np.linalg.norm(matrix, axis=0)
        scale = np.where(length == 0, 1.0, length)
        solution, *_ = np.linalg.lstsq(matrix / scale, right, rcond=None)
        k = k + np.where(length == 0, 0.0, solution / scale)  # what does not act stays to the last bit
    # 3. words
    stiffness, steps, converged = np.array(history), len(norms) - 1, norms[-1] <= threshold
    outside = np.flatnonzero(~kind.is_positive_semidefinite(stiffness))
    words = "converged in {} steps: residual" if converged else "did not converge: after {} steps the residual is"
    reason = f"{words.format(steps)} {norms[-1]:.1e} of the measured FRF, threshold {threshold:.0e}"
    if outside.size:
        reason += (
            f"; K^J was not positive semidefinite at {outside.size} of {steps + 1} steps, first at step {outside[0]}"
        )
    iterated = tuple(i for i, quantity in enumerate(kind.quantities) if quantity.places)
    units = {quantity.name: quantity.unit for quantity in kind.quantities}
    left = tuple(outside.tolist())
    return IterationHistory(stiffness, np.array(norms), converged, left, reason, iterated, units=units)


class _System:
    """Measured FRFs, and the model that predicts them and those between the outputs and the joint."""

    def __init__(
        self,
        structure: Body,
        joint: AnyJoint,
        measured: FrfSet,
        outputs: tuple[str, ...],
        parametrisation: Parametrisation,
    ) -> None:
        self.measured, self._outputs, self.parametrisation = measured, outputs, parametrisation
        self._at_joint = at_joint = joint.labels
        self._deformation = joint.deformations(at_joint)
        self._ports = Ports(
            measured.frequency_hz,
            tuple(dict.fromkeys(outputs + at_joint)),
            tuple(dict.fromkeys(measured.inputs + at_joint)),
        )
        self._model = receptance_model(structure, joint, self._ports)
        self.target = measured.select(outputs, measured.inputs).values

    def predict(self, stiffness: Array) -> FrfSet:
        """H^a between all outputs, inputs and DOFs of the joint."""
        ports = self._ports
        values = self._model.receptance(self.parametrisation.matrix(stiffness))[0]
        return FrfSet(ports.frequency_hz, values, ports.outputs, ports.inputs)

    def residual(self, predicted: FrfSet) -> ComplexArray:
        """ε_H = H^a − H^x, Eq. (5), shape (lines, outputs, inputs)."""
        return predicted.select(self._outputs, self.measured.inputs).values - self.target

    def deformation(self, frf: FrfSet) -> ComplexArray:
        """Deformation of the joint by unit force at each input, shape (lines, r, inputs)."""
        return np.einsum("ar,lai->lri", self._deformation, frf.select(self._at_joint, self.measured.inputs).values)

    def response_to_joint(self, predicted: FrfSet) -> ComplexArray:
        """Response of the outputs to unit force in the joint, shape (lines, r, outputs)."""
        return np.einsum("ar,loa->lro", self._deformation, predicted.select(self._outputs, self._at_joint).values)


def part_to_iterate(problem: Problem) -> Problem | None:
    """The test on which the paper's iteration runs: the first with FRFs at its joint; None where it cannot run.

    It knows no damping of a joint, and neither measured bodies nor modes have such FRFs.
    """
    if problem.parametrisation.damped:
        return None
    joined = (part for part in problem.parts if part.test.joints.size)
    return next((part for part in joined if part.test.joint_frf is not None), None)


def missing_for_iteration(problem: Problem) -> str:
    """What measurement files lack for the paper's iteration, in words; empty where no file could have had it."""
    provenances = (test.data.provenance for test in problem.tests)
    return next(
        (provenance.iteration for provenance in provenances if provenance is not None and provenance.iteration), ""
    )


def why_not_iterated(problem: Problem) -> str:
    """What was found in place of what the paper's iteration expects."""
    bodies = [body.name for test in problem.tests for body in test.measured_bodies]
    if bodies:
        return (
            f"found the measured body {bodies[0]}; the paper's iteration expects a structure that is modelled "
            "throughout"
        )
    if problem.parametrisation.damped:
        return "found damping of the joint; the paper's iteration expects stiffnesses alone"
    if not any(test.data.frfs for test in problem.tests):
        return f"found {problem.tests[0].data.words} as data; the paper's iteration expects FRFs"
    return missing_for_iteration(problem) or "found no FRFs at the joint; the paper's iteration expects joint_frf"
