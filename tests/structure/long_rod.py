"""A kind of body of one's own: a rod of a hundred thousand DOFs whose motions are formulas."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointbayes.structure import Body, DampingLaw, LossFactor, Modes, Reduction

LAW = LossFactor(0.01)


class Points(Sequence[str]):
    """``"1:x"``, ``"2:x"`` and so on, made when they are asked for."""

    def __init__(self, count: int) -> None:
        self._numbers = range(1, count + 1)

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, at):
        return [f"{n}:x" for n in self._numbers[at]] if isinstance(at, slice) else f"{self._numbers[at]}:x"

    def index(self, label: str) -> int:
        return self._numbers.index(int(label.removesuffix(":x")))


@dataclass(frozen=True)
class StiffenedModes:
    """Modes at any factor on Young's modulus, which changes no shape."""

    modes: Modes

    def __call__(self, factors):
        stiffer = factors[:, :1] if factors.shape[1] else np.ones((len(factors), 1))
        return stiffer * self.modes.eigenvalues, np.repeat(self.modes.shapes[None], len(factors), axis=0)


@dataclass(frozen=True, repr=False)
class LongRod(Body):
    """A free rod in axial motion, its Young's modulus uncertain."""

    length: float = 2.0  # m
    area: float = 4e-4  # m²
    youngs_modulus: float = 2.1e11
    density: float = 7800.0
    labels: Sequence[str] = Points(100_000)
    damping: DampingLaw = LAW
    names: tuple[str, ...] = ("youngs_modulus",)
    top_hz: float = 1e5

    def frequency_hz(self, number):
        """Natural frequencies, number 0 the rigid-body motion."""
        return number / (2 * self.length) * np.sqrt(self.youngs_modulus / self.density)

    def reach_hz(self, count: int) -> float:
        return self.frequency_hz(count + 1)  # held at one DOF, each rises to the next at most

    def at(self, dofs: Iterable[str], top_hz: float) -> "LongRod":
        return replace(self, top_hz=top_hz)

    def certain(self) -> "LongRod":
        return replace(self, names=())

    def shapes(self, dofs: NDArray[np.intp], number) -> NDArray[np.float64]:
        """Motions of DOFs in modes of unit modal mass."""
        place = dofs / (self.n_dofs - 1)
        size = np.where(np.equal(number, 0), 1.0, 2.0) / (self.density * self.area * self.length)
        return np.sqrt(size) * np.cos(np.pi * np.outer(place, number))

    def rigid_motions(self, dofs: NDArray[np.intp]) -> NDArray[np.float64]:
        return self.shapes(dofs, [0])

    def free_modes(self, dofs: NDArray[np.intp], motions, forced=None):
        number = np.arange(20_000)  # those above the band become a few vectors
        modes = Modes((2 * np.pi * self.frequency_hz(number)) ** 2, motions.T @ self.shapes(dofs, number))
        reduction = Reduction.below(self.top_hz, modes, np.eye(len(modes.shapes)), forced)
        return StiffenedModes(reduction.reduce(modes))
