"""The posterior mode (MAP) by Levenberg-Marquardt from several starts, and its Laplace covariance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from jointbayes.errors import ModelError
from jointbayes.identification.climb import newton_climb
from jointbayes.identification.climb_all import climb_all
from jointbayes.identification.mode_scan import with_modes_on_data
from jointbayes.identification.squares import PosteriorSquares
from jointbayes.inference import LogPosterior
from jointbayes.joint import CondensedChart, LogStiffness

__all__ = ["LocalMode", "MapEstimate", "ModeSearch", "StartOutcome", "maximise_posterior", "refine"]

Array = NDArray[np.float64]

#: Two modes are the same when they lie this close, in prior standard deviations and in log density.
_SAME_POINT = 1e-3
_SAME_DENSITY = 1e-3
#: A mode this much lower in log density than the best matters no more.
_LOWEST = 12.0
_MOST_MODES = 8
#: Two ends are two modes when the log density falls by this much between them, looked at in so many places.
_VALLEY = 0.5
_LINE = 21
#: So often the noise model's parameters and all others are improved in turn.
_TURNS = 3
#: Relative tolerance of a climb that is the last word, and of one that a climb on the density itself follows.
_EXACT, _ROUGH = 1e-12, 1e-5
#: Edges of the support are looked for so often, and a climb along them that gains less has arrived.
_EDGES, _SETTLED = 5, 1e-6
#: Steps of the rough climb. Two rough ends are one when they are nearer than this, in prior standard deviations and in
#: log density.
_ROUGH_STEPS = 40
_NEAR, _NEARLY = 0.01, 0.05
#: A rough end from which the density falls no more than this on the way to a mode leads there.
_FALL = 0.01
#: Rough ends that are lower than the best by `_LOWEST` and this are not refined, and no more than so many in one go.
_UNREFINED, _REFINED = 20.0, 8


@dataclass(frozen=True, slots=True)
class StartOutcome:
    """Where one start led: its first and last (k11, k12, k22), log density, and whether that is the best mode."""

    name: str
    start: Array
    stiffness: Array
    log_posterior: float
    reached_mode: bool


@dataclass(frozen=True, slots=True)
class LocalMode:
    """A local maximum of the posterior density: coordinates (d,), Laplace covariance (d, d), log density."""

    theta: Array
    covariance: Array
    log_posterior: float


@dataclass(frozen=True, slots=True)
class MapEstimate:
    """Mode of the posterior density over θ.

    Parameters
    ----------
    theta
        Coordinates of the mode, shape (d,).
    stiffness
        (k11, k12, k22) at the mode, shape (3,).
    covariance
        Laplace covariance of θ, shape (d, d); never wider than the prior in any direction.
    log_posterior
        Log density at the mode, up to the evidence.
    starts
        What became of each start.
    modes
        Local modes that starts led to and that may matter, the highest first: none is more than 12 below it in log
        density.
    """

    theta: Array
    stiffness: Array
    covariance: Array
    log_posterior: float
    starts: tuple[StartOutcome, ...]
    modes: tuple[LocalMode, ...] = ()

    @property
    def failed_starts(self) -> tuple[str, ...]:
        """Names of the starts that ended elsewhere."""
        return tuple(s.name for s in self.starts if not s.reached_mode)


def refine(log_posterior: LogPosterior, theta: ArrayLike) -> tuple[Array, float]:
    """Climb from θ, shape (d,), to the nearest mode: trust-region least squares, exact in the joint's coordinates.

    With a noise model that is not Gaussian of known size its parameters and all others are improved in turn, and the
    end is polished by Newton's method on the density itself.

    Returns
    -------
    theta, log_density : ndarray of shape (d,), float

    Raises
    ------
    ModelError
        If the start lies outside the prior's support.

    References
    ----------
    Branch, M. A., Coleman, T. F., Li, Y. (1999). SIAM Journal on Scientific Computing 21(1), 1-23.
    DOI 10.1137/S1064827595289108
    """
    start = np.asarray(theta, dtype=float)
    if not np.isfinite(log_posterior(start)[0]):
        raise ModelError(f"MAP: found a start at {start.tolist()}; expected a point where the prior is above zero")
    likelihood = log_posterior.likelihood
    if likelihood.gaussian:
        found = _least_squares(log_posterior, start, _EXACT)
        return found, float(log_posterior(found)[0])
    for _ in range(_TURNS if likelihood.hyper_count else 1):
        start = _noise_improved(log_posterior, start)
        end = _least_squares(log_posterior, start, _ROUGH)
        # what is best for the squares need not be better for the density
        start = end if log_posterior(end)[0] > log_posterior(start)[0] else start
    return _polished(log_posterior, start)


def _polished(log_posterior: LogPosterior, theta: Array) -> tuple[Array, float]:
    """End of Newton's method on the density itself, along the edges of the support where these hold it.

    In coordinates in which a joint with hardly known k11 and k12 has a straight ridge: of the paper's stiffnesses k22
    is replaced by k22 − k12²/k11, see `CondensedChart`.
    """
    prior = log_posterior.prior
    low, high = prior.support
    value = float(log_posterior(theta)[0])
    for _ in range(_EDGES):
        edge = ((theta <= low) | (theta >= high)) & ~_gains_inwards(log_posterior, theta, value)
        free = np.flatnonzero(~edge)
        condensed = isinstance(prior.parametrisation, LogStiffness) and not edge[2]
        chart = CondensedChart() if condensed else None
        place = theta if chart is None else chart.forward(theta[None])[0]

        def inside(moving: Array, free: Array = free, place: Array = place, chart: CondensedChart | None = chart) -> Array:
            whole = np.tile(place, (len(moving), 1))
            whole[:, free] = moving
            return np.clip(whole if chart is None else chart.inverse(whole)[0], low, high)

        covariance = laplace_covariance(log_posterior, theta)
        slope = np.eye(theta.size)
        if chart is not None:
            step = 1e-6 * np.eye(theta.size)
            slope = ((chart.forward(theta + step) - chart.forward(theta - step)) / 2e-6).T
        covariance = (slope @ covariance @ slope.T)[np.ix_(free, free)]
        found, density, _ = newton_climb(lambda m: log_posterior(inside(m)), place[free], covariance)
        gain, value = density - value, max(density, value)
        theta = inside(found[None])[0] if gain > 0 else theta
        if gain < _SETTLED:
            break
    return theta, value


def _gains_inwards(log_posterior: LogPosterior, theta: Array, value: float) -> NDArray[np.bool_]:
    """Whether the density rises from θ, shape (d,), towards the inside of the support along each coordinate."""
    low, high = log_posterior.prior.support
    step = np.where(theta <= low, 1.0, -1.0) * 1e-5 * np.minimum(log_posterior.prior.sd, 1.0)
    return np.asarray(log_posterior(theta + np.diag(step)) > value)


def _noise_improved(log_posterior: LogPosterior, theta: Array) -> Array:
    """Best parameters of the noise model, the last coordinates of θ, for the others as they are."""
    count = log_posterior.likelihood.hyper_count
    if count == 0:
        return theta
    low, high = (end[-count:] for end in log_posterior.prior.support)
    margin = 1e-6 * (high - low)

    def loss(tail: Array) -> float:
        value = -float(log_posterior(np.concatenate([theta[:-count], tail]))[0])
        return value if np.isfinite(value) else np.finfo(float).max

    found = optimize.minimize(
        loss,
        np.clip(theta[-count:], low + margin, high - margin),
        method="Nelder-Mead",
        bounds=list(zip(low + margin, high - margin, strict=True)),
        options={"xatol": 1e-3, "fatol": 1e-3},
    )
    return np.concatenate([theta[:-count], found.x])


def _least_squares(log_posterior: LogPosterior, start: Array, tolerance: float) -> Array:
    """End of a climb on the residuals to a relative tolerance, the parameters of the noise model held as they are."""
    moving = start.size - log_posterior.likelihood.hyper_count
    if moving == 0:  # a rigid joint and a structure that is exactly known
        return start
    low, high = (end[:moving] for end in log_posterior.prior.support)
    feasible = log_posterior.prior.parametrisation.feasible
    tail, joint = start[moving:], log_posterior.prior.joint

    # the solver asks for residual and Jacobian of one point in turn: they come from one evaluation
    last: dict[bytes, tuple[Array, Array]] = {}

    def both(t: Array) -> tuple[Array, Array]:
        key = t.tobytes()
        if key not in last:
            last.clear()
            residual, jacobian = log_posterior.residuals(np.concatenate([t, tail]))
            last[key] = residual, jacobian[:, :moving]
        return last[key]

    size = both(start[:moving])[0].size

    def residual(t: Array) -> Array:
        # an infinite residual makes the solver shorten its step: the cone is no box that it could be told of
        return both(t)[0] if feasible(joint(t)) else np.full(size, np.inf)

    def jacobian(t: Array) -> Array:
        return both(t)[1]

    margin = 1e-9 * (high - low)
    margin[~np.isfinite(margin)] = 0.0
    found = optimize.least_squares(
        residual,
        np.clip(start[:moving], low + margin, high - margin),
        jac=jacobian,
        bounds=(low, high),
        x_scale=log_posterior.prior.sd[:moving],
        xtol=tolerance,
        ftol=max(0.01 * tolerance, 1e-14),
        gtol=tolerance,
        max_nfev=200,
    )
    return np.concatenate([found.x, tail])


def maximise_posterior(
    log_posterior: LogPosterior, starts: Mapping[str, ArrayLike], screened: Sequence[Array] = ()
) -> MapEstimate:
    """Best mode over several starts.

    Parameters
    ----------
    log_posterior
        Density to climb.
    starts
        (k11, k12, k22), shape (3,), by name. A start outside the prior's support is moved to its nearest edge.
    screened
        Further starts θ, each shape (d,), inside the support. An end that is as good as the best of the named starts'
        is that one.

    Returns
    -------
    MapEstimate

    Raises
    ------
    ModelError
        If no start leads anywhere.
    """
    search = ModeSearch(log_posterior)
    search.climb_stiffnesses(starts)
    search.climb({f"screened draw {i}": theta for i, theta in enumerate(screened, 1)})
    return search.estimate()


class ModeSearch:
    """Climbs from more and more starts, and what they found.

    All starts climb together, roughly and under Gaussian noise of the stated size; the distinct ends that may matter
    are then climbed to the last digit, under the noise model itself.

    Parameters
    ----------
    log_posterior
        Density to climb.
    """

    def __init__(self, log_posterior: LogPosterior) -> None:
        self._posterior = log_posterior
        self._begun: dict[str, Array] = {}  # (k11, k12, k22) by the start's name
        self._ends: dict[str, tuple[Array, float]] = {}
        self._refined: list[_Refined] = []

    @property
    def best(self) -> tuple[Array, float]:
        """Highest end so far, θ of shape (d,), and its log density.

        Raises
        ------
        ModelError
            If no start lies inside the prior's support.
        """
        if not self._refined:
            raise ModelError(
                "MAP: found no start inside the prior's support; expected priors that contain a positive definite "
                "joint; widen them"
            )
        highest = max(end.log_density for end in self._refined)
        # of ends that are equally good the first: a further start that leads to a known mode changes nothing
        first = next(end for end in self._refined if end.log_density >= highest - _SAME_DENSITY)
        return first.theta, first.log_density

    @property
    def refined(self) -> Array:
        """Distinct ends so far that may matter, shape (n, d)."""
        return np.array([end.theta for end in self._refined])

    def reached(self) -> dict[str, bool]:
        """Whether each start, by name, ended at the best mode; of those at which the density has a value."""
        theta, best = self.best
        sd = self._posterior.prior.sd
        return {
            # along a ridge that data and prior leave flat many points are equally the mode
            name: bool((np.abs((end - theta) / sd) < _SAME_POINT).all()) or best - density < _SAME_DENSITY
            for name, (end, density) in self._ends.items()
        }

    def climb_stiffnesses(self, starts: Mapping[str, ArrayLike]) -> None:
        """Climb from joints (k11, k12, k22), shape (3,), by name, each moved into the prior's support."""
        inside = {name: into_support(self._posterior, k) for name, k in starts.items()}
        self._begun |= {name: np.asarray(k, dtype=float) for name, k in starts.items()}
        self.climb({name: theta for name, theta in inside.items() if theta is not None})

    def climb(self, starts: Mapping[str, Array], weights: Sequence[Array] = (), *, scan: bool = True) -> None:
        """Climb from points θ, each shape (d,), by name.

        Parameters
        ----------
        starts
            Points inside the support.
        weights
            Factors on the residuals, shape (lines, pairs), with which they climb first, one after the other.
        scan
            Whether uncertain errors of natural frequencies are first moved to their best place.
        """
        prior = self._posterior.prior
        self._begun |= {name: prior.stiffness(theta) for name, theta in starts.items() if name not in self._begun}
        if not starts:
            return
        names = list(starts)
        rough = np.array([with_modes_on_data(self._posterior, t) if scan else t for t in starts.values()])
        for weight in weights:
            rough, _ = climb_all(PosteriorSquares(self._posterior, weight), rough, _ROUGH_STEPS)
        rough, _ = climb_all(PosteriorSquares(self._posterior), rough, _ROUGH_STEPS)
        density = self._posterior(rough)
        possible = np.isfinite(density)
        self._ends |= {names[i]: (rough[i], float(density[i])) for i in np.flatnonzero(possible)}
        self._refine_distinct([names[i] for i in np.flatnonzero(possible)])

    def _refine_distinct(self, names: Sequence[str]) -> None:
        """Refine those ends of these starts that are new and may matter; the others get the end of the same mode."""
        left = _REFINED
        for name in sorted(names, key=lambda n: -self._ends[n][1]):
            theta, density = self._ends[name]
            known = next((r for r in self._refined if self._leads_to(theta, density, r)), None)
            # under another noise model the rough climb is only a start
            sure = self._posterior.likelihood.hyper_count == 0 and bool(self._refined)
            if known is None and left and not (sure and density < self.best[1] - _LOWEST - _UNREFINED):
                known = _Refined(theta, density, *refine(self._posterior, theta))
                self._refined.append(known)
                left -= 1
            if known is not None:
                self._ends[name] = known.theta, known.log_density

    def _leads_to(self, theta: Array, density: float, mode: "_Refined") -> bool:
        """Whether a rough end is that of a mode, or no valley lies between it and the mode."""
        same = (np.abs((mode.rough - theta) / self._posterior.prior.sd) < _NEAR).all()
        if same and abs(mode.rough_density - density) < _NEARLY:
            return True
        higher = density - _SAME_DENSITY < mode.log_density
        return higher and not _parted(self._posterior, mode.theta, theta, density, _FALL)

    def estimate(self) -> MapEstimate:
        """Best mode so far, its covariance, and where each start led.

        Raises
        ------
        ModelError
            If no start led anywhere.
        """
        theta, best = self.best
        prior = self._posterior.prior
        nowhere, reached = np.full_like(theta, np.nan), self.reached()
        outcomes = []
        for name, stiffness in self._begun.items():
            end, density = self._ends.get(name, (nowhere, -np.inf))
            outcomes.append(StartOutcome(name, stiffness, prior.stiffness(end), density, reached.get(name, False)))
        return MapEstimate(
            theta,
            prior.stiffness(theta),
            laplace_covariance(self._posterior, theta),
            best,
            tuple(outcomes),
            local_modes(self._posterior, [(end.theta, end.log_density) for end in self._refined]),
        )


