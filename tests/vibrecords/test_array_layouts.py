"""Files of arrays as analysers and their users write them: channels, lines, units and values, in each of four formats.

Layouts and where they are described:

- Siemens (LMS) Test.Lab, export to MATLAB: structs with `x_values`, `y_values` and `function_record`; read by the
  scripts of published data sets, as of the rotating-machine data of Mendeley Data ztmf3m7h5x ("Data description").
- Data Physics SignalCalc, export to MATLAB: `Freq_domain`, `Hf_chan_2`, `Hf_coh_chan_2`, `PSD_chan_1`, `Time_chan_1`;
  the example data and docstrings of `vibration_toolbox` (`sdof_cf`: "TF = data['Hf_chan_2']").
- DEWESoft X, export to MATLAB: `Sample_rate`, `Data1_<channel>` and `Data1_time_<channel>`, the latter in days in some
  versions.
- Polytec file access for MATLAB, `GetPointData`: `[x, y, usd]`, points in rows of y; its help text.
- MATLAB itself: structs, cells, arrays of structs, sparse: "MAT-File Format" of The MathWorks; version 7.3 is HDF5.
- Names of users: `H`, `H1`, `FRF`, `Recep`, `Mob`, `f`, `Freq`, `frequencyBand`, `df` and `f_start`, `mag` and `phase`.
"""

import numpy as np
import pytest
import scipy.io
import scipy.sparse

from tests.vibrecords.array_trees import WITH_LISTS, WRITERS
from tests.vibrecords.reading import require
from vibrecords.formats import iter_records
from vibrecords.formats.array_files import read_arrays
from vibrecords.records import CoherenceRecord, FrfRecord, SpectrumRecord, TimeRecord

RNG = np.random.default_rng(22)
F = 10.0 + 0.5 * np.arange(8)
H = RNG.normal(size=(8, 3)) + 1j * RNG.normal(size=(8, 3))
V, C = H[:, 0], RNG.uniform(0.5, 0.99, 8)
T = np.arange(12) / 256
X = RNG.normal(size=(12, 2))
G = 9.80665


def column(values):
    return np.asarray(values)[:, None]


def displayed(unit):
    """A quantity of Test.Lab: values are stored in SI, times `factor` they are what the label says."""
    factor = {"g": 1 / G, "g/N": 1 / G, "g/V": 1 / G, "g^2/Hz": G**-2}.get(unit, 1.0)
    about = "Data saved by Test.Lab in MKS"
    return {"label": unit, "unit_transformation": {"factor": factor, "log_reference": 1.0}, "info": about}


def siemens(values=V, unit="g/N", kind="FRF", labels=("Tip:1:+Z", "Tip:2:+X"), x_unit="Hz", **x):
    """A struct of Test.Lab."""
    axis = {"start_value": 10.0, "increment": 0.5, "number_of_values": float(len(values))} | x
    about = {"name": f"{kind} {labels[0]}", "type": kind, "primary_channel": {"label": labels[0]}}
    if labels[1]:
        about["first_reference_channel"] = {"label": labels[1]}
    return {
        "x_values": axis | {"quantity": {"label": x_unit}},
        "y_values": {"values": np.reshape(values, (len(values), -1)), "quantity": displayed(unit)},
        "function_record": about,
    }


def signal(values=X, names=("3:Point1", "4:Point2"), unit="g", increment=1 / 256):
    """Time histories of several channels in one struct of Test.Lab."""
    return {
        "x_values": {"start_value": 0.0, "increment": increment, "number_of_values": 12.0, "quantity": {"label": "s"}},
        "y_values": {"values": values, "quantity": displayed(unit)},
        "function_record": {"name": list(names), "type": "Signal"},
    }


def frf(response, reference, values=V, lines=F, **more):
    return {
        "type": FrfRecord,
        "response": response,
        "reference": reference,
        "frequency_hz": lines,
        "values": values,
    } | more


def history(channel, values, rate=256.0, **more):
    return {"type": TimeRecord, "channel": channel, "values": values, "sample_rate_hz": rate} | more


