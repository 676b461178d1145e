"""What draws are worth: effective sizes of chains, and the tail of importance weights.

The numbers are ArviZ's, which takes half a second to load.
"""

import numpy as np

from jointbayes.arrays import Array
from jointbayes.sampling.diagnostics import normal_scores

#: Probabilities whose quantiles are the tail.
_TAIL = (0.05, 0.95)
_FEWEST = 100  # weights, whose largest fifth is fitted


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


def pareto_k(log_weight: Array) -> float:
    """Shape of the generalised Pareto distribution fitted to the largest importance weights.

    Above 0.7 the mean of the weights cannot be trusted, however many there are.

    Parameters
    ----------
    log_weight : ndarray, shape (n,)
        ln of the weights above zero, up to a constant.

    Returns
    -------
    float
        −inf if all weights are equal; inf if there are too few of them.

    References
    ----------
    Vehtari, A. et al. (2024). Pareto smoothed importance sampling. Journal of Machine Learning Research 25(72), 1-58.
    Zhang, J., Stephens, M. A. (2009). Technometrics 51(3), 316-325. DOI 10.1198/tech.2009.08017
    """
    n = log_weight.size
    if n < _FEWEST:
        return float("inf")
    if np.ptp(log_weight) < 1e-9:
        return float("-inf")
    weight = np.exp(np.sort(log_weight) - log_weight.max())
    cutoff = max(weight[-int(np.ceil(min(0.2 * n, 3 * np.sqrt(n)))) - 1], np.finfo(float).tiny)
    excess = weight[weight > cutoff] - cutoff
    if excess.size <= 4:
        return float("inf")
    return _pareto_shape(excess)


def _pareto_shape(excess: Array) -> float:
    """Shape of a generalised Pareto distribution by Zhang and Stephens' posterior mean, of sorted excesses (n,)."""
    n = excess.size
    trials = 30 + int(n**0.5)
    b = (1 - np.sqrt(trials / (np.arange(1, trials + 1) - 0.5))) / (3 * excess[int(n / 4 + 0.5) - 1]) + 1 / excess[-1]
    k = np.log1p(-b[:, None] * excess).mean(axis=1)
    height = n * (np.log(-b / k) - k - 1)
    share = np.exp(height - height.max())
    shape = float(np.log1p(-(b @ share / share.sum()) * excess).mean())
    return (n * shape + 5) / (n + 10)  # drawn a little towards 0.5, as the weights' paper does
