"""Channels of files become DOFs of the model, with the sign and gain that the case states, and nothing in silence."""

import numpy as np
import pytest

from vibrecords.errors import MeasurementError
from vibrecords.measurement_plan import Channel, map_records
from vibrecords.records import FrfRecord

LINES = np.array([10.0, 20.0, 30.0])
VALUES = np.array([1.0 + 2.0j, 3.0 - 1.0j, 0.5 + 0.1j])


def record(response: str = "Point:12:Z+", reference: str = "Point:11:Y+") -> FrfRecord:
    return FrfRecord(response, reference, LINES, VALUES, "accelerance", where="data set 1")


def channels(**extra: Channel) -> dict[str, Channel]:
    return {"Point:12:Z+": Channel("12:z"), "Point:11:Y+": Channel("11:y"), **extra}


def test_an_frf_is_relabelled_by_dofs_and_left_as_it_is():
    (found,) = map_records([record()], channels(), "tip.uff").records
    assert (found.response, found.reference, found.where) == ("12:z", "11:y", "data set 1")
    assert np.array_equal(found.values, VALUES)


@pytest.mark.parametrize(("response", "force", "factor"), [
    (Channel("12:z", -1.0), Channel("11:y"), -1.0),
    (Channel("12:z"), Channel("11:y", -1.0), -1.0),
    (Channel("12:z", -1.0), Channel("11:y", -1.0), 1.0),
    (Channel("12:z", gain=1.02), Channel("11:y"), 1.02),
    (Channel("12:z"), Channel("11:y", gain=1.02), 1 / 1.02),
    (Channel("12:z", -1.0, 2.0), Channel("11:y", -1.0, 0.5), 4.0),
])  # fmt: skip
def test_a_response_multiplies_and_a_force_divides(response, force, factor):
    mapped = map_records([record()], {"Point:12:Z+": response, "Point:11:Y+": force}, "tip.uff")
    np.testing.assert_allclose(mapped.records[0].values, factor * VALUES, rtol=1e-15)


def test_a_channel_in_the_opposite_direction_is_taken_with_a_minus_and_says_so():
    mapped = map_records([record("Point:12:Z-")], channels(), "tip.uff")
    np.testing.assert_array_equal(mapped.records[0].values, -VALUES)
    turned = {use.channel: (use.factor, use.reversed_direction) for use in mapped.uses}
    assert turned == {"Point:12:Z-": (-1.0, True), "Point:11:Y+": (1.0, False)}


def test_both_directions_at_one_point_are_one_dof_where_one_is_the_force():
    drive = FrfRecord("Point:11:Y-", "Point:11:Y+", LINES, VALUES, "accelerance")
    mapped = map_records([drive], {"Point:11:Y+": Channel("11:y")}, "tip.uff")
    assert (mapped.records[0].response, mapped.records[0].reference) == ("11:y", "11:y")
    np.testing.assert_array_equal(mapped.records[0].values, -VALUES)


def test_channels_that_are_not_mapped_are_left_out_and_listed():
    others = [record("Point:99:X+"), record(), record("Point:98:X+")]
    mapped = map_records(iter(others), channels(), "tip.uff")
    assert len(mapped.records) == 1
    assert mapped.left_out == ("Point:99:X+", "Point:98:X+")


def test_an_unknown_channel_is_refused_with_the_nearest_name_that_is_free():
    mapped = channels(**{"Point:21:Z+": Channel("1:y")})
    others = [record(), *(record(name) for name in ("Point:22:Z+", "Point:31:X+"))]
    with pytest.raises(MeasurementError, match=r'^tip.uff: .*"Point:21:Z\+".*did you mean "Point:22:Z\+"\?$') as found:
        map_records(others, mapped, "tip.uff")
    assert 'one of "Point:22:Z+", "Point:31:X+";' in str(found.value)
    assert found.value.key == ("channels", "Point:21:Z+")
    with pytest.raises(MeasurementError, match=r"all of these are mapped; remove it$"):
        map_records([record()], mapped, "tip.uff")


def test_two_response_channels_for_one_dof_are_refused():
    both = {**channels(), "Point:13:Z+": Channel("12:z")}
    with pytest.raises(MeasurementError, match=r"response channels Point:12:Z\+ and Point:13:Z\+ for the one DOF 12:z"):
        map_records([record(), record("Point:13:Z+")], both, "tip.uff")


def test_a_force_that_is_not_mapped_is_named():
    with pytest.raises(MeasurementError, match=r"no FRF whose response and force are both in \[data.channels\]"):
        map_records([record()], {"Point:12:Z+": Channel("12:z")}, "tip.uff")


def test_a_file_without_frfs_is_refused():
    with pytest.raises(MeasurementError, match="found no FRF"):
        map_records([], channels(), "tip.uff")


def test_a_sensor_has_its_mass_where_it_responds_and_not_where_the_channel_is_the_force():
    known = {"12": Channel("5:y", gain=2.0, accelerometer_mass=0.003)}
    response, force = map_records([record("12", "12")], known, "tip.uff").uses
    assert (response.role, response.accelerometer_mass) == ("response", 0.003)
    assert (force.role, force.accelerometer_mass, force.factor) == ("force", 0.0, 2.0)
