"""Structures with several joints that tests are about: a portal, a wheel, chains, and six damped joints."""

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from jointbayes.inference import Problem
from vibrecords import FrfData, FrfSet, RelativeNoise

Array = NDArray[np.float64]
#: Stiffnesses (kx, ky, krz) of both feet.
FEET = ((2e7, 8e7, 3e4), (9e7, 2e8, 1.2e5))
_WHEEL = (3e4, 8e4, 2e5)
_FRAME = """
[structure]
kind = "frame"
directions = ["x", "y", "rz"]
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = { shape = "rectangle", width_mm = 40.0, height_mm = 20.0 }
damping = { law = "loss_factor", loss_factor = 0.005 }
"""


def portal(sensor_mm: float = 250.0, noise_seed: int = 1) -> str:
    """Case text of the portal, 500 mm wide and 400 mm high, with a sensor on its beam."""
    feet = "".join(
        f'[joints.{name}]\nkind = "springs"\ndofs = ["foot{name}:x", "foot{name}:y", "foot{name}:rz"]\n'
        for name in "AB"
    )
    truth = "".join(
        f"{name} = {{ kx = {kx}, ky = {ky}, krz = {krz} }}\n" for name, (kx, ky, krz) in zip("AB", FEET, strict=True)
    )
    return f"""title = "Symmetric portal"
{_FRAME}
members = [
  {{ points = ["footA", "headA"] }},
  {{ points = ["footB", "headB"] }},
  {{ points = ["headA", "mid", "headB"] }},
]
[structure.points]
footA = [0, 0, 0]
headA = [0, 400, 0]
footB = [500, 0, 0]
headB = [500, 400, 0]
mid = [{sensor_mm}, 400, 0]
{feet}
[data]
kind = "synthetic_frf"
outputs = ["mid:x"]
inputs = ["mid:x"]
f_min_hz = 10.0
f_max_hz = 1196.0
f_step_hz = 4.0
noise = {{ relative = 0.03, floor = 0.0, seed = {noise_seed} }}
[data.truth.stiffness]
{truth}"""


def wheel(noise_seed: int = 1) -> str:
    """Case text of a wheel of three spokes, with a joint at each end of one, and a sensor of its hub's rotation."""
    turns = {name: 2 * math.pi * i / 3 for i, name in enumerate("abc")}
    points = "".join(f"{n} = [{300 * math.cos(t):.12f}, {300 * math.sin(t):.12f}, 0]\n" for n, t in turns.items())
    joints = "".join(f'[joints.{name}]\nkind = "springs"\ndofs = ["{name}:rz"]\n' for name in turns)
    truth = "".join(f"{name} = {{ krz = {k} }}\n" for name, k in zip(turns, _WHEEL, strict=True))
    spokes = ", ".join(f'{{ points = ["hub", "{name}"] }}' for name in turns)
    return f"""title = "Wheel"
{_FRAME}
members = [{spokes}, {{ points = ["a", "b", "c", "a"] }}]
[structure.points]
hub = [0, 0, 0]
{points}
{joints}
[data]
kind = "synthetic_frf"
outputs = ["hub:rz"]
inputs = ["hub:rz"]
f_min_hz = 20.0
f_max_hz = 1500.0
f_step_hz = 5.0
noise = {{ relative = 0.03, floor = 0.0, seed = {noise_seed} }}
[data.truth.stiffness]
{truth}"""


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
