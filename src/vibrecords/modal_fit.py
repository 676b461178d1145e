"""Natural frequencies and damping ratios from measured FRFs, with standard deviations, nothing clicked."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.linalg
import scipy.ndimage
from numpy.typing import NDArray

from vibrecords.arrays import Array, Band, ComplexArray, Flags, Indices, Quantity, quantity_factor, stretch_about
from vibrecords.driven import driven_lines
from vibrecords.errors import MeasurementError, refusal
from vibrecords.frf_set import FrfSet
from vibrecords.modal_doubt import DoubtfulMode, PoleReview
from vibrecords.modal_problem import ModalProblem, polynomial_poles, steady_poles
from vibrecords.provenance import MeasuredMode
from vibrecords.variance import RelativeNoise, coherence_variance


@dataclass(frozen=True, slots=True, eq=False)
class ModalFit:
    """Modes of a set of FRFs and the modal model fitted with them.

    Parameters
    ----------
    modes
        By rising frequency.
    values
        The model's FRFs, shape (lines, outputs, inputs), in the quantity of the data.
    misfit
        χ² per degree of freedom: 1 where the model explains the data within the stated noise.
    covariance
        Of all frequencies, Hz, and then all damping ratios, shape (2 modes, 2 modes).
    doubtful
        What looks like a mode and is left out, by rising frequency.
    """

    modes: tuple[MeasuredMode, ...]
    values: ComplexArray
    misfit: float
    covariance: Array
    doubtful: tuple[DoubtfulMode, ...]


def identify_modes(
    frf: FrfSet,
    variance: Array | None = None,
    *,
    f_min_hz: float | None = None,
    f_max_hz: float | None = None,
    max_order: int = 40,
) -> tuple[MeasuredMode, ...]:
    """Natural frequencies and damping ratios of the modes that FRFs show, with standard deviations.

    Poles that are stable while the order of a least-squares complex frequency-domain model rises are the start of a
    weighted least-squares fit of the modal model: two real numbers for each mode and FRF, and fourteen for each FRF for
    what lies outside the band. What the fit leaves is searched for further modes. A mode stays only if it improves the
    fit by more than the search for one in pure noise would; what is doubtful all the same is left out, and named by
    `fit_modes`. Standard deviations come from the Jacobian of that fit, and are widened where the model does not
    explain the data within the stated noise.

    Parameters
    ----------
    frf
        FRFs of one structure, of any quantity.
    variance
        σ² = E|δH|² of both parts together, shape as ``frf.values``. If None, it is taken from coherence and averages
        where the FRFs have them, smoothed along frequency, and else estimated from what the fit leaves.
    f_min_hz, f_max_hz
        Band to look at; by default all of it. Only modes inside are returned.
    max_order
        Highest order of the polynomial models: at least three times the number of modes expected.

    Returns
    -------
    tuple
        Modes by rising frequency; empty where none stands out of the noise.

    Raises
    ------
    MeasurementError
        If the band holds too few lines, or the variance has another shape or is not positive.
    """
    with _finite_numbers():
        return _modes_of(_fit_bands(frf, variance, (f_min_hz, f_max_hz), max_order))[0]


def modes_and_doubtful(
    frf: FrfSet, variance: Array | None = None
) -> tuple[tuple[MeasuredMode, ...], tuple[DoubtfulMode, ...]]:
    """As `identify_modes`, and what looks like a mode and is left out."""
    with _finite_numbers():
        fits = _fit_bands(frf, variance, (None, None))
        return _modes_of(fits)[0], tuple(doubt for fitted in fits for doubt in fitted.doubtful)


def fit_modes(
    frf: FrfSet,
    variance: Array | None = None,
    *,
    f_min_hz: float | None = None,
    f_max_hz: float | None = None,
    max_order: int = 40,
) -> ModalFit:
    """As `identify_modes`, with the fitted FRFs (in the band), misfit, covariance and doubtful modes as well."""
    with _finite_numbers():
        fits = _fit_bands(frf, variance, (f_min_hz, f_max_hz), max_order)
        chi2, freedom, values = zip(*(fitted.all_values(frf.quantity) for fitted in fits), strict=True)
        modes, covariance = _modes_of(fits)
        modes = tuple(_without_window(mode, frf.window_rate) for mode in modes)
        doubtful = tuple(doubt for fitted in fits for doubt in fitted.doubtful)
        shape = (-1, len(frf.outputs), len(frf.inputs))
        return ModalFit(modes, np.vstack(values).reshape(shape), sum(chi2) / sum(freedom), covariance, doubtful)


def _without_window(mode: MeasuredMode, rate: float) -> MeasuredMode:
    """A mode without the decay rate in 1/s that an exponential window has added to its pole."""
    omega, decay = 2 * np.pi * mode.frequency_hz, 2 * np.pi * mode.frequency_hz * mode.damping_ratio
    true = float(np.sqrt(omega**2 - decay**2 + (decay - rate) ** 2))
    return replace(mode, frequency_hz=true / (2 * np.pi), damping_ratio=(decay - rate) / true) if rate else mode


def identify_zeros(frf: FrfSet, variance: Array | None = None) -> dict[str, ModalFit]:
    """Antiresonances of drive points: natural frequencies of the structure with that DOF held.

    They are the poles of one over the FRF, sought by the rules of `identify_modes`.

    Parameters
    ----------
    frf, variance
        As for `identify_modes`.

    Returns
    -------
    dict
        For each DOF that is an output and an input, the fit of one over its accelerance; the frequencies and dampings
        of its modes are those of the antiresonances. Empty where there is no drive point.

    Raises
    ------
    MeasurementError
        As `identify_modes`.
    """
    _lines_inside(frf, variance, (None, None))
    fits = {}
    for dof in (output for output in frf.outputs if output in frf.inputs):
        at = np.s_[:, [frf.outputs.index(dof)], [frf.inputs.index(dof)]]
        noise = None if variance is None else variance[at][:, :, None]
        with _finite_numbers():
            cores = [fitted.in_core() for fitted in _fit_bands(frf.select((dof,), (dof,)), noise, (None, None))]
            lines, values, weight, smooth = (np.concatenate(each) for each in zip(*cores, strict=True))
            factor = quantity_factor(lines, "accelerance", frf.quantity)[:, None]
            # one over the accelerance, linearised about the fitted one: its noise is Gaussian even where that is nearly
            # 0; fitted as a receptance, since it is a constant, the mass, at high frequencies
            inverse = (2 / smooth - values / smooth**2) / factor
            sd = 1 / (weight * np.abs(smooth**2 * factor))
        fits[dof] = fit_modes(FrfSet(lines, inverse[:, :, None], (dof,), (dof,)), sd[:, :, None] ** 2)
    return fits


@contextmanager
def _finite_numbers() -> Iterator[None]:
    """Say in one line what linear algebra says of numbers beyond what floats hold."""
    try:
        with np.errstate(all="ignore"):
            yield
    except (ValueError, ArithmeticError) as error:
        found = f"FRFs that no modes can be fitted to ({' '.join(str(error).split())})"
        expected = "those of a structure"
        raise refusal("modal fit", found, expected, "look at the values, or choose another band") from None


def _fit_bands(frf: FrfSet, variance: Array | None, band_hz: Band, max_order: int = 40) -> list["_PoleFit"]:
    """Fits of the driven part of a band, or of each of its sub-bands where it has many lines."""
    lines = np.flatnonzero(_lines_inside(frf, variance, band_hz))
    if variance is None and frf.coherence is not None:
        coherence = np.clip(frf.coherence[lines].reshape(lines.size, -1), 1e-6, 1.0)
        noise = np.abs(frf.values[lines].reshape(lines.size, -1)) * np.sqrt(1 / coherence - 1)
        driven = lines[driven_lines(coherence.max(axis=1), np.median(noise, axis=1))]
        lines = driven if driven.size >= _FEWEST_LINES else lines
    joined = _joined_at(frf.frequency_hz[lines], np.abs(frf.values[lines]).reshape(lines.size, -1))
    ends = _ends_of_sub_bands(np.abs(frf.values[lines]).reshape(lines.size, -1), joined)
    fits = []
    for first, last in pairwise(ends):
        over = (last - first) // _OVERLAP if len(ends) > 2 else 0
        low, high = max(first - over, 0), min(last + over, lines.size)
        inside, count = lines[low:high], int(joined[low:high].min())
        top = np.nextafter(frf.frequency_hz[lines[-1]], np.inf)
        ends_hz = frf.frequency_hz[lines[first]], frf.frequency_hz[lines[last]] if last < lines.size else top
        further = max_order if len(ends) == 2 else _FURTHER
        fits.append(_fit_poles(_Joined.of(frf, variance, inside, count), ends_hz, max_order, further))
    return fits


def _joined_at(frequency_hz: Array, magnitude: Array) -> Indices:
    """How many lines may be joined to one about each, shape (lines,): 1 where lines are few, or no more than needed.

    A mode may be as little damped as the sharpest peak of any FRF, so that its width goes with the frequency.
    """
    step, none = np.gradient(frequency_hz), np.ones(len(magnitude), dtype=np.intp)
    if len(magnitude) <= _MOST_LINES or step.max() > _EVEN * step.min():
        return none
    smooth = scipy.ndimage.uniform_filter1d(magnitude, _SMOOTHED, axis=0, mode="nearest")
    sharpest = np.inf
    for level in smooth.T:
        for peak in scipy.signal.find_peaks(np.log(level + np.finfo(float).tiny), prominence=1.0)[0].tolist():
            first, end = stretch_about(level <= level[peak] / 2, peak)
            sharpest = min(sharpest, (end - first) * step[peak] / frequency_hz[peak])
    count = sharpest * frequency_hz / step / _ON_A_PEAK if np.isfinite(sharpest) else none
    return np.clip(count, 1, len(magnitude) // _MOST_LINES + 1).astype(np.intp)


@dataclass(frozen=True, slots=True, eq=False)
class _Joined:
    """FRFs and their variance, if that is stated, at lines joined by `count`, and at every line."""

    frf: FrfSet
    variance: Array | None
    every: FrfSet
    every_variance: Array | None
    count: int

    @classmethod
    def of(cls, frf: FrfSet, variance: Array | None, inside: Indices, count: int) -> "_Joined":
        """Of some lines: the means over so many at a time, without their errors of second order."""
        noise = None if variance is None else variance[inside]
        coherence = None if frf.coherence is None else frf.coherence[inside]
        every = replace(frf, frequency_hz=frf.frequency_hz[inside], values=frf.values[inside], coherence=coherence)
        if count == 1:
            return cls(every, noise, every, noise, 1)
        whole = inside.size // count * count

        def means(values: NDArray[Any]) -> NDArray[Any]:
            return values[:whole].reshape(-1, count, *values.shape[1:]).mean(axis=1)

        mean = means(every.values)
        few = replace(
            every,
            frequency_hz=means(every.frequency_hz)[1:-1],
            # a mean is off by 1/24 of the second difference of such means
            values=mean[1:-1] - (mean[2:] - 2 * mean[1:-1] + mean[:-2]) / 24,
            coherence=None if coherence is None else means(coherence)[1:-1],
            averages=None if frf.averages is None else round(frf.averages * count / _LOUDER),
        )
        return cls(few, None if noise is None else _LOUDER / count * means(noise)[1:-1], every, noise, count)


def _ends_of_sub_bands(magnitude: Array, joined: Indices) -> list[int]:
    """Lines at which sub-bands begin, and the end of the last; between two of them the FRFs are smallest.

    A fit takes as long as its lines times the modes and what looks like one among them, times the latter again.
    """
    count = len(magnitude)
    if count <= _MOST_LINES:
        return [0, count]
    level = (magnitude / (np.median(magnitude, axis=0) + np.finfo(float).tiny)).max(axis=1)
    level = scipy.ndimage.uniform_filter1d(level, _SMOOTHED, mode="nearest")
    # lines of a sub-band are joined by as many as serve its lowest: it has more than those of its middle
    size = _SUB_BAND // 4 if (joined > 1).any() else _SUB_BAND
    way = np.cumsum(1 / joined)
    bands = -(-way[-1] // size)
    nominal = np.interp(np.linspace(0, way[-1], int(bands) + 1)[1:-1], way, np.arange(1, count + 1))
    ends = [0]
    for n in nominal.round().astype(int).tolist():
        reach = size // 4 * int(joined[n])
        low = max(n - reach, ends[-1] + 1)
        ends.append(low + int(np.argmin(level[low : n + reach])))
    return [*ends, count]


def _fit_poles(lines: _Joined, ends_hz: tuple[float, float], max_order: int, further: int) -> "_PoleFit":
    """Modes of some lines, and the problem with the poles that they are; those modes count that are between the ends.

    Of many FRFs poles are sought in a few, evenly spaced; then the values and weights of all follow, whose residues are
    a linear problem.
    """
    frf, variance = lines.frf, lines.variance
    n_lines, frequency = frf.n_lines, frf.frequency_hz
    values = frf.values.reshape(n_lines, -1)
    stated = None if variance is None else variance.reshape(n_lines, -1)
    order = min(max_order, n_lines // 4)
    further = min(order, further)
    first = _first_weight(values, stated)
    few = _few_of(values.shape)
    if few.size < values.shape[1]:
        values, first, stated = values[:, few], first[:, few], None if stated is None else stated[:, few]
    problem = ModalProblem(frequency, values, first, frf.quantity)
    poles = steady_poles(polynomial_poles(frequency, values, problem.weight, order), max(4, order // 5))
    from_coherence = _noise_squares(frf, few)
    if stated is not None:
        poles = problem.search(poles, further)
    else:
        poles = problem.by_pieces(poles, ModalProblem.climb)
        # the noise is known better the more modes are known: once for the strong ones, once for all
        for all_known in (False, True):
            model = problem.model(poles)
            left = np.abs(values - model) ** 2
            square, width = from_coherence or (left, n_lines)
            weight = _weight_of_squares(square, width, model)
            # where the fit leaves more than that, as where the force is nearly zero, that is the noise
            # (mirrored at the ends, because the first line if repeated would alone set the noise there)
            if all_known or from_coherence is None:
                level = scipy.ndimage.median_filter(left * weight**2, (_LOCAL, 1), mode="reflect") / np.log(2)
                weight /= np.sqrt(np.maximum(level, _LEAST_LEVEL if from_coherence is None else 1.0))
            problem = ModalProblem(frequency, values, weight, frf.quantity)
            poles = problem.search(poles, further)
    poles = problem.climb(poles, fine=True)
    incoherence = None if frf.coherence is None else 1 - frf.coherence.reshape(n_lines, -1)[:, few]
    squares = None if from_coherence is None else from_coherence[0]
    review = PoleReview(problem, poles, incoherence, squares, frf.averages, told=stated is not None)
    is_mode = review.review()
    low, high = ends_hz
    is_mode = is_mode & (review.frequency_hz >= low) & (review.frequency_hz < high)
    doubtful = tuple(doubt for doubt in review.doubtful if low <= doubt.frequency_hz < high)
    lines_wide = lines.count * review.width_hz / review.line_step_hz(review.frequency_hz)
    moved = np.where(review.leaking, _LEAKAGE / lines_wide**2, 0.0)
    return _PoleFit(problem, review.poles, is_mode, moved, doubtful, lines, ends_hz)


def _first_weight(values: ComplexArray, stated: Array | None) -> Array:
    """One over the standard deviations that are stated, or assumed."""
    return 1 / (_UNKNOWN.sd_of_part(np.abs(values)) + np.finfo(float).tiny) if stated is None else stated**-0.5


def _lines_inside(frf: FrfSet, variance: Array | None, band_hz: Band) -> Flags:
    low, high = band_hz
    inside = np.asarray((frf.frequency_hz >= (low or 0.0)) & (frf.frequency_hz <= (high or np.inf)))
    if (n_lines := int(inside.sum())) < _FEWEST_LINES:
        band = "" if low is high is None else f" between {low or 0:g} and {high or frf.frequency_hz[-1]:g} Hz"
        found = f"{n_lines} lines{band}"
        raise refusal("modal fit", found, f"{_FEWEST_LINES} or more", "widen the band or refine lines")
    if variance is not None and (variance.shape != frf.values.shape or not (variance > 0).all()):
        found = f"a variance of shape {variance.shape}"
        raise refusal("modal fit", found, f"positive numbers of shape {frf.values.shape}", "correct it")
    return inside


#: Values that poles are sought in, and FRFs at least: more tell hardly more of a pole, and each costs the same again.
_MOST_VALUES, _FEWEST_FRFS = 30_000, 6
#: A band of more lines is fitted in sub-bands of about so many, each with a part of its lines more on either side.
_MOST_LINES, _SUB_BAND, _OVERLAP = 3201, 1200, 8
#: Of many more lines, spaced evenly to within this factor, those are joined that leave so many above half of the height
#: of the sharpest peak, which is looked for after a mean over some; what takes its error from a mean adds to its noise.
_EVEN, _ON_A_PEAK, _SMOOTHED, _LOUDER = 1.01, 24, 9, (13 / 12) ** 2 + 2 / 24**2
#: Order of the models by which further modes of a sub-band are sought.
_FURTHER = 24
#: Below this many lines there is nothing to fit: fourteen numbers for the rest and four for one mode need more values.
_FEWEST_LINES = 16
#: Noise where nothing is known of it, and the least that a coherence is believed.
_UNKNOWN, _LEAST = RelativeNoise(0.03, 0.01), RelativeNoise(1e-3, 0.0)
#: A Hann window makes resonances of w lines wider by about so much over w², and moves them by as much of half a width.
_LEAKAGE = 0.3
#: Lines over which the level of what a fit leaves is judged, and its least over the law of magnitude and frequency.
_LOCAL, _LEAST_LEVEL = 41, 1e-3
#: What a fit of exact FRFs leaves, relative to these: no noise is less.
_ROUNDING = 1e-12


def _few_of(shape: tuple[int, ...]) -> Indices:
    """Numbers of the FRFs among (lines, frfs) in which poles are sought."""
    lines, frfs = shape
    return np.linspace(0, frfs - 1, min(frfs, max(_FEWEST_FRFS, _MOST_VALUES // lines))).round().astype(np.intp)


def _noise_squares(frf: FrfSet, few: Indices) -> tuple[Array, int] | None:
    """σ² as coherence and averages estimate it line by line, and how many lines hold 40 degrees of freedom.

    None where they do not tell. At one line σ² has 2(n − 1) degrees of freedom: weights as uncertain as that would
    spoil the fit.
    """
    try:
        square = np.maximum(coherence_variance(frf), _LEAST.variance(frf.values)).reshape(frf.n_lines, -1)
    except MeasurementError:
        return None
    assert frf.averages is not None
    return square if few.size == square.shape[1] else square[:, few], 1 + 2 * (20 // (2 * (frf.averages - 1)))


def _weight_of_squares(square: Array, width: int, model: ComplexArray) -> Array:
    """One over the noise of which each square is a rough estimate of σ².

    ln σ² is a parabola in ln|H| plus one in f, as likely as the squares allow; times the mean over `width` lines of
    what that leaves, for noise that depends on frequency as such.
    """
    weight = np.empty(square.shape)
    count, half = len(square), width // 2
    line = np.linspace(-1, 1, count)
    first, last = (np.clip(np.arange(count) + shift, 0, count) for shift in (-half, half + 1))
    square = np.maximum(square, (_ROUNDING * np.abs(model)) ** 2)
    for k in range(square.shape[1]):
        magnitude = np.abs(model[:, k])
        level = np.log(magnitude + 1e-3 * np.median(magnitude) + np.finfo(float).tiny)
        level = (level - level.mean()) / max(level.std(), 1e-6)
        columns = np.column_stack([np.ones(count), level, level**2, line, line**2])
        # coefficients c of E[square] = exp(columns c) for exponentially distributed squares, by Fisher scoring
        c = np.append(np.log(square[:, k].mean() + np.finfo(float).tiny), np.zeros(columns.shape[1] - 1))
        for _ in range(30):
            excess = np.minimum(square[:, k] / np.exp(columns @ c), 50.0) - 1
            step = scipy.linalg.lstsq(columns, excess)[0]
            c = c + np.clip(step, -1, 1)
            if np.abs(step).max() < 1e-6:
                break
        law = np.exp(columns @ c)
        ratio = square[:, k] / law
        total = np.concatenate([[0.0], np.cumsum(ratio)])
        # far below the sum before it, a difference of sums is rounding: no mean is below the smallest of its terms
        least = scipy.ndimage.minimum_filter1d(ratio, 2 * half + 1, mode="nearest")
        weight[:, k] = (law * np.maximum((total[last] - total[first]) / (last - first), least)) ** -0.5
    return weight


def _modes_of(fits: list["_PoleFit"]) -> tuple[tuple[MeasuredMode, ...], Array]:
    """Modes of all sub-bands, and the covariance of their frequencies in Hz and then their damping ratios."""
    each = [fitted.modes() for fitted in fits]
    modes = tuple(mode for modes, _ in each for mode in modes)
    # of each sub-band frequencies and then damping ratios: of all the former stand before all the latter
    is_damping = np.concatenate([np.repeat([False, True], len(few)) for few, _ in each])
    order = np.argsort(is_damping, kind="stable")
    return modes, scipy.linalg.block_diag(*(block for _, block in each))[np.ix_(order, order)]


@dataclass(frozen=True, slots=True, eq=False)
class _PoleFit:
    """Poles of least squares and which of them are modes.

    Leakage may have moved each pole by `moved` times its distance from the imaginary axis. Between the ends the fit
    answers for the lines: the others are of the next sub-bands.
    """

    problem: ModalProblem
    poles: ComplexArray
    is_mode: Flags
    moved: Array
    doubtful: tuple[DoubtfulMode, ...]
    lines: _Joined
    ends_hz: tuple[float, float]

    def _core(self, frequency_hz: Array) -> Flags:
        return (frequency_hz >= self.ends_hz[0]) & (frequency_hz < self.ends_hz[1])

    def in_core(self) -> tuple[Array, ComplexArray, Array, ComplexArray]:
        """Lines in Hz, values, weights and the model of the core."""
        problem, lines = self.problem, self.problem.omega / (2 * np.pi)
        core = self._core(lines)
        return lines[core], problem.values[core], problem.weight[core], problem.model(self.poles)[core]

    def all_values(self, quantity: Quantity) -> tuple[float, int, ComplexArray]:
        """χ², its degrees of freedom and the model of all FRFs at all lines of the core, shape (lines, frfs)."""
        chi2, freedom, models = 0.0, 0, []
        frf, variance, count = self.lines.every, self.lines.every_variance, self.problem.values.shape[1]
        values = frf.values.reshape(frf.n_lines, -1)
        if values.shape == self.problem.values.shape:
            weight = self.problem.weight
        else:
            weight = _first_weight(values, None if variance is None else variance.reshape(values.shape))
        for first in range(0, values.shape[1], count):  # as many at once as poles were sought in
            some = slice(first, first + count)
            few = ModalProblem(frf.frequency_hz, values[:, some], weight[:, some], quantity)
            chi2, freedom = chi2 + few.chi2(self.poles), freedom + few.freedom(self.poles.size)
            models.append(few.model(self.poles))
        return chi2, freedom, np.hstack(models)[self._core(frf.frequency_hz)]

    def modes(self) -> tuple[tuple[MeasuredMode, ...], Array]:
        """Modes, and the covariance of their frequencies in Hz and then their damping ratios."""
        numbers = np.flatnonzero(np.tile(self.is_mode, 2))
        if not numbers.size:
            return (), np.zeros((0, 0))
        unit = np.repeat([1 / (2 * np.pi), 1.0], self.poles.size)
        leakage = np.concatenate([-self.poles.real, -self.poles.real / np.abs(self.poles)]) * np.tile(self.moved, 2)
        covariance = self.problem.covariance(self.poles) + np.diag(leakage**2)
        covariance = (covariance * np.outer(unit, unit))[np.ix_(numbers, numbers)]
        poles = self.poles[self.is_mode]
        sd_hz, sd_damping = np.sqrt(np.diag(covariance)).reshape(2, -1).tolist()
        modes = tuple(
            MeasuredMode(float(abs(p) / (2 * np.pi)), sd, float(-p.real / abs(p)), sd_zeta)
            for p, sd, sd_zeta in zip(poles, sd_hz, sd_damping, strict=True)
        )
        return modes, covariance
