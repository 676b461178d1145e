"""Measured bodies: coupled as if they were modelled, their errors propagated, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg

import jointbayes as jb
from jointbayes.frf import LowRankCoupling, NoisePropagation, receptance_model
from jointbayes.joint import JointMatrix, Joints, joint_matrix_of
from jointbayes.structure import Rayleigh, ViscousMatrix, beam
from tests.conftest import STEEL
from tests.oracles import off_peak
from vibrecords import FrfSet

LINES = np.arange(40.0, 1200.0, 20.0)
OMEGA = 2 * np.pi * LINES
K_PAIR = np.array([[2e8, 3e6], [3e6, 1e5]])
TAPER = jb.Joint(("1:y", "1:rz"), ("s5:y", "s5:rz"))
#: Two joints: the taper, and a spring between the tool's third point and the spindle's nose.
TWO = Joints((replace(TAPER, name="taper"), jb.Joint(("3:y",), ("s4:y",), name="ring")))
K_TWO = np.array([[2e8, 3e6, 0], [3e6, 1e5, 0], [0, 0, 4e6]])
#: The same with a dashpot in the ring and a loss factor of the taper.
DAMPED_TWO = JointMatrix(K_TWO, np.diag([0, 0, 900.0]), 0.2 * K_TWO * [[1, 1, 0], [1, 1, 0], [0, 0, 0]])


PORTS = jb.Ports(LINES, ("7:y", "s4:y"), ("7:y",))


def tool(damping=None) -> jb.Structure:
    return beam(0.18, jb.Section.circle(0.02), STEEL, damping or jb.LossFactor(0.02), elements=6)


def spindle() -> jb.Structure:
    """A stub on two bearings, with other labels than the tool's."""
    free = beam(0.25, jb.Section.circle(0.06), STEEL, Rayleigh(20.0, 2e-5), elements=4)
    k = free.stiffness.copy()
    for label, spring in (("1:y", 8e7), ("4:y", 5e7)):
        i = free.dofs.index(label)
        k[i, i] += spring
    return jb.Structure(k, free.mass, free.damping, tuple(f"s{label}" for label in free.dofs))


def dynamic_stiffness(structure: jb.Structure, omega: float) -> np.ndarray:
    """Z of one body, written out."""
    alpha, beta = structure.damping.viscous
    given = structure.damping.matrix
    c = alpha * structure.mass + beta * structure.stiffness if given is None else given
    return structure.stiffness * (1 + 1j * structure.damping.hysteretic) + 1j * omega * c - omega**2 * structure.mass


def at_line(joint: np.ndarray, omega: float) -> np.ndarray:
    """K of a joint, or K + jωC + jH of one with damping."""
    k, c, h = joint_matrix_of(joint).sides
    return k + 1j * (omega * c + h)


def dense(bodies, joint, k, outputs, inputs, omega=OMEGA) -> np.ndarray:
    """Receptance of all bodies assembled, by one dense solution of each line."""
    labels = [label for body in bodies for label in body.dofs]
    deformation, row = np.zeros((len(labels), joint.size)), 0
    for one in getattr(joint, "joints", (joint,)):
        for sign, dofs in ((1.0, one.dofs), (-1.0, one.against)):
            deformation[[labels.index(label) for label in dofs], row + np.arange(len(dofs))] = sign
        row += one.size
    forces, seen = (np.eye(len(labels))[:, [labels.index(label) for label in at]] for at in (inputs, outputs))
    out = []
    for w in omega:
        z = linalg.block_diag(*(dynamic_stiffness(body, w) for body in bodies))
        out.append(seen.T @ np.linalg.solve(z + deformation @ at_line(k, w) @ deformation.T, forces))
    return np.array(out)


def frfs_of(structure: jb.Structure, dofs, quantity="receptance", frequency_hz=LINES) -> FrfSet:
    """Exact FRFs of a body by itself."""
    at = np.ix_(*[structure.index(dofs)] * 2)
    values = [np.linalg.inv(dynamic_stiffness(structure, 2 * np.pi * f))[at] for f in frequency_hz]
    return FrfSet(frequency_hz, np.array(values), tuple(dofs), tuple(dofs)).converted(quantity)


