"""The moves between modes leave a density of two unlike modes as it is, shares and all."""

import numpy as np
import pytest
from scipy import stats

from jointbayes.sampling import SeveralModes, fit_each_mode
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.moves import IndependenceMove, JumpMove
from tests.science.known_densities import Target
from tests.science.test_invariance import LEVEL, Warp, moved, smallest_level

SHARE = 0.25
PLACES = (np.array([0.0, 3.0]), np.array([5.0, -1.0]))
COVARIANCES = (np.array([[0.25, 0.1], [0.1, 1.0]]), np.array([[4.0, -1.5], [-1.5, 1.0]]))


def starts_at(distance, off=0.0, wider=1.0):
    """Place and covariance of each mode, or roughly so."""
    return [(distance * place + off, wider * covariance) for place, covariance in zip(PLACES, COVARIANCES, strict=True)]


def two_modes(distance=1.0):
    """A quarter about one place, the rest about another, four times as wide: their tails meet."""
    starts = starts_at(distance)
    normal = [(place, np.linalg.inv(c), 0.5 * np.linalg.slogdet(c)[1]) for place, c in starts]

    def log_density(x):
        each = [-0.5 * np.einsum("ni,ij,nj->n", x - m, p, x - m) - half for m, p, half in normal]
        return np.logaddexp(np.log(SHARE) + each[0], np.log(1 - SHARE) + each[1])

    def exact(n, rng):
        first = rng.random(n) < SHARE
        each = [rng.multivariate_normal(*start, size=n) for start in starts]
        return np.where(first[:, None], *each)

    mean = SHARE * starts[0][0] + (1 - SHARE) * starts[1][0]
    second = [c + np.outer(m - mean, m - mean) for m, c in starts]

    normals = [[stats.norm(m[k], np.sqrt(c[k, k])).cdf for m, c in starts] for k in range(2)]
    marginals = tuple(lambda t, of=of: SHARE * of[0](t) + (1 - SHARE) * of[1](t) for of in normals)
    return Target(log_density, exact, mean, SHARE * second[0] + (1 - SHARE) * second[1], marginals)


def rough_modes(distance=1.0):
    """Modes that are known only roughly, an exchange among the images."""
    images = np.array([[[0.0, 1.0], [1.0, 0.0]], np.diag([1.0, -1.0])])
    return SeveralModes.from_starts(starts_at(distance, off=0.2, wider=1.5), images)


class WithoutVolume(SeveralModes):
    """What a jump would do whose author forgot that one mode is wider."""

    def carried(self, theta, here, there):
        moved, log_volume = super().carried(theta, here, there)
        return moved, np.zeros_like(log_volume)


class AnyWayBack(JumpMove):
    """One that does not ask whether the map leads back."""

    def get_proposal(self, theta, random):
        here = self._modes.nearest(theta)
        return self._modes.carried(theta, here, 1 - here)


def one_of_proposals(target, coordinates=Identity()):  # noqa: B008  (it has no state)
    starts = starts_at(1.0, off=0.2, wider=1.5)
    flatter = lambda x: 0.8 * target.log_density(x)  # noqa: E731
    proposal = fit_each_mode(flatter, [coordinates], starts, None, np.random.default_rng(1))
    return IndependenceMove(proposal.coordinates, proposal.density)


CASES = {
    "jump": (1.0, lambda _target: JumpMove(rough_modes())),
    "jump where modes overlap": (0.3, lambda _target: JumpMove(rough_modes(0.3))),
    "independence of each mode": (1.0, one_of_proposals),
    "independence of each mode in other coordinates": (1.0, lambda target: one_of_proposals(target, Warp())),
}


@pytest.mark.science
@pytest.mark.parametrize("name", CASES)
def test_a_move_between_modes_leaves_the_density_as_it_is(name):
    distance, move = CASES[name]
    target = two_modes(distance)
    outcome = moved(target, move(target))
    assert outcome.acceptance > 0.1
    assert smallest_level(outcome.theta, target) > LEVEL


ROUGH = rough_modes()


@pytest.mark.science
@pytest.mark.parametrize(
    ("distance", "move"),
    [(1.0, JumpMove(WithoutVolume(ROUGH.centres, ROUGH.factors, ROUGH.maps))), (0.3, AnyWayBack(rough_modes(0.3)))],
    ids=["without the volume", "without a way back"],
)
def test_a_jump_that_is_wrong_is_caught(distance, move):
    target = two_modes(distance)
    assert smallest_level(moved(target, move).theta, target) < LEVEL / 1e3
