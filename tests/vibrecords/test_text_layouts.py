"""Tables, LabVIEW files, TDMS and workbooks as programs lay them out, from their public documentation: what is in them.

All files are made here. FRFs have 12 lines, records 16 samples; what is read must be right to 1e-12.
"""

import itertools

import numpy as np
import pytest

from tests.vibrecords.reading import records_of, require
from vibrecords.formats.table_text import column_of
from vibrecords.records import CoherenceRecord, FrfRecord, SpectrumRecord, TimeRecord

RNG = np.random.default_rng(22)
F = 20.0 + 2.5 * np.arange(12)
H = RNG.normal(size=12) + 1j * RNG.normal(size=12)
H2 = RNG.normal(size=12) + 1j * RNG.normal(size=12)
G2 = RNG.uniform(0.5, 1, 12)
T = np.arange(16) / 2048
A, B, C = RNG.normal(size=(3, 16))
G, LBF = 9.80665, 4.4482216152605


def rows(*columns, delimiter=",", decimal=".", end="\n", digits=None):
    """Rows of numbers; None stands for an empty field."""
    text = [
        delimiter.join("" if x is None else repr(float(x)).replace(".", decimal) for x in row)
        for row in itertools.zip_longest(*columns)
    ]
    return "".join(line + end for line in text)


def frf(response="output 1", reference="input 1", values=H, quantity=None, factor=1.0, coherence=None):
    return {"type": FrfRecord, "frequency_hz": F, **locals()}


def time(channel, values, quantity="unknown", factor=1.0, sample_rate_hz=2048.0, hit=None):
    return {"type": TimeRecord, **locals()}


def spectrum(channel, values, kind):
    return {"type": SpectrumRecord, "frequency_hz": F, **locals()}


def read(tmp_path, content, **layout):
    return records_of(tmp_path / "measurement", content, **layout)


SIGNALCALC = "Mobilyzer\nProject\t12\nDate\t2026/02/03\nAverages\t10\n\n"
M, P = np.abs(H), np.angle(H, deg=True)
ACC = {"quantity": "accelerance"}

