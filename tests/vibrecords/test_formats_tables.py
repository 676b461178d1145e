"""Tables of text in the dialects that programs write."""

import numpy as np
import pytest

from tests.vibrecords.reading import records_of
from vibrecords.errors import MeasurementError
from vibrecords.formats import iter_records, read_frf
from vibrecords.formats.table_text import column_of

LINES = np.array([1.5, 2.0, 2.5, 3.25])
H = np.array([1 + 2j, -0.5 + 0.25j, 3e-3 - 4e-3j, -7.5j])


def table(columns, header, delimiter=",", decimal="."):
    rows = [delimiter.join(f"{x!r}".replace(".", decimal) for x in row) for row in np.column_stack(columns).tolist()]
    return "\n".join([*([delimiter.join(header)] if header else []), *rows]) + "\n"


REAL_IMAG = ("Frequency [Hz]", "Real 1:Z+ / 2:Z+ [m/s²/N]", "Imag 1:Z+ / 2:Z+ [m/s²/N]")


@pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_delimiters_decimal_signs_line_ends_and_encodings(tmp_path, delimiter, decimal, end, encoding):
    text = table((LINES, H.real, H.imag), REAL_IMAG, delimiter, decimal).replace("\n", end)
    (record,) = records_of(tmp_path / "a", text.encode(encoding))
    np.testing.assert_array_equal(record.frequency_hz, LINES)
    np.testing.assert_array_equal(record.values, H)
    assert (record.response, record.reference, record.quantity) == ("1:Z+", "2:Z+", "accelerance")
    assert record.unit == "m/s²/N"


@pytest.mark.parametrize("decimal", [".", ","])
def test_blanks_between_columns(tmp_path, decimal):
    text = table((LINES, H.real, H.imag), ("f/Hz", "Re", "Im"), "   ", decimal)
    (record,) = records_of(tmp_path / "a", text)
    np.testing.assert_array_equal(record.values, H)


@pytest.mark.parametrize("kind", [("Real", "Imag"), ("Magnitude", "Phase")])
def test_infinite_and_huge_numbers_stay_without_a_warning(tmp_path, kind):
    header = ("Frequency [Hz]", f"{kind[0]} A / B [g/N]", f"{kind[1]} A / B" + (" [deg]" if kind[1] == "Phase" else ""))
    columns = (LINES, np.array([np.inf, 1e308, np.nan, 1.0]), np.array([1.0, 2.0, 3.0, np.inf]))
    (record,) = records_of(tmp_path / "a", table(columns, header))
    assert not np.isfinite(record.values).any()
    if kind[0] == "Real":
        np.testing.assert_allclose(record.values.imag[:3], [9.80665, 2 * 9.80665, 3 * 9.80665])


@pytest.mark.parametrize("unit", ["deg", "°", "rad"])
def test_magnitude_and_phase(tmp_path, unit):
    phase = np.angle(H) if unit == "rad" else np.angle(H, deg=True)
    header = ("Freq (Hz)", "Magnitude A / B (g/N)", f"Phase A / B ({unit})")
    (record,) = records_of(tmp_path / "a", table((LINES, np.abs(H), phase), header))
    np.testing.assert_allclose(record.values, 9.80665 * H, rtol=1e-12, atol=1e-12)
    assert (record.unit, record.quantity) == ("g/N", "accelerance")
    assert "g/N converted to (m/s^2)/N" in record.notes


def test_decibels(tmp_path):
    header = ("Frequency [Hz]", "Magnitude A / B [dB re 1 (mm/s)/N]", "Phase A / B [deg]")
    columns = (LINES, 20 * np.log10(np.abs(H)), np.angle(H, deg=True))
    (record,) = records_of(tmp_path / "a", table(columns, header))
    np.testing.assert_allclose(record.values, 1e-3 * H, rtol=1e-12, atol=1e-15)
    assert record.quantity == "mobility"
    assert record.notes[0] == "decibels taken as 20 log10 of the magnitude over 1 (mm/s)/N"


