"""Universal files as programs write them: modes, several references, coherences alone, spectra, longer headers.

Layouts: Structural Dynamics Research Lab, University of Cincinnati, Universal File Formats, data sets 55 and 58; the ID
lines and columns of ARTeMIS (its help, "UFF Data Set Number 55"), of I-DEAS Test (notes 8 and 12 of data set 55) and of
pyuff, which is the oracle for what it reads.
"""

import math

import numpy as np
import pytest
import pyuff
from benchmarks.written_files import write_records

from tests.vibrecords.made_files import function_58, header_164, mode_55
from tests.vibrecords.reading import records_of
from vibrecords.errors import MeasurementError
from vibrecords.formats import iter_records, uff_data_sets
from vibrecords.inspection import inspect_file
from vibrecords.records import CoherenceRecord, FrfRecord, ModeRecord, SpectrumRecord, TimeRecord

RNG = np.random.default_rng(22)
H = RNG.normal(size=11) + 1j * RNG.normal(size=11)
SHAPE = {4: [0.0, 1.25, 0.0], 7: [0.5, -0.75, 0.0]}
POLE = (-3.0, 300.0)  # rad/s
DAMPED = (math.hypot(*POLE) / (2 * math.pi), 3 / math.hypot(*POLE))


#: Each with the kinds of its records, and what is right of the first.
WELL_FORMED = {
    "a mode with the last digits that our writer once put behind it":
        (mode_55(SHAPE) + "    -1\n 58017\n +1 +2\n    -1\n", [ModeRecord], {"frequency_hz": 52.5}),
    "normal mode, 3 DOFs at a node":
        (mode_55(SHAPE), [ModeRecord],
        {"number": 3, "frequency_hz": 52.5, "damping_ratio": 0.012, "modal_mass": 2.0, "frequency_sd_hz": None}),
    "normal mode, 6 DOFs at a node":
        (mode_55({2: [1.0, 2, 3, 4, 5, 6]}), [ModeRecord],
        {"shape": {f"2:{a}+": n for n, a in enumerate(("X", "Y", "Z", "RX", "RY", "RZ"), 1)}}),
    "normal mode, scalars": (mode_55({2: [1.5]}), [ModeRecord], {"shape": {"2:S": 1.5}}),
    "normal mode, hysteretic damping alone":
        (mode_55(SHAPE, (10.0, 0.0, 0.0, 0.04)), [ModeRecord],
        {"damping_ratio": 0.02, "modal_mass": None, "notes": ("damping ratio half the hysteretic damping, 0.04",)}),
    "complex eigenvalue of first order":
        (mode_55({4: [1j, 2 - 1j, 0]}, (*POLE, 0.0, 1.0, 0.0, 0.0), analysis=3), [ModeRecord],
        {"frequency_hz": DAMPED[0], "damping_ratio": DAMPED[1], "shape": {"4:X+": 1j, "4:Y+": 2 - 1j, "4:Z+": 0}}),
    "complex eigenvalue of second order, velocities":
        (mode_55({4: [1j, 2, 0]}, (*POLE, 0.0, 1.0, 0.0, 0.0), analysis=7, motion=11), [ModeRecord],
        {"frequency_hz": DAMPED[0], "notes": ("shape in velocities",)}),
    "modes of ARTeMIS: frequency in an ID line, no damping":
        (mode_55(SHAPE, (52.5, 0.0, 0.0, 0.0), ids=("Mode 1, Frequency: 52.50 Hz", *["NONE"] * 4)), [ModeRecord],
        {"damping_ratio": None, "notes": ()}),
    "modes of I-DEAS Test: reference and signal codes in ID line 5":
        (mode_55(SHAPE, ids=(*["NONE"] * 4, f"{4:10d}{2:10d}{12:10d}{13:10d}")) + mode_55(SHAPE, number=4),
        [ModeRecord, ModeRecord], {"where": "data set 1"}),
    "rigid-body mode": (mode_55(SHAPE, (0.0, 1.0, 0.0, 0.0)), [ModeRecord], {"frequency_hz": 0.0}),
    "mode without nodes": (mode_55({}), [ModeRecord], {"shape": {}}),
    "static deflection and stress beside a mode":
        (mode_55(SHAPE, (0.0,), analysis=1, counts=(1, 1, 1, 0)) + mode_55(SHAPE, motion=2) + mode_55(SHAPE),
        [ModeRecord], {"where": "data set 3"}),
    "mode and FRF": (mode_55(SHAPE) + function_58(H), [ModeRecord, FrfRecord], {"number": 3}),
    "two references":
        ("".join(function_58(H, response=("NONE", n, 3), reference=("NONE", m, 3)) for m in (1, 2) for n in (1, 2)),
        [FrfRecord] * 4, {"response": "1:Z+", "reference": "1:Z+"}),
    "coherence in a file of its own":
        (function_58(np.full(11, 0.5), function=6), [CoherenceRecord], {"response": "12:Z+", "reference": "11:Y+"}),
    "spectra beside an FRF":
        ("".join(function_58(H.real, function=n) for n in (2, 9, 12)) + function_58(H, function=3) + function_58(H),
        [SpectrumRecord] * 4 + [FrfRecord],
        {"kind": "auto spectrum", "channel": "12:Z+", "notes": ("values not read",)}),
    "a time history in milliseconds":
        (function_58(H.real, function=1, first=0.0, kinds=("time", "force", "none"), units=("ms", "N", "NONE")),
        [TimeRecord], {"sample_rate_hz": 2000.0}),
    "a spectrum on lines of both signs":
        (function_58(np.arange(21.0), function=2, first=-5.0), [SpectrumRecord],
        {"notes": ("values not read", "two-sided axis: 11 of 21 lines, from 0 Hz on")}),
    "ID lines longer than 80 columns":
        (function_58(H, ids=("x" * 200, *["NONE"] * 4)), [FrfRecord], {"quantity": "accelerance"}),
    "two ID lines more": (function_58(H, ids=("a", "b", "c", "d", "e", "f", "g")), [FrfRecord], {"response": "12:Z+"}),
    "text behind column 80":
        ("\n".join(f"{line:<80}" + "   [SEQ 12]" * (6 < n < 13) for n, line in enumerate(function_58(H).split("\n"))),
        [FrfRecord], {"response": "12:Z+", "reference": "11:Y+"}),
    "degrees of freedom in wider columns":
        (function_58(H).replace(f"NONE      {12:10d}{3:4d}", f"NONE{12:18d}{3:8d}"), [FrfRecord],
        {"response": "12:Z+", "reference": "11:Y+", "unit": "(m/s^2)/N"}),
    "name of an axis longer than its columns":
        (function_58(H).replace(f"{'NONE':<20} {'m/s^2':<20}", "Acceleration of the response m/s^2"), [FrfRecord],
        {"quantity": "accelerance", "factor": 1.0}),
    "unit longer than its columns":
        (function_58(H, units=("Hz", "(Millimetres/s^2)/Newtons", "NONE")), [FrfRecord],
        {"unit": "(Millimetres/s^2)/Newtons"}),
    "two systems of units one after the other":
        (header_164(1000.0, 1.0, 5, "mm, N") + function_58(H,
        units=("Hz", "NONE", "NONE")) + header_164() + function_58(H, units=("Hz", "NONE", "NONE"),
        response=("NONE", 2, 3)), [FrfRecord, FrfRecord], {"factor": 1e-3}),
}  # fmt: skip


