"""Errors of the model in modes: the dense normal density, one error shared by tests of one structure, changes seen."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

import jointbayes as jb
from jointbayes.case.case import case_from_text
from jointbayes.errors import CaseError
from jointbayes.inference import ErrorSizes, ModelErrorNoise
from tests.case.refusal_rows import parts_named
from tests.conftest import CONFIGS, edited
from tests.oracles import differences
from tests.science.calibration import simulated_problem
from vibrecords import Antiresonances, FrequencyData, ModalConstants, ModeData, ModeShapes, Observed

SIZES = ErrorSizes(frequency=0.004, factor=2.0, damping=0.25, shape=0.04, constant=0.15)
KNOWN = SIZES.damping, SIZES.shape, SIZES.constant
#: Two repetitions of two modes, the second without a damping ratio of mode 2; a shape at one DOF, seen in the first;
#: two antiresonances, one of them seen twice, and a modal constant of each mode.
MODES = ModeData(
    Observed(np.array([[12.0, 31.0], [12.1, 31.2]]), np.array([0.05, 0.1])),
    Observed(np.array([[0.01, 0.02], [0.012, np.nan]]), np.array([0.001, 0.002])),
    ModeShapes(("1:x",), "2:x", Observed(np.array([[[0.2], [-1.6]], [[0.21], [np.nan]]]), np.array([[0.02], [0.03]]))),
    zeros=Antiresonances("2:x", Observed(np.array([[8.0, 20.0], [8.1, np.nan]]), 0.04)),
    constants=ModalConstants(("1:x",), ("2:x",), Observed(np.array([[0.4], [-0.9]]), 0.05)),
)
EIGENVALUES = ModeData(Observed(np.array([5700.0, 38000.0]), np.array([40.0, 300.0])), eigenvalues=True)
OTHER_LEVEL = FrequencyData([11.9, 30.8, 70.0], [0.05, 0.1, 0.2])


def covariance(error, *tests):
    """Of the values of several tests, by pairs: the stated variance, and an error wherever both are of one quantity."""
    names = [name.replace("eigenvalue", "frequency") for data in tests for name in data.value_names]
    # (2πf)² moves by twice the share by which f does
    values = np.concatenate([data.values * (2 if data is EIGENVALUES else 1) for data in tests])
    size = dict(zip(("damping", "shape", "constant"), KNOWN, strict=True)) | {"frequency": error, "zero": error}
    # a component of a shape is off by a fraction of itself, or of 0.3 where it is less
    least = [0.3 if name.startswith("shape") else 0.0 for name in names]
    values = np.maximum(np.abs(values), least)
    dense = np.diag(np.concatenate([data.sd for data in tests]) ** 2)
    for i, first in enumerate(names):
        for j, second in enumerate(names):
            if first == second:
                kind = first.split()[0]
                dense[i, j] += size[kind] ** 2 * values[i] * values[j]
    return dense


def noise_of(*tests, bodies=None):
    """The noise of several tests, of one structure unless their bodies are numbered otherwise."""
    each = [ModelErrorNoise.of(data, SIZES) for data in tests]
    return each[0].shared(each, bodies or [0] * len(each))


def log_density(residual, sd, tests):
    """ln of the mean of the dense normal density over the log-normal prior of the size of a frequency's error."""

    def density(u):
        dense = covariance(SIZES.frequency * SIZES.factor**u, *tests) / np.outer(sd, sd)
        return stats.norm.pdf(u) * math.exp(stats.multivariate_normal(cov=dense).logpdf(residual) + 0.5 * residual.size)

    return math.log(integrate.quad(density, -8, 8, epsabs=0, epsrel=1e-10, limit=400)[0]) - 0.5 * residual.size


