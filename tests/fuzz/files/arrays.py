"""Archives, HDF5 and MATLAB files made anew with other arrays: names, shapes, types, values, groups, attributes."""

import io
import random
import struct
import zipfile
import zlib
from contextlib import suppress
from typing import Any

import numpy as np

from tests.fuzz.files.text import UNITS
from tests.fuzz.mutations import damaged_bytes

Block = dict[str, Any]
_NAMES = [
    "frequency_hz", "f", "omega_rad_s", "w", "frf", "H", "outputs", "inputs", "quantity", "unit", "coherence",
    "averages", "sample_rate_hz", "fs", "time", "samples", "channels", "units", "quantities", "hits", "force",
    "acceleration", "velocity", "displacement", "response", "manifest",
]  # fmt: skip
_TYPES = ("<f8", ">f8", "<f4", "<f2", "<i4", "u1", "<i8", "<u8", "<c16", "<c8", "?", "S3", "<U4")
#: Names of members, and four bytes of text that is none.
_STRANGE = ("a\x1b[31m.npy", "\u202e/x.npy", "/f.npy", "x", "a/b/c.npy")
_NO_TEXT = (b"\xff\xff\xff\xff", b"\0\xd8\0\0", b"\0\0\x11\0")
_FLOATS = [0.0, 1.0, -1.0, float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 5e-324, 1e-308, 1e15, 1e-15]
_TEXTS = ["", " ", "12:Z+", "Point:1:RX-", "receptance", "mobility", "force", "acceleration", "a" * 400,
          "\x1b[31m\u202e", "ü\n", "$\\frac{", *UNITS]  # fmt: skip


def _sound(rng: random.Random) -> Block:
    """Arrays of FRFs or of time histories as a file may have them."""
    lines = rng.choice((1, 2, 12, 20, 40))
    outputs, inputs = rng.choice((1, 2, 3)), rng.choice((1, 1, 2))
    noise = np.random.default_rng(rng.getrandbits(32))
    if rng.random() < 0.6:
        f = np.arange(1.0, lines + 1)
        values = noise.normal(size=(lines, outputs, inputs)) + 1j * noise.normal(size=(lines, outputs, inputs))
        block: Block = {"frequency_hz": f, "frf": values, "unit": "(m/s^2)/N", "averages": 5.0}
        block["outputs"] = [f"{i + 1}:Z+" for i in range(outputs)]
        block["inputs"] = [f"{i + 1}:Z+" for i in range(inputs)]
        if rng.random() < 0.5:
            block["coherence"] = noise.uniform(0.1, 1, (lines, outputs, inputs))
        return block
    samples = noise.normal(size=(lines * 4, outputs))
    samples[lines : lines + 3] *= 100
    return {
        "sample_rate_hz": rng.choice((1.0, 100.0, 1e4)),
        "samples": samples,
        "channels": [f"{i + 1}:Z+" for i in range(outputs)],
        "units": ["N", "m/s^2", "g"][:outputs],
        "hits": np.arange(1.0, outputs + 1),
    }


def _array(rng: random.Random) -> Any:
    """Any array that a file may hold under any name."""
    if rng.random() < 0.15:
        return rng.choice(_TEXTS)
    if rng.random() < 0.15:
        return [rng.choice(_TEXTS) for _ in range(rng.randrange(4))]
    shape = tuple(rng.choice((0, 1, 1, 2, 3, 12, 40)) for _ in range(rng.randrange(5)))[:4]
    if np.prod(shape, dtype=float) > 1e4:
        shape = shape[:1]
    kind = np.dtype(rng.choice(_TYPES))
    with np.errstate(all="ignore"):
        if kind.kind in "US":
            return np.full(shape, rng.choice(_TEXTS)[:4].encode("ascii", "replace").decode(), kind)
        return np.full(shape, rng.choice(_FLOATS) if kind.kind in "fc" else rng.randrange(3)).astype(kind)


def _changed_block(rng: random.Random, block: Block) -> Block:
    block = dict(block)
    for _ in range(rng.choice((1, 1, 2, 3))):
        key = rng.choice(list(block)) if block else "frf"
        value = block.get(key)
        match rng.randrange(8):
            case 0:
                block[rng.choice(_NAMES)] = block.pop(key, 1.0)
            case 1:
                block[rng.choice(_NAMES)] = _array(rng)
            case 2:
                block.pop(key, None)
            case 3 | 4 if isinstance(value, np.ndarray) and value.size and value.dtype.kind in "fc":
                value = value.copy()
                with np.errstate(all="ignore"):
                    value.reshape(-1)[rng.randrange(value.size)] = rng.choice(_FLOATS)
                block[key] = value
            case 5 if isinstance(value, np.ndarray) and value.dtype.kind in "fc":
                with np.errstate(all="ignore"):
                    block[key] = value * rng.choice(_FLOATS)
            case 6 if isinstance(value, np.ndarray):
                block[key] = value.T if rng.random() < 0.5 else value[..., None]
            case 7 if isinstance(value, list) and value:
                block[key] = [*value[:-1], rng.choice(_TEXTS)] if rng.random() < 0.5 else value[:-1]
            case _:
                block[key] = _array(rng) if rng.random() < 0.5 else rng.choice(_FLOATS)
    return block


