"""Universal files: fields as the format has them, pyuff's files and ours, units, coherence, streaming."""

import tracemalloc

import numpy as np
import pytest
import pyuff
from benchmarks.written_files import write_frf

from tests.vibrecords.made_files import function_58, header_164
from tests.vibrecords.reading import only, records_of
from vibrecords import FrfSet
from vibrecords.errors import MeasurementError
from vibrecords.formats import iter_records, read_frf
from vibrecords.records import FrfRecord, TimeRecord

RNG = np.random.default_rng(3)
H = RNG.normal(size=23) + 1j * RNG.normal(size=23)


@pytest.mark.parametrize("single", [True, False])
@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("complex_", [True, False])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_all_eight_cases_of_the_format(tmp_path, single, even, complex_, end):
    lines = np.sort(np.round(RNG.uniform(1, 900, 23), 2))
    text = function_58(H if complex_ else H.real, None if even else lines, single=single).replace("\n", end)
    record = only(tmp_path / "a", text.encode())
    expected = 1 + 0.5 * np.arange(23) if even else lines
    np.testing.assert_allclose(record.frequency_hz, expected, rtol=1e-5)
    np.testing.assert_allclose(
        record.values, H if complex_ else H.real, rtol=1e-5 if single else 1e-12, atol=1e-5 * single
    )
    assert (record.response, record.reference, record.quantity) == ("12:Z+", "11:Y+", "accelerance")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves files open
@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("even", [0, 1])
def test_files_of_pyuff_are_read(tmp_path, binary, even):
    path = tmp_path / "a.uff"
    file = pyuff.UFF(str(path))
    lines = 1 + 0.5 * np.arange(23)
    common = {"binary": binary, "func_type": 4, "rsp_dir": -3, "ref_node": 2, "ref_dir": 3, "x": lines, "id1": "id"}
    common |= {"rsp_ent_name": "Point", "ref_ent_name": "Point", "abscissa_spacing": even}
    common |= {"abscissa_spec_data_type": 18, "ordinate_spec_data_type": 8, "orddenom_spec_data_type": 13}
    for node in (1, 2):
        file.write_sets(pyuff.prepare_58(rsp_node=node, data=H * node, **common), "add")
    frf = read_frf(path)
    assert (frf.outputs, frf.inputs, frf.quantity) == (("Point:1:Z-", "Point:2:Z-"), ("Point:2:Z+",), "receptance")
    np.testing.assert_allclose(frf.frequency_hz, lines, rtol=1e-5)
    np.testing.assert_allclose(frf.values[:, 1, 0], 2 * H, rtol=1e-11)


@pytest.mark.parametrize("form", ["uff58", "uff58b"])
@pytest.mark.parametrize("lines", [np.arange(1, 24) * 0.25, np.sort(RNG.uniform(1, 99, 23))], ids=["even", "uneven"])
def test_pyuff_reads_our_files(tmp_path, form, lines):
    frf = FrfSet(lines, H[:, None, None], ("Point:12:Z+",), ("3:X-",), "mobility", np.abs(H)[:, None, None] / 9, 4)
    write_frf(frf, tmp_path / "a.uff", form)
    sets = pyuff.UFF(str(tmp_path / "a.uff")).read_sets()
    first, second = (s for s in sets if s["type"] == 58)
    assert [s["type"] for s in sets[:2]] == [151, 164]
    assert (first["func_type"], second["func_type"]) == (4, 6)
    assert (first["rsp_ent_name"], first["rsp_node"], first["rsp_dir"]) == ("Point", 12, 3)
    assert (first["ref_node"], first["ref_dir"], first["ordinate_axis_units_lab"]) == (3, -1, "m/s")
    np.testing.assert_allclose(first["x"], lines, rtol=1e-9)
    np.testing.assert_allclose(first["data"], H, rtol=1e-12)
    np.testing.assert_allclose(second["data"], np.abs(H) / 9, rtol=1e-12)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("width", [4, 8])
