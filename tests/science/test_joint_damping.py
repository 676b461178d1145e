"""A joint's own loss factor is found where the structure's damping is another one, and not where nothing tells them."""

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import DirectSolve, FrfSet, Ports
from jointbayes.inference import JointPrior, Uniform
from jointbayes.joint import Damped, parametrisation_named
from jointbayes.measurement import FrfMeasurement
from jointbayes.structure import LossFactor
from tests.conftest import CLAMP, rod

pytestmark = pytest.mark.science

KIND = Damped(parametrisation_named("springs", ("y", "rz")), (), ("all",))
TRUTH = np.array([5e7, 6e4, 0.08])
PORTS = Ports(np.arange(20.0, 2500.0, 10.0), ("11:y", "6:y"), ("11:y",))


def posterior_of(seed, truth=TRUTH):
    structure = rod(damping=LossFactor(0.005))
    exact = DirectSolve(structure, CLAMP, PORTS).receptance(KIND.matrix(truth))[0]
    rng = np.random.default_rng(seed)
    sd = 0.03 * np.abs(exact) + 0.01 * np.median(np.abs(exact))
    values = exact + sd * (rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape))
    measurement = FrfMeasurement(FrfSet(PORTS.frequency_hz, values, PORTS.outputs, PORTS.inputs), 2 * sd**2)
    ends = [(5e5, 5e9), (6e2, 6e6), (1e-4, 1.0)]
    prior = JointPrior(KIND, tuple(Uniform(*np.log(end)) for end in ends))
    return jb.sample(jb.Problem(structure, CLAMP, measurement, prior), seed=1)


def test_the_loss_factor_of_a_joint_is_identified():
    posterior = posterior_of(1)
    assert posterior.converged
    for name, k in zip(KIND.stiffness_names, TRUTH, strict=True):
        low, high = posterior.interval(name, 0.999)
        assert low < k < high, name
    assert posterior.summary().parameters["eta"].known.verdict == "identified"


def test_the_loss_factor_of_a_joint_that_hardly_moves_is_not_identified():
    posterior = posterior_of(2, np.array([4e9, 5e6, 0.002]))
    assert posterior.converged
    assert posterior.identifiability("eta").verdict not in ("identified", "weakly identified")
