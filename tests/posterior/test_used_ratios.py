"""Ratios of motions as data: used where an edge has a place and the model comes near, named where it does not."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.case.case import case_from_text
from jointbayes.inference import ErrorSizes, UsedMode
from jointbayes.posterior.decision import FARTHEST_RATIO, modes_problem, premises_sentences, shapes_of, with_ratios
from jointbayes.posterior.storage import problem_arrays, problem_from
from tests.case.refusal_rows import parts_named
from vibrecords.modal_ratios import MotionRatio

TRUTH = np.array([4e7, 6e4])
CASE = parts_named("rooms")["posterior/used_ratios case"]


@pytest.fixture(scope="module")
def measured():
    """A problem of FRFs that nobody computed, at its truth."""
    problem = case_from_text("two sensors", CASE).problem
    return problem.with_test(data=replace(problem.test.data, synthetic=False))


def by_modes(problem, **sizes):
    theta = np.append(np.log(TRUTH), problem.prior.mean[2:])
    return modes_problem(problem, SimpleNamespace(theta=theta, places=theta[None]), 1, ErrorSizes(**sizes))


@pytest.fixture(scope="module")
def answered(measured):
    """The problem of the modes that they show, the errors of the model as usual."""
    return by_modes(measured)


def test_ratios_of_measured_frfs_are_data_beside_the_frequencies(answered):
    found = answered
    shapes = found.test.data.shapes
    assert set(shapes.dofs) | {shapes.reference[0]} == {"6:y", "11:y"}
    values = dict(zip(found.test.data.value_names, found.test.data.values, strict=True))
    predicted = dict(zip(found.test.data.value_names, found.log_posterior.predicted(_at_truth(found))[0], strict=True))
    ratios = [name for name in values if name.startswith("shape")]
    assert len(ratios) == 3  # one of each mode
    for name in ratios:
        assert values[name] == pytest.approx(predicted[name], abs=0.02)
    (sentence, *_) = premises_sentences(replace(found.premises, reason="it is measured"), None)
    assert re.search(r"and the ratios of the motions of (6:y, 11:y|11:y, 6:y) in them\.$", sentence)


def test_an_answer_with_ratios_is_kept_in_a_file(answered):
    found = answered
    assert any(mode.ratios for mode in found.premises.modes)
    kept, record = problem_arrays(found)

    def array(name):
        return kept[name].values if name in kept else kept[f"{name}_real"].values + 1j * kept[f"{name}_imag"].values

    again = problem_from(array, record, "two sensors")
    assert again.premises == found.premises
    assert again.log_posterior(_at_truth(found)) == found.log_posterior(_at_truth(found))


def _at_truth(problem):
    return np.append(np.log(TRUTH), problem.prior.mean[2:])[None]


def test_without_a_place_for_an_edge_there_are_none(measured):
    assert by_modes(measured, edge=0.0).test.data.shapes is None
    certain = case_from_text("two sensors", CASE.replace("uncertain.length.sd_percent = 0.5", "")).problem
    certain = certain.with_test(data=replace(certain.test.data, synthetic=False))
    assert by_modes(certain).test.data.shapes is None


def test_a_sensor_that_is_turned_round_is_named_and_not_used(measured):
    frf = measured.test.data.frf
    turned = replace(measured.test.data, frf=replace(frf, values=frf.values * np.array([-1.0, 1.0])[:, None]))
    found = by_modes(measured.with_test(data=turned))
    assert found.test.data.shapes is None
    (why,) = found.premises.left_out
    assert re.match(r"How much .*6:y.* move relative to each other is not used: the nearest model misses it by", why)
    assert "look at signs, gains and places of the sensors" in why


@pytest.mark.parametrize("away", [FARTHEST_RATIO - 0.01, FARTHEST_RATIO + 0.01])
@pytest.mark.parametrize("small", [False, True])
def test_ratios_are_believed_up_to_a_third_of_them(measured, answered, away, small):
    tried = TRUTH[None], measured.prior.factors(_at_truth(measured))
    mode = next(m for m in answered.premises.modes if m.ratios)
    model = jb.frf.AssembledShapes(measured.test.structures, measured.test.joints, 1, ("6:y", "11:y", "2:y"))
    middle, tip, root = model.modes(np.diag(TRUTH), np.ones((1, 1))).shapes[0, 0]
    true = root / tip if small else middle / tip
    value = true - away * 0.3 if small else true / (1 + away)
    ratio = MotionRatio("2:y" if small else "6:y", "11:y", float(value), 0.001)
    used, why = with_ratios(measured, tried, [[ratio]], [replace(mode, ratios=())])
    assert bool(used[0].ratios) == (away < FARTHEST_RATIO) == (not why)


def test_the_nearest_of_the_joints_tried_counts(measured):
    ratio = MotionRatio("6:y", "11:y", 5.0, 0.001)
    near = MotionRatio("6:y", "11:y", 0.34, 0.001)
    values = np.array([[1e7, 1e4], TRUTH])
    tried = values, np.ones((2, 1))
    mode = UsedMode("", 1, 100.0, 0.1)
    assert with_ratios(measured, tried, [[ratio]], [mode])[1]
    assert not with_ratios(measured, tried, [[near]], [mode])[1]
    assert with_ratios(measured, tried, [[near, ratio]], [mode])[1]  # all of them must be near at one joint


def test_shapes_have_a_reference_of_each_mode_and_holes():
    first = UsedMode("", 1, 100.0, 0.1, ratios=(MotionRatio("6:y", "11:y", 0.3, 0.01),))
    second = UsedMode("", 2, 600.0, 0.1, ratios=(MotionRatio("11:y", "6:y", -0.9, 0.02),))
    third = UsedMode("", 3, 1500.0, 0.1)
    shapes = shapes_of([first, second, third])
    assert shapes.dofs == ("6:y", "11:y")
    assert shapes.reference[:2] == ("11:y", "6:y")
    assert np.array_equal(shapes.components.values, [[0.3, np.nan], [np.nan, -0.9], [np.nan, np.nan]], equal_nan=True)
    assert shapes_of([third]) is None
