"""A mixture of Student-t distributions at many places of a thin curved sheet, each bent as the sheet is there."""

from dataclasses import dataclass, field

import numpy as np

from jointbayes.sampling.distributions import DOF, StudentT, log_peak
from vibrecords.arrays import Array, Flags

#: Lengths of its widest axis from a kernel: what lies there is no other part of a density. A Gaussian of d dimensions
#: lies √d lengths from its middle, and no more than this beyond.
_CLOSE, _BEYOND = 4.0, 2.0
_AT_ONCE, _IN_MEMORY = 50_000, 10_000_000  # numbers of an array


@dataclass(frozen=True, slots=True, eq=False)
class Kernels:
    """Distribution over θ: a place and its axes are chosen, a Student-t drawn along these, and bent.

    With u the draw's coordinates along the first t axes, ½ Σ uᵢ uⱼ bᵢⱼ is added, across to these axes: a shear, which
    leaves volumes as they are.

    Parameters
    ----------
    places : ndarray, shape (k, d)
        Centres.
    axes : ndarray, shape (k, d, d)
        Columns of each: one unit of the Student-t, the widest first.
    bend : ndarray, shape (k, t, t, d)
        bᵢⱼ of each, in the span of its last d − t axes.
    weights : ndarray, shape (k,)
        Probability of each, up to a factor.
    """

    places: Array
    axes: Array
    bend: Array
    weights: Array
    _into: Array = field(init=False, repr=False)
    _bent: Array = field(init=False, repr=False)
    _log_peaks: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        d, into = self.places.shape[1], np.linalg.inv(self.axes)
        first, second = np.triu_indices(self.bend.shape[1])
        derived = {
            "weights": self.weights / self.weights.sum(),
            "_into": into,
            "_bent": np.einsum(
                "kij,kpj,p->kip", into, self.bend[:, first, second], np.where(first == second, 0.5, 1.0)
            ),
            "_log_peaks": log_peak(DOF, d) - np.linalg.slogdet(self.axes)[1],
        }
        for name, array in derived.items():
            object.__setattr__(self, name, array)

    def draw(self, random: np.random.Generator | np.random.RandomState, n: int) -> Array:
        """Independent draws, shape (n, d)."""
        d, t = self.places.shape[1], self.bend.shape[1]
        which = random.choice(len(self.places), n, p=self.weights)
        z = random.standard_normal((n, d)) / np.sqrt(random.chisquare(DOF, n) / DOF)[:, None]
        bent = np.einsum("na,nb,nabd->nd", z[:, :t], z[:, :t], self.bend[which]) / 2
        return self.places[which] + np.einsum("nij,nj->ni", self.axes[which], z) + bent

    def log_densities(self, theta: Array) -> Array:
        """Log of the normalised density of each kernel, without its weight, shape (k, n), at θ, shape (n, d)."""
        (k, d), t = self.places.shape, self.bend.shape[1]
        first, second = np.triu_indices(t)
        squared = np.empty((k, len(theta)))
        # few of many at a time, which stay in the processor's cache
        for some in np.array_split(np.arange(k), min(k, 1 + k * len(theta) * d // _AT_ONCE)):
            z = self._into[some] @ (theta.T - self.places[some][:, :, None])
            if t:
                z[:, t:] -= self._bent[some, t:] @ (z[:, first] * z[:, second])
            np.einsum("kin,kin->kn", z, z, out=squared[some[0] : some[-1] + 1])
        squared /= DOF
        return np.asarray(self._log_peaks[:, None] - (DOF + d) / 2 * np.log1p(squared, out=squared))

    def log_density(self, theta: Array) -> Array:
        """Log of the normalised density, shape (n,), at θ, shape (n, d)."""
        parts = np.array_split(theta, 1 + len(theta) * len(self.places) // _IN_MEMORY)
        return np.concatenate([self.mixed(self.log_densities(part)) for part in parts])

    def mixed(self, log_densities: Array) -> Array:
        """Log of the mixture's density, shape (n,), from the log densities of its kernels, shape (k, n)."""
        each = log_densities + np.log(self.weights)[:, None]
        top = each.max(axis=0)
        return np.asarray(top + np.log(np.exp(each - top).sum(axis=0)))

    def covers(self, theta: Array, sd: Array) -> Flags:
        """Whether points, shape (n, d), are as near to a kernel as a few lengths of its widest axis, shape (n,).

        Distances are measured in units `sd`, shape (d,): across to a thin sheet they count as along it.
        """
        widest = np.linalg.norm(self.axes[:, :, 0] / sd, axis=1)
        near, lengths = np.zeros(len(theta), dtype=bool), max(_CLOSE, self.places.shape[1] ** 0.5 + _BEYOND)
        for place, length in zip(self.places / sd, widest, strict=True):
            near |= ((theta / sd - place) ** 2).sum(axis=1) < (lengths * length) ** 2
        return near

    def joined(self, other: "Kernels", share: float) -> "Kernels":
        """These and others, which have this share of the probability."""
        weights = np.concatenate([(1 - share) * self.weights, share * other.weights])
        places = np.concatenate([self.places, other.places])
        axes, bend = np.concatenate([self.axes, other.axes]), np.concatenate([self.bend, other.bend])
        return Kernels(places, axes, bend, weights)

    @property
    def whole(self) -> StudentT:
        """One Student-t as wide as all of these."""
        away = self.places - self.weights @ self.places
        scale = np.einsum("k,kij,klj->il", self.weights, self.axes, self.axes) + (away.T * self.weights) @ away
        return StudentT(self.weights @ self.places, scale, DOF)
