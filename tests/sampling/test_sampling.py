"""The sampling room: settings, diagnostics, stop rule, reproducibility and what it refuses."""

import dataclasses
import pickle
import subprocess
import sys
import time
from itertools import pairwise

import numpy as np
import pytest
from emcee.autocorr import integrated_time
from scipy.stats import norm, rankdata

from jointbayes.sampling import Quantities, SamplerSettings, quantile_error, run_ensembles, stopping
from jointbayes.sampling.diagnostics import autocorrelation_time, split_r_hat
from jointbayes.sampling.ensemble import EnsembleState, Streams
from jointbayes.sampling.moves import advance
from jointbayes.sampling.sampler import weighted_moves
from jointbayes.sampling.stopping import Check, EndError, add_end_error, diagnose, expected_steps, judge, next_check

SHORT = SamplerSettings(walkers=8, max_steps=300, check_every=100)


def gaussian(theta):
    return -0.5 * np.sum(theta**2, axis=1)


def run(seed, settings=SHORT, log_density=gaussian, dimension=2, progress=None):
    start = np.random.default_rng(0).normal(size=(settings.ensembles, settings.walkers, dimension))
    return run_ensembles(log_density, start, np.random.default_rng(seed), settings, progress)


@pytest.fixture(scope="module")
def one():
    """A run of the first seed; nobody may change it."""
    return run(1)


def autoregressive(phi, shape, rng):
    """AR(1) along axis 1, started in equilibrium, unit variance."""
    x = np.empty(shape)
    x[:, 0] = rng.normal(size=x[:, 0].shape)
    for t in range(1, shape[1]):
        x[:, t] = phi * x[:, t - 1] + np.sqrt(1 - phi**2) * rng.normal(size=x[:, 0].shape)
    return x


class TestSettings:
    def test_limits_themselves_are_allowed(self):
        SamplerSettings(ensembles=4, walkers=4, check_every=10, max_steps=20, tau_factor=5.0)

    def test_settings_import_neither_emcee_nor_scipy(self):
        code = "import sys, jointbayes.sampling.ensemble as s; s.SamplerSettings(); print({*sys.modules})"
        found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert "'numpy'" in found.stdout
        assert not any(f"'{name}'" in found.stdout for name in ("emcee", "scipy"))


class TestAutocorrelationTime:
    @pytest.mark.parametrize("phi", [0.0, 0.5, 0.9, 0.95])
    def test_matches_an_ar1_process(self, phi):
        draws = autoregressive(phi, (4, 6000, 24, 1), np.random.default_rng(3))
        assert autocorrelation_time(draws)[0] == pytest.approx((1 + phi) / (1 - phi), rel=0.05)

    def test_agrees_with_emcee_on_long_chains(self):
        draws = autoregressive(0.8, (4, 20_000, 4, 2), np.random.default_rng(4))
        reference = integrated_time(np.concatenate(list(draws), axis=1), c=5, tol=0)
        np.testing.assert_allclose(autocorrelation_time(draws), reference, rtol=0.01)

    def test_does_not_depend_on_location_and_scale(self):
        draws = autoregressive(0.8, (4, 500, 8, 1), np.random.default_rng(5))
        np.testing.assert_allclose(autocorrelation_time(draws), autocorrelation_time(1e3 * draws - 1e4), rtol=1e-8)

    def test_walkers_that_never_move_have_a_tau_as_long_as_the_run(self):
        places = np.random.default_rng(6).normal(size=(4, 1, 8, 1))
        # emcee's own window gives 1 here, the best τ there is.
        assert autocorrelation_time(np.repeat(places, 200, axis=1))[0] == pytest.approx(200.0, rel=0.02)


