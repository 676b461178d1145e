"""Kinds of joint: pairs in all coordinates, full matrices, springs, rigid ones, and several joints side by side."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import jointbayes as jb
from jointbayes.frf import NaturalFrequencies
from jointbayes.inference import LogPosterior
from jointbayes.joint import COORDINATES, HYPOTHESES, RIGID, ComplianceCoordinates, ElasticCentre, Rigid
from jointbayes.joint.kinds import joint_under_hypothesis
from tests.conftest import CLAMP, PAIR, TABLE_3, best_of, lone_likelihood, pair_matrix, rod
from tests.oracles import differences
from vibrecords import FrequencyData

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
SPRINGS = jb.parametrisation_named("springs", ("x", "rz"))
TWO = jb.blocks_of({"left": jb.LogStiffness(), "right": jb.SignedCoupling()})
SHARED = jb.blocks_of({"a": jb.LogStiffness(), "b": "a", "c": SPRINGS, "d": Rigid(2), "e": ElasticCentre()})
DAMPED = jb.Damped(jb.LogStiffness(), ("k22",), ("k11",))
KINDS = {key: jb.parametrisation_named(key) for key in COORDINATES} | {
    **{f"full of {len(d)}": jb.FullStiffness(d) for d in (("rz",), ("y", "rz"), ("x", "y", "rz"), DIRECTIONS)},
    "springs": SPRINGS,
    "one spring of a pair": jb.PlainSprings(("k22",)),
    "rigid": Rigid(3),
    "two": TWO,
    "shared": SHARED,
    "damped": DAMPED,
    "damped springs": jb.Damped(SPRINGS, ("kx",), ("all",)),
    "damped among others": jb.blocks_of({"a": DAMPED, "b": "a", "c": SPRINGS}),
}
ALL = pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
SEEDS = st.integers(0, 2**32 - 1)
#: Of as many kinds: each example draws all coordinates over decades.
FEW = settings(max_examples=20)


def theta_of(kind, seed, widest=0.9):
    """Random coordinates of possible joints, their stiffnesses over decades."""
    rng = np.random.default_rng(seed)
    draw = {True: lambda: rng.normal(np.log(1e7), 3.0), False: lambda: rng.uniform(-widest, widest)}
    theta = np.array([draw[axis.logarithmic]() for axis in kind.axes])
    for cone in kind.cones:
        theta[cone.coupling] = (theta[cone.first] + theta[cone.last]) / 2 + np.log(rng.uniform(0.01, widest))
    return theta


@ALL
@FEW
@given(SEEDS)
def test_coordinates_and_stiffness_are_inverse_to_each_other(kind, seed):
    theta = theta_of(kind, seed)
    stiffness = kind.values(theta)
    assert stiffness.shape == (len(kind.quantities),)
    assert kind.describes(stiffness)
    assert kind.feasible(theta)
    assert kind.is_positive_semidefinite(stiffness)
    kind.check(stiffness)
    np.testing.assert_allclose(kind.coordinates(stiffness), theta, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(kind.values_of_matrix(kind.matrix(stiffness)), stiffness)


@ALL
@FEW
@given(SEEDS)
def test_the_derivative_and_its_volume_are_those_of_the_stiffness(kind, seed):
    theta = theta_of(kind, seed)
    exact, d = kind.derivative(theta), len(kind.axes)
    assert exact.shape == (len(kind.quantities), d)
    size = np.abs(exact).max(axis=1, initial=0.0, keepdims=True)
    size[size == 0] = 1.0  # of a motion that is held
    slopes = differences(kind.values, theta).reshape(d, len(exact)).T
    np.testing.assert_allclose(exact / size, slopes / size, atol=1e-7)
    if len(kind.quantities) == d:
        sign, log_slope = np.linalg.slogdet(exact / size)
        assert sign != 0
        assert kind.log_slope(theta) == pytest.approx(log_slope + np.log(size).sum(), abs=1e-8)


@ALL
@FEW
@given(SEEDS)
def test_the_compliance_leads_back_with_the_volume_it_states(kind, seed):
    coordinates, theta = ComplianceCoordinates(kind), theta_of(kind, seed, widest=0.7)
    phi = coordinates.forward(theta[None])
    back, inside = coordinates.inverse(phi)
    assert inside.tolist() == [True]
    np.testing.assert_allclose(back[0], theta, rtol=1e-7, atol=1e-7)
    # wide enough for a compliance of which a stiff spring is but the last digits
    step = 3e-4 * np.eye(theta.size)
    size = np.maximum(np.abs(phi[0]), np.abs(coordinates.forward(theta + step) - phi).max(axis=0, initial=0.0) * 1e4)
    jacobian = ((coordinates.forward(theta + step) - coordinates.forward(theta - step)) / size).T / 6e-4
    _, log_determinant = np.linalg.slogdet(jacobian)
    expected = -log_determinant - np.log(size).sum() if theta.size else 0.0
    assert coordinates.log_volume(theta[None])[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("key", [*COORDINATES, "full of 1", "full of 2", "full of 3", "full of 6", "springs", "two"])
@FEW
@given(SEEDS)
def test_determinant_and_compliance_are_those_of_the_joint_matrix(key, seed):
    kind = KINDS[key]
    theta = theta_of(kind, seed)
    matrix = kind.matrix(kind.values(theta)).stiffness
    size = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(size, size)
    determinant = np.linalg.slogdet(scaled)[1] + 2 * np.log(size).sum()
    assert kind.log_determinant(theta) == pytest.approx(determinant, abs=1e-6)
    compliance = kind.matrix(ComplianceCoordinates(kind).forward(theta[None])[0]).stiffness
    np.testing.assert_allclose(compliance * np.outer(size, size) @ scaled, np.eye(len(size)), atol=1e-6)


LN_K = st.floats(np.log(1e2), np.log(1e12))


@given(LN_K, LN_K, st.floats(-3.0, 3.0))
def test_coordinates_are_feasible_exactly_where_the_joint_is_positive_definite(ln_k11, ln_k22, rho):
    assume(abs(rho) > 0.01)
    assume(abs(abs(rho) - 1) > 1e-9)
    log = [ln_k11, (ln_k11 + ln_k22) / 2 + np.log(abs(rho)), ln_k22]
    for kind, theta in ((jb.LogStiffness(), log), (jb.SignedCoupling(), [ln_k11, ln_k22, rho])):
        stiffness = kind.values(np.array(theta))
        size = np.sqrt(stiffness[[0, 2]])
        definite = (np.linalg.eigvalsh(pair_matrix(stiffness) / np.outer(size, size)) > 0).all()
        assert kind.feasible(np.array(theta)) == definite


@given(LN_K, st.floats(-1.0, 1.0), LN_K)
def test_a_joint_acts_at_its_elastic_centre_without_coupling(ln_k11, arm, ln_k22c):
    """Motion of the centre y + a φ gives the force k11 (y + a φ) and no moment about it."""
    to_centre = np.array([[1.0, arm], [0.0, 1.0]])
    about_centre = to_centre.T @ np.diag(np.exp([ln_k11, ln_k22c])) @ to_centre
    np.testing.assert_allclose(pair_matrix(ElasticCentre().values([ln_k11, arm, ln_k22c])), about_centre, rtol=1e-12)


@pytest.mark.parametrize("key", COORDINATES)
def test_a_parametrisation_says_what_its_coordinates_are(key):
    kind, theta = KINDS[key], KINDS[key].coordinates(TABLE_3)
    assert kind.names == tuple(axis.name for axis in kind.axes)
    assert {axis.quantity for axis in kind.axes} == {quantity.name for quantity in PAIR.quantities}
    for quantity, k in zip(PAIR.quantities, TABLE_3, strict=True):
        column = kind.names.index(kind.standing_for(quantity.name))
        if quantity.name in kind.names:  # a stiffness among the coordinates is there by its logarithm
            assert kind.axes[column].value(theta[column]) == pytest.approx(k, rel=1e-12)
            assert (kind.axes[column].unit, kind.axes[column].label) == (quantity.unit, f"ln {quantity.name}")
        else:
            assert quantity.name in kind.derived
    others = [(a.name, a.unit, a.label, a.axis_label, a.bounded) for a in kind.axes if not a.logarithmic]
    expected = {"signed": [("rho", "1", "ρ", "ρ", True)], "elastic_centre": [("arm", "m", "arm", "arm (m)", False)]}
    assert others == expected.get(key, [])


@pytest.mark.parametrize(
    ("phi", "log", "signed"),
    [
        ([2e-10, -1e-11, 1e-6], True, True),
        *(([2e-10, c12, 1e-6], False, True) for c12 in (1e-11, 0.0)),  # k12 ≤ 0
        *((phi, False, False) for phi in ([-2e-10, -1e-11, 1e-6], [2e-10, -1e-11, -1e-6])),
        ([-2e-10, -1e-11, -1e-6], False, False),  # positive determinant, negative definite
        *(([2e-10, c12, 1e-6], False, False) for c12 in (-2e-8, 2e-8)),  # c12² > c11 c22
    ],
)
def test_the_coordinates_know_which_compliances_are_joints(phi, log, signed):
    for kind, expected in ((jb.LogStiffness(), log), (jb.SignedCoupling(), signed), (ElasticCentre(), signed)):
        theta, inside = ComplianceCoordinates(kind).inverse(np.array([phi]))
        assert inside.tolist() == [expected]
        assert np.isfinite(theta).all()  # meaningless where outside, but no warning and no NaN
        assert not expected or kind.feasible(theta).all()


@pytest.mark.parametrize("damping", [-0.1, 0.0])
def test_damping_of_zero_or_below_is_outside_of_the_coordinates_and_no_warning(damping):
    coordinates = ComplianceCoordinates(DAMPED)
    phi = coordinates.forward(theta_of(DAMPED, 1)[None])
    np.testing.assert_allclose(phi[0, 3:], DAMPED.values(theta_of(DAMPED, 1))[3:], rtol=1e-14)
    phi[0, 4] = damping
    theta, inside = coordinates.inverse(phi)
    assert inside.tolist() == [False]
    assert np.isfinite(theta).all()


@ALL
def test_batches_are_the_same_as_one_by_one(kind):
    theta = np.array([[theta_of(kind, 10 * i + j) for j in range(2)] for i in range(3)])
    stiffness = kind.values(theta)
    asked = {"values": (theta, 0), "derivative": (theta, 1), "feasible": (theta, 0), "matrix": (stiffness, 0)}
    for name, (given_, close) in asked.items():
        together = getattr(kind, name)(given_)
        each = [[getattr(kind, name)(t) for t in row] for row in given_]
        if name == "matrix":
            together, each = together.sides, [[joint.sides for joint in row] for row in each]
            each = np.moveaxis(each, 2, 0)
        np.testing.assert_allclose(together, each, rtol=1e-12 * close, atol=0, err_msg=name)


@given(st.integers(1, 6), SEEDS)
def test_every_positive_definite_matrix_is_a_full_joint(r, seed):
    rng = np.random.default_rng(seed)
    root, size = rng.normal(size=(r, r)) + 0.1 * np.eye(r), np.exp(rng.normal(10, 3, r))
    matrix, scale = (root @ root.T + 1e-3 * np.eye(r)) * np.outer(size, size), np.outer(size, size)
    full = jb.FullStiffness(DIRECTIONS[:r])
    theta = full.coordinates(full.values_of_matrix(matrix))
    assert full.feasible(theta)
    np.testing.assert_allclose(full.matrix(full.values(theta)).stiffness / scale, matrix / scale, atol=1e-9)


def test_a_full_joint_of_two_motions_is_the_coupled_pair():
    full, signed = jb.FullStiffness(("y", "rz")), jb.SignedCoupling()
    np.testing.assert_allclose(full.coordinates(TABLE_3), signed.coordinates(TABLE_3), rtol=1e-12)
    assert full.stiffness_names == signed.stiffness_names
    assert [q.unit for q in full.quantities] == [q.unit for q in signed.quantities]
    np.testing.assert_array_equal(full.matrix(TABLE_3).stiffness, PAIR.matrix(TABLE_3).stiffness)


FULL = jb.FullStiffness(("x", "y", "z"))
INDEFINITE = np.array([1.0, 0.9, -0.9, 1.0, 0.9, 1.0])  # each pair possible, all three together not


def test_near_what_is_no_full_joint_there_is_one():
    assert not FULL.is_positive_semidefinite(INDEFINITE)
    assert not FULL.describes(INDEFINITE)
    near = FULL.nearest(INDEFINITE)
    assert FULL.describes(near)
    np.testing.assert_array_equal(near, [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])


def test_springs_are_named_after_their_directions_and_stand_on_the_diagonal():
    springs = jb.parametrisation_named("springs", DIRECTIONS)
    assert springs.names == springs.stiffness_names == ("kx", "ky", "kz", "krx", "kry", "krz")
    assert [q.unit for q in springs.quantities] == ["N/m"] * 3 + ["N·m/rad"] * 3
    np.testing.assert_array_equal(springs.matrix(np.arange(1.0, 7.0)).stiffness, np.diag(np.arange(1.0, 7.0)))


def test_a_rigid_joint_has_no_quantity_and_holds_every_motion():
    rigid = Rigid(3)
    assert (rigid.names, rigid.quantities, rigid.size) == ((), (), 3)
    np.testing.assert_array_equal(rigid.matrix(np.empty((4, 0))).stiffness, np.tile(RIGID * np.eye(3), (4, 1, 1)))


# ---- several joints


def test_joints_side_by_side_have_their_names_and_their_own_matrices():
    assert TWO.names == ("left.k11", "left.k12", "left.k22", "right.k11", "right.k22", "right.rho")
    assert TWO.stiffness_names == tuple(f"{side}.{k}" for side in ("left", "right") for k in PAIR.stiffness_names)
    assert [axis.label for axis in TWO.axes][-2:] == ["ln right.k22", "right.ρ"]
    assert TWO.standing_for("right.k12") == "right.rho"
    theta = theta_of(TWO, 1)
    left, right = jb.LogStiffness(), jb.SignedCoupling()
    k = TWO.values(theta)
    np.testing.assert_array_equal(k, np.concatenate([left.values(theta[:3]), right.values(theta[3:])]))
    matrix = TWO.matrix(k).stiffness
    np.testing.assert_array_equal(matrix[:2, :2], left.matrix(k[:3]).stiffness)
    np.testing.assert_array_equal(matrix[2:, 2:], right.matrix(k[3:]).stiffness)
    assert not matrix[:2, 2:].any()
    np.testing.assert_allclose(np.einsum("q,qij->ij", k, TWO.pattern), matrix, rtol=1e-15)


def test_what_joints_share_is_named_once_and_stands_in_each_of_them():
    assert SHARED.stiffness_names == ("a.k11", "a.k12", "a.k22", "c.kx", "c.krz", "e.k11", "e.k12", "e.k22")
    matrix = SHARED.matrix(SHARED.values(theta_of(SHARED, 2))).stiffness
    np.testing.assert_array_equal(matrix[:2, :2], matrix[2:4, 2:4])
    assert SHARED.size == 10
    np.testing.assert_array_equal(np.diag(matrix)[6:8], [RIGID, RIGID])


def test_a_lone_joint_without_a_name_is_its_parametrisation_itself():
    assert jb.blocks_of({"": PAIR}) is PAIR
    assert jb.blocks_of({"clamp": PAIR}).names == ("clamp.k11", "clamp.k12", "clamp.k22")


def test_where_the_means_of_the_priors_are_no_joint_the_middle_is_one_without_coupling():
    mean = np.log([1e6, 1e9, 1e5])
    assert np.allclose(jb.LogStiffness().middle(mean), [1e6, 0.0, 1e5])


def test_a_hypothesis_is_that_of_every_joint():
    assert joint_under_hypothesis(TWO, "full").names == TWO.names
    assert joint_under_hypothesis(TWO, "rigid").names == ()
    assert joint_under_hypothesis(TWO, "translation").names == ("left.k11", "right.k11")
    assert joint_under_hypothesis(SHARED, "rotation").names == ("a.k22", "c.krz", "e.k22")
    assert all(joint_under_hypothesis(TWO, name).size == TWO.size for name in HYPOTHESES)
    full = KINDS["full of 3"]
    assert joint_under_hypothesis(full, "translation").names == ("k11", "k22")
    springs = joint_under_hypothesis(full, "springs")
    np.testing.assert_array_equal(springs.matrix(full.rigid).stiffness, RIGID * np.eye(3))


# ---- springs without coupling

PLAIN = pytest.mark.parametrize("names", [(), ("k11",), ("k22",), ("k11", "k22")])
KNOWN = {"k11": 3e8, "k22": 2e5}


@pytest.mark.parametrize(("absent", "stiffness"), [(False, 1e30), (True, 0.0)])
def test_a_spring_that_is_not_named_is_rigid_or_absent(absent, stiffness):
    values = jb.PlainSprings(("k22",), absent=absent).values(np.log([2e5]))
    np.testing.assert_allclose(values, [stiffness, 0.0, 2e5])


@PLAIN
def test_named_springs_are_coordinates_and_the_others_rigid(names):
    springs, theta = jb.PlainSprings(names), np.log([KNOWN[name] for name in names])
    expected = [KNOWN["k11"] if "k11" in names else RIGID, 0.0, KNOWN["k22"] if "k22" in names else RIGID]
    np.testing.assert_allclose(springs.values(theta), expected, rtol=1e-13)
    np.testing.assert_allclose(springs.coordinates(expected), theta, rtol=1e-13)
    assert springs.feasible(theta)
    assert springs.log_determinant(theta) == pytest.approx(theta.sum(), rel=1e-13)
    assert PAIR.is_positive_semidefinite(expected)


def test_a_compliance_that_is_not_positive_is_no_spring():
    compliance = np.array([[1e-9, -1e-6], [0.0, 1e-6], [1e-9, 1e-6]])
    theta, inside = ComplianceCoordinates(jb.PlainSprings()).inverse(compliance)
    assert inside.tolist() == [False, False, True]
    assert np.isfinite(theta).all()


@PLAIN
def test_the_mode_search_finds_the_springs_that_made_the_data(names):
    """Also without any coordinate, where there is nothing to find."""
    springs, theta = jb.PlainSprings(names), np.log([KNOWN[name] for name in names])
    made = NaturalFrequencies(rod(elements=4), CLAMP, 3).frequency_hz(pair_matrix(springs.values(theta)))[0]
    measurement = FrequencyData(made, np.full(3, 0.01))
    marginals = {"k11": jb.Uniform(np.log(1e6), np.log(1e11)), "k22": jb.Uniform(np.log(1e3), np.log(1e8))}
    prior = jb.JointPrior(springs, tuple(marginals[name] for name in springs.names))
    assert prior.sample(np.random.default_rng(1), 5).shape == (5, theta.size)
    assert [end.shape for end in prior.support] == [(theta.size,)] * 2
    posterior = LogPosterior(prior, lone_likelihood(rod(elements=4), CLAMP, measurement))
    found = best_of(posterior, {"paper": [1e8, 0.0, 0.0], "stiff": [1e10, 1e6, 1e6]})
    np.testing.assert_allclose(found.theta, theta, atol=1e-6)
    assert found.covariance.shape == (theta.size, theta.size)
    assert not found.failed_starts


def test_a_refused_pair_names_its_key():
    with pytest.raises(jb.ModelError) as error:
        jb.parametrisation_named("log", ("y",))
    assert error.value.key == ("dofs",)
