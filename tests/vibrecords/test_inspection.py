"""Inspection: what it says of a file and its hits, and that it streams."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.written_files import write_records

from tests.vibrecords.test_warnings import DAMPING, FREQUENCY, LINES, hammer, records
from vibrecords.inspection import contents_of_records, contents_text, inspect_file, resonances_text, with_resonances
from vibrecords.provenance import MeasurementWarning
from vibrecords.records import CoherenceRecord, FrfRecord, ModeRecord, SpectrumRecord, TimeRecord

COARSE = LINES[1::2]  # 1 Hz apart


def inspected(records):
    return with_resonances(contents_of_records(records))


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    path = tmp_path_factory.mktemp("inspect") / "tip.uff"
    write_records(records(np.random.default_rng(1), lines=COARSE), path, "uff58b")
    return path


@pytest.fixture(scope="module")
def found(clean):
    return inspect_file(clean)


def write_hits(path):
    """Five hits, the third a double one, and the velocity of one mode at 200 Hz with 2 % damping."""
    rng = np.random.default_rng(2)
    found = []
    for number in range(1, 6):
        force = hammer(rng, second=0.4 if number == 3 else 0.0, hit=number)
        t = np.arange(force.values.size) / force.sample_rate_hz
        omega, zeta = 2 * np.pi * 200.0, 0.02
        damped = omega * np.sqrt(1 - zeta**2)
        response = np.exp(-zeta * omega * t) * (np.cos(damped * t) - zeta * omega / damped * np.sin(damped * t))
        velocity = np.convolve(force.values, response)[: t.size] / force.sample_rate_hz
        velocity += 1e-4 * np.abs(velocity).max() * rng.standard_normal(t.size)
        found += [force, TimeRecord("laser", force.sample_rate_hz, velocity, "velocity", "m/s", number)]
    write_records(found, path, "npz")
    return path


@pytest.fixture(scope="module")
def hits(tmp_path_factory):
    return write_hits(tmp_path_factory.mktemp("inspect") / "hits.npz")


def test_a_file_is_described(found):
    assert found.form == "uff"
    assert list(found.channels) == ["Point:1:Z+", "Point:2:Z+"]
    assert found.channels["Point:2:Z+"].as_response == found.channels["Point:2:Z+"].as_force == 2
    ((kind, count),) = found.kinds.items()
    assert (count, kind) == (4, "FRF: accelerance, unit (m/s^2)/N; 1595 lines, 5.5 to 1599.5 Hz every 1 Hz")
    assert found.averages == (10,)
    assert 0 < found.coherence[0] < found.coherence[1] < 1
    assert found.warnings == ()


def test_resonances_are_found_with_their_damping(found):
    assert [m.frequency_hz for m in found.modes] == pytest.approx(FREQUENCY, rel=1e-3)
    assert [m.damping_ratio for m in found.modes] == pytest.approx(DAMPING, rel=0.1)
    errors = [(m.frequency_hz - f) / m.frequency_sd_hz for m, f in zip(found.modes, FREQUENCY, strict=True)]
    assert np.abs(errors).max() < 4


@pytest.mark.whole
def test_each_hit_is_shown_and_the_frfs_of_the_hits_have_their_resonance(hits):
    found = inspect_file(hits)
    assert [t.hit.number for t in found.hits] == [1, 2, 3, 4, 5]
    assert [t.hit.kept for t in found.hits] == [True, True, False, True, True]
    text = "\n".join([*contents_text(found), *resonances_text(found)])
    assert "Point:1:Z+ hit 3: " in text
    assert "LEFT OUT: double hit, again after 2" in text
    first = next(line for line in text.splitlines() if "Point:1:Z+ hit 1: " in line)
    # a half sine is 20 dB down at 1.31 over its length, which is 1.5 times the width at half its height
    down_hz = float(first.split("20 dB down at ")[1].split()[0])
    assert down_hz * found.hits[0].hit.width_s == pytest.approx(0.87, rel=0.1)
    assert {d.key for d in found.warnings} == {"double_hit"}
    (mode,) = found.modes
    assert mode.frequency_hz == pytest.approx(200.0, abs=max(4 * mode.frequency_sd_hz, 0.02))
    assert mode.damping_ratio == pytest.approx(0.02, abs=max(4 * mode.damping_sd, 2e-4))


def test_the_trace_of_a_double_hit_shows_both():
    third = contents_of_records([hammer(np.random.default_rng(3), second=0.4)]).hits[0]
    late = third.force_n[third.time_s > 0.01]
    assert late.max() > 0.2 * third.force_n.max()


def test_why_there_are_no_resonances_is_said():
    quiet = [replace(r, quantity=None, unit="") for r in records(np.random.default_rng(3))]
    assert inspected(quiet).modes_note == "no FRF of a known quantity"
    noise = np.random.default_rng(4).standard_normal((2, LINES.size))
    flat = replace(quiet[0], quantity="mobility", values=noise[0] + 1j * noise[1], coherence=None)
    assert inspected([flat]).modes_note == "none stands out of the noise"
    assert "Resonances: none stands out of the noise" in list(resonances_text(inspected([flat])))
    shaken = TimeRecord("1:z", 2048.0, np.random.default_rng(5).standard_normal(4096), "force", "N")
    assert "not one hit each" in inspected([shaken]).modes_note


@pytest.mark.science
def test_many_frfs_are_streamed():
    lines = np.arange(10, 6410) * 0.25
    one = records(np.random.default_rng(7), lines=lines)[1]

    def many(count):
        for node in range(count):
            # values of their own, as read from a file
            yield replace(one, response=f"Point:{node + 2}:Z+", values=one.values * (1 + 0.01 * node))

    peak = {}
    for count in (20, 70):
        tracemalloc.start()
        contents_of_records(many(count))  # the fit is not what is measured
        peak[count] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    # an FRF with its axis and coherence is 200 kB; what is kept of each is a fiftieth of that
    assert (peak[70] - peak[20]) / 50 < 8_000


def test_all_kinds_of_records_are_listed():
    f = np.arange(1.0, 21.0)
    modes = [ModeRecord(1, 12.5, 0.01, 0.004, 2e-4, {"1:z": 1 + 0j, "2:z": -0.5 + 0j}), ModeRecord(2, 40.0)]
    spectrum = SpectrumRecord("acc", "PSD", f, np.ones(20), "g²/Hz")
    listed = inspected([CoherenceRecord("1:z", "2:z", f, np.full(20, 0.9), 8), spectrum, *modes])
    assert listed.kinds == {
        "coherence, without its FRF; 20 lines, 1 to 20 Hz every 1 Hz": 1,
        "spectrum, no FRF: PSD, unit g²/Hz; 20 lines, 1 to 20 Hz every 1 Hz": 1,
        "mode": 2,
    }
    assert (listed.averages, listed.coherence) == ((8,), (0.9, 0.9))
    assert listed.listed_modes == tuple(modes)
    text = "\n".join([*contents_text(listed), *resonances_text(listed)])
    assert text.startswith("Nothing in it looks wrong.\n")
    warned = replace(listed, warnings=(MeasurementWarning("a", "hit 3 is a double hit", "hit again"),) * 2)
    assert next(contents_text(warned)) == "2 warnings, the first: hit 3 is a double hit."
    assert "Modes in the file (2)\n    1        12.5 ± 0.01 Hz   damping 0.4 % ± 0.02 %   shape at 2 DOFs\n" in text
    assert "acc  no direction; 1 spectra" in text
    assert "Resonances: there is no FRF" in text


# ---- hostile and careless input


def test_a_coherence_that_is_not_finite_is_warned_of():
    lines = np.arange(1.0, 21.0)
    for bad, where in ((np.inf, 3), (np.nan, 0)):
        coherence = np.full(20, 0.9)
        coherence[where] = bad
        record = FrfRecord("1:Z+", "2:Z+", lines, lines + 1j, "mobility", "m/s/N", coherence, 5)
        found = [w.sentence for w in contents_of_records([record]).warnings if w.key == "coherence_range"]
        assert found == ["coherence is NaN or infinite on 1 of 20 lines, not 0 to 1"]


def test_too_few_lines_to_fit_are_said_without_a_band_that_nobody_gave():
    lines = np.arange(1.0, 14.0)
    record = FrfRecord("1:Z+", "2:Z+", lines, lines + 1j, "mobility")
    assert inspected([record]).modes_note.startswith("modal fit: found 13 lines; expected 16 or more")


def test_numbers_that_no_measurement_gives_are_warned_of_and_nothing_else_is_judged():
    lines = np.arange(1.0, 41.0)
    for size in (1e300, 1e-300):
        record = FrfRecord("1:Z+", "1:Z+", lines, size * (lines + 1j), "mobility", "m/s/N")
        keys = {w.key for w in contents_of_records([record]).warnings}
        assert keys == {"not_finite", "coherence_missing"}


def conjugated_file(path):
    exact = records(np.random.default_rng(1), lines=COARSE)
    write_records([r.conjugate for r in exact], path, "uff58b")
    return path


def test_a_file_of_conjugates_shows_the_resonances_of_the_structure(found, tmp_path):
    conjugated = inspect_file(conjugated_file(tmp_path / "conjugated.uff"))
    assert [w.key for w in conjugated.warnings] == ["conjugated"]
    assert any("complex conjugates" in note for note in conjugated.notes)
    hz = [mode.frequency_hz for mode in conjugated.modes]
    np.testing.assert_allclose(hz, [mode.frequency_hz for mode in found.modes], rtol=1e-6)
