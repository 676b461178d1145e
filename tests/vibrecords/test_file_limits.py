"""What is no measurement file, or too large a one, is one line: soon, whatever it is, and it leaves nothing behind."""

import os
import stat
import time
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from benchmarks import written_files

from tests.vibrecords.broken_files import FRF, npz_bytes
from tests.vibrecords.made_files import function_58, head, lvm
from tests.vibrecords.reading import put, refusal
from vibrecords import records as stated
from vibrecords.errors import MeasurementError, WriteError
from vibrecords.formats import detect_format, iter_records, join_frfs, read_frf, uff_data_sets, write_frf, write_records
from vibrecords.formats import read as reading
from vibrecords.formats.array_walk import records_of_tree
from vibrecords.formats.table import records_of_tables
from vibrecords.formats.table_text import Column, ColumnTable, column_of
from vibrecords.inspection import contents_of_records, inspect_file
from vibrecords.records import FrfRecord, TimeRecord

LINES = np.arange(1.0, 13.0)


# ---- paths


@pytest.mark.parametrize(("name", "found"), [
    ("a\0b", "cannot be read (embedded null byte)"),
    ("a" * 5000, "cannot be read (File name too long)"),
    ("loop", "cannot be read (Too many levels of symbolic links)"),
    ("pipe", "found a directory, a device or a pipe"),
    ("/dev/zero", "found a directory, a device or a pipe"),
    ("/dev/stdin", "found a directory, a device or a pipe"),
    (".", "found a directory, a device or a pipe"),
    ("file/below", "cannot be read (Not a directory)"),
], ids=ascii)  # fmt: skip
def test_what_is_no_file_is_refused_without_waiting(tmp_path, monkeypatch, name, found):
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    Path("file").write_text("1,2,3\n")
    os.mkfifo("pipe")
    for attempt in (detect_format, lambda path: next(iter_records(path)), read_frf, lambda p: inspect_file(Path(p))):
        with pytest.raises(MeasurementError) as caught:
            attempt(name)
        assert found in str(caught.value)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 600


def test_nothing_but_a_file_is_written_over(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in ("a\0b", "a" * 300, tmp_path / "pipe", tmp_path, "/dev/full", tmp_path / "none" / "a"):
        with pytest.raises(WriteError, match="expected") as caught:
            write_frf(FRF, path)
        assert str(caught.value).isprintable()
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)


def test_a_label_that_is_no_text_is_not_written(tmp_path):
    record = FrfRecord("tip \udc9b", "b", LINES, LINES + 1j, "mobility")
    with pytest.raises(MeasurementError, match="expected"):
        write_records([record], tmp_path / "a")
    assert not list(tmp_path.iterdir())


# ---- sizes


def test_a_file_larger_than_any_measurement_is_not_begun(tmp_path):
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(stated.MOST_BYTES + 1)
    assert f"expected at most {stated.MOST_BYTES >> 30}" in refusal(tmp_path / "huge")


@pytest.mark.parametrize("form", ["uff58", "csv", "npz"])
def test_more_records_than_any_measurement_are_refused(tmp_path, monkeypatch, form):
    written_files.write_frf(FRF, tmp_path / "a", form)
    monkeypatch.setattr(reading, "MOST_RECORDS", 1)
    assert "found more than 1 FRFs and time histories" in refusal(tmp_path / "a")


def test_more_data_sets_than_belong_to_so_many_are_refused(tmp_path, monkeypatch):
    (tmp_path / "a").write_text("    -1\n   151\nmodel\n    -1\n" * 30)
    monkeypatch.setattr(uff_data_sets, "_MOST_SETS", 20)
    assert "data sets: found more than 20" in refusal(tmp_path / "a")


@pytest.mark.parametrize("long", ["x" * 301, "x" * 100_000])
def test_labels_and_units_longer_than_any_are_refused(tmp_path, long):
    csv = f"frequency [Hz],real {long},imaginary {long}\n1,2,3\n2,3,4\n"
    labview = lvm([long], [[0, 1], [1, 2]], head(["N"], 2))
    label = npz_bytes(frf=LINES + 1j, frequency_hz=LINES, outputs=np.array([long]))
    unit = npz_bytes(frf=LINES + 1j, frequency_hz=LINES, unit=np.array(long))
    for content in (csv, labview, label, unit):
        message = refusal(put(tmp_path / "a", content))
        assert f"expected at most {stated.LONGEST_LABEL}" in message
        assert len(message) < 600


