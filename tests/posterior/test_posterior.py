"""Posteriors: draws, verdicts, predictions, the summary and the file."""

import dataclasses
import json

import h5py
import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal

import jointbayes as jb
from jointbayes.frf import receptance_model
from jointbayes.posterior import assess, data_sha256, summarise
from jointbayes.posterior.posterior import region_level
from jointbayes.posterior.sampled import BestDraw
from jointbayes.posterior.storage import RECORD
from jointbayes.posterior.verdicts import mode_agrees, mode_distance
from jointbayes.sampling.diagnostics import effective_sizes
from tests.conftest import PAIR, judged_as, pair_matrix

INITIAL = (1e8, 0.0, 0.0)
MEASURED_HZ = (120.0, 762.0, 2101.0)


# ---- draws


def test_draws_are_chains_of_stiffnesses_with_units(cheap_posterior):
    draws = cheap_posterior.draws
    assert cheap_posterior.converged
    assert cheap_posterior.reason.startswith("converged after ")
    assert set(draws.data_vars) == set(PAIR.stiffness_names)
    assert [draws[name].attrs["units"] for name in PAIR.stiffness_names] == ["N/m", "N", "N·m/rad"]
    assert all(draws[name].dims == ("chain", "draw") for name in PAIR.stiffness_names)
    assert draws.sizes["chain"] == 4 * 16
    assert_array_equal(draws["ensemble"], np.repeat(np.arange(4), 16))
    k11, k12, k22 = (draws[name].values for name in PAIR.stiffness_names)
    assert (k12**2 < k11 * k22).all()


def test_the_log_density_belongs_to_its_draw(cheap_posterior):
    problem = cheap_posterior.problem
    theta = problem.parametrisation.coordinates(cheap_posterior.stiffness[::37])
    assert_allclose(problem.log_posterior(theta), cheap_posterior.log_density.ravel()[::37], rtol=1e-9)


def test_prior_draws_follow_the_prior_of_the_case(cheap_posterior):
    k11 = cheap_posterior.prior_values("k11")
    assert k11.shape[0] == 1
    assert k11.size >= 1000
    assert (k11.min(), k11.max()) == pytest.approx((1e6, 1e11), rel=0.2)


def test_intervals_are_equal_tailed(cheap_posterior):
    for name in PAIR.stiffness_names:
        values = cheap_posterior.values(name)
        low, high = cheap_posterior.interval(name, 0.8)
        # a walker that stays where it is repeats a draw, at an end as anywhere
        assert np.mean(values < low) - 1 / values.size <= 0.1 <= np.mean(values <= low) + 1 / values.size
        assert np.mean(values > high) - 1 / values.size <= 0.1 <= np.mean(values >= high) + 1 / values.size
        wide = cheap_posterior.interval(name)
        assert wide[0] < low < high < wide[1]
        assert wide == pytest.approx(cheap_posterior.verdict(name).interval, rel=1e-12)


def test_the_mode_refined_from_the_best_draw_is_the_map(cheap_posterior, frequency_posterior):
    for posterior in (cheap_posterior, frequency_posterior):
        assert mode_agrees(posterior)
        assert posterior.best.log_density >= posterior.log_density.max()
        assert posterior.best.log_density == pytest.approx(posterior.problem.log_posterior(posterior.best.theta)[0])
    assert mode_distance(cheap_posterior) < 0.01
    assert_allclose(list(cheap_posterior.mode.values()), cheap_posterior.estimate.values, rtol=1e-2)


@pytest.mark.parametrize(
    ("distance", "higher", "agrees"),
    [(0.009, 1.0, True), (0.011, 0.0009, True), (0.011, -0.0009, True), (0.011, 0.0011, False), (0.011, -0.01, False)],
)
def test_the_map_counts_as_missed_beyond_a_hundredth_of_its_sd_and_a_thousandth_in_density(
    cheap_posterior, distance, higher, agrees
):
    estimate = cheap_posterior.estimate
    step = distance * np.sqrt(np.diag(estimate.covariance)) * np.array([0.3, -1.0, 0.5])
    moved = dataclasses.replace(cheap_posterior, best=BestDraw(estimate.theta + step, estimate.log_posterior + higher))
    assert mode_distance(moved) == pytest.approx(distance)
    assert mode_agrees(moved) == agrees


