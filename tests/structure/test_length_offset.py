"""An offset that all lengths share: the place where a clamp begins to hold, a number of millimetres and no factor."""

import math

import numpy as np
from numpy.testing import assert_allclose

import jointbayes as jb
from jointbayes.frf import receptance_model
from jointbayes.structure.shape_modes import ModeTable
from tests.conftest import CLAMP, STEEL, TABLE_3, pair_matrix
from tests.oracles import noisy_frfs, off_peak

OFFSET = {"length_offset": (-0.012, 0.012)}


def recipe(length, **more):
    return jb.BeamRecipe(length, jb.Section.circle(0.025), STEEL, jb.ModalDamping((0.01,)), **more)


def test_its_value_is_in_millimetres_and_may_be_negative():
    offset = jb.Nuisance("length_offset", "mm", 1000.0, jb.Normal(0.0, 0.0019))
    length = jb.Nuisance("long.length", "mm", 383.0, jb.Normal(0.0, 0.1 / 383))
    assert offset.additive
    assert not length.additive
    assert (offset.label, length.label) == ("length_offset", "ln long.length")
    prior = jb.JointPrior(jb.LogStiffness(), (jb.Normal(0.0, 1.0),) * 3, (length, offset))
    theta = np.array([0.0, 0.0, 0.0, 0.001, -0.0025])
    assert_allclose(prior.nuisance_values(theta), [383 * math.exp(0.001), -2.5])
    assert_allclose([n.coordinate(v) for n, v in zip((length, offset), prior.nuisance_values(theta), strict=True)],
                    theta[3:])  # fmt: skip
    assert prior.labels[3:] == ("ln long.length", "length_offset")


def test_tests_share_the_offset_that_moves_all_their_lengths_by_as_many_millimetres():
    """Two overhangs whose clamp begins 2 mm further in: the posterior finds the offset and its sign."""
    lines = np.arange(20.0, 2500.0, 4.0)
    ports, tests = jb.Ports(lines, ("11:y", "6:y"), ("11:y",)), []
    for number, (name, length) in enumerate({"long": 0.383, "short": 0.2}.items()):
        exact = receptance_model(jb.BeamFamily(recipe(length + 0.002), {}), CLAMP, ports)
        measured = noisy_frfs(exact.receptance(pair_matrix(TABLE_3)[None])[0], ports, number, 0.01, 0.002)
        tests.append(jb.Test(name, jb.BeamFamily(recipe(length), OFFSET), CLAMP, measured))
    marginals = tuple(jb.Uniform(np.log(k) - 3, np.log(k) + 3) for k in TABLE_3)
    offset = jb.Nuisance("length_offset", "mm", 1000.0, jb.Normal(0.0, 0.002))
    problem = jb.Problem(tests=tests, prior=jb.JointPrior(jb.LogStiffness(), marginals, (offset,)))
    estimate = jb.find_map(problem)
    found, sd = 1e3 * estimate.theta[3], 1e3 * math.sqrt(estimate.covariance[3, 3])
    assert abs(found - 2.0) < 4 * sd < 1.0


def test_a_stubby_beam_is_interpolated_as_well():
    """Its modes above the band avoid each other over the range of lengths; those further up do not."""
    family, tips = jb.BeamFamily(recipe(0.1), OFFSET), jb.Ports(np.arange(10.0, 2501.0, 60.0), ("11:y",), ("11:y",))
    edge = np.exp(np.array([[-0.0109], [-0.004], [0.0021], [0.0117]]))
    matrices = np.tile(pair_matrix(TABLE_3), (len(edge), 1, 1))
    found, exact = (receptance_model(f, CLAMP, tips).receptance(matrices, edge) for f in (family, family.reference()))
    assert off_peak(found, exact, axis=1) < 1e-7
    at = family.at((*CLAMP.labels, "11:y"), tips.frequency_hz[-1])
    motions = np.eye(at.nominal.n_dofs)[:, at.nominal.index((*CLAMP.labels, "11:y"))]
    assert isinstance(at.over_factors(motions, None).bodies[0].modes, ModeTable)
