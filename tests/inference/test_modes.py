"""Likelihood of modes: against values of the test's own, matching, and the Jacobian that the search uses."""

import math

import numpy as np
import pytest
from scipy import linalg, stats

from jointbayes.frf import AssembledShapes
from jointbayes.inference.modal_likelihood import ModePrediction, mac
from jointbayes.joint import Joint
from jointbayes.structure import LossFactor, ModalDamping, Structure
from tests.conftest import CLAMP, lone_likelihood, rod
from vibrecords import Antiresonances, ModalConstants, ModeData, ModeShapes, Observed

NAN = float("nan")
MASSES = np.diag([2.0, 1.0, 1.5])
SPRINGS = np.array([[700.0, -700.0, 0.0], [-700.0, 1200.0, -500.0], [0.0, -500.0, 500.0]])
CHAIN = Structure(SPRINGS, MASSES, ModalDamping((0.01, 0.02)), ("1:x", "2:x", "3:x"))
GROUND = Joint(("1:x",))
STIFF = np.array([[3e6, 2e4], [2e4, 4e3]])


def modes(k: float) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and shapes (mode, mass) of the chain whose first mass is held by k."""
    whole = SPRINGS.copy()
    whole[0, 0] += k
    lam, shapes = linalg.eigh(whole, MASSES)
    return lam, shapes.T


def test_ln_l_is_the_sum_of_the_normal_log_densities_of_every_observed_value():
    rng = np.random.default_rng(3)
    frequency = Observed(np.sort(rng.uniform(2, 8, (2, 3))), np.array([[0.1, 0.2, 0.3]]))
    damping = Observed(np.array([0.02, NAN, 0.01]), np.array([1e-3, 1.0, 2e-3]))
    components = rng.normal(size=(2, 3, 2))
    components[1, 0, 1] = NAN
    shapes = ModeShapes(("3:x", "1:x"), ("2:x", "2:x", "2:x"), Observed(components, 0.1))
    measured = ModeData(frequency, damping, shapes)
    likelihood = lone_likelihood(CHAIN, GROUND, measured)
    for k in (300.0, 4e4):
        lam, phi = modes(k)
        expected = stats.norm.logpdf(frequency.values, np.sqrt(lam) / (2 * np.pi), frequency.sd).sum()
        expected += np.nansum(stats.norm.logpdf(damping.values, [0.01, 0.02, 0.02], damping.sd))
        ratio = (phi[:, [2, 0]] / phi[:, [1]])[None]
        expected += np.nansum(stats.norm.logpdf(components, ratio, 0.1))
        assert likelihood.log_likelihood(np.array([[[k]]]))[0] == pytest.approx(expected, rel=1e-9)
        assert likelihood.n_data == 6 + 2 + 11


def test_antiresonances_and_modal_constants_enter_with_what_the_chain_itself_has():
    rng = np.random.default_rng(4)
    zeros = Antiresonances(("3:x", "1:x", "3:x"), Observed(rng.uniform(2, 6, (2, 3)), np.array([0.1, 0.2, 0.3])))
    constants = rng.normal(size=(2, 2, 2))
    constants[0, 1, 0] = NAN
    of_constants = ModalConstants(("3:x", "1:x"), ("1:x", "1:x"), Observed(constants, 0.1))
    frequency = Observed(np.array([3.0, 6.0]), 0.2)
    measured = ModeData(frequency, numbers=(1, 3), zeros=zeros, constants=of_constants)
    likelihood = lone_likelihood(CHAIN, GROUND, measured)
    for k in (300.0, 4e4):
        lam, phi = modes(k)
        whole = SPRINGS + np.diag([k, 0, 0])
        held = [linalg.eigvalsh(whole[np.ix_(left, left)], MASSES[np.ix_(left, left)]) for left in ([0, 1], [1, 2])]
        antiresonance = np.sqrt([held[0][0], held[1][0], held[0][1]]) / (2 * np.pi)
        expected = stats.norm.logpdf([3.0, 6.0], np.sqrt(lam[[0, 2]]) / (2 * np.pi), 0.2).sum()
        expected += stats.norm.logpdf(zeros.frequency.values, antiresonance, zeros.frequency.sd).sum()
        expected += np.nansum(stats.norm.logpdf(constants, (phi[:, [2, 0]] * phi[:, [0]])[[0, 2]], 0.1))
        assert likelihood.log_likelihood(np.array([[[k]]]))[0] == pytest.approx(expected, rel=1e-9)


def test_eigenvalues_are_compared_as_eigenvalues_and_a_mode_with_the_one_of_its_number():
    lam, _ = modes(900.0)
    of_eigenvalues = lone_likelihood(CHAIN, GROUND, ModeData(Observed(1.1 * lam, 0.2 * lam), eigenvalues=True))
    np.testing.assert_allclose(of_eigenvalues.standardised([[[900.0]]])[0], -0.5, rtol=1e-9)
    f = np.sqrt(lam[[2, 0]]) / (2 * np.pi)
    numbered = lone_likelihood(CHAIN, GROUND, ModeData(Observed(f, 0.1), numbers=(3, 1)))
    np.testing.assert_allclose(numbered.predicted([[[900.0]]])[0], f, rtol=1e-9)


def test_modes_are_matched_by_shape_where_the_joint_changes_their_order():
    # two masses held by a spring each: which mode is the lower one depends on the joint
    apart = Structure(np.diag([0.0, 400.0]), np.eye(2), ModalDamping((0.0,)), ("1:x", "2:x"))
    shapes = ModeShapes(("1:x",), "2:x", Observed(np.array([[1e-3], [2e3]]), 1.0))
    frequency = Observed(np.sqrt([400.0, 900.0]) / (2 * np.pi), 0.1)
    measured = ModeData(frequency, shapes=shapes, match="shape")
    prediction = ModePrediction(measured, apart, Joint(("1:x",)))
    for k, order in ((900.0, [0, 1]), (100.0, [1, 0])):
        modal, places = prediction.matched([[[k]]])
        assert places.tolist() == [order]
        np.testing.assert_allclose(2 * np.pi * modal.frequency_hz[0], [20.0, math.sqrt(k)], rtol=1e-9)


def test_mac_is_one_for_proportional_shapes_and_zero_for_orthogonal_ones_and_passes_over_what_was_not_measured():
    measured = np.array([[1.0, 2.0, NAN], [2.0, -1.0, 0.0]])
    predicted = np.array([[-2.0, -4.0, 7.0], [2.0, -1.0, 0.0]])
    np.testing.assert_allclose(mac(measured, predicted), [[1.0, 0.0], [0.0, 1.0]], atol=1e-15)


def test_a_reference_that_does_not_move_is_infinitely_unlikely_and_no_error():
    # the masses do not know of each other: in either mode one is at rest, to rounding or exactly
    alike = Structure(np.array([[5.0, 0.0], [0.0, 5.0]]), np.eye(2), ModalDamping((0.0,)), ("1:x", "2:x"))
    shapes = ModeShapes(("1:x",), "2:x", Observed(np.array([[0.5], [0.5]]), 0.1))
    measured = ModeData(Observed(np.array([0.3, 0.4]), 0.1), shapes=shapes)
    likelihood = lone_likelihood(alike, Joint(("1:x",)), measured)
    assert likelihood.log_likelihood([[[1.0]]])[0] < -1e30


@pytest.mark.parametrize("match", ["number", "shape"])
@pytest.mark.parametrize("eigenvalues", [False, True])
def test_the_jacobian_of_the_residuals_is_that_of_differences(match, eigenvalues):
    structure = rod(damping=LossFactor(0.01))
    modal = AssembledShapes(structure, CLAMP, 3, ("3:y", "7:y", "11:y")).modes(STIFF)
    frequency = (2 * np.pi * modal.frequency_hz) ** 2 if eigenvalues else modal.frequency_hz
    shapes = ModeShapes(("3:y", "7:y"), "11:y", Observed(modal.shapes[:, :, :2] / modal.shapes[:, :, 2:], 0.01))
    more = {
        "zeros": Antiresonances(("11:y", "11:y", "7:y"), Observed(np.array([150.0, 700.0, 200.0]), 1.0)),
        "constants": ModalConstants(("7:y", "11:y"), ("11:y", "11:y"), Observed(np.ones((3, 2)), 0.1)),
    }
    off, ratios = Observed(1.01 * frequency, 0.01 * frequency), Observed(modal.damping_ratio, 1e-4)
    measured = ModeData(off, ratios, shapes, match=match, eigenvalues=eigenvalues, **more)
    likelihood = lone_likelihood(structure, CLAMP, measured)
    directions = np.array([[[1e6, 0], [0, 0]], [[0, 1e4], [1e4, 0]], [[0, 0], [0, 1e3]]])
    residual, jacobian = likelihood.residuals(STIFF, directions, np.ones(0))
    np.testing.assert_allclose(residual, likelihood.standardised(STIFF[None])[0], rtol=1e-12)
    up, down = (likelihood.standardised(STIFF + step * directions) for step in (1e-4, -1e-4))
    difference = ((up - down) / 2e-4).T
    assert np.abs(jacobian - difference).max() < 1e-5 * np.abs(difference).max(), (jacobian, difference)
