"""A body is asked for motions, never for matrices: one of 100 000 DOFs goes through everything."""

import json
import re
import tracemalloc
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import Ports, receptance_model
from jointbayes.structure import Body, LossFactor
from tests.oracles import noisy_frfs
from tests.structure.long_rod import LongRod
from vibrecords import FrfSet

SRC = Path(jb.__file__).parent
STIFFNESS, MODULUS = 3e7, 1.012  # N/m at the end that is held, and Young's modulus over the stated one
SPRING = jb.parametrisation_named("springs", ("x",))
JOINT = jb.Joint(("1:x",))
LINES = np.linspace(100.0, 5000.0, 150)
TIP, MIDDLE = "100000:x", "50000:x"


def receptance(first, second, modulus):
    """Exact receptance of the rod on its spring between two places, from 0 to 1 along it."""
    rod = LongRod()
    omega, complex_modulus = 2 * np.pi * LINES, modulus * rod.youngs_modulus * (1 + 1j * rod.damping.hysteretic)
    wave = omega * np.sqrt(rod.density / complex_modulus) * rod.length

    def free(a, b):
        near, far = min(a, b), max(a, b)
        size = complex_modulus * rod.area / rod.length * wave * np.sin(wave)
        return -np.cos(wave * near) * np.cos(wave * (1 - far)) / size

    return free(first, second) - free(first, 0) * STIFFNESS / (1 + STIFFNESS * free(0, 0)) * free(0, second)


def exact_frf(modulus=1.0):
    places = {"1:x": 0.0, MIDDLE: 49_999 / 99_999, TIP: 1.0}
    values = np.stack([receptance(place, 1.0, modulus) for place in places.values()], axis=1)[:, :, None]
    return FrfSet(LINES, values, tuple(places), (TIP,))


def problem(rod, *uncertain, modulus=1.0):
    ports = Ports(LINES, (MIDDLE, TIP), (TIP,))
    data = noisy_frfs(exact_frf(modulus).values[:, 1:], ports, seed=3, relative=0.05 / np.sqrt(2), floor=0.0)
    data = replace(data, synthetic=True, joint_frf=exact_frf())
    prior = jb.JointPrior(SPRING, (jb.OfStiffness(jb.Uniform(1e5, 1e10)),), uncertain)
    return jb.Problem(structure=rod, joint=JOINT, data=data, prior=prior, initial=[1e7], name="long rod")


def test_a_body_of_formulas_has_the_frfs_of_its_closed_form():
    model = receptance_model(LongRod(), JOINT, Ports(LINES, ("1:x", MIDDLE, TIP), (TIP,)))
    predicted = model.receptance(SPRING.matrix([STIFFNESS]), [MODULUS])[0]
    exact = exact_frf(MODULUS).values
    assert np.abs(predicted - exact).max() < 1e-4 * np.abs(exact).max()


@pytest.mark.science
def test_the_joint_of_a_body_of_100_000_dofs_is_found_within_its_stated_uncertainty(tmp_path):
    asked = problem(LongRod(names=()))
    history = jb.identify(asked)
    assert history.stiffness[0] == pytest.approx(STIFFNESS, rel=1e-4), history.reason

    estimate = jb.find_map(asked)
    assert abs(np.log(estimate.values[0] / STIFFNESS)) < 3 * np.sqrt(estimate.covariance[0, 0])

    posterior = jb.sample(asked, seed=1, settings=jb.SamplerSettings(max_steps=400))
    low, high = posterior.interval("kx", 0.95)
    assert low < STIFFNESS < high < 1.05 * low

    jb.write_report(posterior, tmp_path / "rod")
    summary = json.loads((tmp_path / "rod" / "summary.json").read_text())
    assert summary["parameters"]["kx"]["verdict"] == "identified"


@pytest.mark.science
def test_what_is_uncertain_of_such_a_body_is_found_with_its_joint():
    modulus = jb.Nuisance("youngs_modulus", "GPa", 210.0, jb.Normal(0.0, 0.02))
    estimate = jb.find_map(problem(LongRod(), modulus, modulus=MODULUS))
    error = estimate.theta - np.log([STIFFNESS, MODULUS])
    assert (np.abs(error) < 3 * np.sqrt(np.diag(estimate.covariance))).all()


def test_no_array_over_all_dofs_squared_is_built():
    tracemalloc.start()
    jb.find_map(problem(LongRod(names=())))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 100e6  # bytes; such an array has 8e10


def test_default_priors_are_relative_to_what_a_rod_weighs_and_how_it_stretches():
    rod = LongRod()
    assert rod.own_inertia("1:x") == pytest.approx(rod.density * rod.area * rod.length)
    # of a free bar that a force at one end accelerates
    assert rod.own_stiffness("1:x", "1:x") == pytest.approx(3 * rod.youngs_modulus * rod.area / rod.length, rel=1e-4)


def lines_outside_the_room(pattern):
    """What matches in the modules that are not of structure/."""
    texts = [path.read_text(encoding="utf-8") for path in SRC.rglob("*.py") if path.parent != SRC / "structure"]
    return [match for text in texts for match in re.findall(pattern, text)]


def test_nobody_outside_the_room_asks_a_body_for_its_matrices():
    of_a_quantity = {"self", "nuisance", "n", "first", "other"}  # names of a `Nuisance`, which has a nominal value
    assert set(lines_outside_the_room(r"([\w)\]]+)\.nominal\b")) <= of_a_quantity
    assert lines_outside_the_room(r"np\.eye\([^)]*dofs[^)]*\)") == []
    assert {"nominal", "structure", "stiffness", "mass", "modes"}.isdisjoint(dir(Body))
    # the reference solver, and the synthetic FRFs that it makes
    assert len(lines_outside_the_room(r"(?:isinstance|require)\([^()]*\bStructure\b")) == 2


class OneMotion(Body):
    def reach_hz(self, count):
        return 1.0

    def rigid_motions(self, dofs):
        return np.ones((len(dofs), 1))

    def free_modes(self, dofs, motions, forced=None):
        raise NotImplementedError


def test_a_body_may_be_a_dataclass_whose_fields_are_what_is_asked_of_it():
    @dataclass(frozen=True)
    class Point(OneMotion):
        labels: tuple[str, ...]
        place: np.ndarray  # without a default after what a property of `Body` would be the default of
        names: tuple[str, ...]
        damping: LossFactor

    point = Point(("1:x",), np.zeros(3), ("density",), LossFactor(0.0))
    assert (point.labels, point.names, point.n_dofs) == (("1:x",), ("density",), 1)
    with pytest.raises(TypeError, match="missing 4 required"):
        Point()


def test_a_body_without_labels_says_what_it_lacks():
    class Nothing(OneMotion):
        damping = LossFactor(0.0)

    with pytest.raises(NotImplementedError, match="Nothing has no labels"):
        Nothing().n_dofs  # noqa: B018
