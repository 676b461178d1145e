"""A problem that is made wrongly, or changed where it cannot be, says so in one line that names the remedy."""

from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.inference import ScaledNoise
from jointbayes.structure import ModalDamping


@pytest.fixture(scope="module")
def problem(cheap_case):
    return cheap_case.problem


MORE = {"noise": ScaledNoise()}


@pytest.mark.parametrize("field", ["structure", "joint", "data", *MORE])
def test_what_belongs_to_a_test_cannot_be_replaced_in_its_problem(problem, field):
    of_test = "joints" if field == "joint" else field
    other = MORE[field] if field in MORE else getattr(problem.test, of_test)
    with pytest.raises(jb.ModelError, match=rf"found {field} .*with_test\({of_test}=…\)$"):
        replace(problem, **{field: other})
    with pytest.raises(jb.ModelError, match=rf"found {field} besides tests"):
        jb.Problem(tests=problem.tests, prior=problem.prior, **{field: other})


def test_what_a_problem_has_itself_can_be_replaced(problem):
    guess = problem.first_guess
    assert replace(problem, initial=guess).initial is guess
    assert replace(problem, prior=problem.prior, tests=problem.tests).names == problem.names
    changed = problem.with_test(noise=MORE["noise"])
    assert replace(changed, name="other").test.noise is MORE["noise"]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda p: {"data": p.test.data.frf}, r"found as data FrfSet; expected .* jb\.FrfData\(frf, variance\)$"),
        (lambda p: {"structure": np.eye(3)}, r"found as structure ndarray; expected a body, such as jb\.BeamFamily"),
        (lambda p: {"noise": "student"}, r"found as noise 'student'; expected a noise model of jointbayes\.inference"),
        (lambda p: {"prior": jb.LogStiffness()}, r"found as prior LogStiffness; expected jb\.JointPrior\("),
    ],
)
def test_each_part_of_a_problem_is_of_its_kind(problem, wrong, message):
    parts = {"structure": problem.test.structure, "joint": problem.test.joints, "data": problem.test.data}
    with pytest.raises(jb.ModelError, match=message):
        jb.Problem(**({"prior": problem.prior} | parts | wrong(problem)))


@pytest.mark.parametrize("ratio", [0.01, "0.01", None])
def test_a_lone_damping_ratio_is_asked_for_as_a_sequence(ratio):
    with pytest.raises(jb.ModelError, match=r"modal damping: found .*; expected a sequence of ratios, such as \("):
        ModalDamping(ratio)
