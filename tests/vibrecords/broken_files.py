"""Broken measurement files, each made from a sound one by one fault: name → (bytes, what the message must say)."""

import io
import pickle
import struct
import zipfile

import h5py
import numpy as np
import scipy.io
from benchmarks.written_files import write_records

from tests.vibrecords.made_files import function_58, header_164
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


def uff(**changes):
    """One data set 58 with a fault, as bytes."""
    return function_58(H[:, 0, 0], **changes).encode()


def field(text, line, first, last, new):
    """Text with one field of one line replaced, columns counted from 1."""
    lines = text.split(b"\n")
    row = lines[line - 1].ljust(80)
    lines[line - 1] = row[: first - 1] + new.rjust(last - first + 1).encode() + row[last:]
    return b"\n".join(lines)


def broken_uff(directory):
    whole, one = sound(directory, "uff58"), uff()
    lines = LINES.copy()
    doubled, backwards = lines.copy(), lines.copy()
    doubled[5], backwards[7] = lines[4], 2.5
    vector = H[:, 0, 0]
    nan, zero, infinite = vector.copy(), vector.copy(), vector.copy()
    nan[3], zero[4], infinite[5] = complex(1, np.nan), 0, complex(np.inf, 1)
    time = function_58(
        vector.real, [0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12], function=1, kinds=("time", "force", "none")
    )
    return {
        "uff cut within values": (one[:-120], r"data set 1, line \d+: found the end of the file"),
        "uff cut within the header": (one[:300], r"data set 1, line \d+: found \d+ lines of header; expected 11"),
        "uff cut behind the type": (b"    -1\n    58\n", r"data set 1, line 3: found 0 lines of header"),
        "uff cut behind a delimiter": (b"    -1\n", "data set 1, line 2: found the end of the file"),
        "uff cut at its last delimiter": (whole[:-9], r"found the end of the file; expected the delimiter -1"),
        "uff count too large": (field(one, 9, 11, 20, "13"), "found 24 numbers; expected 26"),
        "uff count too small": (field(one, 9, 11, 20, "11"), r"line 19: found more numbers; expected 22"),
        "uff count of zero": (field(one, 9, 11, 20, "0"), "data set 1, line 9: found 0 values; expected 1 or more"),
        "uff negative count": (field(one, 9, 11, 20, "-12"), "line 9: found -12 values"),
        "uff huge count": (field(one, 9, 11, 20, "9999999999"), "expected 19999999998 for the 9999999999 values"),
        "uff count in words": (field(one, 9, 11, 20, "twelve"), "found 'twelve' in columns 11 to 20"),
        "uff unknown ordinate type": (field(one, 9, 1, 10, "3"), "ordinate data type 3; expected 2, 4, 5 or 6"),
        "uff unknown spacing": (field(one, 9, 21, 30, "7"), "found abscissa spacing 7"),
        "uff increment of zero": (field(one, 9, 44, 56, "0.0"), "abscissa increment 0; expected it above 0"),
        "uff increment nan": (field(one, 9, 44, 56, "nan"), "abscissa increment nan"),
        "uff D in the header": (field(one, 9, 44, 56, "0.5D+00"), "replace D by E"),
        "uff impossible direction": (field(one, 8, 52, 55, "9"), "line 8: found directions 9 and 2"),
        "uff text among numbers": (field(one, 15, 21, 40, "abc"), "data set 1, line 15: found 'abc'; expected"),
        "uff D exponents": (one[:900] + one[900:].replace(b"E+", b"D+").replace(b"E-", b"D-"), "replace D by E"),
        "uff underscores": (field(one, 15, 21, 40, "1_0.0"), "line 15: found '1_0.0'; expected a number"),
        "uff missing number": (field(one, 16, 1, 20, ""), "line 19: found 23 numbers; expected 24"),
        "uff comma for a point": (field(one, 15, 1, 20, "1,5"), "line 15: found '1,5'"),
        "uff delimiter gone": (changed(one + one, b"\n    -1\n    -1\n", b"\n"), r"data set 1, line 20: found"),
        "uff text between data sets": (one + b"hello\n" + one, "line 21: found 'hello' between data sets"),
        "uff type in words": (b"    -1\n    xy\n" + one, "line 2: found 'xy'; expected the number"),
        "uff NaN": (uff_of(nan), "data set 1: found NaN or infinity at 2.5 Hz"),
        "uff infinity": (uff_of(infinite), "data set 1: found NaN or infinity at 3.5 Hz"),
        "uff number beyond all": (field(one, 15, 1, 20, "1E+999"), "NaN or infinity at 2 Hz"),
        "uff zero line": (uff_of(zero), "data set 1: found exactly 0 at 3 Hz"),
        "uff doubled line": (uff(abscissa=doubled), r"found 5 Hz after 5 Hz \(line 6\)"),
        "uff lines backwards": (uff(abscissa=backwards), r"found 2.5 Hz after 7 Hz \(line 8\)"),
        "uff line at 0 Hz": (uff(first=0.0), "data set 1: found a line at 0 Hz; .* f_min_hz"),
        "uff no function": (b"    -1\n   151\nmodel\n    -1\n", "found 1 of the types 151, and no FRF"),
        "uff coherence of other lines": (one + uff(function=6, first=3.0), "data set 2: found a coherence of 12 lines"),
        "uff coherence of another length": (one + uff_of(np.ones(9), function=6), "a coherence of 9 lines"),
        "uff coherence above 1": (one + uff_of(np.full(12, 1.7), function=6), "found coherence 1.7 at 1 Hz"),
        "uff units of zero": (header_164(length=0.0).encode() + one, "expected factors of length and force above 0"),
        "uff units in words": (header_164().replace("1.0000", "metre.").encode() + one, "data set 1, line 3: found"),
        "uff pair twice": (one + one, "data set 2: found the FRF of '12:Z.' over '11:Y.' again"),
        "uff pair missing": (one + uff(response=("NONE", 1, 1), reference=("NONE", 2, 2)), "found no FRF of '12:Z.'"),
        "uff instants uneven": (time.encode(), "data set 1: found instants that are not evenly spaced"),
        "uff complex time": (uff(function=1, kinds=("time", "force", "none")), "complex values of a time history"),
        "uff in UTF-16": (one.decode().encode("utf-16"), "found text in UTF-16"),
        "uff without its first line": (one[7:], "expected (a table|one for each|\\d+ as in|a number)"),
    }  # fmt: skip


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


