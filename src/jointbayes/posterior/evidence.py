"""The evidence Z = ∫ p(data | θ) p(θ) dθ of a model from the draws of its posterior, or by nested sampling if asked.

The draws say where the posterior lies, not how large its integral is. A mixture q that is fitted to the draws
integrates to one, so that p/q at draws of both gives Z. The optimal bridge is used: its error stays finite where q
misses the tails.

References
----------
Meng, X.-L., Wong, W. H. (1996). Simulating ratios of normalizing constants via a simple identity: a theoretical
exploration. Statistica Sinica 6(4), 831-860. Optimal bridge: Eq. (4.1).
Frühwirth-Schnatter, S. (2004). Estimating marginal likelihoods for mixture and Markov switching models using bridge
sampling techniques. The Econometrics Journal 7(1), 143-167. DOI 10.1111/j.1368-423X.2004.00125.x (its error).
"""

import math
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointbayes.progress import Progress, ProgressCallback, tell_nobody
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import Coordinates, Draws, LogDensity, fit_proposal
from jointbayes.sampling.density import Checked
from jointbayes.sampling.diagnostics import effective_sizes
from vibrecords.arrays import Array

Method = Literal["exact", "Laplace", "bridge sampling", "nested sampling"]

#: Largest standard error of ln Z with which hypotheses are weighed: 2 ln B is then known to less than a grade.
LARGEST_ERROR = 0.5
#: ln Z below the best by Laplace's approximation at which a hypothesis is not drawn from.
OUT_OF_QUESTION = 100.0
_PROPOSED = 4000  # draws of each mixture
_ROUNDS, _SETTLED = 1000, 1e-9  # of the bridge's fixed point, and the change of ln Z at which it ends
_LARGEST_RATIO = 100.0  # of ln p/q above its median
_LIVE = 400
_STOP = 0.01  # ln Z that the live points may still add
_IMPOSSIBLE = -1e300  # dynesty knows no −inf
_EVERY_S = 1.0  # between two lines of progress


@dataclass(frozen=True, slots=True)
class Evidence:
    """ln Z and how far to trust it.

    Parameters
    ----------
    log_z : float
        ln of the evidence.
    error : float
        Monte Carlo standard error of ``log_z``; NaN of Laplace's approximation, which knows none.
    method : {"exact", "Laplace", "bridge sampling", "nested sampling"}
        How it was found; exact where there is no parameter.
    evaluations : int
        Number of evaluations of the density, those of the posterior draws not included.
    """

    log_z: float
    error: float
    method: Method
    evaluations: int

    @property
    def trusted(self) -> bool:
        """Whether the error is small enough to weigh hypotheses by."""
        return not self.error > LARGEST_ERROR


def constant_evidence(log_density: LogDensity) -> Evidence:
    """Evidence of a model without parameters: its likelihood."""
    return Evidence(float(log_density(np.zeros((1, 0)))[0]), 0.0, "exact", 1)


def laplace_evidence(mode: tuple[Array, Array], log_posterior: float) -> Evidence:
    """Laplace's approximation from a mode with its covariance and the log density there.

    References
    ----------
    Tierney, L., Kadane, J. B. (1986). Accurate approximations for posterior moments and marginal densities. Journal of
    the American Statistical Association 81(393), 82-86. DOI 10.1080/01621459.1986.10478240
    """
    log_volume = float(np.linalg.slogdet(2 * math.pi * mode[1])[1])
    return Evidence(log_posterior + log_volume / 2, math.nan, "Laplace", 0)


