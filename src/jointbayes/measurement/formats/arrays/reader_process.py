"""Program that reads an HDF5 or MATLAB file and leaves plain arrays in an npz file; run by `read`.

It knows nothing of the package, so that it starts quickly: ``reader_process.py KIND FILE TARGET MOST_BYTES``.
"""

import json
import os
import re
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["REFUSED", "main"]

#: Exit code for a file that is refused, with the reason on standard output.
REFUSED = 3
_REMEDY = "store plain numbers and text in this file"
#: What the libraries themselves need beside the arrays.
_ROOM = 256 * 2**20
Block = dict[str, Any]


class RefusedError(Exception):
    """The file holds what is not read; the message says where and what."""


def main(arguments: list[str]) -> int:
    """Read a file as the command line says; returns the exit code."""
    kind, path, target, most = arguments
    try:
        blocks = list(_matlab(path, int(most)) if kind == "mat" else _hdf5(path, kind == "mat73", int(most)))
    except RefusedError as error:
        reason = str(error)
    # the libraries raise whatever the damaged bytes lead them to; which kind is of no use to anybody
    except Exception as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        reason = f"content: found a part that cannot be read ({reason}); expected a complete file; copy it again"
    else:
        _save(blocks, target)
        return 0
    sys.stdout.buffer.write(reason.encode("utf-8", errors="replace"))
    return REFUSED


def _bound_memory(most: int) -> None:
    """Let this process take no more than the arrays of the file can need, where the system can bound it."""
    statistics = Path("/proc/self/statm")
    if statistics.exists():
        import resource

        now = int(statistics.read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (now + 3 * most + _ROOM, resource.RLIM_INFINITY))


def _refuse_more(found: int, most: int) -> None:
    """Refuse arrays that are far larger than their file."""
    if found > most:
        raise RefusedError(
            f"content: found arrays of {found / 1e6:.3g} MB; expected at most {most / 1e6:.3g} MB in a file of this "
            "size; save it again without compression"
        )


def _save(blocks: list[tuple[str, Block]], target: str) -> None:
    arrays: dict[str, NDArray[Any]] = {}
    manifest = []
    for place, block in blocks:
        names = []
        for name, value in block.items():
            key = f"a{len(arrays)}"
            arrays[key] = np.asarray(value)
            names.append((name, key))
        manifest.append((place, names))
    with open(target, "wb") as file:
        np.savez(file, manifest=np.array(json.dumps(manifest)), **arrays)  # type: ignore[arg-type]


def _matlab(path: str, most: int) -> Iterator[tuple[str, Block]]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabObject

    _bound_memory(most)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of variables that occur twice: the last one counts, as in MATLAB
        found = loadmat(path, appendmat=False, chars_as_strings=True)
    _refuse_more(sum(value.nbytes for value in found.values() if isinstance(value, np.ndarray)), most)
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


def _hdf5(path: str, matlab: bool, most: int) -> Iterator[tuple[str, Block]]:
    """Blocks of a file, one for each group; attributes count as arrays."""
    import h5py  # type: ignore[import-untyped]

    _bound_memory(most)
    with h5py.File(path, "r") as file:
        groups: dict[str, Block] = {"": {}}

        def visit(name: str, item: Any) -> None:  # noqa: ANN401 - h5py is untyped here
            group, _, key = name.rpartition("/")
            if name.startswith("#"):
                return
            if isinstance(item, h5py.Dataset):
                groups.setdefault(group, {})[key] = item
            else:
                groups.setdefault(name, {})

        file.visititems(visit)  # passes over links to other files
        _refuse_more(sum(item.nbytes for block in groups.values() for item in block.values()), most)
        for group in sorted(groups, key=_natural):
            prefix = f"{group}/" if group else ""
            block = {key: _array(item, f"variable '{prefix}{key}'", matlab) for key, item in groups[group].items()}
            attributes = {} if matlab else {key: _attribute(v) for key, v in file[group or "/"].attrs.items()}
            block = {key: value for key, value in {**attributes, **block}.items() if value is not None}
            if block:
                yield prefix, block


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
