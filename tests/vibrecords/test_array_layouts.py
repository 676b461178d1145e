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

from tests.vibrecords.array_trees import WITH_LISTS, WRITERS, trees
from tests.vibrecords.reading import require
from vibrecords.formats import iter_records
from vibrecords.formats.array_files import read_arrays
from vibrecords.records import CoherenceRecord, FrfRecord, ModeRecord, SpectrumRecord, TimeRecord

RNG = np.random.default_rng(22)
F = 10.0 + 0.5 * np.arange(8)
H = RNG.normal(size=(8, 3)) + 1j * RNG.normal(size=(8, 3))
V, C = H[:, 0], RNG.uniform(0.5, 0.99, 8)
T = np.arange(12) / 256
X = RNG.normal(size=(12, 2))
G = 9.80665


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
ARRAYS = {"F": F, "H": H, "V": V, "V2": H[:, 1], "V3": H[:, 2], "C": C, "T": T, "X": X, "X1": X[:, 0], "X2": X[:, 1]}
ARRAYS |= {"U": F**1.5, "S": T**2, "D": 739371.5 + T / 86400, "J": F + 1j, "I": np.eye(3)}  # uneven, in days, complex
ARRAYS |= {"XX": np.column_stack([X, X[:, 0]]), "FN": np.array([3.0, 17.0, 80.0]), "XI": np.full(3, 0.01), "PHI": H[:4]}
_KINDS = {
    "FRF": FrfRecord,
    "time": TimeRecord,
    "spectrum": SpectrumRecord,
    "coherence": CoherenceRecord,
    "mode": ModeRecord,
}


def expected(told):
    """A record of arrays.txt, with what is not said."""
    kind = _KINDS[told["type"]]
    default = {"sample_rate_hz": 256.0} if kind is TimeRecord else {} if kind is ModeRecord else {"frequency_hz": F}
    default |= {"response": "output 1", "reference": "input 1"} if kind in (FrfRecord, CoherenceRecord) else {}
    notes = {"notes": tuple(told["notes"])} if "notes" in told else {}
    return default | told | notes | {"type": kind}


#: Name: what the file holds, what its records are, and the formats where not all four.
FILES = {
    **{name: (tree, [*map(expected, told)], forms) for name, tree, told, forms in trees(ARRAYS)},
    "magnitudes of 20 to 60":
        ({"mag": np.abs(V) + 20, "phase_deg": np.degrees(np.angle(V)), "f": F},
        [frf("output 1", "input 1", V + 20 * V / np.abs(V)) | {"notes":
        ("magnitude taken as linear, not in decibels", *NUMBERED)}]),
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


@pytest.mark.parametrize("form", ["npz", "mat"])
@pytest.mark.parametrize("more", [{}, {"Phi": H[:4].T}, {"channels": np.array(["1:z", "2:z", "3:z", "4:z"])}])
def test_modes_of_pyoma_have_their_shapes(tmp_path, form, more):
    WRITERS[form](FILES["modes of pyOMA"][0]["result"] | more, tmp_path / "a")
    channels = more.get("channels", [f"channel {n + 1}" for n in range(4)])
    for i, mode in enumerate(iter_records(tmp_path / "a")):
        assert mode.shape == dict(zip(channels, H[:4, i], strict=True))
        assert bool(mode.notes) == ("Phi" in more)


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
