"""Which format a file has, by what is in it."""

import re
import stat
import zipfile
from pathlib import Path

from jointbayes.errors import MeasurementError, path_fault
from jointbayes.measurement.formats.limits import MOST_BYTES

_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Beginnings of files that are not measurements, with their names.
_OTHERS: tuple[tuple[bytes, str], ...] = (
    (b"\x7fELF", "an executable program"),
    (b"MZ", "an executable program"),
    (b"#!", "a script"),
    (b"%PDF", "a PDF document"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"BZh", "a bzip2 archive"),
    (b"\xfd7zXZ", "an xz archive"),
    (b"7z\xbc\xaf", "a 7-Zip archive"),
    (b"\xd0\xcf\x11\xe0", "an old Microsoft Office document"),
    (b"\x89PNG", "an image"),
    (b"\xff\xd8\xff", "an image"),
    (b"\xff\xfe", "text in UTF-16"),
    (b"\xfe\xff", "text in UTF-16"),
    (b"TDSm", "a LabVIEW TDMS file"),
    (b"<!DOCTYPE", "a web page"),
    (b"<html", "a web page"),
    (b"<?xml", "an XML document"),
    (b"\x93NUMPY", "a single NumPy array"),
)
_EXPECTED = "expected UFF, MAT, CSV or TSV, npz, HDF5 or LVM; export the measurement in one of them"


def detect_format(path: str | Path) -> str:
    """Format of a file by its content: ``uff``, ``mat``, ``mat73``, ``npz``, ``hdf5``, ``lvm`` or ``table``.

    Raises
    ------
    MeasurementError
        If the file cannot be opened, is empty, is larger than any measurement or is none of these.
    """
    path = Path(path)
    head = _head(path)
    if not head.strip():
        raise MeasurementError(f"{path}: found nothing but {len(head)} blank bytes in the file; {_EXPECTED}")
    return _binary_format(path, head) or _text_format(path, head)


def _head(path: Path) -> bytes:
    """Beginning of a file, once it is known to be one: a pipe would be waited for."""
    expected = "expected a measurement file; correct the path"
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise MeasurementError(f"{path}: found a directory, a device or a pipe; {expected}")
        if about.st_size > MOST_BYTES:
            raise MeasurementError(
                f"{path}: found {about.st_size / 2**30:.3g} GiB; expected at most {MOST_BYTES >> 30}; split the file"
            )
        with path.open("rb") as file:
            return file.read(4096)
    except FileNotFoundError:
        raise MeasurementError(f"{path}: found no such file; {expected}") from None
    except (OSError, ValueError) as error:  # of other kinds, and a NUL in the path
        reason = path_fault(error)
        raise MeasurementError(f"{str(path)[:300]}: found that it cannot be read ({reason}); {expected}") from None


def _binary_format(path: Path, head: bytes) -> str | None:
    if head.startswith(b"MATLAB 7.3"):
        return "mat73"
    if head.startswith(b"MATLAB 5.0"):
        return "mat"
    if head.startswith(_HDF5) or any(head[at : at + 8] == _HDF5 for at in (512, 1024, 2048)):
        return "hdf5"
    if head.startswith(b"PK\x03\x04"):
        try:
            with zipfile.ZipFile(path) as archive:
                names = archive.namelist()
        except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
            raise MeasurementError(
                f"{path}: found a zip archive that is cut off or damaged; expected a complete npz file; copy it again"
            ) from None
        if any(name.endswith(".npy") for name in names):
            return "npz"
        raise MeasurementError(f"{path}: found a zip archive without NumPy arrays (an Office document?); {_EXPECTED}")
    if re.match(rb"\x80[\x01-\x05]|c[\w.]+\n\w+\n|\(lp\d|\(dp\d|[\]}]q\x00", head):
        raise MeasurementError(f"{path}: found a Python pickle, which is never opened; {_EXPECTED}")
    for start, name in _OTHERS:
        if head.startswith(start):
            raise MeasurementError(f"{path}: found {name}; {_EXPECTED}")
    return None


def _text_format(path: Path, head: bytes) -> str:
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    first = text.split(b"\n", 1)[0].strip()
    if re.fullmatch(rb"-1", first):
        return "uff"
    if first.startswith(b"LabVIEW Measurement"):
        return "lvm"
    control = sum(byte < 32 and byte not in b"\t\n\r\f" for byte in head)
    if control:
        raise MeasurementError(f"{path}: found binary data of an unknown kind; {_EXPECTED}")
    return "table"
