"""Wrong models: the answer by modes holds the true joint, or the light of the model or a condition says what is wrong.

One data set each of `benchmarks.wrong_model` and, for right models, `false_alarms`; docs/what-can-be-wrong.md says what
the long studies found.
"""

from dataclasses import replace
from itertools import product

import pytest
from benchmarks import false_alarms, wrong_model
from benchmarks.study import holds

import jointbayes as jb
from jointbayes.posterior import gather_knowledge
from tests.case.refusal_rows import parts_named
from tests.conftest import TO_CONVERGE, first_in_ci

science = pytest.mark.science
_KINDS = [("nothing", "stocky"), ("length 5 % off", "slender")]
_KINDS += [pair for pair in product(wrong_model.WRONGS, wrong_model.BEAMS) if pair not in _KINDS]
_SPRINGS = parts_named("rooms")["science/wrong_model springs"]


@science
@pytest.mark.parametrize(("wrong", "beam"), first_in_ci(_KINDS, 1))
def test_nothing_is_identified_where_the_truth_is_far_outside_and_the_light_of_a_right_model_is_green(wrong, beam):
    row = wrong_model.analyse(wrong, beam, 1)
    assert not any(one["outside"] for one in row["known"].values())
    if wrong == "nothing":
        assert all(holds(one, "ends") for one in row["known"].values())
        assert row["grade"] in ("usual", "negligible")
    if wrong == "length 5 % off" and beam == "slender":
        assert row["grade"] in ("large", "impossible")


@science
def test_what_the_check_cannot_see_the_freed_inputs_do():
    case = jb.case_from_text("1.3 % shorter than it is", _SPRINGS)
    longer = jb.case_from_text("as it is", _SPRINGS.replace("383.0", "388.0")).problem.test.data
    made = case.problem.with_test(data=longer)
    (test,) = case.tests
    wrong = replace(case, problem=made, stated=made, tests=(replace(test, data=longer),))
    posterior = jb.sample(wrong, seed=1, settings=TO_CONVERGE)
    assert posterior.check.explains
    known, (low, high) = posterior.verdict("ky"), posterior.interval("ky", 0.999)
    assert known.cls == "identified"
    assert not low <= 3e7 <= high
    condition = "identified, if Young's modulus, density, length and damping ratio are exact"
    exact = gather_knowledge(posterior).exact
    words = {name: replace(posterior.verdict(name), exact=exact[name]).words for name in ("ky", "krz")}
    assert words == {"ky": condition, "krz": "identified"}  # of krz the class is the same without them


@science
@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=[pytest.mark.long] * (k == "uncertain")) for k in false_alarms.KINDS]
)
def test_exact_data_are_explained(kind):
    assert false_alarms.analyse(kind, 1, replace(TO_CONVERGE, walkers=24))["findings"] == []
