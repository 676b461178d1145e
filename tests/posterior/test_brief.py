"""A row of a table of cases says what the summary says, and a small file is still a posterior."""

import math

import numpy as np
import pytest

import jointbayes as jb
from tests.conftest import FEW_STEPS, cheap_text


@pytest.fixture(scope="module")
def uncertain():
    text = cheap_text() + "\n[uncertain.gain]\nsd_percent = 1.0\n"
    return jb.sample(jb.case_from_text("uncertain", text), seed=1, settings=FEW_STEPS)


@pytest.mark.parametrize(
    "which", ["cheap_posterior", "frequency_posterior", pytest.param("uncertain", marks=pytest.mark.whole)]
)
def test_a_brief_row_has_the_numbers_of_the_summary(request, which):
    posterior = request.getfixturevalue(which)
    row, numbers = posterior.brief(), posterior.summary().to_json()
    for name, stated in (numbers["parameters"] | numbers["nuisances"]).items():
        assert [row[f"{name}.low95"], row[f"{name}.high95"]] == stated["interval95"]
        for column in ("unit", "map", "median", "sd_log", "contraction"):
            assert row[f"{name}.{column}"] == stated[column]
        assert row[f"{name}.verdict"] == stated.get("verdict")
        assert [row.get(f"{name}.printed_{end}95") for end in ("low", "high")] == stated.get("printed95", [None] * 2)
    for column in ("seed", "converged", "reason"):
        assert row[column] == numbers[column]
    assert row["explains"] == numbers["check"]["explains"]
    assert not any(isinstance(cell, float) and not math.isfinite(cell) for cell in row.values())


def test_what_is_said_of_a_quantity_besides_the_joint_is_that_of_its_logarithm(uncertain):
    said = uncertain.summary().nuisances["gain"]
    values, before = uncertain.values("gain"), uncertain.prior_values("gain")
    assert said.sd_log == pytest.approx(np.log(values).std())
    assert said.contraction == pytest.approx(1 - np.log(values).var() / np.log(before).var())
    assert said.interval95 == pytest.approx(np.quantile(values, [0.025, 0.975]))
    assert said.prior_interval95 == pytest.approx(np.quantile(before, [0.025, 0.975]))


@pytest.mark.parametrize(
    "which", ["cheap_posterior", "frequency_posterior", pytest.param("uncertain", marks=pytest.mark.whole)]
)
def test_the_misfit_p_value_falls_below_its_level_where_there_is_a_misfit(request, which):
    check = request.getfixturevalue(which).check
    assert (check.misfit_p_value < 0.01) == (check.finding == "misfit")
    assert 0 <= check.misfit_p_value <= 1


@pytest.mark.whole
def test_a_file_of_fewer_draws_holds_some_of_them_and_gives_nearly_the_same_verdicts(cheap_posterior, tmp_path):
    small = cheap_posterior.with_fewer_draws(2000)
    small.save(tmp_path / "small.nc")
    cheap_posterior.save(tmp_path / "all.nc")
    back = jb.load_posterior(tmp_path / "small.nc")
    assert 500 < len(back.theta) <= 2000
    assert (tmp_path / "small.nc").stat().st_size < (tmp_path / "all.nc").stat().st_size
    every = cheap_posterior.values("k12").shape[1] // back.values("k12").shape[1]
    assert every > 1
    for name in cheap_posterior.stiffness_names:
        assert np.isin(back.values(name), cheap_posterior.values(name)).all()
        assert back.values(name).shape[0] == cheap_posterior.values(name).shape[0]  # of every walker
        assert back.interval(name) == pytest.approx(cheap_posterior.interval(name), rel=0.2)
        assert back.verdict(name).verdict == cheap_posterior.verdict(name).verdict
    assert np.array_equal(back.log_density, small.log_density)


def test_no_fewer_draws_than_asked_for_are_left_alone(cheap_posterior):
    assert np.array_equal(cheap_posterior.with_fewer_draws(10**9).theta, cheap_posterior.theta)
