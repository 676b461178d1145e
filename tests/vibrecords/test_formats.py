"""Measurement files of every format: what is written is read, to the last bit but in UFF text; formats by content."""

import stat
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.written_files import FORMATS, write_frf, write_records

from vibrecords import FrfSet, formats
from vibrecords.errors import MeasurementError, WriteError
from vibrecords.formats import cut_to_band, detect_format, iter_records, join_frfs, read_frf, records_of_frf
from vibrecords.records import Dof, FrfRecord, TimeRecord, dof_label, parse_dof

#: Text of universal files has columns for 13 digits; all else comes back bit for bit.
EXACT = [form for form in FORMATS if form != "uff58"]
KINDS = {"uff58": "uff", "uff58b": "uff", "csv": "table"}
AXES = {
    "even": np.arange(1, 41) * 0.5,
    "step_that_is_no_decimal": np.arange(1, 41) * 0.1,
    "uneven": np.sort(np.random.default_rng(5).uniform(1, 5000, 41)),
    "one_line": np.array([17.3]),
}


def frf_set(lines=AXES["even"], seed=0, **changes):
    rng = np.random.default_rng(seed)
    outputs, inputs = ("Point:11:Y+", "7:RZ-", "acc tip"), ("11:y", "Point:3:Z-")
    shape = (lines.size, len(outputs), len(inputs))
    values = (rng.normal(size=shape) + 1j * rng.normal(size=shape)) * 10 ** rng.uniform(-12, 4, size=shape)
    return replace(FrfSet(lines, values, outputs, inputs, "accelerance", rng.uniform(size=shape), 7), **changes)


def same_set(a, b, form=""):
    arrays = ("frequency_hz", "values") + (("coherence",) if a.coherence is not None else ())
    for key in ("outputs", "inputs", "quantity", "averages"):
        assert getattr(a, key) == getattr(b, key)
    assert (a.coherence is None) == (b.coherence is None)
    if form == "uff58":
        return all(np.allclose(getattr(a, name), getattr(b, name), rtol=1e-9, atol=0) for name in arrays)
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in arrays)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("form", FORMATS)
def test_frfs_come_back(tmp_path, form, axis):
    frf = frf_set(AXES[axis])
    write_frf(frf, tmp_path / "a", form)
    back = read_frf(tmp_path / "a")
    assert same_set(frf, back, form)
    np.testing.assert_allclose(back.values.view(float), frf.values.view(float), rtol=1e-12)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("quantity", ["receptance", "mobility"])
def test_quantity_survives_without_coherence_and_averages(tmp_path, form, quantity):
    frf = frf_set(quantity=quantity, coherence=None, averages=None)
    write_frf(frf, tmp_path / "a", form)
    assert same_set(frf, read_frf(tmp_path / "a"), form)
    assert all(record.notes == () for record in iter_records(tmp_path / "a"))


@pytest.mark.parametrize("form", FORMATS)
def test_one_response_over_several_references_keeps_its_sides(tmp_path, form):
    frf = frf_set().select(("acc tip",), ("Point:3:Z-", "11:y"))
    write_frf(frf, tmp_path / "a", form)
    assert same_set(frf, read_frf(tmp_path / "a"), form)


@pytest.mark.parametrize("form", EXACT)
def test_extreme_numbers_come_back_bit_for_bit(tmp_path, form):
    values = np.array([5e-324, -1.7976931348623157e308, 1e-100, -0.0, 2.2250738585072014e-308, 1 / 3])
    record = FrfRecord("1:Z+", "2:Z+", np.arange(1.0, 7.0), values + 1j * values[::-1], "receptance")
    write_records([record], tmp_path / "a", form)
    (read,) = iter_records(tmp_path / "a")
    assert read.values.tobytes() == record.values.tobytes()


@pytest.mark.parametrize("form", FORMATS)
def test_nan_and_zero_stay_where_they_are(tmp_path, form):
    values = np.array([1 + 1j, np.nan + 2j, 0, np.inf - 1j])
    record = FrfRecord("1:Z+", "2:Z+", np.array([0.0, 1.0, 2.0, 3.0]), values, "receptance")
    write_records([record], tmp_path / "a", form)
    (read,) = iter_records(tmp_path / "a")
    np.testing.assert_array_equal(read.values, values)
    np.testing.assert_array_equal(read.frequency_hz, record.frequency_hz)


