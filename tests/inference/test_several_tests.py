"""Several tests of the same joints in one problem."""

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.errors import ModelError
from jointbayes.frf import NaturalFrequencies, Ports, receptance_model
from jointbayes.inference import JointPrior, Normal, Nuisance, ScaledNoise, Uniform
from jointbayes.joint import Joint, LogStiffness, blocks_of
from jointbayes.posterior.checks import checks_of
from jointbayes.structure import BeamFamily, BeamMaterial, BeamRecipe, ModalDamping, Section
from tests.conftest import CLAMP, PAIR, TABLE_3, TO_CONVERGE, pair_matrix, rod
from tests.oracles import check_density, noisy_frfs
from vibrecords import FrequencyData

LINES = np.arange(20.0, 1500.0, 10.0)
MARGINALS = tuple(Uniform(log_k - 3, log_k + 3) for log_k in np.log(TABLE_3).tolist())
FULL, SHORT = rod(0.383), rod(0.2)


def frfs(structure, seed, stiffness=TABLE_3, joint=CLAMP, tip="11:y"):
    ports = Ports(LINES, (tip,), (tip,))
    exact = receptance_model(structure, joint, ports).receptance(pair_matrix(stiffness))[0]
    return noisy_frfs(exact, ports, seed)


def frequencies(structure, count=4, sd=2.0):
    found = NaturalFrequencies(structure, CLAMP, count).frequency_hz(pair_matrix(TABLE_3))[0]
    return FrequencyData(found, np.full(count, sd))


LONG = jb.Test("long", FULL, CLAMP, frfs(FULL, 1))
BRIEF = jb.Test("short", SHORT, CLAMP, frfs(SHORT, 2))
HEARD = jb.Test("heard", SHORT, CLAMP, frequencies(SHORT))
PRIOR = JointPrior(PAIR, MARGINALS)


def points(problem, count=6, seed=3):
    rng = np.random.default_rng(seed)
    middle = np.concatenate([np.log(TABLE_3), np.zeros(len(problem.names) - 3)])
    return middle + 0.1 * rng.normal(size=(count, len(problem.names)))


def alone(test, prior=PRIOR):
    return jb.Problem(structure=test.structure, joint=test.joints, data=test.data, prior=prior, noise=test.noise)


def test_one_test_has_the_density_of_a_problem_without_tests_to_the_last_bit():
    plain, of_one = alone(LONG), jb.Problem(tests=[LONG], prior=PRIOR)
    theta = points(plain)
    np.testing.assert_array_equal(of_one.log_posterior(theta), plain.log_posterior(theta))
    for name in ("standardised", "white", "predicted", "gradient"):
        found, expected = (getattr(one.log_posterior, name)(theta) for one in (of_one, plain))
        np.testing.assert_array_equal(found, expected)
    assert plain.parts == (plain,)
    assert of_one.names == plain.names


def test_the_log_likelihood_of_tests_is_the_sum_of_theirs():
    tests = [LONG, BRIEF, HEARD]
    problem = jb.Problem(tests=tests, prior=PRIOR)
    theta = points(problem)
    each = [alone(one).log_posterior for one in tests]
    expected = sum(posterior.log_likelihood(theta) for posterior in each)
    np.testing.assert_allclose(problem.log_posterior.log_likelihood(theta), expected, rtol=1e-13)
    white = np.concatenate([posterior.white(theta) for posterior in each], axis=1)
    np.testing.assert_allclose(problem.log_posterior.white(theta), white, rtol=1e-13)
    whole = problem.log_posterior.residuals(theta[0])
    own = [np.concatenate(parts) for parts in zip(*(p.data_residuals(theta[0]) for p in each), strict=True)]
    for found, expected in zip(whole, own, strict=True):
        np.testing.assert_allclose(found[:-3], expected, rtol=1e-12)
    check_density(problem.log_posterior, theta[0])
    for part, one, posterior in zip(problem.parts, tests, each, strict=True):
        assert part.test.name == one.name
        np.testing.assert_array_equal(part.log_posterior.log_likelihood(theta), posterior.log_likelihood(theta))


def uncertain(length, names):
    recipe = BeamRecipe(length, Section.circle(0.025), BeamMaterial(2.1e11, 0.3, 7800.0), ModalDamping((0.01,)))
    return BeamFamily(recipe, dict.fromkeys(names, (-0.05, 0.05)))


def test_quantities_are_shared_by_all_tests_or_belong_to_the_one_they_are_named_after():
    names = ("youngs_modulus", "density")
    tests = [
        jb.Test("long", uncertain(0.383, names), CLAMP, frfs(FULL, 1), ScaledNoise()),
        jb.Test("short", uncertain(0.2, names), CLAMP, frfs(SHORT, 2)),
    ]
    known = Normal(0.0, 0.02)
    nuisances = (
        Nuisance("youngs_modulus", "GPa", 210.0, known),
        Nuisance("long.density", "kg/m³", 7800.0, known),
        Nuisance("short.density", "kg/m³", 7800.0, known),
        Nuisance("short.gain", "1", 1.0, known),
        Nuisance("noise_scale", "1", 1.0, known),
    )
    problem = jb.Problem(tests=tests, prior=JointPrior(PAIR, MARGINALS, nuisances))
    density, gain = Nuisance("density", "kg/m³", 7800.0, known), Nuisance("gain", "1", 1.0, known)
    first = alone(tests[0], JointPrior(PAIR, MARGINALS, (nuisances[0], density, nuisances[4])))
    second = alone(tests[1], JointPrior(PAIR, MARGINALS, (nuisances[0], density, gain)))
    theta = np.concatenate([np.log(TABLE_3), [0.01, -0.02, 0.015, 0.03, 0.05]])
    expected = first.log_posterior.log_likelihood(theta[[0, 1, 2, 3, 4, 7]])
    expected = expected + second.log_posterior.log_likelihood(theta[[0, 1, 2, 3, 5, 6]])
    np.testing.assert_allclose(problem.log_posterior.log_likelihood(theta), expected, rtol=1e-12)
    _, jacobian = problem.log_posterior.data_residuals(theta)
    lines = 2 * LINES.size
    assert not jacobian[:lines, [5, 6]].any()
    assert not jacobian[lines:, [4, 7]].any()
    assert (jacobian[:lines, 3] != 0).any()
    assert (jacobian[lines:, [3, 5, 6]] != 0).any(axis=0).all()
    factors = problem.prior.factors(theta)
    assert [float(part.gain(factors)) for part in problem.parts] == pytest.approx([1.0, np.exp(0.03)])
    np.testing.assert_allclose(
        problem.parts[1].natural_frequencies_hz(TABLE_3, 3, factors),
        second.natural_frequencies_hz(TABLE_3, 3, second.prior.factors(theta[[0, 1, 2, 3, 5, 6]])),
    )


