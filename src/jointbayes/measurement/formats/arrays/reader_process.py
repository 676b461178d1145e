"""Program that reads an HDF5 or MATLAB file and sends plain arrays to standard output; run by `read`.

It knows nothing of the package, so that it starts quickly: ``reader_process.py KIND FILE MOST_BYTES SECONDS``. What it
sends is a line of JSON, which says why the file is refused or names blocks and their arrays, and then these arrays one
after the other, each as a .npy file. It leaves nothing behind, however it ends.
"""

import json
import math
import os
import re
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Exit code for a file that is refused, with the reason on standard output.
REFUSED = 3
#: Groups within groups, groups and arrays in one file, and characters of a name: no export comes near.
_DEEPEST, _MOST_OBJECTS, _LONGEST_NAME = 32, 200_000, 300
_REMEDY = "store plain numbers and text in this file"
#: What the libraries themselves need beside the arrays.
_ROOM = 256 * 2**20
Block = dict[str, Any]


class RefusedError(Exception):
    """The file holds what is not read; the message says where and what."""


class _Output:
    """Standard output; not a file to NumPy, which would ask for the position in it."""

    def write(self, data: Any) -> int:  # noqa: ANN401 - bytes or a view of them
        return sys.stdout.buffer.write(data)


def main(arguments: list[str]) -> int:
    """Read a file as the command line says; returns the exit code."""
    kind, path, most, seconds = arguments
    limits = _Limits(int(most), float(seconds))
    try:
        blocks = list(_matlab(path, limits) if kind == "mat" else _hdf5(path, kind == "mat73", limits))
    except RefusedError as error:
        reason = str(error)
    except ImportError as error:
        reason = f"content: found that the library for it cannot be loaded ({_short(error)}); expected room for it; "
        reason += "raise the limit of memory, or install jointbayes again"
    # the libraries raise whatever the damaged bytes lead them to; which kind is of no use to anybody
    except Exception as error:
        reason = f"content: found a part that cannot be read ({_short(error)}); expected a complete file; copy it again"
        if isinstance(error, MemoryError) and limits.of_system:
            reason = f"content: found too little memory, the system allows {limits.memory / 1e6:.0f} MB; expected room "
            reason += "for all arrays of the file; raise the limit (ulimit -v)"
    else:
        _send(blocks)
        return 0
    _Output().write(json.dumps({"refused": reason}).encode() + b"\n")
    return REFUSED


def _short(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


class _Limits:
    """What reading may take, where the system can bound it: bytes of arrays, and seconds of computing."""

    def __init__(self, most: int, seconds: float) -> None:
        self.most, self.seconds = most, seconds
        self.memory, self.of_system = math.inf, False

    def bound(self) -> None:
        """Take no more from here on; called once libraries are loaded. What the system bounds already stays bounded."""
        statistics = Path("/proc/self/statm")
        if not statistics.exists():
            return
        import resource

        now = int(statistics.read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        wanted = now + 3 * self.most + _ROOM
        soft, hard = (math.inf if n == resource.RLIM_INFINITY else n for n in resource.getrlimit(resource.RLIMIT_AS))
        self.memory, self.of_system = min(wanted, soft, hard), min(soft, hard) < wanted
        _, hard_memory = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (int(self.memory), hard_memory))
        # computing and not waiting: a busy machine refuses no sound file
        _, hard_cpu = resource.getrlimit(resource.RLIMIT_CPU)
        spent = math.ceil(time.process_time() + self.seconds)
        resource.setrlimit(
            resource.RLIMIT_CPU, (spent if hard_cpu == resource.RLIM_INFINITY else min(spent, hard_cpu), hard_cpu)
        )
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))


def _refuse_more(found: int, most: int) -> None:
    """Refuse arrays that are far larger than their file."""
    if found > most:
        raise RefusedError(
            f"content: found arrays of {found / 1e6:.3g} MB; expected at most {most / 1e6:.3g} MB in a file of this "
            "size; save it again without compression"
        )


def _send(blocks: list[tuple[str, Block]]) -> None:
    out = _Output()
    names = [(place, list(block)) for place, block in blocks]
    out.write(json.dumps({"blocks": names}).encode() + b"\n")
    for _, block in blocks:
        for value in block.values():
            np.lib.format.write_array(out, np.asarray(value), allow_pickle=False)
    sys.stdout.buffer.flush()


def _matlab(path: str, limits: _Limits) -> Iterator[tuple[str, Block]]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabObject

    limits.bound()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of variables that occur twice: the last one counts, as in MATLAB
        found = loadmat(path, appendmat=False, chars_as_strings=True)
    _refuse_more(sum(value.nbytes for value in found.values() if isinstance(value, np.ndarray)), limits.most)
    top: Block = {}
    structs = []
    for name, value in found.items():
        if name.startswith("__"):
            continue
        if isinstance(value, np.ndarray) and value.dtype.names is not None and not isinstance(value, MatlabObject):
            structs.append((name, value))
        else:
            top[name] = _plain(value, f"variable '{name}'")
    if top:
        yield "", top
    for name, value in structs:
        for i, element in enumerate(value.ravel()):
            place = f"{name}." if value.size == 1 else f"{name}({i + 1})."
            yield place, {key: _plain(element[key], f"variable '{place}{key}'") for key in value.dtype.names}


