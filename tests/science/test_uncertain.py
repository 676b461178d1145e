"""What is uncertain beside the joint: the density sees it, and so do mode, information and draws."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jointbayes as jb
from jointbayes.frf import synthesise_frf
from jointbayes.identification import refine
from jointbayes.inference import IntegratedScale, ProportionalNoise, ScaledNoise
from tests.conftest import CLAMP, STEEL, pair_matrix, shipped_text
from tests.oracles import differences
from vibrecords import FrfData, RelativeNoise

pytestmark = pytest.mark.science

TRUTH = np.array([5.05e9, 3.44e7, 1.52e6])
BEAM = jb.BeamRecipe(0.383, jb.Section.circle(0.025), STEEL, jb.ModalDamping((0.01,)))
LINES = np.arange(20.0, 2500.0, 20.0)
STRUCTURE = (
    jb.Nuisance("youngs_modulus", "Pa", 2.1e11, jb.Normal(0.0, 0.02)),
    jb.Nuisance("length", "m", 0.383, jb.Normal(0.0, 0.005)),
    jb.Nuisance("damping_ratio", "1", 0.01, jb.Uniform(-2.3, 2.3)),
)
GAIN = jb.Nuisance("gain", "1", 1.0, jb.Normal(0.0, 0.05))
WIDE = tuple(jb.Normal(m, 1.0) for m in np.log(TRUTH))


@cache
def measured(seed=1, gain=1.0, outputs=("11:y", "6:y")):
    rng = np.random.default_rng(seed)
    ports = jb.Ports(LINES, outputs, ("11:y",))
    law = RelativeNoise(0.03, 0.01)
    return synthesise_frf(BEAM.structure(), CLAMP, pair_matrix(TRUTH), ports, law, "mobility", rng, gain=gain)


def problem(nuisances, noise=None, data=None):
    ranges = {n.name: n.range for n in nuisances if n.name in {s.name for s in STRUCTURE}}
    family = jb.BeamFamily(BEAM, ranges) if ranges else BEAM.structure()
    prior = jb.JointPrior(jb.LogStiffness(), WIDE, nuisances)
    return jb.Problem(structure=family, joint=CLAMP, data=data or measured(), prior=prior, noise=noise)


def test_the_density_is_that_of_the_structure_with_these_quantities():
    whole = problem((*STRUCTURE, GAIN))
    theta = np.concatenate([np.log(TRUTH) + np.array([0.1, 0.05, -0.002]), [0.01, -0.003, 0.2, 0.03]])
    built = BEAM.structure({"youngs_modulus": np.exp(0.01), "length": np.exp(-0.003), "damping_ratio": np.exp(0.2)})
    frf, gain = measured().frf, np.exp(0.03)
    # gain · H − H^x over σ is H − H^x/gain over σ/gain
    scaled = FrfData(replace(frf, values=frf.values / gain), measured().variance / gain**2)
    known = jb.Problem(structure=built, joint=CLAMP, data=scaled, prior=jb.JointPrior(jb.LogStiffness(), WIDE))
    jacobian = 2 * np.log(gain) * frf.values.size
    expected = known.log_posterior.log_likelihood(theta[:3]) - jacobian
    assert_allclose(whole.log_posterior.log_likelihood(theta), expected, rtol=1e-7)  # modes are interpolated to 1e-8


PROPORTIONAL = jb.Nuisance("proportional_error", "1", 1.0, jb.Uniform(-9.0, -1.0))
NOISES = {
    "gaussian": (None, ()),
    "scaled": (ScaledNoise(), (jb.Nuisance("noise_scale", "1", 1.0, jb.Uniform(-2.0, 2.0)),)),
    "proportional": (ProportionalNoise.of(measured()), (PROPORTIONAL,)),
}
START = {"noise_scale": 0.0, "proportional_error": -4.0}
HYPER = {"gaussian": [], "scaled": [0.3], "proportional": [-4.0]}


@pytest.mark.parametrize("name", NOISES)
def test_residuals_and_their_derivative_are_those_of_the_density(name):
    noise, hyper = NOISES[name]
    density = problem((*STRUCTURE, GAIN, *hyper), noise).log_posterior
    theta = np.concatenate([np.log(TRUTH) + 0.01, [0.01, -0.003, 0.1, 0.03], HYPER[name]])
    residual, jacobian = density.residuals(theta)
    free = theta.size - len(hyper)
    # with the noise's parameters held, ln p = const − eᵀe/2: its gradient along all others is −Jᵀe
    slope = differences(lambda at: density(at)[0], theta)[:free]
    assert_allclose(-(jacobian.T @ residual)[:free], slope, rtol=2e-4, atol=2e-3 * np.abs(slope).max())
    assert (jacobian[: -theta.size, free:] == 0).all()


@pytest.mark.parametrize(
    ("noise", "hyper"),
    [NOISES["scaled"], (IntegratedScale(2, 4.0), ()), (jb.StudentNoise(2, 4.0), ()), NOISES["proportional"]],
    ids=["scaled", "integrated", "student", "proportional"],
)
def test_the_climb_ends_where_the_density_has_no_slope(noise, hyper):
    density = problem((*STRUCTURE, *hyper), noise).log_posterior
    start = np.concatenate([np.log(TRUTH) + np.array([0.2, 0.1, -0.01]), np.zeros(3), [START[n.name] for n in hyper]])
    theta, value = refine(density, start)
    low, high = density.prior.support
    inside = (theta > low + 1e-3) & (theta < high - 1e-3)
    moves = np.diag(1e-3 * np.minimum(density.prior.sd, 0.1))[inside]
    for sides in (theta + moves, theta - moves):
        assert (density(sides) < value + 1e-3).all()


def test_an_overstated_noise_is_found_by_its_scale():
    exact = measured()
    stated = FrfData(exact.frf, exact.variance * 4.0)
    density = problem(NOISES["scaled"][1], ScaledNoise(), stated).log_posterior
    theta, _ = refine(density, np.concatenate([np.log(TRUTH), [0.0]]))
    n = exact.frf.values.size
    assert abs(np.exp(theta[-1]) - 0.5) < 4 * 0.5 / np.sqrt(2 * n)


def test_a_wrong_gain_biases_the_joint_unless_it_is_uncertain():
    off = measured(seed=3, gain=1.05)
    known, _ = refine(problem((), None, off).log_posterior, np.log(TRUTH))
    free, _ = refine(problem((GAIN,), None, off).log_posterior, np.concatenate([np.log(TRUTH), [0.0]]))
    assert abs(np.exp(free[-1]) - 1.05) < 0.01
    assert abs(free[2] - np.log(TRUTH[2])) < abs(known[2] - np.log(TRUTH[2]))


SMALL = jb.load_case("configs/clamped_beam_midspan.toml").text.replace("f_step_hz = 2.0", "f_step_hz = 40.0")


def test_the_structure_of_the_data_may_differ_from_the_one_analysed():
    text = SMALL.replace("\n[data.truth]", "\n[data.truth]\nlength_mm = 360.0\ngain = 1.1\n#")
    truth = replace(BEAM, length=0.36)
    other = jb.case_from_text("other", text).problem.test.data
    ports = jb.Ports(other.frf.frequency_hz, other.frf.outputs, other.frf.inputs)
    exact = synthesise_frf(truth.structure(), CLAMP, pair_matrix(TRUTH), ports, RelativeNoise(0.03, 0.01), gain=1.1)
    assert_allclose(other.variance, exact.variance, rtol=1e-6)  # on other meshes


@pytest.mark.long
@pytest.mark.parametrize("name", ["clamped_beam_uncertain", "clamped_beam_midspan"])
def test_no_verdict_depends_on_whether_the_prior_allows_a_coupling_of_either_sign(name):
    text = shipped_text(name)
    positive = '[prior.k12]\ndistribution = "log_uniform"\nlow = 1.0e4\nhigh = 1.0e10\n\n'  # as of clamped_beam.toml
    other = re.sub(r"\[prior\.rho\][^\[]*", positive, text.replace('"signed"', '"log"'))
    as_shipped, as_main = (jb.sample(jb.case_from_text(name, each), seed=1) for each in (text, other))
    assert as_main.problem.parametrisation.names == ("k11", "k12", "k22")
    for k in ("k11", "k12", "k22"):
        assert as_shipped.verdict(k).cls == as_main.verdict(k).cls
