"""Simulated measurements: FRFs as an analyser writes them, and time histories of a test."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from vibrecords.arrays import Array, ComplexArray, Indices, Quantity
from vibrecords.formats.units import MOTION_OF, SI_SENSOR
from vibrecords.frf_set import FrfSet
from vibrecords.records import TimeRecord
from vibrecords.variance import NoiseLaw


def noisy_frf(true: FrfSet, law: NoiseLaw, averages: int, rng: np.random.Generator) -> FrfSet:
    """H1 estimates and their coherence from `averages` averages with noise at the output.

    The noise of each average is n times that of the result, the input the same in each, as for a hammer. Then the mean
    and the sum of squares about it are independent (Cochran), so that the averages themselves need not be drawn:
    H1 = H + noise of variance σ², and γ² = |H1|²/(|H1|² + r) with r/σ² from a gamma distribution of shape n − 1.

    Parameters
    ----------
    true
        Exact FRFs.
    law
        Law of the noise that is left after averaging; its σ² is taken at the exact FRF.
    averages
        Number n of averages; a single one has no coherence that says anything, and gets none.
    rng
        Source of the noise.

    Returns
    -------
    FrfSet
        With coherence and averages.

    References
    ----------
    Bendat, J. S., Piersol, A. G. (2010). Random Data, 4th ed., section 9.2. DOI 10.1002/9781118032428
    """
    variance = law.variance(true.values)
    real, imag = rng.standard_normal((2, *true.values.shape))
    values = true.values + np.sqrt(variance / 2) * (real + 1j * imag)
    square, coherence = np.abs(values) ** 2, None
    if averages > 1:
        coherence = square / (square + variance * rng.standard_gamma(averages - 1, true.values.shape))
    return FrfSet(true.frequency_hz, values, true.outputs, true.inputs, true.quantity, coherence, averages)


def channel_label(dof: str) -> str:
    """Label of a DOF as files of universal format have it.

    Examples
    --------
    >>> channel_label("11:y"), channel_label("1:rz")
    ('Point:11:Y+', 'Point:1:RZ+')
    """
    node, direction = dof.split(":")
    return f"Point:{node}:{direction.upper()}+"


def lines_apart(frequency_hz: Array, spacing_hz: float) -> Indices:
    """Numbers of lines that are at least `spacing_hz` apart, from the first on; for even and uneven lines."""
    kept = [0]
    for i in range(1, frequency_hz.size):
        if frequency_hz[i] - frequency_hz[kept[-1]] >= spacing_hz * (1 - 1e-6):
            kept.append(i)
    return np.array(kept, dtype=np.intp)


_NOMINAL_N = 100.0
_SPREAD = 0.25  # of the logarithm of the peak force from hit to hit
_MOST = 2.0  # times the nominal peak, for a hit that is not meant to overload
_FORCE_RANGE = 2.5  # full scale over the nominal peak
_RESPONSE_RANGE = 4.0  # a shorter pulse moves accelerometers more than a stronger one


@dataclass(frozen=True, slots=True)
class Rig:
    """A structure under test, its sensors and the analyser.

    Parameters
    ----------
    frf
        Exact FRFs (lines, outputs, inputs) at lines (lines,) above 0 Hz; displacement, velocity or acceleration, as
        `quantity` says, per newton.
    outputs, inputs
        DOF labels.
    quantity
        What the sensors make of it.
    sample_rate_hz
        Samples per second.
    block
        Samples of a block.
    decay_s
        Time in which all that a hit stirs is gone, s.
    """

    frf: Callable[[Array], ComplexArray]
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    quantity: Quantity
    sample_rate_hz: float
    block: int
    decay_s: float

    def responding(self, samples: int) -> tuple[int, Callable[[Array, int], Array]]:
        """A period of `samples` samples at least, and the response to a force of that period, exact at each line of it.

        It is that of all outputs (period, outputs) to a force (period,) at one input, which is counted from 0.
        """
        period = int(fft.next_fast_len(samples, real=True))
        lines = np.fft.rfftfreq(period, 1 / self.sample_rate_hz)
        values = np.zeros((lines.size, len(self.outputs), len(self.inputs)), dtype=complex)
        values[1:] = self.frf(np.asarray(lines[1:], dtype=float))
        values[0] = values[1].real  # static; the model may not have 0 Hz
        return period, lambda force, j: fft.irfft(fft.rfft(force)[:, None] * values[:, :, j], period, axis=0)

    def records(self, number: int, input_: str, force: Array, responses: Sequence[Array]) -> Iterator[TimeRecord]:
        """Records of one hit, or one run of the shaker: of the force on an input, and of every output."""
        rate, motion, where = self.sample_rate_hz, MOTION_OF[self.quantity], "virtual test"
        yield TimeRecord(channel_label(input_), rate, force, "force", "N", number, where)
        for output, values in zip(self.outputs, responses, strict=True):
            yield TimeRecord(channel_label(output), rate, values, motion, SI_SENSOR[motion], number, where)


@dataclass(frozen=True, slots=True)
class ChannelNoise:
    """White noise of the channels.

    Parameters
    ----------
    force, response
        Standard deviation as a fraction of the channel's peak in a nominal hit, or, with a shaker, of its own.
    """

    force: float = 0.0005
    response: float = 0.001


@dataclass(frozen=True, slots=True)
class Hammer:
    """How the hammer is swung.

    Parameters
    ----------
    hits
        Good hits at each input.
    pulse_s
        Nominal length of the half-sine pulse, s; each is 20 % shorter to 10 % longer.
    double_hits, overloads
        Further hits at each input that bounce, or exceed the range, at random places among the good ones.
    pretrigger_s
        Time before the pulse in each block, s.
    """

    hits: int
    pulse_s: float
    double_hits: int = 0
    overloads: int = 0
    pretrigger_s: float = 0.01


def half_sine(samples: int, sample_rate_hz: float, start_s: float, length_s: float, peak: float) -> Array:
    """Half-sine pulse, shape (samples,); it may begin between two samples."""
    phase = (np.arange(samples) / sample_rate_hz - start_s) / length_s
    return np.where((phase > 0) & (phase < 1), peak * np.sin(np.pi * phase), 0.0)


def hammer_records(rig: Rig, hammer: Hammer, noise: ChannelNoise, rng: np.random.Generator) -> Iterator[TimeRecord]:
    """Records of a hammer test: for each hit the block of the force and of each response.

    Hits are counted through over the inputs. Noise and range of a channel are the same for all hits.

    Yields
    ------
    TimeRecord
        Force first, then the outputs in order; `hit` says which belong together.
    """
    period, respond = rig.responding(rig.block + round(rig.decay_s * rig.sample_rate_hz))
    number = 0
    for j, input_ in enumerate(rig.inputs):
        scale = np.abs(respond(_force(period, rig, hammer, 1.0, 1.0), j)).max(axis=0)
        kinds = np.repeat(["good", "double", "overload"], [hammer.hits, hammer.double_hits, hammer.overloads])
        for kind in rng.permutation(kinds):
            number += 1
            force = _swing(str(kind), period, rig, hammer, rng)
            moved = respond(force, j)[: rig.block]
            measured = _sense(force[: rig.block], _NOMINAL_N, noise.force, _FORCE_RANGE, rng)
            responded = [
                _sense(values, float(largest), noise.response, _RESPONSE_RANGE, rng)
                for values, largest in zip(moved.T, scale, strict=True)
            ]
            yield from rig.records(number, input_, measured, responded)


def _force(samples: int, rig: Rig, hammer: Hammer, strength: float, length: float) -> Array:
    return half_sine(samples, rig.sample_rate_hz, hammer.pretrigger_s, length * hammer.pulse_s, strength * _NOMINAL_N)


def _swing(kind: str, samples: int, rig: Rig, hammer: Hammer, rng: np.random.Generator) -> Array:
    """Force of one hit, shape (samples,), N."""
    strength = min(float(rng.lognormal(0.0, _SPREAD)), _MOST)
    length = float(rng.uniform(0.8, 1.1))
    if kind == "overload":
        strength = float(rng.uniform(1.5, 2.5)) * _FORCE_RANGE
    force = _force(samples, rig, hammer, strength, length)
    if kind == "double":
        again = hammer.pretrigger_s + float(rng.uniform(3.0, 10.0)) * hammer.pulse_s
        weaker = float(rng.uniform(0.2, 0.6)) * strength * _NOMINAL_N
        force = force + half_sine(samples, rig.sample_rate_hz, again, length * hammer.pulse_s, weaker)
    return force


def _sense(true: Array, scale: float, noise: float, most: float, rng: np.random.Generator) -> Array:
    """What a channel makes of a signal: noise added, cut off at its range, `most` times its scale."""
    return np.clip(true + noise * scale * rng.standard_normal(true.size), -most * scale, most * scale)


def shaker_records(rig: Rig, samples: int, noise: ChannelNoise, rng: np.random.Generator) -> Iterator[TimeRecord]:
    """Records of a test with white random force, one input after the other, in the steady state.

    Parameters
    ----------
    rig
        Structure, sensors, analyser.
    samples
        Samples of each record.
    noise
        On the channels.
    rng
        Source of force and noise.

    Yields
    ------
    TimeRecord
        Force first, then the outputs in order; `hit` counts the inputs.
    """
    period, respond = rig.responding(samples + round(rig.decay_s * rig.sample_rate_hz))
    for j, input_ in enumerate(rig.inputs):
        # a random force that repeats after the record's end has no beginning: no transient to wait for
        force = _NOMINAL_N * rng.standard_normal(period)
        moved = respond(force, j)[:samples]
        force = force[:samples] + noise.force * _NOMINAL_N * rng.standard_normal(samples)
        responded = [values + noise.response * float(values.std()) * rng.standard_normal(samples) for values in moved.T]
        yield from rig.records(j + 1, input_, force, responded)