def measured_spindle(dofs=("s5:y", "s5:rz", "s4:y"), sd=0.01, quantity="receptance") -> jb.MeasuredBody:
    frf = frfs_of(spindle(), dofs, quantity)
    return jb.MeasuredBody.of(frf, (sd * np.abs(frf.values)) ** 2, "spindle")


def coupled(body, joint=TAPER, ports=PORTS, model=None):
    """The tool with a measured body, or several, at a joint."""
    bodies = body if isinstance(body, tuple) else (body,)
    return receptance_model(jb.Substructures(model or tool(), bodies), joint, ports)


@pytest.mark.parametrize(("joint", "k"), [(TAPER, K_PAIR), (TWO, K_TWO), (TWO, DAMPED_TWO)])
@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
def test_a_body_with_exact_frfs_couples_as_if_it_were_modelled(joint, k, quantity):
    ports = jb.Ports(LINES, ("7:y", "3:rz", "s4:y"), ("7:y", "s5:y"))
    found = coupled(measured_spindle(quantity=quantity), joint, ports).receptance(k)[0]
    assert off_peak(found, dense((tool(), spindle()), joint, k, ports.outputs, ports.inputs)) < 1e-10


def test_both_bodies_may_be_measured_but_for_a_model_that_no_joint_touches():
    outside = jb.Structure(np.eye(1) * 1e6, np.eye(1), jb.LossFactor(0.1), ("99:y",))
    blank = frfs_of(tool(), ("1:y", "1:rz", "7:y"))
    bodies = (jb.MeasuredBody.of(blank, np.zeros(blank.values.shape), "tool"), measured_spindle())
    found = coupled(bodies, model=outside).receptance(K_PAIR)[0]
    assert off_peak(found, dense((tool(), spindle()), TAPER, K_PAIR, PORTS.outputs, PORTS.inputs)) < 1e-10


def with_matrix(structure: jb.Structure) -> jb.Structure:
    """Modal damping of a body by itself as a matrix C = MΦ diag(2ζω) ΦᵀM."""
    law = structure.damping
    if not law.of_assembled_modes:
        return structure
    modes = structure.modes()
    rigid = int((modes.eigenvalues <= 0).sum())
    rate = np.zeros(structure.n_dofs)
    rate[rigid:] = 2 * law.per_mode(structure.n_dofs - rigid) * np.sqrt(modes.eigenvalues[rigid:])
    weighted = structure.mass @ modes.shapes
    return replace(structure, damping=ViscousMatrix((weighted * rate) @ weighted.T))


def test_modal_damping_is_that_of_the_modelled_body_by_itself():
    free, ports = tool(jb.ModalDamping((0.01, 0.03))), jb.Ports(LINES, ("7:y",), ("7:y", "3:y"))
    found = LowRankCoupling(jb.Substructures(free, (measured_spindle(),)), TAPER, ports).receptance(K_PAIR)[0]
    truth = dense((with_matrix(free), spindle()), TAPER, K_PAIR, ports.outputs, ports.inputs)
    assert np.abs(found - truth).max() < 1e-8 * np.abs(found).max()


@pytest.mark.parametrize("law", [jb.ModalDamping((0.01, 0.03)), jb.LossFactor(0.02)], ids=["modal", "loss factor"])
@pytest.mark.parametrize("k", [K_TWO, DAMPED_TWO], ids=["undamped joint", "damped joint"])
def test_uncertain_models_of_any_damping_in_a_batch_are_those_of_each_row(law, k):
    recipe = jb.BeamRecipe(0.18, jb.Section.circle(0.02), STEEL, law, elements=6)
    family, factors = jb.BeamFamily(recipe, {"youngs_modulus": (-0.1, 0.1)}), np.array([[1.0], [1.05], [0.97]])
    ports, body = jb.Ports(LINES[::8], ("7:y", "s4:y"), ("7:y",)), measured_spindle().at_lines(LINES[::8])
    model = coupled(body, TWO, ports, family)
    sides = k.sides if isinstance(k, JointMatrix) else (k,)
    batch = JointMatrix(*(np.stack([side, 1.1 * side, 0.9 * side]) for side in sides))
    found, noise = model.receptance(batch, factors), NoisePropagation(model).covariance(batch, factors)
    for i, row in enumerate(factors):
        one = with_matrix(family.structure(row))
        truth = dense((one, spindle()), TWO, batch[i], ports.outputs, ports.inputs, ports.omega)
        assert off_peak(found[i], truth) < 3e-5  # modes far above the lines answer without damping
        want = NoisePropagation(coupled(body, TWO, ports, one)).covariance(batch[i])[0]
        assert np.abs(noise[i] - want).max() < 1e-4 * np.abs(want).max()


