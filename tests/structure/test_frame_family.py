"""Frames as forward models see them: joints, uncertain quantities of each body, labels, and what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jointbayes as jb
from jointbayes.frf import NaturalFrequencies
from jointbayes.structure import PointMass, Rayleigh
from tests.conftest import STEEL

FLEX = jb.Section(1e-3, 1e-6, 1e-6, (1, 1, 1, 1))  # without a torsion constant
FLAT = jb.Section.rectangle(0.04, 0.01)
LAWS = [jb.ModalDamping((0.01, 0.02)), jb.LossFactor(0.01), Rayleigh(1.0, 1e-6)]
SPRINGS = np.array([[1e8, 0, 0], [0, 3e7, 2e5], [0, 2e5, 1e4]])
BETWEEN = jb.Joint(("left.3:x", "left.3:y", "left.3:rz"), ("right.1:x", "right.1:y", "right.1:rz"))
PORTS = jb.Ports(np.arange(20.0, 1500.0, 211.0), ("left.1:y", "right.3:y", "right.3:z"), ("left.1:y", "right.3:z"))


def two_bodies(law=LAWS[0], **more):
    """A straight one, and a bent one with a mass at its end; the joint is between places that coincide."""
    left = jb.FrameBody({1: (0, 0, 0), 3: (0.28, 0, 0)}, (jb.Member((1, 3), FLAT, STEEL),))
    places = {"1": (0.28, 0, 0), "2": (0.4, 0, 0), "3": (0.5, 0.1, 0.05)}
    members = (jb.Member(("1", "2"), FLAT, STEEL), jb.Member(("2", "3"), FLAT, STEEL, jb.Section.rectangle(0.02, 0.01)))
    right = jb.FrameBody(places, members, (PointMass("3", 0.05, (1e-5, 2e-5, 1e-5)),))
    return jb.FrameRecipe({"left": left, "right": right}, law, **more)


def test_natural_frequencies_of_joined_halves_are_those_of_the_whole():
    section = jb.Section.circle(0.02)
    one = jb.FrameBody({1: (0, 0, 0), 2: (0.3, 0.1, 0), 3: (0.6, 0.1, 0.2)}, (jb.Member((1, 2, 3), section, STEEL),))
    half = jb.FrameBody({1: (0, 0, 0), 2: (0.3, 0.1, 0)}, (jb.Member((1, 2), section, STEEL),))
    other = jb.FrameBody({2: (0.3, 0.1, 0), 3: (0.6, 0.1, 0.2)}, (jb.Member((2, 3), section, STEEL),))
    whole = jb.FrameRecipe(one, LAWS[0])
    halves = jb.FrameFamily(jb.FrameRecipe({"a": half, "b": other}, LAWS[0]), {})
    six = ("x", "y", "z", "rx", "ry", "rz")
    joint = jb.Joint(tuple(f"a.2:{d}" for d in six), tuple(f"b.2:{d}" for d in six))
    found = NaturalFrequencies(halves, joint, 6, top_hz=3000.0).frequency_hz(np.diag([1e13] * 3 + [1e10] * 3))[0]
    exact = whole.structure({}, whole.mesh((), 3000.0)).modes().frequency_hz[:12]
    assert_allclose(found, exact[6:], rtol=1e-5)
    assert (exact[:6] < 1e-3).all()


def test_a_frequency_is_found_below_which_so_many_modes_lie():
    family = jb.FrameFamily(two_bodies(), {})
    top = family.reach_hz(10)
    modes = family.at((), 2 * top).nominal.modes().frequency_hz
    assert (modes < top).sum() >= 16
    assert top < 1.02 * modes[15]  # and not far above: modes that nobody needs cost their time in each draw


def test_numbers_between_two_numbered_points_are_points_where_they_are_asked_for():
    body = jb.FrameBody({1: (0, 0, 0), 11: (0, 0.5, 0), 12: (0.1, 0.5, 0)}, (jb.Member((1, 11, 12), FLAT, STEEL),))
    recipe = jb.FrameRecipe(body, LAWS[0])
    assert recipe.positions["4"] == pytest.approx((0, 0.15, 0))
    assert recipe.positions["12"] == (0.1, 0.5, 0)
    nominal = jb.FrameFamily(recipe, {}).at(("4:x",), 500.0).nominal
    named = {label.split(":")[0] for label in nominal.dofs if "~" not in label}
    assert named == {"1", "4", "11", "12"}
    # a frame whose points all have numbers counts nothing
    square = {1: (0, 0, 0), 2: (1, 0, 0), 3: (1, 1, 0), 4: (0, 1, 0)}
    members = tuple(jb.Member(pair, FLAT, STEEL) for pair in ((1, 2), (2, 3), (3, 4), (4, 1)))
    assert len(jb.FrameRecipe(jb.FrameBody(square, members), LAWS[0]).positions) == 4


def test_the_height_of_a_section_lies_in_the_plane_of_a_plane_frame_unless_stated():
    stiff = jb.Section.rectangle(0.01, 0.05)  # height 50 mm
    for end in ((0.5, 0, 0), (0, 0.5, 0), (0.3, 0.4, 0)):
        bars = (jb.Member((1, 2), stiff, STEEL, up=up) for up in (None, (0, 0, 1)))
        bodies = [jb.FrameBody({1: (0, 0, 0), 2: end}, (bar,)) for bar in bars]
        recipes = [jb.FrameRecipe(body, LAWS[0], ("x", "y", "rz")) for body in bodies]
        f, slow = (r.structure({}, r.mesh((), 3000.0)).modes().frequency_hz[3] for r in recipes)
        beam = jb.BeamRecipe(0.5, stiff, STEEL, LAWS[0]).structure().modes().frequency_hz
        assert f == pytest.approx(beam[2], rel=1e-9)
        assert slow < f / 4


def body(**more):
    given = {"points": {1: (0, 0, 0), 2: (0.5, 0, 0)}, "members": (jb.Member((1, 2), FLAT, STEEL),)} | more
    return jb.FrameBody(**given)


def test_a_body_that_nothing_reaches_still_has_its_natural_frequencies():
    joint = jb.Joint(("left.1:y",))
    recipe = two_bodies()
    found = NaturalFrequencies(jb.FrameFamily(recipe, {}), joint, 3, top_hz=1500.0).frequency_hz(np.zeros((1, 1)))[0]
    exact = recipe.structure({}, recipe.mesh((), 1500.0)).modes().frequency_hz[:14]
    assert_allclose(found[1:], exact[12:], rtol=1e-6)  # the joint without stiffness holds one of twelve motions
    assert found[0] < 0.1


def test_a_frame_is_equal_to_itself_and_tells_where_its_points_are():
    assert two_bodies() == two_bodies()
    assert hash(two_bodies()) == hash(two_bodies())
    assert "left, right" in repr(jb.FrameFamily(two_bodies(), {}))
    nominal = jb.FrameFamily(two_bodies(), {}).nominal
    assert nominal.position("left.2:rx") == pytest.approx((0.14, 0, 0))
    assert nominal.position("right.3:y") == (0.5, 0.1, 0.05)
    beam = jb.BeamFamily(jb.BeamRecipe(0.4, FLAT, STEEL, LAWS[0]), {}).nominal
    assert beam.position("6:y") == pytest.approx((0.2, 0, 0))
    assert jb.FrameFamily(two_bodies(element="paper"), {}).discretisation.order == 3
