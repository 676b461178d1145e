"""The watch over what a long-running process holds sees a leak, and none in runs one after the other."""

import tempfile
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.long import LIMITS, Held, excess, growth, watch

import jointbayes as jb
from tests.conftest import FEW_STEPS, cheap_text

pytestmark = pytest.mark.docs

NOTHING = Held(0, 0, 0, 0, 0, 0)
kept = []


def leak_objects(_):
    kept.append([[] for _ in range(10)])


def leak_memory(_):
    kept.append(np.ones(50_000))


def leak_files(_):
    kept.append(open("/dev/null"))  # noqa: SIM115 (left open on purpose)


@pytest.mark.long
@pytest.mark.parametrize(
    ("work", "what"), [(leak_objects, "objects"), (leak_memory, "memory_kb"), (leak_files, "files")]
)
def test_a_leak_is_seen(work, what, tmp_path):
    try:
        grown = growth(list(watch(work, 20, 2, tmp_path, points=10)))
    finally:
        for one in kept:
            getattr(one, "close", lambda: None)()
        kept.clear()
    assert what in " ".join(excess(grown))


def test_growth_is_the_slope_and_one_look_that_is_off_does_not_matter():
    looks = [(n, replace(NOTHING, memory_kb=100.0 + 3 * n)) for n in range(9)]
    looks[4] = (4, replace(NOTHING, memory_kb=1e6))
    assert (growth(looks).memory_kb, excess(NOTHING)) == (pytest.approx(3.0), ())


@pytest.mark.science
@pytest.mark.long
def test_posteriors_one_after_the_other_leave_nothing_behind(tmp_path, monkeypatch):
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    text = cheap_text()

    def work(seed):
        posterior = jb.sample(jb.case_from_text("cheap", text), seed=seed, settings=FEW_STEPS)
        posterior.summary()
        posterior.save(tmp_path / "posterior.nc")

    grown = growth(list(watch(work, 30, 10, place, points=15)))
    # of thirty runs the allocator's habits are a larger share than of a thousand
    assert excess(grown, replace(LIMITS, memory_kb=200.0)) == ()
