"""Place walkers and run their ensembles until they agree; they learn from their first steps what to propose."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from jointbayes.errors import SamplingError
from jointbayes.progress import Budget, Progress, ProgressCallback
from jointbayes.sampling.chains import Chains, Stage
from jointbayes.sampling.coordinate_maps import Coordinates, Identity
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.ensemble import EnsembleState, SamplerSettings, Streams, WeightedMove
from jointbayes.sampling.kernels import Kernels
from jointbayes.sampling.origins import RESEMBLES, Ground, Origins, adapted, kernels_at, seen_by_one, two_origins
from jointbayes.sampling.proposal import Proposal, fit_proposal
from jointbayes.sampling.stopping import ALONE, SEEN_BY_ONE, Check, Quantities, StopDecision
from vibrecords.arrays import Array

ADAPTED_SHARE = 0.8  # of the local moves; the plain rest explores where the coordinates do not help
LARGEST_SHARE = 0.9  # of the independence move; the rest frees a walker that it cannot reach
GOOD_EFFICIENCY = 0.5  # from here on the independence move has its largest share
USELESS = 0.1  # up to here it has none
MANY_DIMENSIONS = 16  # from here on even a good fit is hardly ever accepted as a whole, but part of the way to it is
PARTIAL_SHARE = 0.8  # of the local moves there
KEPT = (0.6, 0.9)  # shares of the way that are kept


def independence_share(efficiency: float) -> float:
    """Probability of the independence move at a step.

    With an importance efficiency e its τ is about 2/e − 1; differential evolution in three dimensions has about 10.
    On posteriors of measured natural frequencies it gave 2.6 times the effective draws per evaluation at e = 0.34, and
    a tenth fewer at e = 0.15, where walkers wait in places that the proposal does not reach.

    Examples
    --------
    >>> [round(independence_share(e), 3) for e in (0.9, 0.3, 0.0)]
    [0.9, 0.45, 0.0]
    """
    return LARGEST_SHARE * min(1.0, max(0.0, efficiency - USELESS) / (GOOD_EFFICIENCY - USELESS))


def weighted_moves(proposal: Proposal | None = None) -> tuple[WeightedMove, ...]:
    """Weighted moves of an ensemble.

    With a proposal that is close to the posterior most steps are independence moves. The rest are local.

    Of these, steps along a difference of two walkers had the shortest τ on Gaussian, curved and skewed densities (a
    sixth to a half of τ of stretch moves alone). The full step (gamma0 = 1) carries walkers from one mode to
    another. A tenth of stretch moves varies the step length, which is fixed in the other two, for densities whose
    width changes from place to place, and costs little. With coordinates most of these moves are made in them, and
    the others remain for densities that are no closer to a Gaussian there.

    Parameters
    ----------
    proposal : Proposal, optional
        Fitted approximation of the density, in coordinates in which it is closer to a Gaussian.

    Returns
    -------
    tuple of WeightedMove
        Their weights sum to 1.
    """
    # emcee takes a while to import, and reading the settings does not need it
    from jointbayes.sampling.moves import AutoregressiveMove, DEMove, HalvesStretchMove, IndependenceMove

    def steps(where: Coordinates, small: float, name: str = "") -> list[WeightedMove]:
        full = DEMove(where, gamma0=1.0)
        return [
            WeightedMove(f"differential evolution{name}", DEMove(where), small),
            WeightedMove(f"differential evolution, full step{name}", full, 0.1),
        ]

    local = [*steps(Identity(), 0.8), WeightedMove("stretch", HalvesStretchMove(), 0.1)]
    if proposal is None:
        return tuple(local)
    adapted = steps(proposal.coordinates, 0.9, ", adapted coordinates")
    local = _share(adapted, ADAPTED_SHARE) + _share(local, 1 - ADAPTED_SHARE)
    if proposal.whole.mean.size >= MANY_DIMENSIONS:
        partial = [
            WeightedMove(
                f"autoregressive, {kept:g} kept", AutoregressiveMove(proposal.coordinates, proposal.whole, kept), 0.5
            )
            for kept in KEPT
        ]
        local = _share(partial, PARTIAL_SHARE) + _share(local, 1 - PARTIAL_SHARE)
    # local moves hardly move a walker on what takes many kernels: a sheet that is thin
    on_sheet = isinstance(proposal.density, Kernels)
    share = LARGEST_SHARE if on_sheet else independence_share(proposal.efficiency)
    if share == 0.0:
        return tuple(local)
    independence = WeightedMove("independence", IndependenceMove(proposal), share)
    return (independence, *_share(local, 1 - share))


def _share(moves: list[WeightedMove], share: float) -> list[WeightedMove]:
    return [WeightedMove(m.name, m.move, share * m.weight) for m in moves]


def initial_states(
    log_density: LogDensity, start: Array, settings: SamplerSettings, *, first: bool = True
) -> list[EnsembleState]:
    """Check the start and compute the log-density there.

    A stage that is not the first one goes on from wherever the walkers are, as it would without an end between.
    """
    start = np.array(start, dtype=np.float64)
    if start.ndim != 3 or start.shape[:2] != (settings.ensembles, settings.walkers):
        raise SamplingError(
            f"sampler start: found an array of shape {start.shape}, expected "
            f"({settings.ensembles}, {settings.walkers}, parameters)"
        )
    settings.require_dimension(start.shape[2])
    states = []
    for index, theta in enumerate(start):
        if first:
            bad = np.flatnonzero(~np.isfinite(theta).all(axis=1))
            if bad.size:
                raise SamplingError(
                    f"sampler start: the position of walkers {bad.tolist()} of ensemble {index} is not finite, "
                    "expected finite numbers"
                )
            offset = theta - theta.mean(axis=0)
            size = np.abs(offset).max(axis=0)
            rounding = np.spacing(np.abs(theta).max(axis=0)) * np.sqrt(theta.size)
            # A posterior may be a sheet a millionth of a millionth thick, as where k12² comes up to k11 k22: walkers
            # that were found there span all the same. Only rounding tells nothing.
            if (size <= rounding).any() or np.linalg.svd(offset / size, compute_uv=False)[-1] <= (
                rounding / size
            ).max():
                raise SamplingError(
                    f"sampler start: the walkers of ensemble {index} do not span the {start.shape[2]} parameters, "
                    "expected them scattered in every direction: the moves never leave the subspace they start in"
                )
        values = Checked(log_density)(theta)
        outside = np.flatnonzero(np.isneginf(values))
        if outside.size:
            raise SamplingError(
                f"sampler start: the density is zero at walkers {outside.tolist()} of ensemble {index}, the "
                f"first at θ = {theta[outside[0]].tolist()}; expected every walker inside the prior's support"
            )
        states.append(EnsembleState(theta, values))
    return states


#: Steps of each stage, and τ of a run that mixes slowly: after a stage it starts again from where it stands, with a
#: proposal fitted to its draws. Most runs converge within 300 steps. The last stage has all steps that are left.
_STAGES = (500, 1000, 2000, 4000)
_SLOW_TAU = 50.0
#: A mixture of less efficiency is no better than kernels, which then have further rounds of draws.
_POOR, _FURTHER, _DRAWS = 0.1, 10, 4000
_ON_A_SHEET = 0.05  # efficiency of kernels that serve where walkers mix slowly with a mixture
_MOST_FURTHER = 300  # kernels that are added to a proposal at a time
_OF_ORIGINS = 0.1  # of the budget, after which the origins must do with what they have
_STATED = 0.25  # of a proposal's efficiency: if draws of the posterior find less, a part of it was missed
_LOOKED_AT = 5000
_UNCONFIRMED = "no climb from the prior came down on them, so that no second origin confirms that these are all"


def _never_slow(_: Check) -> bool:
    return False


def _slow_between(first: int, last: int, tau: float) -> Callable[[Check], bool]:
    """Whether a run mixes slowly: its τ exceeds a limit at a check between two steps."""
    return lambda check: first <= check.step <= last and check.tau_max > tau


def run_ensembles(
    log_density: LogDensity,
    start: Array,
    rng: np.random.Generator | Streams,
    settings: SamplerSettings,
    progress: ProgressCallback | None = None,
    *,
    proposal: Proposal | None = None,
    quantities: Quantities | None = None,
    is_slow: Callable[[Check], bool] = _never_slow,
    budget: Budget | None = None,
) -> Chains:
    """Run the ensembles side by side until the stop rule is met, or a limit of steps or of evaluations is reached.

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
    proposal : Proposal, optional
        Approximation of the density, from :func:`fit_proposal`; the better it is, the more of the steps are proposed
        from it. Most of the others are made in its coordinates.
    quantities : Quantities, optional
        What the stop rule's bound on the errors of interval ends is applied to; by default each coordinate of θ.
    is_slow : callable, optional
        Whether the run ends with a check, before its limit, because it mixes slowly; by default never.
    budget : Budget, optional
        Of the run that this one is a stage of; by default the budget of the settings begins here.

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
    stage, states = Stage(), initial_states(log_density, start, settings, first=streams.stage == 0)
    decision, began = StopDecision(converged=False, reason=""), time.perf_counter()
    budget = budget or settings.budget(start.shape[-1])
    advance_one = partial(advance, log_density, moves=weighted_moves(proposal))

    def is_done() -> bool:
        if decision.converged or stage.step >= settings.max_steps:
            return True
        if not stage.checks or stage.checks[-1].step != stage.step:
            return False
        return budget.is_spent or is_slow(stage.checks[-1])

    while not is_done():
        before, states = stage.step, stage.extend(advance_one, states, streams, settings)
        budget.spend((stage.step - before) * settings.ensembles * settings.walkers)
        decision = stage.check_if_due(settings, quantities)
        if progress is not None:
            progress(stage.report(settings, decision, time.perf_counter() - began))
    if not decision.converged and stage.step < settings.max_steps and budget.is_spent:
        decision = replace(decision, reason=f"{decision.reason}; {budget}")
    return stage.chains(settings, decision, time.perf_counter() - began)


