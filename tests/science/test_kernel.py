"""The compiled kernels: exact against the direct solve, honest about singular joints, bounded in memory, fast."""

import os
import subprocess
import sys
import time
import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointbayes.frf import AssembledModes, DirectSolve, LowRankCoupling, Ports, synthesise_frf
from jointbayes.frf.kernels.secular import springs
from jointbayes.frf.modal import JoinedModes
from jointbayes.frf.ports import TakingPart
from jointbayes.inference import FrfLikelihood, JointPrior, LogPosterior, Normal
from jointbayes.joint import Joint, Joints, LogStiffness
from jointbayes.structure import LossFactor, ModalDamping, Rayleigh, Structure
from tests.conftest import CLAMP, CONFIGS, TABLE_3, first_in_ci, lone_likelihood, pair_matrix, rod
from tests.oracles import off_peak
from vibrecords import FrfData, FrfSet, RelativeNoise

LAWS = {"loss factor": LossFactor(0.02), "Rayleigh": Rayleigh(2.0, 1e-7), "modal": ModalDamping((0.01,))}


def with_law(law):
    return replace(rod(), damping=LAWS[law])


def model_of(structure, joint, ports):
    modal = isinstance(structure.damping, ModalDamping)
    return (AssembledModes if modal else LowRankCoupling)(structure, joint, ports)


def both_of(law, joint, ports):
    """The model of a damping law with a kernel, and the direct solve."""
    return model_of(with_law(law), joint, ports), DirectSolve(with_law(law), joint, ports)


def random_joints(count, seed):
    """K^J over twelve decades in each stiffness, any coupling; absent, half absent and rigid ones among them."""
    rng = np.random.default_rng(seed)
    k11, k22 = 10 ** rng.uniform(2, 14, count), 10 ** rng.uniform(-2, 10, count)
    k12 = rng.uniform(-1, 1, count) * np.sqrt(k11 * k22)
    k = np.stack([k11, k12, k22], axis=-1)
    k[:5] = [[0, 0, 0], [1e8, 0, 0], [0, 0, 1e4], [1e14, 0, 1e10], [1e8, 1e6, 1e4]]
    return pair_matrix(k)


@pytest.mark.science
@pytest.mark.parametrize("law", first_in_ci(["loss factor", "modal"], 1))
def test_ten_thousand_joints_over_twelve_decades_agree_with_the_direct_solve(law):
    model, direct = both_of(law, CLAMP, Ports(np.geomspace(20.0, 2500.0, 6), ("11:y",), ("11:y",)))
    for batch in np.array_split(random_joints(10_000, seed=5), 20):
        assert off_peak(model.receptance(batch), direct.receptance(batch), axis=1) < 1e-9


END, TIP = ("1:y", "1:rz", "5:y"), ("11:y",)


def joints_at(dofs):
    """A joint to ground at each of these DOFs, whose K^J may be coupled throughout."""
    return Joints(tuple(Joint((label,), name=f"at {label}") for label in dofs))


@pytest.mark.parametrize("dofs", [END[:1], END[:2], END, tuple(f"{n}:y" for n in range(1, 7))])
@pytest.mark.parametrize("law", LAWS)
def test_joints_of_any_number_of_dofs(law, dofs):
    r, ports = len(dofs), Ports(np.geomspace(20.0, 2500.0, 40), ("11:y", "1:y"), ("11:y",))
    model, direct = both_of(law, joints_at(dofs), ports)
    rng = np.random.default_rng(r)
    factors = rng.normal(size=(12, r, r)) * 10 ** rng.uniform(1, 5, size=(12, r, 1))
    matrices = factors @ factors.swapaxes(1, 2)
    matrices[0] = 0.0
    matrices[1] = 1e7  # one spring across all DOFs
    assert off_peak(model.receptance(matrices), direct.receptance(matrices), axis=1) < 1e-9


def joints_of_many_dofs(r, seed):
    """K^J coupled throughout, from well conditioned to singular; absent, half absent and rigid ones among them."""
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(1, 5, size=(30, r, 1))
    factors = scale * (np.eye(r) + 10 ** rng.uniform(-2, 2, size=(30, 1, 1)) * rng.normal(size=(30, r, r)))
    factors[:4, :, -1:] *= np.array([0.0, 1e-7, 1e-4, 1e-3])[:, None, None]
    matrices = factors @ factors.swapaxes(1, 2)
    matrices[-4] = 0.0
    matrices[-3] = 1e7  # one spring across all DOFs
    matrices[-2] = np.diag(np.resize([1e14, 0.0, 1e-300, 1e6], r))
    matrices[-1] *= 1e14 / matrices[-1].max()
    return matrices


