"""Modes in files of arrays, as pyOMA2 saves its results (pyoma2.core.result: Fn, Xi, Phi, Fn_std, Xi_std; fs)."""

import numpy as np
import pytest

from tests.vibrecords.array_trees import WRITERS
from vibrecords.formats import iter_records
from vibrecords.records import ModeRecord

RNG = np.random.default_rng(5)
FN, XI = np.array([3.25, 17.5, 80.0]), np.array([0.011, 0.02, 0.005])
PHI = RNG.normal(size=(4, 3)) + 1j * RNG.normal(size=(4, 3))
WHOLE = {"Fn": FN, "Xi": XI, "Phi": PHI, "Fn_std": FN / 1000, "Xi_std": XI / 10, "fs": 200.0}


def save(path, form, arrays):
    WRITERS["npz" if form == "npz" else "mat"]({"result": arrays} if form == "struct" else arrays, path)
    return list(iter_records(path))


@pytest.mark.parametrize("form", ["npz", "mat", "struct"])
@pytest.mark.parametrize("turned", [False, True])
def test_modes_of_pyoma_are_read(tmp_path, form, turned):
    records = save(tmp_path / "a", form, WHOLE | ({"Phi": PHI.T} if turned else {}))
    assert {type(record) for record in records} == {ModeRecord}
    for i, mode in enumerate(records):
        assert (mode.number, mode.frequency_hz, mode.damping_ratio) == (i + 1, FN[i], XI[i])
        assert (mode.frequency_sd_hz, mode.damping_sd) == (FN[i] / 1000, XI[i] / 10)
        assert mode.shape == {f"channel {n + 1}": PHI[n, i] for n in range(4)}
        assert bool(mode.notes) == turned


def test_frequencies_alone_and_named_channels_will_do(tmp_path):
    (mode,) = save(tmp_path / "a", "npz", {"Fn": np.array([5.0])})
    assert (mode.frequency_hz, mode.damping_ratio, mode.frequency_sd_hz, mode.shape) == (5.0, None, None, {})
    channels = {"channels": np.array(["1:z", "2:z", "3:z", "4:z"])}
    assert set(save(tmp_path / "b", "npz", WHOLE | channels)[0].shape) == {"1:z", "2:z", "3:z", "4:z"}


@pytest.mark.parametrize(("changes", "said"), [
    ({"Xi": XI * 100}, "Xi not taken: above critical, or in percent"),
    ({"Phi": PHI[:3]}, "square shapes read as channels x modes"),
    ({"Fn_cov": FN}, "Fn_cov not taken: a variance or a relative one"),
])  # fmt: skip
def test_what_has_two_readings_is_not_taken_and_noted(tmp_path, changes, said):
    arrays = {name: values for name, values in WHOLE.items() if "std" not in name or "Fn_cov" not in changes}
    for mode in save(tmp_path / "a", "npz", arrays | changes):
        assert said in mode.notes
        assert mode.damping_ratio is None or "Xi" not in said
        assert mode.frequency_sd_hz is None or "cov" not in said
