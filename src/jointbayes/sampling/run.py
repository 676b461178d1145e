"""Run ensembles until they agree."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from jointbayes.sampling.chains import Chains, Progress
from jointbayes.sampling.coordinates import Coordinates
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.ensemble import Block, EnsembleState, initial_states, mixture
from jointbayes.sampling.proposal.fit import Proposal
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
from jointbayes.sampling.workers import MoveOn, mover

__all__ = ["Slow", "run_ensembles", "run_stage"]


@dataclass(frozen=True, slots=True)
class Slow:
    """Between which steps, and above which τ, a run is ended because it mixes slowly."""

    first: int
    last: int
    tau: float


def run_ensembles(
    log_density: LogDensity,
    start: NDArray[np.float64],
    rng: np.random.Generator,
    settings: SamplerSettings,
    progress: Callable[[Progress], None] | None = None,
    *,
    coordinates: Coordinates | None = None,
    proposal: Proposal | None = None,
    quantities: Quantities | None = None,
) -> Chains:
    """Run the ensembles side by side until the stop rule is met or the step limit is reached.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density, (n, d) array to (n,) array; −inf where the density is zero.
    start : ndarray, shape (ensembles, walkers, d)
        Where the walkers start: at finite log-density, spanning the space in each ensemble.
    rng : numpy.random.Generator
        Source of all randomness: one child is spawned from it, and from that a seed for each ensemble and block.
    settings : SamplerSettings
        Size, length, stop rule and number of processes. The draws do not depend on the latter.
    progress : callable, optional
        Called with a :class:`Progress` after each block.
    coordinates : Coordinates, optional
        Coordinates in which the density is closer to a Gaussian: most moves are then made in these.
    proposal : Proposal, optional
        Approximation of the density in coordinates of its own, from :func:`fit_proposal`; the better it is, the
        more of the steps are proposed from it.
    quantities : Quantities, optional
        What the stop rule's bound on the errors of interval ends is applied to; by default each coordinate of θ.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the start is of another shape, not finite, in a subspace or somewhere of zero density, or if the
        log-density returns NaN, +inf or an array of another shape, or cannot be sent to the processes.

    References
    ----------
    J. Goodman, J. Weare, Ensemble samplers with affine invariance (2010), DOI 10.2140/camcos.2010.5.65.
    C. J. F. ter Braak, Differential evolution MCMC (2006), DOI 10.1007/s11222-006-8769-1.
    D. Foreman-Mackey et al., emcee: the MCMC hammer (2013), DOI 10.1086/670067.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> settings = SamplerSettings(walkers=8, max_steps=2000)
    >>> run_ensembles(lambda x: -0.5 * x[:, 0] ** 2, rng.normal(size=(4, 8, 1)), rng, settings).converged
    True
    """
    return run_stage(
        log_density,
        start,
        Streams.of(rng),
        settings,
        progress,
        coordinates=coordinates,
        proposal=proposal,
        quantities=quantities,
    )


def run_stage(
    log_density: LogDensity,
    start: NDArray[np.float64],
    streams: Streams,
    settings: SamplerSettings,
    progress: Callable[[Progress], None] | None,
    *,
    coordinates: Coordinates | None,
    proposal: Proposal | None,
    quantities: Quantities | None,
    slow: Slow | None = None,
) -> Chains:
    """Run the ensembles as :func:`run_ensembles` does, as one stage of several.

    Parameters
    ----------
    log_density, start, settings, progress, coordinates, proposal, quantities
        As for :func:`run_ensembles`.
    streams : Streams
        Seeds of this stage.
    slow : Slow, optional
        When the stage ends before its limit because it mixes slowly; by default never.
    """
    import jointbayes.sampling.moves  # noqa: F401  (emcee's import is no part of the sampling that is timed)

    began = time.perf_counter()
    states = initial_states(log_density, start, settings)
    run = _Run(blocks=[], checks=[], step=0)
    verdict = Verdict(converged=False, reason="")
    with mover(log_density, mixture(coordinates, proposal), min(settings.processes, settings.ensembles)) as move_on:
        while not verdict.converged and run.step < settings.max_steps and not (slow and run.is_slow(slow)):
            states = run.extend(move_on, states, streams, settings)
            if run.step == run.due(settings):
                run.check(settings, quantities)
                verdict = judge(settings, run.checks)
            if progress is not None:
                progress(run.report(settings, verdict, time.perf_counter() - began))
    return run.chains(settings, verdict, time.perf_counter() - began)


@dataclass(slots=True)
class _Run:
    """A run in progress: the blocks of all ensembles so far, and what the checks found.

    ``blocks`` has one row per block and one column per ensemble.
    """

    blocks: list[list[Block]]
    checks: list[Check]
    step: int

    def due(self, settings: SamplerSettings) -> int:
        """Step of the next check."""
        return next_check(self.checks[-1].step if self.checks else 0, settings)

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
        seeds = [streams.block(ensemble, len(self.blocks)) for ensemble in range(len(states))]
        self.blocks.append(move_on(states, size, seeds))
        self.step += size
        return [block.end for block in self.blocks[-1]]

    def check(self, settings: SamplerSettings, quantities: Quantities | None) -> None:
        """Look at all steps so far."""
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
        """Close the run, whose last block always ends in a check."""
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
