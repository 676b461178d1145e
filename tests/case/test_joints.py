"""Several joints, and joints of other kinds, in a case file."""

import numpy as np
import pytest

from jointbayes.case.case import case_from_text
from jointbayes.errors import CaseError
from jointbayes.joint import Joint, Joints, parametrisation_named
from tests.case.refusal_rows import refusal_rows
from tests.conftest import CONFIGS, edited

BEAM = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")
BEAM = BEAM[BEAM.index("[structure]") : BEAM.index("[joint]")]
DATA = """
[data]
kind = "synthetic_frf"
outputs = ["4:y", "9:y"]
inputs = ["4:y"]
f_min_hz = 20.0
f_max_hz = 2000.0
f_step_hz = 20.0
noise = { relative = 0.03, floor = 0.01, seed = 1 }
"""
TWO = (
    BEAM
    + """
[joints.left]
dofs = ["1:y", "1:rz"]
[joints.left.prior]
k11 = { distribution = "log_uniform", low = 1e6, high = 1e10 }
k12 = { distribution = "log_uniform", low = 1e4, high = 1e7 }
k22 = { distribution = "log_uniform", low = 1e3, high = 1e7 }

[joints.right]
kind = "springs"
dofs = ["11:y", "11:rz"]
"""
    + DATA
    + """
[data.truth.stiffness.left]
k11 = 5e7
k12 = 4e5
k22 = 5e4
[data.truth.stiffness.right]
ky = 2e7
krz = 3e4
"""
)
TRUTH = "[data.truth.stiffness]\nk11 = 5e7\nk12 = -4e5\nk22 = 5e4\n"
LONE = BEAM + '[joint]\nkind = "full"\ndofs = ["1:y", "1:rz"]\n' + DATA + TRUTH


def test_a_case_with_two_joints_is_a_problem_with_their_quantities():
    case = case_from_text("two", TWO)
    problem = case.problem
    assert problem.test.joints == Joints((Joint(("1:y", "1:rz"), name="left"), Joint(("11:y", "11:rz"), name="right")))
    assert problem.names == ("left.k11", "left.k12", "left.k22", "right.ky", "right.krz")
    assert case.spec.all_quantities == problem.parametrisation.stiffness_names
    low, high = problem.prior.support
    np.testing.assert_allclose(np.exp([low[:3], high[:3]]), [[1e6, 1e4, 1e3], [1e10, 1e7, 1e7]])
    k11, k12, k22, ky, krz = problem.first_guess
    assert (k12, k22) == (0.0, 0.0)
    assert k11 == pytest.approx(ky)
    assert ky / krz == pytest.approx(1 / 0.383**2)
    theta = problem.parametrisation.coordinates([5e7, 4e5, 5e4, 2e7, 3e4])
    squares = np.abs(problem.log_posterior.standardised(theta)) ** 2
    assert squares.mean() == pytest.approx(1.0, abs=0.3)
    assert case.warnings == ()
    assert case.plan_parameter == "left.k12"


def test_a_lone_joint_may_be_of_another_kind():
    problem = case_from_text("full", LONE).problem
    assert problem.names == ("k11", "k22", "rho12")
    assert problem.parametrisation == parametrisation_named("full", ("y", "rz"))
    assert problem.parametrisation.stiffness_names == ("k11", "k12", "k22")
    rigid = edited(LONE, ('"full"', '"rigid"'), (TRUTH, "[data.truth.stiffness]\n"))
    assert case_from_text("rigid", rigid).problem.names == ()


def test_joints_may_share_their_quantities():
    own = "[data.truth.stiffness.right]\nky = 2e7\nkrz = 3e4\n"
    text = edited(TWO, ('kind = "springs"\ndofs', 'shared = "left"\ndofs'), (own, ""))
    problem = case_from_text("shared", text).problem
    assert problem.names == ("left.k11", "left.k12", "left.k22")
    assert problem.parametrisation.size == 4


