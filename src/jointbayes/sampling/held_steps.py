"""The steps that a long run holds in memory: evenly spaced ones of all, so that it grows no further."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jointbayes.arrays import Array
from jointbayes.sampling.ensemble import Block

#: Steps of each ensemble that are held at most. Longer runs hold every second, fourth and so on of them; τ and R̂ are
#: then those of these, τ in steps all the same, and never smaller than their distance.
MOST_HELD = 25_000
_AT_ONCE = 20  # blocks that are condensed together


def spacing(steps: int) -> int:
    """Distance of the steps that are held of so many: a power of two, and the same however a run came so far.

    Examples
    --------
    >>> [spacing(n) for n in (0, 25_000, 25_001, 1_000_000)]
    [1, 1, 2, 64]
    """
    every = 1
    while steps > every * MOST_HELD:
        every *= 2
    return every


@dataclass(slots=True)
class HeldSteps:
    """Steps of which not all are held any more.

    Parameters
    ----------
    steps, rows
        How many steps, and how many rows of blocks, these were.
    every
        Distance of those that are held, of which the first is step number `every`.
    theta, log_density
        Those that are, one after the other, shapes (ensembles, held, walkers, d) and (ensembles, held, walkers).
    accepted, proposed
        Proposals of each move by ensemble.
    singular
        Points without a finite density.
    """

    steps: int = 0
    rows: int = 0
    every: int = 1
    theta: list[Array] = field(default_factory=list)
    log_density: list[Array] = field(default_factory=list)
    accepted: list[Counter[str]] = field(default_factory=list)
    proposed: list[Counter[str]] = field(default_factory=list)
    singular: int = 0

    def take(self, rows: Sequence[list[Block]], every: int) -> None:
        """Hold of some rows of blocks, which follow, steps of this distance, and no more of those before."""
        if every > self.every and self.theta:
            keep = slice(every // self.every - 1, None, every // self.every)
            # copies, or what is dropped would stay in memory
            self.theta = [np.concatenate(self.theta, axis=1)[:, keep].copy()]
            self.log_density = [np.concatenate(self.log_density, axis=1)[:, keep].copy()]
        self.every = every
        theta, log_density = spaced(rows, self.steps, every)
        self.theta.append(theta)
        self.log_density.append(log_density)
        for row in rows:
            self.accepted = self.accepted or [Counter() for _ in row]
            self.proposed = self.proposed or [Counter() for _ in row]
            for accepted, proposed, block in zip(self.accepted, self.proposed, row, strict=True):
                self.singular += block.singular
                for name, count in block.moves.items():
                    accepted[name] += count.accepted
                    proposed[name] += count.proposed
            self.steps += len(row[0].theta)
        self.rows += len(rows)

    def with_rows(self, rows: Sequence[list[Block]], every: int) -> tuple[Array, Array]:
        """θ and log-density at this distance, of what is held and of the rows that follow."""
        further = [spaced(rows, self.steps, every)] if rows else []
        keep = slice(every // self.every - 1, None, every // self.every)
        if not self.theta:
            return further[0]
        parts = [(np.concatenate(self.theta, axis=1), np.concatenate(self.log_density, axis=1))]
        parts = [(theta[:, keep], log_density[:, keep]) for theta, log_density in parts] + further
        theta, log_density = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
        return theta, log_density

    def due(self, rows: int) -> bool:
        """Whether so many rows are worth taking."""
        return rows >= _AT_ONCE


def spaced(rows: Sequence[list[Block]], before: int, every: int) -> tuple[Array, Array]:
    """Steps whose number, with so many before, is a multiple: (ensembles, n, walkers, d), and log-density without d."""
    theta: list[list[Array]] = [[] for _ in rows[0]]
    log_density: list[list[Array]] = [[] for _ in rows[0]]
    for row in rows:
        kept = slice(-(before + 1) % every, None, every)
        for block, some, values in zip(row, theta, log_density, strict=True):
            some.append(block.theta[kept])
            values.append(block.log_density[kept])
        before += len(row[0].theta)
    return np.stack([np.concatenate(one) for one in theta]), np.stack([np.concatenate(one) for one in log_density])
