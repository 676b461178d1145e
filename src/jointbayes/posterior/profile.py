"""Profile likelihood of one coordinate, with likelihood-ratio intervals.

Unlike the Fisher information it follows a curved or flat ridge to its end, and unlike an interval of draws it does not
depend on the prior of the stiffnesses.

References
----------
Raue, A. et al. (2009). Structural and practical identifiability analysis of partially observed dynamical models by
exploiting the profile likelihood. Bioinformatics 25(15), 1923-1929. DOI 10.1093/bioinformatics/btp358
Venzon, D. J., Moolgavkar, S. H. (1988). A method for computing profile-likelihood-based confidence intervals. Applied
Statistics 37(1), 87-94. DOI 10.2307/2347496
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, special

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.inference import LogPosterior, Problem
from jointbayes.joint import Coordinate
from jointbayes.posterior.fisher import inverse_information

#: An unbounded prior counts as bounded so many standard deviations from its mean.
_UNBOUNDED = 8.0
#: Wanted fall of the log ratio from one point to the next.
_FALL = 0.35
#: Error of the log likelihood that ends a climb: the limits are where it has fallen by 1.92.
_ACCURACY = 1e-4
#: Distance from the edge of the cone of positive definite joints that the climb keeps.
_EDGE = 1e-9
#: Least eigenvalue, of columns of unit length, down to which products of columns have all digits that matter.
_INDEPENDENT = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class ProfileLikelihood:
    """Greatest likelihood for each value of one coordinate, relative to the greatest of all.

    Parameters
    ----------
    coordinate
        Which.
    value
        Its values in increasing order, shape (n,): ln k, ρ or ln(p/nominal).
    log_ratio
        ln of the profile over its maximum, shape (n,), 0 or less.
    theta
        All coordinates where the maximum is reached, shape (n, d): how the others move along.
    level
        Confidence of the interval.
    interval
        Values between which −2 log ratio stays below the χ²₁ quantile; at an open end, the end of the prior's support.
    open_below, open_above
        Whether the ratio does not fall that far within the prior: there is no lower or upper limit.
    """

    coordinate: Coordinate
    value: Array
    log_ratio: Array
    theta: Array
    level: float
    interval: tuple[float, float]
    open_below: bool
    open_above: bool

    @property
    def name(self) -> str:
        """Name of the coordinate."""
        return self.coordinate.name

    @property
    def on_axis(self) -> tuple[str, Array, Array]:
        """For a figure: label of the axis, values on it, and the log ratio."""
        return self.coordinate.axis_label, self.value * self.coordinate.axis_scale, self.log_ratio

    @property
    def sentence(self) -> str:
        """What the interval says, for instance "no upper limit within the prior"."""
        missing = [word for word, is_open in (("lower", self.open_below), ("upper", self.open_above)) if is_open]
        if missing:
            return f"{self.name} has no {' and no '.join(missing)} limit within the prior"
        return f"{self.name} has a lower and an upper {100 * self.level:g} % limit"


def profile_likelihood(problem: Problem, theta: ArrayLike, name: str, *, level: float = 0.95) -> ProfileLikelihood:
    """Profile of one coordinate from a mode outwards.

    At each value the likelihood is climbed over all other coordinates by least squares, from where the climb before
    it ended. The priors of the nuisances belong to the likelihood (they stand for other measurements); those of the
    joint's coordinates are left out except for their support, an unbounded one ending 8 standard deviations from its
    mean. Coordinates that the residuals do not depend on (noise hyperparameters) stay at `theta`.

    Parameters
    ----------
    problem
        Structure, joint, data and prior.
    theta
        Where to start, shape (d,): a mode.
    name
        Coordinate to profile.
    level
        Confidence of the likelihood-ratio interval.

    Raises
    ------
    ModelError
        If there is no such coordinate, or the residuals do not depend on it, or `theta` is impossible.
    """
    names = problem.names
    if name not in names:
        raise ModelError(f"profile: found coordinate {name!r}; expected one of {', '.join(names)}; correct the name")
    climb = _Climb(problem.log_posterior, np.asarray(theta, dtype=float), names.index(name))
    if not climb.depends:
        raise ModelError(
            f"profile: found that no residual depends on {name}; expected a coordinate that the model predicts with; "
            "profile another one"
        )
    top, top_cost = climb.maximum()
    first = climb.first_step(top)
    quantile = float(2 * special.gammaincinv(0.5, level))  # of χ² with one degree of freedom
    below, lower, open_below = _side(climb, top, top_cost, -first, quantile)
    above, upper, open_above = _side(climb, top, top_cost, first, quantile)
    points = np.array([t for t, _ in reversed(below)] + [top] + [t for t, _ in above])
    costs = np.array([c for _, c in reversed(below)] + [top_cost] + [c for _, c in above])
    coordinate = next(
        (axis for axis in problem.parametrisation.axes if axis.name == name), Coordinate(name, "1", name, "")
    )
    value, log_ratio = points[:, climb.at], costs.min() - costs
    return ProfileLikelihood(coordinate, value, log_ratio, points, level, (lower, upper), open_below, open_above)


def _side(
    climb: "_Climb", top: Array, top_cost: float, step: float, quantile: float
) -> tuple[list[tuple[Array, float]], float, bool]:
    """Points outwards on one side, the interval's end there, and whether it is open."""
    edge = climb.high[climb.at] if step > 0 else climb.low[climb.at]
    limit = top_cost + quantile / 2
    points: list[tuple[Array, float]] = []
    theta, cost, smallest = top, top_cost, abs(step) / 4
    while theta[climb.at] != edge:
        value = theta[climb.at] + step
        value = min(value, edge) if step > 0 else max(value, edge)
        there, there_cost = climb.maximum_at(value, theta)
        if not np.isfinite(there_cost):  # no positive definite joint so far out: its edge ends the prior's support
            step /= 4
            if abs(step) < 1e-3 * smallest:
                break
            continue
        points.append((there, there_cost))
        if there_cost > limit:
            points.insert(-1, _crossing(climb, (theta, cost), (there, there_cost), limit))
            return points, float(points[-2][0][climb.at]), False
        fall = max(abs(there_cost - cost), 0.01 * _FALL)
        theta, cost = there, there_cost
        # towards the limit the ratio falls as a square: the next step shrinks where this one fell too far
        size = max(abs(step) * float(np.clip(np.sqrt(_FALL / fall), 0.5, 2.0)), smallest)
        step = size if step > 0 else -size
    return points, float(theta[climb.at]), True


