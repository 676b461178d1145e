"""Where joints act: in axes of their own, over rigid links, and several side by side."""

import numpy as np
import pytest

from jointbayes.errors import ModelError
from jointbayes.joint import Joint, Joints, joints_of
from tests.conftest import rod
from tests.one_line import refused

SIX = ("x", "y", "z", "rx", "ry", "rz")
TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


class Points:
    """Nodes with six DOFs each at stated places."""

    def __init__(self, places):
        self.places = places
        self.dofs = [f"{node}:{direction}" for node in places for direction in SIX]
        self.n_dofs = len(self.dofs)

    def index(self, labels):
        return np.array([self.dofs.index(label) for label in labels])

    def position(self, label):
        return self.places[int(label.split(":")[0])]

    def moved(self, translation, rotation):
        """Motion of all DOFs in a small rigid motion about the origin."""
        at_nodes = (translation + np.cross(rotation, place) for place in self.places.values())
        return np.concatenate([[*moved, *rotation] for moved in at_nodes])


def labels(node, directions=SIX):
    return tuple(f"{node}:{direction}" for direction in directions)


def test_own_axes_turn_the_motions_of_a_joint():
    structure = Points({1: np.zeros(3)})
    motion = np.random.default_rng(1).normal(size=6)
    found = Joint(labels(1), axes=TURN).selection(structure).T @ motion
    np.testing.assert_allclose(found, np.concatenate([TURN @ motion[:3], TURN @ motion[3:]]), rtol=1e-14)
    along = Joint(("1:y",), axes=TURN)
    assert along.labels == ("1:x", "1:y", "1:z")
    np.testing.assert_allclose(along.selection(structure).T @ motion, TURN[1] @ motion[:3])


def test_an_offset_is_a_rigid_link_to_the_point_of_the_joint():
    place, offset = np.array([0.3, -0.2, 0.5]), np.array([0.02, 0.05, -0.03])
    structure = Points({1: place})
    translation, rotation = np.random.default_rng(2).normal(size=(2, 3))
    motion = structure.moved(translation, rotation)
    at_point = translation + np.cross(rotation, place + offset)
    found = Joint(labels(1), offset_m=offset).selection(structure).T @ motion
    np.testing.assert_allclose(found, [*at_point, *rotation], rtol=1e-13)
    both = Joint(labels(1), axes=TURN, offset_m=offset).selection(structure).T @ motion
    np.testing.assert_allclose(both, [*(TURN @ at_point), *(TURN @ rotation)], rtol=1e-13)


def test_a_joint_over_links_feels_no_common_rigid_motion():
    first, second = np.array([0.0, 0.0, 0.0]), np.array([0.1, 0.02, 0.0])
    structure = Points({1: first, 2: second})
    joint = Joint(labels(1), labels(2), axes=TURN, offset_m=(0.06, 0.0, 0.0), offset_against_m=(-0.04, -0.02, 0.0))
    motion = structure.moved(*np.random.default_rng(3).normal(size=(2, 3)))
    np.testing.assert_allclose(joint.selection(structure).T @ motion, np.zeros(6), atol=1e-14)


def test_sides_at_different_places_are_refused_unless_an_offset_leads_from_one_to_the_other():
    structure = Points({1: np.zeros(3), 2: np.array([0.025, 0.0, 0.0])})
    with pytest.raises(
        ModelError, match=r"bolt: found 1:x and 2:x at different places, \(25, 0, 0\) mm apart"
    ) as caught:
        Joint(labels(1), labels(2), name="bolt").selection(structure)
    assert "offset" in str(caught.value)
    Joint(labels(1), labels(2), offset_m=(0.025, 0, 0)).selection(structure)
    Joint(labels(1), labels(2), offset_against_m=(-0.025, 0, 0)).selection(structure)


def test_joints_side_by_side_are_their_selections_side_by_side():
    structure = rod()
    one, other = Joint(("1:y", "1:rz"), name="one"), Joint(("3:y",), ("8:y",), name="other")
    joints = Joints((one, other))
    expected = np.hstack([one.selection(structure), other.selection(structure)])
    np.testing.assert_array_equal(joints.selection(structure), expected)
    assert joints.size == 3
    assert joints.labels == ("1:y", "1:rz", "3:y", "8:y")
    whole = np.zeros_like(expected)
    whole[structure.index(joints.labels)] = joints.deformations(joints.labels)
    np.testing.assert_array_equal(whole, expected)
    assert joints_of(joints) is joints
    assert joints_of([one, other]) == joints
    assert str(joints) == "one: 1:y, 1:rz to ground; other: 3:y to 8:y"


@pytest.mark.parametrize(
    "broken",
    [
        lambda: Joints((Joint(("1:y",)), Joint(("2:y",), name="b"))),
        lambda: Joints((Joint(("1:y",), name="b"), Joint(("2:y",), name="b"))),
        lambda: Joint(("1:y",), axes=((1, 0, 0), (0, 1, 0), (0, 0, 2))),
        lambda: Joint(("1:y",), axes=((1, 0), (0, 1))),
        lambda: Joint(("1:y", "1:rz"), axes=((1, 0, 0), (0, 1, 0), (0, 0, -1))),
        lambda: Joint(("1:y",), offset_m=(1, 2)),
        lambda: Joint(("1:y",), offset_m=(1, 2, np.nan)),
        lambda: Joint(("tip",), offset_m=(1, 2, 3)).selection(rod()),
        lambda: Joint(("1:y", "1:rz"), axes=TURN).selection(rod()),
    ],
)
def test_impossible_places_are_refused_in_one_line(broken):
    refused(broken, ModelError)
