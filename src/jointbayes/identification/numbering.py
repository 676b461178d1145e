"""Check whether measured natural frequencies fit other modes, or another unit, as well as the stated ones."""

import math
from dataclasses import dataclass, replace

import numpy as np

from jointbayes.errors import JointBayesError
from jointbayes.frf import NaturalFrequencies, least_reach_hz
from jointbayes.inference import ErrorSizes, JointPrior, ModelErrorNoise, Problem, Uniform
from jointbayes.inference.climb import PosteriorSquares, climb_all
from vibrecords import ModalData
from vibrecords.arrays import Array
from vibrecords.mode_data import renumbered

#: Modes that the first measured one may be away from its stated number.
SHIFTS = (*range(-3, 0), *range(1, 7))
#: ln of the Bayes factor from which on one of two numberings is taken, 150 to 1, and within which both are named.
SURE = 5.0
RAD_PER_S = 1 / (2 * math.pi)  # Hz
_DRAWS, _CLIMBS, _MOST_STEPS = 300, 2, 30
_WEIGHED = 2  # the numberings nearest to the measured frequencies whose evidence is compared with the stated one's
_SPREAD = 0.02  # of frequencies: errors well below it count by their square, those above hardly more
_RIGID = 1e30  # N/m and N·m/rad
_RIGID_DRAWS = 50  # of what is uncertain of the structure
_ABOVE_RIGID = 1.05  # of measured frequencies over those with rigid joints: E to 3 %, length to 0.5 % come to 2 %
_AT_END = 1e-3  # standard deviations of the prior within which a coordinate counts as at an end of its range


@dataclass(frozen=True, slots=True)
class Renumbered:
    """A numbering that explains the data as well as the stated one, or better: both, and ln of the Bayes factor.

    With `rad_per_s` it is the stated numbering of frequencies that were divided by 2π.
    """

    stated: tuple[int, ...]
    other: tuple[int, ...]
    log_bayes_factor: float
    rad_per_s: bool = False

    @property
    def better(self) -> bool:
        """Whether the other one is sure to be the right one of the two."""
        return self.log_bayes_factor > SURE

    @property
    def words(self) -> str:
        """What was found, after "natural frequencies that": ``"fit far better as those of modes 3, 4 than …"``."""
        stated, other = (", ".join(map(str, numbers)) for numbers in (self.stated, self.other))
        odds = f"ln of the Bayes factor {self.log_bayes_factor:.3g}"
        if self.rad_per_s:
            as_well = "fit far better" if self.better else "fit about as well"
            return f"{as_well} divided by 2π, as if they were in rad/s: {odds}"
        if self.better:
            return f"fit far better as those of modes {other} than of modes {stated}: {odds}"
        return f"fit about as well as those of modes {other} as of modes {stated}: {odds}"


@dataclass(frozen=True, slots=True)
class AboveRigid:
    """A mode whose measured frequency, in Hz, is above the one that it has with rigid joints."""

    number: int
    measured_hz: float
    rigid_hz: float


def find_numbering(problem: Problem, sizes: ErrorSizes | None = None) -> Renumbered | None:
    """Look for a numbering under which measured natural frequencies are as probable as under the stated one.

    The probability of the data is that of the joint and all else that is uncertain, with the model's error, integrated
    by Laplace's method from the modes that the problem knows and the best of draws of the prior. Default priors follow
    the measured frequencies: of frequencies in rad/s the springs are softer by (2π)².

    Parameters
    ----------
    problem
        One test.
    sizes
        Of the model's errors in modes that are stated without any; None takes the model as exact.

    Returns
    -------
    Renumbered
        The most probable other numbering; None where the stated one is sure.

    References
    ----------
    Kass, R. E., Raftery, A. E. (1995). Bayes factors. Journal of the American Statistical Association 90(430), 773-795.
    DOI 10.1080/01621459.1995.10476572
    """
    measured, prior = problem.test.data.modes, problem.prior
    if measured is None or measured.match == "shape" or not prior.marginals:
        return None
    with np.errstate(all="ignore"):  # of joints far from any that fits
        try:
            nearest = _nearest_first(problem, measured)[:_WEIGHED]
            if not nearest:
                return None
            stated = _log_evidence(problem, measured, (0, 1.0), sizes)
            gains = {other: _log_evidence(problem, measured, other, sizes) - stated for other in nearest}
        except (JointBayesError, ArithmeticError, ValueError, np.linalg.LinAlgError):  # the run itself will say it
            return None
    (shift, unit_hz), gain = max(gains.items(), key=lambda item: item[1])
    as_many = len(measured.values) <= len(prior.marginals)  # numbers as many joints fit, of any modes
    if not gain >= (SURE if as_many else -SURE):
        return None
    other = tuple(number + shift for number in measured.numbers)
    return Renumbered(measured.numbers, other, gain, unit_hz != 1)


def find_above_rigid(problem: Problem) -> AboveRigid | None:
    """Look for a measured natural frequency that no joint reaches, because a rigid joint has a lower one.

    A natural frequency rises with every stiffness of the joints. What is uncertain takes values of the prior.

    Returns
    -------
    AboveRigid
        The mode farthest above; None if each is at most 5 % above, which the model may miss.
    """
    measured = problem.test.data.modes
    if measured is None or measured.match == "shape" or problem.test.measured_bodies:
        return None
    body, joints, count = problem.test.structures, problem.test.joints, max(measured.numbers)
    draws = problem.prior.sample(np.random.default_rng(0), _RIGID_DRAWS)
    factors = np.unique(problem.structural(problem.prior.factors(draws)), axis=0)
    with np.errstate(all="ignore"):
        try:
            model = NaturalFrequencies(body.at(joints.labels, least_reach_hz(body, joints, count)), joints, count)
            rigid = model.frequency_hz(np.tile(_RIGID * np.eye(joints.size), (len(factors), 1, 1)), factors).max(axis=0)
        except (JointBayesError, ArithmeticError, ValueError, np.linalg.LinAlgError):  # the run itself will say it
            return None
    highest = rigid[np.array(measured.numbers) - 1]
    worst = int(np.argmax(measured.frequency_hz / highest))
    found, limit = float(measured.frequency_hz[worst]), float(highest[worst])
    return AboveRigid(measured.numbers[worst], found, limit) if found > _ABOVE_RIGID * limit else None