@pytest.mark.parametrize("form", EXACT)
def test_time_histories_come_back_bit_for_bit(tmp_path, form):
    rng = np.random.default_rng(1)
    told = [("11:y", "force", 1), ("11:y", "force", 2), ("Point:4:Z+", "acceleration", None)]
    told += [("laser", "velocity", None), ("gap", "displacement", None), ("other", "unknown", None)]
    records = [TimeRecord(name, 1 / 3 * 1e4, rng.normal(size=50), what, hit=hit) for name, what, hit in told]
    write_records(records, tmp_path / "a", form)
    for a, b in zip(iter_records(tmp_path / "a"), records, strict=True):
        assert (a.channel, a.sample_rate_hz, a.quantity, a.hit) == (b.channel, b.sample_rate_hz, b.quantity, b.hit)
        assert a.values.tobytes() == b.values.tobytes()


@pytest.mark.parametrize("form", ["uff58b", "npz", "mat", "mat73", "hdf5"])
def test_records_of_different_kinds_share_a_file(tmp_path, form):
    rng = np.random.default_rng(2)
    records = [
        FrfRecord("1:Z+", "2:Z+", np.arange(1.0, 9.0), rng.normal(size=8) + 1j, "mobility", averages=3),
        FrfRecord("1:Z+", "2:Z+", np.arange(1.0, 5.0), rng.normal(size=4) + 1j, None),
        TimeRecord("2:Z+", 100.0, rng.normal(size=20), "force"),
        TimeRecord("1:Z+", 200.0, rng.normal(size=10), "acceleration", hit=2),
        *(FrfRecord(f"{k}:Z+", "1:Z+", np.arange(1.0, 4.0), np.full(3, k * 1j), "mobility") for k in range(3, 12)),
    ]
    write_records(records, tmp_path / "a", form)
    read = list(iter_records(tmp_path / "a"))
    key = {FrfRecord: lambda r: (r.response, r.quantity, r.averages), TimeRecord: lambda r: (r.channel, r.hit)}
    frfs, times = ([r for r in read if isinstance(r, kind)] for kind in (FrfRecord, TimeRecord))
    for kind, found in ((FrfRecord, frfs), (TimeRecord, times)):
        written = [r for r in records if isinstance(r, kind)]
        assert [key[kind](r) for r in found] == [key[kind](r) for r in written]
        assert all(a.values.tobytes() == b.values.tobytes() for a, b in zip(found, written, strict=True))


@pytest.mark.parametrize("form", FORMATS)
def test_format_is_told_by_content_not_by_ending(tmp_path, form):
    for ending in ("", ".uff", ".csv", ".mat", ".npz"):
        path = tmp_path / f"file{ending}"
        write_frf(frf_set(), path, form)
        assert detect_format(path) == KINDS.get(form, form)
        assert read_frf(path).n_lines == 40


def test_a_table_refuses_what_it_cannot_hold(tmp_path):
    records = [FrfRecord("1:Z+", "2:Z+", np.arange(1.0, n), np.ones(n - 1), "mobility") for n in (5, 6)]
    with pytest.raises(MeasurementError, match="different lines"):
        formats.write_records(records, tmp_path / "a")
    with pytest.raises(MeasurementError, match="one kind"):
        formats.write_records([records[0], TimeRecord("x", 1.0, np.ones(3))], tmp_path / "a")
    assert list(tmp_path.iterdir()) == []


def test_writing_leaves_the_old_file_when_it_fails(tmp_path):
    path = tmp_path / "a.csv"
    formats.write_frf(frf_set(), path)
    before = path.read_bytes()
    with pytest.raises(MeasurementError, match="found a label that is no text"):
        formats.write_frf(frf_set(outputs=("1:y", "2:y", "\ud800")), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]
    assert stat.S_IMODE(path.stat().st_mode) & 0o400


def test_a_new_file_is_as_readable_as_any_other(tmp_path):
    formats.write_frf(frf_set(), tmp_path / "a")
    (tmp_path / "b").touch()
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == stat.S_IMODE((tmp_path / "b").stat().st_mode)


