"""Run ensembles until they agree, and let them learn from their first steps what to propose."""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from jointbayes.progress import Budget, Progress, ProgressCallback
from jointbayes.sampling.chains import Chains, Slow, Stage
from jointbayes.sampling.checkpoint import UnfinishedRun, finished_first, require_same_density
from jointbayes.sampling.coordinate_maps import Coordinates
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.distribution_fit import GOOD_MIXTURE, good_efficiency
from jointbayes.sampling.ensemble import SamplerSettings, Streams
from jointbayes.sampling.proposal import DRAWS_OF_A_FIT, Proposal, refit_proposal
from jointbayes.sampling.starting import initial_states, weighted_moves
from jointbayes.sampling.stopping import Quantities
from vibrecords.arrays import Array

#: Steps of each stage, and τ of a run that mixes slowly: after a stage it starts again from where it stands, with a
#: proposal fitted to its draws. Most runs converge within 300 steps. The last stage has all steps that are left.
_STAGES = (500, 1000, 2000, 4000)
_SLOW_TAU = 20.0
#: Before these, where the first proposal is not good: each reaches a little further out from what the last one found.
_EXPLORING = (200, 200, 200, 200)
_HALF = 0.3  # efficiency that stands for half independence moves, half local ones
_STATED = 0.5  # of a proposal's efficiency: if draws of the posterior find less, a part of it was missed
_FAR = 100.0  # ln of an importance weight that is as good as infinite