@pytest.mark.parametrize("tests", [(MODES,), (EIGENVALUES, OTHER_LEVEL), (OTHER_LEVEL, OTHER_LEVEL, MODES)])
def test_the_density_is_the_mean_of_dense_normal_ones_whose_tests_share_each_error(tests):
    rng, noise = np.random.default_rng(1), noise_of(*tests)
    sd = np.concatenate([data.sd for data in tests])
    for error in (1e-4, 0.004, 0.03):
        residual = rng.multivariate_normal(np.zeros(sd.size), covariance(error, *tests) / np.outer(sd, sd))
        value = noise.log_likelihood((residual / math.sqrt(2))[None, :, None], ())[0]
        value -= sd.size * math.log(math.sqrt(2 * math.pi))
        assert value == pytest.approx(log_density(residual, sd, tests), abs=1e-4)


def test_sizes_are_integrated_over_in_no_more_directions_than_they_move():
    noise = ModelErrorNoise.of(MODES, SIZES)
    assert noise._by_node[0].shape[2] == len({"frequency 1", "frequency 2", "zero 1", "zero 2"}) < MODES.values.size


def test_tests_of_two_structures_share_the_size_of_errors_and_no_error():
    two, one = noise_of(OTHER_LEVEL, OTHER_LEVEL, bodies=[0, 1]), noise_of(OTHER_LEVEL, OTHER_LEVEL)
    alone = ModelErrorNoise.of(OTHER_LEVEL, SIZES)
    z = np.array([30.0, -20.0, 25.0, 30.0, -20.0, 25.0])[None, :, None]  # the same large residuals in both
    apart = 2 * alone.log_likelihood(z[:, :3], ())
    assert one.log_likelihood(z, ()) > two.log_likelihood(z, ()) > apart


def test_scores_are_white_in_the_mean_whatever_the_size_of_the_error():
    noise = noise_of(MODES, OTHER_LEVEL)
    z = noise.draw(np.random.default_rng(3), np.empty((20_000, 0)), MODES.values.size + 3, 1)
    square = 2 * noise.scores(z, ())[:, :, 0] ** 2
    assert square.mean(axis=0) == pytest.approx(1.0, abs=0.05)


def test_replicated_residuals_have_the_covariance_of_the_mean_square_of_that_size():
    noise = ModelErrorNoise.of(MODES, SIZES)
    drawn = noise.draw(np.random.default_rng(2), np.empty((400_000, 0)), MODES.values.size, 1)[:, :, 0]
    error = SIZES.frequency * math.exp(math.log(SIZES.factor) ** 2)  # root mean square of the log-normal
    dense = covariance(error, MODES) / np.outer(MODES.sd, MODES.sd) / 2
    scale = np.sqrt(np.outer(np.diag(dense), np.diag(dense)))
    assert np.abs((drawn.T @ drawn / len(drawn) - dense) / scale).max() < 0.03


def test_the_size_of_the_error_is_drawn_as_residuals_leave_it():
    noise, rng = ModelErrorNoise.of(OTHER_LEVEL, SIZES), np.random.default_rng(4)
    z = np.full((4000, 3, 1), 0.0)
    z[2000:, :, 0] = 0.02 * OTHER_LEVEL.values / OTHER_LEVEL.sd / math.sqrt(2)  # 2 % of each frequency
    small, large = np.split(noise.draw_size(rng, z)[:, 0], 2)
    assert np.median(small) < SIZES.frequency < 0.008 < np.median(large) < 0.03


LEVELS = parts_named("rooms")["inference/model_error levels"]
WRONG = 1 + np.array([0.004, -0.005, 0.003])  # predicted frequencies, at both levels
LOOSE, TIGHT = {"low.ky": 5e7, "low.krz": 5e4}, {"high.ky": 5e7, "high.krz": 5.5e4}


def levels(tmp_path, first, second):
    """A case of two tests of one structure, whose data are these frequencies."""
    text = LEVELS.replace("FIRST", str(list(first))[1:-1]).replace("SECOND", str(list(second))[1:-1])
    (tmp_path / "levels.toml").write_text(text.replace('extends = "', f'extends = "{CONFIGS}/'), encoding="utf-8")
    return jb.load_case(tmp_path / "levels.toml", allow_outside=True)


