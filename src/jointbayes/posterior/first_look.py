"""A linearised first look at further measurements: what each would tell, by Fisher's information at a few draws.

A candidate is data of the model itself: FRFs, modes, their ratios, antiresonances. Of quantities that a proposed test
has for itself, as errors of overhangs, the present data know nothing, so that the present posterior of all is that of
the present quantities times the prior of the new ones, and draws of it are present draws beside draws of that prior.

References
----------
Fisher, R. A. (1922). On the mathematical foundations of theoretical statistics. Philosophical Transactions of the Royal
Society A 222, 309-368. DOI 10.1098/rsta.1922.0009
"""

import copy
import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from jointbayes.errors import ModelError
from jointbayes.frf import AnyStructure, Ports
from jointbayes.inference import ModelErrorNoise, NoiseModel, Nuisance, Problem, Test
from jointbayes.inference.likelihood_base import ResidualKind
from jointbayes.inference.test import columns_of_names
from jointbayes.joint import AnyJoint, Joints, Parametrisation
from jointbayes.posterior.prediction import frfs_as_measured, replace_values, simulated_values
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
    joints = test.joints.joints
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
            quantities too, where it has any, see `WithOwn`.
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
        present, there = self.present(problem), self.without_data(problem)
        there = there.with_test(residual_kind=self.residual_kind or present.test.residual_kind)
        stiffness, factors = there.prior.values(theta), there.prior.factors(theta)
        true = frfs_as_measured(there, self.ports, self.quantity, stiffness, factors)[0]
        kept = self.ports.frequency_hz > self.above_hz
        lines, values, variance = self.ports.frequency_hz[kept], true[kept], self.law.variance(true)[kept]
        frf = FrfSet(lines, values, self.ports.outputs, self.ports.inputs, self.quantity)
        if rng is not None:
            noise = _noise(present, there, self.noise, theta, FrfData(frf, variance), rng)
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
        there = self.without_data(problem)
        exact = _of_data(there, self._measured(np.ones(2 * len(self.numbers)))).log_posterior.predicted(theta)[0]
        there = _of_data(there, self._measured(exact))
        if rng is None:
            return _with_usual_errors(there)
        values = simulated_values(there, theta, rng)
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


#: The least eigenvalue of an information scaled to a unit diagonal that is inverted: what rounding leaves of zero.
_ROUNDING = 1e-15
#: A parameter whose variance, in units of that with all else known, exceeds this is not determined at all: far enough
#: below 1/_ROUNDING that a hundredth of a direction without information is enough.
_UNDETERMINED = 1e11


@dataclass(frozen=True, slots=True, eq=False)
class FisherInformation:
    """Information about θ at one point, data and prior apart.

    Parameters
    ----------
    names
        Coordinate names, joint first, then nuisances, shape (d,).
    theta
        The point, shape (d,).
    data
        JᵀJ of the standardised residuals of the data, shape (d, d).
    prior
        Precision of the prior, −∂² ln p/∂θ², shape (d, d); zero where the prior is uniform, whose bounds count for
        nothing here.
    prior_sd
        Standard deviation of the prior of each coordinate, shape (d,).
    parametrisation
        Meaning of the joint's coordinates, the first ones of θ.
    """

    names: tuple[str, ...]
    theta: Array
    data: Array
    prior: Array
    prior_sd: Array
    parametrisation: Parametrisation

    def total(self, free: Sequence[str] | None = None) -> Array:
        """Information about the parameters in `free`, in that order (all if None), the others exactly known: (f, f)."""
        rows = self._rows(free)
        return (self.data + self.prior)[np.ix_(rows, rows)]

    def covariance(self, free: Sequence[str] | None = None) -> Array:
        """Inverse of `total`, shape (f, f): the smallest covariance that an unbiased estimate can have.

        Combinations that neither data nor prior determine have a variance at the limit of double precision, 1e15 of
        what it would be with all else known, rather than infinity, so that correlations keep their limit of ±1.
        A parameter without any information has an infinite variance and no correlation.

        References
        ----------
        Rao, C. R. (1945). Information and accuracy attainable in the estimation of statistical parameters.
        Bulletin of the Calcutta Mathematical Society 37, 81-91.
        """
        return inverse_information(self.total(free))

    def sd(self, free: Sequence[str] | None = None) -> dict[str, float]:
        """Standard deviation of each parameter in `free`; infinite where it is not determined."""
        information = self.total(free)
        variance = np.diag(inverse_information(information))
        with np.errstate(invalid="ignore"):  # inf · 0 where there is no information at all
            sd = np.where(variance * np.diag(information) < _UNDETERMINED, np.sqrt(variance), np.inf)
        return {self.names[i]: float(s) for i, s in zip(self._rows(free), sd, strict=True)}

    def stiffness_sd(self, free: Sequence[str] | None = None) -> dict[str, float]:
        """Standard deviation of ln |k| of each stiffness that the joint's coordinates move, whatever they are.

        `free` names coordinates of θ, as in `sd`; for coordinates other than logarithms the derivative at θ is used.
        A stiffness that is zero has an infinite one.
        """
        rows, sd_of_coordinate, covariance = self._rows(free), self.sd(free), self.covariance(free)
        theta = self.theta[: len(self.parametrisation.names)]
        stiffness, derivative = self.parametrisation.values(theta), self.parametrisation.derivative(theta)
        sd_by_name: dict[str, float] = {}
        for quantity, k, row in zip(self.parametrisation.quantities, stiffness, derivative, strict=True):
            if not row.any():
                continue
            if quantity.name in self.parametrisation.names:
                sd_by_name[quantity.name] = sd_of_coordinate.get(quantity.name, 0.0)
                continue
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = np.array([row[i] / k if i < row.size else 0.0 for i in rows])  # ∂ ln |k|/∂θ
            moved = slope != 0
            undetermined = any(np.isinf(sd_of_coordinate[self.names[rows[i]]]) for i in np.flatnonzero(moved))
            variance = slope[moved] @ covariance[np.ix_(moved, moved)] @ slope[moved]
            finite = not undetermined and np.isfinite(slope).all()
            sd_by_name[quantity.name] = float(np.sqrt(variance)) if finite else float("inf")
        return sd_by_name

    def _rows(self, free: Sequence[str] | None) -> list[int]:
        return [self.names.index(name) for name in (self.names if free is None else free)]