@pytest.mark.parametrize("r", [2, 3, 6])
@pytest.mark.parametrize("law", LAWS)
def test_the_misfit_kernel_computes_the_distance_of_the_direct_solve(law, r):
    joint = CLAMP if r == 2 else joints_at([f"{n}:y" for n in range(1, r + 1)])
    ports = Ports(np.geomspace(20.0, 2500.0, 70), ("11:y", "9:rz", *["1:y"] * (r == 2)), ("11:y", "8:y"))
    model, direct = both_of(law, joint, ports)
    for matrix in random_joints(40, seed=6) if r == 2 else joints_of_many_dofs(r, seed=r):
        expected = direct.receptance(matrix)[0]
        per_peak = np.broadcast_to(1 / np.abs(expected).max(axis=0), expected.shape)
        # the distance is the sum over all values of the squared errors, each relative to its FRF's peak
        assert np.sqrt(model.misfit(expected, per_peak).chi2(matrix[None])[0]) < 1e-8
        moved = expected * 1.01
        distance = (np.abs(expected - moved) ** 2 * per_peak**2).sum()
        np.testing.assert_allclose(model.misfit(moved, per_peak).chi2(matrix[None]), distance, rtol=1e-6)
    if r == 2:
        return
    size = np.array([[1e30, 1e6, 1e4], [1e200, 1e6, 1e4], [1e200, 1e6, 1e-200], [1e200, 1e6, 0.0]])
    stiff, rigid, loose, absent = model.misfit(moved, per_peak).chi2(np.eye(r) * size[:, np.arange(r) % 3][:, None, :])
    np.testing.assert_allclose([rigid, loose], [stiff, absent], rtol=1e-9)


@pytest.mark.parametrize("dofs", [END[:2], END])
@pytest.mark.parametrize("law", LAWS)
def test_the_gradient_is_the_slope_of_the_likelihood(law, dofs):
    ports, r = Ports(np.geomspace(20.0, 2500.0, 100), ("11:y", "1:rz"), ("11:y",)), len(dofs)
    model, rng = model_of(with_law(law), joints_at(dofs), ports), np.random.default_rng(3)
    size = np.array([1e8, 1e5, 1e7])[:r]
    matrices = np.stack([np.diag(size) + 0.2 * s * np.sqrt(np.outer(size, size)) for s in (-1, 1)])
    measured = model.receptance(matrices[0] * 1.3)[0]
    misfit = model.misfit(measured, 1 / np.abs(measured))
    value, slope = misfit.chi2_gradient(matrices)
    np.testing.assert_allclose(value, misfit.chi2(matrices), rtol=1e-12)
    np.testing.assert_allclose(slope, slope.swapaxes(1, 2), rtol=1e-12)
    change = rng.normal(size=(r, r))
    change = (change + change.T) * np.sqrt(np.outer(size, size)) * 1e-7
    difference = (misfit.chi2(matrices + change) - misfit.chi2(matrices - change)) / 2
    np.testing.assert_allclose((slope * change).sum(axis=(1, 2)), difference, rtol=1e-4)


def test_the_gradient_of_the_posterior_is_that_of_its_residuals():
    structure = with_law("loss factor")
    ports = Ports(np.arange(20.0, 2500.0, 10.0), ("11:y",), ("11:y",))
    rng, noise = np.random.default_rng(1), RelativeNoise(0.03, 0.01)
    measurement = synthesise_frf(structure, CLAMP, pair_matrix(TABLE_3), ports, noise, rng=rng)
    prior = JointPrior(LogStiffness(), tuple(Normal(np.log(k), 2.0) for k in TABLE_3))
    posterior = LogPosterior(prior, lone_likelihood(structure, CLAMP, measurement))
    theta = np.log(TABLE_3 * [1.3, 0.9, 1.02])
    residual, jacobian = posterior.residuals(theta)
    np.testing.assert_allclose(posterior.gradient(theta), -jacobian.T @ residual, rtol=1e-8)
    both = posterior.gradient(np.stack([theta, theta]))
    np.testing.assert_array_equal(both[0], both[1])


def two_masses(law):
    """Two free unit masses without any spring between: their receptance is −1/ω² each."""
    return Structure(np.zeros((2, 2)), np.eye(2), law, ("1:y", "2:y"))