@dataclass(frozen=True, slots=True)
class _Refined:
    """A rough end of a climb with its log density, and the mode it was refined to."""

    rough: Array
    rough_density: float
    theta: Array
    log_density: float


def local_modes(log_posterior: LogPosterior, ends: Sequence[tuple[Array, float]]) -> tuple[LocalMode, ...]:
    """Ends of climbs that are modes of their own, the highest first.

    Two ends belong to one mode where the density along the straight line between them hardly falls below the lower
    one: a flat ridge has many ends and one mode.

    Parameters
    ----------
    log_posterior
        Density that was climbed.
    ends
        Place, shape (d,), and log density of each.
    """
    best = max(density for _, density in ends)
    modes: list[LocalMode] = []
    for theta, density in sorted(ends, key=lambda end: -end[1]):
        if density < best - _LOWEST or len(modes) == _MOST_MODES:
            break
        if all(_parted(log_posterior, mode.theta, theta, density) for mode in modes):
            modes.append(LocalMode(theta, laplace_covariance(log_posterior, theta), density))
    return tuple(modes)


def _parted(log_posterior: LogPosterior, higher: Array, lower: Array, density: float, valley: float = _VALLEY) -> bool:
    """Whether the density falls by that much between two ends, below the lower one."""
    if (np.abs((higher - lower) / log_posterior.prior.sd) < _SAME_POINT).all():
        return False
    fraction = np.linspace(0, 1, _LINE)[1:-1, None]
    straight = higher + fraction * (lower - higher)
    return bool(log_posterior(straight).min() < density - valley)


