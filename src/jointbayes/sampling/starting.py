"""Where the walkers of a run start: about the modes that were found, and not where there is hardly a draw."""

from collections.abc import Sequence

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import SamplingError
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.proposal.fit import Proposal, Start
from jointbayes.sampling.proposal.weights import drawn_without_replacement, truncated
from jointbayes.sampling.settings import SamplerSettings

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
