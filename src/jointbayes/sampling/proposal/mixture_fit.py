"""Fit a mixture of Student-t distributions to weighted draws."""

import numpy as np

from jointbayes.arrays import Array
from jointbayes.sampling.proposal.student import StudentMixture, StudentT
from jointbayes.sampling.proposal.student_fit import DOF

_EM_STEPS = 8
_MOST = 12  # components besides the wide one
_DEFENSIVE = 0.05  # weight of one wide component, which bounds the importance weights
_WIDER = 3.0  # it than all others together
_STARVED = 2  # effective draws per parameter of a component, below which it is dropped
_FLOOR = 1e-3  # of the overall covariance, added to each scale


def first_mixture(x: Array, weight: Array, components: int, rng: np.random.Generator) -> StudentMixture:
    """Equal components centred at weighted draws, x of shape (n, d) with normalised weights, to start from.

    Each centre is drawn in proportion to weight times squared distance from those before, so that no mode far from
    the others is left out.

    References
    ----------
    D. Arthur, S. Vassilvitskii, k-means++: the advantages of careful seeding (2007), SODA, 1027-1035.
    """
    mean, overall = _moments(x, weight)
    whitened = (x - mean) @ np.linalg.inv(np.linalg.cholesky(overall)).T
    chosen = [int(rng.choice(len(x), p=weight))]
    nearest = np.full(len(x), np.inf)
    for _ in range(components - 1):
        nearest = np.minimum(nearest, ((whitened - whitened[chosen[-1]]) ** 2).sum(axis=1))
        chance = weight * nearest
        if chance.sum() <= 0:
            break
        chosen.append(int(rng.choice(len(x), p=chance / chance.sum())))
    scale = overall * len(chosen) ** (-2 / x.shape[1])
    narrow = [StudentT(x[k], scale, DOF) for k in chosen]
    return _with_wide(narrow, np.full(len(narrow), 1 / len(narrow)), mean, overall)


def most_likely_mixture(mixture: StudentMixture, x: Array, weight: Array) -> StudentMixture:
    """Weights, centres and scales most likely for weighted draws, by some steps of expectation-maximisation.

    Components that few draws belong to are dropped; the wide one is set by the draws' covariance.

    Parameters
    ----------
    mixture : StudentMixture
        From which to start; its last component is the wide one.
    x : ndarray, shape (n, d)
        Draws.
    weight : ndarray, shape (n,)
        Their normalised weights.

    References
    ----------
    O. Cappé et al., Adaptive importance sampling in general mixture classes (2008), section 4 on t distributions,
    DOI 10.1007/s11222-008-9059-x.
    """
    d = x.shape[1]
    mean, overall = _moments(x, weight)
    for _ in range(_EM_STEPS):
        each = mixture.log_densities(x)
        belongs = np.exp(each - each.max(axis=1, keepdims=True))
        belongs *= (weight / belongs.sum(axis=1))[:, None]
        narrow, masses = [], []
        for share, component in zip(belongs.T, mixture.components[:-1], strict=False):
            mass = float(share.sum())
            if mass <= 0 or mass**2 < _STARVED * (d + 1) * float(share @ share):
                continue
            # far draws count for less: tails are expected
            near = share * (DOF + d) / (DOF + component.squared_distance(x))
            centre = near @ x / near.sum()
            z = x - centre
            narrow.append(StudentT(centre, (z.T * near) @ z / mass + _FLOOR * overall, DOF))
            masses.append(mass)
        if not narrow:
            narrow, masses = [StudentT(mean, overall, DOF)], [1.0]
        mixture = _with_wide(narrow, np.array(masses), mean, overall)
    return mixture


def split(mixture: StudentMixture) -> StudentMixture:
    """Put two halves in the place of the heavier components, along the longest axis of each."""
    *narrow, wide = mixture.components
    weight = mixture.weights[:-1]
    chosen = set(np.argsort(weight)[::-1][: max(_MOST - len(narrow), 0)].tolist())
    size = np.sqrt(np.diag(wide.scale))
    parts: list[StudentT] = []
    weights: list[float] = []
    for k, component in enumerate(narrow):
        if k not in chosen:
            parts.append(component)
            weights.append(float(weight[k]))
            continue
        values, vectors = np.linalg.eigh(component.scale / np.outer(size, size))
        shift = 0.7 * np.sqrt(values[-1]) * vectors[:, -1] * size
        scale = component.scale - 0.9 * np.outer(shift, shift)
        parts += [StudentT(component.mean + side * shift, scale, DOF) for side in (-1, 1)]
        weights += [float(weight[k]) / 2] * 2
    return StudentMixture((*parts, wide), np.append(weights, mixture.weights[-1]))


def _moments(x: Array, weight: Array) -> tuple[Array, Array]:
    """Mean and covariance, the latter positive definite whatever the draws."""
    mean = weight @ x
    z = x - mean
    covariance = (z.T * weight) @ z
    variance = np.diag(covariance)
    covariance += 1e-9 * np.diag(np.where(variance > 0, variance, np.maximum(mean**2, 1e-300)))
    return mean, covariance


def _with_wide(narrow: list[StudentT], weight: Array, mean: Array, covariance: Array) -> StudentMixture:
    """Mixture with the wide component at its end."""
    wide = StudentT(mean, _WIDER**2 * covariance, DOF)
    weights = np.append((1 - _DEFENSIVE) * weight / weight.sum(), _DEFENSIVE)
    return StudentMixture((*narrow, wide), weights)
