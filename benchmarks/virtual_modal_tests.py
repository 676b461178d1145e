"""Virtual modal tests of closed-form beams, simulated in time: what `benchmarks.modal_fit` identifies.

Modes are those of uniform Euler-Bernoulli beams, from the roots of their frequency equations; some beams bend in two
planes. The response to a force that is linear between samples is exact at the samples, mode by mode, so that the poles
of the sampled FRFs are those of the beam. FRFs are H1 estimates over blocks. Some kinds are hard to read: random blocks
leak, half sines have zeros in their spectrum, a single hit has no coherence and a drift, a window damps and makes noise
smooth, and a shaker drives part of the band only.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.signal import butter, lfilter, sosfiltfilt

from vibrecords import FrfSet

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

RING_DOWN, CUT_OFF, HANN = "hits that ring down", "hits cut off by the block", "random blocks with a Hann window"
ONE_HIT, ZEROS = "one hit on a free beam", "hits whose force has zeros"
EXPONENTIAL, PARTLY_DRIVEN = "an exponential window", "a shaker that drives part of the band"
KINDS = (RING_DOWN, CUT_OFF, HANN, ONE_HIT, ZEROS, EXPONENTIAL, PARTLY_DRIVEN)
#: What cos βL cosh βL is; of a pinned beam sin βL is 0.
_ENDS = {"clamped-free": -1.0, "free-free": 1.0, "clamped-clamped": 1.0, "pinned-pinned": 0.0}


@dataclass(frozen=True)
class Modes:
    """Natural frequencies, Hz, damping ratios, and shapes of unit modal mass, shape (modes, DOFs)."""

    frequency_hz: Array
    damping: Array
    shapes: Array

    @property
    def poles(self) -> Complex:
        """λ, rad/s."""
        return 2 * np.pi * self.frequency_hz * (-self.damping + 1j * np.sqrt(1 - self.damping**2))

    def accelerance(self, frequency_hz: Array) -> Complex:
        """Exact FRFs of all DOFs over a force at the first, shape (lines, DOFs)."""
        omega, omega_r = 2 * np.pi * frequency_hz[:, None], 2 * np.pi * self.frequency_hz
        modal = -(omega**2) / (omega_r**2 - omega**2 + 2j * self.damping * omega_r * omega)
        return modal @ (self.shapes * self.shapes[:, :1])


@dataclass(frozen=True)
class VirtualTest:
    """FRFs as an analyser writes them, the modes in truth, and what each stands above the noise, in dB."""

    kind: str
    notches: bool
    frf: FrfSet
    truth: Modes
    above_noise_db: Array
    width_in_lines: Array


def beam_roots(ends: str, count: int) -> Array:
    """First β L of a uniform beam, those of rigid motions left out."""
    order = np.arange(1, count + 1)
    if ends == "pinned-pinned":
        return np.pi * order
    guess = np.pi * (order - 0.5) if ends == "clamped-free" else np.pi * (order + 0.5)

    def equation(x: float) -> float:
        return float(np.cos(x) - _ENDS[ends] / np.cosh(x))

    return np.array([brentq(equation, g - 0.4 if g > 1.6 else 1.6, g + 0.4) for g in guess])


def beam_shapes(ends: str, roots: Array, x: Array) -> Array:
    """Shapes of unit mean square at x in 0…1, shape (roots, x), in exponentials that do not overflow."""
    b, bx = roots[:, None], roots[:, None] * x
    if ends == "pinned-pinned":
        return np.sqrt(2) * np.sin(bx)
    sign = -1.0 if ends.startswith("clamped") else 1.0  # of the trigonometric functions beside the hyperbolic ones
    plus = 1.0 if ends == "clamped-free" else -1.0
    # cosh βx + s cos βx − r (sinh βx + s sin βx), r = (cosh β ± cos β)/(sinh β ± sin β); all times exp(−β)
    e = np.exp(-b)
    upper, lower = (1 + e**2) / 2 + plus * e * np.cos(b), (1 - e**2) / 2 + plus * e * np.sin(b)
    ratio = upper / lower
    hyperbolic = ((lower - upper) / lower / e * np.exp(bx - b) + (1 + ratio) * np.exp(-bx)) / 2
    return np.asarray(hyperbolic + sign * (np.cos(bx) - ratio * np.sin(bx)))


def random_beam(rng: np.random.Generator, sensors: int, highest_hz: float, *, free: bool = False) -> Modes:
    """Draw a beam with three to seven modes below `highest_hz`, and all up to three times that."""
    while True:
        ends = "free-free" if free else str(rng.choice(list(_ENDS)))
        below = int(rng.integers(3, 8))
        roots = beam_roots(ends, 2 * below + 4)
        at = rng.uniform(0.05, 0.98, sensors)
        frequency = highest_hz * rng.uniform(0.75, 0.95) * (roots / roots[below - 1]) ** 2
        shapes = beam_shapes(ends, roots, at)
        if rng.random() < 0.4:  # a second plane of bending, which sensors see under other angles
            angle = rng.uniform(0.2, 1.3, sensors)
            frequency = np.concatenate([frequency, frequency * rng.uniform(1.03, 1.6)])
            shapes = np.vstack([shapes * np.cos(angle), shapes * np.sin(angle)])
        order = np.argsort(frequency)
        frequency, shapes = frequency[order], shapes[order]
        kept = frequency < 2.4 * highest_hz
        damping = np.exp(rng.uniform(np.log(0.001), np.log(0.02), frequency.size))
        damping = np.maximum(damping, 0.0005 * highest_hz / frequency)  # no block is longer than a ring-down of these
        modes = Modes(frequency[kept], damping[kept], shapes[kept])
        f, z = modes.frequency_hz, modes.damping
        widths = 2 * f * z
        apart = np.diff(f) / np.maximum(widths[:-1], widths[1:])
        if (apart[f[:-1] < highest_hz] > 2.0).all():
            return modes


def _modal_responses(modes: Modes, force: Array, step_s: float) -> Array:
    """Accelerations of unit modal amplitude to a force linear between samples, shape (modes, samples)."""
    out = []
    for pole in modes.poles:
        a = np.exp(pole * step_s)
        after = (a - 1 - pole * step_s) / (pole**2 * step_s)
        before = (a - 1) / pole - after
        state = lfilter([after, before], [1, -a], force)
        out.append(2 * np.real(pole**2 / (2j * pole.imag) * state) + force)
    return np.array(out)


def simulate(index: int, seed: int = 1) -> VirtualTest:
    """Simulate one virtual test: its kind follows from the number, all else is drawn."""
    rng = np.random.default_rng([seed, index])
    kind, sensors, notches = KINDS[index % len(KINDS)], 1 + (index // len(KINDS)) % 5, rng.random() < 0.5
    highest, rate = 1000.0, 5000.0
    one_hit, random = kind == ONE_HIT, kind in (HANN, PARTLY_DRIVEN)
    modes = random_beam(rng, sensors, highest, free=one_hit)
    inside = modes.frequency_hz < highest
    slowest = float((modes.damping * modes.frequency_hz)[inside].min())
    # decay over a block: exp(−2π·slowest·T)
    decays = {RING_DOWN: (5, 9), ZEROS: (3, 9), ONE_HIT: (3, 9), HANN: (3, 12), PARTLY_DRIVEN: (8, 16)}
    block_s = rng.uniform(*decays.get(kind, (1.2, 3))) / (2 * np.pi * slowest)
    samples = 2 * int(np.clip(block_s, 0.25, 2.0) * rate / 2)
    averages = 1 if one_hit else int(rng.integers(10, 60)) if random else int(rng.integers(3, 11))
    window, rate_of_window = np.ones(samples), 0.0
    if random:
        window = np.hanning(samples + 1)[:-1]
    elif kind == EXPONENTIAL:
        averages = int(rng.choice([1, 3, 5, 10]))
        rate_of_window = -np.log(10 ** rng.uniform(-3, -1)) * rate / samples
        window = np.exp(-rate_of_window * np.arange(samples) / rate)
    frequency = np.fft.rfftfreq(samples, 1 / rate)
    used = (frequency > 8.0) & (frequency <= highest)
    frequency = frequency[used]
    driven_hz = highest * (rng.uniform(0.3, 0.7) if kind == PARTLY_DRIVEN else 1.0)
    spectra_x, spectra_y, clean = _spectra(rng, modes, kind, (averages, samples, rate), window, used, driven_hz)
    peak = np.abs(clean).max()
    # white noise of the sensors, of a single hit with a part that grows towards 0 Hz
    level = np.sqrt(np.mean(np.abs(spectra_y) ** 2)) * 10 ** rng.uniform(-3, -1.5)
    noise = level * _noise(rng, (averages, sensors, samples), window, drift_hz=100.0 * one_hit)[..., used]
    if notches and not (kind == EXPONENTIAL and averages == 1):  # where a tone is a mode that only the window damps
        noise = noise + _hum(rng, (averages, sensors, samples, rate), window, peak)[..., used] * level * 30
    if notches:
        hole = rng.uniform(50, 950)
        gone = 1 - 0.995 * np.exp(-(((frequency - hole) / rng.uniform(2, 10)) ** 2))
        spectra_x, spectra_y, clean = spectra_x * gone, spectra_y * gone, clean * gone
    exact_x = spectra_x
    if kind in (ZEROS, ONE_HIT, PARTLY_DRIVEN):
        of_force = 10 ** rng.uniform(-4.5, -3.5) * np.abs(spectra_x).max()
        spectra_x = spectra_x + of_force * _noise(rng, (averages, samples), window)[..., used]
    xx = np.mean(np.abs(spectra_x) ** 2, axis=0)

    def over_force(y: Complex) -> Complex:
        return np.mean(y * spectra_x[:, None].conj(), axis=0) / xx

    measured = spectra_y + noise
    h1 = over_force(measured)
    coherence = np.abs(h1) ** 2 * xx / np.mean(np.abs(measured) ** 2, axis=0)
    states = averages > 1 and not (kind == PARTLY_DRIVEN and rng.random() < 0.5)
    frf = FrfSet(
        frequency,
        h1.T[:, :, None],
        tuple(f"{i + 1}:y" for i in range(sensors)),
        ("1:y",),
        "accelerance",
        np.clip(coherence, 1e-12, 1).T[:, :, None] if states else None,
        averages if states else None,
    )
    above = _above_noise(modes, clean, exact_x, h1.T, frequency)
    above[modes.frequency_hz > driven_hz] = -np.inf
    seen = modes.poles - rate_of_window  # the window damps each mode by as much
    in_frf = Modes(np.abs(seen) / (2 * np.pi), -seen.real / np.abs(seen), modes.shapes)
    width_in_lines = 2 * in_frf.damping * in_frf.frequency_hz * samples / rate
    return VirtualTest(kind, bool(notches), frf, in_frf, above, width_in_lines)


def _spectra(rng, modes, kind, sizes, window, used, driven_hz):
    """Spectra of force (blocks, lines), of responses (blocks, DOFs, lines), and of each mode (blocks, modes, lines)."""
    averages, samples, rate = sizes
    if kind in (HANN, PARTLY_DRIVEN):
        settle = 4 * samples
        force = rng.standard_normal(settle + averages * samples)
        if kind == PARTLY_DRIVEN:  # 60 dB less above
            force = force * 1e-3 + sosfiltfilt(butter(8, driven_hz, fs=rate, output="sos"), force)
        modal = _modal_responses(modes, force, 1 / rate)[:, settle:].reshape(-1, averages, samples).swapaxes(0, 1)
        force = force[settle:].reshape(averages, samples)
    else:
        # half sines, whose spectrum is zero at 1.5, 2.5 … over their length
        shortest, longest = (1.6e-3, 4e-3) if kind in (ZEROS, ONE_HIT) else (0.4e-3, 0.8e-3)
        length = rng.uniform(shortest, longest)
        pulses = []
        for _ in range(averages):
            if kind not in (ZEROS, ONE_HIT):
                length = rng.uniform(shortest, longest)
            width = max(int(length * rate), 2)
            pulse = np.zeros(samples)
            pulse[10 : 10 + width + 1] = rng.uniform(0.5, 2) * np.sin(np.pi * np.arange(width + 1) / width)
            pulses.append(pulse)
        force = np.array(pulses)
        modal = np.array([_modal_responses(modes, pulse, 1 / rate) for pulse in force])
    x = np.fft.rfft(window * force)[:, used]
    per_mode = np.fft.rfft(window * modal)[..., used]
    return x, np.einsum("brl,ro->bol", per_mode, modes.shapes * modes.shapes[:, :1]), per_mode


def _noise(rng, shape, window, drift_hz=0.0):
    """Spectra of white noise of unit power in each block, plus noise with a power of (drift_hz/f)²."""
    noise = rng.standard_normal(shape)
    if drift_hz:
        noise = noise + 2 * np.pi * drift_hz / 5000.0 * np.cumsum(rng.standard_normal(shape), axis=-1)
    return np.fft.rfft(window * noise) / np.sqrt(shape[-1])


def _hum(rng, sizes, window, peak):
    """The mains at every sensor, at 50 Hz and two multiples, of any phase in each block."""
    averages, sensors, samples, rate = sizes
    time = np.arange(samples) / rate
    tones = np.zeros((averages, sensors, samples))
    for multiple in (1, *rng.choice(np.arange(2, 19), 2, replace=False)):
        phase = rng.uniform(0, 2 * np.pi, (averages, sensors, 1))
        tones += rng.uniform(0.2, 1) * np.cos(2 * np.pi * 50 * multiple * time + phase)
    return np.fft.rfft(window * tones) / np.sqrt(samples)


def _above_noise(modes, clean, spectra_x, h1, frequency):
    """By how much each mode's share of the best FRF stands above what are no modes, at the least of three lines, dB."""
    xx = np.mean(np.abs(spectra_x) ** 2, axis=0)
    share = np.mean(clean * spectra_x[:, None].conj(), axis=0) / xx  # (modes, lines)
    weight = modes.shapes * modes.shapes[:, :1]
    exact = np.einsum("rl,ro->lo", share, weight)
    scatter = np.abs(h1 - exact) ** 2
    above = np.full(modes.frequency_hz.size, -np.inf)
    for r, f in enumerate(modes.frequency_hz):
        line = int(np.argmin(np.abs(frequency - f)))
        if frequency[0] < f < frequency[-1]:
            about = slice(max(line - 8, 0), line + 9)
            three = np.abs(share[r, max(line - 1, 0) : line + 2]).min()
            ratio = (three * np.abs(weight[r])) ** 2 / scatter[about].mean(axis=0)
            above[r] = 10 * np.log10(ratio.max())
    return above
