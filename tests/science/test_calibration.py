"""A sample of `make science`: the published point lies in the 95 % region for most noise seeds."""

import re

import numpy as np
import pytest
from benchmarks.calibration import CASE, TABLE, analyse_many, table, with_noise_seed

from tests.conftest import CONFIGS


@pytest.fixture(scope="module")
def outcomes():
    return analyse_many(12)


def test_the_published_point_lies_in_the_95_per_cent_region(outcomes):
    # of 12 true coverages of 95 %, fewer than 9 happen once in 5000 times
    assert sum(o.level <= 0.95 for o in outcomes) >= 9
    # and the region is no blanket: levels spread as uniform numbers do
    assert 0.2 < np.mean([o.level for o in outcomes]) < 0.8


def test_every_noise_seed_converges_to_one_mode_with_k22_within_two_per_cent(outcomes):
    assert all(o.converged and o.mode_agrees for o in outcomes)
    assert max(abs(o.k22_error) for o in outcomes) < 0.02


def test_the_published_table_of_100_seeds_shows_90_to_99():
    page = TABLE.read_text(encoding="utf-8")
    inside, total = map(int, re.search(r"joint 95 % region \| (\d+) of (\d+)", page).groups())
    assert total == 100
    assert 90 <= inside <= 99


def test_the_seed_of_the_case_is_not_among_those_tested(outcomes):
    own = int(re.search(r"(?m)^seed = (\d+)[^\n]*\nadded", CASE.read_text()).group(1))
    assert own not in {o.noise_seed for o in outcomes}
    assert "12 noise seeds" in table(outcomes)
    assert CASE == CONFIGS / "clamped_beam.toml"
    assert with_noise_seed(CASE.read_text(), own) == CASE.read_text()
