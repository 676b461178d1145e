"""What page one says was tested, and its sketch: to scale, with what the problem has and where it has it."""

import re
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas

import jointbayes as jb
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.model import Figure, Paragraph
from jointbayes.report.sections.lead import blocks_on_tests
from jointbayes.report.structure_sketch import _draw_test, _drawing, _Places, dof_words, sketch
from tests.conftest import CONFIGS, cheap_text, of_case


def problem_of(name):
    return jb.load_case(CONFIGS / f"{name}.toml").problem.parts[0]


@pytest.mark.parametrize("name", ["clamped_beam", "measured_rotation", "portal_frame", "spindle_tool"])
def test_each_dof_of_the_data_and_each_joint_is_where_the_model_has_it(name):
    problem = problem_of(name)
    places, frf = _Places(problem), problem.test.data.frfs.frf
    marks = [*places.joints(), *places.sensors()]
    for kind, labels in (("force", frf.inputs), ("sensor", frf.outputs)):
        shown = [mark for mark in marks if mark.kind == kind]
        assert [mark.text for mark in shown] == [dof_words(problem.test, label) for label in labels]
        for mark, label in zip(shown, labels, strict=True):
            x, y, _ = problem.test.structures.position(label)
            np.testing.assert_allclose(mark.place, [x, y])  # all of these lie in the plane of the drawing
    joints = [mark for mark in marks if mark.kind == "joint"]
    every = getattr(problem.test.joints, "joints", (problem.test.joints,))
    assert [bool(mark.ground) for mark in joints] == [not joint.against for joint in every]
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


def test_dofs_have_the_names_that_people_use():
    test = problem_of("clamped_beam_midspan").test
    names = {label: dof_words(test, label) for label in ("11:y", "1:y", "1:rz", "3:y")}
    assert names == {
        "11:y": "tip, vertical",
        "1:y": "joint, vertical",
        "1:rz": "joint, turning",
        "3:y": "76.6 mm, vertical",
    }
    assert dof_words(problem_of("portal_frame").test, "headA:x") == "headA:x"


def test_no_label_lies_on_another_or_on_a_wall():
    canvas = Canvas(figsize=(3.4, 2.2), dpi=72)
    axes = canvas.add_axes((0, 0, 1, 1))
    _draw_test(axes, _drawing(problem_of("portal_frame")))
    FigureCanvasAgg(canvas).draw()
    labels = {text.get_text(): text.get_window_extent() for text in axes.texts if text.get_text()}
    assert {"lowA:x", "B", "200 mm"} < set(labels)
    walls = [line.get_window_extent() for line in axes.lines if line.get_linewidth() == 1.6]
    assert len(walls) == 4
    over = [pair for pair in combinations(labels, 2) if labels[pair[0]].overlaps(labels[pair[1]])]
    assert (over, [name for name, box in labels.items() if any(map(box.overlaps, walls))]) == ([], [])


def test_ground_lies_beyond_the_end_that_it_holds():
    drawing = _drawing(problem_of("clamped_beam"))
    (joint,) = (mark for mark in drawing.marks if mark.kind == "joint")
    np.testing.assert_array_equal(joint.ground[0], [-1, 0])
    feet = [mark.ground[0] for mark in _drawing(problem_of("portal_frame")).marks if mark.ground]
    assert [foot.tolist() for foot in feet] == [[0, -1]] * 4


def test_every_test_that_looks_different_is_drawn():
    problem = jb.load_case(CONFIGS / "two_overhangs.toml").problem
    _, figure = blocks_on_tests(ReportInputs(SimpleNamespace(problem=problem)))
    assert figure.caption == "What was tested: test long and short with joints, ground, forces and responses."
    one, both = sketch(problem.parts[0]), sketch(*problem.parts)
    assert both.count("#c9d3dd") == 2 * one.count("#c9d3dd")
    same = SimpleNamespace(problem=SimpleNamespace(parts=(problem.parts[0],) * 2))
    (figure,) = (block for block in blocks_on_tests(ReportInputs(same)) if isinstance(block, Figure))
    assert figure.svg == one


def test_the_joint_is_that_of_the_test_that_has_one():
    """The first test of the bar is of the bar by itself; the page said "Joint: none."."""
    problem = jb.load_case(CONFIGS / "measured_bar.toml").problem
    text, _ = blocks_on_tests(ReportInputs(SimpleNamespace(problem=problem)))
    assert text.text.endswith(f" Joint: {problem.parts[1].test.joints}.")


def test_a_structure_that_nobody_can_draw_is_told_in_words(cheap_posterior, monkeypatch):
    monkeypatch.setattr("jointbayes.report.sections.lead.sketch", lambda *_: "")
    (text,) = blocks_on_tests(ReportInputs(of_case(cheap_posterior)))
    assert isinstance(text, Paragraph)
    assert text.text.startswith("**Tested.** Beam, 383 mm long")
