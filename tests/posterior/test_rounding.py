"""Numbers side by side have one notation, and the digits that their errors support."""

import math
from dataclasses import replace

import pytest

from jointbayes.posterior.identifiability import Verdict
from jointbayes.posterior.verdicts import line_of
from jointbayes.rounding import engineering, interval, rounded, rounded_interval, with_interval

NAN = math.nan


@pytest.mark.parametrize(
    ("values", "unit", "errors", "texts", "with_prefix"),
    [
        ((5.046e9, 3.532e9, 1.4552e10), "N/m", (2.1e7, 5.1e6, 2.1e8), ("5.05", "3.532", "14.6"), "GN/m"),
        ((1.52e6, 1.40e6, 1.61e6), "N·m/rad", (), ("1.52", "1.40", "1.61"), "MN·m/rad"),
        ((8.2e5, 9e4), "N·m/rad", (), ("820", "90.0"), "kN·m/rad"),
        ((820.0, 90.0), "N·m/rad", (), ("820", "90.0"), "N·m/rad"),
        ((1.2e8, 1.1e8), "N/m", (1.5e7, 1.5e7), ("120", "110"), "MN/m"),
        ((9.6e8, 9.4e8, 1.02e9), "N/m", (1e6, 1e6, 1e6), ("960", "940", "1020"), "MN/m"),
        ((-3e5, 0.0, 2e6), "N", (), ("-300", "0", "2000"), "kN"),
        ((3.44e7, 1.2, 9e12), "N", (), ("3.44e7", "1.20e0", "9.00e12"), "N"),
        ((NAN, 3e3, math.inf), "N·s/m", (NAN, NAN, NAN), ("–", "3.00", "–"), "kN·s/m"),
        ((0.08, 0.02), "1", (0.001, 0.001), ("0.080", "0.020"), "1"),
    ],
)
def test_a_median_and_its_interval_share_one_prefix(values, unit, errors, texts, with_prefix):
    assert engineering(values, unit, errors) == (texts, with_prefix)


@pytest.mark.parametrize("low", [99210.0, 9.921e-5])
def test_both_ends_of_an_interval_have_one_notation(low):
    for text in (interval((low, 1.1 * low)), rounded_interval((low, 1.1 * low), (0.0, 0.0))):
        assert len({"e" in end for end in text.split(" to ")}) == 1


def test_a_number_alone_is_told_as_in_a_row_of_one():
    assert rounded(99936.0, 12.0) == "9.994e4"
    assert rounded_interval((99936.0, 1.0067e5), (12.0, 40.0)) == "9.994e4 to 1.0067e5"


def test_a_median_and_the_ends_of_its_interval_are_told_alike():
    errors = {"median_error": 12.0, "interval_error": (40.0, 40.0)}
    known = Verdict("identified", (99210.0, 100673.0), 99936.0, "N·m/rad", **errors)
    assert known.value == "99.9 (99.2 to 100.7) kN·m/rad"
    assert line_of("krz", known) == "krz = 99.9 (99.2 to 100.7) kN·m/rad: identified"
    bounded = replace(known, cls="bounded below", limit=4.482e5)
    assert line_of("krz", bounded) == "krz above 448 kN·m/rad: bounded below"
    assert replace(bounded, cls="bounded above").value == "below 448 kN·m/rad"


@pytest.mark.parametrize(
    ("values", "errors", "text"),
    [
        ((1.5221e6, 1.5094e6, 1.580e6), (1e2, 1e2, 1e3), "1.52 (1.51 to 1.58) MN·m/rad"),
        ((1.06e6, 5.43e5, 2.2e7), (NAN, NAN, 1e6), "1.06 (0.543 to 22) MN·m/rad"),
        ((6.0e4, 5.9917e4, 6.0094e4), (), "60.00 (59.92 to 60.09) kN·m/rad"),
        ((2e5, -3e5, 4e5), (), "200 (-300 to 400) kN·m/rad"),
        ((5.0, 5.0, 5.0), (), "5.00 (5.00 to 5.00) N·m/rad"),
        ((NAN, NAN, NAN), (), "– (– to –) N·m/rad"),
    ],
)
def test_a_value_has_three_digits_or_those_that_its_interval_needs(values, errors, text):
    assert with_interval(values, "N·m/rad", errors) == text


@pytest.mark.parametrize(
    ("values", "errors", "text"),
    [
        ((5.1e9, 3.2e9, 1.46e10), (1e8, 1e7, 6e9), "5.1 (3.20 to 10) GN/m"),  # one digit
        ((5.1e9, 3.2e9, 4.1e10), (1e8, 1e7, 3e10), "5.1 (3.20 to above 20) GN/m"),
        ((5.1e9, 3.2e8, 9.1e9), (1e8, 3e8, 1e8), "5.1 (below 0.8 to 9.1) GN/m"),
        ((5.1e9, 3.2e9, 4.1e10), (1e8, 1e7, 9e12), "5.1 (3.20 to above 4) GN/m"),
        ((5.1e9, -3.2e9, 4.1e10), (1e8, 9e9, 1e9), "5.1 (-3 to 41) GN/m"),
    ],
)
def test_an_end_with_a_large_monte_carlo_error_is_printed_with_one_digit_or_as_a_limit(values, errors, text):
    assert with_interval(values, "N/m", errors) == text
