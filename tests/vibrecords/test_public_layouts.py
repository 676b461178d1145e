"""Layouts of which users of other readers reported that they cannot be read, and modes under many names.

Each is rebuilt here from the report with numbers of our own; its name says where it was reported.
"""

import re

import numpy as np
import pytest

from tests.vibrecords import made_files
from tests.vibrecords.made_files import binary_58, clock, function_58, mode_55
from tests.vibrecords.reading import records_of, require
from vibrecords.records import FrfRecord, ModeRecord, TimeRecord

RNG = np.random.default_rng(22)
G, RATE = 9.80665, 1024.0
LINES = np.array([5.0, 50.35, 100.0])
FRF = RNG.normal(size=3) + 1j * RNG.normal(size=3)
SHORT = RNG.normal(size=13)
TIME = np.arange(200) / RATE
FORCE, TIP = RNG.normal(size=(2, 200))
FREQUENCIES, RATIOS, SHAPES = np.array([41.0, 117.0, 260.0]), np.array([0.01, 0.004, 0.02]), RNG.normal(size=(4, 3))
MODES = (FREQUENCIES, RATIOS, SHAPES)


def history(channel, values, rate=RATE):
    return {"type": TimeRecord, "channel": channel, "values": values, "sample_rate_hz": rate}


_AXES = {"kinds": ("time", "acceleration", "none"), "units": ("s", "m/s2", "NONE"), "function": 1, "first": 0.0}
_MPS = {"ids": ("MPS set1 Dof1", "NONE", "08-Oct-24 10:27:07", "NONE", "NONE"), "response": ("1+Z", 1, 3)}
_MPS |= {"reference": ("NONE", 0, 0), "step": 1 / RATE, **_AXES}


def _pairs_filled_with_zeros() -> str:
    ids, ends = ("Demo", "demo.unv", "16-May-2019 14:00:01", "SINE(X)", "NONE"), {"response": ("de0", 0, 2)}
    axes = {"kinds": ("frequency", "acceleration", "none"), "units": ("Hz", "m/s^2", "NONE")}
    text = function_58(FRF, LINES, single=True, reference=("NONE", 0, 0), ids=ids, **ends, **axes)
    return re.sub(r"E([+-])", r"e\1", text).replace("\n    -1\n", f"{0.0:13.5e}" * 3 + "\n    -1\n")


def _blanks_and_long_exponents() -> bytes:
    ids = ("1x : m/s²", "UFF58 file created by HBM catman", "30-Apr-20 19:12:52", "NONE", "NONE")
    lines = function_58(SHORT, single=True, ids=ids, **_AXES).replace("m/s2 ", "m/s² ").split("\n")
    lines[7] = "    1         0    0         0 NONE               0   0 NONE               0   0"
    lines[8] = "         2        13         1 0.00000E+000 5.00000E-005 0.00000E+000"
    return "\n".join(line if line == lines[8] else f"{line:<80}" for line in lines).encode("latin-1")


def _uneven_real_double(width: int) -> str:
    """Time in 13 or 20 columns and values in 20, of which a row holds two pairs, the last one."""
    ids = ("v2;227935", "RML-03", "21-06-03T03:21:06Z", "227935", "force;N")
    axes = _AXES | {"kinds": ("time", "force", "none"), "units": ("s", "N", "NONE"), "x_width": width}
    return function_58(SHORT, np.arange(13) / 1000, ids=ids, response=("AP", 0, 0), reference=("NONE", 0, 0), **axes)


def _name_too_long() -> str:
    """A name of eleven characters, which moves all that follows it by one column."""
    ids = ("", "Runn_xxx", "25/03/19", "Sine; 1 g", "PF-I-0301y+ [g]")
    axes = {"kinds": ("frequency", "acceleration", "none"), "units": ("Hz", "g", "NONE")}
    lines = function_58(FRF / G, LINES, ids=ids, **axes).split("\n")
    lines[7] = "    4        25    1         0 PF-I-0301y+         0   0       NONE         0   0"
    return "\n".join(lines)


def _mode(number: int) -> str:
    """A mode between texts of a swept sine, without a blank between its numbers; complex, three to a node."""
    frequency, damping, shape = MODES[0][number], MODES[1][number], MODES[2][:, number]
    ids = ("TESTTEST:Cfg=0:C1:trans:111121", "SWP:FS=  10.00:FE= 20.00:F=0.1111:None:None:NONE:M")
    ids += ("POMA:PF=2.55e-05:NM=  5:GF=  4.8612", "FR=8.9999:d=0.1111", "NONE")
    root = 2 * np.pi * frequency * np.array([-damping, np.sqrt(1 - damping**2)])
    told = {"analysis": 3, "per_node": 6, "counts": (2, 6, 0, number + 1), "ids": ids}
    nodes = {node: [value, *[0j] * 5] for node, value in enumerate(shape, start=1)}
    return mode_55(nodes, (*root, 1.0, 0.0, 1.0, 0.0), **told)


def _empty_fields() -> str:
    counts = np.array([200, 200, 0, 0, 0, 0, 200])
    header = {"Notes": ["X values guaranteed valid only for Dev0/Ai0"]}
    header |= made_files.head([""] * 7, counts, step=np.where(counts > 0, 1 / RATE, 1.0))
    header |= {"Date": ["2016/08/11"] * 7, "Time": ["15:37:48.375"] * 7}
    names = ["Dev0/Ai0", "Dev0/Ai2", "Untitled", "Untitled 1", "Untitled 2", "Untitled 3", "Dev0/Ai0 1"]
    return made_files.lvm(names, [TIME, FORCE, TIP, [], [], [], [], FORCE], header)


