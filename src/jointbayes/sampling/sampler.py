"""Place walkers and run their ensembles until they agree; they learn from their first steps what to propose."""

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
from jointbayes.sampling.distributions import GOOD_MIXTURE, drawn_without_replacement, good_efficiency, truncated
from jointbayes.sampling.ensemble import EnsembleState, SamplerSettings, Streams, WeightedMove
from jointbayes.sampling.proposal import DRAWS_OF_A_FIT, Proposal, Start, refit_proposal
from jointbayes.sampling.stopping import Check, Quantities, StopDecision
from vibrecords.arrays import Array

ADAPTED_SHARE = 0.8  # of the local moves; the plain rest explores where the coordinates do not help
LARGEST_SHARE = 0.9  # of the independence move; the rest frees a walker that it cannot reach
GOOD_EFFICIENCY = 0.5  # from here on the independence move has its largest share
USELESS = 0.1  # up to here it has none
MANY_DIMENSIONS = 16  # from here on even a good fit is hardly ever accepted as a whole, but part of the way to it is
PARTIAL_SHARE = 0.8  # of the local moves there
KEPT = (0.6, 0.9)  # shares of the way that are kept
JUMP_SHARE = 0.1  # of all moves, where there are several modes
_DRAWS = 4000  # of the proposal, among which replacements are looked for


def starting_walkers(
    starts: Sequence[Start],
    log_prior: LogDensity,
    settings: SamplerSettings,
    rng: np.random.Generator,
    shares: Array | None = None,
) -> Array:
    """Starting points from the Laplace approximation, shape (ensembles, walkers, d), all inside the prior's support.

    From several modes each ensemble has walkers about every one of them, as far as they go round.
    Near a corner of the support, where hardly a draw lies inside, the approximation is narrowed until enough do.

    Parameters
    ----------
    starts
        Place and covariance of every mode, the highest first.
    log_prior
        Log density of the prior: −inf outside its support.
    settings
        How many walkers and ensembles.
    rng
        The run's generator.
    shares
        Of the walkers, for each mode; by default alike.

    Raises
    ------
    SamplingError
        If too few draws about a mode lie inside the support.
    """
    balls = []
    counts = _counts(np.ones(len(starts)) / len(starts) if shares is None else shares, settings.walkers)
    for (theta, covariance), walkers in zip(starts, counts, strict=True):
        wanted = settings.ensembles * walkers
        inside: list[Array] = []
        for trial in range(200):
            narrower = covariance * 0.5 ** max(0, trial - 19)
            ball = rng.multivariate_normal(theta, narrower, size=wanted)
            inside.extend(ball[np.isfinite(log_prior(ball))])
            if len(inside) >= wanted:
                break
        else:
            raise SamplingError(
                f"start: found only {len(inside)} of {wanted} starting points where the prior is above zero; "
                "expected a mode inside the prior's support; widen the priors"
            )
        balls.append(np.array(inside[:wanted]).reshape(settings.ensembles, walkers, -1))
    return np.concatenate(balls, axis=1)


def _counts(shares: Array, walkers: int) -> list[int]:
    """Walkers about each mode: one, as far as they go round, and the others where most are missing to its share."""
    counts = (np.arange(len(shares)) < walkers).astype(int)
    for _ in range(walkers - counts.sum()):
        counts[np.argmax(shares * walkers - counts)] += 1
    return [int(count) for count in counts]


def replace_far_walkers(
    start: Array, log_density: LogDensity, least: float, proposal: Proposal, rng: np.random.Generator
) -> Array:
    """Starting points of which those with a log density below `least` are replaced by draws from the proposal.

    Where a posterior is thin and curved its Laplace approximation misses most of it, and a walker that
    starts there may take thousands of steps to come in. The draws are chosen in proportion to their truncated
    importance weights, none twice.
    """
    flat = start.reshape(-1, start.shape[-1])
    outside = np.flatnonzero(log_density(flat) < least)
    if not outside.size:
        return start
    theta, log_weight = proposal.weighted_draws(log_density, rng, _DRAWS)
    order = drawn_without_replacement(truncated(log_weight, _DRAWS), outside.size, rng)
    replaced = flat.copy()
    replaced[outside[: order.size]] = theta[order]
    return replaced.reshape(start.shape)


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


