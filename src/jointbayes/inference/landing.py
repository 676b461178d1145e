"""Where a posterior lies, seen from the whole prior: climbs from quasi-random points, and its shape about their ends.

Few data leave many joints that fit: a thin curved sheet across the prior, or several. A climb that is damped by the
widths of the prior comes down on the nearest part of it, so that climbs from everywhere reach every part.
"""

import numpy as np
from scipy.stats import qmc

from jointbayes.inference.climb import PosteriorSquares, climb_all, side_inside
from jointbayes.inference.log_posterior import LogPosterior
from vibrecords.arrays import Array, Indices

_STEPS = 40
_ARRIVED = 2.0  # in log density: a climb whose next step promises less has come down
_HOPEFUL = 100.0  # below the best of few data: what is lower is climbed no further on all
_AT_ONCE = 4_000_000  # derivatives of residuals held in memory together
_STEP = 1e-6  # of first differences, in prior standard deviations
_ALONG = 0.5  # of second differences, in lengths of an axis
_BENT = 0.3  # of its length, that a sheet may leave an axis at its end
_CLOSER = 3  # times that an axis is made shorter at most


class Landing:
    """A posterior, of which some coordinates may be held at zero, seen from its prior.

    Parameters
    ----------
    log_posterior
        The posterior.
    free
        Columns of θ that are free; by default all.
    mode
        A point that fits, shape (d,): parameters of the noise start there, which no climb moves.
    coarse
        The posterior of fewer data that has its slopes and bends, for these and for the first part of each climb.
    """

    def __init__(
        self,
        log_posterior: LogPosterior,
        free: Indices | None = None,
        mode: Array | None = None,
        coarse: LogPosterior | None = None,
    ) -> None:
        prior = log_posterior.prior
        self._posterior, self._mode = log_posterior, prior.mean if mode is None else mode
        self._coarse = log_posterior if coarse is None else coarse
        self._free = np.arange(prior.mean.size) if free is None else free
        known = np.intersect1d(PosteriorSquares(log_posterior).columns, self._free)
        self._squares = PosteriorSquares(log_posterior, columns=known)
        self._coarse_squares = PosteriorSquares(self._coarse, columns=known)
        #: Prior standard deviations of the free coordinates, shape (f,).
        self.sd = prior.sd[self._free]

    @property
    def evaluations(self) -> int:
        """Number of points at which the posterior was evaluated so far."""
        return sum(each.evaluations for each in {self._posterior, self._coarse})

    def whole(self, theta: Array) -> Array:
        """All coordinates, shape (..., d), of the free ones, shape (..., f)."""
        points = np.zeros((*theta.shape[:-1], self._mode.size))
        points[..., self._free] = theta
        return points

    def log_density(self, theta: Array) -> Array:
        """Log density, shape (n,), of the free coordinates, shape (n, f)."""
        return self._posterior(self.whole(theta))

    def land(self, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Where climbs from n points of the prior end, shape (m, f), and ln of the density there, shape (m,)."""
        prior, columns = self._posterior.prior, self._squares.columns
        points = np.tile(self._mode, (n, 1))
        points[:, columns] = prior.transform(qmc.Sobol(self._mode.size, seed=rng).random(n))[:, columns]
        points = self.whole(points[:, self._free])
        points = points[prior.feasible(points)]
        theta, value = climb_all(self._coarse_squares, points, _STEPS, fine=True, enough=_ARRIVED)
        if self._coarse is not self._posterior:
            theta = theta[value > value.max(initial=-np.inf) - _HOPEFUL]
            theta, value = climb_all(self._squares, theta, _STEPS, fine=True, enough=_ARRIVED)
        return theta[:, self._free], value

    def widths(self, theta: Array) -> Array:
        """Widths of the density about points, shape (n, f), along its axes there, in prior standard deviations."""
        few = np.array_split(self.whole(theta), self._parts(len(theta)))
        curvature = np.concatenate([self._curvature(points, self._slopes(points)[1])[0] for points in few])
        return 1 / np.sqrt(np.maximum(curvature[:, ::-1], 1e-12))[:, ::-1]

    def shapes(self, theta: Array, reach: Array, bent: int) -> tuple[Array, Array]:
        """Axes of the density about points, the widest first, and how it bends away from them.

        Parameters
        ----------
        theta
            Points, shape (n, f).
        reach
            Length that no axis exceeds, in prior standard deviations, shape (n,). It is made shorter where the density
            bends away too far.
        bent
            Number of axes t along which the bend is looked at.

        Returns
        -------
        axes, bend : ndarray, shapes (n, f, f) and (n, t, t, f)
            Columns of the axes, and the second derivative of the sheet by places along them, across to these.
        """
        parts = self._parts(len(theta))
        few = zip(np.array_split(theta, parts), np.array_split(reach, parts), strict=True)
        found = [self._shapes(self.whole(points), lengths, bent) for points, lengths in few]
        return np.concatenate([axes for axes, _ in found]), np.concatenate([bend for _, bend in found])

    def _shapes(self, points: Array, reach: Array, bent: int) -> tuple[Array, Array]:
        # 1. slopes of the residuals, and the axes that they give
        n, white, reach = len(points), self._coarse.white, reach.copy()
        here, jacobian = self._slopes(points)
        curvature, vectors = self._curvature(points, jacobian)
        axes, bend = np.empty_like(vectors), np.zeros((n, bent, bent, self.sd.size))
        away, left = np.zeros(n), np.arange(n)
        for _ in range(_CLOSER):
            precision = curvature[left] + 1 / reach[left, None] ** 2
            axes[left] = self.sd[:, None] * vectors[left] / np.sqrt(precision)[:, None]
            # 2. second differences along the widest axes, and the way across that takes them away
            alone: list[Array] = []
            for j in range(bent):
                for i in [j, *range(j)]:
                    along = axes[left, :, i] + (axes[left, :, j] if i < j else 0.0)
                    move = _ALONG * self.whole(along)
                    second = white(points[left] + move) + white(points[left] - move) - 2 * here[left]
                    if i == j:
                        alone.append(second)
                    else:
                        second = (second - alone[i] - alone[j]) / 2
                    second = np.where(np.isfinite(second), second, 0.0) / _ALONG**2
                    gradient = np.einsum("nmd,nm->nd", jacobian[left], second)
                    across = np.einsum("ndk,nd->nk", vectors[left], gradient) / precision
                    across[:, :bent] = 0.0
                    bend[left, i, j] = bend[left, j, i] = -np.einsum("ndk,nk->nd", vectors[left], across)
            # 3. shorter axes where the density leaves them too far
            away[left] = np.sqrt((bend[left] ** 2).sum(axis=-1)).max(axis=(1, 2), initial=0.0) / 2
            left = left[away[left] > 2 * _BENT * reach[left]]
            if not left.size:
                break
            reach[left] *= np.minimum(1.0, _BENT * reach[left] / np.maximum(away[left], 1e-300))
        bend *= np.minimum(1.0, 2 * reach / np.maximum(away, 1e-300))[:, None, None, None]
        return axes, bend * self.sd

    def _parts(self, n: int) -> int:
        """Number of parts of n points whose derivatives are held in memory together."""
        return max(1, n * self._coarse.likelihood.n_data * self.sd.size // _AT_ONCE)

    def _slopes(self, points: Array) -> tuple[Array, Array]:
        """Residuals, shape (n, m), and their derivative by the free coordinates over their sd, (n, m, f)."""
        prior, white, here = self._posterior.prior, self._coarse.white, self._coarse.white(points)
        jacobian = np.empty((*here.shape, self.sd.size))
        for column, (free, sd) in enumerate(zip(self._free, self.sd, strict=True)):
            move = _STEP * min(sd, 1.0) * np.eye(points.shape[1])[free]
            side = side_inside(prior, points, move)[:, None]
            jacobian[..., column] = (white(points + side * move) - here) * side * (sd / move[free])
        jacobian[~np.isfinite(jacobian).all(axis=(1, 2))] = 0.0
        return here, jacobian

    def _curvature(self, points: Array, jacobian: Array) -> tuple[Array, Array]:
        """Eigenvalues of −∇²ln p in prior standard deviations, ascending, and vectors, shapes (n, f) and (n, f, f)."""
        prior, known = self._posterior.prior, np.isin(self._free, self._squares.columns)
        precision = np.matmul(jacobian.swapaxes(1, 2), jacobian) * np.outer(known, known)
        for column in np.flatnonzero(~known):  # parameters of the noise
            free, sd = self._free[column], self.sd[column]
            move = 1e-2 * sd * np.eye(points.shape[1])[free]
            second = sum(self._posterior(points + side * move) for side in (1, -1)) - 2 * self._posterior(points)
            second = np.where(np.isfinite(second), second, 0.0) / 1e-2**2
            precision[:, column, column] = np.maximum(-second - prior.precision[free] * sd**2, 0.0)
        diagonal = np.arange(self.sd.size)
        precision[:, diagonal, diagonal] += prior.precision[self._free] * self.sd**2
        values, vectors = np.linalg.eigh(precision)
        return np.maximum(values, 0.0), vectors
