"""A steel rod on a joint, whose FRFs these tests read, fit and correct: 383 mm long, 25 mm thick.

Timoshenko elements integrated from their shape functions, so that nothing here needs a model of jointbayes;
`tests/structure/test_structure.py` compares the two.

References
----------
Friedman, Z., Kosmatka, J. B. (1993). An improved two-node Timoshenko beam finite element. Computers & Structures 47(3),
473-481. DOI 10.1016/0045-7949(93)90243-7
"""

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.linalg import eigh

from vibrecords import FrfData, FrfSet, RelativeNoise, quantity_factor

LENGTH, DIAMETER, YOUNG, POISSON, DENSITY = 0.383, 0.025, 2.1e11, 0.3, 7800.0
#: Stiffness of the joint at node 1, translation and rotation.
CLAMP = np.array([[5.05e9, 3.44e7], [3.44e7, 1.52e6]])


@cache
def free_rod(elements: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and consistent mass of the rod without its joint, DOFs y and rz of each node."""
    area, inertia = np.pi * DIAMETER**2 / 4, np.pi * DIAMETER**4 / 64
    shear = 6 * (1 + POISSON) / (7 + 6 * POISSON) * YOUNG / (2 * (1 + POISSON)) * area  # Cowper's coefficient
    step = LENGTH / elements
    phi = 12 * YOUNG * inertia / (shear * step**2)
    stiffness, mass = np.zeros((2, 4, 4))
    for x, weight in zip(*leggauss(4), strict=True):  # exact for the sixth power, of the mass
        s, w = (x + 1) / 2, weight / 2 * step
        bend = 3 * s**2 - 2 * s**3 + phi * s
        v = [1 + phi - bend, step * (s**3 - (2 + phi / 2) * s**2 + (1 + phi / 2) * s)]
        v = np.array([*v, bend, step * (s**3 - (1 - phi / 2) * s**2 - phi / 2 * s)]) / (1 + phi)
        turn = 6 * (s - s**2) / step
        theta = np.array([-turn, 3 * s**2 - (4 + phi) * s + 1 + phi, turn, 3 * s**2 - (2 - phi) * s]) / (1 + phi)
        slope = np.array([-turn - phi / step, 3 * s**2 - (4 + phi) * s + 1 + phi / 2, turn + phi / step])
        slope = np.array([*slope, 3 * s**2 - (2 - phi) * s - phi / 2]) / (1 + phi)
        curve = np.array([(12 * s - 6) / step, 6 * s - 4 - phi, (6 - 12 * s) / step, 6 * s - 2 + phi])
        curve = curve / (step * (1 + phi))
        bent, sheared = YOUNG * inertia * np.outer(curve, curve), shear * np.outer(slope - theta, slope - theta)
        stiffness += w * (bent + sheared)
        mass += w * DENSITY * (area * np.outer(v, v) + inertia * np.outer(theta, theta))
    whole = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for i in range(0, 2 * elements, 2):
        whole[:, i : i + 4, i : i + 4] += stiffness, mass
    return whole[0], whole[1]


def rows(dofs: Sequence[str]) -> list[int]:
    """Rows of DOFs such as ``"11:y"``, ``"1:rz"``."""
    return [2 * int(node) - 2 + (way == "rz") for node, way in (dof.split(":") for dof in dofs)]


def on_joint(elements: int = 10, joint: np.ndarray = CLAMP) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of the rod on its joint."""
    stiffness, mass = (matrix.copy() for matrix in free_rod(elements))
    stiffness[:2, :2] += joint
    return stiffness, mass


def receptance(
    lines: np.ndarray,
    outputs: Sequence[str],
    inputs: Sequence[str],
    *,
    elements: int = 10,
    joint: np.ndarray = CLAMP,
    loss_factor: float | None = None,
    masses: Mapping[str, float] | None = None,
) -> np.ndarray:
    """FRFs, shape (lines, outputs, inputs): 1 % of critical damping in each mode, or a loss factor of the rod.

    `masses` sit at DOFs, kg.
    """
    (stiffness, mass), omega = on_joint(elements, joint), 2 * np.pi * np.asarray(lines)
    for dof, more in (masses or {}).items():
        mass[rows([dof]), rows([dof])] += more
    if loss_factor is not None:
        dynamic = stiffness + 1j * loss_factor * free_rod(elements)[0] - (omega**2)[:, None, None] * mass
        return np.linalg.inv(dynamic)[:, rows(outputs)][:, :, rows(inputs)]
    square, shapes = eigh(stiffness, mass)
    gain = 1 / (square - omega[:, None] ** 2 + 0.02j * np.sqrt(square) * omega[:, None])
    return np.einsum("om,lm,im->loi", shapes[rows(outputs)], gain, shapes[rows(inputs)])


def measured(
    lines: np.ndarray,
    noise: RelativeNoise,
    rng: np.random.Generator | None,
    outputs: Sequence[str] = ("11:y",),
    inputs: Sequence[str] = ("11:y",),
    quantity: str = "receptance",
) -> FrfData:
    """FRFs of the rod with noise of a law, exact without a generator; the variance is stated either way."""
    true = receptance(lines, outputs, inputs) * quantity_factor(lines, quantity)[:, None, None]
    variance, values = noise.variance(true), true
    if rng is not None:
        real, imag = rng.standard_normal((2, *true.shape))
        values = true + np.sqrt(variance / 2) * (real + 1j * imag)
    return FrfData(FrfSet(lines, values, tuple(outputs), tuple(inputs), quantity), variance, synthetic=True)
