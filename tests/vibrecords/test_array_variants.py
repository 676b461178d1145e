"""Files of arrays as many people write them: read right, or asked in one line whose advice, when followed, is right.

The truth of each is made here from its definition, so that nothing of the reader is its own oracle.
"""

import h5py
import nptdms
import numpy as np
import pytest
import scipy.io

from tests.vibrecords.reading import records_of, refusal
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
            array, attributes = value if isinstance(value, tuple) else (value, {})
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


#: Name: data sets with attributes, and what is in them: the FRF in m/N, or histories in N and m/s², or what is asked.
FRF_FILES = {
    "mm/N": {"f": LINES, "frf": (1000 * H, {"unit": "mm/N"})},
    "units in capitals": {"f": LINES, "frf": (1e6 * H, {"Units": "um/N"})},
    "unit_string": {"f": LINES, "H": (H * 4.4482216152605, {"unit_string": "m/lbf"})},
    "bytes": {"f": LINES, "H": (1000 * H, {"UNIT": np.bytes_("mm/N")})},
    "kilohertz": {"f": (LINES / 1000, {"unit": "kHz"}), "H": (H, {"unit": "m/N"})},
    "rad/s": {"f": (LINES * 2 * np.pi, {"units": "rad/s"}), "H": (H, {"unit": "m/N"})},
    "degrees": {"f": LINES, "mag": (1000 * abs(H), {"unit": "mm/N"}), "phase": (np.angle(H, True), {"unit": "deg"})},
    "radians": {"f": LINES, "mag": (1000 * abs(H), {"unit": "mm/N"}), "phase": (np.angle(H), {"unit": "rad"})},
    "scale_factor": {"f": LINES, "H": (H / 1e-9, {"units": "m/N", "scale_factor": 1e-9})},
    "scale_factor in text": {"f": LINES, "H": (H / 1e-9, {"units": "m/N", "scale_factor": "1e-9"})},
    "scale and offset of both parts": {
        "f": LINES,
        "real": (packed(H.real, 1e-12, 1e-4), {"units": "m/N", "scale_factor": 1e-12, "add_offset": 1e-4}),
        "imag": (packed(H.imag, 1e-12), {"units": "m/N", "scale_factor": 1e-12}),
    },
    "axis by attributes": {"H": (H, {"unit": "m/N", "df": 2.0, "f_start": 2.0})},
    "averages at the data set": {"f": LINES, "H": (H, {"unit": "m/N", "averages": 5}), "coherence": COHERENCE},
    "group unit, own unit": {"": {"unit": "g/N"}, "f": LINES, "H": (1000 * H, {"unit": "mm/N"})},
    "a fill value": {"f": LINES, "H": (H, {"unit": "m/N", "_FillValue": np.nan})},
}
HISTORIES = {
    "kN and g": {"fs": RATE, "force": (FORCE / 1000, {"units": "kN"}), "acceleration": (MOTION / G, {"units": "g"})},
    "rate at each data set": {
        "force": (FORCE, {"unit": "N", "fs": RATE}),
        "acceleration": (MOTION, {"unit": "m/s^2", "fs": RATE}),
    },
    "step at each data set": {
        "force": (FORCE, {"unit": "N", "dt": 1 / RATE}),
        "acceleration": (MOTION / G, {"unit": "g", "dt": 1 / RATE}),
    },
    "instants in ms": {
        "time": (1000 * TIME, {"units": "ms"}),
        "force": (FORCE, {"units": "N"}),
        "acceleration": (MOTION, {}),
    },
    "instants since a day": {
        "time": (TIME, {"units": "seconds since 2026-01-01 00:00:00"}),
        "force": (FORCE, {"units": "N"}),
        "acceleration": (MOTION / G, {"units": "g"}),
    },
    "packed": {
        "fs": RATE,
        "force": (packed(FORCE, 1e-6), {"units": "N", "scale_factor": 1e-6}),
        "acceleration": (packed(MOTION, 1e-8, 3.0), {"units": "m/s^2", "scale_factor": 1e-8, "add_offset": 3.0}),
    },
    "units of columns": {
        "fs": RATE,
        "samples": (
            np.column_stack([FORCE / 4.4482216152605, MOTION / G]),
            {"units": ["lbf", "g"], "channels": ["force", "acceleration"]},
        ),
    },
    "unit and quantity of any name": {
        "fs": RATE,
        "response": (MOTION / G, {"unit": "g", "quantity": "acceleration"}),
        "force": (FORCE, {"unit": "N"}),
    },
}
#: What the numbers may have or not: the unit is open, and the case asks.
OPEN = {
    "gain": ({"f": LINES, "H": (H, {"unit": "m/N", "gain": 0.5})}, "(attribute gain: applied?) m/N"),
    "offset": ({"fs": RATE, "force": (FORCE, {"unit": "N", "offset": 3.0})}, "(attribute offset: applied?) N"),
    "scale without unit": ({"fs": RATE, "force": (FORCE, {"Scale": 1e3})}, "(attribute scale: applied?)"),
    "calibration": ({"fs": RATE, "force": (FORCE, {"unit": "V", "calibration": "cal_7"})},
                    "(attribute calibration: applied?) V"),
}  # fmt: skip


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
    neutral = {"unit": "N", "gain": 1.0, "offset": 0, "sensitivity": 0.0023, "comment": "front"}
    (force,) = records_of(hdf5(tmp_path / "a", {"fs": RATE, "force": (FORCE, neutral)}))
    assert (force.unit, force.factor) == ("N", 1.0)
    np.testing.assert_array_equal(force.values, FORCE)
    wrong = {"fs": RATE, "force": (FORCE, {"scale_factor": "many"})}
    refusal(hdf5(tmp_path / "b", wrong), None, "variable 'force': found no number in its scale_factor; expected one")
    two = {"force": (FORCE, {"fs": 1024.0}), "acceleration": (MOTION, {"fs": 512.0})}
    refusal(hdf5(tmp_path / "c", two), None, "found data sets of different fs; expected one rate in a group")
    parts = {"f": LINES, "real": (H.real, {"unit": "m/N"}), "imag": (H.imag, {"unit": "mm/N"})}
    refusal(hdf5(tmp_path / "d", parts), None, "variable 'imag': found the unit 'mm/N'; expected 'm/N', that of 'real'")


def test_a_constant_signal_packs_well_and_is_no_bomb(tmp_path):
    scipy.io.savemat(tmp_path / "a", {"fs": RATE, "x": np.ones(4_000_000)}, do_compression=True, appendmat=False)
    assert (tmp_path / "a").stat().st_size < 10**5  # of which 20 times are 2 MB
    (record,) = records_of(tmp_path / "a")
    assert record.values.size == 4_000_000