@pytest.mark.parametrize("name", WELL_FORMED)
def test_what_programs_write_is_read_right(tmp_path, name):
    text, kinds, expected = WELL_FORMED[name]
    records = records_of(tmp_path / "a.uff", text)
    assert [type(record) for record in records] == kinds
    first = records[0]
    for key, value in expected.items():
        assert getattr(first, key) == (pytest.approx(value, rel=1e-12) if isinstance(value, float) else value), key
    for record in records:
        if isinstance(record, FrfRecord):
            np.testing.assert_allclose(record.frequency_hz, 1 + 0.5 * np.arange(11), rtol=1e-12)
            np.testing.assert_allclose(record.values, H * (record.factor or 1), rtol=1e-12)
        if isinstance(record, CoherenceRecord):
            np.testing.assert_array_equal(record.values, 0.5)


@pytest.mark.parametrize("part", [1, 64, 1000])
def test_functions_are_the_same_whatever_is_decoded_at_once(tmp_path, monkeypatch, part):
    values = RNG.normal(size=301) + 1j * RNG.normal(size=301)
    time = function_58(values.real, function=1, first=0.0, kinds=("time", "force", "none"), units=("s", "N", "NONE"))
    uneven = function_58(values, np.sort(RNG.uniform(1, 900, 301)), response=("NONE", 2, 3))
    loose = "\n".join(" ".join(line.split()) if "E" in line[4:20] else line for line in uneven.split("\n"))
    text = time + function_58(values) + uneven + loose.replace("         2   3", "         5   3")
    whole = records_of(tmp_path / "a.uff", text)
    monkeypatch.setattr(uff_data_sets, "_PART", part)
    for record, same in zip(records_of(tmp_path / "a.uff", text), whole, strict=True):
        np.testing.assert_array_equal(record.values, same.values)
        if isinstance(record, FrfRecord):
            np.testing.assert_array_equal(record.frequency_hz, same.frequency_hz)
    with pytest.raises(MeasurementError, match="line 164: found 601 numbers; expected 602"):
        records_of(tmp_path / "a.uff", function_58(values).replace(f"{values[150].real:20.12E}", " " * 20))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves files open
