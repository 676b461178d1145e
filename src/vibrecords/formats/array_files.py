"""Files of named arrays: npz (never a pickle), HDF5 and MATLAB, read as one tree of arrays and texts."""

import math
import mmap
import re
import struct
import warnings
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import complex_of
from vibrecords.errors import MeasurementError, refusal, require_at_most
from vibrecords.formats import matlab_5
from vibrecords.formats.matlab_5 import ATTRIBUTE, Block, MatrixOf, Unread, full_matrix, read_matlab_4
from vibrecords.records import LONGEST_LABEL, MOST_RECORDS, refuse_damage

#: A compressed file may unpack to this many times its size, or to 64 MiB: constant signals pack well.
_RATIO, _ALWAYS = 20, 2**26
_MOST_ENTRIES = 5000  # of an archive
#: Bytes of one text in a file of arrays: labels are short, and a posterior's coordinates too.
_LONGEST_TEXT = 4096
#: How a text of any length stands in a data set that lies in one piece: its length, and where its bytes are.
_TEXT_ENTRY = np.dtype([("length", "<u4"), ("heap", "<u8"), ("number", "<u4")])


def read_arrays(path: Path, kind: str, most: int = 0, matrix: MatrixOf = full_matrix) -> Block:
    """All that a file holds, as one tree.

    Parameters
    ----------
    path, kind
        The file: ``npz``, ``mat``, ``mat4``, ``mat73`` or ``hdf5``.
    most
        Bytes that it may unpack to, where that is more than FRFs do.
    matrix
        What becomes of MATLAB's sparse matrices.

    Returns
    -------
    dict
        Name to an array of numbers or text, to a dict (struct, group), to a list of these (cells, array of structs), or
        to an `Unread`, in the order of the file and groups by name. In HDF5 ``frf@unit`` is the attribute ``unit`` of
        the data set ``frf``.

    Raises
    ------
    MeasurementError
        If the file cannot be read, or unpacks to far more than its size.
    """
    with refuse_damage("content", "a complete file; copy it again", most=120):
        return _READERS[kind](path, max(most, _ALWAYS, _RATIO * path.stat().st_size), matrix)


def read_groups(path: Path) -> dict[str, Block]:
    """Arrays of an HDF5 file by the place of their group, ``""`` at the top.

    Raises
    ------
    MeasurementError
        As `read_arrays`, and if there is anything but numbers and text.
    """
    groups: dict[str, Block] = {}
    waiting = [("", read_arrays(path, "hdf5"))]
    while waiting:
        place, block = waiting.pop()
        groups[place.strip("/")] = {
            key: value for key, value in block.items() if not isinstance(value, dict) and ATTRIBUTE not in key
        }
        waiting += [(f"{place}/{key}", value) for key, value in block.items() if isinstance(value, dict)]
        for key, value in groups[place.strip("/")].items():
            if isinstance(value, Unread):
                raise refusal(f"variable '{place}/{key}'", value.what, "numbers or text")
    return groups


# ---- npz


def zip_entries(path: Path) -> list[zipfile.ZipInfo]:
    """Entries of a zip archive, counted before they are listed: reading takes a fifth of a millisecond for each.

    Raises
    ------
    MeasurementError
        If there are too many.
    """
    with path.open("rb") as file:
        count = sum(part.count(b"PK\x01\x02") for part in iter(partial(file.read, 2**24), b""))
    require_at_most(_MOST_ENTRIES, count, f"{path}", "entries of an archive", "join arrays, or split it")
    with zipfile.ZipFile(path) as archive:
        return archive.infolist()


def _read_npz(path: Path, most: int, _matrix: MatrixOf) -> Block:
    """Arrays of an archive; ``record_2/frf`` is the array ``frf`` of the group ``record_2``."""
    tree: Block = {}
    matlab_5.refuse_larger(sum(member.file_size for member in zip_entries(path)), most)
    with np.load(path, allow_pickle=False) as arrays, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of headers as Python 2 wrote them
        for name in arrays.files:
            expected = "plain numbers or text; save it again without objects"
            with refuse_damage(f"variable '{name}'", expected, "an array", most=120):
                array = arrays[name]
            if not isinstance(array, np.ndarray):
                raise refusal(f"member '{name}'", "no NumPy array", ".npy members", "save it again")
            *groups, key = name.split("/")
            matlab_5.refuse_deeper(len(groups), len(arrays.files), f"variable '{name}'")
            block = tree
            for group in groups:
                block = block.setdefault(group, {})
                if not isinstance(block, dict):
                    raise MeasurementError(f"variable '{name}': found an array '{group}' as well; rename one of them")
            block[key] = array
    return tree


# ---- HDF5 and MATLAB 7.3