def run_ensembles(
    log_density: LogDensity,
    start: Array,
    rng: np.random.Generator | Streams,
    settings: SamplerSettings,
    progress: ProgressCallback | None = None,
    *,
    coordinates: Coordinates | None = None,
    proposal: Proposal | None = None,
    quantities: Quantities | None = None,
    slow: Slow | None = None,
    keeper: UnfinishedRun | None = None,
    budget: Budget | None = None,
) -> Chains:
    """Run the ensembles side by side until the stop rule is met, or a limit of steps or of processor time is reached.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density, (n, d) array to (n,) array; −inf where the density is zero.
    start : ndarray, shape (ensembles, walkers, d)
        Where the walkers start: at finite log-density, spanning the space in each ensemble.
    rng : numpy.random.Generator or Streams
        Source of all randomness: one child is spawned from it, and from that a seed for each ensemble and block; or
        the seeds themselves, of one stage of several.
    settings : SamplerSettings
        Size, length and stop rule.
    progress : callable, optional
        Called with a :class:`Progress` after each block.
    coordinates : Coordinates, optional
        Coordinates in which the density is closer to a Gaussian: most moves are then made in these.
    proposal : Proposal, optional
        Approximation of the density in coordinates of its own, from :func:`fit_proposal`; the better it is, the
        more of the steps are proposed from it.
    quantities : Quantities, optional
        What the stop rule's bound on the errors of interval ends is applied to; by default each coordinate of θ.
    slow : Slow, optional
        When the run ends before its limit because it mixes slowly; by default never.
    keeper : UnfinishedRun, optional
        Where the steps are kept while they are made, and from where the run goes on.
    budget : Budget, optional
        Of the run that this one is a stage of; by default that of the settings begins here.

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
    from jointbayes.sampling.moves import advance  # emcee's import is no part of the sampling that is timed

    streams = rng if isinstance(rng, Streams) else Streams.from_generator(rng)
    number = streams.stage
    kept = None if keeper is None else keeper.stage(number)
    if kept is None:
        stage, states, spent = Stage(), initial_states(log_density, start, settings, first=number == 0), 0.0
    else:
        stage, states, spent = kept
        require_same_density(log_density, states)
    verdict, whole_steps, began = stage.verdict(settings), stage.step, time.perf_counter() - spent
    budget = budget or settings.budget(start.shape[-1])
    advance_one = partial(advance, log_density, moves=weighted_moves(coordinates, proposal))

    def is_done() -> bool:
        if verdict.converged or stage.step >= settings.max_steps or (slow and stage.is_slow(slow)):
            return True
        return budget.is_spent and bool(stage.checks) and stage.checks[-1].step == stage.step

    def keep(*, now: bool) -> None:
        if keeper is not None:
            keeper.keep(number, stage, states, time.perf_counter() - began, now=now)

    try:
        while not is_done():
            with finished_first(wait=keeper is not None) as asked_to_stop:
                states = stage.extend(advance_one, states, streams, settings)
                whole_steps = stage.step
                stage.check_if_due(settings, quantities, proposal.modes if proposal else None)
                verdict = stage.verdict(settings)
                keep(now=bool(asked_to_stop) or is_done())
                stage.condense()
            if progress is not None:
                progress(stage.report(settings, verdict, time.perf_counter() - began))
    except KeyboardInterrupt:
        if stage.step == whole_steps:  # a second signal may have come before a block was counted
            keep(now=True)
        raise
    if not verdict.converged and stage.step < settings.max_steps and budget.is_spent:
        verdict = replace(verdict, reason=f"{verdict.reason}; {budget}")
    return stage.chains(settings, verdict, time.perf_counter() - began)


def run_adapted(
    log_density: LogDensity,
    start: Array,
    rng: np.random.Generator,
    settings: SamplerSettings,
    progress: ProgressCallback | None = None,
    *,
    systems: Sequence[Coordinates],
    proposal: Proposal,
    quantities: Quantities | None = None,
    keeper: UnfinishedRun | None = None,
) -> tuple[Chains, Proposal]:
    """Run ensembles as :func:`run_ensembles` does, and fit the proposal anew where they are slow to converge.

    A proposal that was fitted without knowing the posterior may miss a part of it. A walker there is hardly ever
    moved by the independence move, and τ is hundreds of steps. Where τ is above 20 after 500 steps a proposal is
    fitted to the draws, which do reach that part; after 1000 more again, and so on. Each time the steps made so far
    become burn-in: moves never change while steps are made that count, so that the posterior stays invariant.

    A long thin tail may be missed altogether, by the proposal, by its own draws, from which its efficiency is known,
    and by a short run of steps that are proposed from it: all look good, and the ends of intervals are wrong. So a
    proposal that would serve for most steps although its fit never became good first serves in four stages of 200
    steps, for half of them. The others are local moves, which reach a little beyond what it covers, and the proposal
    is fitted to these draws each time. And a run that has converged is looked at once more: where its draws find the
    proposal less than half as efficient as it is stated to be, there is another stage, with a proposal fitted to them.
    A run with a good proposal and of shorter τ is the same, bit for bit, as that of :func:`run_ensembles`.

    Parameters
    ----------
    log_density, start, rng, settings, progress, quantities
        As for :func:`run_ensembles`; `settings.max_steps` is the limit of all steps together.
    systems : sequence of Coordinates
        Coordinates to choose from for the new proposal.
    proposal : Proposal
        The first.
    keeper : UnfinishedRun, optional
        Where the steps are kept while they are made. With what it holds of an earlier process the run goes on as if
        never interrupted: earlier stages are read, and proposals fitted to them again.

    Returns
    -------
    chains, proposal
        Of the last stage; `chains.discarded` counts the steps before it.

    References
    ----------
    C. Andrieu, J. Thoms, A tutorial on adaptive MCMC (2008), section 4.1, DOI 10.1007/s11222-008-9110-y.
    """
    discarded, evaluations, seconds = 0, 0, 0.0
    streams, budget = Streams.from_generator(rng), settings.budget(start.shape[-1])
    explores = _HALF < proposal.efficiency < GOOD_MIXTURE * good_efficiency(proposal.dimension)
    for number, stage in enumerate((*(_EXPLORING if explores else ()), *_STAGES, None)):
        streams = streams.with_stage(number)
        left = settings.max_steps - discarded
        # what is left must be enough for a stage of its own
        last = left - max(2 * settings.check_every, (stage or 0) // 2)
        slow = Slow(stage, last, 0.0 if explores else _SLOW_TAU) if stage else None
        chains = run_ensembles(
            log_density,
            start,
            streams,
            replace(settings, max_steps=left),
            progress and _counted_on(progress, discarded, settings.max_steps, seconds),
            coordinates=proposal.likeliest.coordinates,
            proposal=replace(proposal, efficiency=_HALF) if explores else proposal,
            quantities=quantities,
            slow=slow,
            keeper=keeper,
            budget=budget,
        )
        evaluations, seconds = evaluations + chains.evaluations, seconds + chains.seconds
        again = chains.converged and stage is not None and chains.steps <= last and _misses_mass(proposal, chains)
        if chains.steps == left or (chains.converged and not again) or budget.is_spent:
            break
        discarded += chains.steps
        explores = explores and number + 1 < len(_EXPLORING)
        proposal = refit_proposal(log_density, systems, proposal, _draws(chains), streams.refit())
        start = chains.theta[:, -1]
    reason = chains.reason
    if discarded:
        reason += f"; {discarded} earlier steps served to fit the proposal and were discarded"
    return replace(chains, discarded=discarded, evaluations=evaluations, seconds=seconds, reason=reason), proposal


def _misses_mass(proposal: Proposal, chains: Chains) -> bool:
    """Whether draws of the run say that the proposal reaches less of the density than its own draws say.

    With w = p/q the efficiency is 1/∫ p²/q: one over the mean of w over draws from p, which lie where q has missed.
    """
    theta = chains.theta[:, chains.held_burn_in :].reshape(-1, chains.theta.shape[-1])
    log_weight = chains.log_density[:, chains.held_burn_in :].ravel() - proposal.log_density(theta)
    middle = np.median(log_weight)
    log_weight = np.clip(log_weight, middle - _FAR, middle + _FAR)
    n = np.log(log_weight.size)
    efficiency = np.exp(2 * n - np.logaddexp.reduce(log_weight) - np.logaddexp.reduce(-log_weight))
    return bool(efficiency < _STATED * proposal.efficiency)


def _draws(chains: Chains) -> Array:
    """Every draw after burn-in, shape (n, d), of at most some ten thousand."""
    kept = chains.theta[:, chains.held_burn_in :]
    every = max(1, kept[..., 0].size // (4 * DRAWS_OF_A_FIT))
    return kept[:, ::every].reshape(-1, kept.shape[-1])


def _counted_on(progress: ProgressCallback, steps: int, limit: int, seconds: float) -> ProgressCallback:
    """Progress of a stage told as that of the whole run."""

    def tell(now: Progress) -> None:
        expected = min((now.total or now.done) + steps, limit)
        elapsed = now.elapsed_seconds + seconds
        progress(replace(now, done=now.done + steps, total=expected, elapsed_seconds=elapsed))

    return tell
