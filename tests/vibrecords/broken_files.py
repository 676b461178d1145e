"""Broken measurement files, each made from a sound one by one fault: name → (bytes, what the message must say)."""

import io
import pickle
import struct
import zipfile

import h5py
import numpy as np
import scipy.io
from benchmarks.written_files import write_records

from vibrecords import FrfSet
from vibrecords.formats import records_of_frf

LINES = np.arange(1.0, 13.0)
RNG = np.random.default_rng(8)
H = RNG.normal(size=(12, 2, 1)) + 1j * RNG.normal(size=(12, 2, 1))
FRF = FrfSet(LINES, H, ("12:Z+", "11:Y+"), ("11:Y+",), "accelerance", RNG.uniform(0.5, 0.9, (12, 2, 1)), 5)


class Trap:
    """Leaves a trace if it is ever unpickled."""

    def __reduce__(self):
        return (_spring, ())


def _spring():
    raise SystemExit("unpickled")


def sound(directory, form, records=None):
    """Bytes of a sound file of a format."""
    path = directory / f"sound.{form}"
    write_records(records or records_of_frf(FRF), path, form)
    return path.read_bytes()


def changed(text, old, new, count=1):
    """Text with a part replaced, which must be there."""
    old, new = (x.encode() if isinstance(x, str) else x for x in (old, new))
    assert old in text, old
    return text.replace(old, new, count)


def broken_58b(directory):
    binary = sound(directory, "uff58b")
    second = binary.index(b"    58b", binary.index(b"    58b") + 9)
    return {
        "58b cut within values": (binary[: second - 100], r"data set 3, line \d+: found no delimiter -1 after the 192"),
        "58b byte order unknown": (changed(binary, b"b     1", b"b     7"), "found byte order 7 and floating-point"),
        "58b numbers of a VAX": (changed(binary, b"b     1     2", b"b     1     1"), "floating-point format 1"),
        "58b count too large": (field_58b(binary, b"        13"), "found no delimiter -1 after the 208 bytes of 13"),
        "58b count huge": (field_58b(binary, b"9999999999"), "found no delimiter -1 after"),
    }  # fmt: skip


def field_58b(binary, count):
    head = b"         6        12"
    return changed(binary, head, b"         6" + count)


def npz_bytes(**arrays):
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def npz_member(header, content=b""):
    """An archive with one member of a header made by hand."""
    head = header.encode().ljust(118) + b"\n"
    npy = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + content
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("frf.npy", npy)
    return out.getvalue()


def broken_npz(directory):
    npz = sound(directory, "npz")
    word = io.BytesIO()
    with zipfile.ZipFile(word, "w") as archive:
        archive.writestr("word/document.xml", "<w/>")
    traps = np.empty(2, dtype=object)
    traps[:] = [Trap(), Trap()]
    huge = "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
    evil = "{'descr': __import__('os').system('true'), 'fortran_order': False, 'shape': (1,), }"
    return {
        "npz cut": (npz[:-300], "zip archive that is cut off"),
        "npz damaged": (changed(npz, b"(12, 2, 1)", b"(12, 2, 9)"), "variable 'frf': found an array that"),
        "npz with a pickle": (npz_bytes(frf=traps, frequency_hz=LINES), "variable 'frf'.*without objects"),
        "npz of a huge shape": (npz_member(huge), "variable 'frf': found an array that"),
        "npz with code for a header": (npz_member(evil), "variable 'frf': found an array that cannot be read"),
        "npz bomb": (npz_bytes(frf=np.zeros(9_000_000), frequency_hz=LINES), "found arrays of 72 MB or more; expected"),
        "npz of other arrays": (npz_bytes(a=LINES), "found neither FRFs nor time histories"),
        "npz of text": (npz_bytes(frf=np.array(["a"] * 12), frequency_hz=LINES), "variable 'frf': found text"),
        "npz NaN": (npz_bytes(frf=np.full(12, np.nan + 0j), frequency_hz=LINES, unit="m/N"), "NaN or infinity at 1 Hz"),
        "npz 0 Hz": (npz_bytes(frf=H, frequency_hz=LINES - 1, unit="m/N"), "found a line at 0 Hz"),
        "npz no lines": (npz_bytes(frf=H[:0], frequency_hz=LINES[:0], unit="m/N"), "found no frequency line"),
        "zip of a document": (word.getvalue(), "zip archive without NumPy arrays"),
    }  # fmt: skip


def mat_bytes(**arrays):
    out = io.BytesIO()
    scipy.io.savemat(out, arrays, do_compression=arrays.pop("compress", False))
    return out.getvalue()


