"""A case and the same data as arrays assume the same and give the same answer."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import jointbayes as jb
from jointbayes.inference import in_workshop
from jointbayes.workflow import answered_problem
from tests.case.refusal_rows import case_text_named
from tests.conftest import CONFIGS, first_in_ci
from tests.one_line import refused
from tests.test_workflow import QUICK

LENGTH, SIDE, DENSITY, MODULUS = 0.4, 0.02, 7800.0, 2.1e11
TRUTH = np.array([2e8, 3e5, 1e5])  # k11, k12, k22
OFF = 1.01  # modulus of the beam that was measured, over the stated one
SD = 1e-3  # of a frequency


class Triangle(stats.rv_continuous):
    """A law of one's own, which no file can hold: triangular from -1 to 1."""

    def _pdf(self, x):
        return 1 - np.abs(x)

    def _cdf(self, x):
        return np.where(x < 0, (1 + x) ** 2 / 2, 1 - (1 - x) ** 2 / 2)

    def _ppf(self, q):
        return np.where(q < 0.5, np.sqrt(2 * q) - 1, 1 - np.sqrt(2 * (1 - q)))


def triangle(middle, half):
    return Triangle(a=-1.0, b=1.0)(loc=middle, scale=half)


def beam(modulus=MODULUS):
    material = jb.BeamMaterial(modulus, 0.3, DENSITY)
    recipe = jb.BeamRecipe(LENGTH, jb.Section.rectangle(SIDE, SIDE), material, jb.ModalDamping((0.01,)))
    return jb.BeamFamily(recipe, {})


def frequencies(seed=1):
    """Four natural frequencies of a beam whose modulus is 1 % off, with noise."""
    data = jb.FrequencyData(np.arange(1.0, 5.0), np.ones(4))
    exact = jb.Problem(structure=beam(OFF * MODULUS), joint=("1:y", "1:rz"), data=data)
    frequency = exact.natural_frequencies_hz(TRUTH, 4)[0]
    return frequency * (1 + SD * np.random.default_rng(seed).standard_normal(4))


def case_of(frequency):
    return jb.case_from_text("beam", case_text_named("one_default") + f"frequencies_hz = {frequency.tolist()}\n")


def problem_of(frequency, **more):
    data = jb.FrequencyData(frequency, SD * frequency)
    return jb.Problem(structure=beam(), joint=("1:y", "1:rz"), data=data, **more)


@pytest.fixture(scope="module")
def both():
    frequency = frequencies()
    case = case_of(frequency)
    arrays = problem_of(frequency, initial=case.problem.initial)
    return [jb.sample(given, seed=1) for given in (case, arrays)]


def test_a_case_and_arrays_assume_the_same_and_give_the_same_draws(both):
    of_case, other = both
    assert of_case.problem.premises.assumed == ("Young's modulus to 3 %", "density to 1 %", "length to 0.5 %")
    assert other.problem.premises == of_case.problem.premises
    assert [(n.name, n.unit, n.nominal, n.prior) for n in other.problem.prior.nuisances] == [
        (n.name, n.unit, n.nominal, n.prior) for n in of_case.problem.prior.nuisances
    ]
    np.testing.assert_array_equal(other.theta, of_case.theta)


def test_the_answer_of_arrays_converges_and_holds_the_truth(both):
    posterior = both[1]
    assert posterior.converged
    for name, true in zip(("k11", "k12", "k22"), TRUTH, strict=True):
        low, high = posterior.interval(name, 0.95)
        assert low < true < high


def test_what_is_declared_exact_or_decided_already_stays_so(both):
    frequency = frequencies()
    answered = both[1].problem
    for same in (problem_of(frequency, exact=("model",)), answered):
        assert answered_problem(same, None, both[1].estimate, 1) is same
    known = in_workshop(problem_of(frequency, exact=("density",)))
    assert known.names[3:] == ("youngs_modulus", "length")
    stated = in_workshop(known)
    assert stated.names == known.names
    plain = jb.Problem(structure=beam().certain(), joint=("1:y", "1:rz"), data=known.test.data)
    assert in_workshop(plain).names == plain.names  # of matrices nothing else is known


@pytest.mark.parametrize("name", first_in_ci(["four_storeys", "measured_rotation", "tied_beams", "two_machines"], 1))
def test_the_problem_of_a_shipped_case_is_answered_as_the_case(name):
    case = jb.load_case(CONFIGS / f"{name}.toml")
    estimate = jb.find_map(case)
    of_case, of_problem = (answered_problem(case.problem, given, estimate, 1) for given in (case, None))
    assert of_problem.premises == of_case.premises
    assert of_problem.names == of_case.names
    theta = of_case.prior.mean[None]
    np.testing.assert_array_equal(of_problem.log_posterior(theta), of_case.log_posterior(theta))


def test_errors_taken_off_a_problem_stay_off(both):
    right = replace(both[1].problem, name="right").with_premises(replace(both[1].problem.premises, model_error=None))
    assert "model" in right.exact


@pytest.mark.science
def test_a_decided_posterior_is_loaded_with_the_problem_as_it_was_stated(tmp_path):
    own = jb.JointPrior(jb.LogStiffness(), tuple(triangle(np.log(k), 3.0) for k in TRUTH))
    stated, path = problem_of(frequencies(), prior=own), tmp_path / "own.nc"
    posterior = jb.sample(stated, seed=1, settings=QUICK)
    assert posterior.problem.premises.reason
    posterior.save(path)
    refused(lambda: jb.load_posterior(path), jb.ModelError, "marginals[0].given (rv_continuous_frozen)")
    loaded = jb.load_posterior(path, problem=stated)
    np.testing.assert_array_equal(loaded.theta, posterior.theta)
    assert loaded.problem.premises == posterior.problem.premises
    other = problem_of(
        frequencies(), prior=replace(own, marginals=(triangle(np.log(TRUTH[0]), 4.0), *own.marginals[1:]))
    )
    refused(lambda: jb.load_posterior(path, problem=other), jb.ModelError, "found draws of another density")
    wrong = problem_of(frequencies(), prior=replace(own, marginals=(jb.Normal(1.0, 2.0), *own.marginals[1:])))
    refused(lambda: jb.load_posterior(path, problem=wrong), jb.ModelError, "of another problem than the one passed")