def test_a_mode_on_the_edge_of_its_prior_is_named(cheap_posterior):
    assert cheap_posterior.problem.prior.coordinates_at_edge(cheap_posterior.best.theta) == ()
    low, high = cheap_posterior.problem.prior.support
    for i, name in enumerate(PAIR.stiffness_names):
        for edge in (low, high):
            theta = np.where(np.arange(3) == i, edge, cheap_posterior.best.theta)
            assert cheap_posterior.problem.prior.coordinates_at_edge(theta) == (name,)


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(cheap_case):
    settings = jb.SamplerSettings(walkers=8, max_steps=100)
    first, again, other = (jb.sample(cheap_case, seed=seed, settings=settings) for seed in (7, 7, 8))
    for name in PAIR.stiffness_names:
        assert first.values(name).tobytes() == again.values(name).tobytes()
        assert first.prior_values(name).tobytes() == again.prior_values(name).tobytes()
        assert not np.isin(first.values(name), other.values(name)).any()
        assert not np.isin(first.prior_values(name), other.prior_values(name)).any()
    assert first.mode == again.mode
    assert (first.record.seed, other.record.seed) == (7, 8)


# ---- identifiability


def draws_between(low, high):
    """41 draws whose quantiles 0.025 and 0.975 are exactly `low` and `high`."""
    return np.concatenate([[low] * 3, np.full(35, np.sqrt(low * high)), [high] * 3])


WIDE_PRIOR = np.exp(np.linspace(-10.0, 10.0, 41))


@pytest.mark.parametrize(
    ("high", "verdict"),
    [
        (1.01, "identified"),
        (1.25, "identified"),
        (np.nextafter(1.25, 2), "weakly identified"),
        (3.0, "weakly identified"),
        (np.nextafter(3.0, 4), "not identified"),
        (50.0, "not identified"),
    ],
)
def test_the_verdict_turns_exactly_at_its_ratios(high, verdict):
    known = assess(draws_between(1.0, high), WIDE_PRIOR)
    assert known.interval == (1.0, high)
    assert (known.ratio, known.cls) == (high, verdict)
    negative = assess(-draws_between(1.0, high), WIDE_PRIOR)
    assert (negative.ratio, negative.cls) == (high, verdict)
    assert negative.interval == (-high, -1.0)


@pytest.mark.parametrize(("contraction", "verdict"), [(0.4999, "not identified"), (0.5001, "identified")])
def test_a_prior_that_was_as_narrow_identifies_nothing(contraction, verdict):
    posterior = draws_between(1.0, 1.2)
    prior = posterior ** (1 / np.sqrt(1 - contraction))  # scales ln k
    known = assess(posterior, prior)
    assert known.contraction == pytest.approx(contraction, abs=1e-12)
    assert known.sd_log == pytest.approx(np.log(posterior).std())
    assert known.cls == verdict


def test_a_stiffness_of_either_sign_is_not_identified_however_narrow():
    posterior = np.linspace(-0.01, 1.0, 41)
    known = assess(posterior, np.linspace(-100.0, 100.0, 41))
    assert (known.ratio, known.cls) == (np.inf, "not identified")
    assert np.isnan(known.sd_log)
    assert known.contraction == pytest.approx(1 - posterior.var() / np.linspace(-100.0, 100.0, 41).var())
    assert assess(np.append(draws_between(1.0, 1.1), 0.0), WIDE_PRIOR).cls == "not identified"


def test_the_region_level_is_the_share_of_draws_with_a_higher_density(cheap_posterior):
    assert region_level(cheap_posterior, list(cheap_posterior.mode.values())) == 0.0
    density = cheap_posterior.log_density.ravel()
    for level in (0.1, 0.5, 0.95):
        row = np.argsort(-density)[round(level * density.size)]
        found = region_level(cheap_posterior, cheap_posterior.stiffness[row])
        assert found == pytest.approx(level, abs=0.002)  # walkers that stay put are ties
    assert region_level(cheap_posterior, [5.05e9, 3.44e7, 1.52e6]) < 0.99  # the truth of these data


