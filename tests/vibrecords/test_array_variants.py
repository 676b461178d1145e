"""Files of arrays as many people write them: read right, or asked in one line whose advice, when followed, is right.

The truth of each is made here from its definition, so that nothing of the reader is its own oracle.
"""

import re

import h5py
import nptdms
import numpy as np
import pytest
import scipy.io

from tests.vibrecords.array_trees import WRITERS, trees
from tests.vibrecords.made_files import matlab_4
from tests.vibrecords.reading import put, records_of, refusal, require
from vibrecords.formats.channel_units import ChannelUnit, restate_frf, restate_history, unknown_sides
from vibrecords.records import FrfRecord, TimeRecord

G = 9.80665
LINES = np.arange(1, 65) * 2.0
#: Receptance of one mode at 38 Hz in m/N, coherence, and a force and an acceleration at 1024 Hz in N and m/s².
H = 1 / (3.0 * ((2 * np.pi * 38.0) ** 2 - (2 * np.pi * LINES) ** 2 + 2j * 0.01 * (2 * np.pi) ** 2 * 38.0 * LINES))
COHERENCE = np.linspace(0.7, 0.99, 64)
RATE = 1024.0
TIME = np.arange(128) / RATE
FORCE = np.where(TIME < 0.004, 80.0 * np.sin(np.pi * TIME / 0.004), 0.0)
MOTION = 12.0 * np.exp(-20 * TIME) * np.sin(2 * np.pi * 38.0 * TIME)


def hdf5(path, tree):
    """Write groups as dicts, data sets as arrays or as pairs of an array and its attributes."""

    def add(group, block):
        for name, value in block.items():
            if isinstance(value, dict):
                add(group.create_group(name), value)
                continue
            array, attributes = value if isinstance(value, (list, tuple)) else (value, {})
            group[name] = array
            for key, text in attributes.items():
                group[name].attrs[key] = text

    with h5py.File(path, "w") as file:
        file.attrs.update(tree.pop("", {}))
        add(file, tree)
    return path


def packed(values, step, offset=0.0):
    """Whole numbers that are `values` times `step`, plus `offset`, as netCDF packs them."""
    return np.round((values - offset) / step).astype("i4")


W = np.random.default_rng(52).normal(size=(128, 2))
ARRAYS = {"F": LINES, "H": H, "C": COHERENCE, "T": TIME, "A": FORCE, "B": MOTION, "W": W, "W1": W[:, 0], "W2": W[:, 1]}
ARRAYS |= {"RI": np.column_stack([H.real, H.imag]), "FRI": np.column_stack([LINES, H.real, H.imag])}
ARRAYS |= {"FH": np.column_stack([LINES, H]), "TB": np.column_stack([TIME, MOTION])}
ARRAYS |= {"TAB": np.column_stack([TIME, FORCE, MOTION]), "LAB": np.column_stack([5 + TIME, FORCE, MOTION])}  # and late
ARRAYS |= {"TABBB": np.column_stack([TIME, FORCE, MOTION, 2 * MOTION, -MOTION])}
ATTRIBUTES = {name: (tree, told, kind) for name, tree, told, (kind,) in trees(ARRAYS, "attributes")}
SCALED = {"scale_factor": 1e-12, "units": "m/N"}
FRF_FILES = {name: tree for name, (tree, _, kind) in ATTRIBUTES.items() if kind == "FRF"} | {
    "bytes": {"f": LINES, "H": [1000 * H, {"UNIT": np.bytes_("mm/N")}]},
    "scale and offset of both parts": {
        "f": LINES,
        "real": [packed(H.real, 1e-12, 1e-4), SCALED | {"add_offset": 1e-4}],
        "imag": [packed(H.imag, 1e-12), SCALED],
    },
}
HISTORIES = {name: tree for name, (tree, _, kind) in ATTRIBUTES.items() if kind == "histories"} | {
    "packed": {
        "fs": RATE,
        "force": [packed(FORCE, 1e-6), {"units": "N", "scale_factor": 1e-6}],
        "acceleration": [packed(MOTION, 1e-8, 3.0), {"units": "m/s^2", "scale_factor": 1e-8, "add_offset": 3.0}],
    },
    "units of columns": {
        "fs": RATE,
        "samples": [
            np.column_stack([FORCE / 4.4482216152605, MOTION / G]),
            {"units": ["lbf", "g"], "channels": ["force", "acceleration"]},
        ],
    },
}
#: What the numbers may have or not: the unit is open, and the case asks.
OPEN = {name: (tree, *unit) for name, (tree, unit, kind) in ATTRIBUTES.items() if kind == "open"}


