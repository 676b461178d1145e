"""The steps of a run that have been made so far, in blocks, and what the checks found."""

from collections import Counter
from dataclasses import dataclass, field
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from jointbayes.sampling.chains import Chains, Progress
from jointbayes.sampling.ensemble import Block, EnsembleState
from jointbayes.sampling.settings import SamplerSettings
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

__all__ = ["Slow", "Stage"]


@dataclass(frozen=True, slots=True)
class Slow:
    """Between which steps, and above which τ, a run is ended because it mixes slowly."""

    first: int
    last: int
    tau: float


@dataclass(slots=True)
class Stage:
    """A stage of a run in progress: the blocks of all ensembles so far, and what the checks found.

    ``blocks`` has one row per block, or per several that were read from a checkpoint, and one column per ensemble.
    ``seconds`` is the time that was spent before this process went on with it.
    """

    blocks: list[list[Block]] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)
    step: int = 0
    seconds: float = 0.0

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
        self, move_on: MoveOn, states: list[EnsembleState], streams: Streams, settings: SamplerSettings
    ) -> list[EnsembleState]:
        """Move every ensemble on by one block and return where they stand."""
        size = min(settings.check_every, settings.max_steps - self.step)
        number = self.step // settings.check_every
        seeds = [streams.block(ensemble, number) for ensemble in range(len(states))]
        self.blocks.append(move_on(states, size, seeds))
        self.step += size
        return self.states()

    def states(self) -> list[EnsembleState]:
        """Where the ensembles stand after the last block."""
        return [block.end for block in self.blocks[-1]]

    def check_if_due(self, settings: SamplerSettings, quantities: Quantities | None) -> None:
        """Look at all steps so far, where the time has come."""
        last = self.checks[-1].step if self.checks else 0
        if self.step == last or self.step != next_check(last, settings):
            return
        theta = self.theta()
        self.checks.append(diagnose(theta, self.checks[-1] if self.checks else None))
        self.checks[-1] = with_end_error(settings, self.checks, theta, quantities)

    def theta(self) -> NDArray[np.float64]:
        """All positions, shape (ensembles, steps, walkers, d)."""
        return np.stack([np.concatenate([block.theta for block in one]) for one in self.by_ensemble()])

    def by_ensemble(self) -> list[tuple[Block, ...]]:
        """Blocks with one row per ensemble."""
        return list(zip(*self.blocks, strict=True))

    def move_acceptance(self) -> dict[str, float]:
        """Fraction of accepted proposals of each move that was made, over all ensembles."""
        accepted, proposed = Counter[str](), Counter[str]()
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
        return Chains(
            theta=self.theta(),
            log_density=np.stack([np.concatenate([b.log_density for b in one]) for one in self.by_ensemble()]),
            acceptance=accepted / (self.step * settings.walkers),
            move_acceptance=self.move_acceptance(),
            thin=thinning(self.checks[-1].tau),
            converged=verdict.converged,
            reason=verdict.reason,
            singular=sum(block.singular for block in chain.from_iterable(self.blocks)),
            evaluations=settings.ensembles * settings.walkers * (self.step + 1),
            seconds=seconds,
            history=tuple(self.checks),
        )
