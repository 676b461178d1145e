"""Frames that say the same by hand: factors, tapers with points on them, heights of members that state none."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jointbayes as jb
from tests.conftest import STEEL

LAW = jb.ModalDamping((0.01,))
WIDE, NARROW = (0.04, 0.03), (0.025, 0.012)
PLACES = {"a": (0.0, 0.0, 0.0), "b": (0.3, 0.1, 0.2)}


def slanted(e=2.1e11, rho=7800.0, length=1.0, size=1.0, kappa=1.0, between=(), element="converged"):
    """A tapered bar in space, every quantity stated; with further points on it."""
    sections = [jb.Section.rectangle(*(size * side for side in sides)) for sides in (WIDE, NARROW)]
    places = PLACES | {f"p{i}": tuple(share * np.array(PLACES["b"])) for i, share in enumerate(between)}
    names = ("a", *(f"p{i}" for i in range(len(between))), "b")
    points = {name: tuple(length * np.array(places[name])) for name in names}
    shear = (0.85 * kappa, 0.7 * kappa)
    bar = jb.Member(names, sections[0], jb.BeamMaterial(e, 0.3, rho), end_section=sections[1], shear_coefficient=shear)
    return jb.FrameRecipe(jb.FrameBody(points, (bar,)), LAW, element=element)


def frequencies(recipe, factors=None, count=12):
    structure = recipe.structure(factors or {}, recipe.mesh(None, 12000.0) if recipe.element != "paper" else None)
    return structure.modes().frequency_hz[6 : 6 + count]


@pytest.mark.parametrize(
    ("quantity", "stated"),
    [
        ("youngs_modulus", {"e": 1.2 * 2.1e11}),
        ("density", {"rho": 1.2 * 7800.0}),
        ("length", {"length": 1.2}),
        ("section_size", {"size": 1.2}),
        ("shear_coefficient", {"kappa": 1.2}),
    ],
)
def test_a_factor_makes_the_frame_that_states_its_quantity_so_much_larger(quantity, stated):
    found, expected = frequencies(slanted(), {quantity: 1.2}), frequencies(slanted(**stated))
    assert_allclose(found, expected, rtol=2e-8)
    assert np.abs(found / frequencies(slanted()) - 1).max() > 1e-3


def test_points_on_a_taper_do_not_change_it():
    assert_allclose(frequencies(slanted(between=(0.2, 0.55))), frequencies(slanted()), rtol=2e-8)


def test_the_papers_element_of_a_taper_has_the_section_at_its_middle():
    middle = jb.Section.rectangle(*((w + n) / 2 for w, n in zip(WIDE, NARROW, strict=True)))
    bar = jb.Member(("a", "b"), middle, STEEL, shear_coefficient=(0.85, 0.7))
    uniform = jb.FrameRecipe(jb.FrameBody(PLACES, (bar,)), LAW, element="paper").structure()
    tapered = slanted(element="paper").structure()
    assert_allclose(tapered.stiffness, uniform.stiffness, rtol=1e-12, atol=1e-12 * np.abs(uniform.stiffness).max())
    assert_allclose(tapered.mass, uniform.mass, rtol=1e-12, atol=1e-12 * np.abs(uniform.mass).max())


@pytest.mark.parametrize(
    ("end", "moves", "turns", "height"),
    [
        ((0.4, 0, 0), "y", "rz", "height"),
        ((0, 0.4, 0), "x", "rz", "height"),
        ((0, 0.4, 0), "z", "rx", "width"),
        ((0, 0, 0.4), "y", "rx", "height"),
        ((0, 0, 0.4), "x", "ry", "width"),
    ],
)
def test_the_height_of_a_member_without_up_lies_across_z_or_along_y(end, moves, turns, height):
    bar = jb.Member(("a", "b"), jb.Section.rectangle(0.04, 0.01), STEEL)
    frame = jb.FrameRecipe(jb.FrameBody({"a": (0, 0, 0), "b": end}, (bar,)), LAW, (moves, turns))
    lying = jb.Section.rectangle(0.04, 0.01) if height == "height" else jb.Section.rectangle(0.01, 0.04)
    beam = jb.BeamRecipe(0.4, lying, STEEL, LAW)
    found, expected = (r.structure({}, r.mesh((), 8000.0)).modes().frequency_hz[2:5] for r in (frame, beam))
    assert_allclose(found, expected, rtol=1e-8)


def test_modes_over_lengths_are_as_many_where_one_vector_is_all_but_rounding():
    recipe = jb.BeamRecipe(0.383, jb.Section.circle(0.025), STEEL, jb.LossFactor(0.01), elements=3)
    family = jb.BeamFamily(recipe, {"length": (-0.05, 0.05)}).at(("1:y", "1:rz", "4:y"), 300.0)
    motions = np.eye(family.nominal.n_dofs)[:, family.nominal.index(("1:y", "1:rz", "4:y"))]
    free = family.free_modes(np.arange(len(motions)), motions)
    square = (2 * np.pi * 250.0) ** 2
    for log in (-0.04, 0.0, 0.03):
        (lam,), (rows,) = free(np.exp([[log]]))
        beam = recipe.structure({"length": np.exp(log)}, recipe.mesh(("1:y", "1:rz", "4:y"), 2000.0))
        at = beam.index(("1:y", "1:rz", "4:y"))
        exact = np.linalg.inv(beam.stiffness - square * beam.mass)[np.ix_(at, at)]
        assert_allclose((rows / (lam - square)) @ rows.T, exact, rtol=1e-6)


@pytest.mark.parametrize("stub", [1e-2, 1e-3, 1e-4])
def test_a_short_stub_leaves_rigid_body_motions_and_soft_supports_what_they_are(stub):
    bar = jb.Member(("a", "b", "c"), jb.Section.rectangle(0.02, 0.005), STEEL)
    body = jb.FrameBody({"a": (0, 0, 0), "b": (3 - stub, 0, 0), "c": (3.0, 0, 0)}, (bar,))
    free = jb.FrameRecipe(body, LAW, ("x", "y", "rz"))
    modes = free.structure(None, free.mesh(("b:y", "c:y"), 20.0)).modes().frequency_hz
    assert (modes[:3] == 0.0).all()
    assert modes[3] > 2.9
    held = replace(free, supports=("a:x", "a:y", "a:rz"))
    (first, *_) = held.structure(None, held.mesh(("b:y", "c:y"), 20.0)).modes().frequency_hz
    stiffness, mass = 2.1e11 * 0.02 * 0.005**3 / 12, 7800.0 * 0.02 * 0.005
    euler = 1.875104069**2 / 9.0 * np.sqrt(stiffness / mass) / (2 * np.pi)  # shear takes far less than 1e-4 of it
    assert first == pytest.approx(euler, rel=1e-4)