def fisher_information(problem: Problem, theta: ArrayLike) -> FisherInformation:
    """Fisher information of a problem at θ, shape (d,), usually the mode.

    The data's part is JᵀJ of the exact Jacobian of the standardised residuals, for the noise as it stands at θ.

    Parameters
    ----------
    problem
        Structure, joint, data and prior.
    theta
        Where; inside the prior's support.
    """
    point = np.asarray(theta, dtype=float)
    _, jacobian = problem.log_posterior.residuals(point)
    data = jacobian[: len(jacobian) - point.size]  # the last d rows are the prior's
    return FisherInformation(
        problem.names, point, data.T @ data, np.diag(problem.prior.precision), problem.prior.sd, problem.parametrisation
    )


def inverse_information(information: Array) -> Array:
    """Covariance, shape (d, d), of an information that may be singular; see `FisherInformation.covariance`."""
    diagonal = np.diag(information)
    seen = diagonal > 0
    root = np.sqrt(diagonal[seen])
    values, vectors = np.linalg.eigh(information[np.ix_(seen, seen)] / np.outer(root, root))
    covariance = np.diag(np.full(diagonal.size, np.inf))
    covariance[np.ix_(seen, seen)] = (vectors / np.maximum(values, _ROUNDING)) @ vectors.T / np.outer(root, root)
    return covariance


#: The present test beside others, if it has no name: one that no test of a case can have.
_PRESENT = "(present)"


def own_of(candidates: Iterable[Candidate]) -> tuple[Nuisance, ...]:
    """Quantities that candidates have for themselves, in their order."""
    return tuple({nuisance.name: nuisance for candidate in candidates for nuisance in candidate.own_nuisances}.values())


@dataclass(frozen=True, eq=False)
class WithOwn:
    """A problem over its quantities and further ones, of which its data say nothing.

    Parameters
    ----------
    present
        The problem in hand.
    own_nuisances
        The further quantities; with none of them all is as it is.
    """

    present: Problem
    own_nuisances: tuple[Nuisance, ...]

    @cached_property
    def problem(self) -> Problem:
        """Problem over all quantities, those of the noise last, for the priors and tests; it is not to be sampled."""
        if not self.own_nuisances:
            return self.present
        nuisances = self.present.prior.nuisances
        end = len(nuisances) - self.present.log_posterior.likelihood.hyper_count
        prior = replace(self.present.prior, nuisances=(*nuisances[:end], *self.own_nuisances, *nuisances[end:]))
        if len(self.present.tests) > 1 or self.present.test.name:
            return replace(self.present, prior=prior)
        return replace(self.present, prior=prior, tests=(replace(self.present.test, name=_PRESENT),))

    @cached_property
    def present_columns(self) -> NDArray[np.intp]:
        """Where the coordinates of the present problem stand among all."""
        return np.array([self.problem.names.index(name) for name in self.present.names], dtype=np.intp)

    @cached_property
    def own_columns(self) -> NDArray[np.intp]:
        """Where the others stand."""
        return np.array([self.problem.names.index(nuisance.name) for nuisance in self.own_nuisances], dtype=np.intp)

    def joined(self, theta: Array, own_theta: Array) -> Array:
        """θ of all, shape (n, D), from that of the present problem, shape (n, d), and the others, shape (n, D − d)."""
        whole = np.empty((len(theta), len(self.problem.names)))
        whole[:, self.present_columns], whole[:, self.own_columns] = theta, own_theta
        return whole

    def drawn(self, theta: Array, rng: np.random.Generator) -> Array:
        """Draws of all, shape (n, D), from draws of the present problem, shape (n, d)."""
        own_draws = [nuisance.prior.sample(rng, len(theta)) for nuisance in self.own_nuisances]
        return self.joined(theta, np.reshape(own_draws, (-1, len(theta))).T)

    def middle(self, theta: Array) -> Array:
        """θ of all, shape (n, D), with the others in the middle of their priors, from θ (n, d)."""
        means = [nuisance.prior.mean for nuisance in self.own_nuisances]
        return self.joined(theta, np.tile(means, (len(theta), 1)))

    def log_density(self, theta: Array) -> Array:
        """ln p(θ | present data) up to the evidence, shape (n,), of θ of all, shape (n, D)."""
        density = self.present.log_posterior(theta[:, self.present_columns])
        for column, nuisance in zip(self.own_columns, self.own_nuisances, strict=True):
            density += nuisance.prior.log_density(theta[:, column])
        return density

    def fisher(self, theta: Array) -> FisherInformation:
        """Information of the present data and of the priors of all, at θ of all, shape (D,)."""
        present = fisher_information(self.present, theta[self.present_columns])
        data = np.zeros((theta.size, theta.size))
        data[np.ix_(self.present_columns, self.present_columns)] = present.data
        prior = self.problem.prior
        return FisherInformation(
            self.problem.names, theta, data, np.diag(prior.precision), prior.sd, self.problem.parametrisation
        )