def _read_hdf5(path: Path, most: int, matrix: MatrixOf, *, matlab: bool = False) -> Block:
    import h5py  # type: ignore[import-untyped]

    # a damaged heap of texts (a "global heap collection") is refused, because HDF5 may read it without end
    with path.open("rb") as raw, mmap.mmap(raw.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for heap in re.finditer(rb"GCOL\x01...", content, re.DOTALL):
            at, end = heap.end() + 8, heap.start() + struct.unpack_from("<Q", content, heap.end())[0]
            while at + 16 <= end:
                number, size = struct.unpack_from("<H6xQ", content, at)
                step = 16 + size + -size % 8 if number else size  # what is free has number 0
                if step < 16 or at + step > min(end, len(content)):
                    raise ValueError(f"a heap of texts at byte {heap.start()}")
                at += step
    with h5py.File(path, "r") as file:
        return _Hdf5(file, most, matlab, matrix).group(file)


def has_attribute(path: Path, name: str) -> bool:
    """Whether a file is HDF5 with an attribute of this name at the top."""
    import h5py

    try:
        with h5py.File(path, "r", locking=False) as file:
            return name in file.attrs
    except (OSError, RuntimeError):
        return False  # none, or damaged


class _Hdf5:
    """Reads the groups of an open file, and what references in them lead to; other links are passed over."""

    def __init__(self, file: Any, most: int, matlab: bool, matrix: MatrixOf) -> None:  # noqa: ANN401 - h5py is untyped
        self.file, self.most, self.matlab, self.matrix = file, most, matlab, matrix
        self.bytes = self.count = 0
        self.seen: set[tuple[int, int]] = set()

    def group(self, group: Any, place: str = "", depth: int = 0) -> Any:  # noqa: ANN401
        """Content of a group: attributes count as arrays; None of one that was there before, as one that holds itself.

        Not by `visititems`, which looks each name up from the top: in groups within groups that takes quadratic time.
        """
        import h5py

        where = h5py.h5o.get_info(group.id)
        if (where.fileno, where.addr) in self.seen:
            return None
        self.seen.add((where.fileno, where.addr))
        self.count += len(group)
        matlab_5.refuse_deeper(depth, self.count, f"group '{place}'")
        items: Block = {}
        for name in group:
            require_at_most(LONGEST_LABEL, len(name), f"group '{place[:60]}'", "characters of a name", "rename it")
            # MATLAB's own, and links
            if (place or not name.startswith("#")) and isinstance(group.get(name, getlink=True), h5py.HardLink):
                items[name] = group[name]
        attributes = self.attributes(group)
        names = [n for n, item in items.items() if isinstance(item, h5py.Dataset)]
        named = {*names}
        groups = sorted((n for n, item in items.items() if isinstance(item, h5py.Group)), key=_natural)
        block = {} if self.matlab else {key: v for key, v in attributes.items() if not isinstance(v, Unread)}
        for name in names + groups:
            told = self.attributes(items[name]) if name in named else {}
            block[name] = self.item(items[name], f"{place}/{name}".lstrip("/"), depth + 1, told)
            if not self.matlab:
                block |= {f"{name}{ATTRIBUTE}{key}": value for key, value in told.items()}
        block = {name: value for name, value in block.items() if value is not None}
        if self.matlab and "MATLAB_sparse" in attributes and {"ir", "jc"} <= block.keys():
            shape = (int(attributes["MATLAB_sparse"]), block["jc"].size - 1)
            parts = (block["ir"].ravel(), block["jc"].ravel(), block.get("data", np.zeros(0)).ravel())
            return self.matrix(shape, *parts, self.most - self.bytes)
        lists = [len(v) for n, v in block.items() if self.matlab and isinstance(v, list) and _is_struct_field(items[n])]
        if lists and len(lists) == len(block):  # the fields of an array of structs, element by element
            return [{name: values[i] for name, values in block.items()} for i in range(min(lists))]
        return block

    def item(self, item: Any, place: str, depth: int, attributes: Block | None = None) -> Any:  # noqa: ANN401
        """Content of a data set, whose attributes may be known, or of a group."""
        import h5py

        if isinstance(item, h5py.Group):
            return self.group(item, place, depth)
        if not isinstance(item, h5py.Dataset):
            return None
        # of the data set in memory, or of one of the chunks that it is unpacked in
        self.bytes += max(item.nbytes, math.prod(item.chunks or (0,)) * item.dtype.itemsize)
        matlab_5.refuse_larger(self.bytes, self.most)
        if h5py.check_ref_dtype(item.dtype) is not h5py.Reference or not item.shape:
            told = self.attributes(item) if attributes is None else attributes
            return _dataset(item, f"variable '{place}'", told, self.matlab)
        if not self.matlab:
            return Unread("references to other places")
        self.count += item.size
        matlab_5.refuse_deeper(depth, self.count, f"group '{place}'")
        values = [self.item(self.file[r], place, depth + 1) if r else None for r in np.asarray(item[()]).T.ravel()]
        values = [np.zeros(0) if value is None else value for value in values]
        return values if _is_struct_field(item) else matlab_5.list_or_texts(values)

    def attributes(self, item: Any) -> Block:  # noqa: ANN401
        """Attributes that are numbers or texts; each entry of a list of texts could be as long as the file."""
        found: Block = {}
        for key in item.attrs:
            kind = item.attrs.get_id(key)
            count = math.prod(kind.shape or ())
            if kind.dtype.kind == "O" and count > 1 and count * self.file.id.get_filesize() > self.most:
                found[key] = Unread("a long list of texts")
            elif _is_plain(kind.dtype) or kind.dtype.kind == "O":
                value = np.asarray(item.attrs[key])
                texts = value.dtype.kind == "O" and all(isinstance(text, str) for text in value.ravel())
                found[key] = value.astype(str) if texts else value
        return {key: value for key, value in found.items() if getattr(value, "dtype", np.dtype("U")).kind in "iufUS"}


def _is_struct_field(item: Any) -> bool:  # noqa: ANN401
    """Whether a data set of references holds one field of an array of structs; cells say that they are cells."""
    return "MATLAB_class" not in item.attrs


def _natural(name: str) -> list[tuple[int, str]]:
    """Order in which record_10 comes after record_9."""
    return [(int(piece), "") if piece.isdecimal() else (-1, piece) for piece in re.split(r"(\d{1,9})", name) if piece]


def _dataset(item: Any, where: str, attributes: Block, matlab: bool) -> Any:  # noqa: ANN401
    """Content of a data set, or None where MATLAB marks it as empty."""
    import h5py

    if item.is_virtual or item.external:
        return Unread("data kept in another file")
    kind = np.asarray(attributes.get("MATLAB_class", ""), dtype=str).ravel()[0]
    if "MATLAB_object_decode" in attributes or kind == "function_handle":
        return matlab_5.UNREADABLE
    if item.shape is None or "MATLAB_empty" in attributes:
        return np.array([], dtype=str) if kind == "char" else None
    if h5py.check_string_dtype(item.dtype):
        # HDF5 makes room for as many bytes as an entry says, up to 4 GB, before it looks for them
        offset = item.id.get_offset() if h5py.check_string_dtype(item.dtype).length is None else None
        longest = 0
        if offset is not None and item.size:
            longest = int(np.fromfile(item.file.filename, _TEXT_ENTRY, item.size, offset=offset)["length"].max())
        if longest > _LONGEST_TEXT or item.size > MOST_RECORDS:
            found = f"{item.size} texts of up to {longest} bytes"
            raise refusal(where, found, f"at most {MOST_RECORDS} of {_LONGEST_TEXT}", matlab_5.REMEDY)
        return np.array(item.asstr(errors="replace")[()], dtype=str)
    if not _is_plain(item.dtype):
        return Unread(f"data of type {item.dtype}")
    values: NDArray[Any] = item[()]
    if values.dtype.names == ("real", "imag"):
        values = complex_of(values["real"], values["imag"])
    if kind == "char":
        if values.dtype.kind != "u":
            return Unread(f"text stored as {item.dtype}")
        # UTF-16, rows along the last axis
        rows = np.atleast_2d(values.T).astype("<u2")
        return np.array([row.tobytes().decode("utf-16-le", errors="replace").rstrip() for row in rows], dtype=str)
    return np.asarray(values).T if matlab else np.asarray(values)


def _is_plain(dtype: np.dtype[Any]) -> bool:
    """Whether values are numbers, text, or pairs of real and imaginary part.

    Damage can make of a part a number of 16 bytes in the room of 8: h5py writes beyond its array, and ends the process.
    """
    if dtype.names is None:
        kind = dtype.kind
        return kind in "iuSUb" or (kind == "f" and dtype.itemsize <= 8) or dtype in (np.complex64, np.complex128)
    fields = [dtype[name] for name in dtype.names]
    wide = sum(field.itemsize for field in fields)
    return dtype.names == ("real", "imag") and all(map(_is_plain, fields)) and dtype.itemsize == wide


_READERS: dict[str, Callable[[Path, int, MatrixOf], Block]] = {
    "npz": _read_npz,
    "mat": matlab_5.read_matlab,
    "mat4": read_matlab_4,
    "mat73": partial(_read_hdf5, matlab=True),
    "hdf5": _read_hdf5,
}