def test_a_joint_that_resonates_undamped_on_a_line_is_impossible_and_counted():
    omega = 8.0  # a power of two: 1 − k/ω² is exactly zero at k = ω²
    frequency = np.array([omega / (2 * np.pi)])
    ports = Ports(frequency, ("1:y",), ("1:y",))
    assert ports.omega[0] == omega
    model = LowRankCoupling(two_masses(LossFactor(0.0)), joints_at(("1:y", "2:y")), ports)
    values = model.receptance(np.diag([100.0, 100.0]))[0]
    data = FrfData(FrfSet(ports.frequency_hz, values, ports.outputs, ports.inputs), np.abs(values) ** 2)
    likelihood, k = FrfLikelihood(model, data), omega**2
    values = likelihood.log_likelihood(np.stack([np.diag([k, 3 * k]), np.diag([2 * k, 3 * k])]))
    assert np.isneginf(values[0])
    assert np.isfinite(values[1])

    prior = JointPrior(LogStiffness(), tuple(Normal(0.0, 10.0) for _ in range(3)))
    posterior = LogPosterior(prior, likelihood)
    posterior.likelihood = SimpleNamespace(log_likelihood=lambda *_: values)
    assert np.isneginf(posterior(np.log([[k, 1.0, 3 * k], [2 * k, 1.0, 3 * k]]))[0])
    assert posterior.singular == 1


def joined_modes(structure, joint, motions):
    """Assembled modes with motions that keep their part along the joint."""
    everywhere = np.arange(structure.n_dofs)
    joined = joint.selection(structure)
    return JoinedModes(structure, TakingPart(everywhere, joined, np.zeros((joint.size, motions.shape[1])), motions))


class TestSecularEquation:
    """Assembled modes without an eigensolution, against one."""

    @pytest.mark.parametrize("seed", range(4))
    def test_eigenvalues_and_orthonormal_modes(self, seed):
        structure = rod()
        free = structure.modes()
        solver = joined_modes(structure, CLAMP, structure.mass @ free.shapes)  # the modes in the free modes
        at_joint = free.shapes.T @ CLAMP.selection(structure)
        for matrix in random_joints(50, seed):
            (lam,), (rows,), _ = solver.solve(matrix[None])
            dense = np.diag(free.eigenvalues) + at_joint @ matrix @ at_joint.T
            vectors, top = rows[2:], np.abs(dense).max()
            np.testing.assert_allclose(lam, np.linalg.eigvalsh(dense), atol=1e-13 * top)
            assert (np.diff(lam) > 0).all()
            np.testing.assert_allclose(vectors.T @ vectors, np.eye(len(lam)), atol=1e-10)
            np.testing.assert_allclose(dense @ vectors, vectors * lam, atol=1e-10 * top)

    def test_equal_eigenvalues_and_modes_that_the_spring_does_not_see(self):
        labels = tuple(f"{n}:y" for n in range(1, 5))
        structure = Structure(np.diag([0.0, 0.0, 4.0, 4.0]), np.eye(4), ModalDamping((0.01,)), labels)
        solver = joined_modes(structure, Joint(("1:y",)), np.eye(4))
        (lam,), (rows,), _ = solver.solve(np.array([[[9.0]]]))
        np.testing.assert_allclose(lam, [0.0, 4.0, 4.0, 9.0], atol=1e-9)
        np.testing.assert_allclose(rows[1:] @ rows[1:].T, np.eye(4), atol=1e-9)
        np.testing.assert_allclose(np.abs(rows[1]), [0, 0, 0, 1], atol=1e-9)

    def test_a_joint_that_releases_energy_is_still_an_eigenproblem(self):
        structure = rod()
        matrix = pair_matrix([1e6, 1e6, 1e4])
        (lam,), _, _ = JoinedModes(structure, TakingPart.of(structure, CLAMP)).solve(matrix[None])
        free = structure.modes()
        at = free.shapes.T @ CLAMP.selection(structure)
        dense = np.diag(free.eigenvalues) + at @ matrix @ at.T
        np.testing.assert_allclose(lam, np.linalg.eigvalsh(dense), rtol=1e-9, atol=1e-3)

    def test_springs_put_the_joint_together_again(self):
        matrices = np.concatenate([random_joints(200, seed=1), pair_matrix([[0.0, 3.0, 0.0], [1.0, 5.0, 2.0]])])
        turn, stiffness = springs(matrices)
        again = (turn * stiffness[:, None, :]) @ turn.swapaxes(1, 2)
        scale = np.sqrt(np.abs(matrices[:, [0, 1], [0, 1]]))
        tolerance = 1e-12 * scale[:, :, None] * scale[:, None, :]
        tolerance += 1e-14 * np.abs(matrices).max(axis=(1, 2))[:, None, None]
        assert (np.abs(again - matrices) <= tolerance).all()
        assert (stiffness[:-2] >= 0).all()


