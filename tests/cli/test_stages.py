"""The processor time of each stage of a run, which `--verbose` prints."""

import time
from types import SimpleNamespace

import pytest

from jointbayes.cli import progress_display
from jointbayes.cli.progress_display import say_stages, show_stage
from jointbayes.progress import Progress


@pytest.fixture
def said(monkeypatch):
    lines = []
    monkeypatch.setattr(progress_display, "_stages", [])
    monkeypatch.setattr(progress_display, "say", lambda text, err: lines.append(text))
    return lines


def busy(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


@pytest.mark.parametrize("verbose", [True, False])
def test_each_stage_is_told_once_with_its_time(said, monkeypatch, verbose):
    monkeypatch.setattr(progress_display, "manner", lambda: SimpleNamespace(quiet=True, verbose=verbose))
    for stage, seconds in (("judging", 0.03), ("sampling", 0.25), ("judging", 0.25)):
        show_stage(Progress(stage, "k11"))
        show_stage(Progress(stage, "k22"))
        busy(seconds)
    say_stages()
    times = {line.split("time  ")[1]: float(line.split()[0]) for line in said}
    assert list(times) == (["starting", "judging", "sampling"] if verbose else [])
    if verbose:
        assert times["starting"] > 0.1  # of this process
        assert times["sampling"] == pytest.approx(0.25, abs=0.11)
        assert times["judging"] == pytest.approx(0.28, abs=0.11)
