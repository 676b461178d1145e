"""DOFs of a rigid face from the sensors on it: a rigid body whose motion is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.one_line import refused
from vibrecords import FrfData, FrfSet, MeasurementError
from vibrecords.assemble import assemble_measurement
from vibrecords.measurement_plan import Channel, MeasurementPlan, VarianceSource
from vibrecords.records import FrfRecord
from vibrecords.variance import RelativeNoise
from vibrecords.virtual_points import SIX, VirtualPoint, at_virtual_points

LINES = np.linspace(50.0, 500.0, 40)
MASS, INERTIA = 2.0, np.diag([3e-3, 4e-3, 5e-3])
AT = np.array([0.3, 0.1, -0.05])  # the point; the body's centre is elsewhere
CENTRE = AT + np.array([0.02, -0.03, 0.05])
PLACES = {"a": (0.33, 0.12, -0.02), "b": (0.27, 0.12, -0.04), "c": (0.3, 0.06, -0.07)}
TILTED = (0.0, 0.6, 0.8)


def arm(place, direction):
    return np.concatenate([direction, np.cross(np.array(place) - CENTRE, direction)])


HIT = arm((0.35, 0.12, -0.02), (0.3, 0.4, 0.5))


def axis(label):
    return np.eye(3)["xyz".index(label[-1])]


def accelerance(outputs, inputs):
    """Of the free rigid body at (place, direction, rotation?) of outputs and inputs: constant over frequency."""
    inverse = np.zeros((6, 6))
    inverse[:3, :3], inverse[3:, 3:] = np.eye(3) / MASS, np.linalg.inv(INERTIA)
    return np.array(outputs) @ inverse @ np.array(inputs).T


def of_point():
    """What the centre moves by unit motions of each of the point's six DOFs, as forms of sensors there."""
    return [arm(AT, axis(dof)) if dof[0] != "r" else np.concatenate([np.zeros(3), axis(dof)]) for dof in SIX]


def sensors(*labels):
    return {label: (PLACES[label[0]], TILTED if label == "c:z" else tuple(axis(label))) for label in labels}


NINE = sensors(*(f"{name}:{way}" for name in "abc" for way in "xyz"))
HITS = {f"h{i}:{way}": (tuple(AT + np.eye(3)[i] * 0.04), tuple(np.eye(3)["xyz".index(way)])) for i in range(3)
        for way in "xyz"}  # fmt: skip


def measured(outputs=NINE, inputs=None, change=()):
    forces = [arm(*place) for place in inputs.values()] if inputs else [HIT]
    h = accelerance([arm(*place) for place in outputs.values()], forces) * np.ones((LINES.size, 1, 1), complex)
    for label, factor in change:
        h[:, list(outputs).index(label)] *= factor
    labels = tuple(inputs) if inputs else ("hit:y",)
    return FrfData(FrfSet(LINES, h, tuple(outputs), labels, "accelerance"), np.full(h.shape, 1e-8))


def point(places=NINE, dofs=SIX):
    return VirtualPoint("11", dofs, tuple(AT), places)


@pytest.mark.parametrize("dofs", [SIX, ("z", "rx")])
def test_sensors_give_the_motion_of_the_point(dofs):
    found, warnings, (note,) = at_virtual_points(measured(), [point(dofs=dofs)])
    rows = [of_point()[SIX.index(dof)] for dof in dofs]
    exact = accelerance(rows, [HIT])
    assert found.frf.outputs == tuple(f"11:{dof}" for dof in dofs)
    assert_allclose(found.frf.values, exact + np.zeros((LINES.size, 1, 1)), rtol=1e-9, atol=1e-9)
    assert not warnings
    assert note.startswith("The rigid motion of virtual point 11 leaves ")


def test_hits_become_forces_and_moments_and_both_stand_with_what_is_no_sensor():
    other = {"20:y": ((0.1, 0.0, 0.0), (0.0, 1.0, 0.0))}
    found, *_ = at_virtual_points(measured(NINE | other, HITS), [point(NINE | HITS)])
    six = tuple(f"11:{dof}" for dof in SIX)
    assert (found.frf.outputs, found.frf.inputs) == (("20:y", *six), six)
    exact = accelerance([arm(*other["20:y"]), *of_point()], of_point())
    assert_allclose(found.frf.values[7], exact, rtol=1e-8, atol=1e-8)


