"""Warnings of how a structure was excited and of what changed between runs: where they should be, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from tests.marks import first_in_ci
from vibrecords.records import FrfRecord, TimeRecord
from vibrecords.warnings.collector import find_warnings

NEW = {"leakage", "excitation_ends", "mains", "level_dependence", "mass_loading", "truncated_ring_down"}


class Structure:
    """Modes, and FRFs as so many averages of a noisy test estimate them, with the coherence that belongs to them."""

    def __init__(self, rng, frequency, damping, points=3):
        self.rng, self.frequency, self.damping = rng, np.asarray(frequency, float), np.asarray(damping, float)
        signs = rng.choice([-1.0, 1.0], (points, self.frequency.size))
        self.shapes = signs * rng.uniform(0.4, 1.2, signs.shape)

    def exact(self, lines, response, shift=1.0):
        omega_r, omega = 2 * np.pi * self.frequency * shift, 2 * np.pi * lines[:, None]
        modal = -(omega**2) / (omega_r**2 - omega**2 + 2j * self.damping * omega_r * omega)
        return modal @ (self.shapes[response] * self.shapes[0])

    def record(self, lines, response=0, *, averages=10, noise=0.003, shift=1.0, spread=0.0, force=1.0, hum=None):
        """`spread`: how far resonances wander from average to average; `force`: its spectrum; `hum`: added to it."""
        typical = np.median(np.abs(self.exact(lines, response)))
        xx, yx, yy = 0.0, 0.0, 0.0
        for _ in range(averages):
            x = force * np.exp(2j * np.pi * self.rng.random(lines.size))
            moved = shift * (1 + spread * self.rng.uniform(-1, 1))
            y = x * self.exact(lines, response, moved) * (1 + 0.01 * self.gauss(lines))
            y = y + noise * typical * self.gauss(lines)
            if hum is not None:
                y = y + typical * hum * np.exp(2j * np.pi * self.rng.random())
            xx, yx, yy = xx + np.abs(x) ** 2, yx + y * x.conj(), yy + np.abs(y) ** 2
        coherence = np.abs(yx) ** 2 / (xx * yy)
        label = f"Point:{response + 1}:Z+"
        return FrfRecord(label, "Point:1:Z+", lines, yx / xx, "accelerance", "m/s^2/N", coherence, averages)

    def gauss(self, lines):
        return (self.rng.standard_normal(lines.size) + 1j * self.rng.standard_normal(lines.size)) / np.sqrt(2)


LINES = np.arange(20, 1200) * 1.0


def structure(seed):
    return Structure(np.random.default_rng(seed), [83.0, 245.0, 512.0, 871.0], [0.012, 0.009, 0.007, 0.006])


def humming(lines, mains):
    return np.where(np.abs((lines + mains / 2) % mains - mains / 2) < 0.6, 1.0, 0.0)


def fading(lines):
    return 1 / (1 + (lines / 600) ** 12)


BROKEN = {
    "frequency that wanders with the level": ("leakage", lambda s: [s.record(LINES), s.record(LINES, 1, spread=0.01)]),
    "three lines across the half-power width and a dip": ("leakage", lambda s: [s.record(LINES[::2], 1, spread=0.02)]),
    "force that ends at 600 Hz": ("excitation_ends", lambda s: [s.record(LINES, 1, force=fading(LINES))]),
    "the same without coherence":
        ("excitation_ends", lambda s: [replace(s.record(LINES, 1, force=fading(LINES)), coherence=None)]),
    "hum at 50 Hz": ("mains", lambda s: [s.record(LINES, 1, hum=humming(LINES, 50))]),
    "hum at 60 Hz": ("mains", lambda s: [s.record(LINES, 0, hum=humming(LINES, 60))]),
    "hum without coherence":
        ("mains", lambda s: [replace(s.record(LINES, 1, hum=5 * humming(LINES, 50)), coherence=None)]),
    "two levels": ("level_dependence", lambda s: [s.record(LINES, 1), s.record(LINES, 1, shift=0.985)]),
    "roving accelerometer":
        ("mass_loading", lambda s: [s.record(LINES, 0), s.record(LINES, 1), s.record(LINES, 2, shift=0.97)]),
}  # fmt: skip


def new_keys(found):
    return {warning.key for warning in find_warnings(found)} & NEW


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_wrong_is_named_and_nothing_else(name):
    key, broken = BROKEN[name]
    for seed in range(5):
        assert new_keys(broken(structure(seed))) == {key}, seed


def test_the_sentences_say_where_and_how_much():
    s = structure(1)
    (level,) = [w for w in find_warnings([s.record(LINES, 1), s.record(LINES, 1, shift=0.985)]) if w.key in NEW]
    assert "3 of 3 resonances are elsewhere" in level.sentence
    assert "1.5 % lower" in level.sentence
    (end,) = [w for w in find_warnings([s.record(LINES, 1, force=fading(LINES))]) if w.key in NEW]
    assert 600 < float(end.sentence.split()[1]) < 1000
    (hum,) = [w for w in find_warnings([s.record(LINES, 1, hum=humming(LINES, 50))]) if w.key in NEW]
    assert "50 Hz: hum of the mains" in hum.sentence


def ring_down(seconds, rng, noise=1e-3, rate=2048.0):
    t = np.arange(int(seconds * rate)) / rate - 0.02
    modes = zip(rng.uniform(40, 400, 3), (0.005, 0.01, 0.02), rng.uniform(0.5, 1, 3), strict=True)
    x = sum(a * np.exp(-z * 2 * np.pi * f * t) * np.sin(2 * np.pi * f * t) for f, z, a in modes) * (t > 0)
    return TimeRecord("acc", rate, x + noise * rng.standard_normal(t.size), "acceleration", "m/s^2", 1)


def test_a_ring_down_that_is_cut_off_is_named_and_one_that_is_not_is_silent():
    slow = [30.0, 90.0]
    for seed in range(20):
        rng = np.random.default_rng(seed)
        t = np.arange(2048) / 2048.0
        cut = sum(np.exp(-0.004 * 2 * np.pi * f * t) * np.sin(2 * np.pi * f * t) for f in slow)
        record = TimeRecord("acc", 2048.0, cut + 1e-3 * rng.standard_normal(t.size), "acceleration", "m/s^2", 1)
        assert new_keys([record]) == {"truncated_ring_down"}
        windowed = replace(record, values=record.values * np.exp(-5 * t))
        assert new_keys([windowed]) == set()
        assert new_keys([ring_down(8.0, rng, noise=10.0 ** rng.uniform(-4, -1))]) == set()
        shaken = TimeRecord("acc", 2048.0, np.random.default_rng(seed).standard_normal(20480), "acceleration", "m/s^2")
        assert new_keys([shaken]) == set()


def clean_file(seed):
    """Three FRFs of random modes; of every fourth structure one of them twice, of every third without coherence."""
    rng = np.random.default_rng([11, seed])
    modes = int(rng.integers(1, 12))
    frequency = np.sort(rng.uniform(40, 1150, modes))
    s = Structure(rng, frequency, 10 ** rng.uniform(-2.5, -1.5, modes))
    lines = LINES[:: int(rng.integers(1, 3))]
    options = {"averages": int(rng.integers(2, 30)), "noise": 10 ** rng.uniform(-3, -0.5)}
    found = [s.record(lines, k, **options) for k in ((0, 1, 2) if seed % 4 else (0, 1, 1, 2))]
    return [replace(r, coherence=None) for r in found] if seed % 3 == 0 else found


def false_alarms(seeds):
    return {seed: keys for seed in seeds if (keys := new_keys(clean_file(seed)))}


def test_clean_files_are_silent():
    assert false_alarms(range(12)) == {}


@pytest.mark.science
@pytest.mark.parametrize("end", first_in_ci([80, 400], 1))
def test_clean_files_are_silent_over_many_structures(end):
    assert false_alarms(range(12, end)) == {}


def test_uneven_lines_of_any_kind_are_judged_or_not_but_never_an_error():
    rng = np.random.default_rng(5)
    s = structure(5)
    for size in (16, 64, 200):
        for power in (0.2, 1.0, 6.0):
            lines = 10 + 990 * np.sort(rng.random(size)) ** power
            for record in (s.record(lines, 1), replace(s.record(lines), coherence=None)):
                assert not new_keys([record, record]) & {"level_dependence", "mass_loading"}
