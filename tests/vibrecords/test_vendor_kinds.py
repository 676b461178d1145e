"""Kinds of file that analysers and their users write, each made here: the values are right, or it is asked."""

import struct

import numpy as np
import pytest
import scipy.io

from vibrecords.errors import MeasurementError
from vibrecords.formats.read import detect_format, iter_records
from vibrecords.records import FrfRecord, ModeRecord, TimeRecord

RNG = np.random.default_rng(36)
F = np.arange(1, 25) * 2.5
H = RNG.normal(size=(24, 2)) + 1j * RNG.normal(size=(24, 2))
V = H[:, 0]


def records(path, **layout):
    return list(iter_records(path, layout))


def one(path, kind=FrfRecord, **layout):
    (record,) = records(path, **layout)
    assert isinstance(record, kind)
    return record


def saved(path, **arrays):
    scipy.io.savemat(path, arrays, appendmat=False)
    return path


def require_frf(record, lines=F, values=V):
    np.testing.assert_allclose(record.frequency_hz, lines, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(record.values, values, rtol=1e-12)


# ---- arrays


def fieldless(name, rows, width):
    """An array of structs without fields in a MATLAB 5 file: flags, dimensions, name, and no names of fields."""

    def element(kind, data):
        return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)

    parts = element(6, struct.pack("<II", 2, 0)) + element(5, struct.pack("<ii", rows, 1)) + element(1, name)
    return element(14, parts + struct.pack("<HHi", 5, 4, width) + element(1, b""))


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
    with pytest.raises(MeasurementError, match=r"'f' .*a two-sided axis.*'Z' .*complex.*'R' .*complex"):
        records(path)
    record = one(path, frf="Z", frequency_hz="f")
    require_frf(record, axis[:half], values[:half])
    assert f"two-sided axis 'f': {half} of {count} lines, from 0 Hz on" in record.notes
    named = saved(tmp_path / "b", fs=1024.0, f=axis[order], FRF=values[order], coh=np.abs(values[order]))
    require_frf(one(named), axis[:half], values[:half])
    np.testing.assert_allclose(one(named).coherence, np.abs(values[:half]))


def test_complex_arrays_beside_a_signal_are_named(tmp_path):
    record = one(saved(tmp_path / "a", fs=100.0, acc_tip=F, Z=V), TimeRecord)
    assert record.notes == ("'Z' not read: [data.layout] can name it",)
    force = one(saved(tmp_path / "b", fs=100.0, f=np.sin(F)), TimeRecord)  # a force, which is no axis
    np.testing.assert_allclose(force.values, np.sin(F))


def matlab_4(order="<", kind=0, **arrays):
    """Matrices as the description of level 4 has them: type, rows, columns, imaginary part or none, name, columns."""
    letters = ["f8", "f4", "i4", "i2", "u2", "u1"]
    content = b""
    for name, value in arrays.items():
        text = isinstance(value, str)
        array = np.array([list(map(ord, value))]) if text else np.atleast_2d(np.asarray(value).T).T
        mopt = 1000 * (order == ">") + 10 * kind + text
        content += struct.pack(f"{order}5i", mopt, *array.shape, np.iscomplexobj(array), len(name) + 1)
        content += name.encode() + b"\0"
        for part in (array.real, array.imag)[: 1 + np.iscomplexobj(array)]:
            content += part.astype(f"{order}{letters[kind]}").tobytes("F")
    return content


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", range(6))
def test_matlab_4(tmp_path, order, kind):
    whole = np.round(50 * np.abs(H.real)) + 1j * np.round(50 * np.abs(H.imag))
    (tmp_path / "a").write_bytes(matlab_4(order, kind, freq=np.arange(24) + 1, H_A=whole, outputs="tip"))
    first, second = records(tmp_path / "a")
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
            records(tmp_path / "b")


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", ["H00", "measured"])
@pytest.mark.parametrize("axis", [False, True])
def test_real_matrices_of_two_and_three_columns_say_how_they_are_named(tmp_path, turned, name, axis):
    matrix = np.column_stack([F, V.real, V.imag][not axis :])
    beside = {} if axis else {"df": 2.5, "f_start": 2.5}
    path = saved(tmp_path / "a", **{name: matrix.T if turned else matrix}, **beside)
    keys = ["frequency_hz", "real", "imaginary"][not axis :]
    layout = {key: f"{name}({f'{i},:' if turned else f':,{i}'})" for i, key in enumerate(keys, start=1)}
    with pytest.raises(MeasurementError) as error:
        records(path)
    assert ", ".join(f'{key} = "{value}"' for key, value in layout.items()) in str(error.value)
    require_frf(one(path, **layout))


@pytest.mark.parametrize(("names", "layout"), [
    (("Frequency_Hz", "DampingRatio", "Phi"), {}),
    (("freq", "damping_ratios", "Phi"), {}),
    (("A", "B", "C"), {"mode_frequencies_hz": "A", "damping_ratios": "B", "mode_shapes": "C"}),
])  # fmt: skip
def test_modes_under_the_names_of_other_programs(tmp_path, names, layout):
    frequency, ratio, shape = np.array([41.0, 117.0, 260.0]), np.array([0.01, 0.004, 0.02]), RNG.normal(size=(4, 3))
    found = records(saved(tmp_path / "a", **dict(zip(names, (frequency, ratio, shape), strict=True))), **layout)
    assert [type(mode) for mode in found] == [ModeRecord] * 3
    assert [mode.frequency_hz for mode in found] == frequency.tolist()
    assert [mode.damping_ratio for mode in found] == ratio.tolist()
    np.testing.assert_array_equal([[*mode.shape.values()] for mode in found], shape.T)


@pytest.mark.parametrize("clock", [{"fs": 256.0}, {"time": np.arange(24) / 256}])
def test_channels_of_sep_5(tmp_path, clock):
    hammer = {"data": V.real, "name": "hammer", "unit_str": "N", **clock}
    tip = {"data": V.imag, "name": "tip", "unit_str": "g", "quantity": "Acceleration", **clock}
    force, motion = records(saved(tmp_path / "a", signals=[hammer, tip]))
    assert (force.channel, force.quantity, force.sample_rate_hz) == ("hammer", "force", pytest.approx(256.0))
    assert (motion.channel, motion.quantity) == ("tip", "acceleration")
    np.testing.assert_allclose(force.values, V.real)
    np.testing.assert_allclose(motion.values, 9.80665 * V.imag)