def _crossing(
    climb: "_Climb", inside: tuple[Array, float], outside: tuple[Array, float], limit: float
) -> tuple[Array, float]:
    """Point at which the cost equals the limit, between one below and one above it, each with its cost."""
    theta = inside[0]
    # a climb that is repeated may end a little elsewhere, on the other side of the limit
    known = {float(place[climb.at]): cost - limit for place, cost in (inside, outside)}
    low, high = sorted(known)

    def over(value: float) -> float:
        return known[value] if value in known else climb.maximum_at(value, theta)[1] - limit

    end = optimize.brentq(over, low, high, xtol=1e-3 * (high - low), rtol=1e-10)
    return climb.maximum_at(float(end), theta)


def _compress_rows(residual: Array, jacobian: Array) -> tuple[Array, Array]:
    """Residuals (k,) and Jacobian (k, d), k ≤ d + 1, with the eᵀe, Jᵀe and JᵀJ of residuals (m,) and Jacobian (m, d).

    That is all that least squares see of them: lines by the ten thousand are summed up once.
    """
    with_residual = jacobian.T @ residual
    products = np.block([[jacobian.T @ jacobian, with_residual[:, None]], [with_residual, residual @ residual]])
    size = np.sqrt(np.diag(products))
    size = np.where((size > 0) & np.isfinite(size), size, 1.0)
    products /= np.outer(size, size)
    if np.isfinite(products).all() and np.linalg.eigvalsh(products)[0] > _INDEPENDENT:
        triangle = np.linalg.cholesky(products).T * size
    else:  # a direction that the data hardly see: its digits are in the rows, not in the products
        triangle = np.asarray(np.linalg.qr(np.column_stack([jacobian, residual]), mode="r"))
    return triangle[:, -1], triangle[:, :-1]


