"""Quantities that can be made of joints' stiffnesses: each by itself, products of powers, condensed stiffnesses."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointbayes.joint.blocks import Blocks
from jointbayes.joint.coupled import CoupledPair
from jointbayes.joint.damped import Damped
from jointbayes.joint.log import LogStiffness
from jointbayes.joint.parametrisation import Parametrisation
from jointbayes.joint.plain_springs import PlainSprings
from jointbayes.joint.quantities import is_rotation_unit, prefixed
from jointbayes.joint.signed import SignedCoupling
from vibrecords.arrays import Array

_SUPERSCRIPT = {1: "", 2: "²"}
#: Of more stiffnesses than these products are made of two at a time.
_FEW = 4
#: Lever arms in m at which a joint's flexibility is evaluated, either way.
_OF_AN_ARM = 1.5  # penalty: the arm is fitted
_ARMS = np.geomspace(1e-3, 10.0, 401)


@dataclass(frozen=True, slots=True, eq=False)
class Combination:
    """A quantity: name, values by stiffness (n, q), whether it is a coordinate, what it must be better by, unit.

    `what` is how a sentence on a flexibility begins; else empty.
    """

    name: str
    of: Callable[[Array], Array]
    single: bool
    penalty: float
    unit: str = ""
    what: str = ""

    def within(self, columns: slice) -> "Combination":
        """The same of one joint whose stiffnesses stand in these columns of those of all joints."""
        return replace(self, of=lambda k: self.of(k[:, columns]))


def parametrisation_of_draws(parametrisation: Parametrisation, values: Array) -> Parametrisation:
    """Coordinates that fit draws, shape (n, q), of a joint that was sampled in others.

    Of a coupled pair ρ takes the place of ln k12 where the coupling has both signs.
    """
    if isinstance(parametrisation, Blocks):
        fitting = [parametrisation_of_draws(joint, values[:, k]) for joint, _, k in parametrisation.parts]
        named = zip(parametrisation.blocks, fitting, strict=True)
        return Blocks(tuple(replace(block, parametrisation=joint) for block, joint in named))
    if isinstance(parametrisation, Damped):
        count = len(parametrisation.of.quantities)
        return replace(parametrisation, of=parametrisation_of_draws(parametrisation.of, values[:, :count]))
    if not isinstance(parametrisation, CoupledPair):
        return parametrisation
    if not values[:, 1].any():
        moving = np.ptp(values, axis=0) > 0
        names = parametrisation.stiffness_names
        return PlainSprings(tuple(name for name, moves in zip(names, moving, strict=True) if moves))
    return LogStiffness() if (values[:, 1] > 0).all() else SignedCoupling()


def single_values(parametrisation: Parametrisation) -> list[Combination]:
    """Every coordinate: a stiffness, or a coupling coefficient, as a function of the stiffnesses, shape (n, q)."""
    return [Combination(name, _value(parametrisation, i), True, 1.0) for i, name in enumerate(parametrisation.names)]


def _value(parametrisation: Parametrisation, column: int) -> Callable[[Array], Array]:
    axis = parametrisation.axes[column]
    if isinstance(parametrisation, Blocks):
        blocks = [(joint, k, i) for joint, _, k in parametrisation.parts for i in range(len(joint.axes))]
        joint, k, i = blocks[column]
        of_joint = _value(joint, i)
        return lambda values: of_joint(values[:, k])
    if axis.name in parametrisation.stiffness_names:
        index = parametrisation.stiffness_names.index(axis.name)
        return lambda k: k[:, index]
    if isinstance(parametrisation, Damped):
        return _value(parametrisation.of, column)  # damping is among its own quantities
    if isinstance(parametrisation, SignedCoupling):
        return lambda k: k[:, 1] / np.sqrt(k[:, 0] * k[:, 2])

    def value(k: Array) -> Array:
        theta = parametrisation.coordinates(k)[:, column]
        return np.exp(theta) if axis.logarithmic else theta

    return value


def combinations_of(parametrisation: Parametrisation, joint: str = "") -> list[Combination]:
    """Products of powers and condensed stiffnesses of each joint, whose names begin with the joint's."""
    if isinstance(parametrisation, Blocks):
        return [
            combination.within(k)
            for block, (of_joint, _, k) in zip(parametrisation.blocks, parametrisation.parts, strict=True)
            for combination in combinations_of(of_joint, block.name)
        ]
    # 1. products of small powers of the coordinates that are logarithms of stiffnesses; of many, two at a time
    stiffnesses = parametrisation.stiffness_names
    logs = [name for name in parametrisation.names if name in stiffnesses]
    columns = [stiffnesses.index(name) for name in logs]
    names = [prefixed(joint, name) for name in logs]
    every = itertools.product(range(-2, 3), repeat=len(logs)) if len(logs) <= _FEW else _powers_of_pairs(len(logs))
    products = []
    for powers in every:
        used = [p for p in powers if p]
        if len(used) < 2 or sum(used) < 0 or math.gcd(*used) != 1 or (sum(used) == 0 and used[0] < 0):
            continue  # no simple quantity, or the reciprocal or a power of another one
        exponents = np.array(powers, dtype=float)

        def product(k: Array, exponents: Array = exponents) -> Array:
            return np.asarray(np.exp(np.log(np.abs(k[:, columns])) @ exponents))  # a prior may have either sign

        products.append(Combination(powers_text(names, powers), product, False, 0.6 + 0.3 * sum(map(abs, used))))
    # 2. of a coupled pair the stiffness of one DOF with the other free (1/compliance), det K^J, the cross compliance
    undamped = parametrisation.of if isinstance(parametrisation, Damped) else parametrisation
    if not isinstance(undamped, CoupledPair):
        return products
    k11, k12, k22 = (prefixed(joint, name) for name in undamped.stiffness_names)
    condensed = [
        Combination(f"{k22} − {k12}²/{k11}", lambda k: k[:, 2] - k[:, 1] ** 2 / k[:, 0], False, 1.1, "N·m/rad"),
        Combination(f"{k11} − {k12}²/{k22}", lambda k: k[:, 0] - k[:, 1] ** 2 / k[:, 2], False, 1.1, "N/m"),
        Combination(f"{k11}·{k22} − {k12}²", _determinant, False, 1.6),
    ]
    if not isinstance(undamped, SignedCoupling):
        condensed.append(Combination(f"{k12}/({k11}·{k22} − {k12}²)", lambda k: k[:, 1] / _determinant(k), False, 1.8))
    return products + condensed