def _nearest_first(problem: Problem, measured: ModalData) -> list[tuple[int, float]]:
    """Other numberings, by shift and unit in Hz, the one first that some joint of the prior brings nearest."""
    numbers, prior = np.array(measured.numbers), problem.prior
    most, least = problem.test.most_modes, min(int(name.split()[1]) for name in measured.value_names)  # zeros as well
    possible = [(shift, 1.0) for shift in SHIFTS if least + shift >= 1 and numbers.max() + shift <= most]
    count = int(numbers.max()) + max((shift for shift, _ in possible), default=0)
    if measured.shown_frfs is None and all(name.startswith("frequency") for name in measured.value_names):
        possible.append((0, RAD_PER_S))
    gaps = [np.append(numbers[:i], numbers[i:] + 1) for i in range(1, numbers.size)]  # a mode between was left out
    # all but the joint as stated: joints move frequencies far more than what is uncertain
    body, joints, count = problem.test.structures, problem.test.joints, max(count, min(count + 1, most))
    certain = body.at(joints.labels, least_reach_hz(body, joints, count)).certain()
    away, model = {}, NaturalFrequencies(certain, joints, count)
    for unit_hz in {1.0, *(unit for _, unit in possible)}:
        softer = _in_unit(prior, unit_hz)
        stiffness = softer.values(softer.sample(np.random.default_rng(0), _DRAWS))
        predicted = model.frequency_hz(softer.parametrisation.matrix(stiffness))
        for shift, unit in possible:
            if unit == unit_hz:
                ratio = np.log(predicted[:, numbers + shift - 1] / (unit * measured.frequency_hz))
                away[shift, unit] = _least_away(ratio)
        if unit_hz == 1:
            seen = [gap for gap in gaps if gap.max() <= predicted.shape[1]]
            missed = [_least_away(np.log(predicted[:, gap - 1] / measured.frequency_hz)) for gap in seen]
    if away.get((0, RAD_PER_S), -math.inf) > min(missed, default=math.inf) - SURE:
        del away[0, RAD_PER_S]
    return sorted(away, key=lambda other: away[other])


def _least_away(ratio: Array) -> float:
    """Return the distance of the joint that is nearest, by ln of predicted over measured, shape (joints, modes)."""
    return float(np.nanmin(np.log1p((ratio / _SPREAD) ** 2).sum(axis=1)))


def _in_unit(prior: JointPrior, unit_hz: float) -> JointPrior:
    """The prior that follows the frequencies in this unit: ranges of stiffnesses moved by its square."""
    if unit_hz == 1:
        return prior
    moved = 2 * math.log(unit_hz)
    marginals = tuple(
        Uniform(marginal.low + moved, marginal.high + moved)
        if axis.logarithmic and isinstance(marginal, Uniform)
        else marginal
        for axis, marginal in zip(prior.parametrisation.axes, prior.marginals, strict=True)
    )
    return replace(prior, marginals=marginals)


def _log_evidence(
    problem: Problem, measured: ModalData, numbering: tuple[int, float], sizes: ErrorSizes | None
) -> float:
    """ln of the probability density of the measured values, as modes of other numbers or in another unit."""
    shift, unit_hz = numbering
    test = replace(problem.test, data=renumbered(measured, shift, unit_hz))
    if isinstance(test.noise, ModelErrorNoise):
        test = test.with_model_error(test.noise.sizes)
    elif sizes is not None and (test.noise is None or test.noise.as_stated):
        test = test.with_model_error(sizes)
    weighed = replace(problem, tests=(test,), prior=_in_unit(problem.prior, unit_hz))
    # ln ∫ p(y|θ) p(θ) dθ about each mode by Laplace's method; half of it along what lies at an end of its range
    prior, (low, high), about = weighed.prior, weighed.prior.support, []
    for theta in _modes(weighed):
        slope = weighed.log_posterior.data_residuals(theta)[1] * prior.sd
        # a flat prior counts as a normal one of its width: along what the data do not see its volume is right to 1.4
        # ln det(1 + JᵀJ), which as a determinant would be lost where a fraction of a hertz is near a rigid-body motion
        log_det = np.log1p(np.linalg.svd(slope, compute_uv=False) ** 2).sum()
        at_end = np.minimum(theta - low, high - theta) < _AT_END * prior.sd
        volume = np.log(math.sqrt(2 * math.pi) * prior.sd).sum() - log_det / 2 - math.log(2) * at_end.sum()
        about.append(float(weighed.log_posterior(theta[None])[0] + volume))
    return max(about) + len(measured.values) * math.log(unit_hz)


def _modes(problem: Problem) -> Array:
    """Modes of the posterior, shape (n, d), to which known modes and the best draws of the prior lead."""
    log_posterior, prior = problem.log_posterior, problem.prior
    draws = prior.sample(np.random.default_rng(0), _DRAWS)
    best = np.argsort(np.nan_to_num(log_posterior(draws), nan=-np.inf))[::-1][:_CLIMBS]
    starts = np.vstack([problem.known_theta, draws[best]])
    return climb_all(PosteriorSquares(log_posterior, exact=True), starts, _MOST_STEPS, fine=True)[0]
