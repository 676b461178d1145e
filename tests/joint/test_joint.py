"""Joints: where they act, what they may be, and the coordinates in which they are inferred."""

from functools import partial

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import jointbayes as jb
from jointbayes.joint import COORDINATES, ComplianceCoordinates, ElasticCentre
from tests.conftest import CLAMP, PAIR, TABLE_3, pair_matrix, rod
from tests.one_line import refused

ALL = pytest.mark.parametrize(
    "parametrisation", [jb.parametrisation_named(key) for key in COORDINATES], ids=list(COORDINATES)
)
LN_K = st.floats(np.log(1e2), np.log(1e12))
COUPLING = st.floats(-0.99, 0.99).filter(lambda rho: abs(rho) > 1e-3)


def theta_of(parametrisation, ln_k11, ln_k22, rho):
    """Coordinates of a positive definite joint; the log parametrisation takes |ρ|."""
    if isinstance(parametrisation, jb.SignedCoupling):
        return np.array([ln_k11, ln_k22, rho])
    if isinstance(parametrisation, ElasticCentre):
        return np.array([ln_k11, rho * np.exp((ln_k22 - ln_k11) / 2), ln_k22 + np.log1p(-(rho**2))])
    return np.array([ln_k11, (ln_k11 + ln_k22) / 2 + np.log(abs(rho)), ln_k22])


@ALL
@settings(max_examples=20)
@given(LN_K, LN_K, COUPLING)
def test_the_determinant_is_that_of_the_joint_matrix(parametrisation, ln_k11, ln_k22, rho):
    theta = theta_of(parametrisation, ln_k11, ln_k22, rho)
    assert parametrisation.log_determinant(theta) == pytest.approx(ln_k11 + ln_k22 + np.log1p(-(rho**2)), abs=1e-9)


@ALL
def test_a_parametrisation_says_what_its_coordinates_are(parametrisation):
    axes, names = parametrisation.axes, parametrisation.names
    assert names == tuple(axis.name for axis in axes)
    assert {axis.quantity for axis in axes} == {quantity.name for quantity in PAIR.quantities}
    theta = parametrisation.coordinates(TABLE_3)
    for quantity, k in zip(PAIR.quantities, TABLE_3, strict=True):
        column = names.index(parametrisation.standing_for(quantity.name))
        if quantity.name in names:  # a stiffness among the coordinates is there by its logarithm
            assert axes[column].value(theta[column]) == pytest.approx(k, rel=1e-12)
            assert (axes[column].unit, axes[column].label) == (quantity.unit, f"ln {quantity.name}")
        else:
            assert quantity.name in parametrisation.derived
    units = {axis.name: (axis.unit, axis.label, axis.axis_label, axis.bounded) for axis in axes if not axis.logarithmic}
    assert (
        units
        == {
            "log": {},
            "signed": {"rho": ("1", "ρ", "ρ", True)},
            "elastic_centre": {"arm": ("m", "arm", "arm (m)", False)},
        }[parametrisation.key]
    )


@ALL
@pytest.mark.parametrize("stiffness", [[0.0, 0.0, 0.0], [1e8, 0.0, 0.0], [1e8, -2e8, 1e6], [1e9, 1e9, 1e6], TABLE_3])
def test_any_joint_has_a_positive_definite_one_near_that_has_coordinates(parametrisation, stiffness):
    near = parametrisation.nearest(stiffness)
    assert parametrisation.describes(near)
    assert is_positive_definite(near)
    assert parametrisation.feasible(parametrisation.coordinates(near))
    if parametrisation.describes(stiffness) and abs(stiffness[1]) < 0.9 * np.sqrt(stiffness[0] * stiffness[2]):
        np.testing.assert_array_equal(near, stiffness)


