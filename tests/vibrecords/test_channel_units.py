"""What a case states of a channel's unit counts, whatever the file says; what nobody says is never taken for SI."""

import numpy as np
import pytest

from vibrecords.errors import MeasurementError
from vibrecords.formats.channel_units import AS_THE_FILE_SAYS, ChannelUnit, restate_frf, restate_history
from vibrecords.formats.units import read_frf_unit, read_sensor_unit, scaled
from vibrecords.measurement_plan import Channel, map_records
from vibrecords.records import CoherenceRecord, FrfRecord, TimeRecord

G, LBF = 9.80665, 4.4482216152605
LINES = np.array([10.0, 20.0, 30.0])
AS_WRITTEN = np.array([1 + 2j, -3 + 0.5j, 0.25j])


def frf(unit):
    factor, quantity, notes = read_frf_unit(unit)
    values = scaled(AS_WRITTEN, factor)
    return FrfRecord("acc", "hammer", LINES, values, quantity, unit, where="set 1", notes=tuple(notes), factor=factor)


def history(unit):
    factor, quantity, notes = read_sensor_unit(unit)
    values = scaled(AS_WRITTEN.real, factor)
    return TimeRecord("acc", 100.0, values, quantity or "unknown", unit, notes=tuple(notes), factor=factor)


@pytest.mark.parametrize(("unit", "response", "force", "factor", "quantity"), [
    # the file says nothing, says it in words nobody knows, or is wrong
    ("", {"unit": "g"}, {}, G, "accelerance"),
    ("", {"unit": "mm/s"}, {"unit": "lbf"}, 1e-3 / LBF, "mobility"),
    ("", {}, {"unit": "kN", "quantity": "force"}, 1e-3, None),
    ("EU/EU", {"unit": "um"}, {"unit": "N"}, 1e-6, "receptance"),
    ("EU/N", {"unit": "g"}, {}, G, "accelerance"),
    ("(m/s^2)/EU", {}, {"unit": "lbf"}, 1 / LBF, "accelerance"),
    ("(m/s²)/N", {"unit": "g"}, {}, G, "accelerance"),
    ("g/N", {}, {"unit": "lbf"}, G / LBF, "accelerance"),
    ("m/s^2/N", {"unit": "ips"}, {}, 0.0254, "mobility"),
    # volts with a sensitivity in volts for each unit
    ("(m/s^2)/V", {}, {"unit": "N", "sensitivity": 0.0112}, 0.0112, "accelerance"),
    ("g/mV", {}, {"unit": "lbf", "sensitivity": 0.05}, G / (1e-3 / 0.05 * LBF), "accelerance"),
    ("V/N", {"unit": "g", "sensitivity": 0.1}, {}, G / 0.1, "accelerance"),
    ("V/V", {"unit": "g", "sensitivity": 0.1}, {"unit": "N", "sensitivity": 0.01}, G / 0.1 * 0.01, "accelerance"),
    ("", {"unit": "g", "sensitivity": 0.1}, {"unit": "N", "sensitivity": 0.01}, G / 0.1 * 0.01, "accelerance"),
])  # fmt: skip
def test_an_frf_has_the_units_that_the_case_states(unit, response, force, factor, quantity):
    record = restate_frf(frf(unit), ChannelUnit(**response), ChannelUnit(**force))
    np.testing.assert_allclose(record.values, factor * AS_WRITTEN, rtol=1e-12)
    assert record.factor == pytest.approx(factor, rel=1e-12)
    assert record.quantity == quantity
    assert not any("left as written" in note or "converted" in note for note in record.notes)
    assert any("as the case states" in note for note in record.notes)


