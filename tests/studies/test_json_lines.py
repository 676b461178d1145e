"""Lines of JSON survive whatever ends the process that writes them."""

import datetime
from dataclasses import dataclass

import pytest

from jointbayes.errors import CaseError, WriteError
from jointbayes.studies.study_directory import append_line, kept_lines, read_lines
from tests.one_line import refused


def test_lines_read_back_as_they_were_and_dates_as_text(tmp_path):
    assert read_lines(tmp_path / "lines") == []
    append_line(tmp_path / "lines", {"a": [1.5, None], "name": "ü\udc9b\n"})
    append_line(tmp_path / "lines", {"day": datetime.datetime(2026, 3, 31, 14, 5)})
    first, second, end = read_lines(tmp_path / "lines")
    assert (first, second) == ({"a": [1.5, None], "name": "ü\udc9b\n"}, {"day": "2026-03-31T14:05:00"})
    assert end is None


def test_line_that_was_cut_off_takes_no_other_with_it(tmp_path):
    append_line(tmp_path / "lines", {"i": 0})
    for cut in (b'{"i": 1', b"\xff"):
        with (tmp_path / "lines").open("ab") as stream:
            stream.write(cut)
        append_line(tmp_path / "lines", {"i": 2})
    assert [line for line in read_lines(tmp_path / "lines") if line is not None] == [{"i": 0}, {"i": 2}, {"i": 2}]


def test_line_that_cannot_be_written_is_an_error_in_a_line(tmp_path):
    refused(lambda: append_line(tmp_path / "missing" / "lines", {}), WriteError, "expected a place with room")


@dataclass(frozen=True)
class Line:
    i: int


@pytest.mark.parametrize("damage", [b"", b"\x00\xff", b"[1, 2]\n{}\n", b"{}\n", b'{"seed": 1}\nnull\n', b'{"se\n{}\n'])
def test_a_damaged_file_of_a_study_is_begun_anew_or_refused_in_a_line(tmp_path, damage):
    file = tmp_path / "lines"
    file.write_bytes(damage)
    if damage.endswith(b"\n"):  # a first line of something else, or a damaged one before whole ones
        with pytest.raises(CaseError, match="expected those of this plan"):
            kept_lines(file, {"seed": "2"}, Line, "simulations", "plan")
        assert file.read_bytes() == damage
    else:
        for _ in range(2):  # what is begun anew is whole
            assert kept_lines(file, {"seed": "2"}, Line, "simulations", "plan") == []
