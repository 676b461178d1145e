"""Broken files of arrays are one helpful line each, and what has two readings is never read in one of them unsaid."""

import re

import numpy as np
import pytest
import scipy.sparse

from tests.vibrecords.array_trees import WRITERS
from tests.vibrecords.reading import refusal, require
from tests.vibrecords.test_array_layouts import (
    POLYTEC,
    SIGNAL_CALC,
    C,
    F,
    H,
    T,
    V,
    X,
    frf,
    history,
    siemens,
    signal,
)
from vibrecords.formats import iter_records

PAIR = {"mag": np.abs(V), "phase_deg": np.degrees(np.angle(V))}


def x_values(**changes):
    """A struct of Test.Lab whose axis is damaged; None takes a key away."""
    struct = siemens()
    axis = struct["x_values"] | changes
    return {"FRF": struct | {"x_values": {key: value for key, value in axis.items() if value is not None}}}


def y_values(**values):
    return {"FRF": siemens() | {"y_values": values}}


UNEVEN = {"S": signal() | {"x_values": {"values": T**2, "quantity": {"label": "s"}}}}
HUGE = scipy.sparse.csc_matrix(([1.0], ([0], [0])), (9**6, 9**6))
#: Name: tree, place, and what was found there.
BROKEN = {
    "no frequency": ({"H": V}, "variable 'H'", "no frequency lines with it"),
    "frequency of another name": ({"H": V, "lines": F}, "variable 'H'", "no frequency lines with it"),
    "frequency in a struct": ({"run": {"H": V, "abc": F}}, "variable 'run.H'", "no frequency lines with it"),
    "frequency of another length": ({"H": V, "f": F[:5]}, "variable 'H'", "shape (1, 8)"),
    "frequency complex": ({"H": V, "freq": F + 1j}, "variable 'freq'", "complex numbers"),
    "frequency in furlongs": ({"H": V, "freq": F, "freq_unit": "furlong"}, "variable 'freq'", "the unit 'furlong'"),
    "step without a first line": ({"H": V, "df": 0.5}, "variable 'H'", "a step of 0.5 Hz and no first"),
    "four dimensions": ({"H": H.reshape(8, 3, 1, 1, 1)[:, :, :, :, [0, 0]], "f": F}, "variable 'H'", "shape (8, 3, 1,"),
    "real FRF": ({"H": V.real, "f": F}, "variable 'H'", "real numbers, which may be the"),
    "real FRF in a struct": ({"a": {"FRF": V.real, "f": F}}, "variable 'a.FRF'", "real numbers, which may be the"),
    "phase of another shape": (PAIR | {"f": F, "phase_deg": F[:5]}, "variable 'phase_deg'", "shape (1, 5)"),
    "imaginary of another shape": ({"f": F, "real": F, "imag": F[:5]}, "variable 'imag'", "shape (1, 5)"),
    "phase without unit": ({"f": F, "mag": np.abs(V), "phase": np.angle(V)}, "variable 'phase'", "a phase that may be"),
    "negative magnitude": ({"f": F, "mag": -np.abs(V), "phase_deg": F}, "variable 'mag'", "negative numbers, which"),
    "magnitude alone": ({"f": F, "mag": np.abs(V)}, "content", "'f' (1 x 8 real), 'mag' (1 x 8"),
    "imaginary alone": ({"f": F, "imag": V.imag}, "content", "'f' (1 x 8 real), 'imag' (1 x 8"),
    "coherence of another shape": ({"f": F, "H": H, "coh": C}, "variable 'coh'", "shape (8, 1, 1)"),
    "coherence without lines": ({"coh": C, "q": F}, "content", "'coh' (1 x 8 real), 'q' (1 x 8"),
    "labels too few": ({"f": F, "H": H, "outputs": np.array(["a", "b"])}, "variable 'outputs'", "2 labels, 2"),
    "quantity in words": ({"f": F, "H": V, "quantity": "stiffness"}, "variable 'quantity'", "'stiffness'"),
    "averages of none": ({"f": F, "H": V, "averages": 0.0}, "variable 'averages'", "[0.0]"),
    "cells of two sizes": ({"f": F, "frf": [V, V[:5]]}, "variable 'frf'", "a struct or unlike cells"),
    "cells of text": ({"f": F, "frf": ["a", "b"]}, "variable 'frf'", "text"),
    "nothing known": ({"abc": V, "q": F}, "content", "'abc' (1 x 8 complex), 'q' (1 x 8"),
    "a misspelt name": ({"frequncy": F, "cohrence": C}, "content", "'frequncy' (1 x 8 real),"),
    "nothing known in structs": ({"a": {"b": {"zz": V}}}, "content", "'a.b.zz' (1 x 8 complex)"),
    "too many to list": ({f"q{i}": F + i for i in range(30)}, "content", "and 22 more"),
    "texts alone": ({"note": "steel", "who": "me"}, "content", "texts alone"),
    "scalars alone": ({"E": 210e9, "rho": 7850.0}, "content", "'E' (1 x 1 real), 'rho' (1 x 1"),
    "a huge sparse matrix": ({"f": F, "frf": HUGE}, "variable 'frf'", "a sparse matrix, too large to be"),
    "time unevenly": ({"t": T**2, "x": X[:, 0]}, "variable 't'", "instants that are not evenly"),
    "time backwards": ({"t": T[::-1], "x": X[:, 0]}, "variable 't'", "instants that are not evenly"),
    "time of one value": ({"t": T[:1], "x": X[:1, 0], "y": X[:, 0]}, "content", "'y' (1 x 12 real), 't' (1 x 1"),
    "time of another length": ({"t": T[:5], "force": X[:, 0]}, "variable 't'", "5 instants"),
    "no sampling rate": ({"force": X[:, 0]}, "variable 'force'", "no sampling rate"),
    "rate of zero": ({"fs": 0.0, "x": X[:, 0]}, "variable 'fs'", "0"),
    "rate negative": ({"fs": -256.0, "force": X[:, 0]}, "variable 'fs'", "-256"),
    "rate nan": ({"fs": np.nan, "force": X[:, 0]}, "variable 'fs'", "nan"),
    "rates of each": ({"fs": np.array([1.0, 2.0]), "force": X[:, 0]}, "variable 'fs'", "no one number"),
    "three dimensions of time": ({"fs": 256.0, "force": np.zeros((4, 3, 2))}, "variable 'force'", "shape (4, 3, 2)"),
    "instants in minutes": ({"t": T, "t_unit": "min", "x": X[:, 0]}, "variable 't'", "the unit 'min'"),
    "hits without sense": ({"fs": 256.0, "samples": X, "hits": np.array([0.5, 1.0])}, "variable 'hits'", "[0.5, 1.0]"),
    "channels too few": ({"fs": 256.0, "samples": X, "channels": "a"}, "variable 'samples'", "2 columns"),
    "test.lab without increment": (x_values(increment=None), "variable 'FRF.x_values.increment'", "steps of None from"),
    "test.lab without start": (x_values(start_value=None), "variable 'FRF.x_values.increment'", "steps of 0.5 from"),
    "test.lab step of zero": (x_values(increment=0.0), "variable 'FRF.x_values.increment'", "steps of 0.0 from 10.0"),
    "test.lab step of nan": (x_values(increment=np.nan), "variable 'FRF.x_values.increment'", "steps of nan from 10.0"),
    "test.lab fewer values": (x_values(number_of_values=9.0), "variable 'FRF.y_values.values'", "8 values"),
    "test.lab uneven lines of another count": (x_values(values=F[:5]), "variable 'FRF.y_values.values'", "8 values"),
    "test.lab without values": (y_values(quantity={"label": "g"}), "variable 'FRF.y_values.values'", "a struct"),
    "test.lab text for values": (y_values(values="many"), "variable 'FRF.y_values.values'", "text"),
    "test.lab cells for values": (y_values(values=[V, V[:3]]), "variable 'FRF.y_values.values'", "a struct"),
    "test.lab axis in rpm squared": ({"FRF": siemens(x_unit="rpm^2")}, "variable 'FRF.y_values.values'", "the unit"),
    "test.lab axis without unit": ({"A": siemens(kind="Function", x_unit="")}, "variable 'A.y_values.values'", "the"),
    "test.lab real FRF": ({"FRF": siemens(np.abs(V))}, "variable 'FRF.y_values.values'", "real numbers, which may be"),
    "test.lab uneven time": (UNEVEN, "variable 'S.y_values.values'", "instants that are not evenly"),
    "polytec of another count": ({"x": F[:5], "y": H.T, "usd": POLYTEC}, "variable 'y'", "shape (3, 8)"),
    "polytec magnitude": ({"x": F, "y": np.abs(H.T), "usd": POLYTEC}, "variable 'y'", "real numbers, which may be the"),
    "polytec without unit": ({"x": F, "y": H.T, "usd": {"Name": "a"}}, "variable 'y'", "the unit '' of an axis of"),
    "signalcalc without lines": ({"Hf_chan_2": V}, "variable 'Hf_chan_2'", "no frequency lines with it"),
    "signalcalc cut": (SIGNAL_CALC | {"Hf_chan_2": V[:5]}, "variable 'Hf_chan_2'", "shape (1, 5)"),
    "signalcalc without instants": ({"Time_chan_1": X[:, 0]}, "content", "'Time_chan_1' (1 x 12 real)"),
    "dewesoft without rate": ({"Data1_AI_1": X[:, 0]}, "content", "'Data1_AI_1' (1 x 12 real)"),
    "dewesoft of two clocks":
        ({"Sample_rate": 9.0, "Data1_AI_1": X[:, 0], "Data1_time_AI_1": T}, "variable 'Data1_time_AI_1'", "sampling"),
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
