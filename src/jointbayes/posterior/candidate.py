"""Further measurements that could be made, as data of the model itself: FRFs, modes, their ratios, antiresonances."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from jointbayes.frf import AnyStructure, Ports
from jointbayes.inference import ModelErrorNoise, NoiseModel, Nuisance, Problem, Test
from jointbayes.inference.likelihood_base import ResidualKind
from jointbayes.inference.test import columns_of_names
from jointbayes.joint import AnyJoint, Joints
from jointbayes.posterior.prediction import replace_values, simulated_values
from vibrecords import (
    Antiresonances,
    FrfData,
    FrfSet,
    ModalData,
    ModeData,
    ModeShapes,
    Observed,
    Quantity,
    RelativeNoise,
    quantity_factor,
)
from vibrecords.arrays import Array

ComplexArray = NDArray[np.complex128]

#: Name of a test of the structure without its joints, and what it is in a sentence.
FREE, FREE_WORDS = "free", "the structure hit free, before it is joined"
#: Quantities of a body of which its frequencies say the same whether it is free or joined.
_OF_BODY = frozenset({"youngs_modulus", "density", "length"})

#: Part of the largest FRF below which a value counts as zero noise in the estimate of a law: rounding.
_TINY = 1e-12
#: How well a sensor that roves, or one calibrated beside another, knows a ratio of components, as a fraction of it.
RELATIVE_CALIBRATION = 0.01
_NODE = 0.01  # ratios below this are not known better than one of this size
#: Standard deviation of natural frequencies beside a ratio of which nothing is to be said, as a fraction.
_UNKNOWN = 1e3
_KNOWN = 1 + 1e-6  # factor by which the size of an error may be larger where it is known


def is_worth_hitting_free(part: Problem) -> bool:
    """Whether the structure of a test without its joints is the same body, hangs on nothing else, and is uncertain.

    Where the edge of the clamp is uncertain as a length in mm the bar goes on behind it, and is another one free.
    """
    test = part.test
    joints = test.joints.joints if isinstance(test.joints, Joints) else (test.joints,)
    to_ground = joints and not any(joint.against for joint in joints) and not test.measured_bodies
    supports = getattr(getattr(test.structures, "recipe", None), "supports", ())
    uncertain = {name.rpartition(".")[2] for name in test.structures.names}
    return bool(to_ground and not supports and "length_offset" not in uncertain and uncertain & _OF_BODY)


class VarianceLaw(Protocol):
    """How noisy FRFs will be: that of the case (`NoiseLaw`), or one estimated from a measurement."""

    def variance(self, values: ComplexArray) -> Array:
        """σ² = E|δH|², shape as `values` (lines, outputs, inputs)."""


@dataclass(frozen=True, slots=True, eq=False)
class StatedVariance:
    """The variance that a measurement states, whatever the FRF: for one that is to be repeated.

    Parameters
    ----------
    stated
        σ², shape (lines, outputs, inputs).
    """

    stated: Array

    def variance(self, values: ComplexArray) -> Array:
        """The stated variance; `values` must have its shape."""
        return self.stated


def estimated_law(data: FrfData) -> RelativeNoise:
    """Relative noise and floor that come nearest to a measurement's own variance, for DOFs that it does not have.

    The standard deviation of a part is fitted as a|H| + b·median|H| with a, b ≥ 0, relative deviations squared.
    Exact where the variance was made so from an FRF without noise.
    """
    magnitude = np.abs(data.frf.values)
    sd = np.sqrt(data.variance / 2)
    floor = np.broadcast_to(np.median(magnitude, axis=0), magnitude.shape)
    terms = np.stack([magnitude / sd, floor / sd], axis=-1).reshape(-1, 2)
    (relative, share), _ = optimize.nnls(terms, np.ones(len(terms)))
    return RelativeNoise(max(float(relative), _TINY), float(share))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Candidate(ABC):
    """A further measurement, independent of the present one and of each other candidate, given the parameters.

    Parameters
    ----------
    name
        Short: ``"6:y"``, ``"hammer 6:y"``, ``"4 x averages"``.
    words
        For a sentence: ``"an accelerometer at mid-span (6:y)"``.
    position
        Where on the structure: ``"191.5 mm"``; empty where nothing is placed.
    test
        Of a proposed test its name, with which the names of its own quantities begin; of a further measurement on
        one of several present tests the name of that one.
    own_nuisances
        Quantities that a proposed test has for itself, such as ``short.length``, with their priors.
    structure
        What is measured, without the joint; as of `Problem`; None of the present one. They differ by added masses.
    joint
        Of a proposed test where the joints act; None where that is as in the present one.
    """

    name: str
    words: str
    position: str = ""
    test: str = ""
    own_nuisances: tuple[Nuisance, ...] = ()
    structure: AnyStructure | None = None
    joint: AnyJoint | None = None

    @abstractmethod
    def problem(self, problem: Problem, theta: Array, rng: np.random.Generator | None = None) -> Problem:
        """The candidate measured where θ, shape (d,), is the truth: a problem over the same parameters.

        Parameters
        ----------
        problem
            The present problem, whose prior and noise model hold for the candidate as well; over the candidate's own
            quantities too, where it has any, see `jointbayes.posterior.first_look.WithOwn`.
        theta
            Truth, shape (d,), the parameters of the noise included.
        rng
            Source of the noise; None leaves the values exact, with their variance still stated.
        """

    def present(self, problem: Problem) -> Problem:
        """The part of the present problem with the test on which it is, or beside which it is proposed."""
        return next((part for part in problem.parts if part.test.name == self.test), problem.parts[0])

    def without_data(self, problem: Problem) -> Problem:
        """The same with its own structure and joints, whose data are still the present ones."""
        present = self.present(problem)
        test = replace(
            present.test,
            name=self.test or present.test.name,
            structure=self.structure or present.test.structure,
            joints=present.test.joints if self.joint is None else self.joint,
        )
        return replace(present, tests=(test,), extra_log_likelihood=None)  # what else is known is known once


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrfCandidate(Candidate):
    """Further FRFs.

    Parameters
    ----------
    ports
        Lines, outputs and inputs.
    quantity
        Receptance, mobility or accelerance.
    law
        Noise.
    above_hz
        Only lines above this frequency are new; the noise law sees all lines, since its floor is relative to their
        median.
    noise, residual_kind
        Of a proposed test how its residuals are judged; None where that is as in the present one.
    """

    ports: Ports
    quantity: Quantity
    law: VarianceLaw
    above_hz: float = 0.0
    noise: NoiseModel | None = None
    residual_kind: ResidualKind | None = None

    def problem(self, problem: Problem, theta: Array, rng: np.random.Generator | None = None) -> Problem:
        """The FRFs measured where θ is the truth, see `Candidate`."""
        point, present = np.asarray(theta, dtype=float), self.present(problem)
        there = self.without_data(problem)
        there = there.with_test(residual_kind=self.residual_kind or present.test.residual_kind)
        factors = there.prior.factors(point)
        model = there.test.receptance_model(self.ports)
        true = model.receptance(there.prior.matrix(point), there.structural(factors))[0]
        true = float(there.gain(factors)) * true
        true = true * quantity_factor(self.ports.frequency_hz, self.quantity)[:, None, None]
        kept = self.ports.frequency_hz > self.above_hz
        lines, values, variance = self.ports.frequency_hz[kept], true[kept], self.law.variance(true)[kept]
        frf = FrfSet(lines, values, self.ports.outputs, self.ports.inputs, self.quantity)
        if rng is not None:
            noise = _noise(present, there, self.noise, point, FrfData(frf, variance), rng)
            frf = replace(frf, values=values - np.sqrt(variance) * noise)
        measurement = FrfData(frf, variance, synthetic=True)
        law = self.noise or present.test.noise
        return there.with_test(data=measurement, noise=law and law.fitted_to(measurement, law.parts))


def as_measured(problem: Problem, name: str, words: str, **changes: Any) -> FrfCandidate:  # noqa: ANN401 (fields)
    """A candidate like the FRFs of a problem of one test but for some fields; noise like theirs without a law."""
    measured, structure = problem.test.data.frfs, problem.test.structure
    assert measured is not None
    frf, law = measured.frf, changes.pop("law", None) or estimated_law(measured)
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    like = FrfCandidate(name=name, words=words, structure=structure, ports=ports, quantity=frf.quantity, law=law)
    return replace(like, **changes)


def repeated(problem: Problem, averages_factor: float) -> FrfCandidate:
    """The present measurement of FRFs with so many times the averages, as what is added to it.

    Averages of n of which one part is in hand: the new part alone has the variance σ²/(factor − 1).
    """
    measured = problem.test.data.frfs
    assert measured is not None
    name, law = f"{averages_factor:g} × averages", StatedVariance(measured.variance / (averages_factor - 1))
    return as_measured(problem, name, name.replace("×", "times the"), law=law)


def _noise(
    present: Problem, there: Problem, stated: NoiseModel | None, theta: Array, exact: FrfData, rng: np.random.Generator
) -> ComplexArray:
    """Standardised complex residuals that a noise model expects at θ, shape (lines, outputs, inputs).

    The model is that of the present data where none is stated; a scale that is integrated out is what these say.
    """
    likelihood = present.log_posterior.likelihood
    law = likelihood.noise
    if stated is not None and present.test.data.frfs is not None:
        law = stated.fitted_to(present.test.data.frfs, law.parts)
    names = [nuisance.name for nuisance in present.prior.nuisances]
    factors = present.prior.factors(theta)[None, columns_of_names(there.test.name, law.names, names)]
    z = present.log_posterior.standardised(theta)
    noise, hyper = law.with_scale((np.abs(z) ** 2).sum(), likelihood.n_data, factors)
    # noise is made in both parts even where only the magnitude is looked at
    shape = exact.frf.values.shape
    return noise.fitted_to(exact, 2).draw(rng, hyper, shape[0], math.prod(shape[1:]))[0].reshape(shape)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModalCandidate(Candidate):
    """Natural frequencies; the ratio of each mode's component at a DOF to that at a reference; or antiresonances.

    Errors of the model in natural frequencies are those of the present ones, of which a further measurement of the same
    structure says nothing: beside ratios and antiresonances natural frequencies do not count.

    Parameters
    ----------
    numbers
        Of the modes, or of the antiresonances, from 1.
    relative
        Standard deviation of each value as a fraction of it.
    dof, reference
        Labels; empty of natural frequencies.
    held
        Label of the DOF at which force and sensor are, of antiresonances.
    """

    numbers: tuple[int, ...]
    relative: float
    dof: str = ""
    reference: str = ""
    held: str = ""

    def problem(self, problem: Problem, theta: Array, rng: np.random.Generator | None = None) -> Problem:
        """The modes measured where θ is the truth, see `Candidate`."""
        point, there = np.asarray(theta, dtype=float), self.without_data(problem)
        exact = _of_data(there, self._measured(np.ones(2 * len(self.numbers)))).log_posterior.predicted(point)[0]
        there = _of_data(there, self._measured(exact))
        if rng is None:
            return _with_usual_errors(there)
        values = simulated_values(there, point, rng)
        if self.dof or self.held:
            values[: len(self.numbers)] = exact[: len(self.numbers)]
        return replace_values(there, values)

    def _measured(self, values: Array) -> ModeData:
        """Data of some values: natural frequencies, then ratios or antiresonances."""
        frequency, ratios = np.split(values[: 2 * len(self.numbers)], [len(self.numbers)])
        if self.held:
            held = Antiresonances((self.held,) * len(ratios), Observed(ratios, self.relative * ratios), self.numbers)
            return ModeData(Observed(frequency, _UNKNOWN * frequency), numbers=self.numbers, zeros=held)
        if not self.dof:
            return ModeData(Observed(frequency, self.relative * frequency), numbers=self.numbers)
        components = Observed(ratios[:, None], self.relative * np.maximum(np.abs(ratios), _NODE)[:, None])
        shapes = ModeShapes((self.dof,), self.reference, components)
        return ModeData(Observed(frequency, _UNKNOWN * frequency), shapes=shapes, numbers=self.numbers)


def modes_hit_free(test: Test, modes: ModalData, test_name: str) -> Iterator[ModalCandidate]:
    """As many natural frequencies of the structure without its joints, as well known as the present ones.

    Fewer where it has not as many up to where it is known, as an imported model may; none where it has none.
    """
    most = modes.frequency_hz.size
    top_hz, nowhere = test.structures.reach_hz(most), np.empty(0, dtype=np.intp)
    free = test.structures.at((), top_hz).certain().free_modes(nowhere, np.empty((0, 0)))
    eigenvalues, _ = free(np.empty((1, 0)))
    there = int(((eigenvalues > 0) & (eigenvalues <= (2 * np.pi * top_hz) ** 2)).sum())
    if numbers := tuple(range(1, min(most, there) + 1)):
        yield ModalCandidate(
            name=FREE, words=FREE_WORDS, test=test_name, joint=Joints(()), numbers=numbers, relative=scatter(modes)
        )


def _of_data(problem: Problem, data: ModeData) -> Problem:
    """The problem of one test with other modes as its data, judged as its own."""
    noise = problem.test.noise
    if noise is not None:
        noise = noise.fitted_to(data, noise.parts)  # type: ignore[arg-type]  # that of modes takes modes
    return problem.with_test(data=data, noise=noise)


def _with_usual_errors(problem: Problem) -> Problem:
    """With errors of the model as large as they usually are: data that fit exactly would say that there are none."""
    noise = problem.test.noise
    if not isinstance(noise, ModelErrorNoise):
        return problem
    test = problem.test.with_model_error(replace(noise.sizes, factor=_KNOWN))
    return problem.with_test(noise=test.noise)


def scatter(modes: ModalData) -> float:
    """Standard deviation of natural frequencies that are measured as the present ones, as a fraction."""
    return float(np.median(modes.sd_hz / modes.frequency_hz))