@pytest.mark.parametrize("narrow", [False, True])
def test_binary_with_its_byte_orders_and_abscissae(tmp_path, order, width, narrow):
    """The abscissa of uneven spacing is single precision by the format, as wide as the values in many files."""
    head = function_58(H, np.ones(23), single=width == 4).split("\n")[:13]
    lines = np.sort(RNG.uniform(1, 900, 23)).astype("f4")
    rows = np.zeros(23, [("x", f"{order}f{4 if narrow else width}"), ("y", f"{order}f{width}", 2)])
    rows["x"], rows["y"] = lines, np.column_stack([H.real, H.imag])
    head[1] = f"{58:6d}b{1 if order == '<' else 2:6d}{2:6d}{11:12d}{rows.nbytes:12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    body = "\n".join(head).encode() + b"\n" + rows.tobytes()
    for end in (b"    -1\n", b"\n    -1\r\n", b"    -1" + b" " * 74 + b"\n", b"    -1"):
        record = only(tmp_path / "a", body + end)
        np.testing.assert_array_equal(record.frequency_hz, lines)
        np.testing.assert_allclose(record.values, H, rtol=1e-6 if width == 4 else 0, atol=0)


def test_a_delimiter_within_binary_values_ends_nothing(tmp_path):
    bytes_ = b"\n    -1\n".ljust(8, b"\n") * 24
    values = np.frombuffer(bytes_, "<f8")
    frf = FrfSet(np.arange(1.0, 13), values.view(complex)[:, None, None], ("1:Z+",), ("1:Z+",))
    write_frf(frf, tmp_path / "a", "uff58b")
    (record,) = iter_records(tmp_path / "a")
    assert record.values.tobytes() == bytes_


def test_data_set_164_counts_where_the_axes_have_no_unit(tmp_path):
    inch = header_164(39.37007874015748, 0.22480894309971, 7, "Inch (pound f)")
    bare = function_58(H, units=("Hz", "NONE", "NONE"))
    record = only(tmp_path / "a", inch + bare)
    np.testing.assert_allclose(record.values, H * 0.0254 / 4.4482216152605, rtol=1e-9)
    assert record.notes == ("converted to SI units by data set 164 (Inch (pound f))",)
    contradicted = only(tmp_path / "b", inch + function_58(H))
    np.testing.assert_allclose(contradicted.values, H, rtol=1e-12)
    assert contradicted.notes == ("unit (m/s^2)/N taken; data set 164 (Inch (pound f)) says otherwise",)
    for kind in ("force", "excitation"):
        force = function_58(H.real, function=1, kinds=("time", kind, "none"), units=("s", "NONE", "NONE"))
        record = only(tmp_path / kind, inch + force)
        assert record.quantity == "force"
        np.testing.assert_allclose(record.values, H.real * 4.4482216152605, rtol=1e-9)


def test_infinite_numbers_and_steps_stay_without_a_warning(tmp_path):
    values = np.array([complex(np.inf, 1), complex(1, np.nan), 1e308])
    record = only(tmp_path / "a", function_58(values, units=("Hz", "g", "N"), step=1e308))
    np.testing.assert_array_equal(record.values.real, [np.inf, 9.80665, np.inf])
    np.testing.assert_array_equal(record.values.imag, [9.80665, np.nan, 0.0])
    time = function_58(values.imag, function=1, kinds=("time", "force", "none"), step=1e308)
    with pytest.raises(MeasurementError, match="not evenly spaced"):
        only(tmp_path / "b", time)


def test_frequency_in_rad_per_s_becomes_hertz(tmp_path):
    record = only(tmp_path / "a", function_58(H, units=("rad/s", "m/s^2", "N")))
    np.testing.assert_allclose(record.frequency_hz, (1 + 0.5 * np.arange(23)) / (2 * np.pi), rtol=1e-14)
    assert record.notes == ("frequency in rad/s converted to Hz",)


def test_coherence_is_found_wherever_it_stands(tmp_path):
    coherences = [np.linspace(0.1, 0.9, 23), np.linspace(0.2, 0.8, 23)]
    parts = [function_58(c, function=6, response=("NONE", n, 3)) for n, c in zip((1, 2), coherences, strict=True)]
    frfs = [function_58(H * n, response=("NONE", n, 3)) for n in (1, 2, 3)]
    for order in ([*parts, *frfs], [*frfs, *parts[::-1]]):
        first, second, third = records_of(tmp_path / "a", "".join(order))
        np.testing.assert_allclose(first.coherence, coherences[0], rtol=1e-12)
        np.testing.assert_allclose(second.coherence, coherences[1], rtol=1e-12)
        assert third.coherence is None


def test_repeated_measurements_each_keep_their_coherence(tmp_path):
    text = "".join(function_58(H * k) + function_58(np.full(23, k / 4), function=6) for k in (1, 2, 3))
    records = records_of(tmp_path / "a", text)
    assert [r.coherence[0] for r in records] == [0.25, 0.5, 0.75]
    assert [r.where for r in records] == ["data set 1", "data set 3", "data set 5"]
    with pytest.raises(MeasurementError, match="data set 3: found the FRF of '12:Z\\+' over '11:Y\\+' again"):
        read_frf(tmp_path / "a")


