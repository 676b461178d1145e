"""Runs of several stages, and walkers that lie on thin sheets."""

from dataclasses import replace

import numpy as np
import pytest
from emcee.ensemble import walkers_independent

from jointbayes.errors import SamplingError
from jointbayes.inference import Landing
from jointbayes.sampling import SamplerSettings, draw, run_ensembles, sampler
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.ensemble import Streams
from jointbayes.sampling.kernels import Kernels
from tests.sampling.test_origins import SHEETS

SETTINGS = SamplerSettings(walkers=24, max_steps=6000)


def gaussian(theta):
    return -0.5 * (theta**2).sum(axis=1)


# ---- posteriors as thin as those where k12² comes up to k11 k22

THIN = 1e-10


def sheet(theta):
    """x normal about 20, y within 1e-10 of it."""
    x, y = theta.T
    return -0.5 * (((x - 20) / 0.01) ** 2 + ((y - x) / THIN) ** 2)


def on_sheet(rng, walkers=24):
    x = 20 + 0.01 * rng.normal(size=(4, walkers))
    return np.stack([x, x + THIN * rng.normal(size=x.shape)], axis=-1)


def test_walkers_on_a_sheet_of_1e_minus_10_go_on_as_any():
    rng = np.random.default_rng(3)
    start = on_sheet(rng)
    assert not any(walkers_independent(walkers) for walkers in start)  # by emcee's measure they have collapsed
    chains = run_ensembles(sheet, start, rng, replace(SETTINGS, max_steps=3000))
    assert chains.converged
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


# ---- stages

AT = np.array([[1.0, 1.0]])


def staged(sheet, monkeypatch, settings=SETTINGS, **constants):
    """Draws of a sheet, with what each stage was told, and the number of fits."""
    for name, value in {"_ON_A_SHEET": 2.0, **constants}.items():
        monkeypatch.setattr(sampler, name, value)
    fits, told, whole = [], [], sampler.fit_proposal
    monkeypatch.setattr(sampler, "fit_proposal", lambda *a: fits.append(whole(*a)) or fits[-1])
    told_of = lambda now: told.append(now) if now.done else None  # noqa: E731
    systems = [Identity()]
    chains, last = draw(Landing(sheet), AT, np.random.default_rng(1), settings, told_of, systems=systems)
    return chains, last, fits, told


def test_a_run_that_mixes_slowly_is_fitted_to_its_draws_and_the_steps_before_do_not_count(monkeypatch):
    chains, last, fits, _ = staged(SHEETS["banana"], monkeypatch, _SLOW_TAU=0.0, _STAGES=(100,))
    assert (chains.converged, chains.discarded, len(fits)) == (True, 100, 2)
    assert last.efficiency == max(fit.efficiency for fit in fits)
    assert "; 100 earlier steps served to fit the proposal and were discarded" in chains.reason


def test_where_walkers_mix_slowly_with_a_mixture_the_kernels_of_the_origins_propose(monkeypatch):
    chains, last, fits, _ = staged(SHEETS["banana"], monkeypatch, _SLOW_TAU=0.0, _STAGES=(100,), _ON_A_SHEET=0.05)
    assert (chains.converged, chains.discarded, len(fits)) == (True, 100, 1)
    assert isinstance(last.density, Kernels)
    assert last.efficiency > 0.05


def test_a_run_that_mixes_well_and_wants_more_steps_goes_on_as_it_is(monkeypatch):
    settings = replace(SETTINGS, max_steps=800, end_tolerance=1e-4)
    chains, _, fits, _ = staged(SHEETS["Gaussian"], monkeypatch, settings)
    assert not chains.converged
    assert (chains.discarded, chains.steps, len(fits)) == (0, 800, 1)


def test_a_converged_run_is_made_again_where_its_draws_lie_where_the_proposal_is_not(monkeypatch):
    """Its stated efficiency is far above that among the draws."""
    chains, _, fits, _ = staged(SHEETS["Gaussian"], monkeypatch, _STATED=2.0, _STAGES=(500,))
    assert chains.converged
    assert chains.discarded > 0
    assert len(fits) == 2


@pytest.mark.whole
@pytest.mark.parametrize(("limit", "fits"), [(100, 1), (760, 2), (2100, 3)])
def test_all_stages_together_make_no_more_steps_than_allowed_and_progress_counts_them(limit, fits, monkeypatch):
    settings = replace(SETTINGS, walkers=8, max_steps=limit, tau_factor=1e6)  # never converged
    chains, _, fitted, told = staged(SHEETS["Gaussian"], monkeypatch, settings, _SLOW_TAU=0.0)
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
