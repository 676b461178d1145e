"""What can be judged of a measured FRF: its mobility, its noise, its resonances, the sense of its phase and shifts."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its parts load at first use

from vibrecords.arrays import Array, Band, ComplexArray, Quantity, quantity_factor, stretch_about
from vibrecords.driven import driven_lines
from vibrecords.provenance import MeasurementWarning
from vibrecords.records import HIGHEST_HZ, FrfRecord, measurable, parse_dof
from vibrecords.warnings.kinds import warn

#: A resonance rises above both sides by this factor, up to where it is higher, and above the noise by that.
_RISE, _ABOVE_NOISE = 3.0, 10.0
#: A phase turns by so much at least across a resonance, rad, and is clear where the noise is below by this factor.
_QUARTER, _CLEAR = np.pi / 4, 4.0
#: Share of the evidence on one side from which on FRFs are conjugates or are not.
_SURE = 0.8


@dataclass(frozen=True, slots=True)
class Resonance:
    """A peak of an FRF: its frequency, cosine of the phase of mobility there, and lines above half its power.

    `turn` is −1 where the phase clearly falls through it, 1 where it rises, and between where lines are too coarse;
    `height` is the magnitude of the mobility. `centre_hz` is the mean of the lines above half power, weighted with the
    power.
    """

    frequency_hz: float
    cosine: float
    lines: int
    turn: float
    height: float
    centre_hz: float


def pair_of(record: FrfRecord) -> tuple[str, str, int]:
    """DOFs of response and reference without their signs, and the product of the signs."""
    names, sign = [], 1
    for label in (record.response, record.reference):
        dof = parse_dof(label)
        if dof is None:
            names.append(label.strip())
            continue
        sign *= -1 if dof.direction < 0 else 1
        names.append(f"{dof.entity}:{dof.node}:{abs(dof.direction)}")
    return names[0], names[1], sign


def usable(record: FrfRecord) -> FrfRecord:
    """Return the record without lines at or below 0 Hz, NaN, zeros, absurd numbers, lines out of order.

    Without a coherence of other lines as well.
    """
    f = record.frequency_hz
    good = (f >= 1 / HIGHEST_HZ) & (f <= HIGHEST_HZ) & measurable(record.values) & (record.values != 0)
    good[good] = np.diff(np.maximum.accumulate(f[good]), prepend=0.0) > 0
    if record.coherence is not None and record.coherence.shape != f.shape:
        record = replace(record, coherence=None)
    return record if good.all() else record.at_lines(good)


@dataclass(frozen=True, eq=False)
class ClearFrf:
    """The usable lines of an FRF of known quantity as mobility, signs of directions taken out; and where it is from."""

    response: str
    reference: str
    quantity: Quantity
    frequency_hz: Array
    mobility: ComplexArray

    @classmethod
    def of(cls, record: FrfRecord) -> "ClearFrf | None":
        """What can be judged of a record; None where it has too few usable lines or no quantity."""
        good = usable(record)
        if good.quantity is None or good.frequency_hz.size < 16:
            return None
        response, reference, sign = pair_of(good)
        mobility = sign * good.values * quantity_factor(good.frequency_hz, "mobility", good.quantity)
        return cls(response, reference, good.quantity, good.frequency_hz, mobility)

    def excitation(self, record: FrfRecord) -> tuple[Array, Array]:
        """Coherence of the record that this was made of, and noise over the force in the quantity that was measured.

        Without a coherence that tells both are made of the scatter of neighbouring lines: of noise alone the magnitude
        is about as large as that.
        """
        coherence, size, noise = usable(record).coherence, np.abs(self.mobility), self.noise
        if coherence is None or not ((coherence >= 0) & (coherence <= 1)).all() or (coherence >= 1 - 1e-9).all():
            coherence = 1 / (1 + (2 * noise / size) ** 2)
        else:
            noise = size * np.sqrt((1 - coherence) / np.maximum(coherence, 1e-6))
        return coherence, noise / np.abs(quantity_factor(self.frequency_hz, "mobility", self.quantity))

    def driven(self, record: FrfRecord) -> "ClearFrf":
        """The lines that the test drove, by the coherence of the record that this was made of."""
        which = driven_lines(*self.excitation(record))
        if which == slice(0, self.frequency_hz.size):
            return self
        return replace(self, frequency_hz=self.frequency_hz[which], mobility=self.mobility[which])

    @cached_property
    def noise(self) -> Array:
        """Rough standard deviation of the noise by line, from third differences; too large rather than too small."""
        # Σ of squares of 1, 3, 3, 1 is 20; the median of an exponential distribution is ln 2 times its mean
        square = np.abs(np.diff(self.mobility, 3)) ** 2 / (20 * np.log(2))
        # mirrored at the ends, because the first line if repeated would alone set the noise there
        local = scipy.ndimage.median_filter(square, size=min(41, square.size), mode="reflect")
        return np.asarray(np.sqrt(np.concatenate([local[:1], local[:1], local, local[-1:]])))

    @cached_property
    def resonances(self) -> tuple[Resonance, ...]:
        """Peaks of |mobility| that stand out from their surroundings and from the noise."""
        magnitude = np.abs(self.mobility)
        resonances = []
        for top in scipy.signal.find_peaks(np.log(magnitude), prominence=np.log(_RISE))[0].tolist():
            if magnitude[top] < _ABOVE_NOISE * self.noise[top]:
                continue
            first, last = stretch_about(magnitude < magnitude[top] / np.sqrt(2), top)
            total = self.mobility[first:last].sum()
            cosine = float(total.real / abs(total))
            across = slice(max(first - 1, 0), last + 1)
            steps = np.angle(self.mobility[across][1:] * self.mobility[across][:-1].conj())
            # a step of nearly π may have gone either way; a hump between resonances turns by little
            turn = float(np.sign(steps.sum()) * (1 - np.abs(steps).max() / np.pi))
            if abs(steps.sum()) < _QUARTER or (magnitude[across] < _CLEAR * self.noise[across]).any():
                turn = 0.0
            centre = float(np.average(self.frequency_hz[first:last], weights=magnitude[first:last] ** 2))
            peak = float(self.frequency_hz[top]), cosine, int(last - first), turn, float(magnitude[top]), centre
            resonances.append(Resonance(*peak))
        return tuple(resonances)

    def turns(self, band_hz: Band = (None, None)) -> Array:
        """Return how clearly the phase falls, and rises, through the resonances of a band, shape (2,).

        Each resonance counts by its height over the highest, so that bumps of the noise decide nothing next to a mode.
        With the time factor exp(+iωt) the phase of each residue over (iω − λ) falls by π at its resonance, because a
        passive structure has Re λ < 0. That holds for receptance, mobility and accelerance, for drive points and
        others, and for either sign; with exp(−iωt) it rises.
        """
        low, high = band_hz[0] or 0.0, band_hz[1] or np.inf
        peaks = [peak for peak in self.resonances if low <= peak.frequency_hz <= high]
        highest = max((peak.height for peak in peaks), default=1.0)
        turns = np.array([peak.turn * peak.height / highest for peak in peaks])
        return np.array([-turns[turns < 0].sum(), turns[turns > 0].sum()])

    @property
    def conjugate(self) -> "ClearFrf":
        """The same for the other time factor."""
        sign = 1.0 if self.quantity == "mobility" else -1.0  # conj(H) (iω)ⁿ against conj(H (iω)ⁿ)
        return replace(self, mobility=sign * self.mobility.conj())


def are_conjugates(turns: Array, least: float) -> bool | None:
    """Whether FRFs are complex conjugates, by their `turns`; None with less than the `least` sum, or two voices."""
    falling, rising = turns.tolist()
    if falling + rising < least or max(falling, rising) < _SURE * (falling + rising):
        return None
    return bool(rising > falling)


#: A shift counts from this fraction of the half-power width on: of the same FRF, and of FRFs of other responses, whose
#: peaks other modes move.
_SAME, _OTHER = 0.3, 0.5
#: Resonances that must shift one way in FRFs of other responses.
_FEWEST = 3


@dataclass(frozen=True, slots=True, eq=False)
class Peaks:
    """Resolved resonances of one FRF: centre and half-power width, Hz; distance of the lines; and where it is from."""

    where: str
    centre_hz: Array
    width_hz: Array
    step_hz: float

    @classmethod
    def of(cls, where: str, clear: ClearFrf) -> "Peaks":
        """Resonances of at least three lines."""
        f = clear.frequency_hz
        step = float((f[-1] - f[0]) / (f.size - 1))
        peaks = [p for p in clear.resonances if p.lines >= 3]
        return cls(where, np.array([p.centre_hz for p in peaks]), np.array([p.lines * step for p in peaks]), step)


def shift_warning(first: Peaks, other: Peaks, *, same_frf: bool) -> MeasurementWarning | None:
    """Warning where resonances of the second FRF have moved from those of the first; None where they have not.

    Its key is ``"level_dependence"`` of the same FRF twice, and ``"mass_loading"`` of other responses to one force,
    where all that have moved must have moved one way.
    """
    if not first.centre_hz.size or not other.centre_hz.size:
        return None
    distance = np.abs(first.centre_hz[:, None] - other.centre_hz)
    mine, theirs = np.arange(len(distance)), distance.argmin(axis=1)
    width = np.sqrt(first.width_hz * other.width_hz[theirs])
    alike = np.abs(np.log(first.width_hz / other.width_hz[theirs])) < np.log(2)
    near = (distance.argmin(axis=0)[theirs] == mine) & (distance[mine, theirs] < 4 * width) & alike
    shift = (other.centre_hz[theirs] - first.centre_hz)[near]
    reach = (_SAME if same_frf else _OTHER) * width[near] + max(first.step_hz, other.step_hz)
    moved = np.abs(shift) > reach
    one_way = min((moved & (shift > 0)).sum(), (moved & (shift < 0)).sum()) == 0
    if not moved.any() or (not same_frf and (moved.sum() < max(_FEWEST, near.sum() / 2) or not one_way)):
        return None
    relative = 100 * shift[moved] / first.centre_hz[near][moved]
    largest = int(np.argmax(np.abs(relative)))
    change = f"{abs(relative[largest]):.2g} % {'lower' if relative[largest] < 0 else 'higher'}"
    at = f"{first.centre_hz[near][moved][largest]:.5g} Hz"
    where = f"{int(moved.sum())} of {int(near.sum())} resonances are elsewhere, that at {at} {change}"
    return warn("level_dependence" if same_frf else "mass_loading", where=where)