def test_more_columns_than_any_table_has_are_refused(tmp_path):
    (tmp_path / "a").write_text("1," * stated.MOST_COLUMNS + "1\n")
    assert f"expected at most {stated.MOST_COLUMNS}" in refusal(tmp_path / "a")


def test_a_number_that_no_measurement_gives_is_no_frf(tmp_path):
    for values, lines, found in (
        (np.full(12, 1e60 + 0j), LINES, "a number beyond 1e+40"),
        (np.full(12, 1e-60 + 0j), LINES, "a number beyond 1e+40 or its inverse"),
        (LINES + 1j, LINES * 1e200, "expected them within 1e-09 to 1e+09 Hz"),
    ):
        with pytest.raises(MeasurementError, match=r"found.*") as caught:
            join_frfs([FrfRecord("a", "b", lines, values, "mobility")], "file")
        assert found in str(caught.value)


# ---- time


def seconds(work, n):
    begun = time.process_time()
    work(n)
    return time.process_time() - begun


def join(n):
    lines = np.array([1.0, 2.0])
    join_frfs((FrfRecord(f"a{i}", "b", lines, np.ones(2) + 1j, "mobility") for i in range(n)), "file")


def same_names(n):
    roles = ["real", "imaginary"] * n
    columns = [Column("frequency", "", "Hz"), *(Column(role, "a", "") for role in roles)]
    sum(1 for _ in records_of_tables([ColumnTable(columns, np.ones((1, len(columns))), {})]))


def histories(n):
    contents_of_records(TimeRecord("a", 10.0, np.array([1.0, 2.0]), "force", hit=i) for i in range(1, n))


def units_again(n):
    text = "    -1\n   164\n         1SI                           2\n" + f"{1.0:25.17E}" * 3 + "\n    -1\n"
    Path("units").write_text(text * n + function_58(LINES + 1j))
    list(iter_records("units"))


