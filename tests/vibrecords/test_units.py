"""Every unit of the tables has the factor of NIST SP 811, typed here again, and reaches the values of a file."""

import numpy as np
import pytest

from tests.vibrecords.reading import WORDS
from vibrecords.formats.units import (
    ATOMS,
    FREQUENCY_HZ,
    frf_unit,
    hertz_factor,
    parse_unit,
    read_frf_unit,
    sensor_unit,
    two_readings,
)

#: Factor to SI and dimension, from Thompson and Taylor, Guide for the Use of the International System of Units, NIST
#: Special Publication 811 (2008), appendix B.8 to the digits printed there; SI prefixes from its table 5.
LENGTH, TIME, MASS, FORCE, ACCELERATION = (1, 0, 0, 0), (0, 0, 1, 0), (0, 1, 0, 0), (1, 1, -2, 0), (1, 0, -2, 0)
PRESSURE, VOLT = (-1, 1, -2, 0), (0, 0, 0, 1)
_FACTORS = {
    (0, 0, 0, 0): "1 rad = 1",
    LENGTH: "m meter meters metre metres = 1; cm = 1e-2; mm = 1e-3; um micron microns = 1e-6; nm = 1e-9; "
            "in inch inches = 2.54e-2; mil mils = 2.54e-5; ft feet = 3.048e-1",
    TIME: "s sec second seconds = 1; ms = 1e-3",
    MASS: "kg = 1",
    FORCE: "N newton newtons = 1; mN = 1e-3; kN = 1e3; MN = 1e6; dyn = 1e-5; lbf lb lbs pound pounds = 4.448222; "
           "kgf kp = 9.80665",  # analysers write the force lb
    ACCELERATION: "g G gn g0 gs = 9.80665",  # of free fall, standard
    (2, 1, -2, 0): "Nm = 1",
    (1, 0, -1, 0): "ips = 2.54e-2",  # inch per second
    PRESSURE: "Pa = 1; kPa = 1e3",
    VOLT: "V volt volts = 1; mV = 1e-3",
    (0, 0, -1, 0): "Hz = 1",
}  # fmt: skip
NIST = {
    name: (float(factor), powers)
    for powers, row in _FACTORS.items()
    for names, factor in (part.split(" = ") for part in row.split("; "))
    for name in names.split()
}
#: Hertz for one unit, from the same table: revolution per minute 1.047 198 E−01 rad/s, one turn is 2π rad.
HERTZ = {
    **dict.fromkeys(("hz", "hertz", "cps", "1/s", "s^-1"), 1.0),
    "khz": 1.0e03,
    "rpm": 1.666667e-02,
    "cpm": 1.666667e-02,
    **dict.fromkeys(("rad/s", "rad/sec", "rads/s", "rad s^-1", "rad.s-1"), 1.666667e-02 / 1.047198e-01),
}
PRINTED = 5e-7  # half a unit of the last of seven digits


def test_no_unit_is_without_a_value_from_elsewhere():
    assert ATOMS.keys() == NIST.keys()
    assert FREQUENCY_HZ.keys() == HERTZ.keys()


@pytest.mark.parametrize("label", NIST)
def test_a_unit_has_the_factor_and_the_dimension_of_the_standard(label):
    factor, powers = NIST[label]
    unit = parse_unit(label)
    assert unit.factor == pytest.approx(factor, rel=PRINTED)
    assert unit.powers == powers


@pytest.mark.parametrize("label", HERTZ)
def test_a_frequency_axis_has_the_factor_of_the_standard(label):
    assert hertz_factor(label) == pytest.approx(HERTZ[label], rel=PRINTED)
    assert hertz_factor(f" [{label.upper()}] ") == hertz_factor(label)


@pytest.mark.parametrize("label", [name for name, (_, powers) in NIST.items() if powers == FORCE])
def test_an_frf_over_any_force_is_divided_by_it(label):
    factor, quantity = frf_unit("m/s^2", label)
    assert quantity == "accelerance"
    assert factor == pytest.approx(1 / NIST[label][0], rel=PRINTED)
    assert sensor_unit(label) == (parse_unit(label).factor, "force")


@pytest.mark.parametrize("label", [name for name, (_, powers) in NIST.items() if powers == LENGTH])
@pytest.mark.parametrize(("of_time", "quantity"), [("", "receptance"), ("/s", "mobility"), ("/s^2", "accelerance")])
def test_an_frf_of_any_length_is_multiplied_by_it(label, of_time, quantity):
    factor, found = frf_unit(f"{label}{of_time}/N")
    assert found == quantity
    assert factor == pytest.approx(NIST[label][0], rel=PRINTED)


def test_the_unit_of_a_sensor_says_what_it_measures():
    assert sensor_unit("in/s") == (0.0254, "velocity")


def test_milliseconds_count_twice_in_an_acceleration():
    assert np.isclose(parse_unit("mm/ms^2").factor, 1e3, rtol=1e-12)


@pytest.mark.parametrize("quantity", WORDS["units"])
def test_units_as_programs_write_them(quantity):
    for factor, labels in WORDS["units"][quantity].items():
        for label in labels:
            assert read_frf_unit(label)[:2] == (pytest.approx(float(factor), rel=1e-12), quantity), label


@pytest.mark.parametrize(
    ("label", "quantity"),
    [("(m/s^2)/V", "accelerance"), ("g/mV", "accelerance"), ("m/s/volts", "mobility"), ("mm/V", "receptance")],
)
def test_an_frf_over_volts_is_in_no_si_unit_but_has_a_quantity(label, quantity):
    factor, named, notes = read_frf_unit(label)
    assert (factor, named) == (None, quantity)
    assert "over volts" in notes[0]


@pytest.mark.parametrize("label", [*WORDS["no_frf"]["other"], *WORDS["no_frf"]["listed"]])
def test_a_unit_of_no_frf_leaves_the_values_as_they_are_and_says_so(label):
    factor, quantity, notes = read_frf_unit(label)
    assert (factor, quantity) == (None, None)
    assert "left as written" in notes[0]
    assert frf_unit(label) is frf_unit("") is sensor_unit("V") is hertz_factor("furlong") is None
    assert read_frf_unit("") == (1.0, None, [])


@pytest.mark.parametrize(("label", "readings"), [
    ("m/s^2*N", ("(m/s^2)*N", "m/(s^2*N)")), ("m/s² N", ("(m/s^2)*N", "m/(s^2*N)")),
    ("[mm/s·N]", ("(mm/s)*N", "mm/(s*N)")),
    *((label, None) for label in ("m/s^2/N", "m/(s^2*N)", "1/N*(m/s²)", "m/s^2·N^-1", "g/lbf", "m*s/N", "", "()",
    "EU/EU*N")),
])  # fmt: skip
def test_a_factor_behind_a_stroke_is_read_in_two_ways(label, readings):
    assert two_readings(label) == readings
