"""Has an ensemble run long enough, and what draws are worth: τ, R̂, effective sizes, the tail of importance weights.

Effective sizes and Pareto k are ArviZ's, which takes half a second to load.
"""

import numpy as np

from jointbayes.errors import SamplingError
from vibrecords.arrays import Array

# Sokal's window: the sum over lags stops at this many τ, where its noise outweighs what it still misses.
_WINDOW = 5.0

# Probabilities of a normal variable below −1 and +1 standard deviations.
_ONE_SD = (0.15865525393145707, 0.8413447460685429)


def autocorrelation_time(theta: Array) -> Array:
    """Integrated autocorrelation time of each parameter, pooled over walkers and ensembles.

    The autocovariances of all walkers of all ensembles are averaged lag by lag, each taken about the one
    mean of all draws, and normalised by the pooled variance; τ = 1 + 2 Σ ρ(t) is summed up to the first lag
    that exceeds 5 τ (Sokal's window, as in `emcee.autocorr`). Two things differ from emcee on purpose.
    With the common mean, walkers that never leave their place keep ρ(t) near 1, so that τ is of the order of
    the number of steps; about its own mean a stuck walker would be 0/0, and a slow one would look fast.
    And where no lag reaches 5 τ the whole sum is taken, where emcee's window falls back to τ = 1.

    Parameters
    ----------
    theta : ndarray, shape (ensembles, steps, walkers, d)
        Draws, every step.

    Returns
    -------
    ndarray, shape (d,)
        τ in steps; infinite for a parameter whose draws are all equal.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the array does not have four axes or fewer than two steps.

    References
    ----------
    A. D. Sokal, Monte Carlo methods in statistical mechanics, DOI 10.1007/978-1-4899-0319-8_6.
    J. Goodman, J. Weare, Ensemble samplers with affine invariance (2010), DOI 10.2140/camcos.2010.5.65.
    D. Foreman-Mackey et al., emcee: the MCMC hammer (2013), DOI 10.1086/670067.

    Examples
    --------
    >>> white = np.random.default_rng(1).normal(size=(4, 500, 24, 1))
    >>> bool(abs(autocorrelation_time(white)[0] - 1.0) < 0.1)
    True
    """
    _require_draws(theta)
    return np.array([_tau(theta[..., k]) for k in range(theta.shape[-1])])


def split_r_hat(theta: Array) -> Array:
    """Rank-normalised split R̂ of each parameter over the ensembles.

    The walkers of one ensemble are proposed from each other and are therefore not independent chains; only
    the ensembles are. So the draws are pooled as follows:

    1. each ensemble is cut in time into a first and a last half of ``n = steps // 2`` steps (an odd middle
       step is left out), which gives ``m = 2 · ensembles`` chains;
    2. all walkers of a half are pooled into that one chain of ``n · walkers`` draws;
    3. all draws of all chains are replaced by normal scores of their ranks (ties share their mean rank);
    4. R̂ = sqrt(((N − 1)/N · W + B/N) / W) with N = n · walkers, W the mean of the variances within the m
       chains and B/N the variance of their m means;
    5. steps 3 and 4 are repeated with the distances from the common median, which shows chains that agree
       in location but not in spread, and the larger R̂ of the two is returned.

    Parameters
    ----------
    theta : ndarray, shape (ensembles, steps, walkers, d)
        Draws, thinned or not: only their distribution matters here, not their order within a half.

    Returns
    -------
    ndarray, shape (d,)
        R̂, near 1 where the ensembles agree; infinite if no draw varies within a chain.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the array does not have four axes or fewer than two steps.

    References
    ----------
    A. Vehtari et al., Rank-normalization, folding, and localization: an improved R̂ (2021),
    DOI 10.1214/20-BA1221, Eqs. (1)-(4), (14), and the folded R̂ of its section 4.

    Examples
    --------
    >>> same = np.random.default_rng(1).normal(size=(4, 500, 24, 1))
    >>> bool(split_r_hat(same)[0] < 1.01)
    True
    """
    _require_draws(theta)
    ensembles, steps, walkers, dimension = theta.shape
    half = steps // 2
    halves = np.concatenate([theta[:, :half], theta[:, steps - half :]])
    chains = halves.reshape(2 * ensembles, half * walkers, dimension)
    worst = np.empty(dimension)
    for k in range(dimension):
        draws = chains[..., k]
        folded = np.abs(draws - np.median(draws))
        worst[k] = max(_r_hat(normal_scores(draws)), _r_hat(normal_scores(folded)))
    return worst