def uff_of(values, **changes):
    return function_58(values, **changes).encode()


def field_58b(binary, count):
    head = b"         6        12"
    return changed(binary, head, b"         6" + count)


def broken_tables(directory):
    csv = sound(directory, "csv").split(b"\n", 1)[1]  # as another program writes it
    row = csv.split(b"\n")[5]

    def with_row(new):
        return changed(csv, row, new)

    parts = row.split(b",")
    second = b",".join([parts[0], b"%s", *parts[2:]])
    zero = b",".join([parts[0], b"0", b"0", *parts[3:]])
    return {
        "csv NaN": (with_row(second % b"nan"), "columns 2, 3 and 4: found NaN or infinity at 4 Hz"),
        "csv infinity": (with_row(second % b"-inf"), "NaN or infinity at 4 Hz"),
        "csv number beyond all": (with_row(second % b"1e999"), "NaN or infinity at 4 Hz"),
        "csv zero line": (with_row(zero), "found exactly 0 at 4 Hz"),
        "csv doubled line": (with_row(row + b"\n" + row), r"found 4 Hz after 4 Hz \(line 5\)"),
        "csv 0 Hz": (changed(csv, b"\n1.0,", b"\n0.0,"), "found a line at 0 Hz; .* f_min_hz"),
        "csv frequency nan": (changed(csv, b"\n1.0,", b"\nnan,"), "found frequency nan at line 1"),
        "csv in half of UTF-16": (csv.decode().encode("utf-16")[:-301], "found [26] fields; expected 7|empty field"),
        "csv in UTF-16 without mark": (csv.decode().encode("utf-16-le"), "found binary data of an unknown kind"),
        "csv in EBCDIC": (csv.decode().encode("cp037"), "expected"),
        "csv averages of none": (changed(csv, b"averages: 5", b"averages: 0"), "found averages '0'"),
        "csv no quantity": (csv.replace(b" [(m/s^2)/N]", b""), "no word on what the FRF is"),
        "csv coherence above 1": (changed(csv, parts[3], b"17.5"), "found coherence 17.5 at 4 Hz"),
    }  # fmt: skip


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
    rng = np.random.default_rng(9)
    return {
        "empty": (b"", "found nothing but 0 blank bytes"),
        "blanks": (b" \n\t\n" * 100, "found nothing but 400 blank bytes"),
        "zeros": (bytes(100_000), "found binary data of an unknown kind"),
        "noise": (bytes([1]) + rng.bytes(100_000), "found binary data of an unknown kind"),
        **{f"pickle {n}": (pickle.dumps(Trap(), protocol=n), "Python pickle, which is never opened") for n in range(6)},
        "pickle of a dictionary": (pickle.dumps({"H": [1.0]}, protocol=0), "Python pickle, which is never opened"),
        "executable": (b"\x7fELF\x02\x01\x01" + bytes(500), "found an executable program"),
        "executable of Windows": (b"MZ\x90\x00" + bytes(500), "found an executable program"),
        "script": (b"#!/bin/sh\nrm -r important\n", "found a script"),
        "program of Python": (b"import os\nos.remove('x')\n", "found no row of two numbers"),
        "gzip": (b"\x1f\x8b\x08\x00" + bytes(50), "found a gzip archive"),
        "PDF": (b"%PDF-1.7\n", "found a PDF document"),
        "image": (b"\x89PNG\r\n\x1a\n" + bytes(50), "found an image"),
        "TDMS": (b"TDSm" + bytes(50), "found a part that cannot be read|expected the package npTDMS"),
        "single array": (b"\x93NUMPY\x01\x00" + bytes(50), "found a single NumPy array"),
    }  # fmt: skip


MAKERS = (broken_uff, broken_58b, broken_tables, broken_npz, broken_mat, broken_hdf5, strangers)