@one_blas_thread()
def evidence(
    log_density: LogDensity, systems: Sequence[Coordinates], draws: Draws, rng: np.random.Generator
) -> Evidence:
    """Evidence of a density from its draws, by the optimal bridge to a mixture of Student-t distributions.

    1. Halve the distinct draws by ensembles. A draw that was resampled into both halves goes to one at random.
       Otherwise a mixture would be weighed by draws that it was fitted to, and be too narrow.
    2. Fit a mixture to one half.
    3. Weigh draws of the mixture and the other half by both densities, see `_bridge`.
    4. Do the same with the halves exchanged. ln Z is the mean, its error at least half of the difference.

    Parameters
    ----------
    log_density : callable
        ln of likelihood times normalised prior over θ, (n, d) array to (n,) array.
    systems : sequence of Coordinates
        Coordinates for the mixture, see `jointbayes.posterior.coordinates.coordinate_systems`.
    draws : Draws
        Posterior draws of two ensembles or more.
    rng : numpy.random.Generator
        Source of the mixtures' draws.
    """
    chains, steps, d = draws.theta.shape
    # 1. halve the distinct draws, each with how often it occurs
    theta, first, place, count = np.unique(
        draws.theta.reshape(-1, d), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    value = draws.log_density.reshape(-1)[first]
    second = np.repeat(draws.ensemble >= np.median(draws.ensemble), steps).astype(float)
    share = np.bincount(place.ravel(), weights=second) / count
    mixed = (share > 0) & (share < 1)
    half = np.where(mixed, rng.random(len(theta)) < 0.5, share > 0.5)
    estimates, errors = [], []
    for fitted_to, weighed_by in ((half, ~half), (~half, half)):
        # 2. fit a mixture to one half
        q = fit_proposal(log_density, systems, theta[fitted_to], rng)
        # 3. weigh draws of the mixture and the other half
        ratio = value - q.log_density(theta)
        ratio = np.minimum(ratio, np.median(ratio) + _LARGEST_RATIO)  # infinite outside the coordinates of q
        bulk, _ = effective_sizes(ratio[place.ravel()].reshape(chains, steps))
        total = float(count[weighed_by].sum())
        here, weight = ratio[weighed_by], count[weighed_by] / total
        worth = 1 / max(float(weight @ weight), chains * steps / (bulk * total))
        _, there = q.weighted_draws(log_density, rng, _PROPOSED)
        log_z, error = _bridge(here, weight, worth, there, _PROPOSED)
        estimates.append(log_z)
        errors.append(error)
    # 4. take both together
    error = max(math.hypot(*errors) / 2, abs(estimates[0] - estimates[1]) / 2)
    return Evidence(sum(estimates) / 2, error, "bridge sampling", 2 * _PROPOSED)


def _bridge(here: Array, weight: Array, worth: float, there: Array, proposed: int) -> tuple[float, float]:
    """ln of the ratio of the integrals of p and q, and its standard error, by the optimal bridge.

    Parameters
    ----------
    here
        ln p/q at draws of p.
    weight, worth
        Their normalised weights, and how many independent draws they are worth.
    there
        ln p/q at draws of q where p is above zero.
    proposed
        Number of draws of q, those included where p is zero.
    """
    ours, theirs = math.log(worth / (worth + proposed)), math.log(proposed / (worth + proposed))
    log_r = float(np.median(here))
    for _ in range(_ROUNDS):
        # Meng and Wong (1996), Eq. (4.1)
        over = there - np.logaddexp(ours + there, theirs + log_r)
        under = -np.logaddexp(ours + here, theirs + log_r)
        mean_over = np.logaddexp.reduce(over) - math.log(proposed)
        before, log_r = log_r, float(mean_over - np.logaddexp.reduce(under + np.log(weight)))
        if not abs(log_r - before) > _SETTLED:
            break
    # Frühwirth-Schnatter (2004), section 3: relative variances of both means
    if not len(there):
        return log_r, math.inf
    over, under = np.exp(over - over.max()), np.exp(under - under.max())
    of_over = proposed * float(over @ over) / over.sum() ** 2 - 1
    of_under = float(weight @ under**2) / float(weight @ under) ** 2 - 1
    return log_r, math.sqrt(of_over / proposed + of_under / worth)


def nested_evidence(
    log_likelihood: LogDensity,
    prior_transform: Callable[[Array], Array],
    dimension: int,
    rng: np.random.Generator,
    live: int = _LIVE,
    tell: ProgressCallback = tell_nobody,
) -> Evidence:
    """Evidence by nested sampling, which needs no draws and finds modes by itself.

    Parameters
    ----------
    log_likelihood : callable
        ln L, (n, d) array to (n,) array; −inf where the data are impossible.
    prior_transform : callable
        Uniform points of the unit cube, (n, d), to draws from the prior, (n, d): `JointPrior.transform`.
    dimension : int
        d, 1 or more.
    rng : numpy.random.Generator
        Source of randomness.
    live : int
        Number of live points: the error falls with its root, the time grows with it.
    tell : callable
        Called with the progress, once a second.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the log-likelihood is NaN or +inf somewhere.

    References
    ----------
    Skilling, J. (2006). Nested sampling for general Bayesian computation. Bayesian Analysis 1(4), 833-859.
    DOI 10.1214/06-BA127
    Speagle, J. S. (2020). dynesty. Monthly Notices of the Royal Astronomical Society 493(3), 3132-3158.
    DOI 10.1093/mnras/staa278
    """
    import dynesty

    checked, calls, told = Checked(log_likelihood), 0, time.monotonic()

    def bounded_log_likelihood(theta: Array) -> float:
        nonlocal calls, told
        calls += 1
        if time.monotonic() > told + _EVERY_S:
            told = time.monotonic()
            tell(Progress("nested sampling", f"{calls} evaluations"))
        return max(float(checked(theta[None])[0]), _IMPOSSIBLE)

    sampler = dynesty.NestedSampler(
        bounded_log_likelihood, lambda u: prior_transform(u[None])[0], dimension, nlive=live, sample="rwalk", rstate=rng
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own efficiency, and of logarithms of zero where ln L is flat
        sampler.run_nested(dlogz=_STOP, print_progress=False)
    found = sampler.results
    return Evidence(float(found.logz[-1]), float(found.logzerr[-1]), "nested sampling", int(np.sum(found.ncall)))