def quantile_error(draws: Array, probability: float) -> float:
    """Monte Carlo standard error of a quantile of one quantity's draws.

    The effective sample size of the indicator "draw ≤ quantile" comes from its own τ, pooled over walkers and
    ensembles: the tails of a skewed density mix more slowly than its middle. With it, see :func:`quantile_spread`.

    Parameters
    ----------
    draws : ndarray, shape (ensembles, steps, walkers)
        Draws of one quantity, on the scale on which the error is wanted, every step or evenly thinned.
    probability : float
        Probability below the quantile, above 0 and below 1.

    Returns
    -------
    float
        Standard error in the unit of the draws; infinite if no effective number can be told from them.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the array has other axes or fewer than two steps.

    References
    ----------
    A. Vehtari et al., Rank-normalization, folding, and localization: an improved R̂ (2021),
    DOI 10.1214/20-BA1221, section 4.3 (effective sample size of quantiles and their Monte Carlo error).

    Examples
    --------
    >>> white = np.random.default_rng(1).normal(size=(4, 500, 24))
    >>> bool(abs(quantile_error(white, 0.5) / (1.2533 / np.sqrt(white.size)) - 1) < 0.2)
    True
    """
    tau = quantile_tau(draws, probability)
    return quantile_spread(draws, probability, draws.size / tau) if np.isfinite(tau) else float("inf")


def quantile_tau(draws: Array, probability: float) -> float:
    """Autocorrelation time of "draw ≤ quantile", in steps of the draws; infinite if all are equal.

    Parameters and errors are those of :func:`quantile_error`.
    """
    _require_draws(draws[..., None])
    return _tau((draws <= np.quantile(draws, probability)).astype(np.float64))


def quantile_spread(draws: Array, probability: float, effective: float) -> float:
    """Standard error of a quantile of draws that are worth so many independent ones.

    The probability below the quantile is as uncertain as a Beta(S p + 1, S (1 − p) + 1) variable, with S the effective
    sample size, and half the distance of the draws that stand at its 16 % and 84 % quantiles is the error. No density
    has to be estimated, and the error follows any monotone change of the quantity's scale.

    Parameters
    ----------
    draws : ndarray
        Draws of one quantity, any shape.
    probability : float
        Probability below the quantile, above 0 and below 1.
    effective : float
        Effective sample size, above 0.

    References
    ----------
    A. Vehtari et al., Rank-normalization, folding, and localization: an improved R̂ (2021),
    DOI 10.1214/20-BA1221, section 4.3.
    """
    from scipy.special import betaincinv

    ends = betaincinv(effective * probability + 1, effective * (1 - probability) + 1, _ONE_SD)
    ranks = np.clip([np.floor(ends[0] * draws.size), np.ceil(ends[1] * draws.size)], 0, draws.size - 1).astype(int)
    down, up = np.partition(draws, ranks, axis=None)[ranks]
    return float(up - down) / 2


def _require_draws(theta: Array) -> None:
    if theta.ndim != 4 or theta.shape[1] < 2:
        raise SamplingError(
            f"convergence diagnostics: found draws of shape {theta.shape}, expected "
            "(ensembles, steps, walkers, parameters) with at least two steps"
        )