@pytest.mark.parametrize(("unit", "stated", "factor", "quantity"), [
    ("", {"unit": "g"}, G, "acceleration"),
    ("EU", {"unit": "lbf"}, LBF, "force"),
    ("m/s^2", {"unit": "g"}, G, "acceleration"),
    ("mV", {"unit": "g", "sensitivity": 0.1}, G * 1e-3 / 0.1, "acceleration"),
    ("V", {"unit": "N", "sensitivity": 0.0023}, 1 / 0.0023, "force"),
    ("", {"quantity": "force"}, 1.0, "force"),
    ("g", {"quantity": "acceleration"}, G, "acceleration"),
])  # fmt: skip
def test_a_time_history_has_the_unit_that_the_case_states(unit, stated, factor, quantity):
    record = restate_history(history(unit), ChannelUnit(**stated))
    np.testing.assert_allclose(record.values, factor * AS_WRITTEN.real, rtol=1e-12)
    assert (record.factor, record.quantity) == (pytest.approx(factor, rel=1e-12), quantity)


def test_nothing_stated_changes_nothing():
    record = frf("EU/EU")
    assert restate_frf(record, AS_THE_FILE_SAYS, AS_THE_FILE_SAYS) is record


@pytest.mark.parametrize(("unit", "response", "force", "message"), [
    ("EU/EU", {"unit": "g"}, {}, r"found the unit 'EU', which is none of a force or motion"),
    ("EU/N", {}, {"unit": "lbf"}, r"found the unit 'EU', which is none of a force or motion"),
    ("g/N", {"unit": "g", "sensitivity": 0.1}, {}, r"found the unit 'g' and a sensitivity; expected volts"),
    ("g/N", {"quantity": "velocity"}, {}, r'found acceleration by the unit .g. and quantity = "velocity"'),
    ("", {"unit": "N"}, {}, r"found force over a force; expected a motion over a force"),
    ("", {"unit": "g"}, {"unit": "mm"}, r"found acceleration over displacement"),
])  # fmt: skip
def test_what_does_not_fit_is_refused(unit, response, force, message):
    with pytest.raises(MeasurementError, match=message) as error:
        restate_frf(frf(unit), ChannelUnit(**response), ChannelUnit(**force))
    assert "\n" not in str(error.value)
    assert "set 1" in str(error.value)


@pytest.mark.parametrize(("stated", "key"), [
    ({"unit": "xyz"}, "unit"), ({"sensitivity": 0.1}, "unit"), ({"unit": "g", "quantity": "force"}, "quantity"),
])  # fmt: skip
def test_a_channel_is_refused_whose_own_words_do_not_fit(stated, key):
    with pytest.raises(MeasurementError, match=r"^channel: found .*; expected .*; correct the channel") as error:
        ChannelUnit(**stated)
    assert error.value.key == (key,)


def coherence(response="acc", reference="hammer", lines=LINES):
    return CoherenceRecord(response, reference, lines, np.array([0.9, 0.8, 0.7]), averages=7, where="coh.mat")


CHANNELS = {"acc": Channel("2:y"), "hammer": Channel("3:y")}


@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize("labels", [(), ("input 2", "input 1")])
def test_a_coherence_of_a_file_of_its_own_goes_to_its_frf(first, labels):
    records = [frf("g/N"), coherence(*labels)]
    mapped = map_records(records[:: -1 if first else 1], CHANNELS, "frf.mat, coh.mat")
    (record,) = mapped.records
    np.testing.assert_array_equal(record.coherence, [0.9, 0.8, 0.7])
    assert (record.averages, record.notes[-1]) == (7, "coherence taken from coh.mat")


@pytest.mark.parametrize(("more", "message"), [
    ([coherence(lines=LINES[:2])], "found a coherence of 2 lines that are not the 3 of the FRF in set 1"),
    ([coherence(lines=LINES + 0.1)], "found a coherence of 3 lines that are not the 3 of the FRF in set 1"),
    ([coherence(), coherence()], "found 2 coherences of acc over hammer and 1 FRFs"),
])  # fmt: skip
def test_a_coherence_of_another_frf_is_refused(more, message):
    with pytest.raises(MeasurementError, match=message):
        map_records([frf("g/N"), *more], CHANNELS, "frf.mat, coh.mat")


def test_coherences_of_other_channels_are_left_alone():
    mapped = map_records([frf("g/N"), coherence("acc 2"), coherence("acc 3")], CHANNELS, "frf.mat, coh.mat")
    assert mapped.records[0].coherence is None
