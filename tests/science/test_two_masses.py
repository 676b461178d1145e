"""Two masses on two springs: the joint posterior of both stiffnesses, against a grid and an eigenproblem of its own.

Ground – k1 – m1 – k2 – m2, as in Beck & Au (2002) and many tutorials of model updating: repeated observations of both
eigenvalues and of the ratio of the components of each mode, uniform priors on the stiffnesses themselves.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

import jointbayes as jb
from tests.conftest import first_in_ci
from vibrecords import ModeData, ModeShapes, Observed

pytestmark = pytest.mark.science

M1, M2 = 16.5e3, 16.1e3  # kg
LOW, HIGH = 5e6, 60e6  # N/m
REPEATS = 5

Array = NDArray[np.float64]


def eigenpairs(k1: Array, k2: Array) -> tuple[Array, Array]:
    """Eigenvalues λ and ratios φ1/φ2 of both modes, each shape (2, …): roots of the quadratic, written out."""
    # (k1 + k2 − λ m1)(k2 − λ m2) = k2²
    half = ((k1 + k2) * M2 + k2 * M1) / (2 * M1 * M2)
    root = np.sqrt(half**2 - k1 * k2 / (M1 * M2))
    lam = np.stack([half - root, half + root])
    return lam, 1 - lam * M2 / k2  # second row: −k2 φ1 + (k2 − λ m2) φ2 = 0


def observed(seed: int) -> tuple[Array, Array, Array, Array, Array]:
    """Truth, and observations of λ and φ1/φ2 with their standard deviations, shape (repetitions, 2)."""
    rng = np.random.default_rng([13, seed])
    k = rng.uniform(15e6, 45e6, 2)
    lam, ratio = eigenpairs(*k)
    sd_lam, sd_ratio = 0.15 * lam, np.full(2, 0.2)
    shape = (REPEATS, 2)
    return k, rng.normal(lam, sd_lam, shape), sd_lam, rng.normal(ratio, sd_ratio, shape), sd_ratio


def on_a_grid(lam: Array, sd_lam: Array, ratio: Array, sd_ratio: Array, n: int = 1500) -> tuple[Array, Array, Array]:
    """Mean, standard deviation and quantiles (2.5, 50, 97.5 %) of k1 and k2, uniform between LOW and HIGH."""

    def log_likelihood(k1: Array, k2: Array) -> Array:
        predicted, shape = eigenpairs(k1[:, None], k2[None, :])
        total = np.zeros(predicted.shape[1:])
        for of, model, sd in ((lam, predicted, sd_lam), (ratio, shape, sd_ratio)):
            total -= 0.5 * sum(((one[mode] - model[mode]) / sd[mode]) ** 2 for one in of for mode in (0, 1))
        return total

    ends = np.array([[LOW, HIGH], [LOW, HIGH]])
    for _ in range(3):  # each time on the part that holds all but 1e-12 of the probability
        k = [low + (np.arange(n) + 0.5) * (high - low) / n for low, high in ends]
        value = log_likelihood(*k)
        weight = np.exp(value - value.max())
        weight /= weight.sum()
        sides = [weight.sum(axis=1), weight.sum(axis=0)]
        step = np.diff(ends, axis=1)[:, 0] / n
        held = [one[side > 1e-12][[0, -1]] for one, side in zip(k, sides, strict=True)]
        ends = np.clip(held + step[:, None] * [-1, 1], LOW, HIGH)
    mean = np.array([one @ side for one, side in zip(k, sides, strict=True)])
    sd = np.sqrt([(one - m) ** 2 @ side for one, m, side in zip(k, mean, sides, strict=True)])
    places = [np.cumsum(side) - side / 2 for side in sides]
    return mean, sd, np.array([np.interp([0.025, 0.5, 0.975], at, one) for at, one in zip(places, k, strict=True)])


def problem_of(lam: Array, sd_lam: Array, ratio: Array, sd_ratio: Array) -> jb.Problem:
    loose = jb.Structure(np.zeros((2, 2)), np.diag([M1, M2]), jb.ModalDamping((0.0,)), ("1:x", "2:x"))
    joints = (jb.Joint(("1:x",), name="ground"), jb.Joint(("2:x",), ("1:x",), name="between"))
    springs = jb.blocks_of({joint.name: jb.parametrisation_named("springs", ("x",)) for joint in joints})
    prior = jb.JointPrior(springs, (jb.OfStiffness(jb.Uniform(LOW, HIGH)),) * 2)
    shapes = ModeShapes(("1:x",), "2:x", Observed(ratio[:, :, None], sd_ratio[:, None]))
    measured = ModeData(Observed(lam, sd_lam), shapes=shapes, eigenvalues=True)
    return jb.Problem(structure=loose, joint=joints, data=measured, prior=prior)


def test_the_model_is_the_two_by_two_eigenproblem():
    _, *data = observed(0)
    problem = problem_of(*data)
    k = np.array([[7e6, 55e6], [2e7, 3e7], [59e6, 6e6]])
    predicted = problem.log_posterior.predicted(np.log(k)).reshape(3, 2, REPEATS, 2)
    lam, ratio = eigenpairs(*k.T)
    np.testing.assert_allclose(predicted[:, 0, 0], lam.T, rtol=1e-9)
    np.testing.assert_allclose(predicted[:, 1, 0], ratio.T, rtol=1e-8)


@pytest.mark.parametrize("seed", first_in_ci(range(10), 1))
def test_the_posterior_is_that_of_a_grid_to_one_per_cent_of_its_standard_deviation(seed):
    _, *data = observed(seed)
    mean, sd, quantiles = on_a_grid(*data)
    problem = problem_of(*data)
    settings = jb.SamplerSettings(walkers=128, tau_factor=250)
    posterior = jb.sample(problem, seed=seed, settings=settings, premises="exact")
    assert posterior.converged
    for i, name in enumerate(problem.parametrisation.names):
        values = posterior.values(name)
        middle = np.array([values.mean() - mean[i], values.std() - sd[i], np.median(values) - quantiles[i, 1]])
        assert np.abs(middle / sd[i]).max() < 0.01, (name, middle / sd[i])
        # Of 128 000 effective draws the mean scatters by 0.28 % of the standard deviation, an end, where the density is
        # 0.058, by √(0.025 · 0.975/n)/0.058 = 0.75 %: forty ends are within four times that.
        ends = np.quantile(values, [0.025, 0.975]) - quantiles[i, [0, 2]]
        assert np.abs(ends / sd[i]).max() < 0.03, (name, ends / sd[i])


def test_the_map_is_the_peak_of_the_density_of_the_logarithms():
    _, *data = observed(1)
    lam, sd_lam, ratio, sd_ratio = data
    estimate = jb.find_map(problem_of(*data))
    k = np.linspace(LOW, HIGH, 5501)

    def density(k1: Array, k2: Array) -> Array:
        predicted, shape = eigenpairs(k1[:, None], k2[None, :])
        square = ((lam[:, :, None, None] - predicted) / sd_lam[:, None, None]) ** 2
        square += ((ratio[:, :, None, None] - shape) / sd_ratio[:, None, None]) ** 2
        return -0.5 * square.sum(axis=(0, 1)) + np.log(k1)[:, None] + np.log(k2)

    rough = [k[::50][i] for i in np.unravel_index(density(k[::50], k[::50]).argmax(), (111, 111))]
    near = [np.linspace(one - 1e6, one + 1e6, 801) for one in rough]
    best = np.unravel_index(density(*near).argmax(), (801, 801))
    np.testing.assert_allclose(estimate.values, [one[i] for one, i in zip(near, best, strict=True)], atol=2.5e3)
