"""What the data cannot see keeps its prior, and the verdict says so."""

import numpy as np
import pytest
from scipy import stats

import jointbayes as jb
from tests.case.refusal_rows import parts_named
from tests.conftest import cheap_text, edited

pytestmark = pytest.mark.science

PICKED = 900
#: Of a p-value, below which the draws are not those of the prior: chance goes below it once in a thousand.
LEVEL = 1e-3

#: About the first mode, well below the second: it sees neither 2 % of shear coefficient nor how the third is damped.
BAND = (
    ("f_min_hz = 20.0", "f_min_hz = 100.0"),
    ("f_max_hz = 2500.0", "f_max_hz = 300.0"),
    ("f_step_hz = 10.0", "f_step_hz = 2.0"),
)
UNCERTAIN = parts_named("rooms")["science/unseen uncertain"]


def rigid_text():
    """A case with a joint whose translation is, a priori, too stiff for any FRF to tell."""
    text = edited(
        cheap_text(),
        *BAND,
        # the truth lies inside the priors below
        ("k11 = 5.05e9", "k11 = 1e14"),
        ("k12 = 3.44e7", "k12 = 1e5"),
        ("relative = 0.008", "relative = 0.03"),
        ("floor = 0.0016", "floor = 0.1"),
        ("ratio = 0.01 ", "ratio = [0.01, 0.01, 0.01] "),
    )
    head, rest = text.split("[prior.k11]")
    _, tail = rest.split("[data]", 1)
    priors = "".join(
        f'[prior.{name}]\ndistribution = "log_uniform"\nlow = {low}\nhigh = {high}\n\n'
        for name, low, high in (("k11", 1e13, 1e15), ("k12", 1e4, 1e6), ("k22", 1e6, 4e6))
    )
    return head + priors + "[data]" + tail + UNCERTAIN


@pytest.fixture(scope="module")
def posterior():
    rough = {"tau_factor": 8.0, "tau_tolerance": 0.1, "end_tolerance": 0.1}
    settings = jb.SamplerSettings(walkers=48, check_every=25, max_steps=2000, **rough)
    found = jb.sample(jb.case_from_text("rigid", rigid_text()), seed=2, settings=settings)
    assert found.converged
    return found


def p_value(posterior, name):
    """Of the Kolmogorov-Smirnov test of nearly independent draws against the prior."""
    column = posterior.problem.prior.names.index(name)
    draws = np.random.default_rng(7).choice(posterior.theta[:, column], PICKED, replace=False)
    return stats.kstest(draws, posterior.problem.prior.all_marginals[column].cdf).pvalue


@pytest.mark.parametrize("name", ["k11", "k12", "shear_coefficient", "damping_ratio_3"])
def test_what_the_data_cannot_see_keeps_its_prior_and_is_not_identified(posterior, name):
    assert p_value(posterior, name) > LEVEL
    known = posterior.verdict(name)
    assert known.contraction < 0.1
    assert known.cls == "not identified"


@pytest.mark.parametrize("name", ["k22", "damping_ratio_1"])
def test_what_the_data_see_does_not_keep_it(posterior, name):
    assert p_value(posterior, name) < 1e-6
    assert posterior.verdict(name).cls != "not identified"


def test_a_prior_a_tenth_narrower_would_be_noticed(posterior):
    # the test above has the power to tell a contraction that the verdict would still call none
    rng = np.random.default_rng(1)
    law = stats.norm(0, 0.1)
    found = [stats.kstest(rng.normal(0, 0.075, PICKED), law.cdf).pvalue for _ in range(100)]
    assert np.mean(np.array(found) < LEVEL) > 0.8