@given(LN_K, st.floats(-1.0, 1.0), LN_K)
def test_a_joint_acts_at_its_elastic_centre_without_coupling(ln_k11, arm, ln_k22c):
    """Motion of the centre y + a φ gives the force k11 (y + a φ) and no moment about it."""
    k11, k12, k22 = ElasticCentre().values([ln_k11, arm, ln_k22c])
    to_centre = np.array([[1.0, arm], [0.0, 1.0]])
    about_centre = to_centre.T @ np.diag(np.exp([ln_k11, ln_k22c])) @ to_centre
    np.testing.assert_allclose([[k11, k12], [k12, k22]], about_centre, rtol=1e-12)


def is_positive_definite(stiffness):
    """By eigenvalues, scaled to a unit diagonal, which by Sylvester's law of inertia keeps their signs."""
    size = np.sqrt(stiffness[[0, 2]])
    return bool((np.linalg.eigvalsh(pair_matrix(stiffness) / np.outer(size, size)) > 0).all())


@given(LN_K, LN_K, st.floats(0.01, 100.0))
def test_log_coordinates_are_feasible_exactly_where_the_joint_is_positive_definite(ln_k11, ln_k22, rho):
    assume(abs(rho - 1) > 1e-9)
    theta = np.array([ln_k11, (ln_k11 + ln_k22) / 2 + np.log(rho), ln_k22])
    assert jb.LogStiffness().feasible(theta) == is_positive_definite(jb.LogStiffness().values(theta))


@given(LN_K, LN_K, st.floats(-3.0, 3.0))
def test_signed_coordinates_are_feasible_exactly_where_the_joint_is_positive_definite(ln_k11, ln_k22, rho):
    assume(abs(abs(rho) - 1) > 1e-9)
    theta = np.array([ln_k11, ln_k22, rho])
    assert jb.SignedCoupling().feasible(theta) == is_positive_definite(jb.SignedCoupling().values(theta))


NO_JOINTS = {
    jb.LogStiffness: [[1e9, 0.0, 1e6], [1e9, -1e7, 1e6], [-1e9, 1e7, 1e6], [np.nan, 1e7, 1e6]],
    ElasticCentre: [[0.0, 0.0, 1e6], [1e9, 1e8, 1e6], [1e9, -1e8, 1e7], [np.nan, 0.0, 1e6]],
    jb.SignedCoupling: [[0.0, 0.0, 1e6], [1e9, 0.0, -1e6], [[1e9, 0.0, 1e6], [1e9, 0.0, np.nan]]],
}


@ALL
@settings(max_examples=20)
@given(LN_K, LN_K, COUPLING)
def test_the_compliance_is_the_inverse_matrix_and_leads_back(parametrisation, ln_k11, ln_k22, rho):
    coordinates = ComplianceCoordinates(parametrisation)
    theta = theta_of(parametrisation, ln_k11, ln_k22, rho)[None]
    phi = coordinates.forward(theta)
    product = pair_matrix(phi[0]) @ pair_matrix(parametrisation.values(theta)[0])
    size = np.exp([ln_k11 / 2, ln_k22 / 2])
    np.testing.assert_allclose(product * size[:, None] / size, np.eye(2), atol=1e-10)
    back, inside = coordinates.inverse(phi)
    assert inside.tolist() == [True]
    np.testing.assert_allclose(back, theta, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("phi", "log", "signed"),
    [
        ([2e-10, -1e-11, 1e-6], True, True),
        ([2e-10, 1e-11, 1e-6], False, True),  # k12 < 0
        ([2e-10, 0.0, 1e-6], False, True),  # k12 = 0
        ([-2e-10, -1e-11, 1e-6], False, False),
        ([2e-10, -1e-11, -1e-6], False, False),
        ([-2e-10, -1e-11, -1e-6], False, False),  # positive determinant, negative definite
        ([2e-10, -2e-8, 1e-6], False, False),  # c12² > c11 c22
        ([2e-10, 2e-8, 1e-6], False, False),
    ],
)
def test_the_coordinates_know_which_compliances_are_joints(phi, log, signed):
    for parametrisation, expected in (
        (jb.LogStiffness(), log),
        (jb.SignedCoupling(), signed),
        (ElasticCentre(), signed),
    ):
        theta, inside = ComplianceCoordinates(parametrisation).inverse(np.array([phi]))
        assert inside.tolist() == [expected]
        assert np.isfinite(theta).all()  # meaningless where outside, but no warning and no NaN
        if expected:
            assert parametrisation.feasible(theta).all()