def weighted_moves(
    coordinates: Coordinates | None = None, proposal: Proposal | None = None
) -> tuple[WeightedMove, ...]:
    """Weighted moves of an ensemble.

    With a proposal that is close to the posterior most steps are independence moves. The rest are local.

    Of these, steps along a difference of two walkers had the shortest τ on Gaussian, curved and skewed densities (a
    sixth to a half of τ of stretch moves alone). The full step (gamma0 = 1) carries walkers from one mode to
    another. A tenth of stretch moves varies the step length, which is fixed in the other two, for densities whose
    width changes from place to place, and costs little. With coordinates most of these moves are made in them, and
    the others remain for densities that are no closer to a Gaussian there. Where the proposal is one of several modes a
    tenth of what is left carries walkers from one to another.

    Parameters
    ----------
    coordinates : Coordinates, optional
        Coordinates in which the density is closer to a Gaussian.
    proposal : Proposal, optional
        Fitted approximation of the density, in coordinates of its own.

    Returns
    -------
    tuple of WeightedMove
        Their weights sum to 1.
    """
    # emcee takes a while to import, and reading the settings does not need it
    from jointbayes.sampling.moves import AutoregressiveMove, DEMove, HalvesStretchMove, IndependenceMove, JumpMove

    def steps(where: Coordinates, small: float, name: str = "") -> list[WeightedMove]:
        full = DEMove(where, gamma0=1.0)
        return [
            WeightedMove(f"differential evolution{name}", DEMove(where), small),
            WeightedMove(f"differential evolution, full step{name}", full, 0.1),
        ]

    local = [*steps(Identity(), 0.8), WeightedMove("stretch", HalvesStretchMove(), 0.1)]
    if coordinates is not None:
        adapted = steps(coordinates, 0.9, ", adapted coordinates")
        local = _share(adapted, ADAPTED_SHARE) + _share(local, 1 - ADAPTED_SHARE)
    if proposal is not None and proposal.dimension >= MANY_DIMENSIONS:
        fitted, where = proposal.whole, proposal.likeliest.coordinates
        partial = [
            WeightedMove(f"autoregressive, {kept:g} kept", AutoregressiveMove(where, fitted, kept), 0.5)
            for kept in KEPT
        ]
        local = _share(partial, PARTIAL_SHARE) + _share(local, 1 - PARTIAL_SHARE)
    if proposal is not None and proposal.modes is not None:
        local = [WeightedMove("between modes", JumpMove(proposal.modes), JUMP_SHARE), *_share(local, 1 - JUMP_SHARE)]
    share = 0.0 if proposal is None else independence_share(proposal.efficiency)
    if proposal is None or share == 0.0:
        return tuple(local)
    independence = WeightedMove("independence", IndependenceMove(proposal.coordinates, proposal.density), share)
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
_SLOW_TAU = 20.0
#: Before these, where the first proposal is not good: each reaches a little further out from what the last one found.
_EXPLORING = (200, 200, 200, 200)
_HALF = 0.3  # efficiency that stands for half independence moves, half local ones
_STATED = 0.5  # of a proposal's efficiency: if draws of the posterior find less, a part of it was missed
_FAR = 100.0  # ln of an importance weight that is as good as infinite


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
    coordinates: Coordinates | None = None,
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
    coordinates : Coordinates, optional
        Coordinates in which the density is closer to a Gaussian: most moves are then made in these.
    proposal : Proposal, optional
        Approximation of the density in coordinates of its own, from :func:`fit_proposal`; the better it is, the
        more of the steps are proposed from it.
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
    advance_one = partial(advance, log_density, moves=weighted_moves(coordinates, proposal))

    def is_done() -> bool:
        if decision.converged or stage.step >= settings.max_steps:
            return True
        if not stage.checks or stage.checks[-1].step != stage.step:
            return False
        return budget.is_spent or is_slow(stage.checks[-1])

    while not is_done():
        before, states = stage.step, stage.extend(advance_one, states, streams, settings)
        budget.spend((stage.step - before) * settings.ensembles * settings.walkers)
        decision = stage.check_if_due(settings, quantities, proposal.modes if proposal else None)
        if progress is not None:
            progress(stage.report(settings, decision, time.perf_counter() - began))
    if not decision.converged and stage.step < settings.max_steps and budget.is_spent:
        decision = replace(decision, reason=f"{decision.reason}; {budget}")
    return stage.chains(settings, decision, time.perf_counter() - began)


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
) -> tuple[Chains, Proposal]:
    """Run ensembles as :func:`run_ensembles` does, and fit the proposal again where they are slow to converge.

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
    A run with a good proposal and of shorter τ is the same, bit for bit, as one of :func:`run_ensembles`.

    Parameters
    ----------
    log_density, start, rng, settings, progress, quantities
        As for :func:`run_ensembles`; `settings.max_steps` is the limit of all steps together.
    systems : sequence of Coordinates
        Coordinates to choose from for the new proposal.
    proposal : Proposal
        The first.

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
        chains = run_ensembles(
            log_density,
            start,
            streams,
            replace(settings, max_steps=left),
            progress and _counted_on(progress, discarded, settings.max_steps, seconds),
            coordinates=proposal.likeliest.coordinates,
            proposal=replace(proposal, efficiency=_HALF) if explores else proposal,
            quantities=quantities,
            is_slow=_slow_between(stage, last, 0.0 if explores else _SLOW_TAU) if stage else _never_slow,
            budget=budget,
        )
        evaluations, seconds = evaluations + chains.evaluations, seconds + chains.seconds
        again = chains.converged and stage is not None and chains.steps <= last and _misses_mass(proposal, chains)
        if chains.steps == left or (chains.converged and not again) or budget.is_spent:
            break
        discarded += chains.steps
        explores = explores and number + 1 < len(_EXPLORING)
        kept = chains.theta[:, chains.held_burn_in :]
        draws = kept[:, :: max(1, kept[..., 0].size // (4 * DRAWS_OF_A_FIT))].reshape(-1, kept.shape[-1])
        proposal = refit_proposal(log_density, systems, proposal, draws, streams.refit())
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


def _counted_on(progress: ProgressCallback, steps: int, limit: int, seconds: float) -> ProgressCallback:
    """Progress of a stage, as progress of the whole run."""

    def tell(now: Progress) -> None:
        expected = min((now.total or now.done) + steps, limit)
        elapsed = now.elapsed_seconds + seconds
        progress(replace(now, done=now.done + steps, total=expected, elapsed_seconds=elapsed))

    return tell