def test_phase_without_unit_is_degrees_only_where_it_must_be(tmp_path):
    header = ("Frequency", "Mobility magnitude", "Mobility phase")
    (record,) = records_of(tmp_path / "a", table((LINES, np.abs(H), np.angle(H, deg=True)), header))
    np.testing.assert_allclose(record.values, H, rtol=1e-12, atol=1e-12)
    assert record.quantity == "mobility"
    with pytest.raises(MeasurementError, match="phase without unit"):
        records_of(tmp_path / "b", table((LINES, np.abs(H), np.angle(H)), header))


@pytest.mark.parametrize("header", ["Frequency [rad/s]", "omega", "Omega [rad/s]", "f [rad/s]"])
def test_frequency_in_rad_per_s(tmp_path, header):
    (record,) = records_of(tmp_path / "a", table((LINES * 2 * np.pi, H.real, H.imag), (header, *REAL_IMAG[1:])))
    np.testing.assert_allclose(record.frequency_hz, LINES, rtol=1e-12)
    assert "frequency in rad/s converted to Hz" in record.notes


def test_several_frfs_with_coherence_in_any_order(tmp_path):
    header = ("Frequency [Hz]", "Coherence A / C", "real B / C [m/N]", "real A / C [m/N]", "imag A / C [m/N]",
              "imag B / C [m/N]")  # fmt: skip
    g2 = np.linspace(0.5, 0.8, 4)
    path = tmp_path / "a"
    path.write_text(
        "# averages: 9, 4\n% quantity: receptance\n" + table((LINES, g2, H.imag, H.real, H.imag, H.real), header)
    )
    first, second = iter_records(path)
    assert (first.response, second.response) == ("A", "B")
    assert (first.averages, second.averages) == (9, 4)
    np.testing.assert_array_equal(first.coherence, g2)
    assert second.coherence is None
    np.testing.assert_array_equal(second.values, H.imag + 1j * H.real)
    assert first.where == "columns 2, 4 and 5"
    assert read_frf(path).outputs == ("A", "B")


def test_without_a_header_three_columns_are_frequency_real_and_imaginary(tmp_path):
    (record,) = records_of(tmp_path / "a", table((LINES, H.real, H.imag), None))
    np.testing.assert_array_equal(record.values, H)
    assert record.quantity is None
    assert record.notes[0] == "no name: column 1 taken as frequency in Hz, since it goes from 1.5 in steps of 0.583333"
    with pytest.raises(MeasurementError, match="4 columns without a header"):
        records_of(tmp_path / "b", table((LINES, H.real, H.imag, H.imag), None))


def test_lines_above_the_header_and_delimiters_at_the_end_are_passed_over(tmp_path):
    text = "Project 12\nmeasured by somebody, on Monday\n\n" + table((LINES, H.real, H.imag), REAL_IMAG)
    (record,) = records_of(tmp_path / "a", text.replace("\n", ",\n"))
    np.testing.assert_array_equal(record.values, H)


def test_time_histories(tmp_path):
    time = np.arange(4) / 2000
    header = ("Time (ms)", "Hammer [lbf]", "acc tip hit 2 [g]", "strange [V]")
    force, acc, strange = records_of(tmp_path / "a", table((time * 1e3, H.real, H.imag, H.real), header))
    assert (force.channel, force.quantity, acc.channel, acc.hit, acc.quantity) == (
        "Hammer",
        "force",
        "acc tip",
        2,
        "acceleration",
    )
    np.testing.assert_allclose(acc.values, 9.80665 * H.imag)
    assert force.sample_rate_hz == pytest.approx(2000)
    assert (strange.quantity, strange.notes) == (
        "unknown",
        ("unit 'V' is that of no force or motion, values left as written",),
    )


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


def test_absurd_averages_say_what_is_allowed(tmp_path):
    path = tmp_path / "tip.csv"
    path.write_text("# averages: 1000000000\nfrequency [Hz],1:Y/1:Y real [m/N],1:Y/1:Y imag [m/N]\n1,1,0\n2,1,0\n")
    with pytest.raises(MeasurementError, match="found averages '1000000000'; expected whole numbers from 1 to 1000000"):
        list(iter_records(path))