# a draw from a heavy tail may be a stiffness that no number holds, where the density is zero
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def draw(
    ground: Ground,
    modes: Array,
    rng: np.random.Generator,
    settings: SamplerSettings,
    tell: Callable[[Progress], object] = lambda _: None,
    *,
    systems: Sequence[Coordinates],
    quantities: Quantities | None = None,
    budget: Budget | None = None,
) -> tuple[Chains, Proposal]:
    """Draw from a density: the one way in which this program does. Return the steps, and the last proposal.

    1. Two origins look for the density, and know nothing of each other: see `two_origins`.
    2. A proposal is fitted to what both have found.
    3. Half of the ensembles start from draws of each origin.
    4. Ensembles move until they meet the stop rule. Where they mix slowly, or have found a part that the proposal
       misses, after 500 steps, after 1000 more, and so on, the kernels propose, or where these are poor a mixture
       that is fitted to the draws. Each time the steps made so far become burn-in: moves never change while steps are
       made that count.
    5. What one origin only has found must be less than `ALONE`.

    Parameters
    ----------
    ground, modes, rng
        As for `two_origins`.
    settings
        Size, length and stop rule; `max_steps` is the limit of all steps together.
    tell
        Called with the progress after each block of steps.
    systems
        Coordinates to choose from for the proposal.
    quantities
        What the stop rule's bound on the errors of interval ends is applied to; by default each coordinate of θ.
    budget
        Evaluations of the density; by default those of the settings.

    References
    ----------
    C. Andrieu, J. Thoms, A tutorial on adaptive MCMC (2008), section 4.1, DOI 10.1007/s11222-008-9110-y.
    """
    streams, density, began = Streams.from_generator(rng), ground.log_density, time.perf_counter()
    budget, begun = budget or settings.budget(modes.shape[1]), ground.evaluations
    # 1. two origins
    needed, most = settings.ensembles * settings.walkers, budget.spent + _OF_ORIGINS * budget.most
    looking, charge = partial(Progress, "preparing the sampling"), budget.watch(lambda: ground.evaluations)

    def is_enough() -> bool:
        return charge() or budget.spent > most

    tell(looking())
    found = two_origins(ground, modes, rng, needed, tell=lambda text: tell(looking(text)), is_spent=is_enough)
    # 2. a proposal
    proposal = fit_proposal(density, systems, found.theta, streams.refit())
    if proposal.efficiency < min(_POOR, found.efficiency):
        proposal = _of_kernels(ground, found, rng)
    proposal = _reaching(ground, proposal, found.places, found.kernels, rng)
    charge()
    # 3. walkers
    shares = np.array_split(np.arange(needed), len(found.starts))
    start = np.concatenate([places[: len(share)] for places, share in zip(found.starts, shares, strict=True)])
    start = start.reshape(settings.ensembles, settings.walkers, -1)
    tell(Progress("sampling"))
    # 4. stages
    discarded, seconds = 0, 0.0
    for number, steps in enumerate((*_STAGES, None), 1):
        left, offset = settings.max_steps - discarded, discarded
        last = left - max(2 * settings.check_every, (steps or 0) // 2)  # what is left is enough for one more
        chains = run_ensembles(
            density,
            start,
            streams.with_stage(number),
            replace(settings, max_steps=left),
            lambda now: tell(_counted_on(now, offset, settings.max_steps, time.perf_counter() - began)),  # noqa: B023
            proposal=proposal,
            quantities=quantities,
            is_slow=_slow_between(steps, last, _SLOW_TAU) if steps else _never_slow,
            budget=budget,
        )
        seconds += chains.seconds
        kept = chains.theta[:, chains.held_burn_in :]
        draws, value = kept.reshape(-1, kept.shape[-1]), chains.log_density[:, chains.held_burn_in :].ravel()
        some = np.linspace(0, len(draws) - 1, _LOOKED_AT).astype(int)
        done = chains.converged and (
            steps is None
            or chains.steps > last
            or not proposal.efficiency_among(draws[some], value[some]) < _STATED * proposal.efficiency
        )
        if chains.steps == left or done or budget.is_spent:
            break
        discarded += chains.steps
        by_kernels = _of_kernels(ground, found, rng)
        if by_kernels.efficiency > _ON_A_SHEET:
            proposal = by_kernels
        else:
            again = fit_proposal(density, systems, draws, streams.with_stage(number).refit())
            best = max(proposal, again, key=lambda each: each.efficiency)
            proposal = _reaching(ground, best, np.concatenate([draws[some], found.places]), found.kernels, rng)
        start = chains.theta[:, -1]
    reason = chains.reason
    if discarded:
        reason += f"; {discarded} earlier steps served to fit the proposal and were discarded"
    # 5. what both origins say
    alone, converged = found.alone, chains.converged
    if not math.isnan(alone) and found.efficiency < RESEMBLES:
        alone = seen_by_one(draws[some], found.kernels, ground.sd)
    if math.isnan(alone):
        reason = f"{reason}; {_UNCONFIRMED}"
    elif alone > ALONE:
        reason, converged = f"{'not ' * converged}{reason}; {SEEN_BY_ONE.format(100 * alone)}", False
    chains = replace(chains, converged=converged, reason=reason, discarded=discarded, seconds=seconds)
    return replace(chains, evaluations=ground.evaluations - begun), proposal


def _of_kernels(ground: Ground, found: Origins, rng: np.random.Generator) -> Proposal:
    """The kernels of both origins, further adapted, as what is proposed."""
    kernels = found.kernels[0].joined(found.kernels[-1], 0.5)
    return Proposal(*adapted(ground, kernels, rng, most=_FURTHER, n=_DRAWS))


def _reaching(
    ground: Ground, proposal: Proposal, theta: Array, origins: Sequence[Kernels], rng: np.random.Generator
) -> Proposal:
    """The proposal with further kernels at some of points θ, shape (n, d), that it hardly reaches without any.

    A walker that comes there would wait for long, and nothing in its efficiency would tell.
    """
    if isinstance(proposal.density, Kernels):
        return proposal
    alone = replace(proposal, further=None)
    chosen = alone.missed(ground.log_density, np.unique(theta, axis=0), rng, _MOST_FURTHER)
    return replace(alone, further=kernels_at(ground, chosen, origins)) if len(chosen) else alone


def _counted_on(now: Progress, steps: int, limit: int, seconds: float) -> Progress:
    """Progress of a stage, as progress of the whole run."""
    expected = min((now.total or now.done) + steps, limit)
    return replace(now, done=now.done + steps, total=expected, elapsed_seconds=seconds)
