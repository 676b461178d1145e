"""Runs that fit their proposal anew, and the coordinates in which bent draws are straight."""

from dataclasses import replace

import numpy as np
import pytest
from emcee.ensemble import walkers_independent
from scipy import stats

from jointbayes.errors import SamplingError
from jointbayes.sampling import INTERVAL, Proposal, SamplerSettings, StudentT, fit_proposal, sampler
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.diagnostics import quantile_error
from jointbayes.sampling.distributions import first_mixture, most_likely_mixture
from jointbayes.sampling.ensemble import Streams
from jointbayes.sampling.sampler import run_adapted, run_ensembles

SETTINGS = SamplerSettings(walkers=24, max_steps=6000)
WIDTH = 0.02


def filament(theta):
    """x normal, y and z thin about x² and x y: a bent thread."""
    x, y, z = theta.T
    return -0.5 * (x**2 + ((y - x**2) / WIDTH) ** 2 + ((z - x * y) / WIDTH) ** 2)


def gaussian(theta):
    return -0.5 * (theta**2).sum(axis=1)


def exact(n, rng):
    x = rng.normal(size=n)
    y = x**2 + WIDTH * rng.normal(size=n)
    return np.column_stack([x, y, x * y + WIDTH * rng.normal(size=n)])


def of_one_half(rng):
    """A proposal for that part of the thread where x is positive, where it would be a good one."""
    draws = exact(20_000, rng)
    half = draws[draws[:, 0] > 0.2][:6000]
    weight = np.full(len(half), 1 / len(half))
    return Proposal(most_likely_mixture(first_mixture(half, weight, 12, rng), half, weight), 0.4, 0)


def adapted(density, start, proposal, settings=SETTINGS, seed=4, **more):
    rng = np.random.default_rng(seed)
    return run_adapted(density, start, rng, settings, systems=[Identity()], proposal=proposal, **more)


@pytest.mark.science
def test_a_run_whose_proposal_misses_half_the_density_converges_where_it_fits_it_anew_and_to_its_draws():
    rng = np.random.default_rng(3)
    proposal, start = of_one_half(rng), exact(4 * 24, rng).reshape(4, 24, 3)
    in_it = {"coordinates": proposal.coordinates, "proposal": proposal}
    plain = run_ensembles(filament, start, np.random.default_rng(4), replace(SETTINGS, max_steps=1200), **in_it)
    chains, last = adapted(filament, start, proposal)
    assert not plain.converged
    assert chains.converged
    assert chains.discarded + chains.steps <= plain.steps
    assert chains.discarded >= 500
    assert last.efficiency > 0.4
    assert f"{chains.discarded} earlier steps" in chains.reason
    assert chains.tau.max() < plain.tau.max() / 5
    x, y, z = np.random.default_rng(5).choice(chains.draws().theta.reshape(-1, 3), 800, replace=False).T
    assert stats.kstest(x, stats.norm.cdf).pvalue > 1e-3
    assert [np.std(y - x**2), np.std(z - x * y)] == pytest.approx([WIDTH] * 2, rel=0.1)


def test_a_run_that_converges_at_once_is_that_of_run_ensembles_bit_for_bit():
    rng = np.random.default_rng(1)
    proposal = fit_proposal(gaussian, [Identity()], [(np.zeros(2), np.eye(2))], rng)
    start, in_it = rng.normal(size=(4, 24, 2)), {"coordinates": proposal.coordinates, "proposal": proposal}
    plain = run_ensembles(gaussian, start, np.random.default_rng(4), SETTINGS, **in_it)
    chains, last = adapted(gaussian, start, proposal)
    assert chains.converged
    assert last is proposal
    assert chains.theta.tobytes() == plain.theta.tobytes()
    assert (chains.discarded, chains.reason, chains.evaluations) == (0, plain.reason, plain.evaluations)


def test_a_run_that_mixes_well_and_wants_more_steps_goes_on_as_it_is():
    rng = np.random.default_rng(1)
    fitted = Proposal(StudentT(np.zeros(2), np.eye(2), 5.0), 0.9, 0)
    start, settings = rng.normal(size=(4, 24, 2)), replace(SETTINGS, max_steps=800, end_tolerance=1e-4)
    chains, last = adapted(gaussian, start, fitted, settings, rng)
    assert not chains.converged
    assert last is fitted
    assert (chains.discarded, chains.steps) == (0, 800)


# ---- posteriors as thin as those where k12² comes up to k11 k22

THIN = 1e-10


def sheet(theta):
    """x normal about 20, y within 1e-10 of it."""
    x, y = theta.T
    return -0.5 * (((x - 20) / 0.01) ** 2 + ((y - x) / THIN) ** 2)


def on_sheet(rng, walkers=24):
    x = 20 + 0.01 * rng.normal(size=(4, walkers))
    return np.stack([x, x + THIN * rng.normal(size=x.shape)], axis=-1)


