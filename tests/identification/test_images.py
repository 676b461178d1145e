"""Images of a mode: like joints exchanged, couplings reflected; climbs from them find the modes that starts miss."""

from math import factorial
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.identification import Images, ModeSearch
from jointbayes.identification.mode_search import _reflections
from jointbayes.joint import Damped, Joint, LogStiffness, blocks_of, parametrisation_named
from tests import models

SPRINGS = parametrisation_named("springs", ("x", "y", "rz"))
FEET = {"A": (2e7, 4e6, 2e5, 8e7, -3e5, 3e4), "B": (9e7, -1e7, 8e5, 2e8, 1e6, 1.2e5)}
FULL = '"full"\ndofs = ["foot{0}:x", "foot{0}:y", "foot{0}:rz"]'


def test_like_joints_are_exchanged_and_unlike_ones_are_not():
    two = blocks_of({"a": SPRINGS, "left": LogStiffness(), "b": SPRINGS})
    assert two.exchanges.tolist() == [[0, 1, 2, 3, 4, 5, 6, 7, 8], [6, 7, 8, 3, 4, 5, 0, 1, 2]]
    damped = blocks_of({"a": SPRINGS, "b": Damped(SPRINGS, ("kx",))})
    assert (damped.exchanges.tolist(), LogStiffness().exchanges.tolist()) == ([list(range(7))], [[0, 1, 2]])
    assert len(blocks_of({"a": SPRINGS, "b": "a", "c": SPRINGS}).exchanges) == 2


@pytest.mark.parametrize(("joints", "count"), [(3, factorial(3)), (4, factorial(4)), (5, 1 + 10), (6, 1 + 15)])
def test_all_orders_of_up_to_four_joints_and_pairs_of_more(joints, count):
    one = parametrisation_named("springs", ("y",))
    exchanges = blocks_of({f"j{i}": one for i in range(joints)}).exchanges
    assert len(np.unique(exchanges, axis=0)) == len(exchanges) == count
    assert exchanges[0].tolist() == list(range(joints))


def test_two_kinds_are_exchanged_together_and_every_test_alike():
    one, two = parametrisation_named("springs", ("y",)), parametrisation_named("springs", ("x",))
    both = blocks_of({"a": one, "b": one, "c": two, "d": two})
    assert sorted(both.exchanges.tolist()) == [[0, 1, 2, 3], [0, 1, 3, 2], [1, 0, 2, 3], [1, 0, 3, 2]]
    levels = blocks_of({"low.a": one, "low.b": one, "high.a": one, "high.b": one})
    assert levels.exchanges.tolist() == [[0, 1, 2, 3], [1, 0, 3, 2]]


def full_portal(sensor_mm=250.0):
    """The portal with full matrices at its feet: mirror images of each other but for their sizes."""
    text = models.portal(sensor_mm)
    for foot in "AB":
        text = text.replace(FULL.format(foot).replace("full", "springs"), FULL.format(foot), 1)
    names = ("k11", "k12", "k13", "k22", "k23", "k33")
    rows = [f"{n} = {{ " + ", ".join(f"{k} = {v}" for k, v in zip(names, FEET[n], strict=True)) + " }" for n in "AB"]
    head, begin, _ = text.partition("[data.truth.stiffness]\n")
    return jb.case_from_text("full", head + begin + "\n".join(rows))


def test_the_mirror_image_of_full_joints_explains_the_data_as_well():
    """Of the plane of the frame couplings of x with y, and of y with rz, change their signs; x with rz does not."""
    problem = full_portal().problem
    theta = problem.parametrisation.coordinates([*FEET["A"], *FEET["B"]])
    images = Images.from_problem(problem)
    assert np.array_equal(images(theta)[0], theta)
    density = problem.log_posterior.log_likelihood(images(theta))
    same = np.flatnonzero(np.abs(density - density[0]) < 1e-3)
    assert same.size == 2
    mirrored = problem.prior.values(images(theta)[same[1]])
    np.testing.assert_allclose(mirrored, [9e7, 1e7, 8e5, 2e8, -1e6, 1.2e5, 2e7, -4e6, 2e5, 8e7, 3e5, 3e4], rtol=1e-9)
    np.testing.assert_allclose(images.matrices @ theta, images(theta))
    np.testing.assert_allclose(np.abs(np.linalg.det(images.matrices)), 1.0)


def test_each_coupling_is_turned_alone_as_well():
    images = Images.from_problem(full_portal().problem)
    turned = (images.signs < 0).sum(axis=1)[(images.columns == np.arange(12)).all(axis=1)]
    assert (turned == 1).sum() == 6
    assert (turned == 4).sum() == 3  # all couplings with x, with y, or with rz


def test_a_plane_of_symmetry_turns_the_motions_across_it_and_the_rotations_within():
    """Across the plane at right angles to x: x, ry and rz, and so the couplings of these with each other motion."""
    ways = ("x", "y", "z", "rx", "ry", "rz")
    full = parametrisation_named("full", ways)
    joint = Joint(tuple(f"a:{way}" for way in ways))
    problem = SimpleNamespace(
        tests=[SimpleNamespace(joints=joint)], parametrisation=full, quantities=full.quantities, names=full.names
    )
    motion = np.array([-1, 1, 1, 1, -1, -1])
    expected = [1.0] * 6 + [float(motion[i] * motion[j]) for i in range(6) for j in range(i + 1, 6)]
    assert expected in _reflections(problem).tolist()
    assert len(np.unique(_reflections(problem), axis=0)) == 8


def test_logarithms_are_never_turned():
    problem = jb.case_from_text("portal", models.portal()).problem
    images = Images.from_problem(problem)
    assert images.columns.tolist() == [[0, 1, 2, 3, 4, 5], [3, 4, 5, 0, 1, 2]]
    assert (images.signs == 1).all()


@pytest.mark.parametrize("sensor_mm", [250.0, 255.0])
def test_a_search_that_knows_one_foot_order_finds_the_other(sensor_mm):
    problem = jb.case_from_text("portal", models.portal(sensor_mm)).problem
    truth = problem.parametrisation.coordinates(np.ravel(models.FEET))
    search = ModeSearch(problem.log_posterior)
    search.climb({"truth": truth})
    assert len(search.estimate().modes) == 1
    search.climb_images(Images.from_problem(problem))
    first, second = search.estimate().modes
    np.testing.assert_allclose(second.theta, first.theta[[3, 4, 5, 0, 1, 2]], atol=0.2)
    assert first.log_posterior - second.log_posterior == pytest.approx(0.0 if sensor_mm == 250.0 else 5.41, abs=0.01)
    assert len(search.estimate().starts) == 1  # images are no starts


@pytest.mark.science
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_order_of_three_like_joints_is_found(seed):
    estimate = jb.find_map(jb.case_from_text("wheel", models.wheel()), seed=seed)
    assert len(estimate.modes) == 6
    orders = {tuple(np.argsort(mode.theta).tolist()) for mode in estimate.modes}
    assert len(orders) == 6
    assert np.ptp([mode.log_posterior for mode in estimate.modes]) < 1e-5