class TestSplitRHat:
    @pytest.mark.parametrize(
        ("change", "low", "high"),
        [
            (lambda x: x, 0.999, 1.005),
            (lambda x: x + 5.0 * (np.arange(4) == 2)[:, None, None, None], 1.3, np.inf),  # one in another mode
            (lambda x: x + np.linspace(-1.0, 1.0, 400)[:, None, None], 1.05, np.inf),  # a drift that all share
            (lambda x: x * np.array([4.0, 1.0, 1.0, 1.0])[:, None, None, None], 1.1, np.inf),  # one of another width
            (lambda x: x + 5.0 * np.arange(8)[:, None], 0.999, 1.005),  # walkers of one ensemble are one chain
        ],
    )
    def test_it_detects_what_parts_ensembles_or_halves_and_nothing_else(self, change, low, high):
        assert low < split_r_hat(change(np.random.default_rng(7).normal(size=(4, 400, 8, 1))))[0] < high

    def test_each_parameter_has_its_own(self):
        draws = np.random.default_rng(7).normal(size=(4, 400, 8, 3))
        draws[3, :, :, 1] += 3.0
        r_hat = split_r_hat(draws)
        assert r_hat[1] > 1.2
        assert max(r_hat[0], r_hat[2]) < 1.01

    def test_matches_the_published_formula_on_plain_chains(self):
        # One walker: Vehtari et al. (2021), Eqs. (1)-(4), written out for four half chains of five draws.
        x = np.random.default_rng(8).exponential(size=(2, 10, 1, 1))
        halves = x.reshape(4, 5)

        def plain(y):
            z = norm.ppf((rankdata(y).reshape(4, 5) - 3 / 8) / (20 + 1 / 4))
            between = 5 / 3 * np.sum((z.mean(axis=1) - z.mean()) ** 2)
            within = np.sum((z - z.mean(axis=1, keepdims=True)) ** 2) / 4 / 4
            return np.sqrt((4 / 5 * within + between / 5) / within)

        expected = max(plain(halves), plain(np.abs(halves - np.median(halves))))
        assert split_r_hat(x)[0] == pytest.approx(expected, rel=1e-12)


class TestQuantileError:
    @pytest.mark.parametrize("probability", [0.025, 0.5, 0.975])
    def test_it_is_the_scatter_of_the_quantile_of_correlated_skewed_draws(self, probability):
        draws = autoregressive(0.8, (800, 400, 6), np.random.default_rng(3)).reshape(200, 4, 400, 6)  # τ = 9
        chains = np.exp(draws)
        errors = [quantile_error(one, probability) for one in chains]
        scatter = np.std([np.quantile(one, probability) for one in chains], ddof=1)
        assert np.sqrt(np.mean(np.square(errors))) / scatter == pytest.approx(1.0, abs=0.2)

    def test_it_follows_a_monotone_change_of_scale(self):
        draws = np.random.default_rng(4).normal(size=(4, 2000, 12))
        slope = 2 * np.exp(2 * np.quantile(draws, 0.975))
        assert quantile_error(np.exp(2 * draws), 0.975) == pytest.approx(slope * quantile_error(draws, 0.975), rel=0.02)


def test_draws_that_never_vary_tell_nothing():
    same = np.ones((4, 50, 8, 1))
    told = autocorrelation_time(same)[0], split_r_hat(same)[0], quantile_error(same[..., 0], 0.5)
    assert (*told, stopping.worst_end_error(same).share) == (np.inf,) * 4