TABLES = {
    # OpenModal: modaldata.py, export_to_csv writes frq, amp_real and amp_imag of each measurement
    "OpenModal": ("frq,amp_real,amp_imag\n" + rows(F, H.real, H.imag), [frf("amp")]),
    # Data Physics SignalCalc, ASCII export: names, blank, "Units:", units (as ModeLAB's read_signalcalc has it)
    "SignalCalc, one channel":
        (SIGNALCALC + "Frequency\tReal\tImaginary\n\nUnits:\nHz\t(m/s2)(N)\t\n\n" + rows(F, H.real, H.imag,
        delimiter="\t"), [frf(**ACC)]),
    "SignalCalc, several channels": (
        "Data written for Mobilyzer\n\n\tH1,2\t\tH1,3\t\nFrequency\tReal\tImag\tReal\tImag\n\nUnits:\n"
        "Hz\tg/N\t\tg/N\t\n\n" + rows(F, H.real, H.imag, H2.real, H2.imag, delimiter="\t"),
        [frf("H1,2", values=G * H, factor=G, **ACC), frf("H1,3", values=G * H2, factor=G, **ACC)],
    ),
    "SignalCalc, magnitude":
        (SIGNALCALC + "Frequency\tMagnitude\tPhase\n\nUnits:\nHz\t(m/s)(N)\tdeg\n\n" + rows(F, M, P, delimiter="\t"),
        [frf(quantity="mobility")]),
    "SignalCalc, time":
        (SIGNALCALC + "Time\tReal\n\nUnits:\nsec\tm/s2\n\n" + rows(T, A, delimiter="\t"),
        [time("Real", A, "acceleration")]),
    "SignalCalc, autospectrum": (
        "Data written for Mobilyzer\n\n\tG1,1 autospectrum\nFrequency\tReal\n\nUnits:\nHz\t(m/s2)^2/Hz\n\n"
        + rows(F, M, delimiter="\t"),
        [spectrum("G1,1 autospectrum Real", M, "autospectrum")],
    ),
    # CutPro: the first row carries names and units behind its numbers
    "CutPro":
        (rows(F[:1], H.real[:1], H.imag[:1], delimiter="\t", end="\tFreq\tHz\tReal\tm/N\tImag\tReal\t\n") + rows(F[1:],
        H.real[1:], H.imag[1:], delimiter="\t", end="\t\n"), [frf(quantity="receptance")]),
    "CutPro, numbers alone":
        (rows(F, H.real, H.imag, delimiter="\t"), [frf("output 1") | {"notes": (
        "no name: column 1 taken as frequency in Hz, since it goes from 20 in steps of 2.5",)}]),
    # pyqtgraph, exporters/CSVExporter: (x,y) per plot
    "pyqtgraph": ("x0000,y0000\n" + rows(T, A, delimiter=", ", end=",\n"), [time("y0000", A)]),
    "pyqtgraph with names": (
        '"Ch 0 - Voltage_0_x","Ch 0 - Voltage_0_y","Ch 1 - Voltage_1_x","Ch 1 - Voltage_1_y"\n'
        + rows(T, A, T[:9], B[:9], end=",\n"),
        [time("Ch 0 - Voltage_0", A), time("Ch 1 - Voltage_1", B[:9])],
    ),
    # Tektronix MSO/DPO2000 to 4000 programmer manuals: spreadsheet format
    "Tektronix": (
        "Model,MSO4034\nFirmware Version,2.48\n\nPoint Format,Y,\nHorizontal Units,S,\nSample Interval,4.88e-4,\n"
        "Record Length,16,\nVertical Units,V,V,\nProbe Attenuation,1,1,\nLabel,,\nTIME,CH1,CH2\n"
        + rows(T - T[4], A, B),
        [time("CH1", A, factor=None), time("CH2", B, factor=None)],
    ),
    # Rigol DS1000Z user's guide: CSV of one channel
    "Rigol":
        ("X,CH1,Start,Increment,\nSequence,Volt,-1.953125e-3,4.8828125e-4,\n" + "".join(f"{i},{a!r},\n" for i,
        a in enumerate(A.tolist())), [time("CH1", A, factor=None)]),
    "Rigol, empty fields": (
        "X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,0,4.8828125e-4\n"
        + "".join(f"{i},{a!r},{b!r},,\n" for i, (a, b) in enumerate(zip(A.tolist(), B.tolist(), strict=True))),
        [time("CH1", A, factor=None), time("CH2", B, factor=None)],
    ),
    # Keysight InfiniiVision user's guide: CSV
    "Keysight": (
        "x-axis,1,2\nsecond,Volt,Volt\n" + rows(T, A, B),
        [time("1", A, factor=None), time("2", B, factor=None)],
    ),
    # Siglent: key and value, then Second,Value
    "Siglent": (
        "Record Length,Analog:16\nSample Interval,0.00048828125\nVertical Units,V\nModel Number,SDS1104\nSecond,Value\n"
        + rows(T, A),
        [time("Value", A, factor=None)],
    ),
    # Rohde & Schwarz RTM20 user manual: CSV1
    "Rohde & Schwarz": ("in s,C1 in V\n" + rows(T, A), [time("C1 in V", A)]),
    # LeCroy 9300C manual, appendix E: spreadsheet format
    "LeCroy": (
        "LECROY9354,935412345\nSegments,1,SegmentSize,16\nSegment,TrigTime,TimeSinceFirstSegment\n"
        "#1,21 Mar 1990 9:37:08,0.0\nTime,Ampl\n" + rows(T, A),
        [time("Ampl", A)],
    ),
    # PicoScope 6: text export with a row of units in brackets
    "PicoScope": (
        "Time,Channel A,Channel B\n(ms),(N),(g)\n\n" + rows(1e3 * T, A, B),
        [time("Channel A", A, "force"), time("Channel B", G * B, "acceleration", G)],
    ),
    # Ansys Twin Builder, CSV file format
    "Twin Builder, complex":
        ('"f [kHz]","Re(y1)[m/N]","Im(y1)[m/N]"\n' + rows(F / 1000, H.real, H.imag),
        [frf("y1", quantity="receptance")]),
    "Twin Builder, polar":
        ('"f [Hz]","Abs(y1)[mm/N]","Phi(y1)[rad]"\n' + rows(F, M, np.angle(H)),
        [frf("y1", values=1e-3 * H, quantity="receptance", factor=1e-3)]),
    "Twin Builder, time": (
        '"Time [ms]", "R1.F [kN]", "M1.A [g]"\n' + rows(1e3 * T, A, B),
        [time("R1.F", 1e3 * A, "force", 1e3), time("M1.A", G * B, "acceleration", G)],
    ),
    # phyphox: export of an experiment as CSV
    "phyphox": (
        '"Time (s)","Acceleration x (m/s^2)","Acceleration y (m/s^2)"\n' + rows(T, A, B),
        [time("Acceleration x", A, "acceleration"), time("Acceleration y", B, "acceleration")],
    ),
    # DEWESoft: text export, header and data
    "DEWESoft": (
        "Data header\nSample rate (Hz): 2048\nStore date: 03.02.2026\n\nData1\nTime (s);Hammer (N);Tip (m/s2)\n"
        + rows(T, A, B, delimiter=";", decimal=","),
        [time("Hammer", A, "force"), time("Tip", B, "acceleration")],
    ),
    # Siemens/LMS Test.Lab: export to text, all forms of one FRF
    "Test.Lab": (
        "Function class\tFRF\nReference\t11:+Y\nResponse\t12:+Z\n\nFrequency (Hz)\tReal (g/N)\tImaginary (g/N)\t"
        "Magnitude (g/N)\tPhase (°)\n" + rows(F, H.real, H.imag, M, P, delimiter="\t"),
        [frf(values=G * H, factor=G, **ACC)],
    ),
    # Brüel & Kjær: lines with their number, decibels and degrees
    "lines, decibels":
        ("Line\tFrequency [Hz]\tMagnitude [dB re 1e-6 m/s²/N]\tPhase [deg]\n" + rows(np.arange(12), F,
        20 * np.log10(M) + 120, P, delimiter="\t"), [frf(**ACC)]),
    "German":
        ("Messung;12\nFrequenz [Hz];Realteil A / B [m/s²/N];Imaginärteil A / B [m/s²/N];Kohärenz A / B\n" + rows(F,
        H.real, H.imag, G2, delimiter=";", decimal=","), [frf("A", "B", coherence=G2, **ACC)]),
    "German, Latin-1":
        (("Frequenz in Hz;Betrag H21 [m/s/N];Phase H21 [°]\n" + rows(F, M, P, delimiter=";",
        decimal=",")).encode("latin-1"), [frf("H21", quantity="mobility")]),
    "German, time":
        ("Zeit in s;Kraft in N;Beschleunigung in m/s²\n" + rows(T, A, B, delimiter=";", decimal=","),
        [time("Kraft", A, "force"), time("Beschleunigung", B, "acceleration")]),
    "French":
        ("Fréquence (Hz)\tPartie réelle (m/N)\tPartie imaginaire (m/N)\tCohérence\n" + rows(F, H.real, H.imag, G2,
        delimiter="\t", decimal=","), [frf(quantity="receptance", coherence=G2)]),
    "French, polar":
        ("Fréquence (Hz);Module (g/N);Phase (deg)\n" + rows(F, M, P, delimiter=";", decimal=","),
        [frf(values=G * H, factor=G, **ACC)]),
    "French, time": (
        "Temps (ms)\tForce (N)\tAccélération (g)\n" + rows(1e3 * T, A, B, delimiter="\t", decimal=","),
        [time("Force", A, "force"), time("Accélération", G * B, "acceleration", G)],
    ),
    # Excel: "Unicode text" is UTF-16 with tabs; text for the Macintosh ends lines with CR
    "UTF-16":
        (("Frequency [Hz]\tReal [m/s²/N]\tImag [m/s²/N]\n" + rows(F, H.real, H.imag, delimiter="\t")).encode("utf-16"),
        [frf(**ACC)]),
    "UTF-16, big end first":
        (("\ufefft [s];F [N]\r\n" + rows(T, A, delimiter=";", end="\r\n")).encode("utf-16-be"),
        [time("F", A, "force")]),
    "CR": ("Hz,Real,Imag\r" + rows(F, H.real, H.imag, end="\r"), [frf()]),
    "Excel, sep=": ("sep=;\nf/Hz;Re;Im\n" + rows(F, H.real, H.imag, delimiter=";"), [frf()]),
    # pandas, DataFrame.to_csv with its index; NumPy, savetxt with a header
    "pandas": (",time_s,force\n" + rows(np.arange(16), T, A), [time("force", A)]),
    "savetxt": ("# frequency real imag\n" + rows(F, H.real, H.imag, delimiter=" "), [frf()]),
    "numbers above the names": (
        "2048 16\nTime (s)  Force (N)\n" + rows(T, A, delimiter="  "),
        [time("Force", A, "force")],
    ),
    # National Instruments DIAdem and catman: names, then a row of units, each channel with its own time
    "an axis for each channel":
        ("Time\tForce\tTime\tTip\ns\tN\tms\tg\n" + rows(T, A, 1e3 * T[:8], B[:8], delimiter="\t"),
        [time("Force", A, "force"), time("Tip", G * B[:8], "acceleration", G)]),
    "coherence alone":
        ("Frequency [Hz],Coherence tip / hammer\n" + rows(F, G2),
        [{"type": CoherenceRecord, "response": "tip", "reference": "hammer", "frequency_hz": F, "values": G2}]),
    "a marker and an empty column":
        ("Time [s],Marker,Force [N],Spare,Tip [g]\n" + rows(T, np.zeros(16), A, [None] * 16, B),
        [time("Force", A, "force"), time("Tip", G * B, "acceleration", G)]),
    "time without a header": (rows(T, A, B), [time("column 2", A), time("column 3", B)]),
    "time without a header, 51.2 kHz":
        (rows(np.arange(16) / 51200, A, B, C, delimiter=";"),
        [time(f"column {i}", x, sample_rate_hz=51200.0) for i, x in ((2, A), (3, B), (4, C))]),
    "time without a header, two columns": (rows(np.arange(16) / 200, A), [time("column 2", A, sample_rate_hz=200.0)]),
    "rows counted, without a header": (rows(np.arange(1, 17), T, A), [time("column 3", A)]),
    "power spectral density":
        ("Frequency (Hz),Tip (g²/Hz),PSD hammer (N^2/Hz)\n" + rows(F, G2, M),
        [spectrum("Tip", G2, "spectrum"), spectrum("PSD hammer", M, "PSD")]),
    "blanks between columns, decimal commas":
        ("f/Hz   Re   Im\n" + rows(F, H.real, H.imag, delimiter="   ", decimal=","), [frf()]),
    **{f"magnitude and phase in {unit}":
        (f"Freq (Hz),Magnitude A / B (g/N),Phase A / B ({unit})\n" + rows(F, M, phase),
        [frf("A", "B", G * H, factor=G, **ACC) | {"unit": "g/N", "notes": ("g/N converted to (m/s^2)/N",)}])
        for unit, phase in (("deg", P), ("°", P), ("rad", np.angle(H)))},
    **{" and ".join(names):
        (f"frequency [Hz],{','.join(names)}\n" + rows(F, 20 * np.log10(np.abs(H + 5)), np.angle(H + 5, deg=True)),
        [{"type": FrfRecord, "frequency_hz": F, "values": H + 5}])  # above 1, so that decibels are above 0
        for names in (("mag_dB", "phase_deg"), ("Magnitude (dB)", "Phase (deg)"), ("FRF mag dB", "FRF phase deg"))},
    "parts in brackets before the unit":
        ("frequency [Hz],H (Magnitude) [m/N],H (Phase) [deg]\n" + rows(F, M, P), [frf("H", quantity="receptance")]),
    "DOS, decimal commas":
        ("f;re;im\n" + rows(F, H.real, H.imag, delimiter=";", decimal=",") + "\x1a", [frf()]),
    "Ctrl-Z and text": ("f,re,im\n" + rows(F, H.real, H.imag) + "\x1a\\c 1,2\n3,4\x01,5\0\n", [frf()]),
    "DOS, CR LF": ("f,re,im\r\n" + rows(F, H.real, H.imag, end="\r\n") + "\x1a", [frf()]),
    **{f"{one} and {two}":
        (f"frequency [Hz],FRF1 real,FRF1 imag,FRF2 real,FRF2 imag,{one},{two}\n"
        + rows(F, H.real, H.imag, H2.real, H2.imag, G2, G2[::-1]),
        [{"type": FrfRecord, "values": values, "coherence": G2 if one.endswith(number) else G2[::-1]}
        for number, values in (("1", H), ("2", H2))])
        for one, two in (("Coh1", "Coh2"), ("Coherence 1", "Coherence 2"), ("coh_2", "coh_1"))},
    "decibels over a unit":
        ("Frequency [Hz],Magnitude A / B [dB re 1 (mm/s)/N],Phase A / B [deg]\n" + rows(F, 20 * np.log10(M), P),
        [frf("A", "B", 1e-3 * H, "mobility", 1e-3) | {"notes": (
        "decibels taken as 20 log10 of the magnitude over 1 (mm/s)/N", "(mm/s)/N converted to (m/s)/N")}]),
    "a phase without unit that passes 4π":
        ("Frequency,Mobility magnitude,Mobility phase\n" + rows(F, M, P), [frf(quantity="mobility")]),
    **{header: (f"{header},Real A / B [m/N],Imag A / B [m/N]\n" + rows(2 * np.pi * F, H.real, H.imag),
        [frf("A", "B", quantity="receptance") | {"notes": ("frequency in rad/s converted to Hz",)}])
        for header in ("Frequency [rad/s]", "omega", "Omega [rad/s]", "f [rad/s]")},
    "several FRFs with coherence in any order":
        ("# averages: 9, 4\n% quantity: receptance\nFrequency [Hz],Coherence A / C,real B / C [m/N],real A / C [m/N],"
        "imag A / C [m/N],imag B / C [m/N]\n" + rows(F, G2, H.imag, H.real, H.imag, H.real),
        [frf("A", "C", H, "receptance", coherence=G2) | {"averages": 9, "where": "columns 2, 4 and 5"},
        frf("B", "C", H.imag + 1j * H.real, "receptance") | {"averages": 4}]),
    "lines above the header and delimiters at the end":
        ("Project 12,\nmeasured by somebody, on Monday,\n,\nf [Hz],Re,Im,\n" + rows(F, H.real, H.imag, end=",\n"),
        [frf()]),
    "an increment without a start":
        ("# increment: 5\nx,Real,Imag\n" + rows(F, H.real, H.imag), [frf()]),
    "time in ms, a hit, an unknown unit":
        ("Time (ms),Hammer [lbf],acc tip hit 2 [g],strange [V]\n" + rows(1e3 * T, A, B, C),
        [time("Hammer", LBF * A, "force", LBF), time("acc tip", G * B, "acceleration", G, hit=2),
        time("strange", C, factor=None) | {"notes": (
        "unit 'V' is that of no force or motion, values left as written",)}]),
    "one sensor over frequency": ("Frequency (Hz),Tip (g)\n" + rows(F, M), [spectrum("Tip", M, "spectrum")]),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_tables(tmp_path, name):
    content, expected = TABLES[name]
    require(read(tmp_path, content), expected)


@pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_delimiters_decimal_signs_line_ends_and_encodings(tmp_path, delimiter, decimal, end, encoding):
    header = delimiter.join(["Frequency [Hz]", "Real 1:Z+ / 2:Z+ [m/s²/N]", "Imag 1:Z+ / 2:Z+ [m/s²/N]"])
    text = header + end + rows(F, H.real, H.imag, delimiter=delimiter, decimal=decimal, end=end)
    (record,) = read(tmp_path, text.encode(encoding))
    require([record], [frf("1:Z+", "2:Z+", **ACC) | {"unit": "m/s²/N"}])
    np.testing.assert_array_equal(record.frequency_hz, F)
    np.testing.assert_array_equal(record.values, H)


@pytest.mark.parametrize(("real", "imaginary"), [("Real", "Imag A / B"), ("Magnitude", "Phase A / B [deg]")])
def test_infinite_and_huge_numbers_stay_without_a_warning(tmp_path, real, imaginary):
    columns = rows(F[:4], [np.inf, 1e308, np.nan, 1.0], [1.0, 2.0, 3.0, np.inf])
    (record,) = read(tmp_path, f"Frequency [Hz],{real} A / B [g/N],{imaginary}\n{columns}")
    assert not np.isfinite(record.values).any()
    if real == "Real":
        np.testing.assert_allclose(record.values.imag[:3], [G, 2 * G, 3 * G])


@pytest.mark.parametrize(("header", "role", "name"), [
    ("force [N]", "other", "force"),
    ("F1 [N]", "other", "F1"),
    ("Frequenz (Hz)", "frequency", ""),
    ("11:y / 11:y real", "real", "11:y / 11:y"),
    ("RE_11", "other", "RE_11"),
    ("Inertance 1:x imag. part", "imaginary", "1:x"),
    ("gamma2 1 / 2", "coherence", "1 / 2"),
    ("temperature", "other", "temperature"),
])  # fmt: skip
def test_roles_of_columns(header, role, name):
    assert (column_of(header).role, column_of(header).name) == (role, name)
