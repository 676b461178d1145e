"""Eigen-directions of the information about a joint, named in words.

An eigenvector of the information in ln k11, ln k12, ln k22 is a direction; an engineer wants a quantity. The gradient
of ln q of each physical quantity q that can be made of a joint is compared with the direction. Where one fits, the
words name it and say how well *that quantity* is known; where none does, they name the product of powers that the
direction is.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.joint import STIFFNESS_NAMES
from jointbayes.posterior.fisher import EigenDirection, FisherInformation, inverse_information
from jointbayes.posterior.identifiability import IDENTIFIED_RATIO, WEAK_RATIO, Verdict

__all__ = ["NamedDirection", "interval_ratio", "name_directions", "spread_in_words", "summary_sentence", "verdict_of"]

Array = NDArray[np.float64]

_NORMAL_95 = 1.959963984540054
#: Least cosine between a direction and the gradient of ln q for q to name it.
_SAME_DIRECTION = 0.98
#: A named quantity may be so many times less well known than the direction itself, at most.
_LOOSE = 3.0
#: Standard deviations within this factor of each other belong to directions that may be mixed at will.
_ALIKE = 2.0
#: A stiffness that moves less than this, relative to the one that moves most, is not said to move along.
_MOVES_ALONG = 0.15
_LARGEST_FACTOR = 1e3
_SUPERSCRIPT = {1: "", 2: "²"}


@dataclass(frozen=True, slots=True, eq=False)
class NamedDirection:
    """One direction in words.

    Parameters
    ----------
    quantity
        What the direction is: ``"k22 − k12²/k11"``, ``"k11 along k12 (k12 ∝ k11^0.4)"``.
    sd
        Standard deviation of ln of the quantity (of ρ itself where that is the quantity).
    verdict
        By the limits of `jointbayes.posterior.identifiability`, from the 95 % interval that `sd` implies.
    weights
        Its gradient over `names`, scaled to length one, shape (p,).
    names
        Coordinates that the weights belong to.
    sentence
        For example ``"k22 is known to 0.58 %"``.
    """

    quantity: str
    sd: float
    verdict: Verdict
    weights: Array
    names: tuple[str, ...]
    sentence: str


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A quantity: its name, the gradient of its ln, and by how much a simpler one is preferred."""

    quantity: str
    gradient: Array
    penalty: float


def interval_ratio(sd: float) -> float:
    """Upper over lower end of the 95 % interval that a standard deviation of a logarithm implies."""
    exponent = 2 * _NORMAL_95 * sd
    return math.exp(exponent) if exponent < 700 else math.inf


def verdict_of(sd: float) -> Verdict:
    """Verdict that the 95 % interval of a logarithm of this standard deviation implies; contraction not regarded.

    Examples
    --------
    >>> [verdict_of(sd) for sd in (0.05, 0.2, 0.3)]
    ['identified', 'weakly identified', 'not identified']
    """
    ratio = interval_ratio(sd)
    if ratio > WEAK_RATIO:
        return "not identified"
    return "identified" if ratio <= IDENTIFIED_RATIO else "weakly identified"


def spread_in_words(sd: float) -> str:
    """One standard deviation of a logarithm as the factor exp(sd): in per cent where small, else as a factor.

    Examples
    --------
    >>> spread_in_words(0.0058), spread_in_words(0.15), spread_in_words(1.97), spread_in_words(math.inf)
    ('0.58 %', '16 %', 'a factor of 7.2', 'more than a factor of 1000')
    """
    if sd > math.log(_LARGEST_FACTOR):
        return f"more than a factor of {_LARGEST_FACTOR:.0f}"
    if interval_ratio(sd) > WEAK_RATIO:
        return f"a factor of {math.exp(sd):.2g}"
    return f"{100 * math.expm1(sd):.2g} %"


def name_directions(fisher: FisherInformation, *, with_prior: bool = False) -> tuple[NamedDirection, ...]:
    """Name each eigen-direction of the information about the joint, best known first.

    Where every single stiffness is identified the words name those: combinations would say nothing more.

    Parameters
    ----------
    fisher
        Information at a mode; its nuisances are marginalised.
    with_prior
        Whether the joint's own prior counts as information.

    Returns
    -------
    tuple of NamedDirection
        As many as the joint has coordinates.
    """
    names, information = fisher.joint_information(with_prior=with_prior)
    directions = fisher.eigen_directions(with_prior=with_prior)
    covariance = inverse_information(information)
    stiffness = fisher.parametrisation.stiffness(fisher.theta[: len(fisher.joint_names)])
    candidates = _candidates(names, dict(zip(STIFFNESS_NAMES, map(float, stiffness), strict=True)))
    alone = _singly(names, range(len(names)), covariance)
    if all(named.verdict == "identified" for named in alone):
        return tuple(alone)
    out: list[NamedDirection] = []
    for group in _groups(directions):
        singles = _spanning_singles(group)
        if singles is not None:
            out += _singly(names, singles, covariance)
        else:
            out += [_named(direction, candidates, covariance) for direction in group]
    return tuple(out)


