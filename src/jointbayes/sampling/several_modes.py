"""Several modes of one density: which is nearest to a point, and how a point is carried from one to another."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.sampling.density import covariance_roots

_LEAST = 1e-10  # eigenvalue of the correlations of a covariance


@dataclass(frozen=True, slots=True, eq=False)
class SeveralModes:
    """Modes of a density, see `SeveralModes.of`.

    Parameters
    ----------
    centres
        Shape (m, d).
    factors
        Cholesky factor of the covariance about each, shape (m, d, d).
    maps
        Matrix that carries a distance from mode i over to mode j, shape (m, m, d, d): its covariance becomes that of j.
    """

    centres: Array
    factors: Array
    maps: Array

    @classmethod
    def of(cls, starts: Sequence[tuple[Array, Array]], images: Array | None = None) -> Self:
        """From place and covariance of each.

        Parameters
        ----------
        starts
            Place, shape (d,), and covariance, shape (d, d), of each mode.
        images
            Orthogonal matrices, shape (n, d, d), of which one may take a mode to another: an exchange of like
            quantities. Each pair of modes is joined by that which brings the one nearest to the other, or by none, so
            that of exact images the map is the exchange itself.
        """
        centres = np.array([place for place, _ in starts])
        roots = [covariance_roots(np.asarray(covariance, dtype=float), _LEAST) for _, covariance in starts]
        factors = np.asarray(np.linalg.cholesky([root @ root.T for root in roots]), dtype=np.float64)
        count, d = centres.shape
        whole = np.eye(d)[None] if images is None else np.concatenate([np.eye(d)[None], images])
        maps = np.empty((count, count, d, d))
        for i in range(count):
            covariances = whole @ factors[i] @ factors[i].T @ whole.swapaxes(1, 2)
            for j in range(i, count):
                distance = np.linalg.solve(factors[j], (whole @ centres[i] - centres[j]).T)
                best = int(np.argmin((distance**2).sum(axis=0)))
                maps[i, j] = factors[j] @ np.linalg.solve(np.linalg.cholesky(covariances[best]), whole[best])
                maps[j, i] = np.linalg.inv(maps[i, j])
        return cls(centres, factors, maps)

    def nearest(self, theta: Array) -> NDArray[np.intp]:
        """Number of the mode nearest to each point θ, shape (..., d), in its own covariance, shape (...)."""
        away = [np.linalg.inv(f) @ (theta - c)[..., None] for c, f in zip(self.centres, self.factors, strict=True)]
        return np.asarray(np.argmin([(z**2).sum((-2, -1)) for z in away], axis=0))

    def membership(self, theta: Array) -> Array:
        """1 for the mode nearest to each draw, 0 for the others, shape (..., m)."""
        return np.asarray(self.nearest(theta)[..., None] == np.arange(len(self.centres)), dtype=float)

    def carried(self, theta: Array, here: NDArray[np.intp], there: NDArray[np.intp]) -> tuple[Array, Array]:
        """Points θ, shape (n, d), carried from modes to others, and ln |∂θ'/∂θ|, shape (n,)."""
        moved = self.centres[there] + np.einsum("nij,nj->ni", self.maps[here, there], theta - self.centres[here])
        size = np.log(np.diagonal(self.factors, axis1=1, axis2=2)).sum(axis=1)
        return moved, size[there] - size[here]
