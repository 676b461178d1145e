"""How walkers move, and emcee's loop that moves them; importing this imports emcee."""

import math
from typing import Any

import emcee
import numpy as np
from emcee import State
from emcee.model import Model
from emcee.moves import Move, RedBlueMove, StretchMove

from jointbayes.sampling.coordinate_maps import Coordinates
from jointbayes.sampling.density import SeveralModes
from jointbayes.sampling.distributions import ProposalDensity, StudentT
from vibrecords.arrays import Array, Flags, Indices

Walkers = Indices | slice

_JITTER = 1e-5  # of the factor, as in emcee: no step is exactly the way back of another


class Driver(emcee.EnsembleSampler):  # type: ignore[misc]  # emcee is not typed
    """emcee's sampler, whose state of random numbers is never read.

    emcee copies the 624 words of the generator's state at every step. With vectorised moves that would be a fourth of
    the time of a step.
    """

    @property
    def random_state(self) -> None:
        """Nothing: the next block has a seed of its own."""
        return

    @random_state.setter
    def random_state(self, state: tuple[Any, ...]) -> None:
        self._random.set_state(state)


def settle(model: Model, state: State, walkers: Walkers, proposed: Array, log_factor: Array) -> Flags:
    """Accept or refuse proposals by the rule of Metropolis and Hastings, in place.

    emcee's own moves do this walker by walker in Python, which costs more than a fast log-density.

    Parameters
    ----------
    model, state
        As emcee hands them to a move; the log-density is asked directly, which the sampler has wrapped in its check.
    walkers : ndarray of int, shape (n,), or slice
        Those that move.
    proposed : ndarray, shape (n, d)
        Where to.
    log_factor : ndarray, shape (n,)
        ln of the ratio q(back)/q(forth) of the proposal's densities.

    Returns
    -------
    ndarray of bool, shape (n,)
        Which proposals were accepted.

    References
    ----------
    W. K. Hastings, Monte Carlo sampling methods using Markov chains (1970), DOI 10.1093/biomet/57.1.97.
    """
    log_density = np.asarray(model.log_prob_fn(proposed))
    # minus an exponential variate is the log of a uniform one
    gain = log_factor + log_density - state.log_prob[walkers]
    accepted: Flags = gain > -model.random.standard_exponential(len(proposed))
    state.coords[walkers] = np.where(accepted[:, None], proposed, state.coords[walkers])
    state.log_prob[walkers] = np.where(accepted, log_density, state.log_prob[walkers])
    return accepted