@pytest.mark.parametrize(
    "impossible",
    [[0.0, 3e7, 1e6], [5e9, 3e7, -1e6], [5e9, 1e9, 1.5e6], [5e9, 0.0, 1.5e6], [5e9, -3e7, 1.5e6], [5e12, 3e7, 1.5e6]],
)
def test_a_joint_without_density_lies_on_the_edge_of_everything(cheap_posterior, impossible):
    assert region_level(cheap_posterior, impossible) == 1.0


def test_a_negative_coupling_has_a_region_where_its_sign_is_free(frequency_posterior):
    assert region_level(frequency_posterior, list(frequency_posterior.mode.values())) == 0.0
    stiffness, density = frequency_posterior.stiffness, frequency_posterior.log_density.ravel()
    likeliest = np.argmax(np.where(stiffness[:, 1] < 0, density, -np.inf))
    assert stiffness[likeliest, 1] < 0
    assert region_level(frequency_posterior, stiffness[likeliest]) < 0.1


# ---- predictions


def test_the_frf_band_holds_the_map_and_narrows_with_its_probability(cheap_posterior):
    frf = cheap_posterior.problem.test.data.frf
    band = cheap_posterior.predict_frf()
    assert band.magnitude.shape == frf.values.shape
    assert (band.quantity, band.outputs, band.inputs) == ("receptance", ("5:y",), ("5:y",))
    ports = jb.Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    problem = cheap_posterior.problem
    best = receptance_model(problem.test.structure, problem.test.joints, ports).receptance(
        pair_matrix(cheap_posterior.estimate.values)
    )[0]
    inside = (band.magnitude_low <= np.abs(best)) & (np.abs(best) <= band.magnitude_high)
    assert inside.mean() > 0.9
    turn = np.angle(best * np.exp(-1j * np.radians(band.phase_deg)), deg=True) + band.phase_deg
    assert ((band.phase_deg_low <= turn) & (turn <= band.phase_deg_high)).mean() > 0.9
    narrow = cheap_posterior.predict_frf(probability=0.5)
    for name in ("magnitude", "phase_deg"):
        centre, low, high = (getattr(band, name + part) for part in ("", "_low", "_high"))
        assert (low <= getattr(narrow, f"{name}_low")).all()
        assert (getattr(narrow, f"{name}_low") <= centre).all()
        assert (centre <= getattr(narrow, f"{name}_high")).all()
        assert (getattr(narrow, f"{name}_high") <= high).all()
        assert (high - low).max() > 0
    few = cheap_posterior.predict_frf(max_draws=1)
    assert_array_equal(few.magnitude_low, few.magnitude_high)


def test_frfs_are_predicted_where_nothing_was_measured(cheap_posterior, frequency_posterior):
    ports = jb.Ports(np.array([100.0, 500.0]), ("3:y", "1:rz"), ("5:y",))
    for posterior in (cheap_posterior, frequency_posterior):
        band = posterior.predict_frf(ports)
        assert band.magnitude.shape == (2, 2, 1)
        assert (band.magnitude > 0).all()


def test_natural_frequencies_are_those_of_the_draws(cheap_posterior, frequency_posterior):
    found = cheap_posterior.predict_natural_frequencies(4, max_draws=100)
    assert found.shape == (100, 4)
    assert (np.diff(found, axis=1) > 0).all()
    stiffness = cheap_posterior.problem.prior.values(cheap_posterior.thinned(100))
    direct = cheap_posterior.problem.natural_frequencies_hz(stiffness, 4)
    assert_array_equal(found, direct)
    best = cheap_posterior.problem.natural_frequencies_hz(cheap_posterior.estimate.values, 4)[0]
    assert ((found.min(axis=0) < best) & (best < found.max(axis=0))).all()
    low, high = np.quantile(frequency_posterior.predict_natural_frequencies(3), [0.025, 0.975], axis=0)
    assert ((low < MEASURED_HZ) & (high > MEASURED_HZ)).all()  # they were fitted, and a joint exists that fits


