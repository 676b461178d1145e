"""The body of scikit-fem's matrices that docs/developing.md names, against solves of those matrices."""

import json
import pickle

import numpy as np
import pytest
from scipy import linalg
from scipy.sparse import diags_array
from scipy.sparse.linalg import splu

import jointbayes as jb
from jointbayes.frf import Ports, receptance_model
from tests.oracles import noisy_frfs

pytest.importorskip("skfem", reason="scikit-fem, whose matrices the example of docs/developing.md takes")
from tests.structure.solid import Solid

HELD = ("1:x", "1:y", "1:z")  # a corner
KIND = jb.parametrisation_named("springs", ("x", "y", "z"))
SPRINGS = np.array([3e7, 2e7, 4e7])
LINES = np.linspace(100.0, 4000.0, 120)


@pytest.fixture(scope="module")
def solid():
    return Solid()


def corner(solid, *place):
    return int(np.abs(solid.places - place).sum(axis=1).argmin()) + 1


def held_stiffness(solid, labels, stiffness):
    added = np.zeros(solid.n_dofs)
    added[solid.index(labels)] = stiffness
    return solid.stiffness * (1 + 0.01j) + diags_array(added)


def exact(solid, output, stiffness):
    """Receptance from a force at the last of the outputs, by solves of the sparse matrices, shape (lines, outputs)."""
    rows, matrix = solid.index(output), held_stiffness(solid, HELD, stiffness)
    force = np.zeros(solid.n_dofs, dtype=complex)
    force[rows[-1]] = 1.0
    return np.array([splu((matrix - w * w * solid.mass).tocsc()).solve(force)[rows] for w in 2 * np.pi * LINES])


def sensors(solid):
    return f"{corner(solid, 0.1, 0.03, 0.02)}:y", f"{corner(solid, 0.2, 0.03, 0.02)}:z"


def test_its_frfs_are_those_of_its_matrices(solid):
    outputs = sensors(solid)
    model = receptance_model(solid, jb.Joint(HELD), Ports(LINES, outputs, outputs[-1:]))
    for factor in (1e-3, 1.0, 1e3):
        predicted = model.receptance(KIND.matrix([factor * SPRINGS]))[0, :, :, 0]
        wanted = exact(solid, outputs, factor * SPRINGS)
        assert (np.abs(predicted - wanted).max(axis=0) < 1e-7 * np.abs(wanted).max(axis=0)).all()


@pytest.mark.parametrize("stiffness", [1.0, 1e15])
def test_it_reaches_above_its_natural_frequencies_however_six_dofs_are_held(solid, stiffness):
    end = corner(solid, 0.2, 0.0, 0.0)
    held = held_stiffness(solid, (*HELD, *(f"{end}:{way}" for way in "xyz")), stiffness).real.toarray()
    natural = np.sqrt(np.maximum(linalg.eigvalsh(held, solid.mass.toarray()), 0)) / (2 * np.pi)
    reach = np.array([solid.reach_hz(count) for count in range(1, 13)])
    assert (reach * (1 + 1e-6) > natural[:12]).all()


def test_its_modes_can_be_sent_to_workers(solid):
    modes = solid.at((), 4000.0).free_modes(solid.index(HELD), np.eye(3))
    sent = pickle.loads(pickle.dumps(modes))
    for here, there in zip(modes(np.empty((2, 0))), sent(np.empty((2, 0))), strict=True):
        assert np.array_equal(here, there)


@pytest.mark.science
def test_the_springs_at_its_corner_are_found_and_reported(solid, tmp_path):
    outputs = sensors(solid)
    values = exact(solid, outputs, SPRINGS)[:, :, None]
    data = noisy_frfs(values, Ports(LINES, outputs, outputs[-1:]), seed=5, relative=0.02 / np.sqrt(2), floor=0.0)
    prior = jb.JointPrior(KIND, tuple(jb.Normal.from_decades(1e7, 1.0) for _ in SPRINGS))
    asked = jb.Problem(structure=solid, joint=jb.Joint(HELD), data=data, prior=prior)
    posterior = jb.sample(asked, seed=1, settings=jb.SamplerSettings(max_steps=1500), premises="exact")
    jb.write_report(posterior, tmp_path / "solid")
    found = json.loads((tmp_path / "solid" / "summary.json").read_text())["parameters"]
    for name, truth in zip(("kx", "ky", "kz"), SPRINGS, strict=True):
        low, high = posterior.interval(name, 0.997)
        assert low < truth < high
        assert found[name]["verdict"] == "identified"
