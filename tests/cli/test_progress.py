"""What commands print of their progress where nobody looks at a terminal."""

from types import SimpleNamespace

import pytest

import jointbayes as jb
from jointbayes.cli import progress_display as progress


def counted(stage, done, elapsed=0.0):
    return jb.Progress(stage, done=done, total=9, unit="cases", elapsed_seconds=elapsed)


@pytest.mark.parametrize(
    ("told", "text"),
    [
        (jb.Progress("drawing figures"), "drawing figures"),
        (jb.Progress("premises", "no room"), "premises: no room"),
        (counted("sampling", 0), "sampling: 0 of 9 cases"),
        (counted("sampling", 3, 50.0), "sampling: 3 of 9 cases, about 2 min left"),
        (jb.Progress("sampling", "1 bad", 3, 9, "cases", 2, 60.0), "sampling: 3 of 9 cases, 1 bad, about 6 min left"),
        (jb.Progress("sampling", "", 2, 9, "cases", 2, 60.0), "sampling: 2 of 9 cases"),
        (counted("sampling", 1, 3600.0), "sampling: 1 of 9 cases, about 8.0 h left"),
    ],
)  # fmt: skip
def test_progress_as_text_says_what_is_counted_and_how_long_the_rest_takes(told, text):
    assert str(told) == text


def test_counts_are_printed_as_a_stage_begins_and_ends_and_now_and_then(monkeypatch, capsys):
    clock = iter([0.0, 1.0, 6.0, 7.0, 400.0, 405.0, 407.0, 408.0])
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    with progress.show_progress() as report:
        for done, elapsed in ((0, 0.0), (1, 1.0), (2, 6.0), (3, 7.0)):
            report(counted("sampling", done, elapsed))
        for done, elapsed in ((4, 400.0), (5, 405.0), (6, 407.0), (9, 408.0)):
            report(counted("sampling", done, elapsed))
    shown = [int(line.split()[1]) for line in capsys.readouterr().err.splitlines()]
    assert shown == [0, 2, 4, 6, 9]  # of a long stage less often: 405 s after its beginning not again after 5 s
