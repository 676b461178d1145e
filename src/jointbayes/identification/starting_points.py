"""Starts for a climb: by natural frequencies first, and from draws of the prior that explain the most lines.

FRFs with lines coarser than a resonance is wide have a density full of false summits; natural frequencies have not.
Joints whose predicted frequencies agree with the resonances of the data lie within reach of the mode.
"""

import numpy as np
import scipy  # its parts load at first use

from jointbayes.frf import NaturalFrequencies, rigid_body_modes
from jointbayes.inference import JointPrior, LogPosterior, Problem, Test
from jointbayes.inference.climb import climb_all
from jointbayes.structure.recipe import is_damping
from vibrecords.arrays import Array, Indices
from vibrecords.peaks import resonances_hz

#: Relative error of a frequency that counts as one standard deviation.
TOLERANCE = 0.005
#: A resonance that is farther than this from any predicted frequency, relative, is given up.
_LOST = 0.2
#: A predicted frequency inside the band that shows no resonance counts as one that is off by this: modes with a node
#: at the response, or across the plane of the measurement, show none.
_UNSEEN = 0.025
#: Predicted frequencies so near the ends of the band, relative, need not show a resonance.
_EDGE = 0.03
_MOST_MODES = 24  # predicted
_SPARE = 1.2  # on the end of the band: the structure itself may be uncertain
_POINTS, _CLIMBED, _STEPS = 256, 12, 25
_APART = 0.5  # prior standard deviations of the joint's coordinates between points that are climbed
_SAME = 0.02  # prior standard deviations between ends that are one
_SCREENED_AT_ONCE = 1_000_000  # residuals held in memory together
_SCREENED_VALUES, _FEWEST_SCREENED = 2_000_000_000, 500  # of all draws together; of millions of lines fewer draws
_FACTORS = 8  # 1 + |z|² that are multiplied before their logarithm is taken: below 1e38 each, they do not overflow


def natural_frequency_model(problem: Problem) -> NaturalFrequencies:
    """Predicts the natural frequencies up to the end of the band of the problem's structures with its joint."""
    structures, modes = problem.test.structures, problem.test.data.modes
    if modes is not None:
        most = max(max(modes.numbers), min(modes.most_modes, problem.test.most_modes))
        return NaturalFrequencies(structures, problem.test.joints, most)
    top = _SPARE * problem.test.data.top_hz
    free = structures.at(problem.test.joints.labels, top)
    most = free.n_dofs - rigid_body_modes(free, problem.test.joints)
    return NaturalFrequencies(structures, problem.test.joints, min(most, _MOST_MODES), top_hz=top)


class FrequencyMatch:
    """How well predicted natural frequencies agree with the resonances of the data, in every test.

    But for tests with a body that is given by its FRFs, whose modes are not known, and for static tests.

    Parameters
    ----------
    problem
        The problem; what moves no natural frequency stays at the mean of its prior.

    Raises
    ------
    ModelError
        If a DOF does not exist.
    """

    def __init__(self, problem: Problem) -> None:
        self.prior: JointPrior = problem.prior
        #: A few frequencies cost no more at one point further.
        self.linearised = None
        self._tests = [_TestMatch(part) for part in problem.parts if _has_modes(part.test)]
        self.columns: Indices = np.unique(np.concatenate([test.columns for test in self._tests]))

    @property
    def resonances_hz(self) -> Array:
        """Resonances of the data of all tests, Hz."""
        return np.concatenate([test.resonances_hz for test in self._tests])

    def residuals(self, theta: Array) -> Array:
        """Residuals, shape (n, …), see `_TestMatch`."""
        return np.concatenate([test.residuals(theta) for test in self._tests], axis=1)

    def value(self, theta: Array) -> Array:
        """Log density, shape (n,), up to a constant: −½ Σ e² and the prior's; −inf outside its support."""
        log_density = self.prior.log_density(theta)
        inside = np.isfinite(log_density)
        if inside.any():
            log_density[inside] -= 0.5 * (self.residuals(theta[inside]) ** 2).sum(axis=1)
        return np.where(np.isnan(log_density), -np.inf, log_density)


def _has_modes(test: Test) -> bool:
    """Whether natural frequencies of the model could show in the data of a test."""
    return not test.measured_bodies and test.data.top_hz > 0


