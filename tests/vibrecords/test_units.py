"""Every unit of the tables has the factor of NIST SP 811, typed here again, and reaches the values of a file."""

import numpy as np
import pytest

from vibrecords.formats.units import (
    ATOMS,
    FREQUENCY_HZ,
    frequency_factor,
    frf_unit,
    parse_unit,
    read_frf_unit,
    sensor_unit,
)

#: Factor to SI and dimension, from Thompson and Taylor, Guide for the Use of the International System of Units, NIST
#: Special Publication 811 (2008), appendix B.8 to the digits printed there; SI prefixes from its table 5.
LENGTH, TIME, MASS, FORCE, ACCELERATION = (1, 0, 0, 0), (0, 0, 1, 0), (0, 1, 0, 0), (1, 1, -2, 0), (1, 0, -2, 0)
PRESSURE, VOLT = (-1, 1, -2, 0), (0, 0, 0, 1)
NIST = {
    "1": (1.0, (0, 0, 0, 0)),
    "rad": (1.0, (0, 0, 0, 0)),
    "m": (1.0, LENGTH),
    "cm": (1.0e-02, LENGTH),
    "mm": (1.0e-03, LENGTH),
    "um": (1.0e-06, LENGTH),
    "nm": (1.0e-09, LENGTH),
    "in": (2.54e-02, LENGTH),  # inch (in)
    "inch": (2.54e-02, LENGTH),
    "mil": (2.54e-05, LENGTH),  # mil (0.001 in)
    "ft": (3.048e-01, LENGTH),  # foot (ft)
    "s": (1.0, TIME),
    "sec": (1.0, TIME),
    "ms": (1.0e-03, TIME),
    "kg": (1.0, MASS),
    "N": (1.0, FORCE),
    "mN": (1.0e-03, FORCE),
    "kN": (1.0e03, FORCE),
    "MN": (1.0e06, FORCE),
    "dyn": (1.0e-05, FORCE),  # dyne (dyn)
    "lbf": (4.448222, FORCE),  # pound-force (lbf)
    "lb": (4.448222, FORCE),  # analysers write the force so
    "lbs": (4.448222, FORCE),
    "kgf": (9.80665, FORCE),  # kilogram-force (kgf)
    "kp": (9.80665, FORCE),  # kilopond (kilogram-force) (kp)
    "g": (9.80665, ACCELERATION),  # acceleration of free fall, standard (g_n)
    "G": (9.80665, ACCELERATION),
    "gn": (9.80665, ACCELERATION),
    "g0": (9.80665, ACCELERATION),
    "gs": (9.80665, ACCELERATION),
    "Nm": (1.0, (2, 1, -2, 0)),
    **dict.fromkeys(("meter", "meters", "metre", "metres"), (1.0, LENGTH)),
    **dict.fromkeys(("micron", "microns"), (1.0e-06, LENGTH)),  # micron (µ)
    "inches": (2.54e-02, LENGTH),
    "mils": (2.54e-05, LENGTH),
    "feet": (3.048e-01, LENGTH),
    **dict.fromkeys(("second", "seconds"), (1.0, TIME)),
    "ips": (2.54e-02, (1, 0, -1, 0)),  # inch per second (in/s)
    **dict.fromkeys(("newton", "newtons"), (1.0, FORCE)),
    **dict.fromkeys(("pound", "pounds"), (4.448222, FORCE)),
    "Pa": (1.0, PRESSURE),
    "kPa": (1.0e03, PRESSURE),
    **dict.fromkeys(("V", "volt", "volts"), (1.0, VOLT)),
    "mV": (1.0e-03, VOLT),
    "Hz": (1.0, (0, 0, -1, 0)),
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
    assert frequency_factor(label) == pytest.approx(HERTZ[label], rel=PRINTED)
    assert frequency_factor(f" [{label.upper()}] ") == frequency_factor(label)


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


def test_milliseconds_count_twice_in_an_acceleration():
    assert np.isclose(parse_unit("mm/ms^2").factor, 1e3, rtol=1e-12)


@pytest.mark.parametrize(("label", "factor", "quantity"), [
    ("(m/s^2)/Newtons", 1.0, "accelerance"),
    ("g's/Pound(s)", 9.80665 / 4.448222, "accelerance"),
    ("G/lbf", 9.80665 / 4.448222, "accelerance"),
    ("ips/LBF", 0.0254 / 4.448222, "mobility"),
    ("mils/lb", 2.54e-5 / 4.448222, "receptance"),
    ("ms-2/N", 1.0, "accelerance"),
    ("ms⁻²/N", 1.0, "accelerance"),
    ("m/s\u00b2/N", 1.0, "accelerance"),
    ("1/N*(m/s²)", 1.0, "accelerance"),
    ("[m/s²]/[N]", 1.0, "accelerance"),
    ("[(mm/s)/kN]", 1e-6, "mobility"),
    ("m/s2/Newton(s)", 1.0, "accelerance"),
])  # fmt: skip
def test_units_as_programs_write_them(label, factor, quantity):
    found, named, _ = read_frf_unit(label)
    assert named == quantity
    assert found == pytest.approx(factor, rel=PRINTED)


@pytest.mark.parametrize(
    ("label", "quantity"),
    [("(m/s^2)/V", "accelerance"), ("g/mV", "accelerance"), ("m/s/volts", "mobility"), ("mm/V", "receptance")],
)
def test_an_frf_over_volts_is_in_no_si_unit_but_has_a_quantity(label, quantity):
    factor, named, notes = read_frf_unit(label)
    assert (factor, named) == (None, quantity)
    assert "over volts" in notes[0]


@pytest.mark.parametrize("label", ["EU", "V/N", "V/V", "Pa/N", "N/m", "dB", "m/s^2", "furlong/N", "g·N"])
def test_a_unit_of_no_frf_leaves_the_values_as_they_are_and_says_so(label):
    factor, quantity, notes = read_frf_unit(label)
    assert (factor, quantity) == (None, None)
    assert "left as written" in notes[0]
    assert read_frf_unit("") == (1.0, None, [])
