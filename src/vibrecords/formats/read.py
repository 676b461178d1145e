"""Records of a measurement file of any format, which is told by what is in it."""

import re
import stat
import zipfile
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

from vibrecords.arrays import Quantity
from vibrecords.errors import MeasurementError, path_fault, placed, refusal
from vibrecords.formats.array_files import read_arrays, zip_entries
from vibrecords.formats.array_walk import records_of_tree
from vibrecords.formats.grid import cut_to_band, join_frfs
from vibrecords.formats.lvm import read_lvm
from vibrecords.formats.matlab_5 import matlab_4_header
from vibrecords.formats.named_arrays import apply_attributes
from vibrecords.formats.names import NAMES
from vibrecords.formats.table import records_of_tables
from vibrecords.formats.table_text import read_text_table, text_lines
from vibrecords.formats.tdms import read_tdms
from vibrecords.formats.uff_data_sets import BEGINNING, read_uff
from vibrecords.formats.xlsx import read_xlsx
from vibrecords.frf_set import FrfSet
from vibrecords.records import MOST_BYTES, MOST_RECORDS, FrfRecord, Record, labels_of, non_negative_half, require_short

_HDF5 = b"\x89HDF\r\n\x1a\n"
_EXPECTED = "expected UFF, MAT, CSV or TSV, xlsx, npz, HDF5, LVM or TDMS; export the measurement in one of them"


