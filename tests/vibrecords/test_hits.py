"""Hits of a hammer: found where they are, and each rejection for its own reason."""

from dataclasses import replace

import numpy as np
import pytest

from tests.simulated import half_sine
from vibrecords.errors import MeasurementError
from vibrecords.records import TimeRecord
from vibrecords.signals.hits import HitSettings, find_hits, is_clipped, reject_overloads

RATE = 10_000.0
BLOCK = HitSettings(block_s=0.1, pretrigger_s=0.01)
PULSE = 1e-3


def force(values: np.ndarray, noise: float = 0.1, seed: int = 1) -> TimeRecord:
    rng = np.random.default_rng(seed)
    return TimeRecord("Point:1:Y+", RATE, values + noise * rng.standard_normal(values.size), "force", "N")


def pulses(*hits: tuple[float, float], seconds: float = 0.5) -> np.ndarray:
    """Half sines at given times with given peaks."""
    return sum(half_sine(round(seconds * RATE), RATE, at, PULSE, peak) for at, peak in hits)


def test_hits_of_a_long_recording_are_found_where_they_are():
    hits = find_hits([force(pulses((0.05, 100.0), (0.2, -60.0), (0.35, 80.0)))], BLOCK)
    assert [hit.number for hit in hits] == [1, 2, 3]
    assert all(hit.kept for hit in hits)
    assert [hit.peak_n for hit in hits] == pytest.approx([100, -60, 80], rel=0.02)
    for hit, at in zip(hits, (0.05, 0.2, 0.35), strict=True):
        # 10 N of 100 N are reached after 6 % of the half sine, 16 % of 60 N after 9 %
        assert hit.trigger == pytest.approx(at * RATE, abs=2)
        assert hit.trigger - hit.start == 100
        assert hit.width_s == pytest.approx(2 / 3 * PULSE, rel=0.2)


def test_an_offset_of_the_force_channel_moves_nothing():
    values = pulses((0.05, 100.0), (0.2, 60.0))
    plain, offset = (find_hits([force(values + shift)], BLOCK) for shift in (0.0, 500.0))
    assert [(h.trigger, h.kept) for h in plain] == [(h.trigger, h.kept) for h in offset]
    assert [h.peak_n for h in offset] == pytest.approx([h.peak_n for h in plain], abs=0.1)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_double_hit_is_rejected_and_a_single_one_is_not(sign):
    values = sign * pulses((0.05, 100.0), (0.06, 20.0), (0.3, 100.0))
    double, single = find_hits([force(values)], BLOCK)
    assert double.reason == "double hit, again after 10 ms"
    assert single.kept


def test_humps_of_one_contact_and_ringing_of_a_filter_are_no_double_hit():
    values = pulses((0.05, 100.0))
    humps = values + half_sine(values.size, RATE, 0.0507, PULSE, 70.0)  # one contact, two humps
    t = np.arange(values.size) / RATE - 0.051
    ringing = values - 8.0 * np.exp(-t / 1e-3) * np.cos(2 * np.pi * 2000 * t) * (t > 0)
    assert find_hits([force(humps)], BLOCK)[0].kept
    assert find_hits([force(ringing, noise=0.0)], replace(BLOCK, double_hit_level=0.06))[0].kept


def test_noise_is_no_double_hit():
    values = pulses((0.05, 100.0))
    assert all(find_hits([force(values, noise=1.0, seed=seed)], BLOCK)[0].kept for seed in range(200))


def test_an_overloaded_hit_is_rejected_by_its_flat_top_or_its_range():
    clipped, full = (np.clip(pulses((0.05, 100.0)), -70, 70) for _ in range(2))
    assert find_hits([force(clipped, noise=0.0)], BLOCK)[0].reason == "force overloaded"
    ranged = replace(BLOCK, force_range_n=70.0)
    assert find_hits([force(full, noise=0.0)], ranged)[0].reason == "force overloaded"
    assert find_hits([force(0.9 * full, noise=0.0)], ranged)[0].kept


def test_a_block_that_is_not_whole_is_rejected():
    early, whole, late = find_hits([force(pulses((0.005, 100.0), (0.2, 100.0), (0.45, 100.0)))], BLOCK)
    assert early.reason.endswith("s before the record")
    assert late.reason.endswith("s after the record")
    assert whole.kept


def test_a_record_for_each_hit_needs_no_block():
    records = [force(pulses((0.05, 100.0))), force(pulses((0.05, 1.0))), force(pulses((0.07, 80.0)))]
    first, weak, third = find_hits(records, HitSettings())
    assert (first.start, third.record, third.trigger) == (0, 2, pytest.approx(702, abs=2))
    assert weak.reason == "no force above the trigger"


def test_a_response_that_is_overloaded_rejects_its_hit_only():
    record = force(pulses((0.05, 100.0), (0.25, 100.0)))
    t = np.arange(record.values.size) / RATE
    swing = np.where(t > 0.05, np.sin(900 * (t - 0.05)), 0) * np.exp(-40 * (t - 0.05) * (t > 0.05))
    swing += 2 * np.where(t > 0.25, np.sin(900 * (t - 0.25)), 0) * np.exp(-40 * (t - 0.25) * (t > 0.25))
    response = TimeRecord("Point:2:Y+", RATE, np.clip(swing, -1.2, 1.2), "acceleration")
    first, second = reject_overloads(find_hits([record], BLOCK), [response], BLOCK)
    assert first.kept
    assert second.reason == "response Point:2:Y+ overloaded"


def test_clipping_needs_three_equal_samples_at_the_top():
    wave = np.sin(np.linspace(0, 20, 1000))
    assert not is_clipped(wave)
    assert is_clipped(np.clip(wave, -2, 0.99))
    assert is_clipped(np.clip(wave, -0.99, 2))
    assert not is_clipped(np.array([0.0, 1.0, 1.0, 0.0]))
    assert is_clipped(np.array([0.0, 1.0, 1.0, 1.0]))
    assert not is_clipped(np.zeros(10))
    assert is_clipped(wave, full_scale=1.0) is bool(np.abs(wave).max() >= 1 - 1e-6)
    assert not is_clipped(np.ones(10), full_scale=1.1)
    assert not is_clipped(np.empty(0))


def test_a_dead_channel_is_refused():
    with pytest.raises(MeasurementError, match="no force in 1 records"):
        find_hits([force(np.zeros(100), noise=0.0)], BLOCK)
    with pytest.raises(MeasurementError, match="no force in 0 records"):
        find_hits([], BLOCK)


@pytest.mark.parametrize("changes", [
    {"trigger_level": 0.0},
    {"trigger_level": 1.0},
    {"double_hit_level": -0.1},
    {"block_s": 0.0},
    {"pretrigger_s": -1.0},
])  # fmt: skip
def test_impossible_settings_are_refused(changes):
    with pytest.raises(MeasurementError, match="hits: found"):
        HitSettings(**changes)