def test_noise_may_be_that_of_each_test():
    known = Normal(0.0, 0.5)
    tests = [
        jb.Test("long", uncertain(0.383, ["density"]), CLAMP, LONG.data, ScaledNoise()),
        jb.Test("short", uncertain(0.2, ["density"]), CLAMP, BRIEF.data, ScaledNoise()),
    ]
    density, *noise = (Nuisance(name, "1", 1.0, known) for name in ("density", "long.noise_scale", "short.noise_scale"))
    problem = jb.Problem(tests=tests, prior=JointPrior(PAIR, MARGINALS, (density, *noise)))
    assert problem.log_posterior.likelihood.hyper_count == 2
    theta = np.concatenate([np.log(TABLE_3), [0.01, 0.3, -0.2]])
    prior = JointPrior(PAIR, MARGINALS, (density, Nuisance("noise_scale", "1", 1.0, known)))
    lone = [alone(one, prior) for one in tests]
    expected = [own.log_posterior.log_likelihood(theta[[0, 1, 2, 3, 4 + i]])[0] for i, own in enumerate(lone)]
    np.testing.assert_allclose(problem.log_posterior.log_likelihood(theta), [sum(expected)], rtol=1e-12)
    found = [part.log_posterior.log_likelihood(theta)[0] for part in problem.parts]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    wrong = jb.Problem(tests=tests, prior=JointPrior(PAIR, MARGINALS, (*noise, density)))
    with pytest.raises(ModelError, match="expected those of the noise last"):
        wrong.log_posterior(theta)


def test_a_joint_may_have_quantities_of_its_own_in_one_test():
    """The clamp is tightened for the third test: its stiffness is another one there."""
    tight = 2.0 * TABLE_3
    third = jb.Test("tight", FULL, CLAMP, frfs(FULL, 5, tight))
    kinds = blocks_of({"": LogStiffness(), "tight": LogStiffness()})
    problem = jb.Problem(tests=[LONG, BRIEF, third], prior=JointPrior(kinds, MARGINALS + MARGINALS))
    assert problem.names == ("k11", "k12", "k22", "tight.k11", "tight.k12", "tight.k22")
    theta = np.log(np.concatenate([TABLE_3, 1.1 * tight]))
    expected = sum(alone(one).log_posterior.log_likelihood(theta[:3]) for one in (LONG, BRIEF))
    expected = expected + alone(third).log_posterior.log_likelihood(theta[3:])
    np.testing.assert_allclose(problem.log_posterior.log_likelihood(theta), expected, rtol=1e-12)


def test_joints_of_tests_are_found_by_their_names():
    left, right = Joint(("1:y", "1:rz"), name="left"), Joint(("11:y", "11:rz"), name="right")
    kinds = blocks_of({"left": LogStiffness(), "right": LogStiffness()})
    both = frfs(FULL, 1, tip="5:y")
    tests = [jb.Test("both", FULL, [right, left], both), jb.Test("one", FULL, left, both)]
    problem = jb.Problem(tests=tests, prior=JointPrior(kinds, MARGINALS + MARGINALS))
    theta = np.log(np.concatenate([TABLE_3, 0.5 * TABLE_3]))
    k = problem.prior.matrix(theta).stiffness
    for block, factor in ((k[:2, :2], 0.5), (k[2:4, 2:4], 1.0), (k[4:, 4:], 1.0)):
        np.testing.assert_allclose(block, pair_matrix(factor * TABLE_3))
    acting = [[bool(quantity.places) for quantity in part.parametrisation.quantities] for part in problem.parts]
    assert (all(acting[0]), all(acting[1])) == (True, False)


@pytest.mark.whole
def test_a_posterior_of_tests_is_checked_and_predicts_each_of_them():
    posterior = jb.sample(jb.Problem(tests=[LONG, HEARD], prior=PRIOR), seed=1, settings=TO_CONVERGE, premises="exact")
    assert posterior.converged
    for name, k in zip(PAIR.stiffness_names, TABLE_3, strict=True):
        low, high = posterior.interval(name, 0.9999)
        assert low < k < high, name
    assert [check.test for check in checks_of(posterior)] == ["long", "heard"]
    assert posterior.check.explains
    assert posterior.check.sentence.startswith("Test ")
    predicted = posterior.predict_natural_frequencies(4, 50, test="heard").mean(axis=0)
    np.testing.assert_allclose(predicted, HEARD.data.frequency_hz, rtol=1e-2)
    assert posterior.predict_frf(test="long", max_draws=20).outputs == ("11:y",)
    assert "k22" in str(posterior.summary())
