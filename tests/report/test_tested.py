"""What page one says was tested, and its sketch: to scale, with what the problem has and where it has it."""

import re

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.model import Figure, Paragraph
from jointbayes.report.sections.tested import blocks_on_tests
from jointbayes.report.structure_sketch import _Places, sketch
from tests.conftest import CONFIGS, cheap_text, of_case


def problem_of(name):
    return jb.load_case(CONFIGS / f"{name}.toml").problem.parts[0]


@pytest.mark.parametrize("name", ["clamped_beam", "measured_rotation", "portal_frame", "spindle_tool"])
def test_each_dof_of_the_data_and_each_joint_is_where_the_model_has_it(name):
    problem = problem_of(name)
    places, frf = _Places(problem), problem.test.data.frfs.frf
    marks = [*places.joints(), *places.sensors()]
    assert sorted(m.text for m in marks if m.kind == "force") == sorted(frf.inputs)
    assert sorted(m.text for m in marks if m.kind == "sensor") == sorted(frf.outputs)
    for mark in marks:
        if mark.kind != "joint":
            x, y, _ = problem.test.structures.position(mark.text)
            np.testing.assert_allclose(mark.place, [x, y])  # all of these lie in the plane of the drawing
    assert "<svg" in sketch(problem)


def test_lengths_are_to_scale_in_both_directions():
    drawn = {length: sketch(jb.case_from_text("b", cheap_text().replace("383.0", f"{length}")).problem)
             for length in (383.0, 120.0)}  # fmt: skip
    shapes = {}
    for length, svg in drawn.items():
        path = re.search(r'<path d="M([^"]+?)z\s*"[^>]*fill: #c9d3dd', svg)[1]
        points = np.array([[float(n) for n in pair] for pair in re.findall(r"([\d.-]+) ([\d.-]+)", path)])
        width, height = np.ptp(points, axis=0)
        shapes[length] = width / height
    assert shapes[383.0] == pytest.approx(383 / 25, rel=1e-3)
    assert shapes[120.0] == pytest.approx(120 / 25, rel=1e-3)


def test_the_sentence_is_made_from_the_data(cheap_posterior):
    figure, text = blocks_on_tests(ReportInputs(of_case(cheap_posterior)))
    assert isinstance(figure, Figure)
    assert figure.caption == "Beam, 383 mm long, section circle 25 mm. Joint: 1:y, 1:rz to ground."
    data = cheap_posterior.problem.test.data
    noise = 100 * np.median(np.sqrt(data.variance) / np.abs(data.frf.values))
    assert text.text == (
        "**Tested.** 1 computed receptance FRF (response at 5:y, force at 5:y), 249 lines from 20 to 2500 Hz, noise "
        f"{noise:.2g} % of |H| (median)."
    )


def test_a_structure_that_nobody_can_draw_is_told_in_words(cheap_posterior, monkeypatch):
    monkeypatch.setattr("jointbayes.report.sections.tested.sketch", lambda _: "")
    (text,) = blocks_on_tests(ReportInputs(of_case(cheap_posterior)))
    assert isinstance(text, Paragraph)
    assert text.text.startswith("**Tested.** Beam, 383 mm long")