class TestStopRule:
    settings = SamplerSettings(max_steps=10_000, check_every=100)

    @staticmethod
    def check(step=6000, burn_in=500, tau=100.0, r_hat=1.002, share=0.0199, tau_end=None):
        end_error = None if share is None else EndError("k11", "upper", share, tau_end or tau)
        return Check(step, burn_in, np.array([1.0, tau]), np.array([r_hat, 1.0]), end_error)

    def test_the_slowest_end_counts_whichever_is_the_least_certain(self):
        rng = np.random.default_rng(1)
        free, stuck = rng.normal(size=(4, 400, 16)), rng.normal(size=(4, 400, 16))
        stuck[:, :, 0] = np.linspace(2.0, 5.0, 400)  # a walker of each ensemble that stays in the tail
        found = stopping.worst_end_error(np.stack([free, stuck], axis=-1))
        assert found.tau > 50 > stopping.worst_end_error(free[..., None]).tau
        assert stopping.worst_end_error(np.stack([free, stuck], axis=-1), every=4).tau == 4 * found.tau

    def test_is_met_when_all_conditions_hold(self):
        verdict = judge(self.settings, [self.check(tau=101.9), self.check()])
        assert verdict.converged
        assert verdict.reason == (
            "converged after 6000 steps (limit 10000): the ends of each 95 % interval are good to 2.0 % of the "
            "interval's width; autocorrelation time τ = 100.0 steps, below 1/50 of the 5500 after burn-in, stable "
            "within 2.0 %; R̂ ≤ 1.0020 over 4 ensembles"
        )

    @pytest.mark.parametrize(
        ("change", "figure"),
        [
            ({"burn_in": 1000}, "τ = 100.0 steps exceeds 1/50 of the 5000"),
            ({"r_hat": 1.01}, "R̂ = 1.0100 over 4 ensembles, below 1.01 is needed"),
            ({"r_hat": np.nan}, "R̂ = nan"),
            ({"tau": np.nan}, "τ = nan"),
            ({"tau": 98.0}, "τ changed by 2.0 % since the check before"),
            ({"share": 0.0201}, "upper end of the 95 % interval of k11 has a Monte Carlo error of 2.01 % of"),
            ({"share": np.nan}, "below 2.0 % is needed"),
            ({"share": None}, "the errors of the ends of the 95 % intervals are unknown"),
            ({"tau_end": 221.0}, "τ = 221.0 steps of an end of a 95 % interval exceeds 1/25 of the 5500 after burn-in"),
        ],
    )
    def test_each_condition_alone_prevents_the_stop(self, change, figure):
        verdict = judge(self.settings, [self.check(), self.check(**change)])
        assert not verdict.converged
        assert verdict.reason.startswith("not converged after 6000 steps (limit 10000): ")
        assert figure in verdict.reason

    def test_more_than_one_check_and_a_finite_tau_are_needed(self):
        assert not judge(self.settings, [self.check()]).converged
        infinite = judge(self.settings, [self.check(tau=np.inf)] * 2)
        assert not infinite.converged
        assert "τ changed by" in infinite.reason

    def test_the_interval_ends_are_looked_at_once_the_rest_is_met(self):
        theta = np.random.default_rng(1).normal(size=(4, 6000, 2, 2))
        looked = [self.check(share=None), self.check(share=None)]
        unmet = [self.check(share=None), self.check(share=None, r_hat=1.02)]
        assert add_end_error(self.settings, unmet, theta).end_error is None
        found = add_end_error(self.settings, looked, theta).end_error
        # sqrt(p (1 - p) / n) / density, over the width of a normal's interval, of n = 4 · 5500 · 2 draws
        assert found.share == pytest.approx(np.sqrt(0.975 * 0.025 / 44000) / 0.05845 / 3.92, rel=0.2)

    def test_steps_expected_for_the_interval_ends_grow_with_the_square_of_their_error(self):
        last = self.check(step=1000, burn_in=500, tau=1.0, share=0.04)
        assert expected_steps(self.settings, last) == 2100  # 4 · 500 kept and 5 τ, in whole blocks

    def test_the_error_is_that_of_the_quantities_asked_for(self):
        theta = np.random.default_rng(1).normal(size=(4, 1000, 8, 2))
        heavy = Quantities(("wide",), lambda t: np.sinh(3 * t[..., 1:]))
        found = stopping.worst_end_error(theta, heavy)
        assert found.name == "wide"
        assert found.share > 2 * stopping.worst_end_error(theta).share

    @pytest.mark.parametrize("limit", [200, 250, 3000, 20_000, 200_000, 199_999])
    def test_checks_are_five_percent_apart_end_at_the_limit_and_stay_cheap(self, limit):
        settings = SamplerSettings(max_steps=limit, check_every=100)
        steps = [next_check(0, settings)]
        while steps[-1] < limit:
            steps.append(next_check(steps[-1], settings))
        assert steps[-1] == limit
        assert all(step % settings.check_every == 0 for step in steps[:-1])
        assert len(steps) >= 2
        assert all(b - a >= max(100, 0.05 * a) for a, b in pairwise(steps))
        assert sum(steps) <= 22 * limit

    @pytest.mark.parametrize(
        ("step", "tau", "expected"),
        [
            (100, 31.0, 1800),  # the first block past burn-in and fifty τ
            (4000, 31.0, 4200),  # long enough: the next check
            *((6000, tau, 10_000) for tau in (1e4, np.inf, np.nan)),  # the limit
        ],
    )
    def test_expected_steps_are_those_of_burn_in_and_fifty_tau(self, step, tau, expected):
        assert expected_steps(self.settings, self.check(step=step, tau=tau)) == expected
        assert expected_steps(self.settings, self.check(tau_end=111.0)) >= 50 * 111

    def test_burn_in_is_five_tau_of_the_check_before_and_at_most_half(self):
        draws = np.random.default_rng(9).normal(size=(4, 400, 8, 2))
        checks = (None, *(self.check(tau=tau) for tau in (20.1, 80.0, np.inf)))
        assert [diagnose(draws, check).burn_in for check in checks] == [200, 101, 200, 200]

    def test_what_burn_in_leaves_out_does_not_count(self):
        draws = np.random.default_rng(9).normal(size=(4, 400, 8, 1))
        spoilt = draws.copy()
        spoilt[:, :100] += 100.0
        found, expected = (diagnose(each, self.check(tau=20.0)) for each in (spoilt, draws))
        np.testing.assert_array_equal([found.tau, found.r_hat], [expected.tau, expected.r_hat])


