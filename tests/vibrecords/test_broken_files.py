"""A corpus of broken files: one line that names file and place and says what is expected; no crash, no hang."""

import os
import random
import tracemalloc
from functools import cache

import numpy as np
import pytest
from benchmarks.written_files import FORMATS, write_records

from tests.fuzz.damage import damaged_bytes
from tests.vibrecords.broken_files import MAKERS
from tests.vibrecords.made_files import function_58
from tests.vibrecords.reading import refusal
from tests.vibrecords.test_formats import frf_set
from vibrecords.errors import MeasurementError
from vibrecords.formats import iter_records, read, read_frf, records_of_frf
from vibrecords.records import FrfRecord, TimeRecord

#: What reading takes beside the file: buffers, and modules imported at the first time.
ROOM = 2_000_000


def complaint(path):
    """Message of the error, empty where there are records."""
    try:
        assert all(record.values.size > 0 for record in iter_records(path))
    except MeasurementError as error:
        return str(error)
    return ""


@pytest.fixture(scope="module", params=MAKERS, ids=lambda maker: maker.__name__)
def corpus(request, tmp_path_factory):
    return request.param(tmp_path_factory.mktemp("sound"))


def test_each_broken_file_is_one_line_that_names_the_place(corpus, tmp_path):
    for name, (content, expected) in corpus.items():
        refusal(tmp_path / name, content, expected, read=read_frf)


def test_missing_files_directories_and_pipes(tmp_path):
    refusal(tmp_path / "none.uff", None, "found no such file")
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe"):
        refusal(path, None, "found a directory, a device or a pipe")


@cache
def big_files():
    values = np.random.default_rng(6).normal(size=40_000) + 1j
    text = function_58(values)
    table = "".join(f"{i}.5,{z.real!r},{z.imag!r}\n" for i, z in enumerate(values[:20_000].tolist(), start=1))
    return {
        "uff cut": text[:-500],
        "uff text among its last numbers": text[:-60] + "oops" + text[-56:],
        "uff of one endless line": "    -1\n    58\n" + "1 " * 1_000_000,
        "csv with a broken last row": "frequency,real [m/N],imag [m/N]\n" + table + "20001.5,x,1\n",
        "csv with NaN at the end": "frequency,real [m/N],imag [m/N]\n" + table + "20001.5,nan,1\n",
        "csv of one endless line": "1.0," * 3_000_000,
    }


@pytest.mark.whole
@pytest.mark.parametrize("name", big_files())
def test_memory_is_bounded_by_three_times_the_file(tmp_path, name):
    path = tmp_path / "measurement"
    path.write_text(big_files()[name])
    tracemalloc.start()
    refusal(path, None, read=read_frf)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3 * path.stat().st_size + ROOM, (peak, path.stat().st_size)


@pytest.mark.parametrize("form", FORMATS)
def test_cuts_and_flipped_bits_never_get_further_than_one_line(tmp_path, form):
    """Whatever the damage, there are records or there is an error of one line."""
    number = FORMATS.index(form)
    history = TimeRecord("1:Z+", 100.0, np.random.default_rng(number).normal(size=30), "force")
    sound = []
    for records in (records_of_frf(frf_set()), [history]):
        write_records(records, tmp_path / "a", form)
        sound.append((tmp_path / "a").read_bytes())
    choices, refused, count = random.Random(number), 0, 60
    for turn in range(count):
        (tmp_path / "b").write_bytes(damaged_bytes(choices, sound[turn % 2]))
        message = complaint(tmp_path / "b")
        refused += bool(message)
        assert "\n" not in message
        assert not message or (message.startswith(str(tmp_path / "b")) and "expected" in message)
    assert refused >= count // 3


def sweep(path, _layout):
    """A reader as somebody adds one, without a guard of its own."""
    first, *lines = path.read_text(encoding="utf-8").splitlines()
    _, response, reference = first.split()
    frequency, real, imaginary = np.array([[float(x) for x in line.split(";")] for line in lines]).T
    yield FrfRecord(response, reference, frequency, real + 1j * imaginary, "accelerance", unit="(m/s^2)/N")


@pytest.mark.parametrize("damage", [b"\xff", b"x;", b"2;", b"SWEEP", b";", b"\n\n"])
def test_damage_that_a_new_reader_does_not_expect_is_one_line(tmp_path, monkeypatch, damage):
    monkeypatch.setitem(read._TOLD_BY_BEGINNING, b"SWEEP ", "sweep")
    monkeypatch.setitem(read._READERS, "sweep", sweep)
    path, sound = tmp_path / "a", b"SWEEP acc ref\n1;2;3\n2;4;5\n"
    path.write_bytes(sound)
    (frf,) = iter_records(path)
    assert frf.values.tolist() == [2 + 3j, 4 + 5j]
    path.write_bytes(sound[:22] + damage + sound[22:])
    refusal(path, None, "found content that cannot be read .*; expected a complete file of format sweep; copy it")
