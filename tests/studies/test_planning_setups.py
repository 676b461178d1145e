"""Set-ups that a plan proposes: with quantities of their own, such as an error of an overhang."""

from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import FrfSet, Ports, receptance_model
from jointbayes.inference import JointPrior, Normal, Nuisance, Uniform
from jointbayes.measurement import FrfMeasurement, RelativeNoise
from jointbayes.posterior.information.fisher import fisher_information
from jointbayes.structure import BeamFamily, BeamMaterial, BeamRecipe, ModalDamping, Section
from jointbayes.studies.planning.candidates import Candidate
from jointbayes.studies.planning.first_look import FirstLook
from jointbayes.studies.planning.own_quantities import WithOwn, own_of
from jointbayes.studies.planning.simulation import WithFurther
from tests.conftest import CLAMP, PAIR, TABLE_3, pair_matrix

LINES = np.arange(20.0, 2000.0, 10.0)
LAW = RelativeNoise(0.02, 0.01)
KNOWN = Normal(0.0, 0.002)
MODULUS = Nuisance("youngs_modulus", "GPa", 210.0, Normal(0.0, 0.02))
SCALE = Nuisance("noise_scale", "1", 1.0, Normal(0.0, 0.3))
MARGINALS = tuple(Uniform(np.log(k) - 3, np.log(k) + 3) for k in TABLE_3)


def beams(length):
    recipe = BeamRecipe(length, Section.circle(0.025), BeamMaterial(2.1e11, 0.3, 7800.0), ModalDamping((0.01,)))
    return BeamFamily(recipe, {"youngs_modulus": (-0.12, 0.12), "length": (-0.012, 0.012)})


def measured(length, seed=None):
    ports = Ports(LINES, ("11:y",), ("11:y",))
    exact = receptance_model(beams(length), CLAMP, ports).receptance(pair_matrix(TABLE_3), np.ones((1, 2)))[0]
    rng, variance = np.random.default_rng(seed), LAW.variance(exact)
    white = 0 if seed is None else rng.standard_normal((*exact.shape, 2)) @ [1, 1j] / np.sqrt(2)
    return FrfMeasurement(FrfSet(LINES, exact + np.sqrt(variance) * white, ("11:y",), ("11:y",)), variance)


def length_of(name, mm):
    return Nuisance(name, "mm", mm, KNOWN)


def present(noise=None):
    nuisances = (MODULUS, length_of("length", 383.0), *(() if noise is None else (SCALE,)))
    return jb.Problem(beams(0.383), CLAMP, measured(0.383, 1), JointPrior(PAIR, MARGINALS, nuisances), noise)


def proposed(name, length):
    own = (length_of(f"{name}.length", 1000 * length),)
    ports = Ports(LINES, ("11:y",), ("11:y",))
    return Candidate(name, "setup", name, beams(length), ports, "receptance", LAW, setup=name, own=own)


SHORT, TINY = proposed("short", 0.2), proposed("tiny", 0.1)


def together(problem, *lengths):
    """The same tests as set-ups of one problem, those proposed without errors."""
    setups = [jb.Setup("long", problem.structure, CLAMP, problem.measurement, problem.noise)]
    setups += [jb.Setup(name, beams(length), CLAMP, measured(length)) for name, length in lengths]
    own = tuple(length_of(f"{name}.length", 1000 * length) for name, length in lengths)
    known = problem.prior.nuisances
    return jb.Problem(setups=setups, prior=replace(problem.prior, nuisances=(*known[:2], *own, *known[2:])))


def test_a_linearised_figure_of_proposed_set_ups_is_that_of_a_problem_of_several():
    problem = present()
    theta = np.concatenate([np.log(TABLE_3), [0.0, 0.0]])
    look = FirstLook(problem, {"short": SHORT, "tiny": TINY}, "k12", theta[None])
    for names, lengths in ((("short",), [("short", 0.2)]), (("short", "tiny"), [("short", 0.2), ("tiny", 0.1)])):
        several = together(problem, *lengths)
        point = np.concatenate([theta, np.zeros(len(lengths))])
        expected = fisher_information(several, point).sd()["k12"]
        assert look.at(names).median == pytest.approx(expected, rel=1e-6)


def test_the_density_of_present_and_proposed_data_is_that_of_a_problem_of_several():
    problem = present(jb.ScaledNoise())
    whole = WithOwn(problem, own_of((SHORT, TINY)))
    assert whole.problem.names[-4:] == ("length", "short.length", "tiny.length", "noise_scale")
    truth = np.concatenate([np.log(TABLE_3), [0.0, 0.0, 0.0, 0.0, 0.0]])
    further = [one.problem(whole.problem, truth) for one in (SHORT, TINY)]
    density = WithFurther(whole.log_density, further)
    setups = [
        jb.Setup("long", problem.structure, CLAMP, problem.measurement, problem.noise),
        *(jb.Setup(one.setup, one.structure, CLAMP, one.measurement, one.noise) for one in further),
    ]
    several = jb.Problem(setups=setups, prior=whole.problem.prior)
    rng = np.random.default_rng(4)
    theta = truth + 0.001 * rng.standard_normal((5, truth.size))
    np.testing.assert_allclose(density(theta), several.log_posterior(theta), rtol=1e-11)
    # an overhang of its own moves only its own data
    alone = further[0].log_posterior.log_likelihood(theta + 1e-3 * (np.array(whole.problem.names) == "tiny.length"))
    np.testing.assert_array_equal(alone, further[0].log_posterior.log_likelihood(theta))


def test_draws_of_what_only_a_proposed_set_up_has_are_those_of_its_prior():
    problem = present()
    whole = WithOwn(problem, own_of((SHORT,)))
    known = np.tile(np.concatenate([np.log(TABLE_3), [0.01, -0.001]]), (4000, 1))
    drawn = whole.drawn(known, np.random.default_rng(1))
    np.testing.assert_array_equal(drawn[:, whole.present_columns], known)
    own = drawn[:, whole.own_columns[0]]
    assert (own.mean(), own.std()) == (pytest.approx(0.0, abs=1e-4), pytest.approx(0.002, rel=0.05))
    np.testing.assert_array_equal(WithOwn(problem, ()).drawn(known, np.random.default_rng(1)), known)
