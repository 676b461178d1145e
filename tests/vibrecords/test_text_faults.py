"""Tables and LabVIEW files that can be read in two ways, or not at all: one line each, and nothing wrong in silence."""

import io
import random
import zipfile

import numpy as np
import pytest

from tests.fuzz.damage import damaged_bytes
from tests.vibrecords.reading import refusal
from tests.vibrecords.test_labview_layouts import NONE, clock, head, lvm, tdms, xlsx
from tests.vibrecords.test_text_layouts import G2, A, B, C, F, G, H, M, P, T, read, rows
from vibrecords.errors import MeasurementError
from vibrecords.records import FrfRecord, SpectrumRecord, TimeRecord

JUMPS = np.where(np.arange(12) % 2, 3.14, -3.14)
FRF, REST = "Frequency [Hz],Real [g/N],Imag [g/N]\n", rows(F, H.real, H.imag)

#: Files that can be read in two ways: what the one line says. The key that decides is named where there is one.
TWO_WAYS = {
    "steps between those of time and frequency": (rows(0.02 * np.arange(16), A, B), 'axis = "time"'),
    "a phase without unit": ("f,Mobility magnitude,Mobility phase\n" + rows(F, M, np.angle(H)), "phase without unit"),
    "small steps that begin above 0": (rows(5 + 0.005 * np.arange(16), A, B), "lines up to 5.075 Hz"),
    "a name that says neither": ("Abscissa,Real,Imag\n" + rows(0.05 * np.arange(16), A, B),
        "'Abscissa': found numbers"),
    "x and y in doubt": ("x0000,y0000\n" + rows(0.05 * np.arange(16), A), "20 samples a second"),
    "magnitude and phase in degrees": (rows(F, M, P, delimiter=";"), "phase in degrees; name the columns"),
    "magnitude and phase in radians": (rows(F, M, JUMPS), "phase in radians; name the columns"),
    "decibels and degrees": (rows(F, 20 * np.log10(M) - 90, P), "phase in degrees; name the columns"),
    "milliseconds or seconds": ("Time,Force [N]\n" + rows(500 * T, A), "expected s .4.096 samples a second. or ms"),
    "decimal commas between commas": ("10,1,25,3,5\n11,2,25,4,5\n12,1,75,3,5\n",
        "comma parts columns or is the decimal"),
    "three columns of whole numbers": ("10,2,5\n11,3,5\n12,4,25\n", "comma parts columns or is the decimal"),
    "decimal commas below names": (
        "Frequency [Hz],Real,Imag\n10,5,1,25,3,5\n11,5,2,25,4,5\n", "found 3 names above 6 columns.*decimal signs"),
    "thousands": ("t [s];F [N]\n0;1.5\n0,001;1,234\n", "points and commas in one table"),
    "thousands with both signs": ("t [s]\tF [N]\n0.001\t1,234.5\n0.002\t1,235.5\n", "points and commas|found"),
    "degrees named radians": ("f [Hz],Mag [g/N],Phase [rad]\n" + rows(F, M, P), "in 'rad' that jumps by"),
    "radians named degrees": (
        "f [Hz],Mag [g/N],Phase [deg]\n" + rows(F, M, JUMPS), "from -π to π"),
    "phase without unit": ("f [Hz],Mag [g/N],Phase\n" + rows(F, M, np.angle(H)),
        "a phase without unit; expected .deg. or .rad."),
    "decibels not named": ("f [Hz],Mag [g/N],Phase [deg]\n" + rows(F, 20 * np.log10(M), P), "a magnitude below 0"),
    "two units of one FRF": ("f [Hz],Real [g/N],Imag [m/s²/N]\n" + REST, "expected one unit of both parts"),
    "channels that begin apart": ("Time [s],A,Time [s],B\n" + rows(T, A, T + 0.1, B), "begins at 0.1, the first at 0"),
    "time and axis = frequency_hz": ("Time,A\n" + rows(T, A), "found 'Time', and axis = 'frequency_hz'",
        "frequency_hz"),
    "two clocks for one X column": (
        lvm(["A", "B"], [T, A, B], head(["N", "g"]) | {"Delta_X": ["0.000488", "0.001"]}), "expected one clock"),
    "a magnitude with gain": (
        "Frequency (Hz),Amplitude (Vpp),Gain (dB),Phase (deg)\n" + rows(F, M, M, P), "found magnitude of ''"),
}  # fmt: skip


@pytest.mark.parametrize("name", TWO_WAYS)
def test_what_can_be_read_in_two_ways_is_refused(tmp_path, name):
    content, said, *axis = TWO_WAYS[name]
    refusal(tmp_path / "measurement", content, said, {"axis": axis[0]} if axis else {})


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


def cut(text, old, new=""):
    assert old in text
    return text.replace(old, new, 1)


TIME = "Time [s],Force [N],Tip [g]\n" + rows(T, A, B)
TWO = "Frequency [Hz],Real A / B [g/N],Imag A / B [g/N],Real C / B [g/N],Imag C / B [g/N]\n"
LVM = lvm(["Force", "Tip"], [T, A, B], head(["N", "g"]))
MULTI = lvm(["Force", "Tip"], [T, A, T, B], head(["N", "g"]), layout="Multi")
ROW = rows(F, H.real, H.imag).splitlines()[4]
FIRST, SECOND, THIRD = ROW.split(",")


