"""`progress=True`: a bar where tqdm is installed, lines where it is not, and never anything else."""

import sys
from types import ModuleType

import pytest

import jointbayes as jb
from jointbayes.progress import callback_of, tell_nobody
from tests.conftest import FEW_STEPS

STAGES = [
    jb.Progress("searching for the best fit"),
    jb.Progress("sampling", "R̂ = 1.1", done=50, total=200, unit="steps"),
    jb.Progress("sampling", "R̂ = 1.0", done=200, total=200, unit="steps"),
]


class Bar:
    """What is asked of a bar of tqdm."""

    made: list["Bar"]

    def __init__(self, desc, bar_format):
        self.desc, self.unit, self.n, self.total, self.closed, self.shown = f"{desc}: ", "it", 0, None, False, []
        self.start_t, self.bar_format = 7.0, bar_format
        self.made.append(self)

    def reset(self, total):
        self.n, self.total, self.start_t = 0, total, 99.0

    def set_postfix_str(self, text):
        self.shown.append((self.n, self.total, text))

    def close(self):
        self.closed = True


@pytest.fixture
def bars(monkeypatch):
    Bar.made = []
    module = ModuleType("tqdm.auto")
    module.tqdm = Bar
    monkeypatch.setitem(sys.modules, "tqdm", ModuleType("tqdm"))
    monkeypatch.setitem(sys.modules, "tqdm.auto", module)
    return Bar.made


def test_each_stage_is_a_bar_and_counts_as_it_is_told(bars):
    tell = callback_of(True)
    for progress in STAGES:
        tell(progress)
    first, second = bars
    assert (first.desc, first.shown, first.closed) == ("searching for the best fit: ", [(0, None, "")], True)
    assert first.bar_format == "{desc}: {elapsed}{postfix}"  # neither a share nor a unit where nothing is counted
    assert (second.unit, second.shown) == (" steps", [(50, 200, "R̂ = 1.1"), (200, 200, "R̂ = 1.0")])
    assert (second.start_t, second.bar_format) == (7.0, "")


def test_a_stage_that_is_over_is_a_whole_bar_even_if_it_took_fewer_steps(bars):
    tell = callback_of(True)
    tell(jb.Progress("searching for the best fit"))
    tell(jb.Progress("searching for the best fit", done=23, total=25, unit="starts"))
    tell(jb.Progress("searching for the best fit", "round 1"))
    tell(STAGES[1])
    assert (bars[0].shown, bars[0].n, bars[0].unit) == (
        [(0, None, ""), (23, 25, ""), (23, 25, "round 1")],
        25,
        " starts",
    )


@pytest.mark.whole
def test_a_run_shows_its_stages(bars, frequency_case):
    jb.sample(frequency_case, seed=1, settings=FEW_STEPS, progress=True)
    assert [bar.desc for bar in bars][-1] == "sampling: "
    n, total, _ = bars[-1].shown[-1]
    assert n == total


def test_without_tqdm_lines_are_printed(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "tqdm", None)
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    tell = callback_of(True)
    for progress in (STAGES[0], *STAGES):  # the first twice
        tell(progress)
    assert capsys.readouterr().out.splitlines() == [str(progress) for progress in STAGES]


def test_a_callback_stays_a_callback_and_none_is_silent():
    kept = []
    callback_of(kept.append)(STAGES[0])
    assert kept == STAGES[:1]
    assert callback_of(None) is callback_of(False) is tell_nobody
