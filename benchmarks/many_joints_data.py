"""The two problems with many joints: the portal frame of configs/portal_frame.toml, and one of six damped joints."""

import re
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from jointbayes.inference import Problem
from vibrecords import FrfData, FrfSet, RelativeNoise

ROOT = Path(__file__).resolve().parents[1]
BASE = ROOT / "configs" / "portal_frame.toml"
Array = NDArray[np.float64]

#: For 200 data sets: 141 lines, and a noise floor of the instruments that is the same at all of them.
_FEW_LINES = {"f_max_hz": "580.0", "f_step_hz": "4.0", "relative": "0.0", "floor": "0.3"}


@cache
def four_joints(*, few_lines: bool = False) -> jb.Case:
    """Four joints of three springs each; with `few_lines` as it is calibrated."""
    text = BASE.read_text(encoding="utf-8")
    for key, value in _FEW_LINES.items() if few_lines else ():
        text, count = re.subn(rf"(?m)((?:^|\W){key} = )[^\n,#]*[^\s,#}}]", rf"\g<1>{value}", text)
        if count != 1:
            raise ValueError(f"{BASE}: expected {key} once, found it {count} times")
    return jb.case_from_text("four joints" + few_lines * ", few lines", text)


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


#: Six columns of different distances, and the springs of their feet: kx, ky in N/m, krz in N·m/rad, and loss factors.
_COLUMNS = {
    "A": (0, 6.0e7, 1.5e8, 6.0e4, 0.05),
    "B": (300, 2.0e7, 6.0e7, 2.5e4, 0.10),
    "C": (700, 1.0e8, 2.5e8, 1.5e5, 0.03),
    "D": (1200, 3.0e7, 1.0e8, 4.0e4, 0.08),
    "E": (1550, 5.0e7, 2.0e8, 3.0e4, 0.04),
    "F": (2150, 4.0e7, 8.0e7, 8.0e4, 0.06),
}


@cache
def six_joints() -> jb.Case:
    """Six joints of three springs, each with a loss factor of its own: 36 unknowns, from 16 FRFs."""
    points, members, joints, truth = [], [], [], []
    for name, (x, kx, ky, krz, eta) in _COLUMNS.items():
        points += [f"foot{name} = [{x}, 0, 0]", f"low{name} = [{x}, 60, 0]", f"head{name} = [{x}, 400, 0]"]
        members.append(f'{{ points = ["foot{name}", "low{name}", "head{name}"] }}')
        priors = [f'{k} = {{ distribution = "log_uniform", low = 1e6, high = 1e10 }}' for k in ("kx", "ky")]
        priors.append('krz = { distribution = "log_uniform", low = 1e3, high = 1e7 }')
        priors += [
            f'{e} = {{ distribution = "log_uniform", low = 1e-3, high = 1.0 }}' for e in ("etax", "etay", "etarz")
        ]
        dofs = ", ".join(f'"foot{name}:{d}"' for d in ("x", "y", "rz"))
        joints.append(
            f'[joints.{name}]\nkind = "springs"\ndofs = [{dofs}]\nloss_factors = ["kx", "ky", "krz"]\n'
            f"prior = {{ {', '.join(priors)} }}\n"
        )
        values = f"kx = {kx}, ky = {ky}, krz = {krz}, etax = {eta}, etay = {eta / 2}, etarz = {2 * eta}"
        truth.append(f"{name} = {{ {values} }}")
    heads = ", ".join(f'"head{name}"' for name in _COLUMNS)
    outputs = [f"low{name}:x" for name in _COLUMNS] + ["headB:y", "headE:y"]
    text = f"""
title = "Frame on six damped base joints"
[structure]
kind = "frame"
directions = ["x", "y", "rz"]
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = {{ shape = "rectangle", width_mm = 40.0, height_mm = 20.0 }}
points = {{ {", ".join(points)} }}
members = [{", ".join(members)}, {{ points = [{heads}] }}]
damping = {{ law = "loss_factor", loss_factor = 0.004 }}
{"".join(joints)}
[data]
kind = "synthetic_frf"
outputs = {str(outputs).replace("'", '"')}
inputs = ["headA:x", "headD:y"]
f_min_hz = 20.0
f_max_hz = 1000.0
f_step_hz = 4.0
noise = {{ relative = 0.03, floor = 0.01, seed = 1 }}
[data.truth.stiffness]
{chr(10).join(truth)}
"""
    return jb.case_from_text("six joints", text)


def chain_truth(count: int, seed: int = 1) -> Array:
    """Springs of a chain of so many joints, shape (count,), N/m: within a factor of two of 1e7."""
    exponents = np.random.default_rng(seed).uniform(6.7, 7.3, size=count)
    return np.array([float(f"{10**exponent:.4g}") for exponent in exponents])


def chain_case(count: int, seed: int = 1) -> jb.Case:
    """A chain of 5 kg masses, each joined to the one before it by one spring, from the FRF of 119 lines at its end."""
    masses = ", ".join(f"{i} = 5.0" for i in range(1, count + 1))
    joints, truth = [], []
    for i, stiffness in enumerate(chain_truth(count, seed), 1):
        against = f'against = ["{i - 1}:x"]\n' if i > 1 else ""
        joints.append(
            f'[joints.j{i}]\nkind = "springs"\ndofs = ["{i}:x"]\n{against}'
            'prior.kx = { distribution = "log_uniform", low = 1e6, high = 1e8 }\n'
        )
        truth.append(f"j{i} = {{ kx = {stiffness} }}\n")
    text = f"""
title = "Chain of {count} joints"
[structure]
kind = "chain"
masses_kg = {{ {masses} }}
damping = {{ law = "modal", ratio = 0.02 }}
{"".join(joints)}
[data]
kind = "synthetic_frf"
outputs = ["{count}:x"]
inputs = ["{count}:x"]
f_min_hz = 10.0
f_max_hz = 600.0
f_step_hz = 5.0
noise = {{ relative = 0.03, floor = 0.01, seed = 1 }}
[data.truth.stiffness]
{"".join(truth)}"""
    return jb.case_from_text(f"chain of {count}", text)