@pytest.mark.parametrize("name", FRF_FILES)
def test_attributes_of_a_data_set_count_for_frfs(tmp_path, name):
    (frf,) = records_of(hdf5(tmp_path / "a", dict(FRF_FILES[name])))
    assert (type(frf), frf.quantity) == (FrfRecord, "receptance")
    np.testing.assert_allclose(frf.values, H, rtol=1e-9, atol=1e-11 if "packed" in name or "parts" in name else 0)
    np.testing.assert_allclose(frf.frequency_hz, LINES, rtol=1e-12)
    assert frf.averages == (5 if "averages" in name else None)


@pytest.mark.parametrize("name", HISTORIES)
def test_attributes_of_a_data_set_count_for_histories(tmp_path, name):
    records = records_of(hdf5(tmp_path / "a", dict(HISTORIES[name])))
    found = {record.quantity: record for record in records}
    assert {type(record) for record in records} == {TimeRecord}
    assert found.keys() == {"force", "acceleration"}
    for quantity, values in (("force", FORCE), ("acceleration", MOTION)):
        np.testing.assert_allclose(found[quantity].values, values, rtol=1e-9, atol=1e-6 if "packed" in name else 1e-12)
        assert found[quantity].sample_rate_hz == pytest.approx(RATE, rel=1e-9)
    if "each channel" in name:
        assert [found[key].channel for key in ("force", "acceleration")] == ["hammer", "tip"]


@pytest.mark.parametrize("name", OPEN)
def test_a_factor_that_may_have_been_applied_leaves_the_unit_open(tmp_path, name):
    tree, unit = OPEN[name]
    (record,) = records_of(hdf5(tmp_path / "a", dict(tree)))
    assert (record.unit, record.factor) == (unit, None)
    if isinstance(record, FrfRecord):  # what is asked is the response alone, and the answer is taken
        assert unknown_sides(record.unit) == ({"unit"}, set())
        np.testing.assert_allclose(restate_frf(record, ChannelUnit("mm"), ChannelUnit()).values, H / 1000)
    else:
        np.testing.assert_allclose(restate_history(record, ChannelUnit("kN")).values, 1000 * FORCE)


@pytest.mark.parametrize("name", ["unit_string", "NI_UnitDescription", "unit", "Units", "UNIT"])
def test_the_unit_of_a_tdms_channel_stands_in_any_of_its_attributes(tmp_path, name):
    clock = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0}
    empty = {} if name == "unit_string" else {"unit_string": ""}
    with nptdms.TdmsWriter(tmp_path / "a") as file:
        file.write_segment([nptdms.ChannelObject("hit", "force", FORCE / 1000, {**clock, **empty, name: "kN"})])
    (record,) = records_of(tmp_path / "a")
    assert (record.unit, record.quantity) == ("kN", "force")
    np.testing.assert_allclose(record.values, FORCE)


def test_attributes_that_change_nothing_and_those_that_are_wrong(tmp_path):
    neutral = {"unit": "N", "gain": 1.0, "offset": 0, "conversion": "none", "sensitivity": 0.0023, "comment": "front"}
    (force,) = records_of(hdf5(tmp_path / "a", {"fs": RATE, "force": (FORCE, neutral)}))
    assert (force.unit, force.factor) == ("N", 1.0)
    np.testing.assert_array_equal(force.values, FORCE)
    wrong = {"fs": RATE, "force": (FORCE, {"scale_factor": "many"})}
    refusal(hdf5(tmp_path / "b", wrong), None, "variable 'force': found no number in its scale_factor; expected one")
    two = {"force": (FORCE, {"fs": 1024.0}), "acceleration": (MOTION, {"fs": 512.0})}
    refusal(hdf5(tmp_path / "c", two), None, "found data sets of different fs; expected one rate in a group")
    parts = {"f": LINES, "real": (H.real, {"unit": "m/N"}), "imag": (H.imag, {"unit": "mm/N"})}
    refusal(hdf5(tmp_path / "d", parts), None, "variable 'imag': found the unit 'mm/N'; expected 'm/N', that of 'real'")