class TestReproducibility:
    def test_global_generator_is_neither_used_nor_touched(self, one):
        np.random.seed(2)  # noqa: NPY002 (the global generator is what this test is about)
        before = np.random.get_state()  # noqa: NPY002
        np.testing.assert_array_equal(one.theta, run(1).theta)
        for now, then in zip(np.random.get_state(), before, strict=True):  # noqa: NPY002
            np.testing.assert_array_equal(now, then)

    def test_adding_an_ensemble_leaves_the_others_as_they_are(self, one):
        np.testing.assert_array_equal(run(1, dataclasses.replace(SHORT, ensembles=5)).theta[:4], one.theta)

    def test_any_block_is_had_again_from_where_it_began_and_its_own_seed(self, one):
        streams, steps = Streams.from_generator(np.random.default_rng(1)), SHORT.check_every
        for ensemble, number in ((0, 1), (3, 2)):
            before = one.theta[ensemble, number * steps - 1]
            state = pickle.loads(pickle.dumps(EnsembleState(before, gaussian(before))))
            block = advance(gaussian, state, steps, streams.block(ensemble, number), weighted_moves())
            np.testing.assert_array_equal(block.theta, one.theta[ensemble, number * steps : (number + 1) * steps])

    def test_no_two_blocks_draw_the_same_numbers(self):
        streams = Streams.from_generator(np.random.default_rng(1))
        seeds = [streams.with_stage(s).block(e, b) for s in range(3) for e in range(4) for b in range(5)]
        assert len({tuple(seed.generate_state(4)) for seed in seeds}) == len(seeds)
        first, second = (streams.with_stage(stage).refit().integers(2**63, size=4) for stage in (0, 1))
        assert not np.array_equal(first, second)

    def test_the_callers_own_stream_is_spawned_from_and_not_drawn_from_and_its_start_stays(self):
        start, rng = np.random.default_rng(0).normal(size=(4, 8, 2)), np.random.default_rng(1)
        before = start.copy()
        run_ensembles(gaussian, start, rng, SHORT)
        assert rng.random() == np.random.default_rng(1).random()
        np.testing.assert_array_equal(start, before)
        assert start.flags.writeable

    def test_ensembles_draw_from_different_streams(self):
        start = np.broadcast_to(np.random.default_rng(0).normal(size=(8, 2)), (4, 8, 2))
        settings = SamplerSettings(walkers=8, max_steps=100, check_every=50)
        last = run_ensembles(gaussian, start, np.random.default_rng(1), settings).theta[:, -1]
        assert not (last[0] == last[1:]).any()