class HalvesMove(RedBlueMove):  # type: ignore[misc]  # emcee is not typed
    """Move each random half of the walkers by the positions of the other half, all of a half at once.

    Subclasses give `get_proposal`, as those of emcee's own move of two halves do.

    References
    ----------
    D. Foreman-Mackey et al., emcee: the MCMC hammer (2013), section 3, DOI 10.1086/670067.
    """

    def propose(self, model: Model, state: State) -> tuple[State, Flags]:
        """Move both halves in turn; return the state and who accepted, shape (walkers,)."""
        walkers = len(state.coords)
        order = model.random.permutation(walkers)
        halves = order[: walkers // 2], order[walkers // 2 :]
        accepted = np.zeros(walkers, dtype=bool)
        for moving, resting in (halves, halves[::-1]):
            proposed, log_factor = self.get_proposal(state.coords[moving], [state.coords[resting]], model.random)
            accepted[moving] = settle(model, state, moving, proposed, log_factor)
        return state, accepted


class HalvesStretchMove(HalvesMove, StretchMove):  # type: ignore[misc]  # emcee is not typed
    """emcee's stretch move, accepted or refused for half of the walkers at once.

    References
    ----------
    J. Goodman, J. Weare, Ensemble samplers with affine invariance (2010), DOI 10.2140/camcos.2010.5.65.
    """


class DEMove(HalvesMove):
    """ter Braak's move along the difference of two other walkers, taken in coordinates φ.

    The proposal is symmetric in φ; in θ it carries the ratio of volumes |∂θ/∂φ| into the acceptance.

    Parameters
    ----------
    coordinates
        Coordinates in which to move.
    gamma0
        Factor of the difference; 2.38/√2d by default.

    References
    ----------
    C. J. F. ter Braak, Differential evolution MCMC (2006), DOI 10.1007/s11222-006-8769-1.
    B. Nelson et al., RUN DMC (2014), section 2.1.2 on the jitter, DOI 10.1088/0067-0049/210/1/11.
    """

    def __init__(self, coordinates: Coordinates, gamma0: float | None = None) -> None:
        super().__init__()
        self._coordinates, self._gamma0 = coordinates, gamma0

    def get_proposal(self, s: Array, c: list[Array], random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose θ for the walkers `s` from the other half `c`, with the log of the volume ratio."""
        n, dimension = s.shape
        resting = self._coordinates.forward(c[0])
        first = random.randint(len(resting), size=n)
        second = random.randint(len(resting) - 1, size=n)
        second += second >= first  # any but the first
        gamma = 2.38 / math.sqrt(2 * dimension) if self._gamma0 is None else self._gamma0
        factor = gamma * (1 + _JITTER * random.standard_normal((n, 1)))
        proposed, inside = self._coordinates.inverse(
            self._coordinates.forward(s) + factor * (resting[first] - resting[second])
        )
        # a walker sent out of the region is proposed where it is, and refused
        proposed = np.where(inside[:, None], proposed, s)
        ratio = self._coordinates.log_volume(proposed) - self._coordinates.log_volume(s)
        return proposed, np.where(inside, ratio, -np.inf)


class EachAlone(Move):  # type: ignore[misc]  # emcee is not typed
    """Move all walkers at once, each by its own place alone; subclasses give `get_proposal`."""

    def propose(self, model: Model, state: State) -> tuple[State, Flags]:
        """Move all walkers; return the state and who accepted, shape (walkers,)."""
        proposed, log_factor = self.get_proposal(state.coords, model.random)
        return state, settle(model, state, slice(None), proposed, log_factor)


class FittedMove(EachAlone):
    """Propose by a fitted distribution in coordinates φ, with respect to which the proposal is reversible.

    The acceptance compares the importance weights p/q of the two places, with q the distribution's density over θ: that
    over φ divided by |∂θ/∂φ|. Subclasses give `new_places`.

    Parameters
    ----------
    coordinates
        Coordinates in which to propose.
    density
        Distribution in these coordinates.
    """

    def __init__(self, coordinates: Coordinates, density: ProposalDensity) -> None:
        self._coordinates, self._density = coordinates, density

    def get_proposal(self, theta: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose for the walkers at θ, shape (n, d), with ln q(θ) − ln q(proposed), shape (n,)."""
        coordinates, density = self._coordinates, self._density
        here = coordinates.forward(theta)
        there = self.new_places(here, random)
        proposed, inside = coordinates.inverse(there)
        # a walker sent out of the region is proposed where it is, and refused
        proposed = np.where(inside[:, None], proposed, theta)
        before = density.log_density(here) - coordinates.log_volume(theta)
        after = density.log_density(there) - coordinates.log_volume(proposed)
        return proposed, np.where(inside, before - after, -np.inf)


class IndependenceMove(FittedMove):
    """Propose all walkers at once from one fixed distribution in coordinates φ.

    Each walker is a chain of its own here. The nearer q is to p, the nearer the draws are to independent ones; where q
    is too narrow a walker waits long, so other moves belong beside this one.

    References
    ----------
    L. Tierney, Markov chains for exploring posterior distributions (1994), section 2.3.3,
    DOI 10.1214/aos/1176325750.
    """

    def new_places(self, here: Array, random: np.random.RandomState) -> Array:
        """New places φ, shape (n, d), for the walkers at others."""
        return self._density.draw(random, len(here))


class AutoregressiveMove(FittedMove):
    """Propose each walker part of the way from where it is to a new draw of a Student-t in coordinates φ.

    In many dimensions even a good fit is refused where the whole place changes at once; part of the way is accepted.
    The stretch of the Student-t is first drawn given the place.

    Parameters
    ----------
    coordinates
        Coordinates in which to propose.
    density
        Student-t in these coordinates.
    kept
        Share of the distance from its centre that is kept, 0 to 1: at 0 it is an independence move but for the stretch.

    References
    ----------
    S. L. Cotter et al., MCMC methods for functions: modifying old algorithms to make them faster (2013),
    DOI 10.1214/13-STS421 (preconditioned Crank-Nicolson).
    """

    def __init__(self, coordinates: Coordinates, density: StudentT, kept: float) -> None:
        super().__init__(coordinates, density)
        self._student, self._kept = density, kept

    def new_places(self, here: Array, random: np.random.RandomState) -> Array:
        """New places φ, shape (n, d), for the walkers at others."""
        density, (n, d) = self._student, here.shape
        squared = (density.dof + density.squared_distance(here)) / random.chisquare(density.dof + d, n)
        fresh = density.scaled(random.standard_normal((n, d))) * np.sqrt(squared * (1 - self._kept**2))[:, None]
        return density.mean + self._kept * (here - density.mean) + fresh


class JumpMove(EachAlone):
    """Carry each walker from the mode nearest to it to the same place about another one.

    Another mode j is chosen with equal probability, and the map from i to j is the inverse of that from j to i, so
    that p'/p and the ratio of volumes |∂θ'/∂θ| decide. Where the map is an exchange of like quantities that ratio is 1.
    A walker that would end nearer to a third mode stays: from there the map would not lead back.

    Parameters
    ----------
    modes
        Two or more.

    References
    ----------
    E. Pompe, C. Holmes, K. Łatuszyński, A framework for adaptive MCMC targeting multimodal distributions (2020),
    section 2 (deterministic jumps), DOI 10.1214/19-AOS1916.
    """

    def __init__(self, modes: SeveralModes) -> None:
        self._modes = modes

    def get_proposal(self, theta: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose for the walkers at θ, shape (n, d), with the log of the volume ratio, shape (n,)."""
        here = self._modes.nearest(theta)
        there = random.randint(len(self._modes.centres) - 1, size=len(theta))
        there += there >= here  # any but the nearest
        proposed, log_volume = self._modes.carried(theta, here, there)
        leads_back = self._modes.nearest(proposed) == there
        # a walker that cannot come back is proposed where it is, and refused
        return np.where(leads_back[:, None], proposed, theta), np.where(leads_back, log_volume, -np.inf)
