"""The steps of a run: those made so far, what the checks found, and what the run leaves behind."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from jointbayes.progress import Progress
from jointbayes.sampling.ensemble import Advance, EnsembleState, MoveCount, SamplerSettings, StepBlock, Streams
from jointbayes.sampling.stopping import (
    Check,
    Quantities,
    StopDecision,
    add_end_error,
    diagnose,
    expected_steps,
    judge,
    next_check,
    thinning,
)
from vibrecords.arrays import Array, Indices


@dataclass(frozen=True, slots=True, eq=False)
class Draws:
    """Draws after burn-in, one chain per walker.

    Parameters
    ----------
    theta : ndarray, shape (ensembles * walkers, n_draw, d)
        Draws; the chains of one ensemble follow each other.
    log_density : ndarray, shape (ensembles * walkers, n_draw)
        Log-density of each draw.
    ensemble : ndarray of int, shape (ensembles * walkers,)
        Ensemble to which each chain belongs, counted from zero.
    """

    theta: Array
    log_density: Array
    ensemble: Indices

    def __post_init__(self) -> None:
        for array in (self.theta, self.log_density, self.ensemble):
            array.setflags(write=False)


@dataclass(frozen=True, slots=True, eq=False)
class Chains:
    """All steps of all ensembles with the figures of the last check; the arrays are made read-only.

    Parameters
    ----------
    theta : ndarray, shape (ensembles, held, walkers, d)
        Positions after each step, or after every so many of a long run; the start is not among them.
    log_density : ndarray, shape (ensembles, held, walkers)
        Log-density at ``theta``.
    acceptance : ndarray, shape (ensembles,)
        Mean fraction of accepted proposals of each ensemble, over all steps.
    move_acceptance : mapping of str to float
        Mean fraction of accepted proposals of each move that was made, by its name.
    thin : int
        Distance of thinned draws in steps, half the smallest τ.
    converged : bool
        Whether the stop rule was met.
    reason : str
        One sentence with the figures that met the rule, or that did not.
    evaluations : int
        Number of points at which the log-density was computed, starts included.
    singular : int
        Number of those at which the density had no finite value although its prior is above zero.
    seconds : float
        Wall time of the run.
    history : tuple of Check
        Every check of the stop rule; the last one was made at the last step.
    discarded : int
        Steps of earlier stages, which are not among these.
    every : int
        Distance of the positions in steps: 1 in a run of no more steps than are held.
    """

    theta: Array
    log_density: Array
    acceptance: Array
    move_acceptance: Mapping[str, float]
    thin: int
    converged: bool
    reason: str
    evaluations: int
    singular: int
    seconds: float
    history: tuple[Check, ...]
    discarded: int = 0
    every: int = 1

    def __post_init__(self) -> None:
        for array in (self.theta, self.log_density, self.acceptance):
            array.setflags(write=False)

    @property
    def steps(self) -> int:
        """Number of steps each ensemble made."""
        return self.history[-1].step

    @property
    def burn_in(self) -> int:
        """Number of first steps left out of τ, R̂ and the draws."""
        return self.history[-1].burn_in

    @property
    def held_burn_in(self) -> int:
        """Number of first positions left out."""
        return self.burn_in // self.every

    @property
    def tau(self) -> Array:
        """Integrated autocorrelation time in steps, shape (d,)."""
        return self.history[-1].tau

    @property
    def r_hat(self) -> Array:
        """Rank-normalised split R̂ over the ensembles, shape (d,)."""
        return self.history[-1].r_hat

    @property
    def ess(self) -> Array:
        """Effective sample size of all steps after burn-in, shape (d,)."""
        ensembles, held, walkers, _ = self.theta.shape
        return ensembles * (held - self.held_burn_in) * walkers / (self.tau / self.every)

    @property
    def worth(self) -> float:
        """Fewest independent draws that an end of a 95 % interval is worth; NaN where the ends were not looked at."""
        error, (ensembles, _, walkers, _) = self.history[-1].end_error, self.theta.shape
        return math.nan if error is None else ensembles * walkers * self.history[-1].kept / error.tau

    def draws(self, *, thinned: bool = True) -> Draws:
        """Return the draws after burn-in.

        Parameters
        ----------
        thinned : bool
            Keep every ``thin``-th step only (the default), or all of them.

        Returns
        -------
        Draws
            Copies in chain order, walkers of one ensemble together.
        """
        ensembles, _, walkers, dimension = self.theta.shape
        kept = slice(self.held_burn_in, None, max(1, self.thin // self.every) if thinned else 1)
        theta = np.swapaxes(self.theta[:, kept], 1, 2)
        log_density = np.swapaxes(self.log_density[:, kept], 1, 2)
        return Draws(
            theta=theta.reshape(ensembles * walkers, -1, dimension).copy(),
            log_density=log_density.reshape(ensembles * walkers, -1).copy(),
            ensemble=np.repeat(np.arange(ensembles), walkers),
        )


#: Steps of each ensemble that are held at most. Longer runs hold every second, fourth and so on of them; τ and R̂ are
#: then those of these, τ in steps all the same, and never smaller than their distance.
MOST_HELD = 25_000


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
class Stage:
    """A stage of a run in progress: the steps of all ensembles so far, and what the checks found.

    ``theta`` and ``log_density`` hold every so many steps, the first of them step number ``every``, one array after the
    other, shapes (ensembles, held, walkers, d) and (ensembles, held, walkers). ``counts`` are of the proposals of each
    move, and ``accepted`` of all that an ensemble accepted.
    """

    theta: list[Array] = field(default_factory=list)
    log_density: list[Array] = field(default_factory=list)
    every: int = 1
    checks: list[Check] = field(default_factory=list)
    step: int = 0
    counts: dict[str, MoveCount] = field(default_factory=dict)
    accepted: list[int] = field(default_factory=list)
    singular: int = 0

    def extend(
        self, advance: Advance, states: list[EnsembleState], streams: Streams, settings: SamplerSettings
    ) -> list[EnsembleState]:
        """Move every ensemble on by one block and return where they stand."""
        size = min(settings.check_every, settings.max_steps - self.step)
        number = self.step // settings.check_every
        row = [advance(state, size, streams.block(ensemble, number)) for ensemble, state in enumerate(states)]
        self._hold(row)
        self.accepted = self.accepted or [0] * len(row)
        for ensemble, block in enumerate(row):
            self.singular += block.singular
            for name, count in block.moves.items():
                before = self.counts.get(name, MoveCount(0, 0))
                self.counts[name] = MoveCount(before.accepted + count.accepted, before.proposed + count.proposed)
                self.accepted[ensemble] += count.accepted
        return [block.end for block in row]

    def _hold(self, row: list[StepBlock]) -> None:
        """Add a block of steps of each ensemble, and drop every second step where the stage has become too long."""
        before, self.step = self.step, self.step + len(row[0].theta)
        every = spacing(self.step)
        kept = slice(-(before + 1) % every, None, every)
        blocks = [block.theta[kept] for block in row], [block.log_density[kept] for block in row]
        for held, block in zip((self.theta, self.log_density), blocks, strict=True):
            if every > self.every:
                # a copy, otherwise what is dropped would stay in memory
                held[:] = [np.concatenate(held, axis=1)[:, every // self.every - 1 :: every // self.every].copy()]
            held.append(np.stack(block))
        self.every = every

    def check_if_due(self, settings: SamplerSettings, quantities: Quantities | None) -> StopDecision:
        """Look at all steps so far, where the time has come, and return what the stop rule says of them."""
        last = self.checks[-1].step if self.checks else 0
        if self.step != next_check(last, settings):
            return StopDecision(converged=False, reason="")
        theta = np.concatenate(self.theta, axis=1)
        self.checks.append(diagnose(theta, self.checks[-1] if self.checks else None, self.every, self.step))
        self.checks[-1] = add_end_error(settings, self.checks, theta, quantities, self.every)
        return judge(settings, self.checks)

    def report(self, settings: SamplerSettings, decision: StopDecision, seconds: float) -> Progress:
        """Where the run stands, for the caller."""
        last = self.checks[-1]
        return Progress(
            "sampling",
            f"τ = {last.tau_max:.0f}, R̂ = {last.r_hat_max:.3f}",
            done=self.step,
            total=self.step if decision.converged else expected_steps(settings, last),
            unit="steps",
            elapsed_seconds=seconds,
            figures={"tau": last.tau_max, "r_hat": last.r_hat_max},
        )

    def chains(self, settings: SamplerSettings, decision: StopDecision, seconds: float) -> Chains:
        """Close the stage, whose last block always ends in a check."""
        return Chains(
            theta=np.concatenate(self.theta, axis=1),
            log_density=np.concatenate(self.log_density, axis=1),
            acceptance=np.array(self.accepted) / (self.step * settings.walkers),
            move_acceptance={name: n.accepted / n.proposed for name, n in self.counts.items() if n.proposed},
            thin=thinning(self.checks[-1].tau),
            converged=decision.converged,
            reason=decision.reason,
            singular=self.singular,
            evaluations=settings.ensembles * settings.walkers * (self.step + 1),
            seconds=seconds,
            history=tuple(self.checks),
            every=self.every,
        )
