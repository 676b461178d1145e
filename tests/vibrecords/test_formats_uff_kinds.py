"""Universal files as programs write them: modes, several references, coherences alone, spectra, longer headers.

Layouts: Structural Dynamics Research Lab, University of Cincinnati, Universal File Formats, data sets 55 and 58; the ID
lines and columns of ARTeMIS (its help, "UFF Data Set Number 55"), of I-DEAS Test (notes 8 and 12 of data set 55) and of
pyuff, which is the oracle for what it reads.
"""

import numpy as np
import pytest
import pyuff
from benchmarks.written_files import write_records

from tests.vibrecords.made_files import function_58, mode_55
from tests.vibrecords.reading import records_of
from vibrecords.errors import MeasurementError
from vibrecords.formats import iter_records, uff_data_sets
from vibrecords.inspection import inspect_file
from vibrecords.records import FrfRecord, ModeRecord

RNG = np.random.default_rng(22)
H = RNG.normal(size=11) + 1j * RNG.normal(size=11)
SHAPE = {4: [0.0, 1.25, 0.0], 7: [0.5, -0.75, 0.0]}
POLE = (-3.0, 300.0)  # rad/s


@pytest.mark.parametrize("part", [1, 64, 1000])
def test_functions_are_the_same_whatever_is_decoded_at_once(tmp_path, monkeypatch, part):
    values = RNG.normal(size=301) + 1j * RNG.normal(size=301)
    time = function_58(values.real, function=1, first=0.0, kinds=("time", "force", "none"), units=("s", "N", "NONE"))
    uneven = function_58(values, np.sort(RNG.uniform(1, 900, 301)), response=("NONE", 2, 3))
    loose = "\n".join(" ".join(line.split()) if "E" in line[4:20] else line for line in uneven.split("\n"))
    text = time + function_58(values) + uneven + loose.replace("         2   3", "         5   3")
    whole = records_of(tmp_path / "a.uff", text)
    monkeypatch.setattr(uff_data_sets, "_PART", part)
    for record, same in zip(records_of(tmp_path / "a.uff", text), whole, strict=True):
        np.testing.assert_array_equal(record.values, same.values)
        if isinstance(record, FrfRecord):
            np.testing.assert_array_equal(record.frequency_hz, same.frequency_hz)
    with pytest.raises(MeasurementError, match="line 164: found 601 numbers; expected 602"):
        records_of(tmp_path / "a.uff", function_58(values).replace(f"{values[150].real:20.12E}", " " * 20))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves files open
@pytest.mark.parametrize(("analysis", "per_node"), [(2, 3), (2, 6), (3, 3), (7, 3)])  # complex ones of 6 it has not
def test_modes_of_pyuff_are_read_as_it_reads_them(tmp_path, analysis, per_node):
    numbers = RNG.normal(size=(per_node, 4)) + (0 if analysis == 2 else 1j * RNG.normal(size=(per_node, 4)))
    common = {"model_type": 1, "analysis_type": analysis, "data_ch": 2, "spec_data_type": 8, "load_case": 1}
    common |= {f"r{i + 1}": row for i, row in enumerate(numbers)} | {"node_nums": [3, 5, 8, 13], "mode_n": 2}
    common |= {"data_type": 2 if analysis == 2 else 5, "n_data_per_node": per_node}
    stated = {"freq": 81.25, "modal_m": 2.5, "modal_damp_vis": 0.0125, "modal_damp_his": 0.0}
    if analysis != 2:
        stated = {"eig": complex(*POLE), "modal_a": 1 + 2j, "modal_b": 0j}
    path = tmp_path / "a.uff"
    pyuff.UFF(str(path)).write_sets(pyuff.prepare_55(**common, **stated), "add")
    theirs = pyuff.UFF(str(path)).read_sets()
    (mode,) = iter_records(path)
    axes = ("X", "Y", "Z", "RX", "RY", "RZ")[:per_node]
    assert (mode.number, set(mode.shape)) == (2, {f"{n}:{axis}+" for n in (3, 5, 8, 13) for axis in axes})
    for i, axis in enumerate(axes):
        ours = [mode.shape[f"{int(node)}:{axis}+"] for node in theirs["node_nums"]]
        np.testing.assert_array_equal(ours, theirs[f"r{i + 1}"])
    if analysis == 2:
        said = [theirs[key] for key in ("freq", "modal_damp_vis", "modal_m")]
        assert [mode.frequency_hz, mode.damping_ratio, mode.modal_mass] == said
    else:
        assert mode.frequency_hz == abs(theirs["eig"]) / (2 * np.pi)


def exact_modes():
    labels = [f"{node}:{axis}+" for node in (3, 12) for axis in ("X", "Y", "Z", "RX", "RY", "RZ")]
    values = RNG.normal(size=(2, 12)) * 10.0 ** RNG.integers(-9, 9, size=(2, 12))
    return [
        ModeRecord(n + 1, 1 / 3 + n, 0.1 / 3, 0.01 / 3, 1e-5 / 3, dict(zip(labels, row.tolist(), strict=True)), 1 / 7)
        for n, row in enumerate(values)
    ]


def test_modes_written_are_read_back_with_the_six_digits_of_their_columns(tmp_path):
    modes = exact_modes()
    shape = {label: value * (1 + 0.25j) for label, value in modes[1].shape.items()}
    modes[1] = ModeRecord(2, 1 / 3, shape=shape, damping_ratio=0.1)
    write_records(modes, tmp_path / "a.uff", "uff58")
    for written, back in zip(modes, iter_records(tmp_path / "a.uff"), strict=True):
        for key in ("number", "frequency_sd_hz", "damping_sd"):
            assert getattr(back, key) == getattr(written, key), key
        for key in ("frequency_hz", "damping_ratio", "shape"):
            assert getattr(back, key) == pytest.approx(getattr(written, key), rel=1e-5), key
    assert [back.modal_mass for back in iter_records(tmp_path / "a.uff")] == [pytest.approx(1 / 7, rel=1e-5), None]


def test_a_spectrum_is_listed_and_no_data(tmp_path):
    (tmp_path / "a.uff").write_text(function_58(H.real, function=9))
    inspection = inspect_file(tmp_path / "a.uff")
    assert "power spectral density" in " ".join(inspection.kinds)
    assert "11 lines, 1 to 6 Hz" in " ".join(inspection.kinds)
    assert (inspection.frfs, inspection.modes) == ((), ())


def test_every_mode_cut_anywhere_is_read_or_one_line(tmp_path):
    whole = mode_55(SHAPE) + mode_55({4: [1j, 2, 0]}, (*POLE, 0.0, 1.0, 0.0, 0.0), analysis=3)
    for size in range(0, len(whole), 7):
        try:
            assert all(isinstance(r, ModeRecord) for r in records_of(tmp_path / "a.uff", whole[:size] or " "))
        except MeasurementError as error:
            assert "\n" not in str(error)  # noqa: PT017 (most cuts are errors, some are none)
