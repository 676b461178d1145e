"""The benchmarks compare like with like, and write what they measured."""

import json

import numpy as np
import pytest
from benchmarks import cases, jax_model, likelihood, page, peers, record, timing
from benchmarks.peer_samplers import stretch_run

from jointbayes.inference import LogPosterior
from tests.one_line import says

pytestmark = pytest.mark.docs

PEERS = [
    ("modal", peers.dense_loop),
    ("modal", peers.dense_batched),
    ("modal", peers.modal_sum),
    ("loss_factor", peers.dense_loop),
    ("loss_factor", peers.dense_batched),
    ("loss_factor", peers.batched_solve),
    ("loss_factor", peers.closed_form),
]


@pytest.fixture(scope="module")
def quick():
    return {law: cases.quick_case(law) for law in cases.CASES}


def some_joints(case):
    """Joints near the truth, much softer ones, and stiffer ones."""
    _, matrices = cases.joints(case, 3)
    softer, stiffer = [[1e-3, 1e-2], [1e-2, 0.1]], [[10.0, 3.0], [3.0, 10.0]]
    return np.concatenate([matrices, matrices * softer, matrices * stiffer])


@pytest.mark.parametrize(("law", "peer"), PEERS, ids=lambda value: getattr(value, "__name__", value))
def test_a_peer_computes_the_same_likelihood(quick, law, peer):
    matrices, problem = some_joints(quick[law]), quick[law].problem
    test = peers.Test(problem)
    # every mode of the same elements, as the peers have them; to a sampler the reduced model is the same
    likelihood = problem.with_test(structure=test.structure.reference()).log_posterior.likelihood
    expected = likelihood.log_likelihood(matrices)
    # ln L is the difference of its constant and χ²/2: digits are lost from those, not from what is left
    np.testing.assert_allclose(peer(test)(matrices), expected, rtol=1e-8, atol=1e-8 * abs(likelihood.constant))
    np.testing.assert_allclose(problem.log_posterior.likelihood.log_likelihood(matrices), expected, atol=1e-2, rtol=0)


@pytest.mark.parametrize("law", list(cases.CASES))
def test_the_jax_model_computes_the_same_posterior_and_its_gradient(quick, law):
    jax = pytest.importorskip("jax", reason="JAX is not installed: pip install 'jointbayes[bench]'")
    problem = quick[law].problem
    matrices = some_joints(quick[law])
    value = jax.jit(jax_model.log_likelihood(problem))
    found = [float(value(k)) for k in matrices[:, [0, 0, 1], [0, 1, 1]]]
    np.testing.assert_allclose(found, problem.log_posterior.likelihood.log_likelihood(matrices), rtol=1e-8)

    theta, _ = cases.joints(quick[law], 1)
    unbounded = jax_model.to_unbounded(problem, theta[0])
    np.testing.assert_allclose(jax_model.to_theta(problem, unbounded), theta[0], rtol=1e-12)
    low, high = problem.prior.support
    stretch = (theta[0] - low) * (high - theta[0]) / (high - low)  # dθ/d(unbounded)
    # ln |dθ/du| = ln(θ − low) + ln(high − θ) + constant in each coordinate
    expected = (problem.log_posterior.gradient(theta[0]) + (1 / (theta[0] - low) - 1 / (high - theta[0]))) * stretch
    np.testing.assert_allclose(jax.jit(jax.grad(jax_model.log_density(problem)))(unbounded), expected, rtol=1e-6)


def test_off_the_cone_the_jax_density_is_zero_and_its_gradient_finite(quick):
    jax = pytest.importorskip("jax", reason="JAX is not installed: pip install 'jointbayes[bench]'")
    density = jax.jit(jax.value_and_grad(jax_model.log_density(quick["loss_factor"].problem)))
    value, gradient = density(jax_model.to_unbounded(quick["loss_factor"].problem, np.log([2e6, 9e9, 2e3])))
    assert float(value) == -np.inf
    assert np.isfinite(gradient).all()


def test_the_effective_samples_of_the_stretch_move_are_those_of_a_gaussian_known_to_be_easy():
    rng = np.random.default_rng(1)
    run = stretch_run(lambda x: -0.5 * (x**2).sum(axis=-1), rng.normal(size=(32, 3)), 0.7, 1)
    assert 15 < run.tau < 60  # about 30 steps in three dimensions
    assert run.evaluations >= 32 * len(run.theta) / 32
    np.testing.assert_allclose(run.mean, 0.0, atol=5 / np.sqrt(run.ess))
    np.testing.assert_allclose(run.sd, 1.0, atol=5 / np.sqrt(run.ess))


def test_what_is_called_jointbayes_is_the_public_density(quick, monkeypatch):
    asked = []
    monkeypatch.setattr(LogPosterior, "__call__", lambda _, theta: asked.append(len(theta)))
    entries = likelihood.contestants("modal", quick["modal"], 8)
    for name in ("jointbayes", "jointbayes, one joint"):
        entries[name].run()
    assert asked == [8, 1]


def test_timings_slopes_and_memory():
    calls = []
    contestants = {"a": timing.Contestant(lambda: calls.append("a"), 1), "b": timing.Contestant(lambda: None, 2)}
    timed = timing.interleaved(contestants, rounds=3, seconds=0.0)
    assert (timed["a"].rounds, len(calls)) == (3, 5)
    assert 0 <= timed["b"].least <= timed["b"].median
    assert timed["b"].cpu >= 0
    assert timing.log_log_slope([1.0, 10.0, 100.0], [2.0, 200.0, 20_000.0]) == pytest.approx(2.0)
    assert timing.peak_megabytes(lambda: np.ones(1_000_000)) == pytest.approx(8.0, rel=0.01)
    # so large that no allocator serves it from memory that it kept from earlier tests
    resident = timing.resident_peak_megabytes(lambda: np.ones(16_000_000).sum())
    assert resident is None or resident > 100


def test_the_likelihood_benchmark_runs_and_writes_nothing_it_is_not_asked_to(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cases, "one_core", lambda: None)  # the other tests of this process keep their cores
    monkeypatch.setattr(record, "RESULTS", tmp_path / "never.json")
    monkeypatch.setattr(record, "PAGE", tmp_path / "never.md")
    likelihood.main(["--quick"])
    printed = capsys.readouterr().out
    says(printed, "| jointbayes |", "jointbayes, joint of 6 DOFs, modal", "jointbayes, joint of 12 DOFs, loss_factor")
    assert "| jointbayes, likelihood of joint matrices alone |" in printed
    assert not list(tmp_path.iterdir())


def test_readme_and_page_carry_what_was_measured():
    results = json.loads(record.RESULTS.read_text(encoding="utf-8"))
    assert page.in_short(results) in (record.PAGE.parents[1] / "README.md").read_text(encoding="utf-8")
    assert page.page(results) in record.PAGE.read_text(encoding="utf-8")