def detect_format(path: str | Path) -> str:
    """By content: ``uff``, ``mat``, ``mat4``, ``mat73``, ``npz``, ``hdf5``, ``lvm``, ``tdms``, ``xlsx`` or ``table``.

    Raises
    ------
    MeasurementError
        If the file cannot be opened, is empty, is larger than any measurement or is none of these.
    """
    # 1. the beginning of a regular file; a pipe would be waited for
    path, expected = Path(path), "expected a measurement file; correct the path"
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise MeasurementError(f"{path}: found a directory, a device or a pipe; {expected}")
        if about.st_size > MOST_BYTES:
            found = f"{about.st_size / 2**30:.3g} GiB"
            raise refusal(str(path), found, f"at most {MOST_BYTES >> 30}", "split the file")
        with path.open("rb") as file:
            head = file.read(4096)
    except FileNotFoundError:
        raise MeasurementError(f"{path}: found no such file; {expected}") from None
    except (OSError, ValueError) as error:  # of other kinds, and a NUL in the path
        reason = path_fault(error)
        raise MeasurementError(f"{str(path)[:300]}: found that it cannot be read ({reason}); {expected}") from None
    if not head.strip():
        raise MeasurementError(f"{path}: found nothing but {len(head)} blank bytes in the file; {_EXPECTED}")
    # 2. words at the beginning of a text
    wide = head[:2] in (b"\xff\xfe", b"\xfe\xff")
    if wide:
        head = head[: len(head) // 2 * 2].decode("utf-16", errors="replace").encode("utf-8", errors="replace")
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    is_universal = text.split(b"\n", 1)[0].strip() == b"-1"
    if text.startswith(b"version https://git-lfs"):
        raise refusal(path, "a pointer of Git LFS", "the measurement", "run `git lfs pull`")
    if wide and is_universal:
        raise refusal(path, "text in UTF-16", "a universal file in ASCII", "save it so")
    if kind := next((kind for beginning, kind in _TOLD_BY_BEGINNING.items() if text.startswith(beginning)), None):
        return kind
    # 3. binary files
    if matlab_4_header(head):
        return "mat4"
    if head.startswith(_HDF5) or any(head[at : at + 8] == _HDF5 for at in (512, 1024, 2048)):
        return "hdf5"
    if head.startswith(b"PK\x03\x04"):
        try:
            names = [entry.filename for entry in zip_entries(path)]
        except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
            found = "a zip archive that is cut off or damaged"
            raise refusal(str(path), found, "a complete npz file", "copy it again") from None
        if any(name.endswith(".npy") for name in names):
            return "npz"
        if "xl/workbook.xml" in names:
            return "xlsx"
        raise MeasurementError(f"{path}: found a zip archive without NumPy arrays or sheets; {_EXPECTED}")
    if re.match(rb"\x80[\x01-\x05]|c[\w.]+\n\w+\n|\(lp\d|\(dp\d|[\]}]q\x00", head):
        raise MeasurementError(f"{path}: found a Python pickle, which is never opened; {_EXPECTED}")
    for name, starts in NAMES["others"].items():
        if head.startswith(tuple(start.encode("latin-1") for start in starts)):
            raise MeasurementError(f"{path}: found {name}; {_EXPECTED}")
    # 4. texts
    if is_universal or BEGINNING.search(head):
        return "uff"
    head = head.partition(b"\n\x1a")[0].rstrip(b"\x1a\r\n")  # Ctrl-Z ends a text of DOS
    if any(byte < 32 and byte not in b"\t\n\r\f" for byte in head):
        raise MeasurementError(f"{path}: found binary data of an unknown kind; {_EXPECTED}")
    return "table"


def iter_records(path: str | Path, layout: Mapping[str, str] | None = None) -> Iterator[Record]:
    """FRFs and time histories of a file, one after the other, in SI units and otherwise as the file has them.

    Parameters
    ----------
    path
        UFF, MAT, CSV or TSV, xlsx, npz, HDF5, LVM or TDMS; told apart by content.
    layout
        What the file's names stand for where they do not tell: our name to theirs, as ``[data.layout]``.

    Yields
    ------
    FrfRecord or TimeRecord
        A universal file is streamed: no more than one record is in memory.

    Raises
    ------
    MeasurementError
        One line that names the file, the place in it, and what is expected.
    """
    path, kind, count = Path(path), detect_format(path), 0
    if layout and kind in _SELF_EXPLAINING:
        found = f"[data.layout] for a file of format {kind}"
        raise refusal(str(path), found, "it for MAT, HDF5, npz or tables", "take it away")
    try:
        with placed(path), closing(_READERS[kind](path, layout or {})) as records:
            for record in records:
                count += 1
                if count > MOST_RECORDS:
                    raise refusal("content", f"more than {MOST_RECORDS} FRFs and time histories", "fewer", "split it")
                require_short(record.where[:60], *labels_of(record), getattr(record, "unit", ""))
                yield non_negative_half(record)
    except OSError as error:
        raise refusal(path, f"a fault ({error})", "a readable file", "copy it again") from None
    except (ValueError, LookupError, ArithmeticError) as error:  # what a reader makes of bytes that it did not expect
        found = f"content that cannot be read ({' '.join(str(error).split())[:80] or type(error).__name__})"
        expected = f"a complete file of format {kind}"
        raise refusal(str(path), found, expected, "copy it again or export it again") from None
    if not count:
        found, expected = "neither FRFs nor time histories", "variables such as 'frequency_hz' and 'frf'"
        raise refusal(str(path), found, expected, "see 'Measurement files' of the documentation")


def read_frf(
    path: str | Path, *, f_min_hz: float | None = None, f_max_hz: float | None = None, quantity: Quantity | None = None
) -> FrfSet:
    """FRFs of a file as one set; outputs and inputs are the file's channel labels.

    Parameters
    ----------
    path
        File in any of the formats.
    f_min_hz, f_max_hz
        Lines outside the band are cut away before anything is checked.
    quantity
        What the FRFs are, against what the file says.

    Raises
    ------
    MeasurementError
        As `iter_records`, and if the FRFs do not form one set.
    """
    frfs = (record for record in iter_records(path) if isinstance(record, FrfRecord))
    cut = (cut_to_band(record, str(path), f_min_hz, f_max_hz) for record in frfs)
    return join_frfs((replace(r, quantity=quantity) if quantity else r for r in cut), str(path))


def _array_records(path: Path, layout: Mapping[str, str], kind: str) -> Generator[Record, None, None]:
    tree = apply_attributes(read_arrays(path, kind)) if kind == "hdf5" else read_arrays(path, kind)
    yield from records_of_tree(tree, layout, "." if kind.startswith("mat") else "/")


#: Formats that the first words of a file tell.
_TOLD_BY_BEGINNING = {
    b"MATLAB 7.3": "mat73",
    b"MATLAB 5.0": "mat",
    b"LabVIEW Measurement": "lvm",
    b"TDSm": "tdms",
}
#: Formats whose files say themselves what is what.
_SELF_EXPLAINING = ("uff", "lvm")
#: Readers by format, of a path and of what the user says of the names in the file.
_READERS: dict[str, Callable[[Path, Mapping[str, str]], Generator[Record, None, None]]] = {
    "uff": lambda path, _layout: read_uff(path),
    "lvm": lambda path, _layout: records_of_tables(read_lvm(path)),
    "tdms": lambda path, layout: records_of_tables(read_tdms(path, layout), layout),
    "table": lambda path, layout: records_of_tables([read_text_table(text_lines(path))], layout),
    "xlsx": lambda path, layout: read_xlsx(path, lambda table: records_of_tables([table], layout)),
    **{kind: partial(_array_records, kind=kind) for kind in ("mat", "mat4", "mat73", "npz", "hdf5")},
}