def test_thinning_keeps_draws_of_every_chain(cheap_posterior):
    everything = cheap_posterior.theta
    assert_allclose(np.exp(everything), cheap_posterior.stiffness, rtol=1e-13)
    assert_array_equal(cheap_posterior.thinned(10**9), everything)
    few = cheap_posterior.thinned(64)
    assert few.shape == (64, 3)
    rows = [int(np.flatnonzero((everything == k).all(axis=1))[0]) for k in few]
    chain_of = np.array(rows) // cheap_posterior.draws.sizes["draw"]
    assert len(set(chain_of.tolist())) > 32


def test_numbers_of_numpy_are_numbers(cheap_posterior):
    assert cheap_posterior.interval("k12", np.float64(0.5)) == cheap_posterior.interval("k12", 0.5)
    assert cheap_posterior.predict_frf(jb.Ports([100.0], ("5:y",), ("5:y",)), max_draws=np.int64(4)).magnitude.size == 1


# ---- file and ArviZ


def test_a_saved_posterior_comes_back_bit_for_bit(cheap_posterior, frequency_posterior, tmp_path):
    for posterior in (cheap_posterior, frequency_posterior):
        path = tmp_path / "posterior.nc"
        posterior.save(path)
        assert [p.name for p in tmp_path.iterdir()] == ["posterior.nc"]
        loaded = jb.load_posterior(path)
        for group in ("posterior", "sample_stats", "prior", "observed_data"):
            xr.testing.assert_identical(loaded.tree[group].to_dataset(), posterior.tree[group].to_dataset())
        for name in PAIR.stiffness_names:
            assert loaded.values(name).tobytes() == posterior.values(name).tobytes()
        assert loaded.record == posterior.record
        # what a report says of the case does not change by the way
        assert loaded.case.workshop_problem.names == posterior.case.workshop_problem.names
        assert loaded.case.default_priors == posterior.case.default_priors
        assert loaded.case.warnings == posterior.case.warnings
        assert loaded.mode == posterior.mode
        assert loaded.best.log_density == posterior.best.log_density
        assert loaded.best.theta.tobytes() == posterior.best.theta.tobytes()
        for field in ("theta", "values", "covariance"):
            assert getattr(loaded.estimate, field).tobytes() == getattr(posterior.estimate, field).tobytes()
        assert loaded.estimate.log_posterior == posterior.estimate.log_posterior
        assert loaded.estimate.failed_starts == posterior.estimate.failed_starts
        assert [s.name for s in loaded.estimate.starts] == [s.name for s in posterior.estimate.starts]
        if posterior is frequency_posterior:  # the ends of a flat region take seconds, found once for both
            found = posterior
            judged_as(loaded, posterior)
        else:  # what other tests asked of the shared one first may have led a climb elsewhere by its last digits
            found = judged_as(dataclasses.replace(posterior), posterior)
        assert summarise(loaded, INITIAL, MEASURED_HZ).to_dict() == summarise(found, INITIAL, MEASURED_HZ).to_dict()


def rewritten(path, change):
    """Change the JSON record of a posterior file."""
    with h5py.File(path, "r+") as file:
        file.attrs[RECORD] = change(json.loads(file.attrs[RECORD]))


def without(key):
    return lambda record: json.dumps({k: v for k, v in record.items() if k != key})


SPOILT = {
    "missing": lambda path: path.unlink(),
    "a directory": lambda path: (path.unlink(), path.mkdir()),
    "cut short": lambda path: path.write_bytes(path.read_bytes()[:-1000]),
    "overwritten": lambda path: path.write_bytes(b"\0" * 4096 + path.read_bytes()[4096:]),
    "another netCDF file": lambda path: xr.Dataset({"x": 1.0}).to_netcdf(path, engine="h5netcdf"),
    "record no JSON": lambda path: rewritten(path, lambda record: "no JSON"),
    "record without version": lambda path: rewritten(path, without("file_version")),
    "later version": lambda path: rewritten(path, lambda record: json.dumps({**record, "file_version": 99})),
}