def summary_sentence(named: Sequence[NamedDirection]) -> str:
    """All directions in one sentence, best known first.

    Examples
    --------
    >>> summary_sentence([])
    'The joint has no stiffness to be known.'
    """
    if not named:
        return "The joint has no stiffness to be known."
    return "; ".join(n.sentence for n in named) + "."


def _groups(directions: Sequence[EigenDirection]) -> list[list[EigenDirection]]:
    """Directions whose standard deviations are alike: their eigenvectors are one choice among many."""
    groups: list[list[EigenDirection]] = []
    for direction in directions:
        if groups and direction.sd <= _ALIKE * groups[-1][0].sd:
            groups[-1].append(direction)
        else:
            groups.append([direction])
    return groups


def _spanning_singles(group: Sequence[EigenDirection]) -> list[int] | None:
    """Coordinates that by themselves span a group of two or more directions; None if it takes mixtures."""
    if len(group) < 2:
        return None
    length = np.linalg.norm([direction.weights for direction in group], axis=0)
    inside = [int(i) for i in np.flatnonzero(length >= _SAME_DIRECTION)]
    return inside if len(inside) == len(group) else None


def _candidates(names: tuple[str, ...], k: dict[str, float]) -> list[_Candidate]:
    """Quantities that can be made of the joint's coordinates, with ∂ ln q/∂ coordinates at this joint."""
    unit = np.eye(len(names))
    out = [_Candidate(name, unit[i], 1.0) for i, name in enumerate(names)]
    logs = [i for i, name in enumerate(names) if name != "rho"]
    for powers in itertools.product(range(-2, 3), repeat=len(logs)):
        used = [p for p in powers if p]
        if len(used) < 2 or sum(used) < 0 or math.gcd(*used) != 1:
            continue  # no simple quantity, or the reciprocal or a power of another one
        gradient = np.array(powers, dtype=float) @ unit[logs]
        text = _powers_text([names[i] for i in logs], powers)
        out.append(_Candidate(text, gradient, 0.8 + 0.2 * sum(map(abs, used))))
    return out + _condensed(names, k)


def _condensed(names: tuple[str, ...], k: dict[str, float]) -> list[_Candidate]:
    """Stiffness of one DOF with the other free (the reciprocal of its compliance), det K^J and the cross compliance."""
    determinant = k["k11"] * k["k22"] - k["k12"] ** 2
    if len(names) < len(STIFFNESS_NAMES) or determinant <= 0:
        return []
    if "rho" in names:
        bend = -2 * k["k12"] * math.sqrt(k["k11"] * k["k22"]) / determinant  # d ln(1 − ρ²)/dρ
        rows = np.array([(0, 1, bend), (1, 0, bend), (1, 1, bend)])
        order = [names.index(name) for name in ("k11", "k22", "rho")]
    else:
        r = k["k12"] ** 2 / determinant
        rows = np.array([(r, -2 * r, 1 + r), (1 + r, -2 * r, r), (1 + r, -2 * r, 1 + r), (-1 - r, 1 + 2 * r, -1 - r)])
        order = [names.index(name) for name in STIFFNESS_NAMES]
    texts = ("k22 − k12²/k11", "k11 − k12²/k22", "k11·k22 − k12²", "k12/(k11·k22 − k12²)")
    unit = np.eye(len(names))[order]
    return [_Candidate(text, row @ unit, p) for text, row, p in zip(texts, rows, (1.1, 1.1, 1.6, 1.8), strict=False)]


def _named(direction: EigenDirection, candidates: Sequence[_Candidate], covariance: Array) -> NamedDirection:
    """Words for one direction: a quantity that fits, else powers where it is known and "along" where it is not."""
    w, names = direction.weights, direction.names
    best, best_score = None, math.inf
    for candidate in candidates:
        length = float(np.linalg.norm(candidate.gradient))
        if abs(candidate.gradient @ w) < _SAME_DIRECTION * length:
            continue
        sd = _sd_of(candidate.gradient, covariance)
        known = verdict_of(sd) != "not identified" or candidate.quantity in names
        if known and sd <= _LOOSE * direction.sd * length and sd / length * candidate.penalty < best_score:
            best, best_score = candidate, sd / length * candidate.penalty
    if best is not None:
        return _of(names, best.quantity, best.gradient, covariance)
    if verdict_of(direction.sd * float(np.abs(w).max())) != "identified":
        return _along(direction)
    exponents = _rounded_powers(direction, covariance)
    return _of(names, _powers_text(names, exponents), np.array(exponents), covariance)


