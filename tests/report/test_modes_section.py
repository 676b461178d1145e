"""The section on modes where a shape was measured of some of them only."""

import numpy as np

from jointbayes.measurement import ModeData, ModeShapes, Observed
from jointbayes.report.sections.natural_frequencies import Compared, _figures


def test_a_mode_of_which_no_component_was_measured_has_no_figure():
    components = np.array([[0.77], [np.nan]])
    shapes = ModeShapes(("1:x",), "2:x", Observed(components, 0.05))
    measured = ModeData(Observed(np.array([2.0, 5.0]), 0.1), shapes=shapes)
    best = np.array([[0.75], [-1.3]])
    compared = Compared(components, np.full((2, 1), 0.05), best, best - 0.1, best + 0.1)
    (figure,) = _figures(measured, compared)
    assert figure.identifier == "mode-shape-1"
    assert "0.4 sd" in figure.alt
