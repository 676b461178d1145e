"""Every stage ends: after its processor time what there is is kept and reported as not settled."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

import jointbayes as jb
from jointbayes.identification import ModeSearch, first_starts, search_further
from jointbayes.posterior.next_step import advice
from jointbayes.progress import BUDGET_S, Budget, usual_budget_s
from jointbayes.report.sections.trust import _calculation
from jointbayes.sampling import Proposal, StudentT, run_adapted, run_ensembles
from jointbayes.sampling.coordinate_maps import Identity
from tests.conftest import cheap_text, edited
from tests.one_line import refused

ALMOST_NONE = 1e-9  # s


def gaussian(theta):
    return -0.5 * (theta**2).sum(axis=1)


def start(rng):
    return rng.normal(size=(4, 8, 2))


def test_a_budget_is_spent_when_its_time_has_passed():
    assert Budget(ALMOST_NONE).is_spent
    assert not Budget().is_spent
    assert str(Budget()) == f"stopped after {BUDGET_S:g} s of processor time (budget_s)"
    refused(lambda: jb.SamplerSettings(budget_s=0.0), jb.SamplingError, "budget_s: found 0")


def test_the_budget_grows_with_the_unknowns_unless_it_is_stated():
    assert (usual_budget_s(12), usual_budget_s(13)) == (120.0, 130.0)
    assert str(jb.SamplerSettings().budget(36)) == "stopped after 360 s of processor time (budget_s)"
    assert str(jb.SamplerSettings(budget_s=7.0).budget(36)) == "stopped after 7 s of processor time (budget_s)"


def test_walkers_stop_at_the_next_check_and_say_why():
    settings = jb.SamplerSettings(walkers=8, max_steps=2000, budget_s=ALMOST_NONE)
    chains = run_ensembles(gaussian, start(np.random.default_rng(1)), np.random.default_rng(1), settings)
    assert not chains.converged
    assert chains.steps == chains.history[-1].step == settings.check_every
    assert chains.reason.startswith("not converged after 50 steps (limit 2000)")
    assert chains.reason.endswith("; stopped after 1e-09 s of processor time (budget_s)")


def test_a_run_that_settles_in_its_time_is_the_same_whatever_the_budget():
    seeded = [start(np.random.default_rng(1)), np.random.default_rng(1)]
    settings = jb.SamplerSettings(walkers=8, max_steps=4000)
    chains = run_ensembles(gaussian, *seeded, settings)
    other = run_ensembles(
        gaussian, start(np.random.default_rng(1)), np.random.default_rng(1), replace(settings, budget_s=60.0)
    )
    assert chains.converged
    assert "budget_s" not in chains.reason
    np.testing.assert_array_equal(chains.theta, other.theta)


def test_no_further_stage_begins_once_the_time_is_spent():
    rng = np.random.default_rng(2)
    proposal = Proposal(StudentT(np.zeros(2), np.eye(2), 5.0), 0.4, 0)  # so poor that it explores first
    settings = jb.SamplerSettings(walkers=8, max_steps=20_000, budget_s=ALMOST_NONE)
    chains, _ = run_adapted(gaussian, start(rng), rng, settings, systems=[Identity()], proposal=proposal)
    assert (chains.discarded, chains.steps) == (0, settings.check_every)
    assert chains.reason.endswith("(budget_s)")


def test_a_search_ends_with_the_best_that_it_has(cheap_case):
    data, told = cheap_case.problem.test.data, []
    wrong = replace(data, frf=replace(data.frf, values=data.frf.values[::-1]))  # nothing explains it: starts disagree
    problem = cheap_case.problem.with_test(data=wrong)
    search = ModeSearch(problem.log_posterior, budget=Budget(ALMOST_NONE))
    search.climb(first_starts(problem, 1))
    assert search_further(search, problem, 1, told.append).rounds == 0
    assert np.isfinite(search.estimate().log_posterior)
    assert any("stopped after 1e-09 s of processor time" in str(progress) for progress in told)


def test_a_run_out_of_time_is_reported_with_its_draws(cheap_case):
    case = jb.case_from_text("cheap", edited(cheap_text(), ("[sampling]", "[sampling]\nbudget_s = 7")))
    assert case.sampler.budget_s == 7
    posterior = jb.sample(case, seed=1, settings=replace(case.sampler, budget_s=ALMOST_NONE))
    assert not posterior.converged
    assert "(budget_s)" in posterior.reason
    assert len(posterior.theta) > 0
    inputs = SimpleNamespace(posterior=posterior, summary=posterior.summary())
    assert advice(posterior, ()) == "Raise budget_s in [sampling] and run again."
    assert "[sampling] budget_s" in _calculation(inputs).text
