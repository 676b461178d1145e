"""Stability lobes of a tool that was never tapped: the exact tool's limit lies in the band of the prediction."""

from pathlib import Path

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import receptance_model
from jointbayes.structure import family_of_recipe
from jointbayes.studies.lobes import Cut, limiting_depth
from jointbayes.studies.predict import predict_lobes, read_other

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.science
def test_the_limit_of_the_exact_tool_lies_in_the_band():
    """All speeds hang together: one data set is one case, so the share of speeds is only held to 92 %."""
    case = jb.load_case(ROOT / "configs" / "spindle_tool.toml")
    other = read_other(ROOT / "examples" / "longer_tool.toml", allow_outside=True)
    found = predict_lobes(jb.sample(case, seed=1), other)
    matrix = case.problem.prior.matrix(np.log([[6e8, 1.2e6, 2e8, 1e5]]))  # [data.truth] of the case
    lines = np.arange(200.0, 4000.0, 0.25)
    ports = jb.Ports(lines, ("tool.tip:y",), ("tool.tip:y",))
    tip = receptance_model(family_of_recipe(other.recipe), other.joint, ports).receptance(matrix)[0, :, 0, 0]
    exact = limiting_depth(Cut(4, 8e8, 0.3, 1.0, True), lines, tip, tip, found.speeds)
    assert ((found.bands[0] <= exact) & (exact <= found.bands[4])).mean() >= 0.92
