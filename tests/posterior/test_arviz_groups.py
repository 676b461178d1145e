"""What ArviZ is given: chains that flatter nobody, and ln L, ln p and replicated data of each draw."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import arviz as az
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jointbayes as jb
from jointbayes.inference import IntegratedScale
from jointbayes.posterior import storage
from jointbayes.posterior.storage import fold_chains
from jointbayes.sampling.diagnostics import effective_sizes, split_r_hat
from tests.report.test_several_tests import BASE, CLAMP_EDGE, HEARD, TWO, posterior_of

BY_DRAW = ("chain", "draw")
POINTWISE = {"log_likelihood", "posterior_predictive"}


pytestmark = pytest.mark.version


@pytest.fixture(scope="module")
def groups(cheap_posterior):
    return cheap_posterior.to_arviz(megabytes=20)


def test_arviz_is_imported_where_its_note_of_the_day_cannot_be_written(monkeypatch):
    noted = []

    def imported(name):
        noted.append(os.environ.get("XDG_CACHE_HOME"))
        if len(noted) == 1:
            raise PermissionError("daily_warning")
        assert Path(noted[1]).is_dir()
        return az

    monkeypatch.setenv("XDG_CACHE_HOME", "mine")
    monkeypatch.setattr(storage, "import_module", imported)
    assert storage.imported_arviz() is az
    assert noted[0] == os.environ["XDG_CACHE_HOME"] == "mine"
    assert not Path(noted[1]).exists()


@pytest.mark.science
@pytest.mark.skipif(sys.platform == "win32", reason="HOME is not what Windows asks")
def test_a_home_that_cannot_be_written_costs_nothing():
    """Matplotlib, ArviZ and the loops each want a cache in the user's home."""
    code = "from jointbayes.posterior.storage import imported_arviz as get; print(get().__name__)"
    without = {key: value for key, value in os.environ.items() if not key.startswith(("XDG_", "MPLCONFIG"))}
    done = subprocess.run(
        [sys.executable, "-c", code], env=without | {"HOME": "/proc/none"}, text=True, capture_output=True
    )
    assert (done.returncode, done.stdout) == (0, "arviz\n"), done.stderr


def names_of(groups):
    return set(groups.children) if hasattr(groups, "children") else set(groups.groups())


def flat(groups, group, name):
    values = groups[group][name].values
    return values.reshape(values.shape[0] * values.shape[1], -1)


def walkers_with_memory(rng, memory, drift=0.0):
    """Draws, shape (4 ensembles · 16 walkers, 200 steps), each walker by itself, and all with a drift in time."""
    noise = rng.normal(size=(64, 200)) * np.sqrt(1 - memory**2)
    draws = [rng.normal(size=64)]
    for step in range(1, 200):
        draws.append(memory * draws[-1] + noise[:, step])
    return np.transpose(draws) + drift * np.linspace(-1, 1, 200)


def test_a_chain_is_an_ensemble_whose_halves_are_those_of_the_run():
    walkers, steps = np.indices((4, 6))
    folded = fold_chains(10 * walkers + steps, 2)
    assert folded.tolist() == [
        [0, 1, 2, 10, 11, 12, 3, 4, 5, 13, 14, 15],
        [20, 21, 22, 30, 31, 32, 23, 24, 25, 33, 34, 35],
    ]


@pytest.mark.parametrize(("memory", "excess"), [(0.0, 1.0), (0.5, 1.0), (0.8, 1.1)])
def test_chains_do_not_flatter_walkers_with_a_memory(memory, excess):
    # 200, 67 and 22 autocorrelation times of a walker; a run goes on until they are 50
    draws = walkers_with_memory(np.random.default_rng(1), memory)
    place = fold_chains(np.arange(draws.size).reshape(draws.shape), 4)
    bulk = float(az.ess(draws.ravel()[place], method="bulk"))
    truth = draws.size * (1 - memory) / (1 + memory)
    assert 0.85 * truth < bulk < 1.1 * truth
    assert bulk < excess * effective_sizes(draws)[0]
    if memory == 0.8:  # with walkers side by side their memory would be lost
        beside = draws.reshape(4, 16, 200).swapaxes(1, 2).reshape(4, -1)
        assert float(az.ess(beside, method="bulk")) > 3 * truth


@pytest.mark.parametrize("drift", [0.0, 0.5])
def test_a_drift_in_time_shows_in_r_hat_as_in_ours(drift):
    draws = walkers_with_memory(np.random.default_rng(2), 0.5, drift)
    place = fold_chains(np.arange(draws.size).reshape(draws.shape), 4)
    own = split_r_hat(draws.reshape(4, 16, 200).swapaxes(1, 2)[..., None])[0]
    assert float(az.rhat(draws.ravel()[place])) == pytest.approx(own, abs=1e-6)
    assert (own > 1.02) == (drift > 0)


