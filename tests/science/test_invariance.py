"""Each move leaves known densities as they are, and the same test catches moves that do not.

Walkers that start as independent exact draws are independent exact draws again after any number of steps, if the move
leaves the product of their densities unchanged. So the final states are tested as a plain sample, at exact levels.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from emcee.moves import DESnookerMove
from scipy import stats

from jointbayes.sampling import Proposal
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.distributions import StudentT
from jointbayes.sampling.ensemble import EnsembleState, WeightedMove
from jointbayes.sampling.kernels import Kernels
from jointbayes.sampling.moves import AutoregressiveMove, DEMove, HalvesStretchMove, IndependenceMove, advance
from tests.science.known_densities import TARGETS

# A step of an ensemble takes as long for many walkers as for few: few ensembles of many are as many draws for less.
ENSEMBLES, WALKERS, STEPS = 8, 128, 50
# About 700 figures are compared in this file: at 1e-6 each a sound program fails once in a thousand choices of seed.
LEVEL = 1e-6


class Warp:
    """φ = exp(θ/2) along the first axis, so that φ <= 0 lies outside, and 2 sinh(θ/2) along the others."""

    def forward(self, theta):
        return np.column_stack([np.exp(theta[:, 0] / 2), 2 * np.sinh(theta[:, 1:] / 2)])

    def inverse(self, phi):
        inside = phi[:, 0] > 0
        first = np.where(inside, phi[:, 0], 1.0)
        return np.column_stack([2 * np.log(first), 2 * np.arcsinh(phi[:, 1:] / 2)]), inside

    def log_volume(self, theta):
        return np.log(2) - theta[:, 0] / 2 - np.log(np.cosh(theta[:, 1:] / 2)).sum(axis=1)


class WarpWithoutVolume(Warp):
    """What a move would do whose author forgot the Jacobian."""

    def log_volume(self, theta):
        return np.zeros(len(theta))


def student_t(coordinates, target):
    """A t distribution as wide and as correlated as the density there, but of another shape."""
    phi = coordinates.forward(target.exact(4000, np.random.default_rng(21)))
    correlation = np.atleast_2d(np.corrcoef(phi.argsort(axis=0).argsort(axis=0), rowvar=False))
    middle, spread = np.median(phi, axis=0), np.diff(np.percentile(phi, [10, 90], axis=0), axis=0)[0] / 2.56
    return StudentT(middle, correlation * np.outer(spread, spread), 5.0)


def independence(coordinates, target):
    return IndependenceMove(Proposal(student_t(coordinates, target), 1.0, coordinates))


def with_kernels(target):
    """A tenth from two kernels, one of them bent, somewhere else than the rest."""
    d = len(target.mean)
    places, bend = target.mean + np.array([[0.5], [-1.0]]), np.zeros((2, 1, 1, d))
    bend[1, 0, 0, 1:] = 0.3
    further = Kernels(places, np.tile(np.eye(d), (2, 1, 1)), bend, np.array([0.3, 0.7]))
    return IndependenceMove(Proposal(student_t(Identity(), target), 1.0, further=further))


MOVES = {
    "independence": lambda target: independence(Identity(), target),
    "independence in other coordinates": lambda target: independence(Warp(), target),
    "independence with further kernels": with_kernels,
    "autoregressive": lambda target: AutoregressiveMove(Identity(), student_t(Identity(), target), 0.6),
    "autoregressive in other coordinates": lambda target: AutoregressiveMove(Warp(), student_t(Warp(), target), 0.9),
    "differential evolution": lambda target: DEMove(Identity()),
    "differential evolution in other coordinates": lambda target: DEMove(Warp()),
    "whole difference in other coordinates": lambda target: DEMove(Warp(), gamma0=1.0),
    "stretch": lambda target: HalvesStretchMove(),
}


@dataclass(frozen=True)
class Outcome:
    """Final states, shape (n, d), and the fraction of accepted proposals."""

    theta: np.ndarray
    acceptance: float


def moved(target, move):
    """Start many ensembles at exact draws and make some steps of one move."""
    rng = np.random.default_rng(22)
    ends, accepted, proposed = [], 0, 0
    for seed in range(ENSEMBLES):
        start = target.exact(WALKERS, rng)
        state = EnsembleState(start, target.log_density(start))
        random = np.random.SeedSequence(seed)
        block = advance(target.log_density, state, STEPS, random, (WeightedMove("move", move, 1.0),))
        ends.append(block.end.theta)
        accepted += block.moves["move"].accepted
        proposed += block.moves["move"].proposed
    return Outcome(np.concatenate(ends), accepted / proposed)


def smallest_level(theta, target):
    """Smallest p-value of the means, the covariances and the marginals of independent draws."""
    centred = theta - target.mean
    rows, columns = np.triu_indices(len(target.mean))
    figures = np.concatenate([centred, centred[:, rows] * centred[:, columns]], axis=1)
    expected = np.concatenate([np.zeros(len(target.mean)), target.covariance[rows, columns]])
    z = (figures.mean(axis=0) - expected) / (figures.std(axis=0) / np.sqrt(len(figures)))
    marginals = [stats.kstest(theta[:, k], cdf).pvalue for k, cdf in enumerate(target.marginals)]
    return float(min((2 * stats.norm.sf(np.abs(z))).min(), *marginals))


def in_turn(names, targets):
    """Each name with each target; `make test` takes one of each name, in turn, and .ci/run all."""
    return [
        pytest.param(name, target, marks=[pytest.mark.science] * ((i - j) % len(targets) > 0))
        for i, name in enumerate(names)
        for j, target in enumerate(targets)
    ]


@pytest.mark.parametrize(("move", "name"), in_turn(MOVES, TARGETS))
def test_a_move_leaves_the_density_as_it_is(move, name):
    target = TARGETS[name]
    outcome = moved(target, MOVES[move](target))
    assert outcome.acceptance > 0.05  # a move that refuses all leaves anything as it is
    assert smallest_level(outcome.theta, target) > LEVEL


WITHOUT_VOLUME = {
    "independence": lambda target: independence(WarpWithoutVolume(), target),
    "differential evolution": lambda target: DEMove(WarpWithoutVolume()),
    "whole difference": lambda target: DEMove(WarpWithoutVolume(), gamma0=1.0),
}


@pytest.mark.parametrize(("move", "name"), in_turn(WITHOUT_VOLUME, ["gaussian-1", "gaussian-3", "student-t", "banana"]))
def test_a_move_without_the_volume_of_its_coordinates_is_caught(move, name):
    target = TARGETS[name]
    assert smallest_level(moved(target, WITHOUT_VOLUME[move](target)).theta, target) < LEVEL / 1e3


@pytest.mark.science
def test_the_biased_snooker_move_of_emcee_is_caught():
    # emcee 3.1.6's DESnookerMove misses part of its Hastings factor above one dimension.
    target = TARGETS["gaussian-6"]
    assert smallest_level(moved(target, DESnookerMove()).theta, target) < LEVEL / 1e3