def test_noise_is_that_of_the_weighted_sensors():
    random, data = np.random.default_rng(2), measured()
    noise = random.normal(size=(4000, 40, 9, 1)) * 1e-4
    exact = at_virtual_points(data, [point()])[0]
    weights, _ = point().weights(tuple(NINE), "sensors")
    assert_allclose(np.einsum("ds,nlsi->nldi", weights, noise).var(axis=(0, 1)), exact.variance[0], rtol=0.03)


@pytest.mark.parametrize("label", NINE)
def test_a_sensor_that_points_the_other_way_is_named(label):
    _, (warning,), _ = at_virtual_points(measured(change=[(label, -1.0)]), [point()])
    assert f"without {label} least is left, which points the other way" in warning.sentence
    assert warning.remedy == f"turn the sign of {label} in [data.channels]"
    assert "on 40 of 40 lines, from 50 Hz" in warning.sentence


def test_a_sensor_that_reads_half_is_named_and_its_sign_is_not_blamed():
    _, (warning,), _ = at_virtual_points(measured(change=[("b:y", 0.5)]), [point()])
    assert "without b:y least is left" in warning.sentence
    assert "place and direction of b:y" in warning.remedy


def test_as_many_sensors_as_motions_leave_nothing_to_check_them_by():
    six = sensors("a:x", "a:y", "a:z", "b:y", "b:z", "c:z")
    _, warnings, (note,) = at_virtual_points(measured(six, change=[("b:z", -1.0)]), [point(six)])
    assert not warnings
    assert "nothing checks that it is rigid" in note


ON_A_LINE = {name: (tuple(AT + np.array([x, 0, 0])), way) for name, x, way in (
    ("a:y", 0.0, (0, 1, 0)), ("b:y", 0.1, (0, 1, 0)), ("c:y", 0.2, (0, 1, 0)), ("a:z", 0.0, (0, 0, 1)),
    ("b:z", 0.1, (0, 0, 1)), ("c:x", 0.2, (1, 0, 0)))}  # fmt: skip


@pytest.mark.parametrize(
    ("places", "dofs", "words"),
    [
        (ON_A_LINE, SIX, "6 sensors, 5 of them independent, which do not see rx; expected some of x, y, z, ry, rz"),
        (sensors("a:y"), ("y",), "1 sensors, 1 of them independent, which do not see y; expected some of none"),
    ],
)
def test_dofs_that_sensors_do_not_see_are_refused(places, dofs, words):
    refused(lambda: at_virtual_points(measured(places), [point(places, dofs)]), MeasurementError, words)


def test_collinear_sensors_give_what_they_see():
    found, *_ = at_virtual_points(measured(ON_A_LINE), [point(ON_A_LINE, ("y", "rz"))])
    exact = accelerance([of_point()[1], of_point()[5]], [HIT])
    assert_allclose(found.frf.values[0], exact, rtol=1e-9)


@pytest.mark.parametrize(("outputs", "words"), [({"20:y": NINE["a:y"]}, "no FRF of its sensors"),
                                                (NINE | {"11:y": NINE["a:y"]}, "found 11:y measured")])  # fmt: skip
def test_a_point_has_sensors_and_no_measurement_of_its_own(outputs, words):
    refused(lambda: at_virtual_points(measured(outputs), [point()]), MeasurementError, words)


def test_an_assembled_measurement_has_the_point_the_warning_and_the_note():
    data = measured(change=[("a:z", -1.0)]).frf
    records = [FrfRecord(label, "hit:y", LINES, data.values[:, i, 0], "accelerance")
               for i, label in enumerate(data.outputs)]  # fmt: skip
    channels = {label: Channel(label) for label in (*NINE, "hit:y")}
    law = VarianceSource("relative", RelativeNoise(0.01, 0.0))
    found = assemble_measurement(records, MeasurementPlan(channels, law, virtual_points=(point(),)))
    assert found.frf.outputs == tuple(f"11:{dof}" for dof in SIX)
    assert "virtual_point" in [warning.key for warning in found.provenance.warnings]
    assert any("virtual point 11 leaves" in note for note in found.provenance.notes)
    assert found.provenance.loaded == ("11:x", "11:y", "11:z")