@pytest.mark.parametrize(("analysis", "per_node"), [(2, 3), (2, 6), (3, 3), (7, 3)])  # complex ones of 6 it has not
def test_modes_of_pyuff_are_read_as_it_reads_them(tmp_path, analysis, per_node):
    numbers = RNG.normal(size=(per_node, 4)) + (0 if analysis == 2 else 1j * RNG.normal(size=(per_node, 4)))
    common = {"model_type": 1, "analysis_type": analysis, "data_ch": 2, "spec_data_type": 8, "load_case": 1}
    common |= {f"r{i + 1}": row for i, row in enumerate(numbers)} | {"node_nums": [3, 5, 8, 13], "mode_n": 2}
    common |= {"data_type": 2 if analysis == 2 else 5, "n_data_per_node": per_node}
    stated = {"freq": 81.25, "modal_m": 2.5, "modal_damp_vis": 0.0125, "modal_damp_his": 0.0}
    if analysis != 2:
        stated = {"eig": complex(*POLE), "modal_a": 1 + 2j, "modal_b": 0j}
    path = tmp_path / "a.uff"
    pyuff.UFF(str(path)).write_sets(pyuff.prepare_55(**common, **stated), "add")
    theirs = pyuff.UFF(str(path)).read_sets()
    (mode,) = iter_records(path)
    axes = ("X", "Y", "Z", "RX", "RY", "RZ")[:per_node]
    assert (mode.number, set(mode.shape)) == (2, {f"{n}:{axis}+" for n in (3, 5, 8, 13) for axis in axes})
    for i, axis in enumerate(axes):
        ours = [mode.shape[f"{int(node)}:{axis}+"] for node in theirs["node_nums"]]
        np.testing.assert_array_equal(ours, theirs[f"r{i + 1}"])
    if analysis == 2:
        said = [theirs[key] for key in ("freq", "modal_damp_vis", "modal_m")]
        assert [mode.frequency_hz, mode.damping_ratio, mode.modal_mass] == said
    else:
        assert mode.frequency_hz == abs(theirs["eig"]) / (2 * np.pi)


def exact_modes():
    labels = [f"{node}:{axis}+" for node in (3, 12) for axis in ("X", "Y", "Z", "RX", "RY", "RZ")]
    values = RNG.normal(size=(2, 12)) * 10.0 ** RNG.integers(-9, 9, size=(2, 12))
    return [
        ModeRecord(n + 1, 1 / 3 + n, 0.1 / 3, 0.01 / 3, 1e-5 / 3, dict(zip(labels, row.tolist(), strict=True)), 1 / 7)
        for n, row in enumerate(values)
    ]


def test_modes_written_are_read_back_with_the_six_digits_of_their_columns(tmp_path):
    modes = exact_modes()
    shape = {label: value * (1 + 0.25j) for label, value in modes[1].shape.items()}
    modes[1] = ModeRecord(2, 1 / 3, shape=shape, damping_ratio=0.1)
    write_records(modes, tmp_path / "a.uff", "uff58")
    for written, back in zip(modes, iter_records(tmp_path / "a.uff"), strict=True):
        for key in ("number", "frequency_sd_hz", "damping_sd"):
            assert getattr(back, key) == getattr(written, key), key
        for key in ("frequency_hz", "damping_ratio", "shape"):
            assert getattr(back, key) == pytest.approx(getattr(written, key), rel=1e-5), key
    assert [back.modal_mass for back in iter_records(tmp_path / "a.uff")] == [pytest.approx(1 / 7, rel=1e-5), None]


def test_a_spectrum_is_listed_and_no_data(tmp_path):
    (tmp_path / "a.uff").write_text(function_58(H.real, function=9))
    inspection = inspect_file(tmp_path / "a.uff")
    assert "power spectral density" in " ".join(inspection.kinds)
    assert "11 lines, 1 to 6 Hz" in " ".join(inspection.kinds)
    assert (inspection.frfs, inspection.modes) == ((), ())