def _singly(names: tuple[str, ...], chosen: Iterable[int], covariance: Array) -> list[NamedDirection]:
    """The chosen coordinates themselves, best known first."""
    unit = np.eye(len(names))
    return sorted((_of(names, names[i], unit[i], covariance) for i in chosen), key=lambda named: named.sd)


def _of(names: tuple[str, ...], quantity: str, gradient: Array, covariance: Array) -> NamedDirection:
    sd = _sd_of(gradient, covariance)
    return NamedDirection(
        quantity, sd, verdict_of(sd), gradient / np.linalg.norm(gradient), names, _sentence(quantity, sd)
    )


def _sd_of(gradient: Array, covariance: Array) -> float:
    """Standard deviation of a combination; coordinates that do not enter may be unknown altogether."""
    used = gradient != 0
    g = gradient[used]
    return float(np.sqrt(g @ covariance[np.ix_(used, used)] @ g))


def _sentence(quantity: str, sd: float) -> str:
    verdict = verdict_of(sd)
    spread = f"±{sd:.2g}" if quantity.startswith("rho") else spread_in_words(sd)
    if verdict == "not identified":
        return f"{quantity} is not known: {spread}"
    return f"{quantity} is known {'to' if verdict == 'identified' else 'roughly, to'} {spread}"


def _rounded_powers(direction: EigenDirection, covariance: Array) -> list[float]:
    """Exponents scaled to a largest of one, with as few decimals as keep the combination as well known as it is."""
    scaled = direction.weights / np.abs(direction.weights).max()
    for decimals in (1, 2, 3, 4):
        rounded = np.round(scaled, decimals)
        if _sd_of(rounded, covariance) <= 1.5 * direction.sd * np.linalg.norm(rounded):
            break
    return [float(p) for p in rounded]


def _powers_text(names: Sequence[str], powers: Sequence[float]) -> str:
    """k11^a k12^b … as a fraction: ``"k12²/k11"``, ``"k11^0.3·k22/k12^0.73"``; where ρ leads, a sum with logarithms."""
    by_name = dict(zip(names, powers, strict=True))
    rho = by_name.pop("rho", 0.0)
    if rho and abs(rho) == max(map(abs, powers)):
        terms = [f" {'+' if p > 0 else '−'} {abs(p):g} ln {name}" for name, p in by_name.items() if p]
        return "rho" + "".join(terms)

    def product(sign: int) -> list[str]:
        sizes = {name: abs(power) for name, power in by_name.items() if power * sign > 0}
        return [name + _SUPERSCRIPT.get(int(p) if p == int(p) else 0, f"^{p:g}") for name, p in sizes.items()]

    above, below = product(1), product(-1)
    text = "·".join(above) or "1"
    if below:
        text += f"/{below[0]}" if len(below) == 1 else f"/({'·'.join(below)})"
    return text if not rho else f"{text}·exp({'−' if rho < 0 else ''}{abs(rho):g} rho)"


def _along(direction: EigenDirection) -> NamedDirection:
    """A direction as the stiffness that moves most along it, and how the others move with it."""
    w, names = direction.weights, direction.names
    main = int(np.abs(w).argmax())
    order = [int(i) for i in np.argsort(-np.abs(w), kind="stable") if i != main]
    movers = [i for i in order if abs(w[i]) >= _MOVES_ALONG * abs(w[main])]
    parts = [
        word + " " + " and ".join(names[i] for i in movers if sign * w[i] * w[main] > 0)
        for word, sign in (("along", 1), ("against", -1))
        if any(sign * w[i] * w[main] > 0 for i in movers)
    ]
    how = ", ".join(_moves_with(names[i], names[main], w[i] / w[main]) for i in movers)
    quantity = f"{names[main]} {' and '.join(parts)} ({how})" if movers else names[main]
    sd = direction.sd * float(abs(w[main]))
    return NamedDirection(quantity, sd, verdict_of(sd), w, names, _sentence(quantity, sd))


def _moves_with(name: str, main: str, slope: float) -> str:
    """How one coordinate follows another along a direction."""
    if name == "rho":
        return f"rho {slope * math.log(2):+.2g} as {main} doubles"
    if main == "rho":
        return f"{name} times {math.exp(0.1 * slope):.3g} as rho grows by 0.1"
    power = f"{slope:.2g}".replace("-", "−")
    return f"{name} ∝ {main}" + ("" if power == "1" else f"^{power}")
