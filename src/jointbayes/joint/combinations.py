"""Quantities that can be made of a joint's stiffnesses: each by itself, products of powers, condensed stiffnesses."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.joint.log import LogStiffness
from jointbayes.joint.parametrisation import Parametrisation
from jointbayes.joint.plain_springs import PlainSprings
from jointbayes.joint.quantities import STIFFNESS_NAMES
from jointbayes.joint.signed import SignedCoupling

__all__ = [
    "Combination",
    "condensed_stiffnesses",
    "parametrisation_of_draws",
    "powers_text",
    "products_of_powers",
    "single_value",
]

Array = NDArray[np.float64]

_SUPERSCRIPT = {1: "", 2: "²"}


@dataclass(frozen=True, slots=True, eq=False)
class Combination:
    """A quantity: name, values by stiffness (n, 3), whether it is a coordinate, and what it must be better by."""

    name: str
    of: Callable[[Array], Array]
    single: bool
    penalty: float


def parametrisation_of_draws(stiffness: Array) -> Parametrisation:
    """Coordinates that fit draws, shape (n, 3): ρ takes the place of ln k12 where the coupling has both signs."""
    if not stiffness[:, 1].any():
        moving = np.ptp(stiffness, axis=0) > 0
        return PlainSprings(tuple(name for name, moves in zip(STIFFNESS_NAMES, moving, strict=True) if moves))
    return LogStiffness() if (stiffness[:, 1] > 0).all() else SignedCoupling()


def single_value(name: str) -> Callable[[Array], Array]:
    """A stiffness, or the coupling coefficient ``"rho"``, as a function of (k11, k12, k22), shape (n, 3)."""
    if name == "rho":
        return lambda k: k[:, 1] / np.sqrt(k[:, 0] * k[:, 2])
    index = STIFFNESS_NAMES.index(name)
    return lambda k: k[:, index]


def products_of_powers(names: tuple[str, ...]) -> list[Combination]:
    """Products of small powers of the coordinates that are logarithms."""
    logs = [name for name in names if name != "rho"]
    columns = [STIFFNESS_NAMES.index(name) for name in logs]
    out = []
    for powers in itertools.product(range(-2, 3), repeat=len(logs)):
        used = [p for p in powers if p]
        if len(used) < 2 or sum(used) < 0 or math.gcd(*used) != 1 or (sum(used) == 0 and used[0] < 0):
            continue  # no simple quantity, or the reciprocal or a power of another one
        exponents = np.array(powers, dtype=float)

        def product(k: Array, exponents: Array = exponents) -> Array:
            return np.asarray(np.exp(np.log(np.abs(k[:, columns])) @ exponents))  # a prior may have either sign

        out.append(Combination(powers_text(logs, powers), product, False, 0.6 + 0.3 * sum(map(abs, used))))
    return out


def condensed_stiffnesses(names: tuple[str, ...]) -> list[Combination]:
    """Stiffness of one DOF with the other free (the reciprocal of its compliance), det K^J and the cross compliance."""
    if len(names) < len(STIFFNESS_NAMES):
        return []
    out = [
        Combination("k22 − k12²/k11", lambda k: k[:, 2] - k[:, 1] ** 2 / k[:, 0], False, 1.1),
        Combination("k11 − k12²/k22", lambda k: k[:, 0] - k[:, 1] ** 2 / k[:, 2], False, 1.1),
        Combination("k11·k22 − k12²", _determinant, False, 1.6),
    ]
    if "rho" not in names:
        out.append(Combination("k12/(k11·k22 − k12²)", lambda k: k[:, 1] / _determinant(k), False, 1.8))
    return out


def _determinant(k: Array) -> Array:
    return k[:, 0] * k[:, 2] - k[:, 1] ** 2


def powers_text(names: Sequence[str], powers: Sequence[float]) -> str:
    """k11^a k12^b … as a fraction: ``"k12²/k11"``, ``"k11^0.3·k22/k12^0.73"``; ρ in an exponential."""
    by_name = dict(zip(names, powers, strict=True))
    rho = by_name.pop("rho", 0.0)

    def product(sign: int) -> list[str]:
        sizes = {name: abs(power) for name, power in by_name.items() if power * sign > 0}
        return [name + _SUPERSCRIPT.get(int(p) if p == int(p) else 0, f"^{p:g}") for name, p in sizes.items()]

    above, below = product(1), product(-1)
    text = "·".join(above) or "1"
    if below:
        text += f"/{below[0]}" if len(below) == 1 else f"/({'·'.join(below)})"
    return text if not rho else f"{text}·exp({'−' if rho < 0 else ''}{abs(rho):g} rho)"