PASSIVE = 1 / (1e4 * (1 + 0.1j) - (2 * np.pi * (1 + 0.5 * np.arange(60))) ** 2)
PAIR = {"response": ("NONE", 1, 3), "reference": ("NONE", 1, 3)}
RECEPTANCE = {"kinds": ("frequency", "displacement", "force"), "units": ("Hz", "m", "N")}


def notes_of(records):
    return " | ".join(note for record in records for note in record.notes)


#: What could be read in two ways, and the words that say so: refused, noted, or warned of.
HOSTILE = {
    "conjugated": (function_58(PASSIVE.conj(), **PAIR, **RECEPTANCE), "complex conjugate"),
    "axis types against the unit":
        (function_58(H, kinds=("frequency", "velocity", "force")), "axis types say mobility"),
    "data set 164 against the unit": (header_164(1000.0) + function_58(H), "says otherwise"),
    "coherence of another pair":
        (function_58(H) + function_58(np.full(11, 0.5), function=6, response=("NONE", 13, 3)),
        "coherence of 13:Z+ stands alone"),
    "one coherence, two FRFs": (function_58(H) * 2 + function_58(np.full(11, 0.5), function=6), "none taken"),
    "FRF over time":
        (function_58(H, kinds=("time", "acceleration", "force"), units=("s", "m/s^2", "N")),
        "found a function of type 4 over an abscissa of type 17 and unit s; expected frequency"),
    "time history over frequency": (function_58(H.real, function=1), "found a function of type 1 over an abscissa"),
    "coherence over time":
        (function_58(H.real, function=6, kinds=("time", "none", "none"), units=("s", "NONE", "NONE")),
        "found a function of type 6 over an abscissa of type 17"),
    "unit of seconds at an axis of no type":
        (function_58(H, kinds=("none", "acceleration", "force"), units=("ms", "m/s^2", "N")),
        "found a function of type 4 over an abscissa of type 0 and unit ms"),
    "FRF over volts": (function_58(H, units=("Hz", "m/s^2", "V")), "over volts"),
    "decibels": (function_58(H.real, units=("Hz", "dB", "NONE")), "dB"),
    "force over motion":
        (function_58(H, kinds=("frequency", "force", "acceleration"), units=("Hz", "N", "m/s^2")), "force over motion"),
    "FRF without imaginary part": (function_58(np.abs(H)), "FRF without imaginary part"),
    "function of unknown type": (function_58(H, function=0), "function of unknown type taken for an FRF"),
    "damping in percent": (mode_55(SHAPE, (52.5, 1.0, 1.2, 0.0)), "damping ratio 1.2 not taken"),
    "damping in percent, below one": (mode_55(SHAPE, (52.5, 1.0, 0.5, 0.0)), "some programs write percent"),
    "eigenvalue of the other sign":
        (mode_55(SHAPE, (3.0, 300.0, 0.0, 0.0, 0.0, 0.0), analysis=3), "negative damping ratio"),
    "eigenvalue in hertz":
        (mode_55(SHAPE, (-0.5, 52.5, 0.0, 0.0, 0.0, 0.0), analysis=3, ids=("Mode 1 52.5 Hz", *["NONE"] * 4)),
        "and 52.5 Hz in an ID line"),
    "shape of accelerations": (mode_55(SHAPE, motion=12), "shape in accelerations"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_nothing_that_could_be_read_in_two_ways_is_read_in_silence(tmp_path, name):
    text, said = HOSTILE[name]
    if said.startswith("found"):
        with pytest.raises(MeasurementError, match=said):
            records_of(tmp_path / "a.uff", text)
        return
    records = records_of(tmp_path / "a.uff", text)
    alone = [f"coherence of {r.response} stands alone" for r in records if isinstance(r, CoherenceRecord)]
    assert all(r.coherence is None for r in records if isinstance(r, FrfRecord))
    warned = [f"{w.key} {w.sentence} {w.remedy}" for w in inspect_file(tmp_path / "a.uff").warnings]
    assert said in " | ".join([notes_of(records), *alone, *warned])


def test_every_mode_cut_anywhere_is_read_or_one_line(tmp_path):
    whole = mode_55(SHAPE) + mode_55({4: [1j, 2, 0]}, (*POLE, 0.0, 1.0, 0.0, 0.0), analysis=3)
    for size in range(0, len(whole), 7):
        try:
            assert all(isinstance(r, ModeRecord) for r in records_of(tmp_path / "a.uff", whole[:size] or " "))
        except MeasurementError as error:
            assert "\n" not in str(error)  # noqa: PT017 (most cuts are errors, some are none)