def structs(n):
    """Structs beside each other, and FRFs with their coherences in one of them."""
    frfs = {f"H_{i}": LINES + 1j for i in range(n // 10)} | {f"coh_{i}": LINES for i in range(n // 10)}
    tree = {f"hit_{i}": {"H": LINES + 1j} for i in range(n)} | {"f": LINES, "all": frfs}
    sum(1 for _ in records_of_tree(tree, {}, "."))


@pytest.mark.whole
@pytest.mark.parametrize("work", [join, same_names, histories, units_again, structs])
def test_time_does_not_grow_with_the_square_of_the_number(tmp_path, monkeypatch, work):
    monkeypatch.chdir(tmp_path)
    n = 2000 if work is join else 1000
    work(n // 10)  # what is loaded at first use
    # whatever else the machine does disturbs one measurement or two, not each of six
    ratios = (seconds(work, 5 * n) / seconds(work, n) for _ in range(6))
    assert any(ratio < 12 for ratio in ratios), "five times the number took over 12 times the time, six times"


@pytest.mark.parametrize("header", ["a" + " " * 290 + "b", "(" * 300, "[" * 300, "real " + "_" * 290])
def test_a_header_made_to_be_searched_long_is_a_name(header):
    def took(name):
        return seconds(lambda n: [column_of(name) for _ in range(n)], 200)

    # it is ten times as long
    assert any(took(header) < 20 * took("real Point:12:Z+ / 11:Y+ [g/N]") for _ in range(6))


# ---- groups within groups


def nested(path, depth):
    with h5py.File(path, "w") as file:
        group = file
        for _ in range(depth):
            group = group.create_group("g")
        group["frequency_hz"], group["frf"] = LINES, LINES + 1j
    return path


def test_groups_within_groups_are_read_as_deep_as_any_export_goes_and_no_further(tmp_path):
    assert len(list(iter_records(nested(tmp_path / "a", 30)))) == 1
    message = refusal(nested(tmp_path / "b", 2000))
    assert "found groups 33 deep" in message


def test_a_group_that_holds_itself_is_read_once(tmp_path):
    path = nested(tmp_path / "a", 2)
    with h5py.File(path, "a") as file:
        file["g"]["again"] = file
        file["soft"], file["other"] = h5py.SoftLink("/g"), h5py.ExternalLink("/etc/passwd", "/")
    assert len(list(iter_records(path))) == 1


# ---- faults that were tracebacks


def test_a_row_that_was_taken_out_by_a_sign_of_comment_is_no_header(tmp_path):
    (tmp_path / "a").write_text("# 10,1,2\n20,1,2.5\n# 25,3,4\n30,1,2\n")
    (record,) = iter_records(tmp_path / "a")
    np.testing.assert_array_equal(record.frequency_hz, [20.0, 30.0])
    (tmp_path / "b").write_text("frequency [Hz],real a [m/N],imaginary a [m/N]\n# 10,1,2\n20,1,2\n30,1,2\n")
    (named,) = iter_records(tmp_path / "b")
    assert (named.unit, named.frequency_hz.tolist()) == ("m/N", [20.0, 30.0])


@pytest.mark.parametrize("start", ["", "# "])
def test_a_bare_carriage_return_ends_a_line(tmp_path, start):
    text = f"{start}frequency [Hz],real a / a [m/N],imaginary\rx\r20,1,2\r30,1,2\r"
    (tmp_path / "a").write_bytes(text.encode())
    (record,) = iter_records(tmp_path / "a")
    assert (record.response, record.unit, record.values.tolist()) == ("a", "m/N", [1 + 2j, 1 + 2j])


@pytest.mark.parametrize("code", [0x110000, 0xFFFFFFFF, 0xD800])
@pytest.mark.parametrize("order", "<>")
def test_text_beyond_unicode_is_no_text(tmp_path, code, order):
    word = np.array([code], f"{order}u4").view(f"{order}U1")
    for key in ("unit", "outputs", "quantity"):
        np.savez(tmp_path / "a.npz", **{"frequency_hz": LINES, "frf": LINES + 1j, key: word})
        assert f"variable '{key}': found the code {code:#x}" in refusal(tmp_path / "a.npz")


@pytest.mark.parametrize("rate", ["200..0", "1.2.3", "1e", "", "1_0", "0x10", "nan", "inf", "-5", "1e400"])
def test_a_sample_rate_that_is_no_number_is_that_of_the_axis(tmp_path, rate):
    even = function_58(np.arange(12.0), function=1, kinds=("time", "force", "none"), first=0.0)
    (tmp_path / "a").write_text(even.replace("\nNONE\n", f"\nsample_rate_hz={rate}\n", 1))
    (of_axis,) = iter_records(tmp_path / "a")
    (tmp_path / "b").write_text(f"# sample_rate_hz: {rate}\ntime [s],hammer [N]\n0,1\n0.5,2\n1.0,3\n")
    (of_table,) = iter_records(tmp_path / "b")
    assert of_axis.sample_rate_hz == of_table.sample_rate_hz == 2.0


def test_hits_are_numbered_by_whole_numbers(tmp_path):
    for hits in ([np.nan], [np.inf], [-1.0], [1.5], [1e300]):
        np.savez(tmp_path / "a.npz", sample_rate_hz=100.0, samples=np.arange(12.0), hits=np.array(hits))
        assert "variable 'hits': found" in refusal(tmp_path / "a.npz")


def test_every_format_has_a_fuzz_target():
    from tests.fuzz.targets import FILES

    assert {target.name for target in FILES} == {*written_files.FORMATS, "tsv", "lvm"}


@pytest.mark.parametrize("name", ["a{}.npy", "xl/sheet{}.xml"])
def test_an_archive_of_many_entries_is_refused_before_one_is_read(tmp_path, monkeypatch, name):
    def archive(count):
        with zipfile.ZipFile(tmp_path / "many.npz", "w") as made:
            for number in range(count):
                made.writestr(name.format(number), b"")

    opened = []
    listed = zipfile.ZipFile
    archive(5001)
    monkeypatch.setattr(zipfile, "ZipFile", lambda *args, **kw: opened.append(args) or listed(*args, **kw))
    message = refusal(tmp_path / "many.npz")
    assert "found 5001 entries of an archive; expected at most 5000; join arrays, or split it" in message
    assert opened == []
    archive(5000)
    assert "entries" not in refusal(tmp_path / "many.npz")