class _Climb:
    """Least squares over all coordinates but one, the joint's own prior left out."""

    def __init__(self, log_posterior: LogPosterior, theta: Array, at: int) -> None:
        self._log_posterior, self.at = log_posterior, at
        prior = log_posterior.prior
        self._feasible, self._cones = prior.parametrisation.feasible, prior.parametrisation.cones
        self._joint = len(prior.parametrisation.names)
        # the priors of the nuisances, as residuals
        self._weight, self._mean = np.sqrt(prior.precision[self._joint :]), prior.mean[self._joint :]
        self._rest = np.eye(theta.size)[self._joint :] * self._weight[:, None]
        low, high = (np.array(end, dtype=float) for end in prior.support)
        unbounded = _UNBOUNDED * prior.sd
        self.low = np.where(np.isfinite(low), low, prior.mean - unbounded)
        self.high = np.where(np.isfinite(high), high, prior.mean + unbounded)
        inner = 1e-9 * (self.high - self.low)  # at its very ends ρ is no positive definite joint
        self.low, self.high = self.low + inner, self.high - inner
        self._last: tuple[bytes, Array, Array] | None = None
        self._start = np.clip(theta, self.low, self.high)
        if not self._possible(self._start):
            raise ModelError(f"profile: found a start at {theta.tolist()}; expected a positive definite joint")
        self._moved = (log_posterior.data_residuals(self._start)[1] != 0).any(axis=0)
        self.depends = bool(self._moved[at])

    def _both(self, theta: Array) -> tuple[Array, Array]:
        """Residuals of the data, in few rows, and of the nuisances' priors, with their Jacobian; the last is kept."""
        key = theta.tobytes()
        if self._last is None or self._last[0] != key:
            data, slope = _compress_rows(*self._log_posterior.data_residuals(theta))
            rest = self._weight * (theta[self._joint :] - self._mean)
            self._last = key, np.append(data, rest), np.concatenate([slope, self._rest])
        return self._last[1], self._last[2]

    def _possible(self, theta: Array) -> bool:
        return bool(self._feasible(theta[: self._joint]))

    def maximum(self) -> tuple[Array, float]:
        """Point of greatest likelihood near the start, shape (d,), and its cost eᵀe/2."""
        return self._solve(self._start, self._moved)

    def first_step(self, theta: Array) -> float:
        """Half a standard deviation of the coordinate, at most a tenth of its range."""
        _, jacobian = self._both(theta)
        used = jacobian[:, self._moved]
        variance = np.diag(inverse_information(used.T @ used))[int(self._moved[: self.at].sum())]
        return float(min(np.sqrt(variance) / 2, (self.high[self.at] - self.low[self.at]) / 10))

    def maximum_at(self, value: float, near: Array) -> tuple[Array, float]:
        """Greatest likelihood with the coordinate at `value`, from a solution near it: θ (d,) and eᵀe/2."""
        others = self._moved.copy()
        others[self.at] = False
        starts = []
        residual, jacobian = self._both(near)
        along = jacobian[:, self.at] * (value - near[self.at])
        # the others follow by the linear model: the point moves along the ridge, not off it
        move = np.linalg.lstsq(jacobian[:, others], -(residual + along), rcond=1e-10)[0]
        for share in (1.0, 0.5, 0.0):
            start = near.copy()
            start[self.at] = value
            start[others] = np.clip(start[others] + share * move, self.low[others], self.high[others])
            starts.append(start)
        starts.append(self._pulled_inside(starts[-1]))
        possible = np.array([start for start in starts if self._possible(start)])
        if not possible.size:
            return starts[-1], np.inf
        rest = self._weight * (possible[:, self._joint :] - self._mean)
        best = possible[np.argmax(self._log_posterior.log_likelihood(possible) - 0.5 * (rest**2).sum(axis=1))]
        return self._solve(best, others) if others.any() else (best, float((self._both(best)[0] ** 2).sum()) / 2)

    def _pulled_inside(self, theta: Array) -> Array:
        """The point with the joint's other logarithms moved into its cones, within the prior's support."""
        inside = theta.copy()
        outside = [] if self._possible(inside) else [c for c in self._cones if c.normal(inside.size) @ inside >= 0]
        for cone in outside:
            excess = 2 * inside[cone.coupling] - inside[cone.first] - inside[cone.last] + 0.1
            for i, slope in ((cone.coupling, 2.0), (cone.first, -1.0), (cone.last, -1.0)):
                if i != self.at:
                    moved = float(np.clip(inside[i] - excess / slope, self.low[i], self.high[i]))
                    excess += slope * (moved - inside[i])
                    inside[i] = moved
        return inside

    def _solve(self, start: Array, free: NDArray[np.bool_]) -> tuple[Array, float]:
        full = start.copy()

        def whole(u: Array) -> Array:
            full[free] = u
            return full

        size = self._both(start)[0].size

        def residual(u: Array) -> Array:
            theta = whole(u)
            return self._both(theta)[0] if self._possible(theta) else np.full(size, np.inf)

        def jacobian(u: Array) -> Array:
            return self._both(whole(u))[1][:, free]

        low, high = self.low[free], self.high[free]
        inner = 1e-12 * (high - low)
        cost = max(float((self._both(start)[0] ** 2).sum()) / 2, 1.0)
        scale = 1 / np.maximum(np.linalg.norm(jacobian(start[free]), axis=0), 1 / (high - low))
        fit = optimize.least_squares(
            residual, np.clip(start[free], low + inner, high - inner), jac=jacobian, bounds=(low, high),
            x_scale=scale, xtol=1e-8, ftol=max(_ACCURACY / cost, 1e-14), gtol=1e-8, max_nfev=60,
        )  # fmt: skip
        return self._climb_edge(whole(fit.x).copy(), float(fit.cost), free, scale)

    def _climb_edge(self, theta: Array, cost: float, free: NDArray[np.bool_], scale: Array) -> tuple[Array, float]:
        """Climb on along the edge of positive definite joints, where least squares, which knows boxes only, stops."""
        normals = [cone.normal(theta.size) for cone in self._cones]
        edges = np.array([normal for normal in normals if normal @ theta >= -0.01])
        if not edges.size:
            return theta, cost
        full = theta.copy()

        def whole(u: Array) -> Array:
            full[free] = theta[free] + u * scale
            return full

        def value(u: Array) -> float:
            residual, _ = self._both(whole(u))
            return float(residual @ residual) / 2

        def gradient(u: Array) -> Array:
            residual, jacobian = self._both(whole(u))
            return residual @ jacobian[:, free] * scale

        fit = optimize.minimize(
            value,
            np.zeros(scale.size),
            jac=gradient,
            method="SLSQP",
            bounds=list(zip((self.low - theta)[free] / scale, (self.high - theta)[free] / scale, strict=True)),
            constraints=optimize.LinearConstraint(edges[:, free] * scale, ub=-_EDGE - edges @ theta),
            options={"ftol": 1e-9, "maxiter": 100},
        )
        end = whole(fit.x).copy()
        return (end, float(fit.fun)) if self._possible(end) and fit.fun < cost else (theta, cost)
