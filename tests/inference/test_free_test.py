"""A test of the structure free, before it is joined: closed forms, what it shares, and an independent posterior."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg
from scipy.interpolate import RectBivariateSpline

import jointbayes as jb
from jointbayes.frf import DirectSolve, NaturalFrequencies, Ports, receptance_model
from jointbayes.inference import ErrorSizes, JointPrior, ModelErrorNoise, Normal, Nuisance, Uniform
from jointbayes.joint import Joints, blocks_of, parametrisation_named
from jointbayes.structure import BeamFamily, BeamRecipe, LossFactor, ModalDamping, Section
from tests.conftest import CLAMP, CONFIGS, PAIR, STEEL, TABLE_3, pair_matrix, rod
from vibrecords import FrequencyData, ModeData, ModeShapes, Observed

NOTHING = Joints(())
NO_JOINT = np.zeros((1, 0, 0))
LAWS = [ModalDamping((0.01,)), LossFactor(0.02)]


def test_the_modes_of_a_free_thin_bar_are_those_of_the_textbook():
    """cosh(βL) cos(βL) = 1; rigid-body motions are not counted."""
    length, diameter, beta = 2.0, 0.004, np.array([4.730041, 7.853205, 10.995608, 14.137165])
    thin = BeamRecipe(length, Section.circle(diameter), STEEL, ModalDamping((0.01,)), elements=10)
    speed = np.sqrt(STEEL.youngs_modulus / STEEL.density) * diameter / 4  # √(EI/ρA)
    exact = (beta / length) ** 2 * speed / (2 * np.pi)
    for body in (thin.structure(), BeamFamily(thin, {"youngs_modulus": (-0.1, 0.1)})):
        model = NaturalFrequencies(body, NOTHING, 4)
        np.testing.assert_allclose(model.frequency_hz(NO_JOINT)[0], exact, rtol=2e-4)
        value, slope = model.tangent(NO_JOINT[0], np.zeros((2, 0, 0)))
        np.testing.assert_allclose(value, exact, rtol=2e-4)
        assert slope.tolist() == [[0.0] * 4] * 2


@pytest.mark.parametrize("law", LAWS)
def test_frfs_of_a_free_body_are_those_of_dense_solves_and_of_a_rigid_bar_far_below_its_modes(law):
    free, ports = rod(damping=law), Ports(np.array([1.0, 100.0, 770.0, 2000.0]), ("11:y", "6:y"), ("11:y",))
    model = receptance_model(free, NOTHING, ports)
    predicted = model.receptance(NO_JOINT)[0]
    np.testing.assert_allclose(predicted, DirectSolve(free, NOTHING, ports).receptance(NO_JOINT)[0], rtol=2e-4)
    mass = 7800.0 * np.pi * 0.025**2 / 4 * 0.383
    turning = (0.383 / 2) ** 2 / (0.383**2 / 12 + 0.025**2 / 16)  # about the middle
    assert predicted[0, 0, 0].real == pytest.approx(-(1 + turning) / (mass * (2 * np.pi) ** 2), rel=1e-4)
    value, slope = model.tangent(NO_JOINT[0], np.zeros((0, 0, 0)))
    np.testing.assert_allclose(value, predicted, rtol=1e-12)
    assert slope.shape == (0, 4, 2, 1)
    misfit = model.misfit(0.9 * predicted, 1 / np.abs(predicted))
    assert misfit.chi2(NO_JOINT)[0] == pytest.approx(8 * 0.1**2, rel=1e-9)
    assert misfit.chi2_gradient(NO_JOINT)[1].shape == (1, 0, 0)


def beam_family(names, **options):
    recipe = BeamRecipe(0.383, Section.circle(0.025), STEEL, ModalDamping((0.01,)), **options)
    return BeamFamily(recipe, dict.fromkeys(names, (-0.05, 0.05)))


def frequencies(joint, matrix, sd=0.001):
    exact = NaturalFrequencies(rod(), joint, 3).frequency_hz(matrix)[0]
    return FrequencyData(exact, sd * exact)


BODY = beam_family(("youngs_modulus", "density", "length"))
CLAMPED = jb.Test("clamped", BODY, CLAMP, frequencies(CLAMP, pair_matrix(TABLE_3)))
FREE = jb.Test("free", BODY, (), frequencies(NOTHING, NO_JOINT))
MATERIAL = (
    Nuisance("youngs_modulus", "GPa", 210.0, Normal(0.0, 0.02)),
    Nuisance("density", "kg/m³", 7800.0, Normal(0.0, 0.01)),
    Nuisance("length", "mm", 383.0, Normal(0.0, 0.003)),
)
PRIOR = JointPrior(PAIR, tuple(Uniform(log_k - 3, log_k + 3) for log_k in np.log(TABLE_3).tolist()), MATERIAL)


def test_both_tests_share_the_material_and_only_one_depends_on_the_joint():
    both = jb.Problem([FREE, CLAMPED], PRIOR)
    theta = np.array([*np.log(TABLE_3), 0.01, -0.005, 0.001]) + 0.02 * np.random.default_rng(1).normal(size=(5, 6))
    parts = [part.log_posterior.log_likelihood(theta) for part in both.parts]
    np.testing.assert_allclose(both.log_posterior.log_likelihood(theta), sum(parts), rtol=1e-12)
    moved = theta + np.array([1.0, -0.5, 0.3, 0, 0, 0])
    np.testing.assert_array_equal(both.parts[0].log_posterior.log_likelihood(moved), parts[0])
    assert not np.allclose(both.parts[1].log_posterior.log_likelihood(moved), parts[1])
    residual, jacobian = both.log_posterior.data_residuals(theta[0])
    assert residual.shape == (6,)
    assert not jacobian[:3, :3].any()
    assert str(FREE).splitlines()[2] == "joint: none"
    assert repr(both).startswith("Problem(joint 1:y, 1:rz to ground; unknown")


def test_a_free_body_is_another_structure_whose_model_has_errors_of_its_own():
    sizes = ErrorSizes(factor=1 + 1e-9)  # one size only, which is shared
    first, again, free = (
        replace(test, name=name, noise=ModelErrorNoise.of(test.data, sizes))
        for name, test in (("clamped", CLAMPED), ("again", CLAMPED), ("free", FREE))
    )
    theta = np.array([[*np.log(TABLE_3), 0.01, -0.005, 0.001]])

    def value(*tests):
        return jb.Problem(tests, PRIOR).log_posterior.log_likelihood(theta)[0]

    assert value(first, free) == pytest.approx(value(first) + value(free), rel=1e-12)
    assert value(first, again) != pytest.approx(value(first) + value(again), rel=1e-3)


def test_damping_ratios_and_shapes_of_a_free_body_are_data():
    body = rod()
    exact = jb.Problem([CLAMPED, FREE], PRIOR).part("free").natural_frequencies_hz(TABLE_3, 2)[0]
    data = ModeData(
        Observed(exact, 0.001 * exact),
        Observed(np.array([0.01, 0.01]), 0.001),
        ModeShapes(("1:y", "6:y"), "11:y", Observed(np.array([[1.0, -0.6], [-1.0, 0.0]]), 0.02)),
    )
    clamped = jb.Test("clamped", body, CLAMP, CLAMPED.data)
    problem = jb.Problem([jb.Test("free", body, (), data), clamped], JointPrior(PAIR, PRIOR.marginals))
    ratios = problem.parts[0].log_posterior.predicted(np.log(TABLE_3))[0]
    by_symmetry = [0.01, 0.01, 1.0, -1.0, 0.0]
    np.testing.assert_allclose(np.delete(ratios, [0, 1, 5]), by_symmetry, atol=1e-3)


def dense_hz(springs, elements):
    """Lowest natural frequencies, shape (n, 3), of the bar on springs (n, 2) at node 1, of its matrices as they are."""
    body = rod(elements=elements)
    half = linalg.solve_triangular(np.linalg.cholesky(body.mass), np.eye(len(body.mass)), lower=True)
    base, ends = half @ body.stiffness @ half.T, half[:, body.index(CLAMP.labels)]
    values = [np.linalg.eigvalsh(base + ends * pair @ ends.T) for pair in springs]
    return np.sqrt([row[row > 1.0][:3] for row in values]) / (2 * np.pi)


def converged_hz(springs):
    """The same of elements without end: their error falls with the square of their length."""
    return (4 * dense_hz(springs, 40) - dense_hz(springs, 20)) / 3


@pytest.mark.science
def test_two_tests_leave_the_posterior_of_a_grid_of_dense_eigenproblems():
    """Two plain springs and E: all stiffnesses over E and √E on all frequencies; the free bar knows √E alone."""
    body, springs = beam_family(("youngs_modulus",)), parametrisation_named("springs", ("y", "rz"))
    truth, sd = np.array([2e8, 2e5]), 0.002
    data = [1.004 * frequencies(CLAMP, np.diag(truth)[None]).frequency_hz]
    data.append(1.005 * frequencies(NOTHING, NO_JOINT).frequency_hz)
    middle, width = np.log(truth), 2.0
    prior = JointPrior(blocks_of({"": springs}), tuple(Uniform(m - width, m + width) for m in middle), MATERIAL[:1])
    tests = [
        jb.Test(name, body, joint, FrequencyData(f, sd * f))
        for name, joint, f in zip(("clamped", "free"), (CLAMP, ()), data, strict=True)
    ]
    grids = [np.linspace(m - width - 0.1, m + width + 0.1, 30) for m in middle]
    table = np.log(converged_hz(np.exp([(a, b) for a in grids[0] for b in grids[1]]))).reshape(30, 30, 3)
    splines = [RectBivariateSpline(*grids, table[:, :, mode]) for mode in range(3)]
    (first, second), e = middle, np.linspace(-0.07, 0.07, 121)
    one, two = np.linspace(first - width, first + width, 201), np.linspace(second - width, second + width, 401)
    (free,) = converged_hz(np.zeros((1, 2)))
    for known in (tests[:1], tests):
        density = np.zeros((e.size, one.size, two.size))
        for i, change in enumerate(e):
            shifted = [np.exp(spline(one - change, two - change) + change / 2) for spline in splines]
            density[i] = sum(-0.5 * ((f - m) / (sd * m)) ** 2 for f, m in zip(shifted, data[0], strict=True))
            if len(known) > 1:
                density[i] -= 0.5 * (((free * np.exp(change / 2) - data[1]) / (sd * data[1])) ** 2).sum()
            density[i] -= 0.5 * (change / 0.02) ** 2
        weight = np.exp(density - density.max()).sum(axis=(0, 1))
        cumulated = (np.cumsum(weight) - weight / 2) / weight.sum()
        expected = np.interp([0.025, 0.5, 0.975], cumulated, two)
        posterior = jb.sample(jb.Problem(known, prior), seed=2, premises="exact")
        assert posterior.converged
        drawn = np.quantile(posterior.theta[:, 1], [0.025, 0.5, 0.975])
        np.testing.assert_allclose(drawn, expected, atol=0.03 * (expected[2] - expected[0]))


def test_a_stiffness_beyond_all_numbers_spoils_no_other_joint_of_the_batch():
    """Importance draws reach stiffnesses whose products are no numbers: no error, and the next joint as ever."""
    storeys = jb.load_case(CONFIGS / "eighteen_storeys.toml").problem
    theta = storeys.prior.transform(np.full((2, len(storeys.names)), 0.5))
    (alone,) = storeys.log_posterior(theta[:1])
    theta[1] += 500 * np.random.default_rng(33).normal(size=len(storeys.names))
    with np.errstate(over="ignore", invalid="ignore"):
        beside, beyond = storeys.log_posterior(theta)
    assert beside == pytest.approx(alone, rel=1e-12)
    assert not beyond > alone - 1e5
