"""A problem that is made wrongly, or changed where it cannot be, says so in one line that names the remedy."""

from dataclasses import replace

import pytest

import jointbayes as jb
from jointbayes.inference import ScaledNoise


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
