"""Tables and LabVIEW files that can be read in two ways, or not at all: one line each, and nothing wrong in silence."""

import io
import random
import zipfile

import numpy as np
import pytest

from tests.fuzz.damage import damaged_bytes
from tests.vibrecords.reading import G2, A, B, C, F, G, H, M, T
from tests.vibrecords.test_labview_layouts import clock, tdms, xlsx
from tests.vibrecords.test_text_layouts import P, read, rows
from vibrecords.errors import MeasurementError
from vibrecords.records import FrfRecord, SpectrumRecord, TimeRecord

FRF, REST = "Frequency [Hz],Real [g/N],Imag [g/N]\n", rows(F, H.real, H.imag)


def test_the_layout_decides(tmp_path):
    content = rows(0.02 * np.arange(16), A, B)
    first, second = read(tmp_path, content, axis="time")
    assert isinstance(second, TimeRecord)
    assert first.sample_rate_hz == pytest.approx(50)
    assert first.notes == ("column 1 taken as time in s, as the layout says",)
    (record,) = read(tmp_path, content, axis="frequency_hz")
    assert isinstance(record, FrfRecord)
    np.testing.assert_array_equal(record.values, A + 1j * B)
    for wrong in ({"axis": "ms"}, {"frf": "H"}):
        with pytest.raises(MeasurementError, match="expected axis, which is time or frequency_hz"):
            read(tmp_path, content, **wrong)
    with pytest.raises(MeasurementError, match="found 'Time', and axis = 'frequency_hz'"):
        read(tmp_path, "Time,A\n" + rows(T, A), axis="frequency_hz")
    with pytest.raises(MeasurementError, match="line 1001: found no row of numbers so far"):
        read(tmp_path, "a,b\n" * 1500)


def test_what_is_decided_by_evidence_is_said(tmp_path):
    """Time as frequency, a missing unit, volts, decibels, lines counted: never in silence."""

    def notes(content):
        return " | ".join(note for record in read(tmp_path, content) for note in record.notes)

    assert "taken as time in s, since it goes from 0 in steps of 0.000488281" in notes(rows(T, A, B))
    assert "taken as time in s, since it goes from -0.001" in notes(rows(T - T[3], A, B, C))
    assert "taken as frequency in Hz, since it goes from 20 in steps of 2.5" in notes(rows(F, H.real, H.imag))
    assert "frequency without unit taken as Hz" in notes("Frequency,Real,Imag\n" + REST)
    assert "time without unit taken as s, 81.92 samples a second" in notes("Time,A\n" + rows(25 * T, A))
    assert "column 1, which counts rows, passed over" in notes(rows(np.arange(16), T, A))
    assert "passed over: column 1 'Line' (index)" in notes("Line," + FRF + rows(np.arange(1, 13), F, H.real, H.imag))
    assert "over volts, values left as written" in notes("f [Hz],Re [m/s²/V],Im [m/s²/V]\n" + REST)
    assert "decibels taken as 20 log10 of the magnitude over 1" in notes(
        "f [Hz],Mag [dB],Phase [deg]\n" + rows(F, M, P)
    )
    mixed = read(tmp_path, "t [s],A [g],B,C\n" + rows(T, A, B, C))
    assert [record.factor for record in mixed] == [G, None, None]
    assert "not taken as SI" in mixed[1].notes[0]
    pairs = "Frequency [Hz],Real A / B [g/N],Imag A / B [g/N],Real C / B,Imag C / B\n"
    assert [r.factor for r in read(tmp_path, pairs + rows(F, H.real, H.imag, M, G2))] == [G, None]
    (spectrum,) = read(tmp_path, "Time [s],Tip FFT [dB]\n" + rows(F, M))
    assert isinstance(spectrum, SpectrumRecord)
    assert "taken as frequency in Hz" in spectrum.notes[0]


@pytest.mark.whole
def test_broken_tdms_and_workbooks_are_one_line(tmp_path):
    """Cut at every length, other bytes, no clock, a bomb: an error of one line, or what is left."""
    whole = tdms({"Test": [("Force", A, {"wf_increment": 0.001}), ("Tip", B, {"wf_increment": 0.001})]})
    choices = random.Random(3)
    book = xlsx(a=np.column_stack([T, A]).tolist())
    for sound in (whole, book):
        refused = 0
        for _ in range(60):
            content = sound[:4] + damaged_bytes(choices, sound[4:])
            try:
                read(tmp_path, content)
            except MeasurementError as error:
                refused += 1
                lines = str(error).splitlines()
                assert "expected" in lines.pop(), error  # noqa: PT017 - one of many files, each of which may be read
                assert not lines
        assert refused > 20
    for groups, said in (
        ({"a": [("x", A, {}), ("y", B, {})]}, "without a wf_increment; expected the time between samples"),
        ({"a": [("x", A, {"wf_increment": 1.0})]}, "without a wf_increment"),
        ({"a": [("x", A, {"NI_Number_Of_Scales": np.uint32(4e9)})]}, "found 4000000000 scales"),
        ({"a": [("x", A, clock(step=0.1)), ("y", B, clock(step=0.1, wf_start_offset=1.0))]}, "begins at"),
    ):
        with pytest.raises(MeasurementError, match=said):
            read(tmp_path, tdms(groups))
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("xl/workbook.xml", "<x/>")
        for i in range(6):
            archive.writestr(f"xl/worksheets/sheet{i}.xml", bytes(10**8))
    with pytest.raises(MeasurementError, match="found 600 MB when unpacked; expected at most 512"):
        read(tmp_path, bomb.getvalue())
    with pytest.raises(MeasurementError, match="sheet 'a', line 1: found no row of two numbers"):
        read(tmp_path, xlsx(a=[["Dear reader"]]))


@pytest.mark.parametrize(("package", "content"), [("nptdms", b"TDSm" + bytes(50)), ("openpyxl", None)])
def test_a_package_that_is_missing_is_named(tmp_path, monkeypatch, package, content):
    content = content or xlsx(a=[[1.0, 2.0]])
    monkeypatch.setitem(__import__("sys").modules, package, None)
    with pytest.raises(MeasurementError, match=r"pip install jointbayes\[files\]"):
        read(tmp_path, content)