def broken_mat(directory):
    mat = sound(directory, "mat")
    packed = mat_bytes(frf=H, frequency_hz=LINES, compress=True)
    damaged = bytearray(packed)
    damaged[160:176] = bytes(16)
    thing = scipy.io.matlab.MatlabObject(np.array([(1.0,)], dtype=[("a", object)]), "control")
    number = mat_bytes(f=1.0)[128:]
    flags, named = struct.pack("<IIII", 6, 8, 16, 0), number[24:48]
    body = flags + named + number
    function = mat[:128] + struct.pack("<II", 14, len(body)) + body
    at = mat.index(struct.pack("<iiii", 5, 12, 12, 2))
    return {
        "mat header cut": (mat[:100], "part that cannot be read"),
        "mat cut": (mat[:-500], "part that cannot be read"),
        "mat damaged compression": (bytes(damaged), "content: found a part that cannot be read .*decompressing"),
        "mat function handle": (function, "'f' .a function handle or an object"),
        "mat object": (mat_bytes(frf=thing), "variable 'frf': found a function handle or an object"),
        "mat sparse": (
            mat_bytes(frf=scipy.sparse.csc_matrix(([1.0], ([0], [0])), (10**5, 10**5))),
            "variable 'frf': found a sparse matrix",
        ),
        "mat bomb": (mat_bytes(frf=np.zeros(9_000_000), compress=True), "found arrays of 67.1 MB or more; expected"),
        "mat of a huge size": (mat[: at + 8] + struct.pack("<i", 2**30) + mat[at + 12 :], "part that cannot be read"),
        "mat without lines": (mat_bytes(frf=H), "variable 'frf': found no frequency lines"),
        "mat of other arrays": (mat_bytes(a=1.0), "found neither FRFs nor time histories"),
        "mat of version 4": (b"\0\0\0\0\x01\0\0\0\x01\0\0\0\0\0\0\0\x02\0\0\0a\0" + bytes(8), "in 'a' .1 x 1 real"),
    }  # fmt: skip


def hdf5_bytes(directory, fill, userblock=0):
    path = directory / "made.h5"
    with h5py.File(path, "w", userblock_size=userblock) as file:
        fill(file)
    return path.read_bytes()


def broken_hdf5(directory):
    hdf5, mat73 = sound(directory, "hdf5"), sound(directory, "mat73")

    def sparse(file):
        file["frequency_hz"] = LINES
        file.create_dataset("frf", shape=(10**9, 12), dtype="f8", chunks=(1000, 12))

    def elsewhere(file):
        file["frequency_hz"] = LINES
        file.create_dataset("frf", (12,), "<f8", external=[("/etc/passwd", 0, 96)])

    def function(file):
        file["frequency_hz"] = LINES
        file["frf"] = np.zeros(3, "u2")
        file["frf"].attrs["MATLAB_class"] = np.bytes_("function_handle")

    def compound(file):
        file["frequency_hz"] = LINES
        file["frf"] = np.zeros(12, [("a", "f8"), ("b", "i4")])

    heap = hdf5.index(b"GCOL")
    return {
        "hdf5 cut": (hdf5[:-500], "truncated file|cannot be read"),
        "hdf5 signature alone": (hdf5[512:520] + b"garbage" * 200, "part that cannot be read"),
        "hdf5 heap damaged": (hdf5[: heap + 24] + bytes(16) + hdf5[heap + 40 :], "part that cannot be read"),
        "hdf5 of nothing": (hdf5_bytes(directory, lambda file: None), "found neither FRFs nor time histories"),
        "hdf5 sparse": (hdf5_bytes(directory, sparse), "found arrays of 9.6e.04 MB or more; expected at most"),
        "hdf5 of another file": (hdf5_bytes(directory, elsewhere), "variable 'frf': found data kept in another file"),
        "hdf5 compound": (hdf5_bytes(directory, compound), "variable 'frf': found data of type"),
        "mat73 cut": (mat73[:2000], "cannot be read"),
        "mat73 header alone": (mat73[:512], "cannot be read"),
        "mat73 function handle": (
            mat73[:512] + hdf5_bytes(directory, function, 512)[512:],
            "variable 'frf': found a function handle",
        ),
    }  # fmt: skip


def strangers(directory):
    rng, csv = np.random.default_rng(9), sound(directory, "csv")
    return {
        "empty": (b"", "found nothing but 0 blank bytes"),
        "blanks": (b" \n\t\n" * 100, "found nothing but 400 blank bytes"),
        "zeros": (bytes(100_000), "found binary data of an unknown kind"),
        "noise": (bytes([1]) + rng.bytes(100_000), "found binary data of an unknown kind"),
        **{f"pickle {n}": (pickle.dumps(Trap(), protocol=n), "Python pickle, which is never opened") for n in range(6)},
        "TDMS": (b"TDSm" + bytes(50), "found a part that cannot be read|expected the package npTDMS"),
        "half of UTF-16": (csv.decode().encode("utf-16")[:-301], "found [1-6] fields; expected 7|empty field"),
        "UTF-16 without mark": (csv.decode().encode("utf-16-le"), "found binary data of an unknown kind"),
        "EBCDIC": (csv.decode().encode("cp037"), "expected"),
    }  # fmt: skip


MAKERS = (broken_58b, broken_npz, broken_mat, broken_hdf5, strangers)
