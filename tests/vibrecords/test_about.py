"""What the heads of files say of the test: specimen, day, operator, instruments; nothing that is not plain."""

import numpy as np
import pytest
from benchmarks.written_files import write_records
from nptdms import ChannelObject, RootObject, TdmsWriter

from vibrecords.formats.about import about_file
from vibrecords.records import FrfRecord


def table(path, *head):
    path.write_text("\n".join([*head, "Time (s),force (N),acc (m/s^2)", "0,0,0", "0.001,1,0"]), encoding="utf-8")
    return path


def test_lines_above_a_table(tmp_path):
    head = ("# Specimen: Clamp 12", "Operator,A. Miller", "Date\t2026/11/25", "# Analyser = SCADAS 305")
    assert about_file(table(tmp_path / "a.csv", *head)) == {
        "specimen": "Clamp 12", "operator": "A. Miller", "date": "2026-11-25", "instruments": "SCADAS 305",
    }  # fmt: skip
    assert about_file(table(tmp_path / "b.csv")) == {}


@pytest.mark.parametrize(
    ("day", "read"),
    [
        ("2026-11-25T08:00:01", "2026-11-25"),
        ("25-Nov-26 08:00:01", "2026-11-25"),
        ("25.11.2026", "2026-11-25"),
        ("25 November 2026", "2026-11-25"),
        ("03/04/2026", ""),  # March or April
        ("yesterday", ""),
    ],
)
def test_a_day_is_read_where_its_order_is_plain(tmp_path, day, read):
    assert about_file(table(tmp_path / "a.csv", f"Date: {day}")).get("date", "") == read


def test_labview_text(tmp_path):
    head = "LabVIEW Measurement\t\nSeparator\tTab\nOperator\tA. Miller\nDate\t2026/11/25\nTime\t08:00:00\n"
    (tmp_path / "a.lvm").write_text(f"{head}***End_of_Header***\t\n", encoding="utf-8")
    assert about_file(tmp_path / "a.lvm") == {"operator": "A. Miller", "date": "2026-11-25"}


def test_tdms(tmp_path):
    told = {"Operator": "A. Miller", "datetime": np.datetime64("2026-11-25T08:00"), "serial_number": "0471"}
    told |= {"name": "x"}
    with TdmsWriter(str(tmp_path / "a.tdms")) as writer:
        writer.write_segment([RootObject(told), ChannelObject("g", "c", np.zeros(3))])
    assert about_file(tmp_path / "a.tdms") == {"operator": "A. Miller", "date": "2026-11-25", "specimen": "0471"}


def test_universal_files(tmp_path):
    lines = np.arange(1.0, 9.0)
    write_records([FrfRecord("1:1:Z+", "1:1:Z+", lines, lines + 0j, "receptance", "m/N")], tmp_path / "a.uff", "uff58")
    assert about_file(tmp_path / "a.uff") == {}  # the name of the program is no specimen
    text = (tmp_path / "a.uff").read_text(encoding="utf-8")
    head = ["Clamp 12", "NONE", "SomeLab 3", "25-Nov-26 08:00:00", "NONE", "NONE", "NONE"]
    begin = text.index("jointbayes")
    end = text.index("    -1", begin)
    (tmp_path / "b.uff").write_text(text[:begin] + "\n".join(head) + "\n" + text[end:], encoding="utf-8")
    assert about_file(tmp_path / "b.uff") == {"specimen": "Clamp 12", "date": "2026-11-25"}
