"""LabVIEW's text files, TDMS and workbooks: what is in them, and the same as lvm_read and npTDMS read."""

import io

import lvm_read
import nptdms
import numpy as np
import openpyxl
import pytest

from tests.vibrecords.made_files import STEP, clock, head, lvm, tdms
from tests.vibrecords.reading import A, B, F, G, H, T, layouts, require
from tests.vibrecords.test_text_layouts import frf, read, time
from vibrecords.errors import MeasurementError
from vibrecords.formats import detect_format, iter_records
from vibrecords.records import TimeRecord

NONE = [None] * 16
FORCE, TIP = time("Force", A, "force"), time("Tip", G * B, "acceleration", G)
LVM = {
    "X goes on":
        (lvm(["Force"], [np.arange(32) / 2048, np.tile(A, 2)], head(["N"])), [time("Force", np.tile(A, 2), "force")]),
    "a shorter channel":
        (lvm(["Force", "Tip"], [T, A, B[:9]], head(["N", "g"])),
        [FORCE, time("Tip", np.append(G * B[:9], [np.nan] * 7), "acceleration", G)]),
    "CR LF": (lvm(["Force", "Tip"], [T, A, B], head(["N", "g"])).replace("\n", "\r\n"), [FORCE, TIP]),
}  # fmt: skip


@pytest.mark.parametrize("name", LVM)
def test_labview_text(tmp_path, name):
    content, expected = LVM[name]
    require(read(tmp_path, content), expected)


LVM |= {name: each for name, each in layouts().items() if name.startswith("LabVIEW")}
#: What lvm_read has no numbers of, or stops at.
UNREAD = ("no decimal sign stated", "separated by commas", "a special block", "two blocks apart")


@pytest.mark.parametrize("name", [name for name in LVM if name.removeprefix("LabVIEW, ") not in UNREAD])
def test_labview_text_is_as_lvm_read_reads_it(tmp_path, name):
    records = read(tmp_path, LVM[name][0])
    content = lvm_read.read_str(LVM[name][0])
    factors = {"g": G}
    found: dict[str, list] = {}
    for record in records:
        if isinstance(record, TimeRecord):
            found.setdefault(record.channel, []).append(record.values / factors.get(record.unit, 1.0))
    columns: dict[str, list] = {}
    for s in range(content["Segments"]):
        data, names = content[s]["data"], content[s]["Channel names"]
        for channel, values in zip(names, np.asarray(data).T, strict=False):
            columns.setdefault(channel, []).append(values)
    for channel, parts in found.items():
        values, oracle = np.concatenate(parts), np.concatenate(columns[channel])
        np.testing.assert_allclose(values, oracle[: values.size], rtol=1e-12)
        assert np.isnan(oracle[values.size :]).all()
    assert found or any(word in LVM[name][0] for word in ("FFT", "Real", "Magnitude"))


def test_an_instant_printed_twice_begins_no_second_hit(tmp_path):
    twice = np.where(np.arange(16) == 8, T[7], T)
    with pytest.raises(MeasurementError, match=r"not evenly spaced: a step of 0 s behind 0\.00341797 s"):
        read(tmp_path, lvm(["Force"], [twice, A], head(["N"])))


# ---- TDMS


TDMS = {
    "waveforms": ({"Test": [("Force", A, clock("N")), ("Tip", B, clock("g"))]}, [FORCE, TIP]),
    "groups of the same channels":
        ({"Hit 1": [("Force", A, clock("N"))], "Hit 2": [("Force", B, clock("N"))]},
        [time("Force", A, "force", hit=1), time("Force", B, "force", hit=2)]),
    "a channel of time": ({"Test": [("Time", T, {}), ("Force", A, {"NI_UnitDescription": "Newtons"})]}, [FORCE]),
    "two clocks":
        ({"Test": [("Force", A, clock("N")), ("Tip", B[:8], clock("g", 2 * STEP))]},
        [FORCE, time("Tip", G * B[:8], "acceleration", G, sample_rate_hz=1024.0)]),
    "a complex FRF":
        ({"FRF": [("tip / hammer", H, clock("m/s", 2.5, wf_start_offset=20.0, wf_xunit_string="Hz"))]},
        [frf("tip", "hammer", factor=None)]),
    "whole numbers with a scale":
        ({"Test":
        [("Force", np.arange(16, dtype=np.int16),
        clock("N") | {"NI_Number_Of_Scales": np.uint32(1), "NI_Scaling_Status": "unscaled", "NI_Scale[0]_Scale_Type":
        "Linear", "NI_Scale[0]_Linear_Slope": 0.5, "NI_Scale[0]_Linear_Y_Intercept": 1.0,
        "NI_Scale[0]_Linear_Input_Source": np.uint32(0xFFFFFFFF)})]},
        [time("Force", 1 + 0.5 * np.arange(16), "force")]),
    "volts": ({"Test": [("ai0", A, clock("V"))]}, [time("ai0", A, factor=None)]),
}  # fmt: skip


@pytest.mark.parametrize("name", TDMS)
def test_tdms(tmp_path, name):
    groups, expected = TDMS[name]
    require(read(tmp_path, tdms(groups)), expected)


def test_tdms_is_as_nptdms_reads_it(tmp_path):
    for groups, _ in TDMS.values():
        records = read(tmp_path, tdms(groups))
        file = nptdms.TdmsFile.read(tmp_path / "measurement")
        found = [r for r in records if isinstance(r, TimeRecord)]
        channels = [c for g in file.groups() for c in g.channels() if c.name != "Time"]
        for record, channel in zip(found, channels, strict=False):
            np.testing.assert_allclose(record.values, (record.factor or 1) * channel[:], rtol=1e-12)


# ---- workbooks


def xlsx(**sheets):
    workbook = openpyxl.Workbook()
    workbook.remove(workbook.active)
    for title, cells in sheets.items():
        sheet = workbook.create_sheet(title)
        for row in cells:
            sheet.append(row)
    file = io.BytesIO()
    workbook.save(file)
    return file.getvalue()


def stack(names, *columns):
    return [names, *np.column_stack(columns).tolist()]


XLSX = {
    "an FRF": (
        {"FRF": stack(["Frequency [Hz]", "Real A / B [g/N]", "Imag A / B [g/N]"], F, H.real, H.imag)},
        [frf("A", "B", G * H, "accelerance", G)],
    ),
    "a title, a row of units, a column that is empty": (
        {"Data": [["Test 12"], ["Operator", "Smith"], [], [None, "Time", "Force"], [None, "ms", "N"],
                  *([None, 1e3 * t, a] for t, a in zip(T.tolist(), A.tolist(), strict=True))]},
        [FORCE],
    ),
    "the second sheet": (
        {"Cover": [["Dear reader"], ["see the next sheet"]], "Data": stack(["Zeit [s]", "Kraft [N]"], T, A)},
        [time("Kraft", A, "force")],
    ),
    "without a header": ({"a": np.column_stack([T, A]).tolist()}, [time("column 2", A)]),
}  # fmt: skip


@pytest.mark.parametrize("name", XLSX)
def test_workbooks(tmp_path, name):
    sheets, expected = XLSX[name]
    content = xlsx(**sheets)
    require(read(tmp_path, content), expected)
    assert detect_format(tmp_path / "measurement") == "xlsx"
    assert next(iter(iter_records(tmp_path / "measurement"))).notes[0].startswith("sheet ")