@pytest.mark.science
@pytest.mark.parametrize("law", first_in_ci(["modal", "loss factor"], 1))
def test_memory_does_not_grow_with_walkers_times_lines(law):
    lines, joints = 50_000, 64
    model = model_of(with_law(law), CLAMP, Ports(np.linspace(20.0, 2500.0, lines), TIP, TIP))
    matrices = pair_matrix(np.array(TABLE_3) * np.ones((joints, 1)))
    measured = model.receptance(matrices[0])[0]
    misfit = model.misfit(measured, 1 / np.abs(measured))
    misfit.chi2(matrices[:1])
    tracemalloc.start()
    misfit.chi2(matrices)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 8 * lines  # one number per line would be that much; walkers × lines is 64 times more


@pytest.mark.science
def test_the_kernel_beats_the_closed_form_in_numpy_by_far():
    """The guard against a regression: a ratio within one process, no absolute time."""
    model = model_of(with_law("loss factor"), CLAMP, Ports(np.arange(2.0, 2502.0, 2.0), TIP, TIP))
    matrices = pair_matrix(np.array(TABLE_3) * np.exp(0.1 * np.random.default_rng(0).normal(size=(64, 1))))
    measured = model.receptance(matrices[0])[0]
    weight = 1 / np.abs(measured)
    misfit = model.misfit(measured, weight)

    def closed_form():
        return (np.abs((model.receptance(matrices) - measured) * weight) ** 2).sum(axis=(1, 2, 3))

    np.testing.assert_allclose(misfit.chi2(matrices), closed_form(), rtol=1e-9, atol=1e-9)
    fastest = {}
    for _ in range(15):  # in turns, so that a busy machine slows both
        for name, run in (("kernel", lambda: misfit.chi2(matrices)), ("numpy", closed_form)):
            began = time.perf_counter()
            run()
            fastest[name] = min(fastest.get(name, np.inf), time.perf_counter() - began)
    assert fastest["numpy"] > 5 * fastest["kernel"]


def misfit_of_many_dofs():
    joint, ports = (
        joints_at([f"{n}:y" for n in range(1, 7)]),
        Ports(np.arange(20.0, 2500.0, 10.0), ("11:y",), ("11:y",)),
    )
    model, matrices = model_of(with_law("loss factor"), joint, ports), joints_of_many_dofs(6, seed=1)
    measured = model.receptance(matrices[10])[0]
    return model.misfit(measured, 1 / np.abs(measured)), matrices


CASES = ["clamped_beam", "clamped_beam_loss_factor", "clamped_beam_frequencies"]
OF_CASES = """
import hashlib, sys, numpy as np, jointbayes as jb
for path in sys.argv[1:]:
    posterior = jb.load_case(path).problem.log_posterior
    values = posterior(posterior.prior.sample(np.random.default_rng(0), 100))
    print(hashlib.sha256(values.tobytes()).hexdigest())
"""
OF_MANY_DOFS = """
from tests.science.test_kernel import misfit_of_many_dofs
misfit, matrices = misfit_of_many_dofs()
values = misfit.chi2(matrices), *misfit.chi2_gradient(matrices)
print(hashlib.sha256(b"".join(x.tobytes() for x in values)).hexdigest())
"""


@pytest.mark.science
@pytest.mark.parametrize(
    ("script", "cases"), first_in_ci([(OF_CASES, CASES[1:2]), (OF_CASES + OF_MANY_DOFS, CASES)], 1), ids=["one", "all"]
)
def test_the_process_that_compiles_has_the_same_last_bits_as_those_that_load_what_was_kept(tmp_path, script, cases):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", script, *(str(CONFIGS / f"{name}.toml") for name in cases)]
    options = {"env": environment, "capture_output": True, "text": True, "check": True}
    compiled, loaded = (subprocess.run(command, **options).stdout for _ in range(2))
    assert any(tmp_path.rglob("*.nbc")), "nothing was kept"
    assert compiled == loaded
    assert len(compiled.splitlines()) == len(cases) + (OF_MANY_DOFS in script)
