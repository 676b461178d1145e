"""Numbers of the summary of quantities other than stiffnesses, and of the misfit."""

import numpy as np
import pytest

import jointbayes as jb
from tests.conftest import FEW_STEPS, cheap_text


@pytest.fixture(scope="module")
def uncertain():
    text = cheap_text() + "\n[uncertain.gain]\nsd_percent = 1.0\n"
    return jb.sample(jb.case_from_text("uncertain", text), seed=1, settings=FEW_STEPS)


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
