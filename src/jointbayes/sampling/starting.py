"""How a run starts: the moves that its proposal asks for, and the places of its walkers."""

from collections.abc import Sequence

import numpy as np

from jointbayes.errors import SamplingError
from jointbayes.sampling.coordinate_maps import Coordinates, Identity
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.distributions import drawn_without_replacement, truncated
from jointbayes.sampling.ensemble import EnsembleState, SamplerSettings, WeightedMove
from jointbayes.sampling.proposal import Proposal, Start
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

    Where a posterior is thin and curved its Laplace approximation lies beside it for the most part, and a walker that
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

    With an importance efficiency e its τ is about 2/e − 1, that of differential evolution in three dimensions about 10.
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
    sixth to a half of that of stretch moves alone). The full step (gamma0 = 1) carries walkers from one mode to
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
    # emcee takes a while to import, and nobody who reads the settings needs it
    from jointbayes.sampling.moves import AutoregressiveMove, DEMove, HalvesStretchMove, IndependenceMove, JumpMove

    flat = Identity()
    local = [
        WeightedMove("differential evolution", DEMove(flat), 0.8),
        WeightedMove("differential evolution, full step", DEMove(flat, gamma0=1.0), 0.1),
        WeightedMove("stretch", HalvesStretchMove(), 0.1),
    ]
    if coordinates is not None:
        adapted = [
            WeightedMove("differential evolution, adapted coordinates", DEMove(coordinates), 0.9),
            WeightedMove(
                "differential evolution, full step, adapted coordinates", DEMove(coordinates, gamma0=1.0), 0.1
            ),
        ]
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
            _require_spanning(theta, index)
        values = Checked(log_density)(theta)
        outside = np.flatnonzero(np.isneginf(values))
        if outside.size:
            raise SamplingError(
                f"sampler start: the density is zero at walkers {outside.tolist()} of ensemble {index}, the "
                f"first at θ = {theta[outside[0]].tolist()}; expected every walker inside the prior's support"
            )
        states.append(EnsembleState(theta, values))
    return states


def _require_spanning(theta: Array, index: int) -> None:
    bad = np.flatnonzero(~np.isfinite(theta).all(axis=1))
    if bad.size:
        raise SamplingError(
            f"sampler start: the position of walkers {bad.tolist()} of ensemble {index} is not finite, "
            "expected finite numbers"
        )
    offset = theta - theta.mean(axis=0)
    size, dimension = np.abs(offset).max(axis=0), theta.shape[1]
    rounding = np.spacing(np.abs(theta).max(axis=0)) * np.sqrt(theta.size)
    # A posterior may be a sheet a millionth of a millionth thick, as where k12² comes up to k11 k22: what walkers found
    # there spans all the same. Only rounding tells nothing.
    if (size <= rounding).any() or np.linalg.svd(offset / size, compute_uv=False)[-1] <= (rounding / size).max():
        raise SamplingError(
            f"sampler start: the walkers of ensemble {index} do not span the {dimension} parameters, "
            "expected them scattered in every direction: the moves never leave the subspace they start in"
        )