def _multi_columns(*, stated: bool) -> str:
    header = made_files.head(["N", "g"], 51200, step=1 / RATE)
    columns = [TIME, FORCE, TIME, TIP / G]
    return made_files.lvm(["hammer", "tip"], columns, header, layout="Multi", stated=stated)


def _commas() -> str:
    header = made_files.head(["N", "m/s^2"], 200, step=1 / RATE)
    return made_files.lvm(["hammer", "tip"], [TIME, FORCE, TIP], header, separator="Comma")


def _scaled(*slopes: float) -> bytes:
    """Whole numbers with the scales of their channel in its properties, one on the other."""
    told = clock("N", 1 / RATE) | {"NI_Number_Of_Scales": np.uint32(len(slopes))}
    for i, slope in enumerate(slopes):
        told |= {f"NI_Scale[{i}]_Scale_Type": "Linear", f"NI_Scale[{i}]_Linear_Slope": slope}
        told |= {f"NI_Scale[{i}]_Linear_Y_Intercept": 0.0}
        told |= {f"NI_Scale[{i}]_Linear_Input_Source": np.uint32(i - 1)} if i else {}
    return made_files.tdms({"a": [("hammer", np.round(1000 * FORCE).astype(np.int16), told)]})


ROUNDED = np.round(1000 * FORCE) / 1000
_AT_1 = [history("1+Z:1:Z+", TIP)]
_SEEN = [history("hammer", FORCE), history("tip", TIP)]
_UNEVEN = [history("AP:0:S", SHORT, 1000.0)]
_OPEN = {"type": FrfRecord, "frequency_hz": LINES, "factor": None}
_MODES = [{"type": ModeRecord, "number": i + 1, "frequency_hz": FREQUENCIES[i], "damping_ratio": RATIOS[i]}
          for i in range(3)]  # fmt: skip
_NAMES = {"Frequency_Hz": FREQUENCIES, "DampingRatio": RATIOS, "Phi": SHAPES}
LAYOUTS = {
    "pyuff 22": (_pairs_filled_with_zeros(), [_OPEN | {"values": FRF}]),
    "pyuff 29": (_blanks_and_long_exponents(), [history("0:S", SHORT, 20000.0)]),
    "pyuff 21": (_name_too_long(), [_OPEN | {"values": FRF / G}]),
    "pyuff 38": (binary_58(TIP, tail=b"\n", **_MPS), _AT_1),
    "pyuff 61": (binary_58(TIP, single=True, **_MPS), _AT_1),
    "pyuff 88": (binary_58(TIP, newline="\r\n", tail=b"\r\n", **_MPS), _AT_1),
    "pyuff 52": (_uneven_real_double(20), _UNEVEN),
    "pyuff 107": (_uneven_real_double(13), _UNEVEN),
    "pyuff 84, sdynpy 13": ("".join(map(_mode, range(3))), _MODES),
    "lvm_read 4 and 5": (_empty_fields(), [history("Dev0/Ai0", FORCE), history("Dev0/Ai2", TIP),
                                           history("Dev0/Ai0 1", FORCE)]),
    "lvm_read 10": (_multi_columns(stated=True), _SEEN),
    "lvm_read, no decimal sign": (_multi_columns(stated=False), _SEEN),
    "lvm_read 14": (_commas(), _SEEN),
    "npTDMS 64": (_scaled(0.001), [history("hammer", ROUNDED)]),
    "npTDMS 120": (_scaled(0.001, 2.0), [history("hammer", 2 * ROUNDED)]),
    "TDMS, a slow group": (made_files.tdms({
        "fast": [("hammer", FORCE, clock("N", 1 / RATE)), ("tip", TIP, clock("m/s^2", 1 / RATE))],
        "slow": [("temperature", SHORT, clock("degC", 0.5))]}), [*_SEEN, history("temperature", SHORT, 2.0)]),
    "five temperatures": ({"fs": RATE, "hammer": FORCE, "tip": TIP, "temperature": SHORT[:5]}, _SEEN),
    "two clocks, t1 and t2": ({"t1": TIME, "hammer": FORCE, "tip": TIP, "t2": TIME[:5] * 64, "slow": SHORT[:5]},
                              [*_SEEN, history("slow", SHORT[:5], RATE / 64)]),
    "modes of Frequency_Hz, Damping_percent": (
        {"Frequency_Hz": FREQUENCIES, "Damping_percent": 100 * RATIOS, "Phi": SHAPES}, _MODES),
    "modes in a struct": ({"Modes": _NAMES}, _MODES),
    "modes of natural frequencies": (
        {"NaturalFrequencies": FREQUENCIES, "DampingRatios": RATIOS, "ModeShapes": SHAPES}, _MODES),
    "modes of fn, zeta, phi": ({"fn": FREQUENCIES, "zeta": RATIOS, "phi": SHAPES}, _MODES),
    "modes of freq, damping_ratios": ({"freq": FREQUENCIES, "damping_ratios": RATIOS, "Phi": SHAPES}, _MODES),
    "modes, each a struct": ({"Mode": [dict(zip(_NAMES, each, strict=True)) for each in zip(*MODES[:2], SHAPES.T,
                                                                                         strict=True)]},
                             [mode | {"number": 1} for mode in _MODES]),
}  # fmt: skip


@pytest.mark.parametrize("name", LAYOUTS)
def test_what_others_could_not_read_is_read(tmp_path, name):
    content, expected = LAYOUTS[name]
    records = records_of(tmp_path / "file", content)
    require(records, expected, rtol=1e-4)
    for record, shape in zip(records, SHAPES.T, strict=False):
        if isinstance(record, ModeRecord):
            np.testing.assert_allclose([x for x in record.shape.values() if x], shape, rtol=1e-4)