def _blocks(rng: random.Random) -> dict[str, Block]:
    made = _changed_block(rng, _sound(rng))
    if rng.random() < 0.8:
        return {"": made}
    place = rng.choice(("record_1", "a b", "record_10", "é", "x" * 80))
    return {place: made, "record_2": _changed_block(rng, _sound(rng))}


# ---- npz


def _npz_of(members: dict[str, bytes], packed: bool) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def _npy(value: Any) -> bytes:
    out = io.BytesIO()
    np.lib.format.write_array(out, np.asarray(value), allow_pickle=True)
    return out.getvalue()


def damaged_npz(rng: random.Random, content: bytes) -> bytes:
    """An archive damaged, or made anew with damaged members and the right check sums."""
    if rng.random() < 0.2:
        return damaged_bytes(rng, content)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except Exception:  # a seed that was an offender
        members = {}
    if not members or rng.random() < 0.4:
        members = {
            f"{place}/{name}.npy" if place else f"{name}.npy": _npy(value)
            for place, block in _blocks(rng).items()
            for name, value in block.items()
        }
    names = list(members)
    for _ in range(rng.choice((0, 1, 1, 2))):
        name = rng.choice(names)
        whole = members[name]
        head = min(len(whole), 128)
        match rng.randrange(5):
            case 0:
                members[name] = damaged_bytes(rng, whole[:head]) + whole[head:]
            case 1:
                members[name] = whole[:head] + damaged_bytes(rng, whole[head:])
            case 2:
                members[name] = members[rng.choice(names)]
            case 3:
                members[rng.choice((f"{rng.choice(_NAMES)}.npy", *_STRANGE))] = whole
            case 4:
                at = rng.randrange(head, len(whole)) if len(whole) > head else 0
                members[name] = whole[:at] + rng.choice(_NO_TEXT) + whole[at + 4 :]
    return _npz_of(members, rng.random() < 0.3)


# ---- HDF5 and MATLAB 7.3


def _put(rng: random.Random, group: Any, key: str, value: Any, matlab: bool) -> None:
    import h5py

    if isinstance(value, (str, list)):
        texts = [value] if isinstance(value, str) else value
        if matlab:
            wide = max([1, *map(len, texts)])
            codes = np.array([[ord(c) & 0xFFFF for c in text.ljust(wide)] for text in texts] or [[0]], "<u2")
            item = group.create_dataset(key, data=codes.T)
            item.attrs["MATLAB_class"] = np.bytes_("char")
        else:
            data = np.array([t.replace("\0", "") for t in texts], dtype=h5py.string_dtype())
            item = group.create_dataset(key, data=data if isinstance(value, list) else data[0])
    else:
        array = np.asarray(value)
        if array.dtype.kind == "U":
            array = array.astype("S16")
        if matlab and np.iscomplexobj(array):
            pair = np.empty(array.shape, [("real", "<f8"), ("imag", "<f8")])
            pair["real"], pair["imag"] = array.real, array.imag
            array = pair
        item = group.create_dataset(key, data=array.T if matlab else array)
        if matlab:
            item.attrs["MATLAB_class"] = np.bytes_("double")
    if rng.random() < 0.1:
        name = rng.choice(("MATLAB_class", "MATLAB_empty", "MATLAB_object_decode", "unit", "frf", "x"))
        item.attrs[name] = rng.choice((1, "char", b"char", b"cell", b"\xff", np.zeros((2, 2)), [1.5], "struct"))