NUMBERED = tuple(f"no {side}puts named in the file, numbered instead" for side in ("out", "in"))
ONE = [frf("output 1", "input 1")]
MANY = [frf(f"output {i + 1}", "input 1", H[:, i]) for i in range(3)]
SIGNAL_CALC = {
    "Freq_domain": column(F),
    "Hf_chan_2": column(V),
    "Hf_coh_chan_2": column(C),
    "Hf_chan_3": column(H[:, 1]),
}
POLYTEC = {"XUnit": "Hz", "YUnit": "m/s/N", "Name": "H1 Velocity / Force", "FunctionType": "ptcFunctionFRFType"}
ELEMENTS = [{"name": f"P{i + 1}", "H": column(H[:, i]), "f": column(F)} for i in range(3)]

#: Name: what the file holds, what its records are, and the formats where not all four.
FILES = {
    "test.lab frf": ({"FRF": siemens()}, [frf("Tip:1:+Z", "Tip:2:+X", quantity="accelerance", averages=None)]),
    "test.lab averages":
        ({"FRF": siemens() | {"function_record": siemens()["function_record"] | {"average": {"nr_of_averages": 5.0}}}},
        [frf("Tip:1:+Z", "Tip:2:+X", averages=5)]),
    "test.lab said to be in MKS":
        ({"FRF": siemens() | {"y_values": {"values": column(V), "quantity": {"label": "g/N", "info": "saved in MKS"}}}},
        [frf("Tip:1:+Z", "Tip:2:+X", quantity="accelerance")]),
    "test.lab in SI or in g":
        ({"FRF": siemens() | {"y_values": {"values": column(V), "quantity": {"label": "g/N"}}}},
        [frf("Tip:1:+Z", "Tip:2:+X", factor=None, unit="g (or SI: no factor)/N")]),
    "test.lab frf in si": ({"FRF": siemens(unit="(m/s^2)/N")}, [frf("Tip:1:+Z", "Tip:2:+X", quantity="accelerance")]),
    "test.lab per volt":
        ({"FRF": siemens(unit="g/V")}, [frf("Tip:1:+Z", "Tip:2:+X", quantity="accelerance", factor=None)]),
    "test.lab unknown unit": ({"FRF": siemens(unit="EU")}, [frf("Tip:1:+Z", "Tip:2:+X", factor=None, unit="EU")]),
    "test.lab coherence beside":
        ({"FRF": siemens(), "Coherence": siemens(C, "", "Coherence")},
        [frf("Tip:1:+Z", "Tip:2:+X", coherence=C)]),
    "test.lab coherence alone":
        ({"Coherence": siemens(C, "", "Coherence")},
        [{"type": CoherenceRecord, "response": "Tip:1:+Z", "reference": "Tip:2:+X", "frequency_hz": F, "values": C}]),
    "test.lab channels in the name":
        ({"FRF_1": siemens() | {"function_record": {"name": "FRF Tip:1:+Z/Tip:2:+X", "type": "FRF"}}},
        [frf("Tip:1:+Z", "Tip:2:+X")]),
    "test.lab unit and factor differ":
        ({"FRF":
        siemens() | {"y_values":
        {"values": column(V), "quantity": {"label": "g/N", "unit_transformation": {"factor": 1.0}}}}},
        [frf("Tip:1:+Z", "Tip:2:+X", factor=None, unit="g (factor 1)/N")]),
    "test.lab uneven lines":
        ({"FRF": siemens(values=V, unit="m/N") | {"x_values": {"values": F**1.5, "quantity": {"label": "Hz"}}}},
        [frf("Tip:1:+Z", "Tip:2:+X", lines=F**1.5, quantity="receptance")]),
    "test.lab time":
        ({"Signal": signal(names=("3:Point1", "µ-mid"))},
        [history("3:Point1", X[:, 0], quantity="acceleration"), history("µ-mid", X[:, 1], unit="m/s^2")],
        WITH_LISTS),
    "test.lab time one":
        ({"Signal_0": signal(X[:, :1], ["hammer"], "N"), "Signal_1": signal(X[:, 1:], ["tip"], "g")},
        [history("hammer", X[:, 0], quantity="force"), history("tip", X[:, 1])], WITH_LISTS),
    "test.lab spectrum":
        ({"PSD": siemens(C, "g^2/Hz", "PSD")},
        [{"type": SpectrumRecord, "channel": "Tip:1:+Z", "frequency_hz": F, "values": C, "unit": "g^2/Hz"}]),
    "test.lab array of structs":
        ({"FRF": [siemens(V, labels=("a", "h")), siemens(H[:, 1], labels=("b", "h"))]},
        [frf("a", "h"), frf("b", "h", H[:, 1])], WITH_LISTS),
    "test.lab structs in a struct": ({"run": {"one": {"FRF": siemens()}}}, [frf("Tip:1:+Z", "Tip:2:+X")]),
    "signalcalc":
        (SIGNAL_CALC | {"PSD_chan_1": column(C), "Time_domain": column(T), "Time_chan_1": column(X[:, 0])},
        [frf("channel 2", "channel 1", coherence=C), frf("channel 3", "channel 1", H[:, 1]),
        {"type": SpectrumRecord, "channel": "channel 1", "frequency_hz": F, "values": C},
        history("channel 1", X[:, 0])]),
    "signalcalc coherence alone":
        ({"Freq_domain": column(F), "Hf_coh_chan_2": column(C)},
        [{"type": CoherenceRecord, "response": "channel 2", "reference": "channel 1", "values": C, "frequency_hz": F}]),
    "signalcalc time":
        ({"Time_domain": T, "Time_chan_1": X[:, 0], "Time_chan_2": X[:, 1]},
        [history("channel 1", X[:, 0]), history("channel 2", X[:, 1])]),
    "dewesoft":
        ({"Sample_rate": 256.0, "Data1_AI_1": column(X[:, 0]), "Data1_AI_2": column(X[:, 1])},
        [history("Data1_AI_1", X[:, 0]), history("Data1_AI_2", X[:, 1])]),
    "dewesoft with instants":
        ({"Data1_time_AI_1": T, "Data1_AI_1": X[:, 0], "Data1_time_AI_2": 2 * T, "Data1_AI_2": X[:, 1]},
        [history("Data1_AI_1", X[:, 0]), history("Data1_AI_2", X[:, 1], 128.0)]),
    "dewesoft in days":
        ({"Sample_rate": 256.0, "Data1_time_AI_1": 739371.5 + T / 86400, "Data1_AI_1": X[:, 0]},
        [history("Data1_AI_1", X[:, 0])]),
    "polytec":
        ({"x": F[None], "y": H.T, "usd": POLYTEC},
        [frf(f"point {i + 1}", "input 1", H[:, i], quantity="mobility") for i in range(3)]),
    "polytec time":
        ({"x": T[None], "y": X.T, "usd": POLYTEC | {"XUnit": "s", "YUnit": "m/s"}},
        [history("point 1", X[:, 0], quantity="velocity"), history("point 2", X[:, 1])]),
    **{f"{name} and {axis}":
        ({axis: F, name: H, "quantity": "mobility", "coherence": np.abs(H) / 9, "navg": 5.0},
        [frf(f"output {i + 1}", "input 1", H[:, i], quantity="mobility", coherence=np.abs(H[:, i]) / 9, averages=5)
        for i in range(3)]) for axis, name in
        (("frequency_hz", "FRF"), ("frequency", "H"), ("freq", "h"), ("f", "frf"), ("Freqs", "H"))},
    "H and f": ({"H": V, "f": F}, ONE),
    "H1 and freq": ({"H1": column(V), "freq": column(F)}, ONE),
    "H2 and Freq": ({"H2": H, "Freq": column(F)}, MANY),
    "Recep and Freq": ({"Recep": column(V), "Freq": F}, [frf("output 1", "input 1", quantity="receptance")]),
    "Mob and frequencies": ({"Mob": V, "Frequencies": F}, [frf("output 1", "input 1", quantity="mobility")]),
    "FRF and frequencyBand": ({"FRF": H.T, "frequencyBand": F}, MANY),
    "H00 and H10":
        ({"H00": V, "H10": H[:, 1], "f": F}, [frf("output 0", "input 0"), frf("output 1", "input 0", H[:, 1])]),
    "FRFs by name":
        ({"FRF_a": V, "FRF_b": H[:, 1], "f": F}, [frf("FRF_a", "input 1"), frf("FRF_b", "input 1", H[:, 1])]),
    "H_1 to H_3":
        ({f"H{i + 1}": H[:, i] for i in range(3)} | {"f": F}, [frf(f"H{i + 1}", "input 1", H[:, i]) for i in range(3)]),
    "lines in an outer struct": ({"f": F, "tip": {"H": V}}, ONE),
    "structs in structs":
        ({"a": {"b": {"c": {"H": V, "freq": F, "unit": "mm/N"}}}}, [frf("output 1", "input 1", V / 1000)]),
    "a unit that all have":
        ({"H": V, "f": F, "unit": "g/N"}, [frf("output 1", "input 1", G * V, unit="g/N", quantity="accelerance",
        notes=(*NUMBERED, "g/N converted to (m/s^2)/N"))]),
    "labels in a struct":
        ({"test": {"f": F, "H": H, "outputs": ["tip", "mid", "root"], "quantity": "receptance"}, "other": np.eye(3)},
        [frf("tip", "input 1", where="variable 'test.H', 'tip' over 'input 1'"), frf("mid", "input 1", H[:, 1]),
        frf("root", "input 1", H[:, 2])], WITH_LISTS),
    "three dimensions":
        ({"frf": H.reshape(8, 3, 1), "frequency_hz": F, "outputs": np.array(["a", "b", "c"])},
        [frf(name, "input 1", H[:, i]) for i, name in enumerate("abc")], ("npz", "mat")),
    "omega":
        ({"H": V, "omega": 2 * np.pi * F},
        [frf("output 1", "input 1", notes=("frequency in rad/s converted to Hz", *NUMBERED))]),
    "kilohertz": ({"H": V, "f_kHz": F / 1000, "g": 9.81}, ONE),
    "unit of the axis": ({"H": V, "freq": 2 * np.pi * F, "freq_unit": "rad/s"}, ONE),
    "unit of the FRF": ({"H": V, "f": F, "H_unit": "g/N"}, [frf("output 1", "input 1", G * V, factor=G)]),
    "mag and phase_deg": ({"f": F, "mag": np.abs(V), "phase_deg": np.degrees(np.angle(V))}, ONE),
    "H_mag and H_phase_rad": ({"f": F, "H_mag": np.abs(V), "H_phase_rad": np.angle(V)}, ONE),
    "decibels": ({"f": F, "H_dB": 20 * np.log10(np.abs(V)), "H_phase_rad": np.angle(V)}, ONE),
    "phase unit": ({"f": F, "mag": np.abs(V), "phase": np.angle(V), "phase_unit": "rad"}, ONE),
    "real and imag": ({"f": F, "real": V.real, "imag": V.imag}, ONE),
    "Re_H and Im_H": ({"f": F, "Re_H": V.real, "Im_H": V.imag}, ONE),
    "df and f_start": ({"H": V, "df": 0.5, "f_start": 10.0}, ONE),
    "coherence by name": ({"H11": V, "coh11": C, "f": F}, [frf("output 1", "input 1", coherence=C)]),
    **{f"{one} and {two}":
        ({"f": F, "FRF1": V, "FRF2": H[:, 1], one: C, two: C[::-1]},
        [{"type": FrfRecord, "values": H[:, i], "coherence": C if one.endswith(f"{i + 1}") else C[::-1]}
        for i in (0, 1)])
        for one, two in (("Coh1", "Coh2"), ("Coherence_1", "Coherence_2"), ("coh_2", "coh_1"))},
    "coherence of another struct":
        ({"one": {"H": V, "f": F}, "two": {"coh": C, "f": F}}, [frf("output 1", "input 1", coherence=C)]),
    "coherence alone":
        ({"coh": C, "f": F},
        [{"type": CoherenceRecord, "response": "output 1", "reference": "input 1", "values": C, "frequency_hz": F}]),
    "t, x, y": ({"t": T, "x": X[:, 0], "y": X[:, 1]}, [history("x", X[:, 0]), history("y", X[:, 1])]),
    "t and a matrix": ({"t": column(T), "x": X}, [history("x 1", X[:, 0]), history("x 2", X[:, 1])]),
    "t, xn, yn": ({"t": T, "xn": X[:, 0], "yn": X[:, 1]}, [history("xn", X[:, 0]), history("yn", X[:, 1])]),
    "f is a force": ({"f": X[:, 1], "t": T, "x": X[:, 0]}, [history("f", X[:, 1]), history("x", X[:, 0])]),
    "f alone is a force": ({"f": X[:, 1], "fs": 256.0}, [history("f", X[:, 1])]),
    "a complex array beside a signal":
        ({"fs": 256.0, "acc_tip": X[:, 0], "Z": V},
        [history("acc_tip", X[:, 0], notes=("'Z' not read: [data.layout] can name it",))]),
    **{f"channels of SEP 5, {name}":
        ({"signals": [{"data": X[:, 0], "name": "hammer", "unit_str": "N", name: clock},
        {"data": X[:, 1], "name": "tip", "unit_str": "g", "quantity": "Acceleration", name: clock}]},
        [history("hammer", X[:, 0], quantity="force"), history("tip", G * X[:, 1], quantity="acceleration")], ("mat",))
        for name, clock in (("fs", 256.0), ("time", T))},
    "dt and input, output":
        ({"dt": 1 / 256, "input": X[:, 0], "output": X[:, 1]}, [history("output", X[:, 1]), history("input", X[:, 0])]),
    "time in ms": ({"time_ms": 1000 * T, "x": X[:, 0]}, [history("x", X[:, 0])]),
    "hits with instants": ({"t": T, "force": X}, [history("force", X[:, 0], hit=1), history("force", X[:, 1], hit=2)]),
    "hits of two sensors":
        ({"fs": 256.0, "acceleration": X, "force": -X},
        [history(name, sign * X[:, i], quantity=name, hit=i + 1)
        for name, sign in (("force", -1), ("acceleration", 1)) for i in range(2)]),
    "samples with units and instants":
        ({"t": T, "samples": np.column_stack([X, X[:, 0]]), "units": ["lbf", "g", "V"]},
        [history("channel 1", 4.4482216152605 * X[:, 0], quantity="force", unit="lbf"),
        history("channel 2", G * X[:, 1], quantity="acceleration", unit="g"),
        history("channel 3", X[:, 0], quantity="unknown", unit="V")]),
    "array of structs": ({"run": ELEMENTS}, [frf(f"P{i + 1}", "input 1", H[:, i]) for i in range(3)], WITH_LISTS),
    "cells of structs":
        ({"run": [*ELEMENTS[:2], "end"]}, [frf(f"P{i + 1}", "input 1", H[:, i]) for i in range(2)], WITH_LISTS),
    "cells of numbers": ({"H": [column(H[:, i]) for i in range(3)], "f": F}, MANY, WITH_LISTS),
    "sparse": ({"FRF": scipy.sparse.csc_matrix(H), "f": F}, MANY),
    "units of each FRF":
        ({"H": H, "f": F, "unit": np.array(["g/N", "mm/N", "EU"])},
        [frf("output 1", "input 1", G * V, quantity="accelerance"),
        frf("output 2", "input 1", H[:, 1] / 1000, quantity="receptance"),
        frf("output 3", "input 1", H[:, 2], factor=None)], ("npz",)),
    "units of nobody knows which":
        ({"force": X[:, 0], "acceleration": X[:, 1], "fs": 256.0, "units": np.array(["N", "g"])},
        [history("force", X[:, 0], factor=None, unit="N, g"), history("acceleration", X[:, 1], factor=None)], ("npz",)),
    "a unit of one of two":
        ({"force": X[:, 0], "acceleration": X[:, 1], "fs": 256.0, "unit": "g"},
        [history("force", X[:, 0], factor=None), history("acceleration", G * X[:, 1], factor=G)]),
    "spectra beside": ({"H": V, "f": F, "F": H[:, 1], "X": H[:, 2]}, ONE, ("mat", "mat73", "npz")),
    "magnitudes of 20 to 60":
        ({"mag": np.abs(V) + 20, "phase_deg": np.degrees(np.angle(V)), "f": F},
        [frf("output 1", "input 1", V + 20 * V / np.abs(V)) | {"notes":
        ("magnitude taken as linear, not in decibels", *NUMBERED)}]),
    "magnitudes in dB by their unit":
        ({"mag": 20 * np.log10(np.abs(V)), "mag_unit": "dB", "phase_deg": np.degrees(np.angle(V)), "f": F},
        [frf("output 1", "input 1", factor=None)]),
    "an FRF of a name that says nothing":
        ({"G": H[:, 1], "H": V, "f": F},
        [frf("output 1", "input 1",
        notes=("'G' not read: [data.layout] can name it", *NUMBERED))]),
    "beside texts and numbers of known names":
        ({"H": V, "f": F, "force": "hammer", "samples": 4096.0, "time": "12:30", "units": {"H": "g"}, "response": 2.0},
        ONE),
    "FRF and what it was made of":
        ({"H": V, "f": F, "t": T, "input": X[:, 0], "output": X[:, 1]},
        [*ONE, history("output", X[:, 1]), history("input", X[:, 0])]),
    "Txy and Cxy":
        ({"Txy": V, "Cxy": C, "Pxx": C, "f": F},
        [frf("output 1", "input 1", coherence=C), {"type": SpectrumRecord, "channel": "Pxx", "values": C}]),
    "data of an FRF": ({"frf": {"data": H, "freq": F}}, MANY),
    "simulink":
        ({"out": {"time": T, "signals": {"values": X, "dimensions": 2.0}}},
        [history("signals 1", X[:, 0]), history("signals 2", X[:, 1])]),
    "beside other things": ({"H": V, "f": F, "h": 0.01, "E": 210e9, "note": "steel", "n": 8.0}, ONE),
    "beside other things of MATLAB":
        ({"H": V, "f": F, "K": scipy.sparse.eye(5).tocsc(), "cells": ["a", np.eye(2), {"x": 1.0}], "flag": True,
        "none": np.empty((0, 0)), "spare": np.full(8, np.nan), "temperature": F[:5]}, ONE, ("mat",)),
}  # fmt: skip
CASES = [(name, form) for name, (_, _, *only) in FILES.items() for form in (only[0] if only else WRITERS)]


