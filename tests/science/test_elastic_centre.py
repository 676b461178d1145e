"""A joint sampled from its elastic centre is the joint sampled by its stiffnesses, under one and the same prior."""

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.joint import ElasticCentre
from tests.case.refusal_rows import parts_named
from tests.conftest import cheap_text, edited

# An arm and a stiffness about the centre that hold nearly all of the posterior under the cheap case's own priors.
CENTRE = parts_named("rooms")["science/elastic_centre centre"]


@pytest.mark.science
def test_both_give_the_same_stiffnesses_once_their_priors_are_the_same(cheap_posterior):
    """Draws in the coordinates of the centre, weighted by the ratio of the priors over the stiffnesses."""
    stated = jb.case_from_text("stated", cheap_text())
    text = edited(cheap_text(), ('parametrisation = "log" ', 'parametrisation = "elastic_centre" '))
    start, end = text.index("[prior.k12]"), text.index("[data]")
    case = jb.case_from_text("centre", f"{text[:start]}{CENTRE}\n{text[end:]}")
    assert isinstance(case.problem.parametrisation, ElasticCentre)
    settings = jb.SamplerSettings(walkers=16, max_steps=1500, tau_factor=20, end_tolerance=0.03)
    posterior, expected = jb.sample(case, seed=1, settings=settings), cheap_posterior
    assert posterior.converged
    assert expected.converged

    logs, centre = jb.LogStiffness(), ElasticCentre()
    inside = logs.describes(posterior.stiffness)
    theta = logs.coordinates(posterior.stiffness[inside])
    slope = centre.log_slope(posterior.theta[inside]) - logs.log_slope(theta)
    log_weight = stated.problem.prior.log_density(theta) + slope
    log_weight -= case.problem.prior.log_density(posterior.theta[inside])
    weight = np.exp(log_weight - log_weight.max())
    effective = weight.sum() ** 2 / (weight**2).sum() / len(weight) * min(posterior.record.sampler["ess"].values())
    assert effective > 300
    picked = np.random.default_rng(2).choice(len(weight), size=20_000, p=weight / weight.sum())
    for i, name in enumerate(("k11", "k12", "k22")):
        here, there = np.log(posterior.stiffness[inside][picked, i]), np.log(expected.values(name).ravel())
        error = there.std() * np.sqrt(1 / effective + 1 / min(expected.record.sampler["ess"].values()))
        assert here.mean() == pytest.approx(there.mean(), abs=4 * error), name
        # the spread of the middle: that of all rests on a few draws far out
        widths = [np.diff(np.quantile(logs, [0.16, 0.84]))[0] for logs in (here, there)]
        assert widths[0] == pytest.approx(widths[1], rel=4 * error / there.std()), name
