"""The steps of a run that have been made so far, in blocks, and what the checks found."""

from collections import Counter
from dataclasses import dataclass, field
from itertools import chain
from typing import Protocol

import numpy as np

from jointbayes.sampling.chains import Chains, Progress
from jointbayes.sampling.ensemble import Block, EnsembleState
from jointbayes.sampling.held_steps import MOST_HELD, HeldSteps, spacing
from jointbayes.sampling.settings import SamplerSettings
from jointbayes.sampling.several_modes import SeveralModes
from jointbayes.sampling.stopping import (
    Check,
    Quantities,
    Verdict,
    diagnose,
    expected_steps,
    judge,
    next_check,
    thinning,
    with_end_error,
)
from jointbayes.sampling.streams import Streams
from jointbayes.sampling.workers import MoveOn


class KeptBlocks(Protocol):
    """Blocks of steps that were made before."""

    def block(self, stage: int, number: int, shape: tuple[int, ...]) -> list[Block] | None:
        """A block of all ensembles of a stage, if it was kept and has this shape."""
        ...


@dataclass(frozen=True, slots=True)
class Slow:
    """Between which steps, and above which τ, a run is ended because it mixes slowly."""

    first: int
    last: int
    tau: float


@dataclass(slots=True)
class Stage:
    """A stage of a run in progress: the blocks of all ensembles so far, and what the checks found.

    ``blocks`` has one row per block, and one column per ensemble. Of a long stage ``held`` has the first steps, of
    which not all are in memory any more, and ``blocks`` those that follow.
    """

    blocks: list[list[Block]] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)
    step: int = 0
    held: HeldSteps = field(default_factory=HeldSteps)

    def verdict(self, settings: SamplerSettings) -> Verdict:
        """What the stop rule says of the last step, if it was looked at."""
        if self.checks and self.checks[-1].step == self.step:
            return judge(settings, self.checks)
        return Verdict(converged=False, reason="")

    def is_slow(self, slow: Slow) -> bool:
        """Whether the run stands at a check between these steps and mixes slowly."""
        if not slow.first <= self.step <= slow.last or self.checks[-1].step != self.step:
            return False
        return self.checks[-1].tau_max > slow.tau

    def extend(
        self,
        move_on: MoveOn,
        states: list[EnsembleState],
        streams: Streams,
        settings: SamplerSettings,
        kept: KeptBlocks | None = None,
    ) -> list[EnsembleState]:
        """Move every ensemble on by one block, which may have been kept, and return where they stand."""
        size = min(settings.check_every, settings.max_steps - self.step)
        number = self.step // settings.check_every
        walkers, dimension = states[0].theta.shape
        block = kept and kept.block(streams.stage, number, (size, len(states), walkers, dimension + 1))
        if not block:
            seeds = [streams.block(ensemble, number) for ensemble in range(len(states))]
            block = move_on(states, size, seeds)
        self.blocks.append(block)
        self.step += size
        return self.states()

    def states(self) -> list[EnsembleState]:
        """Where the ensembles stand after the last block."""
        return [block.end for block in self.blocks[-1]]

    def check_if_due(
        self, settings: SamplerSettings, quantities: Quantities | None, modes: SeveralModes | None = None
    ) -> None:
        """Look at all steps so far, where the time has come."""
        last = self.checks[-1].step if self.checks else 0
        if self.step == last or self.step != next_check(last, settings):
            return
        every = spacing(self.step)
        theta, _ = self.held.with_rows(self.blocks, every)
        self.checks.append(diagnose(theta, self.checks[-1] if self.checks else None, every, self.step, modes))
        self.checks[-1] = with_end_error(settings, self.checks, theta, quantities, every)

    def condense(self, rows: int) -> None:
        """Hold fewer of the steps of a long stage: of its first so many rows, which nobody else asks for any more."""
        count = min(rows - self.held.rows, len(self.blocks) - 1)
        if self.step > MOST_HELD and self.held.due(count):
            self.held.take(self.blocks[:count], spacing(self.step))
            del self.blocks[:count]

    def rows_from(self, number: int) -> list[list[Block]]:
        """Rows of blocks from a number on, none of which has been condensed."""
        return self.blocks[number - self.held.rows :]

    @property
    def rows(self) -> int:
        """Number of rows of blocks so far."""
        return self.held.rows + len(self.blocks)

    def by_ensemble(self) -> list[tuple[Block, ...]]:
        """Blocks with one row per ensemble."""
        return list(zip(*self.blocks, strict=True))

    def move_acceptance(self) -> dict[str, float]:
        """Fraction of accepted proposals of each move that was made, over all ensembles."""
        accepted, proposed = sum(self.held.accepted, Counter[str]()), sum(self.held.proposed, Counter[str]())
        for block in chain.from_iterable(self.blocks):
            for name, count in block.moves.items():
                accepted[name] += count.accepted
                proposed[name] += count.proposed
        return {name: accepted[name] / proposed[name] for name in proposed if proposed[name]}

    def report(self, settings: SamplerSettings, verdict: Verdict, seconds: float) -> Progress:
        """Where the run stands, for the caller."""
        last = self.checks[-1]
        return Progress(
            steps=self.step,
            max_steps=settings.max_steps,
            expected_steps=self.step if verdict.converged else expected_steps(settings, last),
            tau=last.tau_max,
            r_hat=last.r_hat_max,
            elapsed_seconds=seconds,
        )

    def chains(self, settings: SamplerSettings, verdict: Verdict, seconds: float) -> Chains:
        """Close the stage, whose last block always ends in a check."""
        counts = [[count for block in one for count in block.moves.values()] for one in self.by_ensemble()]
        accepted = np.array([sum(count.accepted for count in one) for one in counts])
        accepted += np.array([one.total() for one in self.held.accepted] or 0)
        every = spacing(self.step)
        theta, log_density = self.held.with_rows(self.blocks, every)
        return Chains(
            theta=theta,
            log_density=log_density,
            acceptance=accepted / (self.step * settings.walkers),
            move_acceptance=self.move_acceptance(),
            thin=thinning(self.checks[-1].tau),
            converged=verdict.converged,
            reason=verdict.reason,
            singular=self.held.singular + sum(block.singular for block in chain.from_iterable(self.blocks)),
            evaluations=settings.ensembles * settings.walkers * (self.step + 1),
            seconds=seconds,
            history=tuple(self.checks),
            every=every,
        )
