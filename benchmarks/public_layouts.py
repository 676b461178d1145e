"""Layouts of which users of other readers reported that they cannot be read: `python -m benchmarks.public_layouts`.

Each is rebuilt here from the report with numbers of our own; its name says where it was reported.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from nptdms import ChannelObject, RootObject, TdmsWriter

from benchmarks.file_variants import FORCE, MODES, RATE, TIME, TIP, Variant, report, write_bytes

RNG = np.random.default_rng(22)
G = 9.80665
LINES = np.array([5.0, 50.35, 100.0])
FRF = RNG.normal(size=3) + 1j * RNG.normal(size=3)
SHORT = RNG.normal(size=13)


def _set_58(head: Sequence[str], rows: Sequence[str], first: str = "    58", end: str = "\n") -> str:
    return end.join(["    -1", first, *head, *rows, "    -1"]) + end


def _record(
    ordinate: int, count: int, even: int, step: float, *, abscissa: str, unit: str, form: str = ".5E"
) -> list[str]:
    """Records 7 to 11 of a data set 58 behind its record 6: type, count, spacing, and the axes."""
    none = f"{0:10d}    0    0    0 {'NONE':<20} {'NONE':<20}"
    steps = "".join(f"{x:13{form}}" for x in (0.0, step, 0.0))
    return [f"{ordinate:10d}{count:10d}{even:10d}{steps}", abscissa, unit, none, none]


_TIME_AXIS = f"{17:10d}    0    0    0 {'Time':<20} {'s':<20}"
_ACC_AXIS = f"{12:10d}    0    0    0 {'Acceleration':<20} {'m/s2':<20}"


def _pairs_filled_with_zeros() -> str:
    head = ["Demo", "demo.unv", "16-May-2019 14:00:01", "SINE(X)", "NONE"]
    head += [f"{4:5d}{0:10d}{0:5d}{0:10d} {'de0':<10}{0:10d}{2:4d} {'NONE':<10}{0:10d}{0:4d}"]
    axes = [f"{18:10d}    0    0    0 {'':<20} {'Hz':<20}", f"{12:10d}    0    0    0 {'':<20} {'m/s^2':<20}"]
    head += _record(5, 3, 0, 0.0, abscissa=axes[0], unit=axes[1], form=".5e")
    numbers = [x for f, z in zip(LINES, FRF, strict=True) for x in (f, z.real, z.imag)] + [0.0, 0.0, 0.0]
    return _set_58(head, ["".join(f"{x:13.5e}" for x in numbers[i : i + 6]) for i in (0, 6)])


def _blanks_and_long_exponents() -> bytes:
    head = ["1x : m/s²", "UFF58 file created by HBM catman", "30-Apr-20 19:12:52", "NONE", "NONE"]
    head += ["    1         0    0         0 NONE               0   0 NONE               0   0"]
    head += ["         2        13         1 0.00000E+000 5.00000E-005 0.00000E+000", _TIME_AXIS]
    head += [
        f"{1:10d}    0    0    0 {'1x':<20} {'m/s²':<20}",
        *[f"{0:10d}    0    0    0 {'NONE':<20} {'NONE':<20}"] * 2,
    ]
    rows = ["".join(f"{x:13.5E}" for x in SHORT[i : i + 6]) for i in (0, 6, 12)]
    lines = _set_58(head, rows).split("\n")
    return "\n".join(f"{line:<80}" if "E+0" not in line[:14] else line for line in lines).encode("latin-1")


def _binary(values: np.ndarray, letter: str, end: bytes, tail: bytes) -> bytes:
    body = values.astype(f"<{letter}").tobytes()
    head = ["MPS set1 Dof1", "NONE", "08-Oct-24 10:27:07", "NONE", "NONE"]
    head += [f"{1:5d}{0:10d}{0:5d}{0:10d} {'1+Z':<10}{1:10d}{3:4d} {'NONE':<10}{0:10d}{0:4d}"]
    head += _record({"f4": 2, "f8": 4}[letter], values.size, 1, 1 / RATE, abscissa=_TIME_AXIS, unit=_ACC_AXIS)
    first = f"    58b     1     2          11{len(body):12d}     0     0           0           0"
    return end.join(line.encode() for line in ["    -1", first, *head]) + end + body + tail + b"    -1" + end


def _uneven_real_double(width: int) -> str:
    """Time in 13 or 20 columns and values in 20, of which a row holds two pairs, the last one."""
    head = ["v2;227935", "RML-03", "21-06-03T03:21:06Z", "227935", "force;N"]
    head += [f"{1:5d}{0:10d}{0:5d}{0:10d} {'AP':<10}{0:10d}{0:4d} {'NONE':<10}{0:10d}{0:4d}"]
    unit = f"{13:10d}    0    0    0 {'Force':<20} {'N':<20}"
    head += _record(4, 13, 0, 0.0, abscissa=_TIME_AXIS, unit=unit)
    digits = {13: 5, 20: 11}[width]
    cells = [f"{t:{width}.{digits}E}{x:20.11E}" for t, x in zip(np.arange(13) / 1000, SHORT, strict=True)]
    return _set_58(head, ["".join(cells[i : i + 2]) for i in range(0, 13, 2)])


def _name_too_long() -> str:
    """A name of eleven characters, which moves all that follows it by one column."""
    head = ["", "Runn_xxx", "25/03/19", "Sine; 1 g", "PF-I-0301y+ [g]"]
    head += ["    4        25    1         0 PF-I-0301y+         0   0       NONE         0   0"]
    unit = f"{12:10d}    1    0    0 {'Acceleration':<20} {'g':<20}"
    head += _record(
        6, 3, 0, 0.0, abscissa=f"{18:10d}    0    0    0 {'Frequenz':<20} {'Hz':<20}", unit=unit, form=".4e"
    )
    return _set_58(head, [f"{f:13.5E}{z.real:20.11E}{z.imag:20.11E}" for f, z in zip(LINES, FRF / G, strict=True)])


def _mode(number: int) -> str:
    """A mode between texts of a swept sine, without a blank between its numbers; complex, three to a node."""
    frequency, damping, shape = MODES[0][number], MODES[1][number], MODES[2][:, number]
    lines = ["    -1", "    55", "TESTTEST:Cfg=0:C1:trans:111121", "SWP:FS=  10.00:FE= 20.00:F=0.1111:None:None:NONE:M"]
    lines += ["POMA:PF=2.55e-05:NM=  5:GF=  4.8612", "FR=8.9999:d=0.1111", "NONE"]
    lines += [f"{1:10d}{3:10d}{3:10d}{8:10d}{5:10d}{6:10d}", f"{2:10d}{6:10d}{0:10d}{number + 1:10d}"]
    root = 2 * np.pi * frequency * np.array([-damping, np.sqrt(1 - damping**2)])
    lines += ["".join(f"{x:13.5E}" for x in (*root, 1.0, 0.0, 1.0, 0.0))]
    for node, value in enumerate(shape, start=1):
        rows = np.array([value, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0])
        lines += [f"{node:10d}", *("".join(f"{x:13.5E}" for x in rows[i : i + 6]) for i in (0, 6))]
    return "\n".join([*lines, "    -1"]) + "\n"


def _labview(head: Mapping[str, Sequence[str]], names: Sequence[str], rows: Sequence[Sequence[str]], **how: str) -> str:
    sep = how.get("sep", "\t")
    first = [["LabVIEW Measurement"], ["Writer_Version", how.get("version", "2")], ["Reader_Version", "2"]]
    first += [
        ["Separator", {"\t": "Tab", ",": "Comma"}[sep]],
        *([["Decimal_Separator", "."]] if "version" not in how else []),
    ]
    first += [
        ["Multi_Headings", "No"],
        ["X_Columns", how.get("x", "One")],
        ["Time_Pref", "Absolute"],
        ["Operator", "user"],
    ]
    first += [["Date", "2016/08/11"], ["Time", "14:37:48.201"], ["***End_of_Header***"], [""]]
    lines = [*first, *([key, *cells] for key, cells in head.items()), ["***End_of_Header***"], names, *rows]
    return "\n".join(sep.join(line) for line in lines) + "\n"


def _empty_fields() -> str:
    n = 7
    counts = ["200", "200", "0", "0", "0", "0", "200"]
    head = {"Notes": ["X values guaranteed valid only for Dev0/Ai0"], "Channels": [str(n)], "Samples": counts}
    head |= {
        "Date": ["2016/08/11"] * n,
        "Time": ["15:37:48.375"] * n,
        "X_Dimension": ["Time"] * n,
        "X0": ["0.0E+0"] * n,
    }
    head |= {"Delta_X": [repr(1 / RATE) if c == "200" else "1.000000" for c in counts]}
    names = [
        "X_Value",
        "Dev0/Ai0",
        "Dev0/Ai2",
        "Untitled",
        "Untitled 1",
        "Untitled 2",
        "Untitled 3",
        "Dev0/Ai0 1",
        "Comment",
    ]
    rows = [
        [repr(t), repr(a), repr(b), "", "", "", "", repr(a)]
        for t, a, b in zip(*map(np.ndarray.tolist, (TIME, FORCE, TIP)), strict=True)
    ]
    return _labview(head, names, rows)


def _multi_columns(version: str | None) -> str:
    head = {"Channels": ["2", "", "", ""], "Samples": ["51200", "", "51200", ""], "Y_Unit_Label": ["N", "", "g", ""]}
    head |= {
        "X_Dimension": ["Time", "", "Time", ""],
        "X0": ["0.0", "", "0.0", ""],
        "Delta_X": [repr(1 / RATE), "", repr(1 / RATE), ""],
    }
    rows = [
        [repr(t), repr(a), repr(t), repr(b)]
        for t, a, b in zip(*map(np.ndarray.tolist, (TIME, FORCE, TIP / G)), strict=True)
    ]
    return (
        _labview(
            head,
            ["X_Value", "hammer", "X_Value", "tip", "Comment"],
            rows,
            x="Multi",
            **({"version": version} if version else {}),
        )
        + "\n"
    )


def _commas() -> str:
    n = 2
    head = {"Channels": [str(n)], "Samples": ["200"] * n, "Y_Unit_Label": ["N", "m/s^2"], "X_Dimension": ["Time"] * n}
    head |= {"X0": ["0.0"] * n, "Delta_X": [repr(1 / RATE)] * n}
    rows = [[repr(x) for x in row] for row in np.column_stack([TIME, FORCE, TIP]).tolist()]
    return _labview(head, ["X_Value", "hammer", "tip", "Comment"], rows, sep=",")


def _scaled(path, *, twice: bool) -> None:
    """Whole numbers with the scale of their channel in its properties, or with two of them one on the other."""
    scale = {
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": 0.001,
        "NI_Scale[0]_Linear_Y_Intercept": 0.0,
    }
    scale |= {"NI_Number_Of_Scales": np.uint32(1 + twice)}
    if twice:
        scale |= {
            "NI_Scale[1]_Scale_Type": "Linear",
            "NI_Scale[1]_Linear_Slope": 2.0,
            "NI_Scale[1]_Linear_Y_Intercept": 0.0,
        }
        scale |= {"NI_Scale[1]_Linear_Input_Source": np.uint32(0)}
    clock = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0, "unit_string": "N"}
    with TdmsWriter(str(path)) as writer:
        writer.write_segment(
            [
                RootObject(),
                ChannelObject("a", "hammer", np.round(1000 * FORCE).astype(np.int16), properties=clock | scale),
            ]
        )


SEEN = {"hammer": FORCE, "tip": TIP}
ROUNDED = np.round(1000 * FORCE) / 1000
_UNEVEN = {"histories": {"AP:0:S": SHORT}, "rates": {"AP:0:S": 1000.0}}
LAYOUTS = {
    "pyuff 22": Variant("UFF", write_bytes(_pairs_filled_with_zeros()), [FRF], lines=LINES, open_unit=True),
    "pyuff 29": Variant(
        "UFF", write_bytes(_blanks_and_long_exponents()), histories={"0:S": SHORT}, rates={"0:S": 20000.0}
    ),
    "pyuff 21": Variant("UFF", write_bytes(_name_too_long()), [FRF / G], lines=LINES, open_unit=True),
    "pyuff 38": Variant("UFF", write_bytes(_binary(TIP, "f8", b"\n", b"\n")), histories={"1+Z:1:Z+": TIP}),
    "pyuff 61": Variant("UFF", write_bytes(_binary(TIP, "f4", b"\n", b"")), histories={"1+Z:1:Z+": TIP}),
    "pyuff 88": Variant("UFF", write_bytes(_binary(TIP, "f8", b"\r\n", b"\r\n")), histories={"1+Z:1:Z+": TIP}),
    "pyuff 52": Variant("UFF", write_bytes(_uneven_real_double(20)), **_UNEVEN),
    "pyuff 107": Variant("UFF", write_bytes(_uneven_real_double(13)), **_UNEVEN),
    "pyuff 84, sdynpy 13": Variant("UFF", write_bytes("".join(map(_mode, range(3)))), modes=True),
    "lvm_read 4 and 5": Variant(
        "LVM", write_bytes(_empty_fields()), histories={"Dev0/Ai0": FORCE, "Dev0/Ai2": TIP, "Dev0/Ai0 1": FORCE}
    ),
    "lvm_read 10": Variant("LVM", write_bytes(_multi_columns(None)), histories=SEEN),
    "lvm_read, no decimal sign": Variant("LVM", write_bytes(_multi_columns("0.92")), histories=SEEN),
    "lvm_read 14": Variant("LVM", write_bytes(_commas()), histories=SEEN),
    "npTDMS 64": Variant("TDMS", lambda path: _scaled(path, twice=False), histories={"hammer": ROUNDED}),
    "npTDMS 120": Variant("TDMS", lambda path: _scaled(path, twice=True), histories={"hammer": 2 * ROUNDED}),
}  # fmt: skip

if __name__ == "__main__":
    report(LAYOUTS)
