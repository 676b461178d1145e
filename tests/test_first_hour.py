"""Newcomers' first runs as `benchmarks.first_hour` types them: what is refused is mended by what the message says."""

import pytest
from benchmarks.first_hour import KINDS, ROUNDS, SLIPS, first_hour, remedied


def test_forty_newcomers_are_eight_files_by_five_slips():
    assert (len(KINDS), len(SLIPS)) == (8, 5)


@pytest.mark.parametrize(
    ("row", "message", "mended"),
    [
        ("length_mm = 383,0", "length_mm: found; expected; write 383.0 with a point", "length_mm = 383.0"),
        ("a = { radius_mm = 1 }", "a.radius_mm: unknown; a; write diameter_mm = 2, a", "a = { diameter_mm = 2 }"),
        ('dofs = "1:y, 1:rz"', 'dofs: found; expected; write for example dofs = ["4:y"]', 'dofs = ["1:y", "1:rz"]'),
        ("length_mm = 3", "length_mm: found; expected; think again", "length_mm = 3"),
    ],
)  # fmt: skip
def test_a_newcomer_does_what_the_remedy_says_and_no_more(row, message, mended):
    assert remedied(f"# first\n{row}\n", f"jointbayes: my_case.toml:2: {message}") == f"# first\n{mended}\n"


@pytest.mark.whole
def test_a_sample_has_a_case_that_validates_after_one_round_and_one_of_them_a_report():
    assert [newcomer.rounds for newcomer in first_hour(["tip.csv", "hit.csv", "hits.tdms"], short=True)] == [1] * 15
    (whole,) = first_hour(["tip.uff"], ["decimal comma"])
    assert whole.rounds == 1, whole.said


@pytest.mark.science
@pytest.mark.long
def test_every_newcomer_has_a_report_within_two_rounds():
    assert [n.said for n in first_hour() if n.rounds is None or n.rounds > ROUNDS] == []