@pytest.mark.parametrize("line", ["Averages: 12", "12 averages", "average = 12", "H1, 12 Averages, Hann"])
def test_averages_stand_in_an_id_line(tmp_path, line):
    assert only(tmp_path / "a", function_58(H, ids=("x", "NONE", line, "NONE", "NONE"))).averages == 12


def test_time_histories_with_units_and_hits(tmp_path):
    steps = {"function": 1, "first": 0.0, "step": 1e-3}
    sides = [
        {"kinds": ("time", kind, "none"), "units": ("s", unit, "NONE"), "response": ("Point", node, 3)} | steps
        for node, kind, unit in ((1, "force", "lbf"), (2, "acceleration", "g"))
    ]
    block = [function_58(H.real * k, **side) for k in (1, 2) for side in sides]
    records = records_of(tmp_path / "a", "".join(block))
    assert [(r.channel, r.quantity, r.unit, r.hit) for r in records] == [
        ("Point:1:Z+", "force", "lbf", 1),
        ("Point:2:Z+", "acceleration", "g", 1),
        ("Point:1:Z+", "force", "lbf", 2),
        ("Point:2:Z+", "acceleration", "g", 2),
    ]
    np.testing.assert_allclose(records[3].values, 2 * 9.80665 * H.real, rtol=1e-12)
    assert all(isinstance(r, TimeRecord) and abs(r.sample_rate_hz - 1000) < 1e-6 for r in records)


@pytest.mark.parametrize("single", [True, False])
def test_lines_padded_to_column_80_and_a_byte_order_mark(tmp_path, single):
    text = "\n".join(line.ljust(80) for line in function_58(H, single=single).split("\n")[:-1]) + "\n"
    record = only(tmp_path / "a", b"\xef\xbb\xbf" + text.encode())
    np.testing.assert_allclose(record.values, H, rtol=1e-5 if single else 1e-12)


def test_other_data_sets_are_passed_over(tmp_path):
    nodes = "    -1\n  2411\n         1         0         0        11\n   1.0D+00   2.0D+00   3.0D+00\n    -1\n"
    record = only(tmp_path / "a", nodes + "\n" + function_58(H) + "    -1\n  2414\nNONE\n    -1\n")
    assert isinstance(record, FrfRecord)
    assert record.where == "data set 2"


def test_columns_separated_by_blanks_are_read_where_the_widths_are_not_the_formats(tmp_path):
    text = function_58(H)
    head, body = text.split("\n")[:13], text.split("\n")[13:-2]
    loose = [" ".join(line.split()) for line in body]
    np.testing.assert_allclose(only(tmp_path / "a", "\n".join([*head, *loose, "    -1", ""])).values, H, rtol=1e-12)


def test_columns_that_touch_are_read(tmp_path):
    values = (-np.abs(H.real) - 1j * np.abs(H.imag)) * 1e-101
    text = function_58(values, single=True)
    assert "E-102-" in text  # no blank between two numbers
    np.testing.assert_allclose(only(tmp_path / "a", text).values, values, rtol=1e-5)


def test_columns_of_the_header_that_touch_are_read(tmp_path):
    text = function_58(H)
    form = text.split("\n")[8]  # ordinate type, count, spacing; abscissa minimum, increment, z-axis value
    touching = text.replace(form, form[:56] + "-1.23456E+001")
    assert touching != text
    lines = only(tmp_path / "a", text).frequency_hz
    np.testing.assert_array_equal(only(tmp_path / "b", touching).frequency_hz, lines)


TIME = {"function": 1, "first": 0.0, "kinds": ("time", "force", "none"), "units": ("s", "N", "NONE")}


@pytest.mark.parametrize(("values", "form"), [(RNG.normal(size=4_000) + 1j, {}), (RNG.normal(size=8_000), TIME)])
def test_one_record_is_in_memory_at_a_time(tmp_path, values, form):
    path = tmp_path / "a"
    path.write_text("".join(function_58(values, response=("NONE", n, 3), **form) for n in range(1, 13)))
    size = path.stat().st_size
    tracemalloc.start()
    count = sum(1 for _ in iter_records(path))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert count == 12
    assert peak < size / 2, (peak, size)