@pytest.mark.parametrize(("name", "form"), CASES)
def test_layouts_are_read_right(tmp_path, name, form):
    tree, expected, *_ = FILES[name]
    WRITERS[form](tree, tmp_path / "a")
    require(list(iter_records(tmp_path / "a")), expected)


def squeezed(value):
    """A tree with its arrays as they are without axes of one, and single texts as texts."""
    if isinstance(value, dict):
        return {name: squeezed(item) for name, item in sorted(value.items())}
    if isinstance(value, list) and not all(isinstance(item, str) for item in value):
        return [squeezed(item) for item in value]
    array = np.squeeze(np.asarray(value))
    return array.astype(str).tolist() or "" if array.dtype.kind == "U" else array.astype(complex).tolist()


@pytest.mark.parametrize("name", [n for n, (_, _, *forms) in FILES.items() if not forms or "mat73" in forms[0]])
def test_both_versions_of_matlab_give_the_tree_that_was_written(tmp_path, name):
    tree = FILES[name][0]
    trees = []
    for form in WITH_LISTS:
        WRITERS[form](tree, tmp_path / form)
        trees.append(squeezed(read_arrays(tmp_path / form, form)))
    assert trees[0] == trees[1]
    full = {key: value.toarray() if scipy.sparse.issparse(value) else value for key, value in tree.items()}
    assert trees[0] == squeezed(full)


def test_cells_in_cells_empty_ones_and_structs_of_cells(tmp_path):
    """As MATLAB nests them; scipy's reader is the oracle of the file that scipy wrote."""
    tree = {
        "a": {"b": [{"c": ["x", "y"], "d": [1.0, [2.0, "z"]]}, {"c": ["u", "v"], "d": [3.0]}]},
        "e": np.zeros((0, 0)),
    }
    for form in WITH_LISTS:
        WRITERS[form]({"a": tree["a"]}, tmp_path / form)
        first, second = read_arrays(tmp_path / form, form)["a"]["b"]
        assert (first["c"].tolist(), second["c"].tolist()) == (["x", "y"], ["u", "v"])
        assert [float(first["d"][0].item()), float(second["d"][0].item())] == [1.0, 3.0]
        inner = first["d"][1]
        assert (inner[0].item(), str(inner[1].item())) == (2.0, "z")
    WRITERS["mat"](tree, tmp_path / "a")
    oracle = scipy.io.loadmat(tmp_path / "a", appendmat=False, simplify_cells=True)
    assert oracle["a"]["b"][0]["d"][1][0] == 2.0
    assert read_arrays(tmp_path / "a", "mat")["e"].size == oracle["e"].size == 0
