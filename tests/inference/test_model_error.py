"""Errors of the model in modes: the dense normal density, one error shared by tests of one structure, changes seen."""

import math

import numpy as np
import pytest
from scipy import stats

import jointbayes as jb
from jointbayes.case.case import case_from_text
from jointbayes.errors import CaseError
from jointbayes.inference import ErrorSizes, ModelErrorNoise
from jointbayes.measurement import Antiresonances, FrequencyData, ModalConstants, ModeData, ModeShapes, Observed
from jointbayes.studies.data_sets import simulated_problem
from tests.conftest import CONFIGS

SIZES = ErrorSizes(frequency=0.004, factor=2.0, damping=0.25, shape=0.04, constant=0.15)
KNOWN = SIZES.damping, SIZES.shape, SIZES.constant
#: Two repetitions of two modes, the second without a damping ratio of mode 2; a shape at one DOF, seen in the first;
#: two antiresonances, one of them seen twice, and a modal constant of each mode.
MODES = ModeData(
    Observed(np.array([[12.0, 31.0], [12.1, 31.2]]), np.array([0.05, 0.1])),
    Observed(np.array([[0.01, 0.02], [0.012, np.nan]]), np.array([0.001, 0.002])),
    ModeShapes(("1:x",), "2:x", Observed(np.array([[[0.6], [-1.6]], [[0.61], [np.nan]]]), np.array([[0.02], [0.03]]))),
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
    dense = np.diag(np.concatenate([data.sd for data in tests]) ** 2)
    for i, first in enumerate(names):
        for j, second in enumerate(names):
            if first == second:
                kind = first.split()[0]
                dense[i, j] += size[kind] ** 2 * (1.0 if kind == "shape" else values[i] * values[j])
    return dense


@pytest.mark.parametrize("tests", [(MODES,), (EIGENVALUES, OTHER_LEVEL), (OTHER_LEVEL, OTHER_LEVEL, MODES)])
def test_the_density_is_the_dense_normal_one_whose_tests_share_each_error(tests):
    rng = np.random.default_rng(1)
    own = [ModelErrorNoise.of(data, *KNOWN) for data in tests]
    noise = own[0].shared(own) or own[0]
    sd = np.concatenate([data.sd for data in tests])
    for error in (1e-5, 0.004, 0.3):
        dense = covariance(error, *tests) / np.outer(sd, sd)  # of residuals over their stated deviations
        residual = rng.multivariate_normal(np.zeros(sd.size), dense)
        z = (residual / math.sqrt(2))[None, :, None]
        value = noise.log_likelihood(z, [[error]])[0] - sd.size * math.log(math.sqrt(2 * math.pi))
        assert value == pytest.approx(stats.multivariate_normal(cov=dense).logpdf(residual), rel=1e-9)
        scores = math.sqrt(2) * noise.scores(z, [[error]])[0, :, 0]
        assert scores @ scores == pytest.approx(residual @ np.linalg.solve(dense, residual), rel=1e-9)


def test_replicated_residuals_have_that_covariance():
    noise, error = ModelErrorNoise.of(MODES, *KNOWN), 0.02
    drawn = noise.draw(np.random.default_rng(2), np.full((200_000, 1), error), MODES.values.size, 1)[:, :, 0]
    dense = covariance(error, MODES) / np.outer(MODES.sd, MODES.sd) / 2
    scale = np.sqrt(np.outer(np.diag(dense), np.diag(dense)))
    assert np.abs((drawn.T @ drawn / len(drawn) - dense) / scale).max() < 0.02


def test_tests_of_other_noise_share_nothing():
    one = ModelErrorNoise.of(MODES, *KNOWN)
    assert one.shared([one]) is None


LEVELS = """
extends = "clamped_beam_frequencies_360mm.toml"
remove = ["compare", "data", "joint", "prior"]
title = "One clamp at two torques"
level = { name = "torque", unit = "N m" }
joint = { kind = "springs", dofs = ["1:y", "1:rz"], own = true }
prior.ky = { distribution = "log_uniform", low = 1e6, high = 1e11 }
prior.krz = { distribution = "log_uniform", low = 1e3, high = 1e8 }
data = { kind = "natural_frequencies", frequencies_hz = [FIRST], sd_relative = 0.0002 }
noise.model_error = { frequency_error = 0.004, error_factor = 2.0 }
setups.low.level = 10.0
setups.high.level = 20.0
setups.high.data.frequencies_hz = [SECOND]
"""
WRONG = 1 + np.array([0.004, -0.005, 0.003])  # predicted frequencies, at both levels
LOOSE, TIGHT = {"low.ky": 5e7, "low.krz": 5e4}, {"high.ky": 5e7, "high.krz": 5.5e4}


def levels(tmp_path, first, second):
    """A case of two set-ups of one structure, whose data are these frequencies."""
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
    assert problem.names == ("low.ky", "low.krz", "high.ky", "high.krz", "model_error")
    estimate = jb.find_map(problem, seed=1)
    sd = np.sqrt(np.diag(estimate.covariance))
    of_change = math.sqrt(sd[1] ** 2 + sd[3] ** 2 - 2 * estimate.covariance[1, 3])
    assert sd[1] > 0.01  # as 0.4 % of a frequency makes it
    assert of_change < 0.2 * sd[1]
    assert abs(estimate.theta[3] - estimate.theta[1] - math.log(1.1)) < 3 * of_change


def test_the_density_of_tests_together_has_the_slope_of_its_residuals(torques):
    density = torques.problem.log_posterior
    theta = jb.find_map(torques.problem, seed=1).theta + np.array([0.03, -0.01, 0.02, 0.02, 0.2])
    residual, jacobian = density.residuals(theta)
    step = 1e-5
    for i in range(4):  # the size of the error is no least-squares parameter
        move = np.eye(5)[i] * step
        up, down = density(np.stack([theta + move, theta - move]))
        assert -(jacobian.T @ residual)[i] == pytest.approx((up - down) / (2 * step), rel=1e-5)


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
    problem = torques.problem
    theta = np.append(np.log([5e7, 5e4, 5e7, 5.5e4]), np.log(0.004))
    rng = np.random.default_rng(3)
    predicted = problem.log_posterior.predicted(theta)[0]
    measured = [simulated_problem(problem, problem, theta, rng).tests for _ in range(800)]
    residual = np.array([np.concatenate([test.data.values for test in tests]) for tests in measured]) - predicted
    stated = covariance(0.004, *(test.data for test in problem.tests))
    scale = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    assert (stated / scale)[0, 3] > 0.99  # the first mode at either level
    assert np.abs((residual.T @ residual / len(residual) - stated) / scale).max() < 0.12


def test_errors_of_the_model_need_modes_and_known_errors_of_measurement(tmp_path):
    frf = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")
    with pytest.raises(
        CaseError, match=r"noise\.model_error: found the model's errors in modes, where the data are FRFs"
    ):
        case_from_text("frf", frf + "\n[noise.model_error]\n")
    modes = (CONFIGS / "two_storeys.toml").read_text(encoding="utf-8")
    with pytest.raises(CaseError, match=r"noise\.scale"):
        case_from_text("modes", modes + '\n[noise]\nscale = "sampled"\n[noise.model_error]\n')
