"""Wrong models: the answer by modes holds the true joint, or the light of the model or a condition says what is wrong.

One data set each of `benchmarks.wrong_model` and, for right models, `false_alarms`; docs/what-can-be-wrong.md says what
the long studies found.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from benchmarks import false_alarms, wrong_model
from benchmarks.study import holds

import jointbayes as jb
from jointbayes.posterior import gather_knowledge
from tests.conftest import CONFIGS, TO_CONVERGE, first_in_ci
from vibrecords import FrfData

science = pytest.mark.science
_KINDS = [("nothing", "stocky"), ("length 5 % off", "slender")]
_KINDS += [pair for pair in product(wrong_model.WRONGS, wrong_model.BEAMS) if pair not in _KINDS]
_SPRINGS = """
structure = { length_mm = 383.0, youngs_modulus_gpa = 210.0, density_kg_m3 = 7800.0, \
section = { shape = "circle", diameter_mm = 25.0 }, damping = { law = "modal", ratio = 0.01 } }
joint = { kind = "springs", dofs = ["1:y", "1:rz"] }
prior.ky = { distribution = "log_uniform", low = 1e4, high = 1e11 }
prior.krz = { distribution = "log_uniform", low = 1e2, high = 1e8 }
data = { kind = "synthetic_frf", outputs = ["11:y"], inputs = ["11:y"], f_min_hz = 10.0, f_max_hz = 500.0, \
f_step_hz = 2.0, truth.stiffness = { ky = 3e7, krz = 5e4 }, noise = { relative = 0.10, floor = 0.03, seed = 1 } }
"""


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


def measured_of(kind, seed):
    """All that is measured of a data set, of all its tests."""
    case = jb.case_from_text(kind, false_alarms.text_of(kind, seed), directory=CONFIGS)
    data = [test.data for test in false_alarms.problem_of(kind, seed, case).tests]
    return np.concatenate([(one.frf if isinstance(one, FrfData) else one).values.ravel() for one in data])


@pytest.mark.docs
@pytest.mark.parametrize("kind", false_alarms.KINDS)
def test_each_data_set_has_noise_of_its_own(kind):
    first, again, other = (measured_of(kind, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()