def spoiled_rows():
    """Every fault of a number, in every column of a table and of a LabVIEW file."""
    faults = {
        "a word": ("abc", "found 'abc'; expected a number"),
        "an exponent of Fortran": ("1.5D+02", "found '1.5D.02', an exponent of Fortran's; expected E"),
        "a number in two": ("1.5.2", "found '1.5.2'; expected a number"),
        "an underscore": ("1_000", "found '1_000'; expected a number"),
        "thousands": ("1 234 567", "found '1 234 567'; expected a number without separators"),
        "nothing": ("", "found an empty field; expected a number"),
        "a hexadecimal number": ("0x1F", "found '0x1F'; expected a number"),
        "an error of Excel": ("#DIV/0!", "found '#DIV/0!'; expected a number"),
        "a date": ("2026-02-03", "found '2026-02-03'; expected a number"),
        "a complex number": ("1+2i", "found '1.2i'; expected a number"),
        "an instant": ("09:51:39", "found '09:51:39'; expected a number"),
        "a percentage": ("12%", "found '12%'; expected a number"),
        "a unit": ("1.5g", "found '1.5g'; expected a number"),
        "asterisks": ("******", r"found '\*\*\*\*\*\*'; expected a number"),
    }
    for fault, (field, said) in faults.items():
        for column in (1, 2, 3):
            if column == 1 and field[:1] in ("#", "*"):
                continue  # a comment
            fields = ROW.split(",")
            fields[column - 1] = field
            yield f"{fault} in column {column}", (cut(FRF + REST, ROW, ",".join(fields)), "line 6: " + said)
        row = LVM.splitlines()[24]
        spoiled = "\t".join([*row.split("\t")[:1], field, *row.split("\t")[2:]])
        if field:
            yield f"LabVIEW: {fault}", (cut(LVM, row, spoiled), "line 25: " + said)


