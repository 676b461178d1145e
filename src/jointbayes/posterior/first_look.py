"""The present problem over more quantities: those that proposed tests have for themselves, as errors of overhangs.

The present data know nothing of them, so that the present posterior of all is that of the present quantities times the
prior of the new ones, and draws of it are present draws beside draws of that prior.
Fisher's information at a point says how well data and prior determine each.

References
----------
Fisher, R. A. (1922). On the mathematical foundations of theoretical statistics. Philosophical Transactions of the Royal
Society A 222, 309-368. DOI 10.1098/rsta.1922.0009
"""

import copy
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.inference import Nuisance, Problem
from jointbayes.joint import Parametrisation
from jointbayes.posterior.candidate import Candidate
from vibrecords.arrays import Array

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

    def joined(self, theta: ArrayLike, own_theta: ArrayLike) -> Array:
        """θ of all, shape (n, D), from that of the present problem, shape (n, d), and the others, shape (n, D − d)."""
        present_theta = np.asarray(theta, dtype=float)
        whole = np.empty((len(present_theta), len(self.problem.names)))
        whole[:, self.present_columns], whole[:, self.own_columns] = present_theta, own_theta
        return whole

    def drawn(self, theta: ArrayLike, rng: np.random.Generator) -> Array:
        """Draws of all, shape (n, D), from draws of the present problem, shape (n, d)."""
        present_theta = np.asarray(theta, dtype=float)
        own_draws = [nuisance.prior.sample(rng, len(present_theta)) for nuisance in self.own_nuisances]
        return self.joined(present_theta, np.reshape(own_draws, (-1, len(present_theta))).T)

    def middle(self, theta: ArrayLike) -> Array:
        """θ of all, shape (n, D), with the others in the middle of their priors, from θ (n, d)."""
        present_theta = np.asarray(theta, dtype=float)
        means = [nuisance.prior.mean for nuisance in self.own_nuisances]
        return self.joined(present_theta, np.tile(means, (len(present_theta), 1)))

    def log_density(self, theta: ArrayLike) -> Array:
        """ln p(θ | present data) up to the evidence, shape (n,), of θ of all, shape (n, D)."""
        t = np.atleast_2d(np.asarray(theta, dtype=float))
        density = self.present.log_posterior(t[:, self.present_columns])
        for column, nuisance in zip(self.own_columns, self.own_nuisances, strict=True):
            density += nuisance.prior.log_density(t[:, column])
        return density

    def fisher(self, theta: ArrayLike) -> FisherInformation:
        """Information of the present data and of the priors of all, at θ of all, shape (D,)."""
        point = np.asarray(theta, dtype=float)
        present = fisher_information(self.present, point[self.present_columns])
        data = np.zeros((point.size, point.size))
        data[np.ix_(self.present_columns, self.present_columns)] = present.data
        prior = self.problem.prior
        return FisherInformation(
            self.problem.names, point, data, np.diag(prior.precision), prior.sd, self.problem.parametrisation
        )


Names = tuple[str, ...]

#: Sets are chosen among all there are up to this number, beyond it one by one.
MOST_SETS = 5000
#: A linearised figure may be off by this factor either way when it decides what is not simulated.
MARGIN = 2.0


def measurement_information(candidate: Candidate, problem: Problem, theta: ArrayLike) -> Array:
    """Fisher information of a further measurement about θ, shape (d, d), where θ, shape (d,), is the truth.

    JᵀJ of the standardised residuals, for the noise that the candidate's law makes of the model's FRFs there.
    """
    point = np.asarray(theta, dtype=float)
    return fisher_information(candidate.problem(problem, point), point).data


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
