"""Structures with several joints that tests are about: a portal, a wheel, chains, and six damped joints."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from jointbayes.inference import Problem
from tests.case.refusal_rows import case_text_named
from tests.conftest import edited
from vibrecords import FrfData, FrfSet, RelativeNoise

Array = NDArray[np.float64]
#: Stiffnesses (kx, ky, krz) of both feet.
FEET = ((2e7, 8e7, 3e4), (9e7, 2e8, 1.2e5))


def portal(sensor_mm: float = 250.0, noise_seed: int = 1) -> str:
    """Case text of the portal, 500 mm wide and 400 mm high, with a sensor on its beam."""
    changes = ("mid = [250.0", f"mid = [{sensor_mm}"), ("seed = 1 ", f"seed = {noise_seed} ")
    return edited(case_text_named("portal_on_springs"), *changes)


def wheel(noise_seed: int = 1) -> str:
    """Case text of a wheel of three spokes, with a joint at each end of one, and a sensor of its hub's rotation."""
    return edited(case_text_named("wheel"), ("seed = 1 ", f"seed = {noise_seed} "))


def random_data(problem: Problem, seed: int) -> tuple[Array, Problem]:
    """A truth θ from the prior, and the problem with data of it: 3 % noise and a floor of 1 % of the median |H|."""
    rng = np.random.default_rng([seed, 77])
    theta = problem.prior.sample(rng, 1)[0]
    exact = problem.log_posterior.predicted(theta)[0]
    variance = RelativeNoise(0.03, 0.01).variance(exact)
    noise = rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape)
    assert isinstance(problem.test.data, FrfData)
    old = problem.test.data.frf
    frf = FrfSet(old.frequency_hz, exact + np.sqrt(variance / 2) * noise, old.outputs, old.inputs, old.quantity)
    return theta, problem.with_test(data=FrfData(frf, variance, synthetic=True))


@cache
def six_joints() -> jb.Case:
    """Six joints of three springs, each with a loss factor of its own: 36 unknowns, from 16 FRFs."""
    return jb.case_from_text("six joints", case_text_named("six_joints"))


def chain_truth(count: int, seed: int = 1) -> Array:
    """Springs of a chain of so many joints, shape (count,), N/m: within a factor of two of 1e7."""
    exponents = np.random.default_rng(seed).uniform(6.7, 7.3, size=count)
    return np.array([float(f"{10**exponent:.4g}") for exponent in exponents])


def chain_case(count: int, seed: int = 1) -> jb.Case:
    """A chain of 5 kg masses, each joined to the one before it by one spring, from the FRF of 119 lines at its end."""
    joints, truth = [], []
    for i, stiffness in enumerate(chain_truth(count, seed), 1):
        against = f'against = ["{i - 1}:x"]\n' if i > 1 else ""
        joints.append(f'[joints.j{i}]\ndofs = ["{i}:x"]\n{against}kind = "springs"\n'
                      'prior.kx = { distribution = "log_uniform", low = 1e6, high = 1e8 }\n')  # fmt: skip
        truth.append(f"j{i} = {{ kx = {stiffness} }}\n")
    masses = ", ".join(f"{i} = 5.0" for i in range(1, count + 1))
    changes = ("MASSES", masses), ("JOINTS", "".join(joints)), ("TRUTH", "".join(truth))
    text = edited(case_text_named("chain"), *changes).replace("COUNT", str(count))
    return jb.case_from_text(f"chain of {count}", text)