@pytest.fixture(scope="module")
def saved(cheap_posterior, tmp_path_factory):
    """The bytes of its file."""
    path = tmp_path_factory.mktemp("saved") / "posterior.nc"
    cheap_posterior.save(path)
    return path.read_bytes()


@pytest.mark.parametrize("spoil", SPOILT.values(), ids=SPOILT)
def test_a_file_that_holds_no_posterior_is_refused_in_one_line(saved, tmp_path, spoil):
    path = tmp_path / "posterior.nc"
    path.write_bytes(saved)
    spoil(path)
    with pytest.raises(jb.MeasurementError, match="expected") as caught:
        jb.load_posterior(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")


# ---- summary


def test_the_summary_states_the_numbers_of_the_posterior(cheap_posterior):
    summary = json.loads(json.dumps(summarise(cheap_posterior, INITIAL, MEASURED_HZ).to_dict(), allow_nan=False))
    assert (summary["schema_version"], summary["case"], summary["seed"]) == (5, "cheap", 1)
    assert (summary["converged"], summary["reason"]) == (True, cheap_posterior.reason)
    for i, name in enumerate(PAIR.stiffness_names):
        p, values = summary["parameters"][name], cheap_posterior.values(name)
        assert p["map"] == cheap_posterior.estimate.values[i]
        assert p["median"] == pytest.approx(np.median(values))
        assert p["sd_log"] == pytest.approx(np.log(values).std())
        assert p["interval95"] == pytest.approx(cheap_posterior.interval(name), rel=1e-12)
        prior = cheap_posterior.prior_values(name)
        assert p["contraction"] == pytest.approx(1 - np.log(values).var() / np.log(prior).var())
        assert p["verdict"] == cheap_posterior.verdict(name).cls
        assert 0.99 < p["r_hat"] == cheap_posterior.record.r_hat[name] < 1.01
        assert 400 < p["ess_bulk"] < 2 * values.size
        assert 400 < p["ess_tail"] != p["ess_bulk"]
        assert (p["ess_bulk"], p["ess_tail"]) == effective_sizes(np.log(values))
    fit = summary["fit"]
    # 2481 lines shrunk to 249; the expected χ² per complex value is 1
    assert fit["n_data"] == 249
    assert fit["chi2_per_line"] == pytest.approx(1.0, abs=4 / np.sqrt(249))
    assert fit["synthetic_data"] is True
    frequencies = summary["natural_frequencies_hz"]
    assert frequencies["measured"] == list(MEASURED_HZ)
    assert np.shape(frequencies["interval95"]) == (3, 2)
    low, high = np.array(frequencies["interval95"]).T
    assert ((low < frequencies["map"]) & (frequencies["map"] < high)).all()
    assert frequencies["initial"][0] < 1.0  # the paper's first guess leaves the rod free to turn


def test_numbers_that_do_not_exist_are_null(frequency_posterior):
    summary = json.loads(json.dumps(summarise(frequency_posterior, INITIAL).to_dict(), allow_nan=False))
    assert summary["parameters"]["k12"]["sd_log"] is None
    assert summary["natural_frequencies_hz"]["measured"] is None
    assert len(summary["natural_frequencies_hz"]["map"]) == 3
    assert summary["parameters"]["k12"]["r_hat"] == frequency_posterior.record.r_hat["rho"]
    assert summary["fit"]["synthetic_data"] is False
    assert summary["fit"]["n_data"] == 3


def test_the_fingerprint_follows_the_data(cheap_posterior, frequency_posterior):
    def fingerprint(posterior):
        return data_sha256(posterior.problem)

    assert summarise(cheap_posterior, INITIAL).data_sha256 == fingerprint(cheap_posterior)
    measurement = cheap_posterior.problem.test.data
    changed = dataclasses.replace(
        cheap_posterior,
        problem=cheap_posterior.problem.with_test(
            data=dataclasses.replace(measurement, variance=measurement.variance * (1 + 1e-12))
        ),
    )
    assert len({fingerprint(p) for p in (cheap_posterior, changed, frequency_posterior)}) == 3
    assert fingerprint(cheap_posterior) == fingerprint(dataclasses.replace(cheap_posterior))