PRIOR = '{ distribution = "decades", guess = 1e9, decades = 1.0 }'
BROKEN = r"""
[joints.left]\ndofs = ["1:y", "1:rz"]\n[joints.left.prior]\nk11 = { distribution = "log_uniform", low = 1e6, high = 1e10 }\nk12 = { distribution = "log_uniform", low = 1e4, high = 1e7 }\nk22 = { distribution = "log_uniform", low = 1e3, high = 1e7 }\n\n[joints.right]\nkind = "springs"\ndofs = ["11:y", "11:rz"]\n\n=> ;; joint ;; missing table
[joints.left]\n=>[joint]\ndofs = ["1:y", "1:rz"]\n[joints.left]\n ;; joint ;; one joint or several
[data]\n=>[prior]\nk11 = { distribution = "decades", guess = 1e9, decades = 1.0 }\n[data]\n ;; prior ;; joints.left.prior
kind = "springs"\n=>shared = 'middle'\n ;; joints.right.shared ;; left
kind = "springs"\n=>shared = 'right'\n ;; joints.right.shared ;; left
kind = "springs"\n=>kind = 'springs'\nshared = 'left'\n ;; joints.right.shared ;; another kind
dofs_per_node = 2=>dofs_per_node = 5 && kind = "springs"\ndofs = ["11:y", "11:rz"]=>shared = "left"\ndofs = ["11:z", "11:ry"] ;; joints.right.shared ;; another directions
[data]\n=>[joints.right.prior]\nkx = { distribution = "decades", guess = 1e9, decades = 1.0 }\n[data]\n ;; joints.right.prior ;; no kx
krz = 3e4=>krx = 3e4 ;; data.truth.stiffness ;; right.krz
dofs = ["1:y", "1:rz"]\n=>dofs = ["1:y", "1:rz"]\naxes = [[1, 0, 0], [0, 1, 0], [0, 0.6, 0.8]]\n ;; joints.left.axes ;; right angles
dofs = ["1:y", "1:rz"]\n=>dofs = ["1:y", "1:rz"]\noffset_mm = [0, 0, 10]\n ;; joints.left.offset_mm ;; move with 1:rx, which the structure does not have
dofs = ["11:y", "11:rz"]=>dofs = ["11:y", "11:rz"]\nagainst = ["9:y", "9:rz"]\noffset_against_mm = [76.6, 0, 5] ;; joints.right.offset_against_mm ;; move with 9:rx, which the structure does not have
dofs = ["1:y", "1:rz"]\n=>dofs = ["1:y", "1:rz"]\naxes = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]\n ;; joints.left.axes ;; which the structure does not have
dofs = ["1:y", "1:rz"]\n=>dofs = ["1:y", "1:rz"]\naxes = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]\n ;; joints.left.axes ;; found left-handed axes
dofs = ["1:y", "1:rz"]\n=>dofs = ["1:y", "3:rz"]\n ;; joints.left.dofs ;; found 3:rz beside 1:y
dofs = ["11:y", "11:rz"]=>dofs = ["6:y", "6:rz"]\nagainst = ["5:y", "7:rz"] ;; joints.right.against ;; DOFs of one point on each side, 5
k12 = 4e5=>k12 = 4e9 ;; data ;; positive semidefinite
"""  # noqa: E501


@pytest.mark.parametrize(("changes", "key", "words"), refusal_rows(BROKEN))
def test_what_is_wrong_with_joints_is_one_line_with_file_and_key(changes, key, words):
    with pytest.raises(CaseError) as caught:
        case_from_text("case.toml", edited(TWO, *changes))
    first = str(caught.value).splitlines()[0]
    assert f" {key}" in first
    assert words in str(caught.value)
    assert first.startswith("case.toml")
    assert "; " in first


def test_dashpots_and_loss_factors_of_a_joint_are_parameters_with_priors():
    damped = edited(
        LONE,
        ('kind = "full"', 'kind = "springs"\nviscous = ["ky"]\nloss_factors = ["all"]'),
        (TRUTH, "[data.truth.stiffness]\nky = 5e7\nkrz = 5e4\ncy = 300.0\neta = 0.1\n"),
    )
    case = case_from_text("damped", damped)
    assert case.problem.names == ("ky", "krz", "cy", "eta")
    assert case.warnings == ()
    low, high = np.exp(case.problem.prior.support)
    assert (low[3], high[3]) == pytest.approx((1e-4, 1.0))
    assert low[2] < 300.0 < high[2]
    theta = case.problem.parametrisation.coordinates([5e7, 5e4, 300.0, 0.1])
    squares = np.abs(case.problem.log_posterior.standardised(theta)) ** 2
    assert squares.mean() == pytest.approx(1.0, abs=0.3)
    stated = damped.replace("[data]\n", f"[prior]\nky = {PRIOR}\nkrz = {PRIOR}\ncy = {PRIOR}\n[data]\n", 1)
    with pytest.raises(CaseError, match=r"prior\.eta: missing table"):
        case_from_text("case.toml", stated)
    with pytest.raises(CaseError, match=r"joint\.viscous: found viscous kz; expected each once of ky, krz"):
        case_from_text("case.toml", damped.replace('viscous = ["ky"]', 'viscous = ["kz"]'))