BROKEN = {
    **dict(spoiled_rows()),
    "a field too few": (cut(FRF + REST, ROW, f"{FIRST},{SECOND}"), "line 6: found 2 fields; expected 3"),
    "a field too many": (cut(FRF + REST, ROW, ROW + ",1"), "line 6: found 4 fields; expected 3"),
    "another delimiter": (cut(FRF + REST, ROW, ROW.replace(",", ";")), "line 6: found 1 fields"),
    "cut within a row": ((FRF + REST)[:-30], "line 13: found 2 fields; expected 3"),
    "names again": (FRF + REST + FRF + REST, "line 14: found 'Frequency .Hz.'; expected a number"),
    "the first row broken": (cut(FRF + REST, "20.0,", "20.0,x"), "line 2: found 'x"),
    "names alone": (FRF, "line 1: found no row of two numbers or more"),
    "one column": ("Force\n" + "".join(f"{a!r}\n" for a in A.tolist()), "found no row of two numbers or more"),
    "a letter": ("Dear colleague,\nhere they are.\n", "line 2: found no row of two numbers or more"),
    "a preamble that does not end": ("a,b\n" * 1500, "found no row of numbers so far"),
    "JSON": ('{"frf": [1, 2, 3],\n"f": [1, 2]}\n', "found no row of two numbers or more"),
    "a name too few": (cut(FRF, ",Imag [g/N]", "") + REST, "line 1: found 2 names above 3 columns"),
    "names of two FRFs above one": (TWO + REST, "line 1: found 5 names above 3 columns of numbers"),
    "the imaginary part not there": (cut(FRF, "Imag", "Real") + REST, "found real of ''; expected real and imaginary"),
    "the phase not there": ("f [Hz],Mag [g/N],Spare\n" + REST, "found magnitude of ''; expected real and"),
    "real and phase": ("f [Hz],Real [g/N],Phase [deg]\n" + REST, "found phase and real of ''"),
    "a part of the second FRF": (cut(TWO, "Imag C", "Imag D") + rows(F, M, P, M, P), "found real of 'C / B'"),
    "misspelt names": (cut(cut(FRF, "Real", "Rael"), "Imag ", "Imagnary ") + REST,
                       "column 2 'Rael' .unknown., column 3 'Imagnary' .unknown."),
    "names of no part": ("Frequency [Hz],a,b\n" + REST, "column 2 'a' .unknown., column 3 'b' .unknown.; expected"),
    "no axis": ("Force [N],Tip [g]\n" + rows(A, B), "no column of frequency or time"),
    "an axis that falls": ("Abscissa,Real,Imag\n" + rows(F[::-1], M, P), "expected one whose numbers rise"),
    "lines alone": ("Line,Sample\n1,2\n2,3\n3,4\n", "column 1 'Line' .index., column 2 'Sample' .index."),
    "frequency alone": ("Frequency [Hz],Line\n" + rows(F, np.arange(12)), "found column 1 'Frequency' .frequency."),
    "four columns without names": (rows(F, M, P, G2), "found 4 columns without a header"),
    "two columns without names": (rows(F, M), "found 2 columns without a header"),
    "a unit of frequency": (cut(FRF, "[Hz]", "[furlong]") + REST, "found the unit 'furlong'; expected Hz or rad/s"),
    "a unit of time": (cut(TIME, "Time [s]", "Time [h]"), "found the unit 'h'; expected s or ms"),
    "a unit of phase": ("f [Hz],Mag [g/N],Phase [gon]\n" + REST.replace("-", ""), "the phase in 'gon'; expected deg"),
    "decibels over nothing": ("f [Hz],Mag [dB re 0 g],Phase [deg]\n" + rows(F, M, P),
        "expected decibels over a number"),
    "averages in words": ("# averages: many\n" + FRF + REST, "found averages 'many'; expected whole numbers"),
    "averages of two": ("# averages: 5, 6\n" + FRF + REST, "found 2 numbers of averages; expected 1 or 1"),
    "averages beyond all":
        ("# averages: 1000000000\n" + FRF + REST, "averages '1000000000'; expected whole numbers from 1 to 1000000"),
    "uneven instants": (cut(TIME, "\n0.0009765625", "\n0.0012"), "instants that are not evenly spaced"),
    "an instant twice": ("t [s],F [N]\n0,1\n0,2\n0,3\n", "instants that are not evenly spaced"),
    "one instant": ("t [s],F [N]\n0,1\n", "found fewer than two instants"),
    "time that is not finite": (cut(TIME, "\n0.0009765625", "\nnan"), "or one that is no number"),
    "a gap in an axis of a channel": ("Time [s],A,Time [s],B\n0,1,0,2\n1e-3,2,,\n2e-3,2,2e-3,2\n",
        "line 3: found an empty"),
    "a column before the first axis": (
        "A,Time [s],B,Time [s],C\n" + rows(B, T, A, T, B), "found 'A' before the first axis; expected"),
    "NUL": ((FRF + REST)[:5000].encode() + b"\0" + REST.encode(), "NUL byte|unknown kind"),
    "a pointer of Git LFS": (
        "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n", "run `git lfs pull`"),
    "a web page": ("<!DOCTYPE html><html></html>", "found a web page"),
    "a universal file in UTF-16": ("    -1\n    58\n".encode("utf-16"),
        "found text in UTF-16; expected a universal file"),
    "an old workbook": (b"\xd0\xcf\x11\xe0" + bytes(200), "save it as .xlsx or CSV"),
    # LabVIEW
    "LabVIEW: header cut": (LVM[:90], "found the end of the file; expected ...End_of_Header"),
    "LabVIEW: header of the segment cut": (LVM[: LVM.index("X_Dimension")], "found no end of the segment's header"),
    "LabVIEW: no segment": (LVM[: LVM.index("Channels")], "found no segment of data"),
    "LabVIEW: no rows": (LVM[: LVM.index("Comment") + 8], "found no row of numbers in the segment"),
    "LabVIEW: no names": (cut(LVM, "X_Value", "1.0"), "expected the names of columns, X_Value first"),
    "LabVIEW: separator": (cut(LVM, "Separator\tTab", "Separator\tPipe"),
        "found separator 'Pipe'; expected Tab or Comma"),
    "LabVIEW: cut within a number": (LVM[: LVM.rindex("\n", 0, -2) - 3],
        "found 15 rows of the segment; expected 16 samples; the file is cut off within a number"),
    "LabVIEW: cut within a row": (LVM[: LVM.rindex("\t")] + "\n", "found 2 fields; expected 3"),
    "LabVIEW: no step": (
        lvm(["A"], [NONE, A], head(["N"]) | {"Delta_X": [""]}, layout="No"),
            "found X0 '' and Delta_X ''; expected numbers"),
    "LabVIEW: a step in words": (
        lvm(["A"], [NONE, A], head(["N"]) | {"Delta_X": ["fast"]}, layout="No"), "Delta_X 'fast'; expected numbers"),
    "LabVIEW: channels that begin apart": (
        lvm(["A", "B"], [T, A, T + 1, B], head(["N", "g"]), layout="Multi"), "begins at 1, the first at 0"),
    "LabVIEW: two starts": (
        lvm(["A", "B"], [T, A, B], head(["N", "g"]) | {"X0": ["0", "1"]}),
            "found X0 '1' and Delta_X .*expected one clock"),
    "LabVIEW: uneven instants": (cut(LVM, "\n0.0009765625", "\n0.0012"), "instants that are not evenly spaced"),
    "LabVIEW: a gap in an axis": (
        lvm(["A", "B"], [T, A, [0.0, None, *T[2:]], B], head(["N", "g"]), layout="Multi"),
            "line 21: found an empty field"),
    "LabVIEW: lines cut within Multi": (MULTI[: MULTI.rindex("\t")] + "\n", "found 4 fields|found 3 fields"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_one_helpful_line(tmp_path, name):
    assert len(refusal(tmp_path / "measurement", *BROKEN[name])) < 600


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
