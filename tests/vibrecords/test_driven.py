"""The band that a test drove: where it ends, and that signs, conjugation and resonances are judged in it alone."""

from dataclasses import replace

import numpy as np
import pytest

from vibrecords.driven import driven_lines
from vibrecords.formats import join_frfs
from vibrecords.inspection import contents_of_records, resonances_text, with_resonances
from vibrecords.modal_fit import fit_modes
from vibrecords.records import FrfRecord
from vibrecords.warnings.clear_frf import ClearFrf
from vibrecords.warnings.collector import find_warnings

#: One stretch of 400 lines is 11.
COUNT, STRETCH = 400, 11


def two_parts(driven, *, count=COUNT, good=0.99, bad=0.1, rise=6.0):
    """Coherence and noise of lines driven up to some number."""
    at = np.arange(count) < driven
    return np.where(at, good, bad), np.where(at, 1.0, rise)


def test_a_band_ends_where_coherence_is_gone_and_noise_over_the_force_rises():
    coherence, noise = two_parts(300)
    assert driven_lines(coherence, noise) == slice(0, 300)
    assert driven_lines(coherence[::-1], noise[::-1]) == slice(100, COUNT)
    # a hole of the force in between belongs to it
    coherence[100:150], noise[100:150] = 0.1, 6.0
    assert driven_lines(coherence, noise) == slice(0, 300)


def test_the_first_line_alone_does_not_make_a_stretch():
    coherence, noise = two_parts(300)
    coherence[-1] = 0.99
    assert driven_lines(coherence, noise) == slice(0, 300)
    assert driven_lines(coherence[::-1], noise[::-1]) == slice(100, COUNT)
    mobility = np.ones(100, dtype=complex)
    mobility[0] = 2  # nor the noise
    assert ClearFrf("1:y", "1:y", "mobility", np.arange(1.0, 101.0), mobility).noise.max() == 0


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"driven": COUNT - STRETCH - 1}, {"driven": COUNT - STRETCH}),  # an end as short as a stretch
        ({"driven": 120, "count": 160}, {"driven": 120, "count": 159}),
        ({"driven": 300, "rise": 5.1}, {"driven": 300, "rise": 4.9}),
        ({"driven": 300, "good": 0.91}, {"driven": 300, "good": 0.89}),
        ({"driven": 300, "bad": 0.49}, {"driven": 300, "bad": 0.51}),
    ],
    ids=["length of the end", "number of lines", "rise of the noise", "coherence before", "coherence after"],
)
def test_each_limit_is_where_it_is_said_to_be(one, other):
    assert driven_lines(*two_parts(**one)) == slice(0, one["driven"])
    assert driven_lines(*two_parts(**other)) == slice(0, other.get("count", COUNT))


def test_a_mode_of_three_coherent_lines_is_driven():
    coherence, noise = two_parts(300)
    coherence[350:353] = 0.85, 0.97, 0.6  # a mean of 0.81
    assert driven_lines(coherence, noise) == slice(0, 352)
    coherence[350] = 0.8  # of 0.79
    assert driven_lines(coherence, noise) == slice(0, 300)


LINES = np.arange(1.0, 128.01, 1 / 16)


def chirp(rng, *, sign=1.0):
    """A drive point with one mode at 18.6 Hz driven up to 42 Hz, above which what remains turns its phase upwards."""

    def sum_of(modes, damping):
        modal = -(LINES**2) / (modes[:, None] ** 2 - LINES**2 + 2j * damping * modes[:, None] * LINES)
        return modal.sum(axis=0)

    driven = LINES <= 42
    remains = sum_of(np.linspace(50, 120, 9), 0.01).conj()
    values = np.where(driven, sum_of(np.array([18.6]), 0.012), remains)
    noise = rng.standard_normal((2, LINES.size)) * np.where(driven, 0.002, 0.3)
    values = sign * (values + noise[0] + 1j * noise[1])
    coherence = np.where(driven, 0.9995, 0.02)
    return FrfRecord("Point:1:Z+", "Point:1:Z+", LINES, values, "accelerance", "m/s^2/N", coherence)


def test_undriven_lines_do_not_vote_for_conjugates_and_hold_no_mode():
    found = with_resonances(contents_of_records([chirp(np.random.default_rng(1))]))
    assert {warning.key for warning in found.warnings} == {"averages_missing", "excitation_ends"}
    assert not found.conjugated
    (mode,) = found.modes
    assert (mode.frequency_hz, mode.damping_ratio) == pytest.approx((18.6, 0.012), rel=2e-3)
    assert abs(mode.frequency_hz - 18.6) < 4 * mode.frequency_sd_hz
    assert [doubt for doubt in found.doubtful if doubt.frequency_hz > 42] == []
    assert found.driven_hz == (None, pytest.approx(42.0, abs=0.2))
    assert any(line.startswith("  sought to 4") for line in resonances_text(found))


def test_conjugates_and_signs_in_the_driven_band_are_named_whatever_is_above_it():
    record = chirp(np.random.default_rng(2))
    assert "conjugated" in {warning.key for warning in find_warnings(record.conjugate)}
    assert "sign_flip" in {warning.key for warning in find_warnings(chirp(np.random.default_rng(2), sign=-1.0))}


def test_a_band_that_is_asked_for_is_cut_to_what_was_driven():
    contents = contents_of_records([chirp(np.random.default_rng(3))])
    for band in ((5.0, 40.0), (None, 110.0)):
        assert [mode.frequency_hz for mode in with_resonances(contents, band).modes] == [pytest.approx(18.6, rel=1e-3)]
    assert "found 0 lines between 60 and 4" in with_resonances(contents, (60.0, 110.0)).modes_note


def test_without_coherence_the_scatter_of_neighbouring_lines_tells():
    rng = np.random.default_rng(4)
    record = replace(chirp(rng), coherence=None)
    noise = rng.standard_normal(LINES.size) + 1j * rng.standard_normal(LINES.size)
    values = np.where(LINES <= 42, record.values, noise)
    found = with_resonances(contents_of_records([replace(record, values=values)]))
    assert [mode.frequency_hz for mode in found.modes] == [pytest.approx(18.6, rel=1e-3)]
    assert found.driven_hz == (None, pytest.approx(42.0, abs=2.0))


def test_a_response_that_is_small_was_driven_all_the_same():
    """Below a resonance coherence is low by the noise of the sensor, which over the force is as large as elsewhere."""
    omega_r, low = 60.0, LINES < 12
    values = -(LINES**2) / (omega_r**2 - LINES**2 + 2j * 0.01 * omega_r * LINES)
    noise = np.full(LINES.size, 0.05)
    coherence = np.abs(values) ** 2 / (np.abs(values) ** 2 + noise**2)
    assert np.median(coherence[low]) < 0.5
    assert driven_lines(coherence, noise) == slice(0, LINES.size)


def test_a_fit_keeps_to_what_was_driven_where_coherence_tells():
    record = chirp(np.random.default_rng(5))
    frf = join_frfs([record], "chirp")
    fit = fit_modes(frf)
    assert [mode.frequency_hz for mode in fit.modes] == [pytest.approx(18.6, rel=1e-3)]
    assert len(fit.values) == (LINES <= 42).sum()
    # with the variance stated all lines are fitted: whoever states it says what each is worth
    assert len(fit_modes(frf, np.full(frf.values.shape, 0.1)).values) == LINES.size