def into_support(log_posterior: LogPosterior, stiffness: ArrayLike) -> Array | None:
    """Coordinates of the joint nearest to (k11, k12, k22) at which the prior is above zero; None if there is none."""
    k11, k12, k22 = np.asarray(stiffness, dtype=float)
    prior = log_posterior.prior
    tiny = np.exp(-20.0)
    k11, k22 = max(k11, tiny), max(k22, tiny)
    limit = 0.9 * np.sqrt(k11 * k22)
    names = prior.parametrisation.names
    coupling = np.clip(k12, 0.1 * limit, limit) if "k12" in names else np.clip(k12, -limit, limit)
    low, high = prior.support
    inner = 1e-6 * np.where(np.isfinite(high - low), high - low, 0.0)
    rest = prior.mean[len(names) :]

    def inside(joint: ArrayLike) -> Array:
        whole = np.concatenate([prior.parametrisation.coordinates(joint), rest])
        clipped: Array = np.clip(whole, low + inner, high - inner)
        return clipped

    theta = inside([k11, coupling, k22])
    if not prior.feasible(theta):  # moving k11 or k22 to the edge may leave k12 too large
        k = prior.stiffness(theta)
        k[1] = 0.9 * np.sqrt(k[0] * k[2])
        theta = inside(k)
    return theta if np.isfinite(log_posterior(theta)[0]) else None


def laplace_covariance(log_posterior: LogPosterior, theta: Array) -> Array:
    """Inverse of −∇∇ ln p at a mode, shape (d, d).

    The Hessian is a central difference of the exact gradient. Directions in which it is flatter than the prior
    (a mode at the edge of its support, data that do not see a combination) get the prior's width.
    """
    prior = log_posterior.prior
    sd = prior.sd
    _, jacobian = log_posterior.residuals(theta)
    scaled = jacobian * sd
    step = 1e-3 * sd / np.sqrt(np.maximum((scaled**2).sum(axis=0), 1.0))
    hessian = np.zeros((theta.size, theta.size))
    ups, downs = (prior.moved(theta, np.diag(sign * step)) for sign in (1, -1))
    for i, (up, down) in enumerate(zip(ups, downs, strict=True)):
        if up[i] > down[i]:
            hessian[i] = -(log_posterior.gradient(up) - log_posterior.gradient(down)) / (up[i] - down[i])
    values, vectors = np.linalg.eigh((hessian + hessian.T) / 2 * np.outer(sd, sd))
    covariance: Array = (vectors / np.maximum(values, 1.0)) @ vectors.T * np.outer(sd, sd)
    return covariance
