"""Broken files of arrays are one helpful line each, and what has two readings is never read in one of them unsaid."""

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


#: Name: tree and what the one line must say: the place, what was found, what to do.
BROKEN = {
    "no frequency": ({"H": V}, "variable 'H': found no frequency lines with it; expected a variable 'frequency_hz'"),
    "frequency of another name": ({"H": V, "lines": F}, "expected a variable .*; write frequency_hz = \"lines\" in"),
    "frequency in a struct":
        ({"run": {"H": V, "abc": F}}, "variable 'run.H': .*; write frequency_hz = \"run.abc\""),
    "frequency of another length":
        ({"H": V, "f": F[:5]}, r"variable 'H': found shape .*with 5 lines; correct the array"),
    "frequency complex": ({"H": V, "freq": F + 1j}, "variable 'freq': found complex numbers; expected real numbers"),
    "frequency in furlongs": ({"H": V, "freq": F, "freq_unit": "furlong"}, "variable 'freq': found the unit 'furlong'"),
    "step without a first line": ({"H": V, "df": 0.5}, 'a step of 0.5 Hz and no first line, .*write f_start_hz = "0"'),
    "four dimensions":
        ({"H": H.reshape(8, 3, 1, 1, 1)[:, :, :, :, [0, 0]], "f": F}, r"found shape .*expected \(lines, out"),
    "real FRF": ({"H": V.real, "f": F}, "'H': found real numbers, .*export the other part as well, or write"),
    "real FRF in a struct": ({"a": {"FRF": V.real, "f": F}}, "variable 'a.FRF': found real numbers"),
    "phase of another shape": (PAIR | {"f": F, "phase_deg": F[:5]}, "variable 'phase_deg': found shape .*as 'mag'"),
    "imaginary of another shape": ({"f": F, "real": F, "imag": F[:5]}, "variable 'imag': found shape .*as 'real'"),
    "phase without unit":
        ({"f": F, "mag": np.abs(V), "phase": np.angle(V)}, 'phase_rad = "phase" or phase_deg = "phase" in .*alone'),
    "negative magnitude":
        ({"f": F, "mag": -np.abs(V), "phase_deg": F}, 'negative .*magnitude_db = "mag", phase_deg = "phase_deg"'),
    "magnitude alone": ({"f": F, "mag": np.abs(V)}, "'mag' .*magnitude: the other part is missing"),
    "imaginary alone": ({"f": F, "imag": V.imag}, "'imag' .*imaginary: the other part is missing"),
    "coherence of another shape": ({"f": F, "H": H, "coh": C}, "variable 'coh': found shape .*as the FRFs; store one"),
    "coherence without lines": ({"coh": C, "q": F}, "found neither .*'coh' .*'q' .*write frequency_hz = \"q\" in"),
    "labels too few": ({"f": F, "H": H, "outputs": np.array(["a", "b"])}, "variable 'outputs': found 2 labels"),
    "quantity in words":
        ({"f": F, "H": V, "quantity": "stiffness"}, "variable 'quantity': found 'stiffness'; expected one of"),
    "averages of none": ({"f": F, "H": V, "averages": 0.0}, r"variable 'averages': found \[0.0\]; expected one whole"),
    "cells of two sizes":
        ({"f": F, "frf": [V, V[:5]]}, "variable 'frf': found a struct or unlike cells; expected complex"),
    "cells of text": ({"f": F, "frf": ["a", "b"]}, "variable 'frf': found text; expected complex numbers"),
    "nothing known": ({"abc": V, "q": F}, r"'abc' \(.*complex\), 'q' \(.*write frequency_hz = .q., frf = .abc. in"),
    "a misspelt name":
        ({"frequncy": F, "cohrence": C}, "'frequncy' .*'cohrence' .*write frequency_hz = .NAME., frf = .NAME. with"),
    "nothing known in structs": ({"a": {"b": {"zz": V}}}, r"'a.b.zz' \(.*complex\); expected arrays of known names"),
    "too many to list": ({f"q{i}": F + i for i in range(30)}, "'q0' .* and 22 more; expected arrays of known names"),
    "texts alone": ({"note": "steel", "who": "me"}, "found neither FRFs nor time histories in texts alone"),
    "scalars alone": ({"E": 210e9, "rho": 7850.0}, "'E' .*, 'rho' .*expected arrays of known names, such as"),
    "a huge sparse matrix":
        ({"f": F, "frf": scipy.sparse.csc_matrix(([1.0], ([0], [0])), (9**6, 9**6))}, "'frf': found a sparse"),
    "time unevenly": ({"t": T**2, "x": X[:, 0]}, "variable 't': found instants that are not evenly spaced"),
    "time backwards": ({"t": T[::-1], "x": X[:, 0]}, "variable 't': found instants that are not evenly spaced"),
    "time of one value": ({"t": T[:1], "x": X[:1, 0], "y": X[:, 0]}, "found neither .*'y'"),
    "time of another length":
        ({"t": T[:5], "force": X[:, 0]}, "variable 't': found 5 instants; expected 12, one for each"),
    "no sampling rate":
        ({"force": X[:, 0]}, "variable 'force': found no sampling rate; expected 'sample_rate_hz' or 'time'"),
    "rate of zero": ({"fs": 0.0, "x": X[:, 0]}, "variable 'fs': found 0; expected one number above 0"),
    "rate negative": ({"fs": -256.0, "force": X[:, 0]}, "variable 'fs': found -256; expected one number above 0"),
    "rate nan": ({"fs": np.nan, "force": X[:, 0]}, "variable 'fs': found nan; expected one number above 0"),
    "rates of each": ({"fs": np.array([1.0, 2.0]), "force": X[:, 0]}, "variable 'fs': found no one number"),
    "three dimensions of time":
        ({"fs": 256.0, "force": np.zeros((4, 3, 2))},
        r"variable 'force': found shape \(4, 3, 2\); expected \(samples, channels\)"),
    "instants in minutes":
        ({"t": T, "t_unit": "min", "x": X[:, 0]}, "variable 't': found the unit 'min'; expected s or ms"),
    "hits without sense":
        ({"fs": 256.0, "samples": X, "hits": np.array([0.5, 1.0])}, "variable 'hits': found .*whole numbers"),
    "channels too few": ({"fs": 256.0, "samples": X, "channels": "a"}, "found 2 columns; expected as many channels"),
    "test.lab without increment":
        (x_values(increment=None), "variable 'FRF.x_values.increment': found steps of None from 10"),
    "test.lab without start":
        (x_values(start_value=None), "found steps of 0.5 from None; expected 'start_value' and a step above 0"),
    "test.lab step of zero": (x_values(increment=0.0), "variable 'FRF.x_values.increment': found steps of 0.0 from 10"),
    "test.lab step of nan": (x_values(increment=np.nan), "FRF.x_values.increment': found steps of nan"),
    "test.lab fewer values":
        (x_values(number_of_values=9.0), r"FRF.y_values.values': found 8 values; expected 9, as on the axis"),
    "test.lab uneven lines of another count": (x_values(values=F[:5]), "found 8 values; expected 5, as on the axis"),
    "test.lab without values":
        ({"FRF": siemens() | {"y_values": {"quantity": {"label": "g"}}}}, "FRF.y_values.values': found"),
    "test.lab text for values":
        ({"FRF": siemens() | {"y_values": {"values": "many"}}}, "FRF.y_values.values': found text"),
    "test.lab cells for values":
        ({"FRF": siemens() | {"y_values": {"values": [V, V[:3]]}}}, "FRF.y_values.values': found a struct or"),
    "test.lab axis in rpm squared":
        ({"FRF": siemens(x_unit="rpm^2")}, "variable 'FRF.y_values.values': found the unit 'rpm.2' of an axis"),
    "test.lab axis without unit":
        ({"A": siemens(kind="Function", x_unit="")},
        "variable 'A.y_values.values': found the unit '' of an axis of time or"),
    "test.lab real FRF":
        ({"FRF": siemens(np.abs(V))}, "variable 'FRF.y_values.values': found real numbers, which may be the"),
    "test.lab uneven time":
        ({"S": signal() | {"x_values": {"values": T**2, "quantity": {"label": "s"}}}},
        "variable 'S.y_values.values': found instants that are not evenly spaced"),
    "polytec of another count":
        ({"x": F[:5], "y": H.T, "usd": POLYTEC}, "variable 'y': found shape .*rows of 5 values"),
    "polytec magnitude": ({"x": F, "y": np.abs(H.T), "usd": POLYTEC}, "variable 'y': found real numbers, which may be"),
    "polytec without unit":
        ({"x": F, "y": H.T, "usd": {"Name": "a"}}, "found the unit '' of an axis of time or"),
    "signalcalc without lines": ({"Hf_chan_2": V}, "variable 'Hf_chan_2': found no frequency lines"),
    "signalcalc cut": (SIGNAL_CALC | {"Hf_chan_2": V[:5]}, "variable 'Hf_chan_2': found shape .*with 8 lines"),
    "signalcalc without instants": ({"Time_chan_1": X[:, 0]}, r"found neither .*'Time_chan_1' \("),
    "dewesoft without rate": ({"Data1_AI_1": X[:, 0]}, r"found neither .*'Data1_AI_1' \("),
    "dewesoft of two clocks":
        ({"Sample_rate": 300.0, "Data1_AI_1": X[:, 0], "Data1_time_AI_1": T},
        "found sampling rates of 256 Hz and 300 Hz; .*write time = .* or sample_rate_hz = .300."),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_are_one_helpful_line(tmp_path, name):
    refusal(tmp_path / "a", *BROKEN[name])


SQUARE = H[:3, :] + np.eye(3)
#: What may be read in two ways: what the one line says of both, and a layout that decides, with what is read then.
HOSTILE = {
    "w in rad/s or Hz":
        ({"H": V, "w": F}, "variable 'w': found an axis that may be in rad/s or in Hz", {"omega_rad_s": "w"},
        [frf("output 1", "input 1", lines=F / 2 / np.pi)]),
    "w is Hz": ({"H": V, "w": F}, "rad/s or in Hz", {"frequency_hz": "w"}, [frf("output 1", "input 1")]),
    "a square matrix":
        ({"H": SQUARE, "f": F[:3]}, r'either axis can be that of the lines; .*write frf = "H\(:,1\)" or "H\(1,:\)"',
        {"frf": "H(2,:)"}, [frf("output 1", "input 1", SQUARE[1], F[:3])]),
    "phase in degrees or radians":
        ({"f": F, "mag": np.abs(V), "phase": np.angle(V)}, "may be in degrees or in radians",
        {"magnitude": "mag", "phase_rad": "phase"}, [frf("output 1", "input 1")]),
    "decibels or a real part":
        ({"f": F, "mag": 20 * np.log10(np.abs(V)) - 50, "phase": np.degrees(np.angle(V))},
        "may be decibels or the real part", {"magnitude_db": "mag", "phase_deg": "phase"},
        [frf("output 1", "input 1", V * 10**-2.5)]),
    "a real FRF":
        ({"H": np.abs(V), "p": np.angle(V), "f": F}, "real part of an FRF or its magnitude",
        {"magnitude": "H", "phase_rad": "p"}, [frf("output 1", "input 1")]),
    "a real part alone":
        ({"H": V.real, "f": F}, "real part of an FRF or its magnitude", {"real": "H"},
        [frf("output 1", "input 1", V.real + 0j)]),
    "two axes of one length":
        ({"H": V, "f": F, "freq": 2 * F}, "found two axes for it, 'f' and 'freq', which differ",
        {"frequency_hz": "freq"}, [frf("output 1", "input 1", lines=2 * F)]),
    "estimators or channels":
        ({"H1": V, "H2": H[:, 1], "f": F}, "H1 and H2, which may be estimates of one FRF or FRFs of several channels",
        {"frf": "H2"}, [frf("output 1", "input 1", H[:, 1])]),
    "a step without a first line":
        ({"H": V, "df": 0.5}, "no first line, which may be 0 or 0.5 Hz", {"f_start_hz": "10"},
        [frf("output 1", "input 1")]),
    "two clocks":
        ({"fs": 512.0, "t": T, "x": X[:, 0]}, "found sampling rates of 256 Hz and 512 Hz", {"time": "t"},
        [history("x", X[:, 0])]),
    "two clocks, the other one":
        ({"fs": 512.0, "t": T, "x": X[:, 0]}, "sampling rates of 256 Hz", {"sample_rate_hz": "fs"},
        [history("x", X[:, 0], 512.0)]),
    "a rate and an interval":
        ({"fs": 512.0, "dt": 1 / 256, "x": X[:, 0]}, "found sampling rates of 256 Hz and 512 Hz",
        {"sample_rate_hz": "256"}, [history("x", X[:, 0])]),
    "two time axes":
        ({"t": T, "time2": 2 * T, "y": X[:, 0]}, "found two axes for it, 't' and 'time2'", {"time": "time2"},
        [history("y", X[:, 0], 128.0)]),
    "a square of samples":
        ({"t": T[:3], "x": SQUARE.real}, "either axis can be that of the instants", {"time": "t", "response": "x(:,1)"},
        [history("response", SQUARE[:, 0].real)]),
    "a matrix of time and signals":
        ({"data": np.column_stack([T, X])}, "found neither FRFs nor time histories in 'data'",
        {"time": "data(:,1)", "force": "data(:,2)", "response": "data(:,3)"},
        [history("force", X[:, 0]), history("response", X[:, 1])]),
    "names that say nothing":
        ({"a": {"b": V, "c": F}}, "found neither FRFs nor time histories in", {"frf": "a.b", "frequency_hz": "a.c"},
        [frf("output 1", "input 1")]),
    "parts in two structs":
        ({"p": {"q": V.real, "lines": F}, "r": {"q": V.imag}}, "found neither",
        {"real": "p.q", "imaginary": "r.q", "frequency_hz": "lines"}, [frf("output 1", "input 1")]),
    "a spectrum or an FRF": ({"FFT_tip": V, "f": F}, None, {"frf": "FFT_tip"}, [frf("output 1", "input 1")]),
    "samples at a rate that is nowhere":
        ({"rec": X}, "found neither", {"samples": "rec", "sample_rate_hz": "256"},
        [history("channel 1", X[:, 0]), history("channel 2", X[:, 1])]),
    "one of several structs":
        ({"run": [{"H": V, "f": F}, {"H": H[:, 1], "f": F}]}, None, {"frf": "run(2).H"},
        [frf("output 1", "input 1", H[:, 1])]),
    "coherence under another name":
        ({"H": V, "f": F, "g2": C}, None, {"frf": "H", "coherence": "g2"}, [frf("output 1", "input 1", coherence=C)]),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("form", ["mat", "mat73"])
def test_two_readings_are_refused_and_a_layout_decides(tmp_path, name, form):
    tree, both, layout, expected = HOSTILE[name]
    WRITERS[form](tree, tmp_path / "a")
    if both is not None:
        refusal(tmp_path / "a", None, both)
    require(list(iter_records(tmp_path / "a", layout)), expected)


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
