"""No mesh error in a joint: predictions against the exact dynamic stiffness, and what a coarse mesh is told to do."""

import numpy as np
import pytest
from benchmarks.exact_beam import ExactBeam, circle

import jointbayes as jb
from jointbayes.frf import NaturalFrequencies, receptance_model
from jointbayes.posterior.model_errors import LARGEST_ERROR_SD, LARGEST_SHIFT_SD, check_mesh
from jointbayes.posterior.summary import summarise
from tests.conftest import CLAMP, CONFIGS, STEEL, TABLE_3, pair_matrix
from tests.oracles import off_peak

pytestmark = pytest.mark.science

POINTS = {1: 0.0, 6: 0.1915, 11: 0.383}
LINES = np.arange(20.0, 2500.0, 7.0)
TEXT = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8").replace("f_step_hz = 1.0", "f_step_hz = 4.0")
COARSE = TEXT.replace("elements = 10", 'elements = 10\nelement = "paper"', 1)


def family(law):
    return jb.BeamFamily(jb.BeamRecipe(0.383, jb.Section.circle(0.025), STEEL, law), {})


def exact_beam(stiffness):
    return ExactBeam(0.383, circle(0.025, 0.3), 2.1e11, 0.3, 7800.0, POINTS, tuple(stiffness))


@pytest.mark.parametrize("stiffness", [TABLE_3, (1e7, 1e4, 1e4), (1e11, 1e6, 1e8), (3e8, -3e6, 1e5)])
def test_predicted_frfs_are_those_of_the_beam_without_a_mesh(stiffness):
    outputs, inputs, truth = ("11:y", "6:y", "11:rz"), ("11:y",), exact_beam(stiffness)
    for law, exact in (
        (jb.LossFactor(0.02), truth.receptance(LINES, outputs, inputs, loss_factor=0.02)),
        (jb.ModalDamping((0.01,)), truth.modal_receptance(LINES, outputs, inputs, (0.01,))),
    ):
        model = receptance_model(family(law), CLAMP, jb.Ports(LINES, outputs, inputs))
        assert off_peak(model.receptance(pair_matrix(stiffness))[0], exact) < 1e-7


def test_natural_frequencies_are_those_of_the_beam_without_a_mesh():
    model = NaturalFrequencies(family(jb.ModalDamping((0.01,))), CLAMP, 6)
    found = model.frequency_hz(pair_matrix(TABLE_3))[0]
    np.testing.assert_allclose(found, exact_beam(TABLE_3).modes(1.1 * found[-1]).omega[:6] / (2 * np.pi), rtol=1e-9)


def test_synthetic_data_are_those_of_the_beam_without_a_mesh():
    measured = jb.case_from_text("exact", TEXT.replace("added = true", "added = false")).problem.test.data
    exact = exact_beam(TABLE_3).modal_receptance(measured.frf.frequency_hz, ("11:y",), ("11:y",), (0.01,))
    assert np.abs(measured.frf.values - exact).max() < 1e-8 * np.abs(exact).max()


def gaussian_check(case):
    """The check of a case's mesh with draws from the Laplace approximation, which is quick."""
    estimate = jb.find_map(case)
    prior = case.problem.prior
    draws = np.random.default_rng(1).multivariate_normal(estimate.theta, estimate.covariance, 4000)
    draws = draws[prior.feasible(draws)]
    return estimate, check_mesh(case.problem, estimate.theta, estimate.covariance, prior.values(draws), 1)


@pytest.mark.parametrize("name", ["clamped_beam", "clamped_beam_loss_factor", "clamped_beam_frequencies"])
def test_a_shipped_case_has_no_mesh_that_shows(name):
    _, found = gaussian_check(jb.load_case(CONFIGS / f"{name}.toml"))
    assert found.kind == "converged"
    assert found.within
    assert found.error_sd < LARGEST_ERROR_SD / 5
    assert max(map(abs, found.shift_sd.values())) < 0.01


def test_the_shift_by_the_papers_mesh_is_stated():
    fine, none = gaussian_check(jb.case_from_text("fine", TEXT))
    coarse, found = gaussian_check(jb.case_from_text("coarse", COARSE))
    assert none.within
    assert found.kind == "paper"
    assert not found.within
    assert "shows" in found.sentence
    moved = np.log(coarse.values / fine.values)
    sd = np.sqrt(np.diag(coarse.covariance))
    for name, shift in zip(("k11", "k12", "k22"), moved / sd, strict=True):
        assert found.moves(name)
        assert found.shift_sd[name] == pytest.approx(shift, rel=0.1)
        assert abs(found.shift_sd[name]) > LARGEST_SHIFT_SD


def test_a_mesh_that_moves_a_stiffness_leaves_no_verdict():
    case = jb.case_from_text("coarse", COARSE)
    posterior = jb.sample(case, settings=jb.SamplerSettings(walkers=16, max_steps=200))
    summary = summarise(posterior, (1e8, 0.0, 0.0)).to_dict()
    assert not summary["mesh"]["within_bound"]
    for name, p in summary["parameters"].items():
        assert p["verdict"] == "no verdict", name
        assert "mesh" in {reason["code"] for reason in p["reasons"]}
