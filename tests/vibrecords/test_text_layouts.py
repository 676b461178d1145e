"""Tables and LabVIEW files as programs lay them out, by their public documentation, read to 1e-12: layouts.txt."""

import itertools

import numpy as np
import pytest

from tests.vibrecords.reading import G2, A, F, G, H, M, T, layouts, records_of, require
from vibrecords.formats.table_text import column_of
from vibrecords.records import FrfRecord, SpectrumRecord, TimeRecord


def rows(*columns, delimiter=",", decimal=".", end="\n"):
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


P = np.angle(H, deg=True)
ACC = {"quantity": "accelerance"}

TABLES = {
    **layouts(),
    "German, Latin-1":
        (("Frequenz in Hz;Betrag H21 [m/s/N];Phase H21 [°]\n" + rows(F, M, P, delimiter=";",
        decimal=",")).encode("latin-1"), [frf("H21", quantity="mobility")]),
    # Excel: "Unicode text" is UTF-16 with tabs; text for the Macintosh ends lines with CR
    "UTF-16":
        (("Frequency [Hz]\tReal [m/s²/N]\tImag [m/s²/N]\n" + rows(F, H.real, H.imag, delimiter="\t")).encode("utf-16"),
        [frf(**ACC)]),
    "UTF-16, big end first":
        (("\ufefft [s];F [N]\r\n" + rows(T, A, delimiter=";", end="\r\n")).encode("utf-16-be"),
        [time("F", A, "force")]),
    "CR": ("Hz,Real,Imag\r" + rows(F, H.real, H.imag, end="\r"), [frf()]),
    **{" and ".join(names):
        (f"frequency [Hz],{','.join(names)}\n" + rows(F, 20 * np.log10(np.abs(H + 5)), np.angle(H + 5, deg=True)),
        [{"type": FrfRecord, "frequency_hz": F, "values": H + 5}])  # above 1, so that decibels are above 0
        for names in (("mag_dB", "phase_deg"), ("Magnitude (dB)", "Phase (deg)"), ("FRF mag dB", "FRF phase deg"))},
    "DOS, decimal commas":
        ("f;re;im\n" + rows(F, H.real, H.imag, delimiter=";", decimal=",") + "\x1a", [frf()]),
    "Ctrl-Z and text": ("f,re,im\n" + rows(F, H.real, H.imag) + "\x1a\\c 1,2\n3,4\x01,5\0\n", [frf()]),
    "DOS, CR LF": ("f,re,im\r\n" + rows(F, H.real, H.imag, end="\r\n") + "\x1a", [frf()]),
    "several FRFs with coherence in any order":
        ("# averages: 9, 4\n% quantity: receptance\nFrequency [Hz],Coherence A / C,real B / C [m/N],real A / C [m/N],"
        "imag A / C [m/N],imag B / C [m/N]\n" + rows(F, G2, H.imag, H.real, H.imag, H.real),
        [frf("A", "C", H, "receptance", coherence=G2) | {"averages": 9, "where": "columns 2, 4 and 5"},
        frf("B", "C", H.imag + 1j * H.real, "receptance") | {"averages": 4}]),
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
