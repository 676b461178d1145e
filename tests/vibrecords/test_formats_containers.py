"""npz, MAT and HDF5 files as others write them: aliases, shapes, structs, cells, groups, attributes."""

import struct
import zipfile

import h5py
import numpy as np
import pytest
import scipy.io

from tests.vibrecords.array_trees import WRITERS
from vibrecords.errors import MeasurementError
from vibrecords.formats import array_files, iter_records, read_frf
from vibrecords.formats.array_files import read_arrays

LINES = np.array([1.5, 2.0, 2.5, 3.25])
RNG = np.random.default_rng(4)
H = RNG.normal(size=(4, 3, 2)) + 1j * RNG.normal(size=(4, 3, 2))


def saver(form):
    return lambda path, **arrays: WRITERS[form](arrays, path)


save_npz, save_hdf5 = map(saver, ("npz", "hdf5"))


@pytest.fixture(params=["npz", "mat", "hdf5"])
def save(request):
    return saver(request.param)


@pytest.mark.parametrize(("shape", "labels"), [
    (H, {}),
    (np.moveaxis(H, 0, -1), {}),
    (H[:, :, 0], {}),
    (H[:, 0, 0], {}),
    (H[:, 0, 0][:, None], {}),
    (H[:, 0, 0][None, :], {}),
    (H[:, 0, :], {"outputs": ["one"], "inputs": ["a", "b"]}),
], ids=["lines first", "lines last", "one input", "one FRF", "column", "row", "one output"])  # fmt: skip
def test_usual_shapes_are_known(tmp_path, save, shape, labels):
    save(tmp_path / "a", f=LINES, H=shape, unit="m/N", **labels)
    frf = read_frf(tmp_path / "a")
    expected = H[:, :1, :] if labels else H[:, : frf.values.shape[1], : frf.values.shape[2]]
    np.testing.assert_array_equal(frf.values, expected)
    assert frf.values.size == shape.size


def test_hdf5_groups_are_blocks_and_attributes_count(tmp_path):
    with h5py.File(tmp_path / "a", "w") as file:
        for k in (1, 2, 10):
            group = file.create_group(f"run/hit_{k}")
            group["frequency_hz"], group["frf"] = LINES, H[:, 0, 0] * k
            group.attrs["quantity"], group.attrs["averages"] = "mobility", 3
    found = list(iter_records(tmp_path / "a"))
    assert [r.where.split("'")[1] for r in found] == [f"run/hit_{k}/frf" for k in (1, 2, 10)]
    assert {(r.quantity, r.averages) for r in found} == {("mobility", 3)}


def test_npz_members_that_are_no_arrays_are_told(tmp_path):
    save_npz(tmp_path / "a", f=LINES)
    with zipfile.ZipFile(tmp_path / "a", "a") as archive:
        archive.writestr("notes.txt", "hello")
    with pytest.raises(MeasurementError, match=r"member 'notes.txt': found no NumPy array"):
        list(read_arrays(tmp_path / "a", "npz"))


@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_5_is_read_as_scipy_reads_it(tmp_path, compressed):
    given = {
        "frf": H,
        "single": np.ones(3, np.complex64) * 2j,
        "counts": np.arange(5, dtype=np.int16),
        "flags": np.array([True, False]),
        "none": np.zeros((0, 3)),
        "text": "tip ü",
        "rows": np.array(["ab ", "cde"]),
        "nothing": "",
    }
    cells = np.array([["a", "bb"], ["", "d"]], dtype=object)
    scipy.io.savemat(tmp_path / "a.mat", given | {"cells": cells}, do_compression=compressed)
    block = read_arrays(tmp_path / "a.mat", "mat")
    expected = scipy.io.loadmat(tmp_path / "a.mat")
    assert block.pop("cells").tolist() == ["a", "bb", "", "d"]
    assert block.keys() == given.keys()
    for name, value in block.items():
        np.testing.assert_array_equal(value, expected[name], strict=name != "single")


def matlab_element(kind, content):
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def matlab_cell(content, name=b""):
    """Cell array of one cell, as an element of a MATLAB 5 file."""
    flags, shape = struct.pack("<II", 1, 0), struct.pack("<ii", 1, 1)
    parts = (matlab_element(6, flags), matlab_element(5, shape), matlab_element(1, name), content)
    return matlab_element(14, b"".join(parts))


@pytest.mark.parametrize("depth", [2, 30_000])
def test_cells_within_cells_however_deep_are_one_line(tmp_path, depth):
    """Read by scipy, five thousand levels end the process."""
    scipy.io.savemat(tmp_path / "a.mat", {"f": 1.0})
    sound = (tmp_path / "a.mat").read_bytes()
    content = sound[128:]
    for _ in range(min(depth, 100)):
        content = matlab_cell(content)
    header = content[: -len(sound[128:])] * (depth // 100)  # whose sizes no longer agree, as scipy does not notice
    (tmp_path / "a.mat").write_bytes(sound[:128] + matlab_cell(header + content, b"c"))
    with pytest.raises(MeasurementError, match=r"1 cells real|groups 33 deep"):
        list(iter_records(tmp_path / "a.mat"))


def test_a_number_wider_than_its_room_is_not_read(tmp_path):
    """A damaged type of 16 bytes in the room of 8: h5py writes beyond its array."""
    wide = np.dtype({"names": ["real", "imag"], "formats": ["<f16", "<f8"], "offsets": [0, 8], "itemsize": 16})
    assert not array_files._is_plain(wide)
    assert array_files._is_plain(np.dtype([("real", "<f8"), ("imag", "<f8")]))
    save_hdf5(tmp_path / "a", frequency_hz=LINES, frf=np.ones(4, np.longdouble))
    with pytest.raises(MeasurementError, match="variable 'frf': found data of type float128"):
        list(iter_records(tmp_path / "a"))


def test_texts_without_end_are_one_line(tmp_path):
    save_hdf5(tmp_path / "a", frequency_hz=LINES, frf=H[:, :2, 0], outputs=["a", "x" * 4097])
    with pytest.raises(MeasurementError, match="found 2 texts of up to 4097 bytes; expected at most"):
        list(iter_records(tmp_path / "a"))
    content = bytearray((tmp_path / "a").read_bytes())
    free = content.index(b"GCOL") + 16
    while content[free : free + 2] != bytes(2):
        size = struct.unpack_from("<Q", content, free + 8)[0]
        free += 16 + size + -size % 8
    content[free + 8 : free + 16] = bytes(8)  # HDF5 reads a free part of size 0 again and again
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(MeasurementError, match=r"a heap of texts at byte"):
        list(iter_records(tmp_path / "a"))