@pytest.mark.parametrize(
    ("form", "records", "message"),
    [
        ("xls", records_of_frf(frf_set()), "expected one of csv"),
        ("csv", (), "found nothing to write"),
        *((form, records_of_frf(frf_set()), f"'{form}', which went in this version; expected csv; pyuff writes")
          for form in ("uff58", "uff58b", "tsv", "npz", "mat", "mat73", "hdf5")),
    ],
)  # fmt: skip
def test_writing_says_what_it_needs(tmp_path, form, records, message):
    with pytest.raises(MeasurementError, match=message):
        formats.write_records(records, tmp_path / "a", form)
    assert list(tmp_path.iterdir()) == []


def test_writing_into_no_directory_is_one_line(tmp_path):
    with pytest.raises(WriteError, match="cannot be written"):
        formats.write_frf(frf_set(), tmp_path / "none" / "a")


# labels


@pytest.mark.parametrize("direction", range(-6, 7))
def test_labels_and_degrees_of_freedom_agree(direction):
    dof = Dof("Point", 12, direction)
    assert parse_dof(dof_label(dof)) == dof


@pytest.mark.parametrize("name", ["acc tip", "12", "a:b:c:d", "12:Q+", "Point:x:Z+"])
def test_mere_names_are_no_degrees_of_freedom(name):
    assert parse_dof(name) is None


# assembly


def records(**changes):
    return [replace(r, **changes) for r in records_of_frf(frf_set())]


def joined(record, f_min_hz, f_max_hz=None):
    return join_frfs([cut_to_band(record, "a.uff", f_min_hz, f_max_hz)], "a.uff")


def test_band_is_cut_before_anything_is_checked():
    lines = np.arange(0.0, 10.0)
    values = np.ones(10, complex)
    values[[1, 9]] = np.nan, 0
    record = FrfRecord("1:Z+", "2:Z+", lines, values, "mobility", where="data set 3")
    assert joined(record, 1.5, 8.5).frequency_hz.tolist() == list(range(2, 9))
    for f_min_hz, message in (
        (None, "a.uff: data set 3: found a line at 0 Hz; .*f_min_hz"),
        (0.5, "NaN or infinity at 1 Hz"),
        (1.5, "exactly 0 at 9 Hz"),
        (50.0, "no line above 50 Hz; expected some, the file has 0 to 9 Hz"),
    ):
        with pytest.raises(MeasurementError, match=message):
            joined(record, f_min_hz)


@pytest.mark.parametrize(("given", "message"), [
    ([], "found no FRF"),
    (records()[:-1], "found no FRF of 'acc tip' over 'Point:3:Z-'"),
    (records() + records()[:1], "again"),
    (records(quantity=None), "no word on what the FRF is"),
    (records()[:1] + records(quantity="mobility")[1:], "found mobility beside accelerance"),
    (records()[:1] + records(frequency_hz=AXES["step_that_is_no_decimal"])[1:], "same lines for all"),
    (records(frequency_hz=AXES["even"][::-1]), "found 19.5 Hz after 20 Hz"),
    (records(frequency_hz=np.full(40, np.nan)), "found frequency nan at line 1"),
    (records(coherence=np.full(40, 1.5)), "found coherence 1.5 at 0.5 Hz"),
    (records(coherence=np.full(40, np.nan)), "found coherence nan"),
    (records(coherence=np.ones(3)), "found coherence on 3 lines"),
])  # fmt: skip
def test_assembly_says_what_is_in_the_way(given, message):
    with pytest.raises(MeasurementError, match=message) as caught:
        join_frfs(given, "a.uff")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("a.uff: ")


def test_assembly_takes_the_least_averages_and_coherence_only_if_complete():
    first, *rest = records()
    mixed = [replace(first, averages=3, coherence=None), *rest]
    frf = join_frfs(mixed, "a")
    assert frf.averages == 3
    assert frf.coherence is None
    assert join_frfs([replace(first, averages=None), *rest], "a").averages is None


def test_coherence_of_single_precision_may_pass_one_by_a_hair():
    assert join_frfs(records(coherence=np.full(40, 1 + 1e-7)), "a").coherence.max() == 1.0


def test_quantity_can_be_overruled(tmp_path):
    write_records(records(quantity=None), tmp_path / "a.npz", "npz")
    assert read_frf(tmp_path / "a.npz", quantity="mobility").quantity == "mobility"
