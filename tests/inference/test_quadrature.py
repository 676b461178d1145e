"""Quadrature on a few lines gives the likelihood of all lines, knows where it does not, and changes no small case."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes import workflow
from jointbayes.inference import IntegratedScale, LogPosterior, ScaledNoise, on_nodes, quadrature
from tests.conftest import FEW_STEPS, cheap_text, edited

_SCALE = jb.Nuisance("noise_scale", "1", 1.0, jb.Normal(0.0, 0.3))


def around(problem, width, count=300):
    """Joints about the mode, so many times as far as the posterior's Laplace approximation reaches."""
    mode, covariance = jb.find_map(problem).starts_for_draws[0]
    drawn = np.random.default_rng(1).multivariate_normal(mode, width**2 * covariance, size=count)
    return drawn[np.isfinite(problem.prior.log_density(drawn))]


def largest_error(density, problem, theta):
    return np.abs(density(theta) - problem.log_posterior(theta)).max()


def parts_of(density, problem, theta):
    """Sums of squares by quadrature at some joints, and whether they may be relied on."""
    reduced = density.likelihood.terms[0].likelihood._reduced
    return reduced(problem.prior.matrix(theta), problem.prior.factors(theta))


def unknown(problem, nuisance, **of_test):
    return replace(problem.with_test(**of_test), prior=replace(problem.prior, nuisances=(nuisance,)))


KINDS = {
    "as stated": lambda problem: problem,
    "scale sampled": lambda problem: unknown(problem, _SCALE, noise=ScaledNoise()),
    "scale integrated": lambda problem: problem.with_test(noise=IntegratedScale()),
    "gain": lambda problem: unknown(problem, jb.Nuisance("gain", "1", 1.0, jb.Normal(0.0, 0.02))),
}


@pytest.mark.parametrize("kind", KINDS)
def test_it_gives_what_all_lines_give(cheap_case, kind):
    """Of 249 lines some dozen; a wrong sign, or 1 % in the weight of a term, is far more than this error."""
    problem = KINDS[kind](cheap_case.problem)
    density = on_nodes(problem, around(problem, 1.5), least_values=0)
    assert density is not problem.log_posterior
    theta = around(problem, 1.0, 100)
    _, relied_on = parts_of(density, problem, theta)
    assert relied_on.mean() > 0.95
    assert largest_error(density, problem, theta) < 0.01
    assert np.ptp(problem.log_posterior(theta)) > 3


@pytest.fixture(scope="module")
def narrow():
    """Resonances of a thousandth of the distance of the lines: as the joint changes they jump from line to line."""
    text = edited(cheap_text(), ("ratio = 0.01", "ratio = 1.0e-5"))
    return jb.case_from_text("narrow", text).problem


def test_a_resonance_between_the_nodes_is_noticed(narrow):
    """Joints of which one stands on a line where no joint of the basis has any: by the nodes off by 1 and far more."""
    density = on_nodes(narrow, around(narrow, 0.5), least_values=0)
    far = around(narrow, 20.0, 2000)
    squares, relied_on = parts_of(density, narrow, far)
    likelihood = density.likelihood.terms[0].likelihood
    wrong = np.abs(likelihood.constant - squares - narrow.log_posterior.log_likelihood(far))
    assert (wrong > 1).sum() > 500
    assert wrong[relied_on].max() < 0.02
    assert largest_error(density, narrow, far) < 0.02


def test_what_a_few_lines_cannot_sum_or_need_not_is_computed_on_all(cheap_case, narrow):
    problem = cheap_case.problem
    theta, student = around(problem, 1.5), problem.with_test(noise=jb.StudentNoise())
    assert on_nodes(narrow, around(narrow, 20.0, 2000), least_values=0) is narrow.log_posterior  # a direction each
    assert on_nodes(problem, theta) is problem.log_posterior
    assert on_nodes(student, theta, least_values=0) is student.log_posterior
    assert on_nodes(problem, theta[:20], least_values=0) is problem.log_posterior


@pytest.mark.parametrize("limits", [{"TOLERATED": 1e-9}, {"_FEWEST_NODES": 1, "_EQUATIONS": 0}])
def test_a_basis_that_misses_joints_kept_aside_or_leaves_nothing_over_at_the_nodes_is_not_used(
    cheap_case, monkeypatch, limits
):
    problem = cheap_case.problem
    for name, limit in limits.items():
        monkeypatch.setattr(quadrature, name, limit)
    assert on_nodes(problem, around(problem, 1.5), least_values=0) is problem.log_posterior


def test_several_tests_are_reduced_each_by_itself(cheap_case):
    first, other = (replace(cheap_case.problem.test, name=name) for name in ("loud", "quiet"))
    problem = replace(cheap_case.problem, tests=(first, other))
    density = on_nodes(problem, around(problem, 1.5), least_values=0)
    assert all(term.likelihood._reduced is not None for term in density.likelihood.terms)
    assert largest_error(density, problem, around(problem, 1.0, 100)) < 0.02


def test_a_process_of_its_own_computes_the_same_bits(cheap_case):
    problem = cheap_case.problem
    theta = around(problem, 1.5)
    density = on_nodes(problem, theta, least_values=0)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(density))(theta), density(theta))


@pytest.fixture
def for_all(monkeypatch):
    """Quadrature of FRFs of any number of lines."""
    monkeypatch.setattr(workflow, "on_nodes", lambda problem, theta: on_nodes(problem, theta, least_values=0))


def test_a_run_ends_with_ln_p_on_all_lines_at_its_draws(cheap_case, for_all):
    posterior = jb.sample(cheap_case, settings=FEW_STEPS)
    assert "quadrature" in posterior.reason
    density = posterior.log_density.ravel()
    np.testing.assert_array_equal(density, cheap_case.problem.log_posterior(posterior.theta))
    again = jb.sample(cheap_case, settings=FEW_STEPS)
    np.testing.assert_array_equal(again.theta, posterior.theta)


def test_draws_that_all_lines_do_not_confirm_are_drawn_anew(cheap_case, monkeypatch):
    """A density that is tilted by a tenth of a standard deviation: of weights 0.99 efficient."""

    def tilted(problem, theta):
        exact, sd = problem.log_posterior, theta.std(axis=0)[0]
        return LogPosterior(exact.prior, exact.likelihood, lambda t: 0.1 * (t[:, 0] - theta[:, 0].mean()) / sd)

    expected = jb.sample(cheap_case, settings=FEW_STEPS)
    monkeypatch.setattr(workflow, "on_nodes", tilted)
    posterior = jb.sample(cheap_case, settings=FEW_STEPS)
    assert "quadrature" not in posterior.reason
    np.testing.assert_array_equal(posterior.theta, expected.theta)