@pytest.fixture(scope="module")
def torques(tmp_path_factory):
    """Two torques of a clamp whose second spring grows by 10 %, by a model that is wrong alike in both."""
    place = tmp_path_factory.mktemp("levels")
    rough = levels(place, [136.0, 851.0, 2340.0], [137.0, 855.0, 2350.0]).problem
    truth = np.array([(LOOSE | TIGHT)[name] for name in rough.names[:4]])
    low, high = (part.natural_frequencies_hz(truth, 3)[0] * WRONG for part in rough.parts)
    return levels(place, low.tolist(), high.tolist())


def test_two_levels_of_one_structure_tell_their_ratio_far_better_than_either_stiffness(torques):
    problem = torques.problem
    assert problem.names == ("low.ky", "low.krz", "high.ky", "high.krz")
    estimate = jb.find_map(problem, seed=1)
    sd = np.sqrt(np.diag(estimate.covariance))
    of_change = math.sqrt(sd[1] ** 2 + sd[3] ** 2 - 2 * estimate.covariance[1, 3])
    assert sd[1] > 0.01  # as 0.4 % of a frequency makes it
    assert of_change < 0.2 * sd[1]
    assert abs(estimate.theta[3] - estimate.theta[1] - math.log(1.1)) < 3 * of_change


def test_the_density_of_tests_together_has_the_slope_of_its_residuals(torques):
    density = torques.problem.log_posterior
    theta = jb.find_map(torques.problem, seed=1).theta + np.array([0.03, -0.01, 0.02, 0.02])
    residual, jacobian = density.residuals(theta)
    assert -(jacobian.T @ residual) == pytest.approx(differences(lambda at: density(at)[0], theta), rel=1e-5)


@pytest.mark.science
def test_draws_of_two_levels_hold_the_change_and_come_back_from_their_file(torques, tmp_path):
    posterior = jb.sample(torques, seed=1)
    assert posterior.converged
    assert posterior.check.explains
    change = posterior.values("high.krz") / posterior.values("low.krz")
    low, high = np.quantile(change, [0.025, 0.975])
    assert low < 1.1 < high
    assert high / low < 1.01 < posterior.interval("low.krz")[1] / posterior.interval("low.krz")[0]
    posterior.save(tmp_path / "posterior.nc")
    again = jb.load_posterior(tmp_path / "posterior.nc")
    theta = posterior.theta[:5]
    assert np.array_equal(again.problem.log_posterior(theta), posterior.problem.log_posterior(theta))


def test_simulated_data_of_two_levels_share_the_errors_that_the_likelihood_has_them_share(torques):
    sizes = replace(SIZES, factor=1.0001)  # one size only
    tests = [replace(test, noise=replace(test.noise, sizes=sizes)) for test in torques.problem.tests]
    problem = jb.Problem(tests, torques.problem.prior)
    theta = np.log([5e7, 5e4, 5e7, 5.5e4])
    rng = np.random.default_rng(3)
    predicted = problem.log_posterior.predicted(theta)[0]
    measured = [simulated_problem(problem, problem, theta, rng).tests for _ in range(800)]
    residual = np.array([np.concatenate([test.data.values for test in tests]) for tests in measured]) - predicted
    stated = covariance(0.004, *(test.data for test in problem.tests))
    scale = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    assert (stated / scale)[0, 3] > 0.99  # the first mode at either level
    assert np.abs((residual.T @ residual / len(residual) - stated) / scale).max() < 0.12


@pytest.mark.parametrize(
    ("shipped", "change", "more", "message"),
    [
        ("clamped_beam", (), "", r"uncertain\.model_error: found the model's errors in modes, where the data"),
        ("two_storeys", (), "", r'uncertain\.exact: found "model", whose errors \[uncertain\.model_error\] states'),
        ("two_storeys", [('exact = ["model"]', "exact = []")], '[noise]\nscale = "sampled"\n', r"noise\.scale"),
    ],
)
def test_errors_of_the_model_need_modes_and_known_errors_of_measurement(shipped, change, more, message):
    text = edited((CONFIGS / f"{shipped}.toml").read_text(encoding="utf-8"), *change)
    with pytest.raises(CaseError, match=message):
        case_from_text("case", f"{text}\n{more}[uncertain.model_error]\n")