def test_the_paper_s_patterns_add_up_to_the_joint_matrix():
    matrix = pair_matrix([3.0, 1.0, 2.0])
    np.testing.assert_array_equal(matrix, [[3.0, 1.0], [1.0, 2.0]])
    np.testing.assert_array_equal(np.einsum("k,kij->ij", [3.0, 1.0, 2.0], PAIR.pattern), matrix)
    assert pair_matrix(np.ones((4, 5, 3))).shape == (4, 5, 2, 2)
    with pytest.raises(ValueError, match="read-only"):
        PAIR.pattern[0, 0, 0] = 2.0


def test_a_joint_to_ground_sees_the_motion_of_its_dofs():
    structure = rod()
    motion = np.arange(22.0)
    np.testing.assert_array_equal(CLAMP.selection(structure).T @ motion, motion[:2])
    reversed_clamp = jb.Joint(("1:rz", "1:y"))
    np.testing.assert_array_equal(reversed_clamp.selection(structure).T @ motion, motion[[1, 0]])


def test_a_joint_between_two_sets_sees_their_difference_and_no_common_motion():
    structure = rod()
    inner = jb.Joint(("3:y", "3:rz"), against=("8:y", "8:rz"))
    motion = np.random.default_rng(1).normal(size=22)
    near, far = structure.index(inner.dofs), structure.index(inner.against)
    deformation = inner.selection(structure).T @ motion
    np.testing.assert_allclose(deformation, motion[near] - motion[far], rtol=1e-15)
    translation = np.tile([1.0, 0.0], 11)
    assert not (inner.selection(structure).T @ translation).any()
    # action equals reaction: the assembled joint forces add up to zero
    forces = inner.selection(structure) @ pair_matrix(TABLE_3) @ deformation
    np.testing.assert_array_equal(forces[near], -forces[far])
    assert np.count_nonzero(forces) == 4


@pytest.mark.parametrize(
    "broken",
    [
        lambda: jb.Joint(()),
        lambda: jb.Joint(("1:y", "1:y")),
        lambda: jb.Joint(("1:y", "1:rz"), against=("1:y", "2:rz")),
        lambda: jb.Joint(("1:y", "1:rz"), against=("2:y",)),
        lambda: jb.Joint(("12:y", "12:rz")).selection(rod()),
        lambda: jb.Joint(("1:y", "2:rz")),
        lambda: jb.Joint(("A.b:y", "B.b:rz")),
        lambda: jb.Joint(("1:y", "1:rz"), ("3:rz", "3:y")),
        lambda: jb.Joint(("1:y", "1:rz"), ("3:y", "4:rz")),
        lambda: jb.Joint(("1:y", "1:rz"), against=("2:y", "2:x")).selection(rod()),
        lambda: CLAMP.selection(rod().fixed(("1:y",))),
        *(
            partial(PAIR.check, k)
            for k in ([np.nan, 0.0, 1.0], [1.0, 0.0, np.inf], [-1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 0.0, -1.0],
                      [2.0, 2.0001, 2.0], [2.0, -2.0001, 2.0], [0.0, 1e-9, 1.0])
        ),
        *(partial(kind().coordinates, k) for kind, each in NO_JOINTS.items() for k in each),
    ],
)  # fmt: skip
def test_impossible_joints_are_refused_in_one_line(broken):
    refused(broken, jb.ModelError)


@pytest.mark.parametrize("stiffness", [[2.0, 2.0, 2.0], [2.0, -2.0, 2.0], [1e8, 0.0, 0.0], [0.0, 0.0, 0.0], TABLE_3])
def test_the_edge_of_the_cone_is_a_possible_joint(stiffness):
    PAIR.check(stiffness)
    assert np.linalg.eigvalsh(pair_matrix(stiffness)).min() >= 0.0
