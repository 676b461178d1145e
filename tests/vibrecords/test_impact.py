"""FRFs from hits and from shakers: the estimators, the grouping of records, and that the truth comes back."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.one_line import refused
from tests.simulated import ChannelNoise, Hammer, Rig, hammer_records, shaker_records
from vibrecords.errors import MeasurementError
from vibrecords.formats import join_frfs
from vibrecords.records import TimeRecord
from vibrecords.signals.hits import HitSettings
from vibrecords.signals.impact import frfs_of_hits, impact_frfs
from vibrecords.signals.spectra import (
    ImpactSettings,
    ShakerSettings,
    estimate_frf,
    kept_lines,
    shaker_frf,
    sort_by_force,
)
from vibrecords.signals.windows import added_decay_rate
from vibrecords.variance import coherence_variance

RATE, BLOCK = 4096.0, 2048
SILENT = ChannelNoise(0.0, 0.0)
DECAY = 25.0


def plate(s: np.ndarray) -> np.ndarray:
    """Receptances at s of two DOFs driven at both, shape (lines, 2, 2): two modes, decay rate 25 1/s."""
    out = np.zeros((s.size, 2, 2), dtype=complex)
    for hz, shape in ((90.0, [1.0, 0.6]), (260.0, [1.0, -1.1])):
        mode = s**2 + 2 * DECAY * s + (2 * np.pi * hz) ** 2
        out += np.multiply.outer(1 / mode, np.outer(shape, shape))
    return out


def rig(quantity="accelerance", inputs=("1:y",), block=BLOCK) -> Rig:
    power = {"receptance": 0, "mobility": 1, "accelerance": 2}[quantity]

    def frf(lines: np.ndarray) -> np.ndarray:
        s = 2j * np.pi * lines
        return (plate(s) * s[:, None, None] ** power)[:, :, : len(inputs)]

    return Rig(frf, ("1:y", "2:y"), inputs, quantity, RATE, block, 20 / DECAY)


def hammered(hammer: Hammer, noise: ChannelNoise = SILENT, seed: int = 1, **options: object):
    return list(hammer_records(rig(**options), hammer, noise, np.random.default_rng(seed)))


def impact_frf(forces, response, settings=None):
    """Result of one response."""
    return impact_frfs(forces, [response], settings)[0]


def one_test(records: list[TimeRecord]):
    ((forces, responses),) = sort_by_force(records)
    return forces, responses


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
def test_without_noise_the_frf_of_hits_is_the_true_one(quantity, estimator):
    forces, responses = one_test(hammered(Hammer(3, 2e-3), quantity=quantity))
    settings = ImpactSettings(estimator=estimator, f_min_hz=20, f_max_hz=400)
    for i, result in enumerate(impact_frfs(forces, responses, settings)):
        frf = result.frf
        true = rig(quantity).frf(frf.frequency_hz)[:, i, 0]
        assert_allclose(frf.values, true, atol=1e-4 * np.abs(true).max())
        assert (frf.response, frf.reference) == (f"Point:{i + 1}:Y+", "Point:1:Y+")
        assert (frf.quantity, frf.averages, result.added_decay_rate) == (quantity, 3, 0.0)
        assert (frf.coherence > 0.999).all()
        assert_allclose(frf.frequency_hz, np.arange(20, 401, 2.0))


def test_an_exponential_window_gives_the_frf_at_the_shifted_variable():
    forces, responses = one_test(hammered(Hammer(2, 2e-3), block=512))
    plain, windowed = (
        impact_frf(forces, responses[0], ImpactSettings(exponential_end=end, f_max_hz=400)) for end in (1.0, 1e-3)
    )
    a = added_decay_rate(1e-3, 512 / RATE)
    assert windowed.added_decay_rate == pytest.approx(a)
    s = 2j * np.pi * windowed.frf.frequency_hz + a
    shifted = plate(s)[:, 0, 0] * s**2
    peak = np.abs(shifted).max()
    assert np.abs(windowed.frf.values - shifted).max() < 1e-3 * peak
    true = rig().frf(plain.frf.frequency_hz)[:, 0, 0]
    assert np.abs(plain.frf.values - true).max() > 0.02 * np.abs(true).max()  # the block is too short without it
    assert any("exponential window adds" in note for note in windowed.frf.notes)


def test_the_damping_of_an_exponential_window_is_taken_out_by_the_modes_that_are_found():
    records = hammered(Hammer(10, 2e-3), ChannelNoise(0.0005, 0.002), block=1024)
    settings = ImpactSettings(exponential_end=0.02, force_window_s=4e-3, f_min_hz=20, f_max_hz=400)
    a = added_decay_rate(0.02, 1024 / RATE)
    for i, frf in enumerate(frfs_of_hits(records, settings).frfs):
        true = rig().frf(frf.frequency_hz)[:, i, 0]
        shifted = 2j * np.pi * frf.frequency_hz + a
        windowed = plate(shifted)[:, i, 0] * shifted**2
        peak = np.abs(true).max()
        assert np.abs(windowed - true).max() > 0.3 * peak
        assert np.abs(frf.values - true).max() < 0.01 * peak
        assert frf.notes[1].endswith("taken out by the 2 modes that were found")


def test_without_any_mode_the_window_cannot_be_corrected():
    records = hammered(Hammer(2, 2e-3), ChannelNoise(0.0005, 0.002), block=1024)
    with pytest.raises(MeasurementError, match="found no mode in the FRFs of 'Point:1:Y\\+'"):
        frfs_of_hits(records, ImpactSettings(exponential_end=0.02, force_window_s=4e-3, f_min_hz=340, f_max_hz=480))


def test_double_hits_and_overloads_are_left_out_of_all_responses():
    records = hammered(Hammer(4, 2e-3, double_hits=3, overloads=2), ChannelNoise(0.0005, 0.001))
    forces, responses = one_test(records)
    assert len(forces) == 9
    results = impact_frfs(forces, responses, ImpactSettings(f_max_hz=400))
    for result in results:
        assert result.frf.averages == 4
        reasons = [hit.reason for hit in result.hits]
        assert sum(reason.startswith("double hit") for reason in reasons) == 3
        assert sum("overloaded" in reason for reason in reasons) == 2
    assert results[0].hits == results[1].hits


def test_double_hits_and_overloads_are_found_in_each_of_many_tests():
    for seed in range(40):
        forces, responses = one_test(hammered(Hammer(5, 2e-3, 2, 2), ChannelNoise(0.001, 0.002), seed))
        assert impact_frfs(forces, responses)[0].frf.averages == 5, seed


def test_the_force_window_takes_noise_off_the_force():
    noise = ChannelNoise(0.02, 0.0)
    forces, responses = one_test(hammered(Hammer(40, 2e-3), noise))
    wide = ImpactSettings(f_min_hz=20, f_max_hz=400, hits=HitSettings(double_hit_level=0.3))
    true = rig().frf(np.arange(20, 401, 2.0))[:, 0, 0]

    def error(settings: ImpactSettings) -> float:
        values = impact_frf(forces, responses[0], settings).frf.values
        return float(np.sqrt(np.mean(np.abs(values / true - 1) ** 2)))

    assert error(replace(wide, force_window_s=4e-3)) < 0.3 * error(wide)


def test_a_recording_of_several_hits_gives_the_same_as_its_blocks():
    forces, responses = one_test(hammered(Hammer(3, 2e-3)))
    long_force, long_response = (
        TimeRecord(records[0].channel, RATE, np.concatenate([r.values for r in records]), records[0].quantity)
        for records in (forces, responses[0])
    )
    apart = impact_frf(forces, responses[0], ImpactSettings(f_max_hz=400))
    cut = ImpactSettings(hits=HitSettings(block_s=(BLOCK - 60) / RATE, pretrigger_s=0.008), f_max_hz=400)
    together = impact_frf([long_force], [long_response], cut)
    assert together.frf.averages == 3
    at = apart.frf.frequency_hz
    between = np.interp(at[5:-5], together.frf.frequency_hz, np.abs(together.frf.values))
    assert_allclose(between, np.abs(apart.frf.values)[5:-5], rtol=0.05)


def test_a_single_hit_has_no_coherence():
    forces, responses = one_test(hammered(Hammer(1, 2e-3)))
    frf = impact_frf(forces, responses[0]).frf
    assert (frf.coherence, frf.averages) == (None, 1)


@pytest.mark.parametrize("quantity", ["receptance", "accelerance"])
def test_a_shaker_gives_the_true_frf_within_its_noise(quantity):
    records = list(shaker_records(rig(quantity), 60 * 8192, ChannelNoise(0.0, 0.01), np.random.default_rng(2)))
    forces, responses = one_test(records)
    settings = ShakerSettings(8192 / RATE, f_min_hz=20, f_max_hz=400)
    for i, response in enumerate(responses):
        result = shaker_frf(forces, response, settings)
        frf = result.frf
        assert result.blocks == 119
        assert result.effective_averages == pytest.approx(119 / (1 + 2 * 118 / 119 / 36), rel=1e-3)
        true = rig(quantity).frf(frf.frequency_hz)[:, i, 0]
        variance = np.abs(frf.values) ** 2 * (1 - frf.coherence) / ((frf.averages - 1) * frf.coherence)
        z = np.abs(frf.values - true) ** 2 / variance
        assert 0.8 < z.mean() < 1.15
        assert np.abs(frf.values / true - 1).max() < 0.5


def test_several_inputs_are_sorted_by_their_hits():
    records = hammered(Hammer(2, 2e-3), inputs=("1:y", "2:y"))
    assert [record.hit for record in records if record.quantity == "force"] == [1, 2, 3, 4]
    (first, second) = sort_by_force(records[::-1])[::-1]
    for j, (forces, responses) in enumerate((first, second)):
        settings = ImpactSettings(f_min_hz=20, f_max_hz=400)
        for response in responses:
            frf = impact_frf(forces, response, settings).frf
            i = int(frf.response.split(":")[1]) - 1
            true = rig(inputs=("1:y", "2:y")).frf(frf.frequency_hz)[:, i, j]
            assert_allclose(frf.values, true, atol=1e-4 * np.abs(true).max())


# estimators


def spectra(seed: int, force_noise: float, response_noise: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    shape = (4000, 3)
    noise = (rng.standard_normal((3, *shape)) + 1j * rng.standard_normal((3, *shape))) / np.sqrt(2)
    return noise[0] + force_noise * noise[1], (2 - 1j) * noise[0] + response_noise * noise[2]


def test_each_estimator_is_free_of_the_bias_it_is_said_to_be_free_of():
    true = 2 - 1j
    at_response, at_force = spectra(1, 0.0, 1.5), spectra(2, 0.5, 0.0)
    assert_allclose(estimate_frf(*at_response, "H1")[0], true, rtol=0.05)
    assert_allclose(estimate_frf(*at_force, "H2")[0], true, rtol=0.05)
    assert_allclose(estimate_frf(*at_force, "H1")[0], true / 1.25, rtol=0.05)
    assert_allclose(estimate_frf(*at_response, "H2")[0], true * (1 + 1.5**2 / 5), rtol=0.05)
    both = spectra(3, 0.5, 0.5 * np.sqrt(5))  # as much noise on either side: Hv is free of bias
    assert_allclose(estimate_frf(*both, "Hv")[0], true, rtol=0.05)


def test_coherence_lies_between_0_and_1_and_is_1_for_one_average():
    x, y = spectra(4, 0.2, 0.7)
    _, coherence = estimate_frf(x, y)
    assert_allclose(coherence, 5 / (5 + 0.49) / 1.04, rtol=0.03)
    assert_allclose(estimate_frf(x[:1], y[:1])[1], 1.0, rtol=1e-12)


# what is refused

FORCE = TimeRecord("f", RATE, np.r_[0.0, 0, 5, 9, 5, np.zeros(59)], "force")
MOTION = TimeRecord("a", RATE, np.random.default_rng(1).standard_normal(64), "acceleration")

REFUSED = {
    "other estimator": (lambda: impact_frf([FORCE], [MOTION], ImpactSettings(estimator="H3")), "'H3'"),
    "response for force": (lambda: impact_frf([MOTION], [MOTION]), "found acceleration and acceleration"),
    "unknown response": (lambda: impact_frf([FORCE], [replace(MOTION, quantity="unknown")]), "found force and unknown"),
    "other length": (lambda: impact_frf([FORCE], [replace(MOTION, values=np.ones(63))]), "64 and 63 samples"),
    "other rate": (lambda: impact_frf([FORCE], [replace(MOTION, sample_rate_hz=1.0)]), "4096 and 1 per second"),
    "NaN": (lambda: impact_frf([FORCE], [replace(MOTION, values=np.full(64, np.nan))]), "NaN"),
    "no response": (lambda: impact_frfs([FORCE], []), "no response"),
    "no hit kept":
        (lambda: impact_frf([FORCE], [MOTION], ImpactSettings(hits=HitSettings(block_s=1.0))),
        "no hit to keep among 1 (hit 1:"),
    "blocks of two lengths":
        (lambda:
        impact_frf([FORCE, replace(FORCE, values=FORCE.values[:32])],
        [MOTION, replace(MOTION, values=MOTION.values[:32])]), "32 to 64 samples"),
    "empty band": (lambda: impact_frf([FORCE], [MOTION], ImpactSettings(f_min_hz=1, f_max_hz=2)), "no line between"),
    "silent response": (lambda: impact_frf([FORCE], [replace(MOTION, values=np.zeros(64))]), "found no response"),
    "short shaker": (lambda: shaker_frf([FORCE], [MOTION], ShakerSettings(1.0)), "records of at most"),
    "overlap of one": (lambda: ShakerSettings(1.0, overlap=1.0), "overlap of 1"),
    "no force": (lambda: sort_by_force([MOTION]), "no force"),
    "a channel twice": (lambda: sort_by_force([FORCE, MOTION, MOTION]), "'a' twice"),
    "two forces at once": (lambda: sort_by_force([FORCE, replace(FORCE, channel="g")]), "'f' and 'g' at once"),
    "a missing response":
        (lambda: sort_by_force([replace(FORCE, hit=1), replace(MOTION, hit=1), replace(FORCE, hit=2)]),
        "no response of 'a' to hit 2"),
}  # fmt: skip


@pytest.mark.parametrize(("broken", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_is_refused_in_one_line(broken, message):
    refused(broken, MeasurementError, message)


# variance


@pytest.mark.science
@pytest.mark.parametrize("hits", [3, 10])
def test_the_variance_from_coherence_is_the_scatter_of_simulated_impact_tests(hits):
    noise, tests = ChannelNoise(0.0, 0.02), 150
    settings = ImpactSettings(f_min_hz=40, f_max_hz=300)
    found = []
    for seed in range(tests):
        forces, responses = one_test(hammered(Hammer(hits, 2e-3), noise, seed))
        found.append(impact_frf(forces, responses[1], settings).frf)
    values = np.array([frf.values for frf in found])
    predicted = np.mean([coherence_variance(join_frfs([frf], "hits")).ravel() for frf in found], axis=0)
    scatter = values.var(axis=0, ddof=1)
    assert (predicted / scatter).mean() == pytest.approx(1.0, abs=0.05)
    assert_array_equal([f.averages for f in found], hits)


def test_a_band_that_ends_on_a_line_holds_it_however_the_line_is_rounded():
    every = np.arange(6) * (1.0 / 10)
    assert every[3] > 0.3
    frequency, kept = kept_lines(10, 1.0, 0.1, 0.3)
    assert (frequency.tolist(), kept.tolist()) == (every[1:4].tolist(), [1, 2, 3])