def _strange(rng: random.Random, file: Any, matlab: bool) -> None:
    """Something that groups may hold and records do not."""
    import h5py

    match rng.randrange(9):
        case 0:
            file["soft"] = h5py.SoftLink(rng.choice(("/frf", "/nothing", "/soft")))
        case 1:
            file["frf2"] = h5py.ExternalLink(rng.choice(("/etc/passwd", "input.h5")), "/frf")
        case 2:
            group = file.require_group("deep")
            for i in range(rng.choice((2, 31, 32, 33, 100))):
                group = group.create_group(rng.choice(("a", f"g{i}", "b" * 200)))
            group["frf"] = np.ones(3)
        case 3:
            file.require_group("loop")["again"] = file
        case 4:
            shape = rng.choice(((10**6,), (10**9, 12), (0,), (10**15,)))
            file.create_dataset("samples2", shape=shape, dtype="f8", chunks=True)
        case 5:
            references = np.array([file.ref, file.ref], dtype=h5py.ref_dtype)
            file.create_dataset("outputs2" if rng.random() < 0.5 else "outputs3", data=references)
        case 6:
            file["type"] = np.dtype("<f4")
        case 7:
            file.create_dataset("odd", data=np.zeros(3, [("real", "<f8"), ("imag", rng.choice(("<f8", "<i4", "S2")))]))
        case 8:
            file.attrs[rng.choice(_NAMES)] = rng.choice((1.0, "N", np.ones(12), [b"a", b"b"], h5py.Empty("f8")))


def _hdf5_bytes(rng: random.Random, matlab: bool) -> bytes:
    import h5py

    out = io.BytesIO()
    libver = "latest" if rng.random() < 0.2 else "earliest"
    with h5py.File(out, "w", userblock_size=512 if matlab else 0, libver=libver) as file:
        for place, block in _blocks(rng).items():
            group = file.require_group(place) if place else file
            for key, value in block.items():
                if key not in group:
                    _put(rng, group, key, value, matlab)
        for _ in range(rng.choice((0, 0, 1, 2))):
            with suppress(ValueError, OSError, RuntimeError, TypeError, KeyError):  # there already
                _strange(rng, file, matlab)
    content = out.getvalue()
    return b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + content[128:] if matlab else content


def damaged_hdf5(rng: random.Random, content: bytes, matlab: bool = False) -> bytes:
    """A file made anew, or one damaged; where it is damaged most bytes are of headers."""
    if rng.random() < 0.5:
        content = _hdf5_bytes(rng, matlab)
        if rng.random() < 0.7:
            return content
    return damaged_bytes(rng, content, 3)


def damaged_mat73(rng: random.Random, content: bytes) -> bytes:
    """The same of MATLAB 7.3."""
    return damaged_hdf5(rng, content, matlab=True)


# ---- MATLAB 5


def _mat_bytes(rng: random.Random) -> bytes:
    from scipy.io import savemat

    variables: Block = {}
    for place, block in _blocks(rng).items():
        cells = {
            key[:31]: np.array(value, dtype=object)[:, None] if isinstance(value, list) else value
            for key, value in block.items()
        }
        variables |= {place[:31].replace(" ", "_"): cells} if place else cells
    match rng.randrange(12):
        case 0:
            variables["deep"] = {"a": {"b": {"c": 1.0}}}
        case 1:
            variables["cells"] = np.array([1.0, "a", np.zeros(3)], dtype=object)
        case 2:
            variables["s"] = np.array([(1.0, "a"), (2.0, "b")], dtype=[("frf", object), ("unit", object)])
    out = io.BytesIO()
    savemat(out, variables, do_compression=rng.random() < 0.3, oned_as=rng.choice(("row", "column")))
    return out.getvalue()


def _packed_damaged(rng: random.Random, content: bytes) -> bytes:
    """Compressed elements unpacked, damaged and packed again."""
    out, at = content[:128], 128
    while at + 8 <= len(content):
        kind, size = struct.unpack("<II", content[at : at + 8])
        body = content[at + 8 : at + 8 + size]
        if kind != 15:
            return content
        try:
            body = zlib.compress(damaged_bytes(rng, zlib.decompress(body), 2))
        except zlib.error:
            return content
        out += struct.pack("<II", 15, len(body)) + body
        at += 8 + size
    return out


def damaged_mat(rng: random.Random, content: bytes) -> bytes:
    """A file made anew, or one damaged, also within what is compressed."""
    if rng.random() < 0.5:
        try:
            content = _mat_bytes(rng)
        except (ValueError, TypeError):  # what cannot be written so
            return damaged_bytes(rng, content)
        if rng.random() < 0.6:
            return content
    content = _packed_damaged(rng, content)
    if rng.random() < 0.5 and len(content) > 140:
        at = 128 + 4 * rng.randrange((len(content) - 128) // 4)
        value = rng.choice((0, 1, 2, 5, 6, 7, 8, 9, 14, 15, 2**31 - 1, 2**32 - 1, len(content)))
        return content[:at] + struct.pack("<I", value) + content[at + 4 :]
    return damaged_bytes(rng, content, 3)