def _tau(draws: Array) -> float:
    """Return τ of one parameter from draws of shape (ensembles, steps, walkers)."""
    from scipy import fft

    steps = draws.shape[1]
    length = fft.next_fast_len(2 * steps, real=True)  # padded, so that the correlation does not wrap round
    centred = draws - draws.mean()
    # The spectra are pooled before the way back: one inverse transform per parameter, not per walker.
    power = np.zeros(length // 2 + 1)
    for ensemble in centred:
        power += np.sum(np.abs(fft.rfft(ensemble.T, n=length)) ** 2, axis=0)
    covariance = fft.irfft(power, n=length)[:steps]
    if not covariance[0] > 0.0:
        return float("inf")
    running = 2.0 * np.cumsum(covariance / covariance[0]) - 1.0
    wide_enough = np.arange(steps) >= _WINDOW * running
    return float(running[np.argmax(wide_enough)] if wide_enough.any() else running[-1])


def normal_scores(draws: Array) -> Array:
    """Return draws with each value replaced by the normal quantile of its rank among all, of the same shape."""
    from scipy.special import ndtri

    _, place, count = np.unique(draws, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(count) - (count - 1) / 2)[place].reshape(draws.shape)  # equal values share their mean rank
    return np.asarray(ndtri((ranks - 0.375) / (draws.size + 0.25)))  # Vehtari et al. Eq. (14)


def _r_hat(chains: Array) -> float:
    """Return R̂ of chains of shape (m, N), Vehtari et al. Eqs. (1)-(4)."""
    length = chains.shape[1]
    within = float(np.mean(np.var(chains, axis=1, ddof=1)))
    if within == 0.0:
        return float("inf")
    between = float(np.var(np.mean(chains, axis=1), ddof=1))
    return float(np.sqrt((length - 1) / length + between / within))


#: Probabilities whose quantiles are the tail.
_TAIL = (0.05, 0.95)


def effective_sizes(chains: Array) -> tuple[float, float]:
    """Effective sample sizes (bulk, tail) of one parameter's draws, shape (chains, draws).

    NaN where a chain has fewer than four draws, or a draw is not finite.

    References
    ----------
    Vehtari, A. et al. (2021). Bayesian Analysis 16(2), 667-718. DOI 10.1214/20-BA1221
    """
    half = chains.shape[1] // 2
    if chains.shape[1] < 4 or not np.isfinite(chains).all():
        return float("nan"), float("nan")
    halves = np.concatenate([chains[:, :half], chains[:, -half:]])
    tail = [_effective_size((halves <= quantile).astype(float)) for quantile in np.quantile(chains, _TAIL)]
    return _effective_size(normal_scores(halves)), min(tail)


def _effective_size(chains: Array) -> float:
    """Effective size of draws, shape (chains, draws), by Geyer's initial monotone sequence; Vehtari et al. Eq. (10)."""
    m, n = chains.shape
    if np.ptp(chains) == 0:
        return float(m * n)
    length = 2 ** int(np.ceil(np.log2(2 * n)))  # padded, so that the correlation does not wrap round
    spectrum = np.fft.rfft(chains - chains.mean(axis=1, keepdims=True), n=length, axis=1)
    covariance = np.fft.irfft((np.abs(spectrum) ** 2).mean(axis=0), n=length)[:n] / n
    within = covariance[0] * n / (n - 1)
    total = covariance[0] + (chains.mean(axis=1).var(ddof=1) if m > 1 else 0.0)
    rho = 1 - (within - covariance) / total
    rho[0] = 1.0
    pairs = rho[: 2 * ((n - 1) // 2)].reshape(-1, 2).sum(axis=1)
    kept = int(np.argmax(pairs < 0)) if (pairs < 0).any() else len(pairs) - 1
    tau = -1 + 2 * float(np.minimum.accumulate(pairs[:kept]).sum()) + max(float(rho[2 * kept]), 0.0)
    return float(m * n / max(tau, 1 / np.log10(m * n)))
