"""Trees of arrays written as MATLAB 5, MATLAB 7.3, npz and HDF5 files, as MATLAB and others write them."""

import itertools
import json
from pathlib import Path

import h5py
import numpy as np
import scipy.io
import scipy.sparse

#: Of what references lead to, each of which has a name of its own.
_NUMBERS = itertools.count()


def write_mat(tree, path):
    """As `save` of MATLAB: structs, cells, sparse matrices; a list of dicts is an array of structs."""
    scipy.io.savemat(str(path), {name: _mat_value(value) for name, value in tree.items()}, appendmat=False)


def _mat_value(value):
    if isinstance(value, dict):
        return {name: _mat_value(item) for name, item in value.items()}
    if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        array = np.empty((1, len(value)), dtype=[(name, object) for name in value[0]])
        for i, item in enumerate(value):
            for name in value[0]:
                array[0, i][name] = _mat_value(item[name])
        return array
    if isinstance(value, list):
        cells = np.empty((1, len(value)), dtype=object)
        for i, item in enumerate(value):
            cells[0, i] = _mat_value(item)
        return cells
    return value


def write_mat73(tree, path):
    """As `save -v7.3`: HDF5 with references for cells and arrays of structs."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in tree.items():
            _put(file, file, name, value)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def _reference(file, value):
    name = f"r{next(_NUMBERS)}"
    refs = file.require_group("#refs#")
    _put(file, refs, name, value)
    return refs[name].ref


def _put(file, group, name, value):
    if isinstance(value, dict):
        made = group.create_group(name)
        made.attrs["MATLAB_class"] = np.bytes_("struct")
        for key, item in value.items():
            _put(file, made, key, item)
    elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        made = group.create_group(name)
        made.attrs["MATLAB_class"] = np.bytes_("struct")
        for key in value[0]:
            refs = [_reference(file, item[key]) for item in value]
            made.create_dataset(key, data=np.array([refs], dtype=h5py.ref_dtype).T)
    elif isinstance(value, list):
        refs = [_reference(file, item) for item in value]
        made = group.create_dataset(name, data=np.array([refs], dtype=h5py.ref_dtype).T)
        made.attrs["MATLAB_class"] = np.bytes_("cell")
    elif isinstance(value, str) and not value:
        made = group.create_dataset(name, data=np.zeros(2, "u8"))
        made.attrs["MATLAB_class"], made.attrs["MATLAB_empty"] = np.bytes_("char"), np.uint8(1)
    elif isinstance(value, str):
        made = group.create_dataset(name, data=np.frombuffer(value.encode("utf-16-le"), "<u2")[:, None])
        made.attrs["MATLAB_class"] = np.bytes_("char")
    elif scipy.sparse.issparse(value):
        made, columns = group.create_group(name), value.tocsc()
        made.attrs["MATLAB_class"], made.attrs["MATLAB_sparse"] = np.bytes_("double"), np.uint64(columns.shape[0])
        made["data"], made["ir"], made["jc"] = columns.data, columns.indices, columns.indptr
    else:
        array = np.atleast_2d(np.asarray(value))
        if np.iscomplexobj(array):
            pair = np.empty(array.shape, [("real", "<f8"), ("imag", "<f8")])
            pair["real"], pair["imag"] = array.real, array.imag
            array = pair
        made = group.create_dataset(name, data=array.T, compression="gzip" if array.size else None)
        made.attrs["MATLAB_class"] = np.bytes_("double")


def write_npz(tree, path):
    """As `numpy.savez`, with paths for names of what is within."""
    arrays = {}

    def add(place, value):
        if isinstance(value, dict):
            for name, item in value.items():
                add(f"{place}/{name}" if place else name, item)
        else:
            arrays[place] = np.asarray(value.toarray() if scipy.sparse.issparse(value) else value)

    add("", tree)
    with path.open("wb") as file:
        np.savez(file, **arrays)


def write_hdf5(tree, path):
    """As h5py users write groups."""

    def add(group, block):
        for name, value in block.items():
            if isinstance(value, dict):
                add(group.create_group(name), value)
            else:
                group[name] = value.toarray() if scipy.sparse.issparse(value) else value

    with h5py.File(path, "w") as file:
        add(file, tree)


WRITERS = {"mat": write_mat, "mat73": write_mat73, "npz": write_npz, "hdf5": write_hdf5}
#: Formats that have arrays of structs, and cells.
WITH_LISTS = ("mat", "mat73")

#: What arrays.txt says of an array before its name.
_OF = {"abs": np.abs, "angle": np.angle, "degrees": lambda z: np.angle(z, deg=True), "real": np.real, "imag": np.imag,
       "dB": lambda z: 20 * np.log10(np.abs(z)), "column": lambda x: x[:, None], "row": lambda x: x[None],
       "deep": lambda x: x[..., None], "turned": np.transpose, "backwards": lambda x: x[::-1],
       "sparse": scipy.sparse.csc_matrix}  # fmt: skip


def made(told, arrays):
    """A tree of JSON with these arrays by their names in place of texts such as ``"=column 0.001 abs V"``."""
    if isinstance(told, dict):
        return {key: made(value, arrays) for key, value in told.items()}
    if isinstance(told, list):
        return [made(value, arrays) for value in told]
    if not (isinstance(told, str) and told.startswith("=")):
        return told
    words = told[1:].split()
    count = int(words.pop()) if words[-1].isdecimal() else None
    array = arrays[words.pop()][:count]
    for word in reversed(words):
        array = _OF[word](array) if word in _OF else float(word) * array
    return array


def trees(arrays, table="arrays"):
    """Files of arrays.txt or another table by name: the tree, what is told of each record, and the formats."""
    for part in Path(__file__).with_name(f"{table}.txt").read_text(encoding="utf-8").split("\n== ")[1:]:
        head, tree, _, *records = part.rstrip("\n").split("\n")
        name, _, forms = head.partition(" | ")
        told = [made(json.loads(record), arrays) for record in records if record]
        yield name, made(json.loads(tree), arrays), told, forms.split() or [*WRITERS]