class TestRun:
    def test_stops_by_the_rule_and_reports_progress_after_each_block(self, capsys):
        seen = []
        chains = run(1, SamplerSettings(walkers=8, max_steps=20_000, check_every=100), progress=seen.append)
        assert chains.converged
        assert chains.steps < 20_000
        assert chains.steps - chains.burn_in > 50.0 * chains.tau.max()
        assert chains.r_hat.max() < 1.01
        words = "(limit 20000): the ends of each 95 % interval are good to "
        assert chains.reason.startswith(f"converged after {chains.steps} steps {words}")
        assert abs(chains.history[-2].tau_max / chains.tau.max() - 1.0) < 0.02
        assert [report.done for report in seen] == list(range(100, chains.steps + 1, 100))
        assert all(report.done <= report.total <= 20_000 for report in seen)
        assert seen[-1].total == seen[-1].done
        assert seen[-1].figures == {"tau": chains.tau.max(), "r_hat": chains.r_hat.max()}
        elapsed = [report.elapsed_seconds for report in seen]
        assert elapsed == sorted(elapsed)
        assert capsys.readouterr() == ("", "")

    def test_step_limit_leaves_the_run_unconverged_and_says_so_also_of_no_whole_number_of_blocks(self, one):
        assert not one.converged
        assert one.steps == 300
        assert one.reason.startswith("not converged after 300 steps (limit 300): τ = ")
        odd = run(1, dataclasses.replace(SHORT, max_steps=333))
        assert (odd.theta.shape, odd.history[-1].step) == ((4, 333, 8, 2), 333)

    def test_figures_describe_the_arrays(self):
        calls = []

        def counted(theta):
            calls.append(len(theta))
            return gaussian(theta)

        began = time.perf_counter()
        chains = run(1, log_density=counted)
        passed = time.perf_counter() - began
        moved = np.any(np.diff(chains.theta, axis=1) != 0.0, axis=-1)
        assert chains.theta.shape == (4, 300, 8, 2)
        np.testing.assert_allclose(chains.log_density, -0.5 * np.sum(chains.theta**2, axis=-1))
        np.testing.assert_allclose(chains.acceptance, moved.mean(axis=(1, 2)), atol=1 / 300)
        assert chains.evaluations == sum(calls)
        assert chains.thin == max(1, int(chains.tau.min() / 2))
        np.testing.assert_allclose(chains.ess, 4 * 8 * (300 - chains.burn_in) / chains.tau)
        assert 0.0 < chains.seconds < passed
        assert [check.step for check in chains.history] == [100, 200, 300]

    def test_last_check_is_of_the_kept_draws(self, one):
        kept = one.theta[:, one.burn_in :]
        np.testing.assert_array_equal(one.tau, autocorrelation_time(kept))
        np.testing.assert_array_equal(one.r_hat, split_r_hat(kept[:, :: one.thin]))

    @pytest.mark.parametrize("thinned", [True, False])
    def test_draws_are_the_kept_steps_one_chain_per_walker(self, thinned, one):
        draws, every = one.draws(thinned=thinned), one.thin if thinned else 1
        assert one.thin > 1
        np.testing.assert_array_equal(draws.ensemble, np.repeat(np.arange(4), 8))
        for chain in (0, 13, 31):
            kept = np.s_[chain // 8, one.burn_in :: every, chain % 8]
            np.testing.assert_array_equal(draws.theta[chain], one.theta[kept])
            np.testing.assert_array_equal(draws.log_density[chain], one.log_density[kept])

    def test_arrays_are_read_only(self, one):
        arrays = [one.theta, one.log_density, one.acceptance, one.tau, one.r_hat]
        arrays += [getattr(one.draws(), name) for name in ("theta", "log_density", "ensemble")]
        assert not any(array.flags.writeable for array in arrays)

    @pytest.mark.science
    def test_ensemble_stuck_in_another_mode_is_not_converged(self):
        def two_modes(theta):
            return np.logaddexp(-0.5 * np.sum((theta - 50.0) ** 2, axis=1), gaussian(theta))

        start = np.random.default_rng(0).normal(size=(4, 8, 2))
        start[3] += 50.0
        settings = SamplerSettings(walkers=8, max_steps=2000)
        chains = run_ensembles(two_modes, start, np.random.default_rng(1), settings)
        assert not chains.converged
        assert chains.r_hat.max() > 1.3
        assert "R̂ = " in chains.reason

    def test_walkers_that_cannot_move_are_not_converged(self):
        places = np.random.default_rng(0).normal(size=(4, 8, 2))
        allowed = {tuple(place) for place in places.reshape(-1, 2)}

        def only_there(theta):
            return np.array([0.0 if tuple(point) in allowed else -np.inf for point in theta])

        chains = run_ensembles(only_there, places, np.random.default_rng(1), SHORT)
        np.testing.assert_array_equal(chains.acceptance, 0.0)
        assert not chains.converged
        assert "τ = " in chains.reason


START = np.random.default_rng(0).normal(size=(4, 8, 2))


def changed(place, value):
    """A start with this at some place."""
    start = START.copy()
    start[place] = value
    return start


class TestRefusals:
    def test_an_error_of_the_log_density_itself_comes_through_unprinted(self, capsys):
        with pytest.raises(ZeroDivisionError):
            run(1, log_density=lambda _: 1 / 0)
        assert capsys.readouterr() == ("", "")