@pytest.mark.whole
def test_four_chains_hold_every_draw_and_agree_with_the_summary(cheap_posterior):
    whole = cheap_posterior.to_arviz(megabytes=0)
    assert names_of(whole) == {"posterior", "sample_stats", "log_prior", "prior", "observed_data"}
    for name in cheap_posterior.stiffness_names:
        values, known = whole["posterior"][name], cheap_posterior.values(name)
        assert values.dims == ("chain", "draw")
        assert values.shape == (4, known.size // 4)
        assert_array_equal(np.sort(values.values, axis=None), np.sort(known, axis=None))
        own = effective_sizes(np.log(known))[0] if (known > 0).all() else effective_sizes(known)[0]
        scale = np.log(values.values) if (known > 0).all() else values.values
        assert 0.85 * own < float(az.ess(scale, method="bulk")) < 1.02 * own
    r_hat = cheap_posterior.record.r_hat["k11"]
    assert float(az.rhat(whole["posterior"]["k11"].values)) == pytest.approx(r_hat, abs=2e-3)


@pytest.mark.whole
def test_each_draw_has_its_own_density_and_place(cheap_posterior, groups):
    stats = groups["sample_stats"]
    walker, step = stats["walker"].values, stats["step"].values
    assert_array_equal(groups["posterior"]["k12"].values, cheap_posterior.values("k12")[walker, step])
    assert_array_equal(stats["lp"].values, cheap_posterior.log_density[walker, step])
    likelihood, prior = flat(groups, "log_likelihood", "data"), flat(groups, "log_prior", "coordinates")[:, 0]
    assert likelihood.shape[1] == cheap_posterior.problem.test.data.frf.n_lines
    assert_allclose(likelihood.sum(axis=1) + prior, stats["lp"].values.ravel(), rtol=1e-9)


def test_the_prior_is_that_of_the_quantities_too(cheap_posterior, groups):
    # θ are logarithms: ln |dk/dθ| is the sum of ln k
    assert [axis.name for axis in cheap_posterior.problem.parametrisation.axes] == ["k11", "k12", "k22"]
    logs = sum(np.log(flat(groups, "posterior", name)[:, 0]) for name in ("k11", "k12", "k22"))
    change = flat(groups, "log_prior", "to_quantities")[:, 0]
    assert_allclose(change + logs, (change + logs)[0], rtol=1e-9)


def test_replicated_data_scatter_about_the_prediction_as_the_noise_does(cheap_posterior, groups):
    data, stats = cheap_posterior.problem.test.data, groups["sample_stats"]
    rows = cheap_posterior.theta.reshape(*cheap_posterior.log_density.shape, -1)
    theta = rows[stats["walker"].values, stats["step"].values].reshape(-1, rows.shape[2])
    real, imag = (flat(groups, "posterior_predictive", f"data_{part}") for part in ("real", "imag"))
    replicated = real + 1j * imag
    exact = cheap_posterior.problem.log_posterior.predicted(theta).reshape(replicated.shape)
    z = (replicated - exact) / np.sqrt(data.variance.ravel())
    assert np.mean(np.abs(z) ** 2) == pytest.approx(1, abs=0.01)
    assert np.mean(z.real**2) == pytest.approx(0.5, abs=0.01)
    assert_array_equal(flat_observed(groups), data.frf.values.ravel())


def flat_observed(groups):
    observed = groups["observed_data"]
    return (observed["data_real"].values + 1j * observed["data_imag"].values).ravel()


def test_groups_stay_within_the_size_that_is_given(cheap_posterior):
    small = cheap_posterior.to_arviz(megabytes=3)
    nbytes = sum(variable.nbytes for group in POINTWISE for variable in small[group].values())
    assert 2.9e6 < nbytes <= 3e6 + 3 * 8 * 249 * 4
    least = cheap_posterior.to_arviz(megabytes=1e-3)
    assert least["posterior"].sizes["draw"] == 20


def test_values_that_depend_on_each_other_have_no_density_of_their_own(cheap_posterior):
    noise = IntegratedScale(2, 4.0, 3.0)
    posterior = replace(cheap_posterior, problem=cheap_posterior.problem.with_test(noise=noise))
    groups = posterior.to_arviz(megabytes=5)
    assert "log_likelihood" not in names_of(groups)
    assert (
        groups["posterior"]
        .attrs["log_likelihood"]
        .startswith("left out: noise: found IntegratedScale, whose values depend on each other")
    )
    # the scale is drawn given the data, whose noise is as stated, not from its prior, which is centred on 3
    scatter = [away_from_data(each, posterior.problem.test.data) for each in (groups, cheap_posterior.to_arviz(5))]
    assert scatter[0] == pytest.approx(scatter[1], rel=0.15)


def away_from_data(groups, data):
    away = flat(groups, "posterior_predictive", "data_real") - data.frf.values.real.ravel()
    return np.mean(away**2 / data.variance.ravel())


@pytest.mark.whole
def test_several_tests_have_a_variable_each():
    groups = posterior_of(jb.case_from_text("overhangs", BASE + CLAMP_EDGE + TWO + HEARD)).to_arviz()
    names = set(groups["observed_data"].data_vars)
    assert {name.rsplit("_", 1)[0] if name.endswith(("real", "imag")) else name for name in names} == {
        "data_long", "data_short", "data_heard",
    }  # fmt: skip
    assert set(groups["posterior_predictive"].data_vars) == names
    likelihood, prior = flat(groups, "log_likelihood", "data"), flat(groups, "log_prior", "coordinates")[:, 0]
    assert_allclose(likelihood.sum(axis=1) + prior, groups["sample_stats"]["lp"].values.ravel(), rtol=1e-9)


def test_data_say_what_each_value_stands_for(cheap_posterior, groups):
    frf = cheap_posterior.problem.test.data.frf
    for group, leading in (("observed_data", ()), ("posterior_predictive", BY_DRAW), ("log_likelihood", BY_DRAW)):
        data = groups[group]["data"]
        assert data.dims == (*leading, "frequency", "output", "input")
        assert_array_equal(data["frequency"], frf.frequency_hz)
        assert (data["output"].values.tolist(), data["input"].values.tolist()) == (["5:y"], ["5:y"])
    assert_array_equal(groups["observed_data"]["data"].values, np.abs(frf.values))
    replicated = groups["posterior_predictive"]
    assert_allclose(replicated["data"], np.hypot(replicated["data_real"], replicated["data_imag"]))
    assert replicated["data_imag"].dims == replicated["data"].dims


@pytest.mark.whole
def test_natural_frequencies_are_named(frequency_posterior):
    whole = frequency_posterior.to_arviz()
    for group in ("observed_data", "posterior_predictive", "log_likelihood"):
        assert whole[group]["data"].dims[-1] == "quantity"
        assert whole[group]["data"]["quantity"].values.tolist() == ["frequency 1", "frequency 2", "frequency 3"]


@pytest.mark.whole
@pytest.mark.filterwarnings("ignore:Estimated shape parameter of Pareto:UserWarning")
@pytest.mark.parametrize("name", ["cheap_posterior", "frequency_posterior"])
def test_leave_one_out_pit_finds_the_data_of_each_likelihood(name, request):
    whole = request.getfixturevalue(name).to_arviz(megabytes=20)
    new = int(az.__version__.split(".")[0]) >= 1
    found = az.loo_pit(whole, var_names="data")["data"] if new else az.loo_pit(whole, y="data")
    assert found.shape == whole["observed_data"]["data"].shape
    pit = np.ravel(found)
    assert ((pit >= 0) & (pit <= 1)).all()
    if pit.size > 100:  # the data are of the model: uniform
        assert pit.mean() == pytest.approx(0.5, abs=4 / np.sqrt(12 * pit.size))


@pytest.mark.whole
def test_a_chain_has_a_thousand_draws_at_most_unless_more_are_asked_for(cheap_posterior):
    length = cheap_posterior.log_density.size // 4
    assert length > 1200
    assert cheap_posterior.to_arviz()["posterior"].sizes["draw"] == 1000
    assert cheap_posterior.to_arviz(max_draws=1200)["posterior"].sizes["draw"] == 1200
    assert cheap_posterior.to_arviz(megabytes=0)["posterior"].sizes["draw"] == length


@pytest.mark.filterwarnings("ignore:Estimated shape parameter of Pareto:UserWarning")
def test_leaving_one_out_costs_what_the_effective_parameters_do(groups):
    whole = az.loo(groups)
    elpd, effective = (whole.elpd, whole.p) if hasattr(whole, "elpd") else (whole.elpd_loo, whole.p_loo)
    log_likelihood = flat(groups, "log_likelihood", "data")
    within = np.log(np.exp(log_likelihood - log_likelihood.max(axis=0)).mean(axis=0)) + log_likelihood.max(axis=0)
    assert within.sum() - elpd == pytest.approx(effective, rel=1e-6)
    assert 1 < effective < 6  # three stiffnesses
