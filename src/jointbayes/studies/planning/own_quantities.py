"""The present problem over more quantities: those that proposed set-ups have for themselves, as errors of overhangs.

The present data know nothing of them, so that the present posterior of all is that of the present quantities times the
prior of the new ones, and draws of it are present draws beside draws of that prior.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.arrays import Array
from jointbayes.inference import Nuisance, Problem
from jointbayes.posterior.information.fisher import FisherInformation, fisher_information
from jointbayes.studies.planning.candidates import Candidate

#: The present set-up beside others, if it has no name: one that no set-up of a case can have.
_PRESENT = "(present)"


def own_of(candidates: Iterable[Candidate]) -> tuple[Nuisance, ...]:
    """Quantities that candidates have for themselves, in their order."""
    return tuple({one.name: one for candidate in candidates for one in candidate.own}.values())


@dataclass(frozen=True, eq=False)
class WithOwn:
    """A problem over its quantities and further ones, of which its data say nothing.

    Parameters
    ----------
    present
        The problem in hand.
    own
        The further quantities; with none of them all is as it is.
    """

    present: Problem
    own: tuple[Nuisance, ...]

    @cached_property
    def problem(self) -> Problem:
        """Problem over all quantities, those of the noise last, for the priors and set-ups; it is not to be sampled."""
        if not self.own:
            return self.present
        known = self.present.prior.nuisances
        end = len(known) - self.present.log_posterior.likelihood.hyper_count
        prior = replace(self.present.prior, nuisances=(*known[:end], *self.own, *known[end:]))
        setup = "" if self.present.setups else self.present.setup or _PRESENT
        return replace(self.present, prior=prior, setup=setup)

    @cached_property
    def present_columns(self) -> NDArray[np.intp]:
        """Where the coordinates of the present problem stand among all."""
        return np.array([self.problem.names.index(name) for name in self.present.names], dtype=np.intp)

    @cached_property
    def own_columns(self) -> NDArray[np.intp]:
        """Where the others stand."""
        return np.array([self.problem.names.index(one.name) for one in self.own], dtype=np.intp)

    def joined(self, theta: ArrayLike, own: ArrayLike) -> Array:
        """θ of all, shape (n, D), from that of the present problem, shape (n, d), and the others, shape (n, D − d)."""
        known = np.asarray(theta, dtype=float)
        if not self.own:
            return known
        out = np.empty((len(known), len(self.problem.names)))
        out[:, self.present_columns], out[:, self.own_columns] = known, own
        return out

    def drawn(self, theta: ArrayLike, rng: np.random.Generator) -> Array:
        """Draws of all, shape (n, D), from draws of the present problem, shape (n, d)."""
        known = np.asarray(theta, dtype=float)
        own = [one.prior.sample(rng, len(known)) for one in self.own]
        return self.joined(known, np.stack(own, axis=-1) if own else np.empty((len(known), 0)))

    def middle(self, theta: ArrayLike) -> Array:
        """θ of all, shape (n, D), with the others in the middle of their priors, from θ (n, d)."""
        known = np.asarray(theta, dtype=float)
        return self.joined(known, np.tile([one.prior.mean for one in self.own], (len(known), 1)))

    def log_density(self, theta: ArrayLike) -> Array:
        """ln p(θ | present data) up to the evidence, shape (n,), of θ of all, shape (n, D)."""
        t = np.atleast_2d(np.asarray(theta, dtype=float))
        if not self.own:
            return self.present.log_posterior(t)
        out = self.present.log_posterior(t[:, self.present_columns])
        for column, one in zip(self.own_columns, self.own, strict=True):
            out += one.prior.log_density(t[:, column])
        return out

    def fisher(self, theta: ArrayLike) -> FisherInformation:
        """Information of the present data and of the priors of all, at θ of all, shape (D,)."""
        point = np.asarray(theta, dtype=float)
        known = fisher_information(self.present, point[self.present_columns])
        if not self.own:
            return known
        data = np.zeros((point.size, point.size))
        data[np.ix_(self.present_columns, self.present_columns)] = known.data
        prior = self.problem.prior
        return FisherInformation(
            self.problem.names, point, data, np.diag(prior.precision), prior.sd, self.problem.parametrisation
        )