def test_sensors_beside_the_joint_see_it_through_a_rigid_link():
    """Two translations of a rigid block, 10 and 30 mm from its face, give translation and rotation at the face."""
    block = jb.Structure(np.diag([2e7, 3e4]), np.diag([4.0, 0.02]), jb.LossFactor(0.05), ("b:y", "b:rz"))
    at_face, at_sensors = frfs_of(block, ("b:y", "b:rz")), np.array([[1.0, 0.01], [1.0, 0.03]])
    seen = FrfSet(LINES, at_sensors @ at_face.values @ at_sensors.T, ("p:y", "q:y"), ("p:y", "q:y"))
    variance = (0.01 * np.abs(seen.values)) ** 2
    body = jb.MeasuredBody.of(seen, variance, "block").seen_at(
        {"b:y": {"p:y": 1.5, "q:y": -0.5}, "b:rz": {"p:y": -50.0, "q:y": 50.0}}
    )
    assert np.allclose(body.receptance, at_face.values, rtol=1e-9, atol=1e-9 * np.abs(at_face.values).max())
    # the errors of the three receptances, propagated by hand: A′ = T A Tᵀ entry by entry
    t = np.array([[1.5, -0.5], [-50.0, 50.0]])
    rng, noise = np.random.default_rng(1), np.zeros((20000, 2, 2))
    for i, j in ((0, 0), (0, 1), (1, 1)):
        noise[:, i, j] = noise[:, j, i] = rng.standard_normal(20000) * np.sqrt(_averaged(variance)[0, i, j])
    moved = t @ noise @ t.T
    entries = np.stack([moved[:, 0, 0], moved[:, 0, 1], moved[:, 1, 1]])
    size = np.sqrt(np.diag(body.covariance[0]))
    assert np.abs((np.cov(entries) - body.covariance[0]) / np.outer(size, size)).max() < 0.04


def _averaged(variance):
    """Variance of the mean of two FRFs that reciprocity makes equal."""
    out = np.array(variance)
    out[:, 0, 1] = out[:, 1, 0] = variance[:, 0, 1] * variance[:, 1, 0] / (variance[:, 0, 1] + variance[:, 1, 0])
    return out


def test_an_offset_of_the_joint_is_a_rigid_link_of_the_measured_body():
    ports = jb.Ports(LINES, ("7:y",), ("7:y",))
    body = measured_spindle(("s5:y", "s5:rz"))
    moved = body.seen_at({"t:y": {"s5:y": 1.0, "s5:rz": 0.02}, "t:rz": {"s5:rz": 1.0}})
    by_joint = coupled(body, replace(TAPER, offset_against_m=(0.02, 0.0, 0.0)), ports)
    by_body = coupled(moved, replace(TAPER, against=("t:y", "t:rz")), ports)
    assert off_peak(by_joint.receptance(K_PAIR)[0], by_body.receptance(K_PAIR)[0]) < 1e-12


