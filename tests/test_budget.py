"""Every stage ends: after its evaluations what there is is kept and reported as not settled, on any machine alike."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.identification import ModeSearch, first_starts, search_further
from jointbayes.inference import Landing
from jointbayes.posterior.next_step import advice
from jointbayes.progress import EVALUATIONS, Budget
from jointbayes.report.sections.lead import _calculation
from jointbayes.sampling import draw, run_ensembles, sampler
from jointbayes.sampling.coordinate_maps import Identity
from tests.conftest import cheap_text, edited
from tests.one_line import refused
from tests.sampling.test_origins import SHEETS

ALMOST_NONE = 1  # evaluations


def gaussian(theta):
    return -0.5 * (theta**2).sum(axis=1)


def start(rng):
    return rng.normal(size=(4, 8, 2))


def test_a_budget_is_spent_by_evaluations():
    budget = Budget(100)
    budget.spend(99)
    assert not budget.is_spent
    budget.spend(1)
    assert budget.is_spent
    assert str(Budget()) == f"stopped after {EVALUATIONS} evaluations of the density (max_evaluations)"
    refused(lambda: jb.SamplerSettings(max_evaluations=0), jb.SamplingError, "max_evaluations: found 0")
    refused(lambda: jb.SamplerSettings(max_evaluations=1.5), jb.SamplingError, "max_evaluations: found 1.5")


def test_the_budget_grows_with_the_unknowns_unless_it_is_stated():
    assert (jb.SamplerSettings().budget(12).most, jb.SamplerSettings().budget(13).most) == (EVALUATIONS, 4_290_000)
    assert jb.SamplerSettings(max_evaluations=7).budget(36).most == 7


@pytest.mark.parametrize("evaluations", [1000, 10_000_000])
def test_walkers_on_a_slow_machine_make_the_same_draws(evaluations):
    """Whether the budget ends them or the stop rule, time decides nothing."""

    def slowly(theta):
        time.sleep(0.0003)
        return gaussian(theta)

    settings = jb.SamplerSettings(walkers=8, max_steps=1000, max_evaluations=evaluations, tau_factor=5.0)
    fast, slow = (
        run_ensembles(density, start(np.random.default_rng(1)), np.random.default_rng(1), settings)
        for density in (gaussian, slowly)
    )
    np.testing.assert_array_equal(fast.theta, slow.theta)
    assert fast.reason == slow.reason
    assert ("(max_evaluations)" in fast.reason) == (evaluations == 1000)


def test_a_run_on_a_slow_machine_makes_the_same_draws_from_its_origins_on():
    class Slow(type(SHEETS["two modes"])):
        def __call__(self, theta):
            time.sleep(0.002)
            return super().__call__(theta)

    def drawn(kind, most):
        sheet = kind(SHEETS["two modes"].white, *SHEETS["two modes"].prior.support)
        settings = jb.SamplerSettings(walkers=8, max_evaluations=most, tau_factor=10.0, end_tolerance=0.1)
        rng = np.random.default_rng(1)
        return draw(Landing(sheet), np.array([[1.0, 3.0]]), rng, settings, systems=[Identity()])[0]

    # a budget that ends while the origins look, and one that is never spent
    for most in (10_000, 10_000_000):
        fast, slow = (drawn(kind, most) for kind in (type(SHEETS["two modes"]), Slow))
        assert fast.converged == slow.converged == (most > 10_000)
        np.testing.assert_array_equal(fast.theta, slow.theta)


def test_walkers_stop_at_the_next_check_and_say_why():
    settings = jb.SamplerSettings(walkers=8, max_steps=2000, max_evaluations=ALMOST_NONE)
    chains = run_ensembles(gaussian, start(np.random.default_rng(1)), np.random.default_rng(1), settings)
    assert not chains.converged
    assert chains.steps == chains.history[-1].step == settings.check_every
    assert chains.reason.startswith("not converged after 50 steps (limit 2000)")
    assert chains.reason.endswith("; stopped after 1 evaluations of the density (max_evaluations)")


def test_a_run_that_settles_is_the_same_whatever_the_budget():
    seeded = [start(np.random.default_rng(1)), np.random.default_rng(1)]
    settings = jb.SamplerSettings(walkers=8, max_steps=4000)
    chains = run_ensembles(gaussian, *seeded, settings)
    other = run_ensembles(
        gaussian, start(np.random.default_rng(1)), np.random.default_rng(1), replace(settings, max_evaluations=10**9)
    )
    assert chains.converged
    assert "max_evaluations" not in chains.reason
    np.testing.assert_array_equal(chains.theta, other.theta)


def test_no_further_stage_begins_once_the_budget_is_spent(monkeypatch):
    monkeypatch.setattr(sampler, "_SLOW_TAU", 0.0)
    monkeypatch.setattr(sampler, "_STAGES", (50, 50))
    settings = jb.SamplerSettings(walkers=8, max_steps=20_000, max_evaluations=ALMOST_NONE)
    rng = np.random.default_rng(2)
    chains, _ = draw(Landing(SHEETS["banana"]), np.array([[1.0, 1.0]]), rng, settings, systems=[Identity()])
    assert (chains.discarded, chains.steps) == (0, settings.check_every)
    assert "(max_evaluations)" in chains.reason


def test_a_search_ends_with_the_best_that_it_has(cheap_case):
    data, told = cheap_case.problem.test.data, []
    wrong = replace(data, frf=replace(data.frf, values=data.frf.values[::-1]))  # nothing explains it: starts disagree
    problem = cheap_case.problem.with_test(data=wrong)
    search = ModeSearch(problem.log_posterior, budget=Budget(ALMOST_NONE))
    search.climb(first_starts(problem, 1))
    assert search_further(search, problem, 1, told.append).rounds == 0
    assert np.isfinite(search.estimate().log_posterior)
    assert any("stopped after 1 evaluations of the density" in str(progress) for progress in told)


def test_a_run_out_of_evaluations_is_reported_with_its_draws(cheap_case):
    case = jb.case_from_text("cheap", edited(cheap_text(), ("[sampling]", "[sampling]\nmax_evaluations = 7")))
    assert case.sampler.max_evaluations == 7
    posterior = jb.sample(case, seed=1, settings=replace(case.sampler, max_evaluations=ALMOST_NONE))
    assert not posterior.converged
    assert "(max_evaluations)" in posterior.reason
    assert len(posterior.theta) > 0
    inputs = SimpleNamespace(posterior=posterior, summary=posterior.summary())
    assert advice(posterior, ()) == "Raise max_evaluations in [sampling] and run again."
    assert "[sampling] max_evaluations" in _calculation(inputs)[1]
