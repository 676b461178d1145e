"""What a run solves and builds: a table of modes once, not a solution for each draw, nor a model for each call."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import modal
from jointbayes.identification.numbering import find_numbering
from jointbayes.inference import ErrorSizes
from jointbayes.posterior.decision import modes_problem
from jointbayes.structure import Structure
from tests.conftest import edited

ROD = """length_mm = 383.0, elements = 10, youngs_modulus_gpa = 70.0, density_kg_m3 = 2700.0, \
section = { shape = "rectangle", width_mm = 30.0, height_mm = 25.0 }, \
damping = { law = "modal", ratio = [0.01, 0.01, 0.01, 0.01] }"""
JOINT = 'joint = { kind = "springs", dofs = ["1:y", "1:rz"] }'
SOFT = np.array([1e7, 1e4])
FRF = f"""
structure = {{ {ROD}, accelerometer_mass_g = 5.0 }}
{JOINT}
data = {{ kind = "synthetic_frf", inputs = ["11:y"], outputs = ["11:y"], f_min_hz = 10.0, f_max_hz = 6000.0, \
f_step_hz = 2.0, noise = {{ relative = 0.02, floor = 0.001, seed = 1 }}, \
truth.stiffness = {{ ky = {SOFT[0]}, krz = {SOFT[1]} }} }}
uncertain.damping_ratio = {{ low_factor = 0.1, high_factor = 10.0 }}
"""
FREQUENCIES = f"""
structure = {{ {ROD} }}
{JOINT}
data = {{ kind = "natural_frequencies", frequencies_hz = [120.0, 800.0, 1900.0, 4000.0], sd_relative = 0.003 }}
"""


@pytest.fixture
def counted(monkeypatch):
    """Numbers of eigen-solutions of whole structures and of models built, as they grow."""
    calls = {"solved": 0, "built": 0}
    solve, build = Structure.modes, modal.LowestModes.__init__

    def modes(self):
        calls["solved"] += 1
        return solve(self)

    def init(self, *args, **kwargs):
        calls["built"] += 1
        build(self, *args, **kwargs)

    monkeypatch.setattr(Structure, "modes", modes)
    monkeypatch.setattr(modal.LowestModes, "__init__", init)
    return calls


@pytest.fixture(scope="module")
def asked():
    """The modes that FRFs of a soft joint show, all that a workshop does not know uncertain."""
    case = jb.case_from_text("soft", FRF)
    problem = case.problem.with_test(data=replace(case.problem.test.data, synthetic=False))
    truth = np.concatenate([problem.parametrisation.coordinates(SOFT), problem.prior.mean[2:]])
    return modes_problem(
        problem, SimpleNamespace(theta=truth, places=truth[None]), 1, ErrorSizes(), case.workshop_problem
    )


@pytest.mark.science
def test_modes_of_a_soft_joint_take_no_eigen_solution_for_each_draw(asked, counted):
    draws = asked.prior.sample(np.random.default_rng(1), 300)
    assert np.isfinite(asked.log_posterior(draws)).all()
    assert counted["solved"] < 60  # of the tables; two for each draw before


def test_damping_that_no_mode_sees_is_no_unknown(asked):
    assert asked.names == ("ky", "krz", "youngs_modulus", "density", "length", "accelerometer_mass")


def test_a_search_among_numberings_builds_each_model_once(counted):
    case = jb.case_from_text("four", FREQUENCIES)
    counted.update(solved=0, built=0)
    find_numbering(case.problem)
    assert 0 < counted["built"] <= 9  # one for each number of modes; one for each call before, hundreds


def test_a_search_for_the_mode_builds_few_models(counted):
    problem = jb.case_from_text("four", FREQUENCIES).problem
    counted.update(solved=0, built=0)
    jb.find_map(problem)
    assert counted["built"] <= 3
    assert counted["solved"] <= 20


def test_a_frame_is_meshed_for_a_reach_once(counted):
    points = """points = { a = [0, 0, 0], b = [383, 0, 0] }, members = [{ points = ["a", "b"] }]"""
    text = edited(
        FREQUENCIES,
        ("length_mm = 383.0", 'kind = "frame", directions = ["x", "y", "rz"]'),
        ("elements = 10", points),
        ('["1:y", "1:rz"]', '["a:y", "a:rz"]'),
        ("120.0, 800.0, 1900.0, 4000.0", "120.0, 800.0"),
    )
    family = jb.case_from_text("frame", text).problem.test.structures
    reach = family.reach_hz(5)
    counted.update(solved=0)
    assert replace(family, top_hz=100.0).reach_hz(5) == reach
    assert counted["solved"] == 0
