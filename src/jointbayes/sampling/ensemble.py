"""Ensembles of walkers under an affine-invariant sampler, run until they agree."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import SamplingError
from jointbayes.sampling.chains import Chains, Progress
from jointbayes.sampling.settings import SamplerSettings
from jointbayes.sampling.stopping import Check, Verdict, diagnose, expected_steps, judge, next_check, thinning

if TYPE_CHECKING:
    from jointbayes.sampling.chart import Chart

__all__ = ["Block", "EnsembleState", "LogDensity", "advance", "run_ensembles"]

CHARTED_SHARE = 0.8  # of the moves; the plain rest explores where the chart does not help

LogDensity = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Log of an unnormalised density: (n, d) points to (n,) values, −inf where the density is zero."""


@dataclass(frozen=True, slots=True, eq=False)
class EnsembleState:
    """One ensemble between two steps: all that its next steps depend on.

    Parameters
    ----------
    theta : ndarray, shape (walkers, d)
        Positions.
    log_density : ndarray, shape (walkers,)
        Log-density at the positions.
    random_state : tuple
        State of the Mersenne twister that emcee draws from, as `RandomState.get_state` gives it.
    """

    theta: NDArray[np.float64]
    log_density: NDArray[np.float64]
    random_state: tuple[Any, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """A few steps of one ensemble.

    Parameters
    ----------
    theta : ndarray, shape (steps, walkers, d)
        Positions after each step.
    log_density : ndarray, shape (steps, walkers)
        Log-density at the positions.
    accepted : int
        Number of accepted proposals.
    end : EnsembleState
        State after the last step.
    """

    theta: NDArray[np.float64]
    log_density: NDArray[np.float64]
    accepted: int
    end: EnsembleState


def run_ensembles(
    log_density: LogDensity,
    start: NDArray[np.float64],
    rng: np.random.Generator,
    settings: SamplerSettings,
    progress: Callable[[Progress], None] | None = None,
    *,
    chart: "Chart | None" = None,
) -> Chains:
    """Run the ensembles side by side until the stop rule is met or the step limit is reached.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density, (n, d) array to (n,) array; −inf where the density is zero.
    start : ndarray, shape (ensembles, walkers, d)
        Where the walkers start: at finite log-density, spanning the space in each ensemble.
    rng : numpy.random.Generator
        Source of all randomness; one child per ensemble is spawned from it.
    settings : SamplerSettings
        Size, length and stop rule.
    progress : callable, optional
        Called with a :class:`Progress` after each block.
    chart : Chart, optional
        Coordinates in which the density is closer to a Gaussian: most moves are then made in these.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the start is of another shape, not finite, in a subspace or somewhere of zero density, or if the
        log-density returns NaN, +inf or an array of another shape.

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
    began = time.perf_counter()
    states = _initial_states(log_density, start, rng, settings)
    run = _Run(blocks=[], checks=[], step=0)
    verdict = Verdict(converged=False, reason="")
    while not verdict.converged and run.step < settings.max_steps:
        states = run.extend(partial(advance, log_density, chart=chart), states, settings)
        if run.step == run.due(settings):
            run.check()
            verdict = judge(settings, run.checks)
        if progress is not None:
            progress(run.report(settings, verdict, time.perf_counter() - began))
    return run.chains(settings, verdict, time.perf_counter() - began)


def advance(log_density: LogDensity, state: EnsembleState, steps: int, chart: "Chart | None" = None) -> Block:
    """Move one ensemble on by some steps.

    A pure function of its arguments: the same state gives the same block in any process and in any order.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density, (n, d) array to (n,) array.
    state : EnsembleState
        Where the ensemble stands.
    steps : int
        Number of steps.
    chart : Chart, optional
        Coordinates for most of the moves.

    Returns
    -------
    Block
        The steps and the state after the last one.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the log-density returns NaN, +inf or an array of the wrong shape.
    """
    import emcee

    walkers, dimension = state.theta.shape
    sampler = emcee.EnsembleSampler(walkers, dimension, None, moves=_moves(chart), vectorize=True)
    # emcee's own wrapper prints whatever a log-density raises to the terminal; this room never prints.
    sampler.log_prob_fn = _Checked(log_density)
    # The generator's state must travel with the positions: emcee otherwise copies NumPy's global one.
    before = emcee.State(state.theta, log_prob=state.log_density, random_state=state.random_state)
    after = sampler.run_mcmc(before, steps, skip_initial_state_check=True)
    return Block(
        theta=sampler.get_chain(),
        log_density=sampler.get_log_prob(),
        accepted=int(np.sum(sampler.backend.accepted)),
        end=EnsembleState(after.coords, after.log_prob, after.random_state),
    )


def _moves(chart: "Chart | None") -> list[tuple[Any, float]]:
    """Weighted moves of an ensemble.

    Steps along a difference of two walkers had the shortest τ on Gaussian, curved and skewed densities (a sixth to
    a half of that of stretch moves alone). The whole difference (gamma0 = 1) carries walkers from one mode to
    another. A tenth of stretch moves varies the step length, which is fixed in the other two, for densities whose
    width changes from place to place, and costs little. With a chart most of these moves are made in it, and
    the others remain for densities that are no closer to a Gaussian there.
    """
    from emcee.moves import DEMove, StretchMove

    plain = [(DEMove(), 0.8), (DEMove(gamma0=1.0), 0.1), (StretchMove(), 0.1)]
    if chart is None:
        return plain
    from jointbayes.sampling.chart import ChartedDEMove

    charted = [(ChartedDEMove(chart), 0.9), (ChartedDEMove(chart, gamma0=1.0), 0.1)]
    share = CHARTED_SHARE
    return [(m, share * w) for m, w in charted] + [(m, (1 - share) * w) for m, w in plain]


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

    def extend(
        self,
        move_on: Callable[[EnsembleState, int], Block],
        states: list[EnsembleState],
        settings: SamplerSettings,
    ) -> list[EnsembleState]:
        """Move every ensemble on by one block and return where they stand."""
        size = min(settings.check_every, settings.max_steps - self.step)
        self.blocks.append([move_on(state, size) for state in states])
        self.step += size
        return [block.end for block in self.blocks[-1]]

    def check(self) -> None:
        """Look at all steps so far."""
        self.checks.append(diagnose(self.theta(), self.checks[-1] if self.checks else None))

    def theta(self) -> NDArray[np.float64]:
        """All positions, shape (ensembles, steps, walkers, d)."""
        return np.stack([np.concatenate([block.theta for block in one]) for one in self.by_ensemble()])

    def by_ensemble(self) -> list[tuple[Block, ...]]:
        """Blocks with one row per ensemble."""
        return list(zip(*self.blocks, strict=True))

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
        accepted = np.array([sum(block.accepted for block in one) for one in self.by_ensemble()])
        return Chains(
            theta=self.theta(),
            log_density=np.stack([np.concatenate([b.log_density for b in one]) for one in self.by_ensemble()]),
            acceptance=accepted / (self.step * settings.walkers),
            thin=thinning(self.checks[-1].tau),
            converged=verdict.converged,
            reason=verdict.reason,
            evaluations=settings.ensembles * settings.walkers * (self.step + 1),
            seconds=seconds,
            history=tuple(self.checks),
        )


@dataclass(frozen=True, slots=True)
class _Checked:
    """A log-density whose values are looked at before the sampler may use them."""

    log_density: LogDensity

    def __call__(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        values = np.asarray(self.log_density(theta), dtype=np.float64)
        if values.shape != theta.shape[:1]:
            raise SamplingError(
                f"log-density: found values of shape {values.shape} for {len(theta)} points, expected ({len(theta)},)"
            )
        wrong = np.isnan(values) | np.isposinf(values)
        if wrong.any():
            first = int(np.argmax(wrong))
            raise SamplingError(
                f"log-density: found {values[first]} at θ = {theta[first].tolist()}, "
                "expected a finite number, or −inf where the density is zero"
            )
        return values


def _initial_states(
    log_density: LogDensity, start: NDArray[np.float64], rng: np.random.Generator, settings: SamplerSettings
) -> list[EnsembleState]:
    """Check the start and give each ensemble its own stream of random numbers."""
    start = np.array(start, dtype=np.float64)
    if start.ndim != 3 or start.shape[:2] != (settings.ensembles, settings.walkers):
        raise SamplingError(
            f"sampler start: found an array of shape {start.shape}, expected "
            f"({settings.ensembles}, {settings.walkers}, parameters)"
        )
    settings.require_dimension(start.shape[2])
    states = []
    for index, (theta, child) in enumerate(zip(start, rng.spawn(settings.ensembles), strict=True)):
        _require_spanning(theta, index)
        values = _Checked(log_density)(theta)
        outside = np.flatnonzero(np.isneginf(values))
        if outside.size:
            raise SamplingError(
                f"sampler start: the density is zero at walkers {outside.tolist()} of ensemble {index}, the "
                f"first at θ = {theta[outside[0]].tolist()}; expected every walker inside the prior's support"
            )
        # emcee only knows the Mersenne twister; eight words of the child stream seed it.
        twister = np.random.MT19937(child.integers(2**32, size=8, dtype=np.uint32))
        states.append(EnsembleState(theta, values, tuple(np.random.RandomState(twister).get_state())))
    return states


def _require_spanning(theta: NDArray[np.float64], index: int) -> None:
    from emcee.ensemble import walkers_independent

    bad = np.flatnonzero(~np.isfinite(theta).all(axis=1))
    if bad.size:
        raise SamplingError(
            f"sampler start: the position of walkers {bad.tolist()} of ensemble {index} is not finite, "
            "expected finite numbers"
        )
    if not walkers_independent(theta):
        raise SamplingError(
            f"sampler start: the walkers of ensemble {index} do not span the {theta.shape[1]} parameters, "
            "expected them scattered in every direction: the moves never leave the subspace they start in"
        )