class _TestMatch:
    """The same of one test.

    Each resonance counts by ln(f_model/f_data) over a tolerance, under the soft-L1 loss 2(√(1 + r²) − 1), for the best
    assignment that keeps their order; resonances without a counterpart, and predicted frequencies in the band without
    one, count as much as one that is off by 20 % and by 2.5 %.

    Parameters
    ----------
    problem
        Of the test.
    """

    __test__ = False

    def __init__(self, problem: Problem) -> None:
        self.prior: JointPrior = problem.prior
        self._problem = problem
        data = problem.test.data
        #: Resonances of the data, Hz.
        self.resonances_hz = resonances_hz(data)
        # measured natural frequencies, and modes without other numbers, are the lowest ones, each of them
        self._complete = data.lowest_hz is not None
        self._band = data.band_hz
        joint = len(problem.parametrisation.names)
        quantities = problem.test.structures.names
        fixed = map(is_damping, quantities)
        places = joint + problem.structural_columns
        shift = [int(place) for place, moves_nothing in zip(places, fixed, strict=True) if not moves_nothing]
        self.columns: Indices = np.array([*range(joint), *shift], dtype=np.intp)
        # what is alone counts as a residual of this size
        self._lost, self._unseen = max(_LOST / TOLERANCE, 3.0), min(_UNSEEN / TOLERANCE, 5.0)
        self._model = natural_frequency_model(problem)
        # a joint raises every natural frequency: there are no more in the band than without it
        structural = problem.structural(np.ones((1, len(problem.prior.nuisances))))
        absent = np.zeros((1, problem.test.joints.size, problem.test.joints.size))
        below = int((self._model.frequency_hz(absent, structural)[0] < _SPARE * self._band[1]).sum())
        self._count = self.resonances_hz.size if self._complete else max(below, 1)

    def predicted_hz(self, theta: Array) -> Array:
        """Natural frequencies of the model, shape (n, count), Hz."""
        structural = self._problem.structural(self.prior.factors(theta))
        return self._model.frequency_hz(self.prior.matrix(theta), structural)[:, : self._count]

    def residuals(self, theta: Array) -> Array:
        """Residuals, shape (n, resonances + 1): of each resonance, and of all predicted ones without one."""
        predicted = self.predicted_hz(theta)
        partner, unseen = self._assigned(predicted)
        lost = partner < 0
        ratio = np.log(np.take_along_axis(predicted, np.maximum(partner, 0), axis=1) / self.resonances_hz)
        ratio = np.where(lost, self._lost, ratio / TOLERANCE)
        rest = np.sqrt(unseen * _soft(self._unseen))
        return np.column_stack([np.sign(ratio) * np.sqrt(_soft(ratio)), rest])

    def _assigned(self, predicted: Array) -> tuple[Indices, Array]:
        """Number of the predicted frequency of each resonance, −1 for none, (n, resonances), and how many have none.

        The best of all assignments that keep the order, by dynamic programming over both.
        """
        data = self.resonances_hz
        n, m = predicted.shape
        if self._complete:
            return np.tile(np.arange(m), (n, 1)), np.zeros(n)
        low, high = self._band
        seen = (predicted > low * (1 + _EDGE)) & (predicted < high * (1 - _EDGE))
        with np.errstate(divide="ignore"):  # a free body has modes at 0 Hz
            cost = _soft(np.log(predicted[:, None] / data[:, None]) / TOLERANCE)
        cost = np.where(np.isfinite(cost), cost, np.finfo(float).max / 4)
        partner = _aligned(cost, float(_soft(self._lost)), np.where(seen, _soft(self._unseen), 0.0))
        taken = np.zeros((n, m + 1), dtype=bool)
        np.put_along_axis(taken, np.where(partner < 0, m, partner), True, axis=1)
        return partner, (seen & ~taken[:, :m]).sum(axis=1).astype(float)


def _aligned(cost: Array, lost: float, unseen: Array) -> Indices:
    """Cheapest assignment that keeps the order: number of the column of each row, −1 for none, shape (n, rows).

    For costs (n, rows, columns) of pairs, of a row without a column, and of columns without a row (n, columns).
    """
    n, rows, columns = cost.shape
    best = np.zeros((n, rows + 1, columns + 1))
    best[:, 0, 1:] = np.cumsum(unseen, axis=1)
    best[:, 1:, 0] = lost * np.arange(1, rows + 1)
    choice = np.zeros((n, rows + 1, columns + 1), dtype=np.int8)  # 0 pair, 1 column alone, 2 row alone
    choice[:, 0, 1:], choice[:, 1:, 0] = 1, 2
    for r in range(1, rows + 1):
        for c in range(1, columns + 1):
            pair = best[:, r - 1, c - 1] + cost[:, r - 1, c - 1]
            options = np.stack([pair, best[:, r, c - 1] + unseen[:, c - 1], best[:, r - 1, c] + lost])
            choice[:, r, c] = np.argmin(options, axis=0)
            best[:, r, c] = options.min(axis=0)
    partner = np.full((n, rows), -1, dtype=np.intp)
    each, row, column = np.arange(n), np.full(n, rows), np.full(n, columns)
    for _ in range(rows + columns):
        step = choice[each, row, column]
        paired = (step == 0) & (row > 0) & (column > 0)
        partner[each[paired], row[paired] - 1] = column[paired] - 1
        row, column = row - ((step != 1) & (row > 0)), column - ((step != 2) & (column > 0))
    return partner