def flexibilities_at_arms(parametrisation: Parametrisation, values: Array, joint: str = "") -> list[Combination]:
    """Flexibility of each joint of a translation and a rotation at the lever arm where draws, shape (n, q), agree best.

    A force at a distance a of the joint, which it also bends with the moment aF, moves along by F times
    (k22 − 2a k12 + a² k11)/(k11 k22 − k12²).
    """
    if isinstance(parametrisation, Blocks):
        return [
            combination.within(k)
            for block, (of_joint, _, k) in zip(parametrisation.blocks, parametrisation.parts, strict=True)
            for combination in flexibilities_at_arms(of_joint, values[:, k], block.name)
        ]
    quantities = parametrisation.quantities
    coupled = [quantity.may_be_negative for quantity in quantities] == [False, True, False]
    pair = coupled or [quantity.may_be_negative for quantity in quantities] == [False, False]
    if not pair or [is_rotation_unit(quantities[i].unit) for i in (0, -1)] != [False, True]:
        return []

    def flexibility(k: Array, arm: float) -> Array:
        coupling = k[:, 1] if coupled else 0.0
        across = k[:, -1] - 2 * arm * coupling + arm**2 * k[:, 0]
        return np.asarray(across / (k[:, 0] * k[:, -1] - coupling**2))

    arms = np.concatenate([-_ARMS[::-1], _ARMS] if coupled else [_ARMS])
    few = values[:: max(1, len(values) // 1000)]
    flexibilities = [flexibility(few, arm) for arm in arms]
    if not all((value > 0).all() for value in flexibilities):
        return []  # no joint of positive energy
    widths = [np.ptp(np.quantile(np.log(value), [0.025, 0.975])) for value in flexibilities]
    best = float(f"{arms[int(np.argmin(widths))]:.2g}")
    arm = f"a lever arm of {'−' if best < 0 else ''}{1000 * abs(best):g} mm"
    what = " ".join(filter(None, (f"under a force at {arm} the joint", joint, "gives")))
    name = prefixed(joint, f"flexibility at {arm}")
    return [Combination(name, lambda k: flexibility(k, best), False, _OF_AN_ARM, "m/N", what)]


def _powers_of_pairs(count: int) -> list[tuple[int, ...]]:
    """Small powers of two out of so many."""
    pairs, both = itertools.combinations(range(count), 2), [*itertools.product((-2, -1, 1, 2), repeat=2)]
    return [tuple({i: p, j: q}.get(n, 0) for n in range(count)) for i, j in pairs for p, q in both]


def _determinant(k: Array) -> Array:
    return k[:, 0] * k[:, 2] - k[:, 1] ** 2


def powers_text(names: Sequence[str], powers: Sequence[float], linear: Sequence[str] = ()) -> str:
    """k11^a k12^b … as a fraction: ``"k12²/k11"``, ``"k11^0.3·k22/k12^0.73"``; those in `linear` in an exponential."""
    by_name = dict(zip(names, powers, strict=True))
    exponents = {name: by_name.pop(name) for name in linear}

    def product(sign: int) -> list[str]:
        sizes = {name: abs(power) for name, power in by_name.items() if power * sign > 0}
        return [name + _SUPERSCRIPT.get(int(p) if p == int(p) else 0, f"^{p:g}") for name, p in sizes.items()]

    above, below = product(1), product(-1)
    text = "·".join(above) or "1"
    if below:
        text += f"/{below[0]}" if len(below) == 1 else f"/({'·'.join(below)})"
    for name, power in exponents.items():
        text += f"·exp({'−' if power < 0 else ''}{abs(power):g} {name})" if power else ""
    return text
