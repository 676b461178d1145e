"""Broken files of arrays are one helpful line each, and what has two readings is never read in one of them unsaid."""

import re

import numpy as np
import pytest
import scipy.sparse

from tests.vibrecords.array_trees import WRITERS
from tests.vibrecords.reading import refusal, require
from tests.vibrecords.test_array_layouts import C, F, H, T, V, X, frf, history
from vibrecords.formats import iter_records

HUGE = scipy.sparse.csc_matrix(([1.0], ([0], [0])), (9**6, 9**6))
#: Name: tree, place, and what was found there.
BROKEN = {
    "four dimensions": ({"H": H.reshape(8, 3, 1, 1, 1)[:, :, :, :, [0, 0]], "f": F}, "variable 'H'", "shape (8, 3, 1,"),
    "too many to list": ({f"q{i}": F + i for i in range(30)}, "content", "and 22 more"),
    "a huge sparse matrix": ({"f": F, "frf": HUGE}, "variable 'frf'", "a sparse matrix, too large to be"),
    "rates of each": ({"fs": np.array([1.0, 2.0]), "force": X[:, 0]}, "variable 'fs'", "no one number"),
    "three dimensions of time": ({"fs": 256.0, "force": np.zeros((4, 3, 2))}, "variable 'force'", "shape (4, 3, 2)"),
    "hits without sense": ({"fs": 256.0, "samples": X, "hits": np.array([0.5, 1.0])}, "variable 'hits'", "[0.5, 1.0]"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_are_one_helpful_line(tmp_path, name):
    tree, where, found = BROKEN[name]
    message = refusal(tmp_path / "a", tree, re.escape(found))
    assert message.startswith(f"{tmp_path / 'a'}: {where}: found ")


SQUARE = H[:3, :] + np.eye(3)
PHASES = {"f": F, "mag": 20 * np.log10(np.abs(V)) - 50, "phase": np.degrees(np.angle(V))}
IN_TWO = {"p": {"q": V.real, "lines": F}, "r": {"q": V.imag}}
#: What may be read in two ways, or is not known: a layout that decides other than the advice does, and what is read.
DECIDED = {
    "w is Hz": ({"H": V, "w": F}, {"frequency_hz": "w"}, {}),
    "a square matrix": ({"H": SQUARE, "f": F[:3]}, {"frf": "H(2,:)"}, {"values": SQUARE[1], "lines": F[:3]}),
    "decibels or a real part": (PHASES, {"magnitude_db": "mag", "phase_deg": "phase"}, {"values": V * 10**-2.5}),
    "a real part alone": ({"H": V.real, "f": F}, {"real": "H"}, {"values": V.real + 0j}),
    "two axes of one length": ({"H": V, "f": F, "freq": 2 * F}, {"frequency_hz": "freq"}, {"lines": 2 * F}),
    "estimators or channels": ({"H1": V, "H2": H[:, 1], "f": F}, {"frf": "H2"}, {"values": H[:, 1]}),
    "a step without a first line": ({"H": V, "df": 0.5}, {"f_start_hz": "10"}, {}),
    "parts in two structs": (IN_TWO, {"real": "p.q", "imaginary": "r.q", "frequency_hz": "lines"}, {}),
    "two clocks": ({"fs": 512.0, "t": T, "x": X[:, 0]}, {"sample_rate_hz": "fs"}, history("x", X[:, 0], 512.0)),
    "two time axes": ({"t": T, "time2": 2 * T, "y": X[:, 0]}, {"time": "time2"}, history("y", X[:, 0], 128.0)),
    "a square of samples": (
        {"t": T[:3], "x": SQUARE.real}, {"time": "t", "response": "x(:,1)"}, history("response", SQUARE[:, 0].real)),
    "read, a spectrum": ({"FFT_tip": V, "f": F}, {"frf": "FFT_tip"}, {}),
    "read, one of several structs": (
        {"run": [{"H": V, "f": F}, {"H": H[:, 1], "f": F}]}, {"frf": "run(2).H"}, {"values": H[:, 1]}),
    "read, coherence under another name": (
        {"H": V, "f": F, "g2": C}, {"frf": "H", "coherence": "g2"}, {"coherence": C}),
}  # fmt: skip


@pytest.mark.parametrize("name", DECIDED)
@pytest.mark.parametrize("form", ["mat", "mat73"])
def test_two_readings_are_refused_and_a_layout_decides(tmp_path, name, form):
    tree, layout, expected = DECIDED[name]
    WRITERS[form](tree, tmp_path / "a")
    if not name.startswith("read"):
        refusal(tmp_path / "a", None)
    expected = expected if "channel" in expected else frf("output 1", "input 1", **expected)
    require(list(iter_records(tmp_path / "a", layout)), [expected])


@pytest.mark.parametrize(("layout", "expected"), [
    ({"frf": "HH"}, "[data.layout] frf: found no variable 'HH'; expected one of 'freq', 'run.H', 'run.f'"),
    ({"frf": "run.HH"}, "did you mean 'run.H'?"),
    ({"frf": "H(:,9)"}, "expected a column or row of it, or several as 2:4, counted from 1; correct the number"),
    ({"axis": "time"}, "[data.layout]: found 'axis' for a file of arrays; expected one of frequency_hz"),
    ({"f_start_hz": "ten", "f_step_hz": "1"}, "f_start_hz: found no variable 'ten'"),
    ({"frf": "freq"}, "variable 'freq': found real numbers"),
])  # fmt: skip
def test_layouts_that_do_not_fit_are_told(tmp_path, layout, expected):
    assert expected in refusal(tmp_path / "a", {"run": {"H": H, "f": F}, "freq": F}, layout=layout)


def test_a_layout_of_another_format_is_refused(tmp_path):
    said = r"found \[data.layout\] for a file of format uff; expected it for"
    refusal(tmp_path / "a", "    -1\n   151\nmodel\n    -1\n", said, {"frf": "H"})