def frequency_starts(problem: Problem, rng: np.random.Generator, effort: int = 1) -> Array:
    """Points from which to climb the posterior, shape (n, d), the best first.

    None where the data show no resonance, or a body is given by its FRFs and has no modes to be compared.
    256 Sobol points of the prior in all that moves natural frequencies are compared with the resonances of the data,
    and the twelve best that stand apart climb to agreement.

    Parameters
    ----------
    problem
        The problem.
    rng
        Scrambles the points.
    effort
        Factor on the numbers of points, a power of two, and of climbs.

    References
    ----------
    Sobol, I. M. (1967). On the distribution of points in a cube and the approximate evaluation of integrals. USSR
    Computational Mathematics and Mathematical Physics 7(4), 86-112. DOI 10.1016/0041-5553(67)90144-9
    """
    prior = problem.prior
    if not any(map(_has_modes, problem.tests)):
        return np.empty((0, prior.mean.size))
    match = FrequencyMatch(problem)
    if not (match.resonances_hz.size and match.columns.size):
        return np.empty((0, prior.mean.size))
    unit = np.full((_POINTS * effort, prior.mean.size), 0.5)
    unit[:, match.columns] = scipy.stats.qmc.Sobol(match.columns.size, seed=rng).random(_POINTS * effort)
    points = prior.transform(unit)
    value = match.value(points)
    joint = prior.joint(points) / prior.sd[: len(prior.marginals)]
    picked = apart(joint, value, _APART, _CLIMBED * effort)
    ends, value = climb_all(match, points[picked], _STEPS)
    kept = apart(ends[:, match.columns] / prior.sd[match.columns], value, _SAME, _CLIMBED * effort)
    return ends[kept]


def apart(places: Array, value: Array, distance: float, most: int) -> list[int]:
    """Numbers of the highest places, none within a distance of a higher one in every coordinate; −inf never."""
    picked: list[int] = []
    for i in np.argsort(-value, kind="stable"):
        if len(picked) == most or not np.isfinite(value[i]):
            break
        if all(np.abs(places[i] - places[k]).max(initial=0.0) > distance for k in picked):
            picked.append(int(i))
    return picked


def screened_draws(log_posterior: LogPosterior, rng: np.random.Generator, draws: int, keep: int) -> Array:
    """Points from which to climb, shape (≤ keep, d): of so many draws of the prior those that fit the most lines.

    A joint whose resonances are all off by more than their width has no slope that leads to the mode: climbs end
    where one wrong resonance stands on the slope of a measured one. Draws are ranked by Σ ln(1 + |z|²) of the
    standardised residuals z, the Cauchy loss, which counts lines that fit instead of adding up how badly the others
    do not.

    Parameters
    ----------
    log_posterior
        Density to be climbed.
    rng
        Source of the draws.
    draws, keep
        Numbers of draws, and of points to return: apart from one another by half a prior standard deviation.
    """
    prior, likelihood = log_posterior.prior, log_posterior.likelihood
    draws = min(draws, max(_FEWEST_SCREENED, _SCREENED_VALUES // likelihood.n_data))
    theta = prior.sample(rng, draws)
    loss = np.empty(draws)
    at_once = max(1, _SCREENED_AT_ONCE // likelihood.n_data)
    for begin in range(0, draws, at_once):
        few = theta[begin : begin + at_once]
        z = log_posterior.standardised(few).reshape(len(few), -1)
        square = 1 + (z.real**2 + z.imag**2)
        # one logarithm of a few factors costs a few times less than theirs
        loss[begin : begin + at_once] = np.log(
            np.multiply.reduceat(square, np.arange(0, square.shape[1], _FACTORS), axis=1)
        ).sum(axis=1)
    joint = prior.joint(theta) / prior.sd[: len(prior.marginals)]
    return theta[apart(joint, np.where(np.isfinite(loss), -loss, -np.inf), _APART, keep)]


def _soft(residual: Array | float) -> Array:
    """Soft-L1 loss 2(√(1 + r²) − 1)."""
    return np.asarray(2 * (np.hypot(1.0, residual) - 1))
