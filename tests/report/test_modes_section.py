"""The section on modes where a shape was measured of some of them only."""

import numpy as np

from jointbayes.report.sections.natural_frequencies import Compared, _figures
from vibrecords import ModeData, ModeShapes, Observed


def test_a_mode_of_which_no_component_was_measured_has_no_figure():
    components = np.array([[0.77], [np.nan]])
    shapes = ModeShapes(("1:x",), "2:x", Observed(components, 0.05))
    measured = ModeData(Observed(np.array([2.0, 5.0]), 0.1), shapes=shapes)
    best = np.array([[0.75], [-1.3]])
    compared = Compared(components, np.full((2, 1), 0.05), best, best - 0.1, best + 0.1)
    (figure,) = _figures(measured, compared)
    assert figure.identifier == "mode-shape-1"
    assert "0.4 sd" in figure.alt


def test_a_row_says_by_how_many_standard_deviations_the_map_lies_above_what_was_measured():
    measured, best = np.array([100.0, 50.0, np.nan]), np.array([103.0, 49.0, 7.0])
    compared = Compared(measured, np.array([2.0, 0.5, 1.0]), best, best - 4, best + 4)
    assert compared.row((0,)) == ("100", "2", "103", "+1.50", "99 to 107")
    assert compared.row((1,)) == ("50", "0.5", "49", "-2.00", "45 to 53")
    assert compared.row((2,)) == ("–", "–", "7", "–", "3 to 11")
