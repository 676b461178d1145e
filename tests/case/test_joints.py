"""Several joints, and joints of other kinds, in a case file."""

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.joint import Joint, Joints, parametrisation_named
from tests.case.refusal_rows import case_text_named
from tests.conftest import CONFIGS, edited

BEAM = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")
BEAM = BEAM[BEAM.index("[structure]") : BEAM.index("[joint]")]
TWO = BEAM + case_text_named("two_joints")
DATA = TWO[TWO.index("[data]") : TWO.index("[data.truth")]
TRUTH = "[data.truth.stiffness]\nk11 = 5e7\nk12 = -4e5\nk22 = 5e4\n"
LONE = BEAM + '[joint]\nkind = "full"\ndofs = ["1:y", "1:rz"]\n' + DATA + TRUTH


def test_a_case_with_two_joints_is_a_problem_with_their_quantities():
    case = jb.case_from_text("two", TWO)
    problem = case.problem
    assert problem.test.joints == Joints((Joint(("1:y", "1:rz"), name="left"), Joint(("11:y", "11:rz"), name="right")))
    assert problem.names == ("left.k11", "left.k12", "left.k22", "right.ky", "right.krz")
    assert case.spec.all_quantities == problem.parametrisation.stiffness_names
    low, high = problem.prior.support
    np.testing.assert_allclose(np.exp([low[:3], high[:3]]), [[1e6, 1e4, 1e3], [1e10, 1e7, 1e7]])
    k11, k12, k22, ky, krz = problem.first_guess
    assert ((k12, k22), k11, ky / krz) == ((0.0, 0.0), pytest.approx(ky), pytest.approx(1 / 0.383**2))
    theta = problem.parametrisation.coordinates([5e7, 4e5, 5e4, 2e7, 3e4])
    squares = np.abs(problem.log_posterior.standardised(theta)) ** 2
    assert (squares.mean(), case.warnings) == (pytest.approx(1.0, abs=0.3), ())


def test_a_lone_joint_may_be_of_another_kind():
    problem = jb.case_from_text("full", LONE).problem
    assert problem.names == ("k11", "k22", "rho12")
    assert problem.parametrisation == parametrisation_named("full", ("y", "rz"))
    assert problem.parametrisation.stiffness_names == ("k11", "k12", "k22")
    rigid = edited(LONE, ('"full"', '"rigid"'), (TRUTH, "[data.truth.stiffness]\n"))
    assert jb.case_from_text("rigid", rigid).problem.names == ()


def test_joints_may_share_their_quantities():
    own = "[data.truth.stiffness.right]\nky = 2e7\nkrz = 3e4\n"
    text = edited(TWO, ('kind = "springs"\ndofs', 'shared = "left"\ndofs'), (own, ""))
    problem = jb.case_from_text("shared", text).problem
    assert (problem.names, problem.parametrisation.size) == (("left.k11", "left.k12", "left.k22"), 4)


PRIOR = '{ distribution = "decades", guess = 1e9, decades = 1.0 }'


def test_dashpots_and_loss_factors_of_a_joint_are_parameters_with_priors():
    damped = edited(
        LONE,
        ('kind = "full"', 'kind = "springs"\nviscous = ["ky"]\nloss_factors = ["all"]'),
        (TRUTH, "[data.truth.stiffness]\nky = 5e7\nkrz = 5e4\ncy = 300.0\neta = 0.1\n"),
    )
    case = jb.case_from_text("damped", damped)
    assert (case.problem.names, case.warnings) == (("ky", "krz", "cy", "eta"), ())
    low, high = np.exp(case.problem.prior.support)
    assert (low[3], high[3]) == pytest.approx((1e-4, 1.0))
    assert low[2] < 300.0 < high[2]
    theta = case.problem.parametrisation.coordinates([5e7, 5e4, 300.0, 0.1])
    assert (np.abs(case.problem.log_posterior.standardised(theta)) ** 2).mean() == pytest.approx(1.0, abs=0.3)
    stated = damped.replace("[data]\n", f"[prior]\nky = {PRIOR}\nkrz = {PRIOR}\ncy = {PRIOR}\n[data]\n", 1)
    partly = jb.case_from_text("partly", stated)
    assert partly.default_priors == {"eta"}
    assert partly.problem.prior.marginals[3] == case.problem.prior.marginals[3]
    with pytest.raises(jb.CaseError, match=r"joint\.viscous: found viscous kz; expected each once of ky, krz"):
        jb.case_from_text("case.toml", damped.replace('viscous = ["ky"]', 'viscous = ["kz"]'))
