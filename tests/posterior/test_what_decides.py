"""Which uncertain input matters most: spreads with one input uncertain, against draws and against another inverse."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.phrases import Because, Reason
from jointbayes.posterior.diagnosis import diagnoses_of
from jointbayes.posterior.identifiability import assess, ratio_of
from jointbayes.posterior.knowledge import UncertainInputsRow, _row
from jointbayes.posterior.model_errors import mesh_of
from jointbayes.posterior.posterior import gather_knowledge
from jointbayes.posterior.what_decides import what_decides
from jointbayes.progress import Budget
from jointbayes.report.sections.identifiable import _decides_blocks, range_sentences
from tests.posterior.test_stored_file import copied, refusal, replaced


@pytest.fixture(scope="module")
def posterior(cheap_inputs):
    """With what its report has found of it."""
    return cheap_inputs.posterior


@pytest.fixture(scope="module")
def known(cheap_inputs):
    assert cheap_inputs.knowledge.decides is not None
    return cheap_inputs.knowledge


@pytest.fixture(scope="module")
def found(known):
    return known.decides


def test_the_length_decides_and_the_damping_does_not(found):
    assert list(found.alone) == ["length", "youngs_modulus", "density", "damping_ratio"]
    assert found.sentence.startswith("**Length matters most.** ")
    assert found.sentence.endswith(" No matter alone: damping ratio.")


def test_the_spread_with_one_input_is_that_of_the_information_with_the_others_struck_out(found, posterior, cheap_case):
    problem = cheap_case.workshop_problem
    theta = np.append(posterior.best.theta, np.zeros(4))
    _, jacobian = problem.log_posterior.residuals(theta)
    for name in ("length", "damping_ratio"):
        kept = [0, 1, 2, problem.names.index(name)]
        covariance = np.linalg.inv((jacobian.T @ jacobian)[np.ix_(kept, kept)])
        for k, column in (("k12", 1), ("k22", 2)):
            assert found.alone[name][k] == pytest.approx(math.sqrt(covariance[column, column]), rel=1e-3)


@pytest.mark.parametrize("name", ["youngs_modulus", "density"])
def test_spreads_of_first_order_are_those_of_draws(found, posterior, cheap_case, name):
    problem = cheap_case.workshop_problem
    sampled = _row(posterior, problem, (name,), np.random.default_rng(5), Budget())
    drawn = math.log(ratio_of(sampled.known["k22"].interval)) / (2 * 1.96)
    assert found.alone[name]["k22"] == pytest.approx(drawn, rel=0.25)


def test_the_report_has_a_row_for_each(found):
    table = _decides_blocks(found)[-1]
    names = ["none", "length", "Young's modulus", "density", "damping ratio", "all of these"]
    assert [row[0] for row in table.rows] == names
    assert len(table.head) == 1 + len(found.exact)


def test_nothing_is_said_where_no_stiffness_is_known_anyway(posterior, cheap_case):
    problem = cheap_case.workshop_problem
    data = problem.test.data
    far = problem.with_test(data=replace(data, variance=1e12 * data.variance))
    theta = np.append(posterior.best.theta, np.zeros(4))
    assert what_decides(problem, ("density",), theta) is not None
    assert what_decides(far, ("density",), theta) is None


KNOWN = replace(assess(np.exp(0.01 * np.random.default_rng(1).normal(size=4000)), np.exp(np.arange(3.0))), unit="N/m")


def test_what_the_range_of_a_prior_decides_is_said_with_its_figure():
    bound = Because(Reason.OPEN, {"side": "lower", "bound": 1e4, "unit": "N", "default": False})
    reason, held = str(bound), replace(KNOWN, cls="not identified", reasons=(bound,))
    rows = UncertainInputsRow((), "this run", {"k": KNOWN}), UncertainInputsRow(("length",), "none", {"k": held})
    assert range_sentences(SimpleNamespace(freed=rows)) == (f"With length uncertain the prior decides on k: {reason}.",)
    assert range_sentences(SimpleNamespace(freed=())) == ()
    # where the run itself has uncertain inputs, exact ones that may be wrong say nothing
    assert range_sentences(SimpleNamespace(freed=rows[::-1])) == range_sentences(SimpleNamespace(freed=rows))
    as_stated = replace(rows[1], known={"k": KNOWN}), replace(rows[0], known={"k": held})
    assert range_sentences(SimpleNamespace(freed=as_stated)) == ()


def test_a_file_keeps_combinations_mesh_and_diagnoses_and_refuses_what_does_not_belong_together(
    posterior, known, tmp_path, monkeypatch
):
    posterior.save(tmp_path / "draws.nc")
    for name in (
        "knowledge.name_directions", "knowledge.effect_of_uncertain_inputs", "knowledge.profiles_of",
        "model_errors.check_mesh", "diagnosis.diagnose",
    ):  # fmt: skip
        monkeypatch.setattr(f"jointbayes.posterior.{name}", lambda *_: pytest.fail("found again"))
    loaded = jb.load_posterior(tmp_path / "draws.nc")
    again = gather_knowledge(loaded)
    assert mesh_of(loaded) == mesh_of(posterior)
    assert repr(diagnoses_of(loaded)) == repr(diagnoses_of(posterior))
    assert repr(again.directions) == repr(known.directions)  # NaN is unlike itself
    assert again.decides.sentence == known.decides.sentence
    assert repr(again.freed) == repr(known.freed)
    assert (again.assumed, again.next_steps) == (known.assumed, known.next_steps)
    for one, other in zip(again.profiles, known.profiles, strict=True):
        assert (one.coordinate, one.interval) == (other.coordinate, other.interval)
        assert (one.open_below, one.open_above) == (other.open_below, other.open_above)
        np.testing.assert_array_equal(
            np.column_stack([one.theta, one.log_ratio]), np.column_stack([other.theta, other.log_ratio])
        )
    # what a file of an earlier version kept is found again today
    older = copied(tmp_path, tmp_path / "draws.nc", lambda record: record.update(file_version=3, knowledge={"a": 1}))
    assert jb.load_posterior(older).case is not None
    for place, value, said in (
        (("diagnoses_of",), [], "diagnoses_of: found 0; expected 1"),
        (("diagnoses_of", 0, "modes", 0, "measured_hz"), 0.0, r"diagnoses_of.modes: found \[ModeError"),
    ):
        change = replaced(("found", *place), value)
        assert re.search(said, refusal(copied(tmp_path, tmp_path / "draws.nc", change)))