# ---- what is asked, and the advice followed to the letter

SIZE, PHASE = np.abs(H), np.angle(H)
LONG = np.random.default_rng(52).normal(size=(500_000, 2))
ASKED = {name: (tree, told) for name, tree, told, _ in trees(ARRAYS, "asked")}


def advice(message):
    """The first keys of a layout that a refusal gives to be pasted."""
    first = re.split(r", or |; or | or (?=\w+ = )| with | in \[data", message.rsplit("write ", 1)[1])[0]
    return dict(re.findall(r'(\w+) = "([^"]+)"', first))


@pytest.mark.parametrize("form", ["mat", "hdf5"])
@pytest.mark.parametrize("name", ASKED)
def test_advice_is_enough_when_it_is_followed(tmp_path, name, form):
    tree, told = ASKED[name]
    WRITERS[form](tree, tmp_path / "a")
    records = records_of(tmp_path / "a", **advice(refusal(tmp_path / "a", None, "write ")))
    of_frf = {"type": FrfRecord, "frequency_hz": LINES}
    of_time = {"type": TimeRecord, "sample_rate_hz": RATE}
    expected = [each | (of_frf if each["type"] == "FRF" else of_time) for each in told]
    records.sort(key=lambda record: getattr(record, "channel", ""))  # groups of HDF5 are by name
    require(records, sorted(expected, key=lambda each: each.get("channel", "")), rtol=1e-9)
    if name == "DEWESoft's modal test":
        (frf,) = records
        assert (frf.response, frf.reference, frf.averages) == ("2:Z+", "1:Z+", 5)


def test_the_phase_of_several_frfs_is_answered_once_and_in_degrees_too(tmp_path):
    dewesoft = ASKED["DEWESoft's modal test"][0]
    second = {name.replace("2Zplus", "3RXminus"): value for name, value in dewesoft.items() if "2Zplus" in name}
    path = put(tmp_path / "a", dewesoft | second)
    for key, turned in (("phase_rad", np.exp(1j * PHASE)), ("phase_deg", np.exp(1j * np.deg2rad(PHASE)))):
        records = records_of(path, **{key: "Data1_MT_FRF_H1_2Zplus_1Zplus_Phase"})
        assert [record.response for record in records] == ["2:Z+", "3:RX-"]
        for record in records:
            np.testing.assert_allclose(record.values, SIZE * turned, rtol=1e-9)


def test_lines_of_mescope_come_from_a_first_one_and_a_step(tmp_path):
    (tmp_path / "a").write_bytes(matlab_4("<", 0, FRF=np.column_stack([H, 2 * H])))
    layout = advice(refusal(tmp_path / "a", None, "with the first line and the step in Hz"))
    assert layout == {"f_start_hz": "0", "f_step_hz": "0.5"}
    first, second = records_of(tmp_path / "a", **{"f_start_hz": "2", "f_step_hz": "2"})
    for record, factor in ((first, 1), (second, 2)):
        np.testing.assert_allclose(record.values, factor * H)
        np.testing.assert_allclose(record.frequency_hz, LINES)


def test_columns_of_a_matrix_are_named_one_or_several(tmp_path):
    path = put(tmp_path / "a", {"f": LINES, "all": np.column_stack([LINES, H, 2 * H, 3 * H])})
    records = records_of(path, frf="all(:,3:4)")
    np.testing.assert_allclose([record.values for record in records], [2 * H, 3 * H])
    for wrong in ("all(:,3:5)", "all(:,3:2)", "all(0:2,:)"):
        refusal(path, None, "expected a column or row of it, or several as 2:4", {"frf": wrong})


def test_a_constant_signal_packs_well_and_is_no_bomb(tmp_path):
    scipy.io.savemat(tmp_path / "a", {"fs": RATE, "x": np.ones(4_000_000)}, do_compression=True, appendmat=False)
    assert (tmp_path / "a").stat().st_size < 10**5  # of which 20 times are 2 MB
    (record,) = records_of(tmp_path / "a")
    assert record.values.size == 4_000_000