def test_walkers_on_a_sheet_of_1e_minus_10_go_on_from_stage_to_stage(monkeypatch):
    monkeypatch.setattr(sampler, "_STAGES", (100,))
    rng = np.random.default_rng(3)
    poor, start = Proposal(StudentT(np.full(2, 20.0), 1e-4 * np.eye(2), 5.0), 0.05, 0), on_sheet(rng)
    assert not any(walkers_independent(walkers) for walkers in start)  # by emcee's measure they have collapsed
    settings = replace(SETTINGS, max_steps=3000)
    monkeypatch.setattr(sampler, "_SLOW_TAU", 0.0)  # the first stage is never enough

    chains = adapted(sheet, start, poor, settings)[0]
    assert (chains.converged, chains.discarded) == (True, 100)
    x, y = chains.theta.reshape(-1, 2).T
    assert x.std() == pytest.approx(0.01, rel=0.1)
    assert (y - x).std() == pytest.approx(THIN, rel=0.1)


def test_walkers_that_have_all_met_end_a_run_without_a_verdict_and_no_start_is_such():
    one = np.ones((4, 24, 2))
    later = Streams.from_generator(np.random.default_rng(1)).with_stage(1)
    chains = run_ensembles(gaussian, one, later, replace(SETTINGS, max_steps=100))
    assert not chains.converged
    assert chains.reason.startswith("not converged after 100 steps")
    for start in (one, on_sheet(np.random.default_rng(1))[..., :1] * [1.0, 1.0]):
        with pytest.raises(SamplingError, match="do not span the 2 parameters"):
            run_ensembles(gaussian, start, np.random.default_rng(1), SETTINGS)


@pytest.mark.whole
@pytest.mark.parametrize(("limit", "fits"), [(100, 0), (590, 2), (1650, 5)])
def test_all_stages_together_make_no_more_steps_than_allowed_and_progress_counts_them(limit, fits, monkeypatch):
    rng, told, fitted = np.random.default_rng(3), [], []

    def as_poor(_density, _systems, proposal, draws, _rng):
        fitted.append(len(draws))
        return proposal

    monkeypatch.setattr(sampler, "refit_proposal", as_poor)  # what a stage ends with is dear and makes no step
    poor = Proposal(StudentT(np.full(3, 9.0), 1e-4 * np.eye(3), 5.0), 0.5, 0)
    start = exact(4 * 8, rng).reshape(4, 8, 3)
    settings = replace(SETTINGS, walkers=8, max_steps=limit, tau_factor=1e6)  # never converged
    chains, _ = adapted(filament, start, poor, settings, rng, progress=told.append)
    assert not chains.converged
    assert len(fitted) == fits
    assert chains.discarded + chains.steps == limit
    assert chains.evaluations >= 4 * 8 * limit
    steps = [one.done for one in told]
    assert steps == sorted(set(steps))
    assert steps[-1] == limit
    assert all(one.done <= one.total <= limit for one in told)
    assert np.all(np.diff([one.elapsed_seconds for one in told]) > 0)
    assert chains.seconds > 0


def broad_thread(theta):
    """A bent thread wide enough to be walked along; x is standard normal."""
    x, y, z = theta.T
    return -0.5 * (x**2 + ((y - x**2) / 0.1) ** 2 + ((z - x * y) / 0.1) ** 2)


def above(low, rng):
    """Draws of that thread with x above a limit."""
    x = rng.normal(size=8000)
    x = x[x > low][:6000]
    y = x**2 + 0.1 * rng.normal(size=x.size)
    return np.column_stack([x, y, x * y + 0.1 * rng.normal(size=x.size)])


def errors_of_ends(seed):
    """How far the two ends of x's 95 % interval are from the truth, in stated errors, of a run that knows no tail."""
    rng = np.random.default_rng(seed)
    draws = above(-1.2, rng)  # nothing of 11.5 % of the density: its own draws never see it
    weight = np.full(len(draws), 1 / len(draws))
    proposal = Proposal(most_likely_mixture(first_mixture(draws, weight, 12, rng), draws, weight), 0.5, 0)
    start = draws[: 4 * 24].reshape(4, 24, 3)
    chains, _ = adapted(broad_thread, start, proposal, SETTINGS, rng)
    assert chains.converged
    assert chains.discarded >= 800
    x = chains.theta[:, chains.held_burn_in :, :, 0]
    return [(np.quantile(x, p) - stats.norm.ppf(p)) / quantile_error(x, p) for p in INTERVAL]


@pytest.mark.science
@pytest.mark.long
def test_ends_of_intervals_scatter_as_stated_where_the_proposal_never_saw_the_tail():
    errors = np.array([errors_of_ends(seed) for seed in range(2)])
    # 4 figures of standard deviation 1; without the stages that explore the lower end is 30 stated errors off
    assert 0.4 < np.sqrt((errors**2).mean()) < 1.8


def test_a_converged_run_is_made_again_where_its_draws_lie_where_the_proposal_is_not(monkeypatch):
    start = np.random.default_rng(5).normal(size=(4, 24, 3))
    good = Proposal(StudentT(np.zeros(3), np.eye(3), 5.0), 0.9, 0)
    poor = Proposal(StudentT(np.array([2.0, 0.0, 0.0]), np.eye(3), 5.0), 0.9, 0)

    chains, last = adapted(gaussian, start, good, seed=6)
    assert last is good
    assert not sampler._misses_mass(good, chains)
    assert sampler._misses_mass(poor, chains)
    looks = iter([True, False])
    monkeypatch.setattr(sampler, "_misses_mass", lambda *_: next(looks))
    again, refitted = adapted(gaussian, start, good, seed=6)
    assert again.discarded == chains.steps
    assert refitted is not good
    assert refitted.efficiency > 0.7
