"""Kinds of file that analysers and their users write, each made here: the values are right, or it is asked."""

import struct

import numpy as np
import pytest
import scipy.io

from tests.vibrecords.made_files import function_58, head, lvm, matlab_4, mode_55
from tests.vibrecords.reading import put, records_of
from tests.vibrecords.test_formats_containers import matlab_element
from vibrecords.errors import MeasurementError
from vibrecords.formats.channel_units import ChannelUnit, restate_frf, restate_history, unknown_sides
from vibrecords.formats.read import detect_format
from vibrecords.records import FrfRecord, ModeRecord, TimeRecord

RNG = np.random.default_rng(36)
F = np.arange(1, 25) * 2.5
H = RNG.normal(size=(24, 2)) + 1j * RNG.normal(size=(24, 2))
V = H[:, 0]


def one(path, kind=FrfRecord, **layout):
    (record,) = records_of(path, **layout)
    assert isinstance(record, kind)
    return record


def saved(path, **arrays):
    return put(path, arrays)


def require_frf(record, lines=F, values=V):
    np.testing.assert_allclose(record.frequency_hz, lines, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(record.values, values, rtol=1e-12)


# ---- arrays


def fieldless(name, rows, width):
    """An array of structs without fields in a MATLAB 5 file: flags, dimensions, name, and no names of fields."""

    flags, shape = struct.pack("<II", 2, 0), struct.pack("<ii", rows, 1)
    parts = matlab_element(6, flags) + matlab_element(5, shape) + matlab_element(1, name)
    return matlab_element(14, parts + struct.pack("<HHi", 5, 4, width) + matlab_element(1, b""))


@pytest.mark.parametrize(("rows", "width"), [(5, 1), (1, 32), (0, 0), (2**31 - 1, 1)])
def test_structs_without_fields_are_passed_over(tmp_path, rows, width):
    path = saved(tmp_path / "a", freq=F, FRF=V)
    path.write_bytes(path.read_bytes() + fieldless(b"info", rows, width))
    require_frf(one(path))


@pytest.mark.parametrize("count", [48, 49])
@pytest.mark.parametrize("shifted", [False, True])
@pytest.mark.parametrize("whole", [False, True])
def test_a_two_sided_axis_is_no_signal_and_its_frf_the_half_from_zero(tmp_path, count, shifted, whole):
    half = (count + 1) // 2  # 0, 1, ... and behind them the negative ones
    axis = np.r_[np.arange(half), np.arange(half - count, 0)] * (1 if whole else 2.5)
    values = RNG.normal(size=count) + 1j * RNG.normal(size=count)
    order = np.argsort(axis) if shifted else np.arange(count)
    axis = axis.astype(np.int32) if whole else axis
    path = saved(tmp_path / "a", fs=1024.0, f=axis[order], Z=values[order], R=values)
    with pytest.raises(MeasurementError, match=r"'f' .*'Z' .*complex.*'R' .*write frequency_hz = .f., frf = .Z. in"):
        records_of(path)
    record = one(path, frf="Z", frequency_hz="f")
    require_frf(record, axis[:half], values[:half])
    assert f"two-sided axis: {half} of {count} lines, from 0 Hz on" in record.notes
    named = saved(tmp_path / "b", fs=1024.0, f=axis[order], FRF=values[order], coh=np.abs(values[order]))
    require_frf(one(named), axis[:half], values[:half])
    np.testing.assert_allclose(one(named).coherence, np.abs(values[:half]))


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", range(6))
def test_matlab_4(tmp_path, order, kind):
    whole = np.round(50 * np.abs(H.real)) + 1j * np.round(50 * np.abs(H.imag))
    (tmp_path / "a").write_bytes(matlab_4(order, kind, freq=np.arange(24) + 1, H_A=whole, none=np.empty((0, 3))))
    first, second = records_of(tmp_path / "a")
    assert detect_format(tmp_path / "a") == "mat4"
    for record, column in zip((first, second), whole.T, strict=True):
        require_frf(record, np.arange(24) + 1, column)


def test_matlab_4_is_as_scipy_writes_it_and_one_line_where_it_is_cut(tmp_path):
    scipy.io.savemat(tmp_path / "a", {"freq": F, "H": V, "unit": "m/N"}, appendmat=False, format="4")
    require_frf(one(tmp_path / "a"))
    assert one(tmp_path / "a").quantity == "receptance"
    content = (tmp_path / "a").read_bytes()
    for size in range(26, len(content), 7):
        (tmp_path / "b").write_bytes(content[:size])
        with pytest.raises(MeasurementError, match="expected"):
            records_of(tmp_path / "b")


@pytest.mark.parametrize(("label", "said"), [("g/N", (("g", 9.80665), ("m/s^2", 1.0))), ("g", (("g", 9.80665),))])
def test_a_unit_that_test_lab_leaves_open_is_asked_of_its_channel_and_the_answer_taken(tmp_path, label, said):
    is_frf = "/" in label
    axis = {"start_value": 2.5, "increment": 2.5, "number_of_values": 24.0}
    axis["quantity"] = {"label": "Hz" if is_frf else "s"}
    struct_ = {"x_values": axis, "y_values": {"values": V if is_frf else V.real, "quantity": {"label": label}}}
    record = one(saved(tmp_path / "a", FRF=struct_), FrfRecord if is_frf else TimeRecord)
    assert record.factor is None
    if is_frf:
        assert unknown_sides(record.unit) == ({"unit"}, set())  # newtons are newtons
        with pytest.raises(MeasurementError, match=r"the unit 'g .or SI: no factor.'"):
            restate_frf(record, ChannelUnit(), ChannelUnit("N"))
    for unit, factor in said:
        stated = ChannelUnit(unit)
        answered = restate_frf(record, stated, ChannelUnit()) if is_frf else restate_history(record, stated)
        np.testing.assert_allclose(answered.values, factor * record.values)
        assert answered.quantity in ("accelerance", "acceleration")


# ---- text


def matlab(z, blank=""):
    return f"{z.real!r}{blank}{'-' if z.imag < 0 else '+'}{blank}{abs(z.imag)!r}i"


#: A complex number, as programs write it, by what may part the columns.
COMPLEX = {
    "python": (lambda z: f"({z.real!r}{z.imag:+.17g}j)", " ,;\t"),
    "python without brackets": (lambda z: f"{z.real!r}{z.imag:+.17g}J", " ,;\t"),
    "matlab": (matlab, " ,;\t"),
    "matlab with blanks": (lambda z: matlab(z, " "), " ,;\t"),
    "i in front": (lambda z: f"{z.real!r}{'-' if z.imag < 0 else '+'}i{abs(z.imag)!r}", " ,;\t"),
    "i multiplied": (lambda z: matlab(z).replace("i", "*i"), ",;"),
    "fortran": (lambda z: f"({z.real!r},{z.imag!r})", " ;\t"),
    "square brackets, quoted": (lambda z: f'"[{z.real!r}, {z.imag!r}]"', ",;\t"),
    "decimal commas": (lambda z: matlab(z).replace(".", ","), ";\t"),
    "sympy": (lambda z: matlab(z, " ").replace("i", "*I"), ",;"),
    "three digits of an exponent": (lambda z: f"{z.real:.12e}{z.imag:+.12e}i".replace("e-0", "e-00"), ";\t"),
}


@pytest.mark.parametrize(("form", "delimiter"), [(form, d) for form, (_, many) in COMPLEX.items() for d in many])
@pytest.mark.parametrize("head", [(), ("frequency [Hz]", "FRF tip / hammer [m/N]", "FRF base / hammer [m/N]")])
def test_complex_numbers_in_text(tmp_path, form, delimiter, head):
    values = H.copy()
    values[3, 0], values[4, 1], values[5] = 2.5, -3.25j, [0.0, 1e-7 - 2e8j]
    f = [str(x).replace(".", "," if form == "decimal commas" else ".") for x in F.tolist()]
    cells = [[x, *map(COMPLEX[form][0], row)] for x, row in zip(f, values.tolist(), strict=True)]
    delimiter = "   " if delimiter == " " else delimiter  # as wide columns are
    lines = [delimiter.join(row) for row in ([head] if head else []) + cells]
    found = records_of(tmp_path / "a", "\n".join(lines) + "\n")
    for record, column, name in zip(found, values.T, ("tip", "base"), strict=True):
        require_frf(record, F, column)
        assert (record.response, record.quantity) == (name, "receptance") or not head


def test_numpy_writes_frequencies_as_complex_numbers_too(tmp_path):
    np.savetxt(tmp_path / "a", np.column_stack([F, V]), delimiter=",")
    require_frf(one(tmp_path / "a"))
    for text in ("1+1j 2+3j\n2+1j 4+5j\n", "1 2+3j 4\n2 4 5+6j\n"):  # no frequency; another column from line 2 on
        with pytest.raises(MeasurementError, match="complex numbers in the first column or changing ones"):
            records_of(tmp_path / "b", text)


def labview(counts, clocks, columns):
    """Time histories over one X column, with shorter channels that have a clock of their own."""
    names, header = [f"channel {i}" for i in range(len(columns))], head(["N"] * len(columns), counts, step=clocks)
    return lvm(names, [clocks[0] * np.arange(max(map(len, columns))), *columns], header)


def test_side_channels_of_another_clock_and_length_are_named_and_not_read(tmp_path):
    long, short = RNG.normal(size=40).tolist(), RNG.normal(size=5).tolist()
    text = labview([40, 5, 40], [0.01, 1.0, 0.01], [long, short, long[::-1]])
    first, second = records_of(tmp_path / "a", text)
    assert (first.channel, second.channel, first.sample_rate_hz) == ("channel 0", "channel 2", pytest.approx(100))
    np.testing.assert_array_equal([first.values, second.values], [long, long[::-1]])
    assert "'channel 1' not read: 5 samples, where 'channel 0' has 40" in first.notes
    for counts, clocks in (([40, 40], [0.01, 1.0]), ([5, 40], [1.0, 0.01])):  # X_Value may be that of either
        with pytest.raises(MeasurementError, match="expected one clock"):
            records_of(tmp_path / "b", labview(counts, clocks, [long[: counts[0]], long]))


# ---- universal files


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("even", [False, True])
@pytest.mark.parametrize("count", [22, 23])
def test_a_last_line_filled_up_with_zeros(tmp_path, single, even, count):
    values = np.round(V[:count].astype(complex), 3)
    text = function_58(values, None if even else F[:count], first=2.5, step=2.5, single=single)
    *lines, last, end = text.rstrip("\n").split("\n")
    widths = [13] * 6 if single else [20] * 4 if even else [13, 20, 20]
    filled = len(last)
    for i, width in enumerate(widths):
        if sum(widths[:i]) >= filled:
            last += f"{0:{width}.5E}"
    require_frf(one(put(tmp_path / "a", "\n".join([*lines, last, end]) + "\n")), F[:count], values)
    if len(last) > filled:  # a number beyond the count is none to leave out, nor a line of zeros
        for wrong in ([f"{last[: -widths[-1]]}{3:{widths[-1]}.5E}", end], [last, f"{0:13.5E}" * 6, end]):
            with pytest.raises(MeasurementError, match="more numbers"):
                records_of(tmp_path / "b", "\n".join([*lines, *wrong]) + "\n")


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize(
    "tail", ["\x1a", "\x1a\r\n", "\n\x1a\x1a", "\n\x1a\\c", "\x1a\\c\r\nmore\x01text", "\x1a\nc:\\ab\n\0\n"]
)
def test_text_before_the_first_data_set_and_ctrl_z_behind_the_last(tmp_path, end, tail):
    text = function_58(V, F).replace("\n", end)
    for above in ("", f"Export of analyser 7{end}2026-02-03, 58 channels{end}-1.5 2.5{end}"):
        for body in (text, text.rstrip()):
            np.testing.assert_allclose(one(put(tmp_path / "a", above + body + tail)).values, V, rtol=1e-11)
    first, second = records_of(tmp_path / "e", text + tail + end + text)  # two files in one
    np.testing.assert_array_equal(first.values, second.values)
    with pytest.raises(MeasurementError, match="between data sets"):
        records_of(tmp_path / "b", text + "more text" + end + text)
    with pytest.raises(MeasurementError, match="expected"):  # the first delimiter is missing
        records_of(tmp_path / "c", text.split(end, 1)[1] + text)


@pytest.mark.parametrize("per_line", [1, 3, 5, 100])
@pytest.mark.parametrize("complex_", [False, True])
@pytest.mark.parametrize("on_one_line", [False, True])
def test_modes_in_free_columns(tmp_path, per_line, complex_, on_one_line):
    shape = {7: RNG.normal(size=3), 4: RNG.normal(size=3), 12: RNG.normal(size=3)}
    shape = {node: row + 1j * RNG.normal(size=3) if complex_ else row for node, row in shape.items()}
    *head, _ = mode_55(shape, number=2).split("\n")[:9], None
    lines = [" ".join(line.split()) for line in head[0]] + ["52.5 2.0 0.012 0.0"]
    for node, row in shape.items():
        cells = [repr(float(x)) for x in row.astype(complex).view(float)[:: 1 if complex_ else 2]]
        broken = [" ".join(cells[i : i + per_line]) for i in range(0, len(cells), per_line)]
        lines += [f"{node} " + broken[0], *broken[1:]] if on_one_line else [str(node), *broken]
    mode = one(put(tmp_path / "a", "\n".join([*lines, "    -1"]) + "\n"), ModeRecord)
    assert (mode.number, mode.frequency_hz, mode.damping_ratio) == (2, 52.5, 0.012)
    expected = {f"{node}:{axis}": x for node, row in shape.items() for axis, x in zip("XYZ", row.tolist(), strict=True)}
    assert {label.rstrip("+"): value for label, value in mode.shape.items()} == pytest.approx(expected)
    with pytest.raises(MeasurementError, match="expected"):  # one number less
        records_of(tmp_path / "b", "\n".join([*lines[:-1], lines[-1].rpartition(" ")[0], "    -1"]) + "\n")