Names = tuple[str, ...]

#: Sets are chosen among all there are up to this number, beyond it one by one.
MOST_SETS = 5000
#: A linearised figure may be off by this factor either way when it decides what is not simulated.
MARGIN = 2.0


def measurement_information(candidate: Candidate, problem: Problem, theta: Array) -> Array:
    """Fisher information of a further measurement about θ, shape (d, d), where θ, shape (d,), is the truth.

    JᵀJ of the standardised residuals, for the noise that the candidate's law makes of the model's FRFs there.
    """
    return fisher_information(candidate.problem(problem, theta), theta).data


def sd_of(fisher: FisherInformation, quantity: str) -> float:
    """Standard deviation of ln of a stiffness, nuisances marginalised; at most the prior's where it has one of its own.

    Raises
    ------
    ModelError
        If the joint's coordinates do not move that stiffness.
    """
    spread = fisher.stiffness_sd()
    if quantity not in spread:
        raise ModelError(f"planning: found parameter {quantity!r}; expected one of {', '.join(spread)}")
    limit = math.inf
    if quantity in fisher.parametrisation.names:
        limit = float(fisher.prior_sd[fisher.names.index(quantity)])
    return min(spread[quantity], limit)


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Linearised standard deviation of ln of the wanted stiffness after a set of measurements.

    Parameters
    ----------
    names
        Names of the candidates.
    sds
        One for each draw about which it was linearised, shape (draws,).
    """

    names: Names
    sds: Array

    @property
    def median(self) -> float:
        """Median over the draws."""
        return float(np.median(self.sds))

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the greatest."""
        return float(self.sds.min()), float(self.sds.max())


class FirstLook:
    """Linearised figures of all candidates and of sets of them, about the same draws.

    Parameters
    ----------
    problem
        The problem in hand.
    candidates
        By name.
    quantity
        The wanted stiffness.
    draws
        Draws of the present posterior, shape (n, d).
    """

    def __init__(self, problem: Problem, candidates: Mapping[str, Candidate], quantity: str, draws: Array) -> None:
        self._quantity = quantity
        whole = WithOwn(problem, own_of(candidates.values()))
        points = whole.middle(draws)
        self._present = [whole.fisher(theta) for theta in points]
        self._added = {
            name: [measurement_information(candidate, whole.problem, theta) for theta in points]
            for name, candidate in candidates.items()
        }

    def of(self, quantity: str) -> Self:
        """The same look for another wanted stiffness: what the measurements tell does not depend on it."""
        other = copy.copy(self)
        other._quantity = quantity
        return other

    def linearised(self, names: Names) -> Linearised:
        """Figures of one set."""
        return Linearised(names, np.array([
            sd_of(replace(now, data=now.data + sum(self._added[name][i] for name in names)), self._quantity)
            for i, now in enumerate(self._present)
        ]))  # fmt: skip


def sets_of(names: Sequence[str], size: int, loss: Callable[[Names], float]) -> Iterable[Names]:
    """Sets of so many names: all there are up to 5000, beyond that the one found by adding the best one at a time.

    Raises
    ------
    ModelError
        If none is to be chosen, or there are none to choose from.
    """
    size = min(size, len(names))
    if math.comb(len(names), size) <= MOST_SETS:
        return tuple(itertools.combinations(names, size))
    chosen: Names = ()
    for _ in range(size):
        chosen = min(((*chosen, name) for name in names if name not in chosen), key=loss)
    return (chosen,)


def worth_simulating(looks: Sequence[Linearised], most: int) -> tuple[Linearised, ...]:
    """Those that could come first: all if there are no more than `most`, else by their linearised range.

    One could come first if the least of its linearised figures, halved, is no more than twice the greatest of that
    with the least median. Ordered by their median.
    """
    ordered = sorted(looks, key=lambda look: look.median)
    if len(ordered) <= most:
        return tuple(ordered)
    limit = ordered[0].ends[1] * MARGIN
    return tuple(look for look in ordered if look.ends[0] / MARGIN <= limit)