@pytest.mark.long
@pytest.mark.science
def test_the_propagated_covariance_is_that_of_the_frfs_of_noisy_bodies():
    """Against Monte Carlo: bodies with drawn errors, coupled one by one by the dense reference formula."""
    ports = replace(PORTS, frequency_hz=LINES[[5, 20, 40]])
    body = measured_spindle(sd=1e-3).at_lines(ports.frequency_hz)
    mix = np.random.default_rng(5).normal(size=(6, 6))
    size = np.sqrt(np.diagonal(body.covariance, axis1=1, axis2=2))
    body = replace(body, covariance=(size[:, :, None] * (mix @ mix.T / 6)) * size[:, None, :])
    found = NoisePropagation(coupled(body, TWO, ports)).covariance(DAMPED_TWO)[0]
    rng, count = np.random.default_rng(3), 4000
    root = np.linalg.cholesky(body.covariance)
    a, b = np.triu_indices(3)
    values = np.empty((count, 3, 2), dtype=complex)
    for i in range(count):
        white = rng.standard_normal((3, 6, 2)) @ [1, 1j] / np.sqrt(2)
        delta = np.zeros((3, 3, 3), dtype=complex)
        delta[:, a, b] = delta[:, b, a] = (root @ white[..., None])[..., 0]
        noisy = replace(body, receptance=body.receptance + delta)
        values[i] = coupled(noisy, TWO, ports).receptance(DAMPED_TWO)[0, :, :, 0]
    values -= values.mean(axis=0)
    sampled = np.einsum("nlp,nlq->lpq", values, values.conj()) / count
    size = np.sqrt(np.abs(np.diagonal(found, axis1=1, axis2=2)))
    relative = np.abs(sampled - found) / (size[:, :, None] * size[:, None, :])
    assert relative.max() < 4 / np.sqrt(count)
    # circular: real and imaginary parts alike, and independent of each other
    pseudo = np.einsum("nlp,nlp->lp", values, values) / count
    assert (np.abs(pseudo) / size**2).max() < 4 / np.sqrt(count)


@pytest.mark.parametrize("joint", [K_TWO, DAMPED_TWO], ids=["undamped", "damped"])
def test_the_relative_deviation_of_the_denominator_is_that_of_noisy_bodies(joint):
    ports = jb.Ports(LINES[[5, 20, 40]], ("7:y",), ("7:y",))
    body = measured_spindle(sd=1e-3).at_lines(ports.frequency_hz)
    model = coupled(body, TWO, ports)
    found = NoisePropagation(model).relative_sd(joint)[0]
    k = np.array([at_line(joint, w) for w in ports.omega])
    rng, a, b = np.random.default_rng(4), *np.triu_indices(3)
    sd = np.sqrt(np.diagonal(body.covariance, axis1=1, axis2=2))
    free = model.free(np.empty((1, 0)))[0, :, :3, :3]
    motions = model.bodies[0][1][:, :3]
    ratio = np.empty((4000, 3), dtype=complex)
    for i in range(len(ratio)):
        delta = np.zeros((3, 3, 3), dtype=complex)
        delta[:, a, b] = delta[:, b, a] = sd * (rng.standard_normal((3, 6, 2)) @ [1, 1j]) / np.sqrt(2)
        noisy = free + motions.T @ delta @ motions
        ratio[i] = np.linalg.det(np.eye(3) + noisy @ k) / np.linalg.det(np.eye(3) + free @ k)
    assert np.allclose(np.sqrt(np.mean(np.abs(ratio - 1) ** 2, axis=0)), found, rtol=0.06)


def test_two_frfs_of_one_pair_are_averaged_by_their_variances_and_compared():
    frf = frfs_of(spindle(), ("s5:y", "s5:rz"))
    rng = np.random.default_rng(2)
    variance = (0.01 * np.abs(frf.values)) ** 2
    variance[:, 0, 1] *= 4
    noise = rng.standard_normal((*variance.shape, 2)) @ [1, 1j] * np.sqrt(variance / 2)
    noisy = frf.values + noise
    body = jb.MeasuredBody.of(replace(frf, values=noisy), variance, "spindle")
    assert np.allclose(body.receptance[:, 0, 1], 0.2 * noisy[:, 0, 1] + 0.8 * noisy[:, 1, 0])
    assert np.allclose(body.covariance[:, 1, 1], 0.8 * variance[:, 1, 0])
    assert body.discrepancy == pytest.approx(1.0, abs=4 / np.sqrt(len(LINES)))


#: A sensor that points the other way as a response than as a force.
TURNED = frfs_of(spindle(), ("s5:y", "s5:rz"))
TURNED = replace(TURNED, values=TURNED.values * np.array([[1.0, 1.0], [-1.0, 1.0]]))


def test_lines_of_the_data_may_be_some_of_the_lines_of_the_body():
    some = LINES[3::7]
    whole, few = measured_spindle(), measured_spindle().at_lines(some)
    assert (few.receptance == whole.receptance[3::7]).all()
    assert (few.covariance == whole.covariance[3::7]).all()
