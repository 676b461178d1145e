"""Where a posterior lies, seen from the whole prior: climbs from quasi-random points, and its shape about their ends.

Few data leave many joints that fit: a thin curved sheet across the prior, or several. A climb that is damped by the
widths of the prior comes down on the nearest part of it, so that climbs from everywhere reach every part.
"""

import numpy as np
from scipy.stats import qmc

from jointbayes.inference.climb import PosteriorSquares, climb_all, normal_equations
from jointbayes.inference.log_posterior import LogPosterior
from vibrecords.arrays import Array, Indices

_STEPS = 40
_ARRIVED = 2.0  # in log density: a climb whose next step promises less has come down
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
    """

    def __init__(self, log_posterior: LogPosterior, free: Indices | None = None, mode: Array | None = None) -> None:
        prior = log_posterior.prior
        self._posterior, self._mode = log_posterior, prior.mean if mode is None else mode
        self._free = np.arange(prior.mean.size) if free is None else free
        known = PosteriorSquares(log_posterior).columns
        self._squares = PosteriorSquares(log_posterior, columns=np.intersect1d(known, self._free))
        #: Prior standard deviations of the free coordinates, shape (f,).
        self.sd = prior.sd[self._free]

    @property
    def evaluations(self) -> int:
        """Number of points at which the posterior was evaluated so far."""
        return self._posterior.evaluations

    def whole(self, theta: Array) -> Array:
        """All coordinates, shape (n, d), of the free ones, shape (n, f)."""
        points = np.zeros((len(theta), self._mode.size))
        points[:, self._free] = theta
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
        theta, value = climb_all(self._squares, points, _STEPS, fine=True, enough=_ARRIVED)
        return theta[:, self._free], value

    def widths(self, theta: Array) -> Array:
        """Widths of the density about points, shape (n, f), along its axes there, in prior standard deviations."""
        curvature, _ = self._curvature(self.whole(theta))
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
        parts = max(1, len(theta) * self._posterior.likelihood.n_data * self.sd.size // _AT_ONCE)
        few = zip(np.array_split(theta, parts), np.array_split(reach, parts), strict=True)
        found = [self._shapes(self.whole(points), lengths, bent) for points, lengths in few]
        return np.concatenate([axes for axes, _ in found]), np.concatenate([bend for _, bend in found])

    def _shapes(self, points: Array, reach: Array, bent: int) -> tuple[Array, Array]:
        n, f, white = len(points), self.sd.size, self._posterior.white
        curvature, vectors = self._curvature(points)
        here = white(points)
        step = _STEP * np.minimum(self.sd, 1.0)
        slopes = [
            (white(points + self.whole(row[None])) - here) / size for row, size in zip(np.diag(step), step, strict=True)
        ]
        jacobian = np.stack(slopes, axis=2) * self.sd
        for _ in range(_CLOSER):
            precision = curvature + 1 / reach[:, None] ** 2
            axes = self.sd[:, None] * vectors / np.sqrt(precision)[:, None]
            bend = np.zeros((n, bent, bent, f))
            for i in range(bent):
                for j in range(i, bent):
                    up, down = (_ALONG * (axes[:, :, i] + side * axes[:, :, j]) for side in (1, -1))
                    if i == j:
                        up, down = up / 2, np.zeros_like(up)
                    values = [white(points + self.whole(move)) for move in (up, -up, down, -down)]
                    second = (values[0] + values[1] - values[2] - values[3]) / (_ALONG**2 * (1 if i == j else 4))
                    gradient = np.einsum("nmd,nm->nd", jacobian, np.where(np.isfinite(second), second, 0.0))
                    across = np.einsum("ndk,nd->nk", vectors, gradient) / precision
                    across[:, :bent] = 0.0
                    bend[:, i, j] = bend[:, j, i] = -np.einsum("ndk,nk->nd", vectors, across)
            away = np.sqrt((bend**2).sum(axis=-1)).max(axis=(1, 2), initial=0.0) / 2
            if (away <= 2 * _BENT * reach).all():
                break
            reach = reach * np.minimum(1.0, _BENT * reach / np.maximum(away, 1e-300))
        bend *= np.minimum(1.0, 2 * reach / np.maximum(away, 1e-300))[:, None, None, None]
        return axes, bend * self.sd

    def _curvature(self, points: Array) -> tuple[Array, Array]:
        """Eigenvalues of −∇²ln p in prior standard deviations, ascending, and vectors, shapes (n, f) and (n, f, f)."""
        prior, columns, free = self._posterior.prior, self._squares.columns, self._free
        _, normal = normal_equations(self._squares, points)
        precision = np.zeros((len(points), points.shape[1], points.shape[1]))
        precision[:, columns[:, None], columns] = normal
        for column in np.setdiff1d(free, columns):  # parameters of the noise
            move = 1e-2 * prior.sd[column] * np.eye(points.shape[1])[column]
            second = sum(self._posterior(points + side * move) for side in (1, -1)) - 2 * self._posterior(points)
            second = np.where(np.isfinite(second), second, 0.0) / (1e-2 * prior.sd[column]) ** 2
            precision[:, column, column] = np.maximum(-second - prior.precision[column], 0.0)
        precision[:, np.arange(points.shape[1]), np.arange(points.shape[1])] += prior.precision
        values, vectors = np.linalg.eigh(precision[:, free[:, None], free] * self.sd[:, None] * self.sd)
        return np.maximum(values, 0.0), vectors
