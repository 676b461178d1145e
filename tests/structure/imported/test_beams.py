"""Beams beside an imported model, against dense solves of both assembled by hand."""

import numpy as np
import pytest
from benchmarks.bricks import brick_model, face
from scipy import linalg

import jointbayes as jb
from jointbayes.frf import NaturalFrequencies, receptance_model
from jointbayes.structure import PointMass, family_of_recipe
from jointbayes.structure.imported.beams import with_beams
from jointbayes.structure.imported.ports import port_forms
from tests.conftest import STEEL

TOP_HZ = 3000.0
WAYS = ("x", "y", "z", "rx", "ry", "rz")
SHANK = jb.Member(("shank", "step"), jb.Section.circle(0.016), STEEL)
TIP_OFFSET = ((0, 0, 0), (0, 0.001, 0))
TIP = jb.Member(("step", "tip"), jb.Section.circle(0.012), STEEL, jb.Section.circle(0.01), offsets=TIP_OFFSET)
PLACES = {"shank": (0.2, 0.01, 0.015), "step": (0.24, 0.01, 0.015), "tip": (0.29, 0.013, 0.015)}
TOOL = jb.FrameBody(PLACES, (SHANK, TIP), (PointMass("tip", 0.02, (1e-5, 1e-5, 1e-5)),))
JOINT = jb.Joint(tuple(f"tool.shank:{way}" for way in WAYS), tuple(f"seat:{way}" for way in WAYS))
SPRINGS = np.diag([3e8, 1e8, 2e8, 2e4, 4e4, 3e4])


@pytest.fixture(scope="module")
def parts():
    """Holder, its face as forms, and the tool by itself with a mesh of its own."""
    holder = brick_model((8, 2, 2))
    seat = port_forms(holder, jb.Port(face(holder, 0.2)), "seat")
    recipe = jb.FrameRecipe({"tool": TOOL}, jb.LossFactor(0.01))
    return holder, np.stack([seat[way] for way in WAYS], axis=1), recipe


def reduced(holder, top_hz=TOP_HZ, ends=None):
    whole, points = with_beams(holder, {"tool": TOOL}, top_hz)
    ports = {"seat": face(holder, 0.2), "back": face(holder, 0.0)}
    ports |= {name: points[name] for name in ("tool.shank", "tool.tip")}
    return jb.reduce_to_ports(whole, ports, top_hz, jb.LossFactor(0.01), ends=ends)


def dense(parts, stiffness=1.0, density=1.0):
    """K and M of both, joined, and the row of the tool's tip along y."""
    holder, seat, recipe = parts
    tool = recipe.structure({"youngs_modulus": stiffness, "density": density}, recipe.mesh(None, 2 * TOP_HZ))
    k = linalg.block_diag(holder.stiffness.toarray() * (1 + 0.01j), tool.stiffness * (1 + 0.01j))
    shank = tool.index([f"tool.shank:{way}" for way in WAYS])
    form = np.vstack([-seat, np.zeros((tool.n_dofs, 6))])
    form[holder.n_dofs + shank, np.arange(6)] = 1.0
    mass = linalg.block_diag(holder.mass.toarray(), tool.mass)
    return k + form @ SPRINGS @ form.T, mass, holder.n_dofs + tool.index(("tool.tip:y",))[0]


@pytest.mark.parametrize("factors", [(1.0, 1.0), (0.9, 1.1)])
def test_frfs_and_frequencies_of_both_joined_are_those_of_a_dense_solve(parts, factors):
    ends = {f"tool.{name}": (0.85, 1.15) for name in ("youngs_modulus", "density")}
    ranges = {name: (np.log(low), np.log(high)) for name, (low, high) in ends.items()}
    body = family_of_recipe(reduced(parts[0], ends=ends), ranges)
    lines = np.linspace(20.0, TOP_HZ, 200)
    k, m, row = dense(parts, *factors)
    force = np.eye(1, len(k), row)[0]
    exact = np.array([linalg.solve(k - w * w * m, force)[row] for w in 2 * np.pi * lines])
    model = receptance_model(body.at(JOINT.labels, TOP_HZ), JOINT, jb.Ports(lines, ("tool.tip:y",), ("tool.tip:y",)))
    found = model.receptance(SPRINGS, factors)[0, :, 0, 0]
    assert np.abs(found - exact).max() < 1e-8 * np.abs(exact).max()
    natural = np.sqrt(np.abs(linalg.eigh(k.real, m, eigvals_only=True))) / (2 * np.pi)
    count = int((natural[6:] < TOP_HZ).sum())
    frequency = NaturalFrequencies(body.at(JOINT.labels, TOP_HZ), JOINT, count).frequency_hz(SPRINGS, factors)[0]
    np.testing.assert_allclose(frequency, natural[6 : 6 + count], rtol=1e-8)


def test_each_body_floats_by_itself_and_its_reach_counts_that(parts):
    structure = reduced(parts[0]).structure()
    assert (structure.modes().eigenvalues[:12] == 0).all()
    assert structure.modes().frequency_hz[12] > 1000
    moved = structure.rigid_motions(structure.index(("tool.tip:y", "back:y")))
    assert np.linalg.matrix_rank(moved) == 2


def test_a_model_of_two_bodies_needs_no_beams_for_that(parts):
    holder = parts[0]
    far = holder.nodes.max()
    both = jb.FeModel(
        *(linalg.block_diag(*[matrix.toarray()] * 2) for matrix in (holder.stiffness, holder.mass)),
        np.vstack([holder.dofs, np.add(holder.dofs, [far, 0])]),
        np.concatenate([holder.nodes, holder.nodes + far]),
        np.concatenate([holder.places, np.add(holder.places, [0.5, 0, 0])]),
    )
    assert jb.reduce_to_ports(both, {"a": 1, "b": int(far) + 1}, TOP_HZ, jb.LossFactor(0.01)).reduced.rigid == 12