def _plain(value: Any, where: str) -> NDArray[Any]:  # noqa: ANN401 - whatever scipy makes of the variable
    """Array of numbers or text; a cell array of text becomes an array of strings."""
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    if isinstance(value, (MatlabFunction, MatlabObject, MatlabOpaque)):
        raise RefusedError(f"{where}: found a function handle or an object of MATLAB; expected numbers; {_REMEDY}")
    if not isinstance(value, np.ndarray) or value.dtype.names is not None:
        raise RefusedError(f"{where}: found a sparse matrix or a struct; expected a full array; {_REMEDY}")
    if value.dtype != object:
        return value
    cells = [item.ravel()[0] if isinstance(item, np.ndarray) and item.size == 1 else item for item in value.ravel()]
    cells = ["" if isinstance(item, np.ndarray) and item.size == 0 else item for item in cells]
    if not all(isinstance(item, str) for item in cells):
        raise RefusedError(f"{where}: found cells that are not text; expected a cell array of labels; {_REMEDY}")
    return np.array(cells, dtype=str)


def _hdf5(path: str, matlab: bool, limits: _Limits) -> Iterator[tuple[str, Block]]:
    """Blocks of a file, one for each group; attributes count as arrays."""
    import h5py  # type: ignore[import-untyped]

    limits.bound()
    with h5py.File(path, "r") as file:
        groups = dict(_groups(file))
        _refuse_more(sum(item.nbytes for _, block in groups.values() for item in block.values()), limits.most)
        for place in sorted(groups, key=_natural):
            group, arrays = groups[place]
            prefix = f"{place}/" if place else ""
            block = {key: _array(item, f"variable '{prefix}{key}'", matlab) for key, item in arrays.items()}
            attributes = {} if matlab else {key: _attribute(v) for key, v in group.attrs.items()}
            block = {key: value for key, value in {**attributes, **block}.items() if value is not None}
            if block:
                yield prefix, block


def _groups(file: Any) -> Iterator[tuple[str, tuple[Any, Block]]]:  # noqa: ANN401 - h5py is untyped here
    """Place of each group, the group itself and its arrays; links to other places and other files are passed over.

    Not by `visititems`, which looks each name up from the top: in groups within groups that takes quadratic time.
    """
    import h5py

    waiting, seen, count = [("", file, 0)], set(), 0
    while waiting:
        place, group, depth = waiting.pop()
        where = h5py.h5o.get_info(group.id)
        if (where.fileno, where.addr) in seen:
            continue  # a group that holds itself
        seen.add((where.fileno, where.addr))
        count += len(group)
        if depth > _DEEPEST or count > _MOST_OBJECTS:
            raise RefusedError(
                f"group '{place[:60]}': found groups {depth} deep, {count} entries so far; expected at most {_DEEPEST} "
                f"deep and {_MOST_OBJECTS} entries; {_REMEDY}"
            )
        arrays: Block = {}
        for name in group:
            if len(name) > _LONGEST_NAME:
                raise RefusedError(
                    f"group '{place[:60]}': found a name of {len(name)} characters; expected at most {_LONGEST_NAME}; "
                    "rename it"
                )
            of_matlab = not place and name.startswith("#")
            if of_matlab or not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            item = group[name]
            if isinstance(item, h5py.Dataset):
                arrays[name] = item
            elif isinstance(item, h5py.Group):
                waiting.append((f"{place}/{name}" if place else name, item, depth + 1))
        yield place, (group, arrays)


def _natural(name: str) -> list[tuple[int, str]]:
    """Order in which record_10 comes after record_9."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d{1,9})", name) if part]


def _attribute(value: Any) -> Any:  # noqa: ANN401
    kinds = "iufUS"
    return value if isinstance(value, str) or np.asarray(value).dtype.kind in kinds else None


def _array(item: Any, where: str, matlab: bool) -> Any:  # noqa: ANN401
    """Content of a data set, or None where MATLAB marks it as empty."""
    import h5py

    if item.is_virtual or item.external:
        raise RefusedError(f"{where}: found data kept in another file; expected them in this one; {_REMEDY}")
    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if "MATLAB_object_decode" in item.attrs or kind == "function_handle":
        raise RefusedError(f"{where}: found a function handle or an object of MATLAB; expected numbers; {_REMEDY}")
    if item.shape is None or "MATLAB_empty" in item.attrs:
        return None
    if h5py.check_string_dtype(item.dtype):
        return np.array(item.asstr(errors="replace")[()], dtype=str)
    if h5py.check_ref_dtype(item.dtype) is h5py.Reference:
        return np.array([_text(item.file[reference], where) for reference in item[()].ravel(order="K")], dtype=str)
    found: NDArray[Any] = item[()]
    if found.dtype.names == ("real", "imag"):
        whole = np.empty(found.shape, complex)
        whole.real, whole.imag = found["real"], found["imag"]
        found = whole
    if found.dtype.kind not in "iufcUSb":
        raise RefusedError(f"{where}: found data of type {item.dtype}; expected numbers or text; {_REMEDY}")
    if kind == "char":
        return np.array(_characters(found), dtype=str)
    return np.asarray(found).T if matlab else found


def _text(item: Any, where: str) -> str:  # noqa: ANN401
    """Text in a cell of a cell array."""
    kind = item.attrs.get("MATLAB_class", b"")
    if kind not in (b"char", "char") or item.nbytes > 4096:
        raise RefusedError(f"{where}: found cells that are not text; expected a cell array of labels; {_REMEDY}")
    return "" if "MATLAB_empty" in item.attrs else _characters(item[()])[0]


def _characters(codes: NDArray[Any]) -> list[str]:
    """Rows of a character array, stored as UTF-16 with rows along the last axis."""
    rows = np.atleast_2d(codes.T).astype("<u2")
    return [row.tobytes().decode("utf-16-le", errors="replace").rstrip() for row in rows]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
