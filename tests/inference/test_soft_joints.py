"""Soft joints, thin posteriors: coordinates, starts and walkers that find the mode."""

from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.case.case import case_from_text
from jointbayes.frf import DirectSolve, Ports
from jointbayes.identification.starting_points import screened_draws
from jointbayes.inference.noise.gaussian import GaussianNoise
from jointbayes.sampling.density import newton_climb
from tests.conftest import best_of, cheap_text, pair_matrix
from tests.science.calibration_data import VARIANTS, case_of
from vibrecords import FrfSet

CALIBRATION = 20220322  # its seed


@pytest.fixture(scope="module")
def exact():
    return case_from_text("cheap", cheap_text().replace("added = true", "added = false"))


def calibration_data_of_before(variant, index):
    """Truth, case with data, and seed of a data set of the first calibration, in which the mode was missed."""
    rng = np.random.default_rng(np.random.SeedSequence(CALIBRATION, spawn_key=(list(VARIANTS).index(variant), index)))
    base = case_of(variant)
    problem = base.problem
    nominal, noise, at_joint = problem.test.data, problem.test.noise or GaussianNoise(), problem.test.data.joint_frf
    theta = problem.prior.sample(rng, 1)[0]
    factors = problem.prior.factors(theta)
    structure = problem.test.structures.structure(problem.structural(factors))
    ports = Ports(at_joint.frequency_hz, at_joint.outputs, at_joint.inputs)
    matrix = pair_matrix(problem.prior.values(theta))
    values = DirectSolve(structure, problem.test.joints, ports).receptance(matrix)[0]
    measured = len(nominal.frf.outputs)
    hyper = factors[None, factors.size - len(noise.names) :]
    z = noise.draw(rng, hyper, ports.frequency_hz.size, measured * len(ports.inputs))
    values[:, :measured] += np.sqrt(nominal.variance) * z.reshape(values[:, :measured].shape)
    rest = values[:, measured:]
    values[:, measured:] += 0.05 * np.abs(rest) * (rng.normal(size=rest.shape) + 1j * rng.normal(size=rest.shape))
    frf = FrfSet(ports.frequency_hz, values, ports.outputs, ports.inputs, "receptance")
    used = replace(nominal, frf=frf.select(nominal.frf.outputs, nominal.frf.inputs), joint_frf=frf)
    return theta, replace(base, problem=problem.with_test(data=used)), int(rng.integers(2**32))


@pytest.mark.science
@pytest.mark.parametrize(("variant", "index"), [("joint", 98), ("joint", 460), ("noise scale", 8)])
def test_the_mode_of_a_soft_joint_is_found(variant, index):
    """Data sets of the calibration whose mode no start reached before prior draws were screened."""
    theta, case, seed = calibration_data_of_before(variant, index)
    assert jb.find_map(case, seed=seed).log_posterior > case.problem.log_posterior(theta)[0]


def test_screened_draws_fit_more_lines_than_others_and_stand_apart(exact):
    posterior = exact.problem.log_posterior
    picked = screened_draws(posterior, np.random.default_rng(1), 1000, 5)
    assert picked.shape == (5, 3)
    joint = picked / posterior.prior.sd
    assert min(np.abs(joint[i] - joint[k]).max() for i in range(5) for k in range(i)) > 0.5
    others = posterior.prior.sample(np.random.default_rng(2), 200)
    assert np.median(posterior(picked)) > np.median(posterior(others))


def test_a_screened_start_that_leads_to_the_known_mode_changes_nothing(exact):
    posterior = exact.problem.log_posterior
    starts = {"truth": [5.05e9, 3.44e7, 1.52e6]}
    plain = best_of(posterior, starts)
    more = best_of(posterior, starts, [np.log([4e9, 3e7, 1.4e6])])
    assert np.array_equal(more.theta, plain.theta)
    assert [s.name for s in more.starts] == ["truth", "screened draw 1"]
    assert more.starts[1].reached_mode


def test_a_step_of_a_climb_does_not_leave_all_finite_stiffnesses():
    asked = []

    def far_away(theta):
        asked.append(np.abs(theta).max())
        return -np.log1p((theta[:, 0] - 1e4) ** 2)

    newton_climb(far_away, np.array([0.0]), np.array([[1e6]]))
    differences, first_step = asked[:2]
    assert differences == pytest.approx(100.0)
    assert first_step == pytest.approx(50.0)  # Newton's own is 3200
