"""Axial forces: tensioned and compressed beams against closed forms, uncertain forces, buckling."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import optimize

import jointbayes as jb
from jointbayes.frf.modal import NaturalFrequencies
from jointbayes.joint import joints_of
from jointbayes.structure import require_unbuckled
from jointbayes.structure.frame_element import Stretch, part_matrices
from tests.conftest import STEEL

LAW = jb.ModalDamping((0.01,))
LENGTH, WIRE = 1.0, jb.Section.circle(2e-4)  # so slender that shear and rotary inertia are 1e-7 of a frequency
EI, MASS = STEEL.youngs_modulus * WIRE.inertia_z, STEEL.density * WIRE.area
EULER = np.pi**2 * EI / LENGTH**2
PINNED, CLAMPED = ("1:y", "11:y"), ("1:y", "1:rz", "11:y", "11:rz")


def wire(force, element="converged", supports=PINNED, **stated):
    """The slender beam, its axial force in Euler's critical ones."""
    nodes = 200 if element == "paper" else 10
    held = tuple(label.replace("11:", f"{nodes + 1}:") for label in supports)
    stated = {"section": WIRE, "damping": LAW, "axial_force": force * EULER} | stated
    return jb.BeamRecipe(LENGTH, material=STEEL, elements=nodes, supports=held, element=element, **stated)


def eigenvalues(recipe, springs=0.0, count=3):
    """First (2πf)² with a rotational spring at both ends, in EI/L."""
    ends = [label for label in ("1:rz", f"{recipe.elements + 1}:rz") if label not in recipe.supports]
    structure = recipe.structure({}, recipe.mesh() if recipe.element == "paper" else recipe.mesh(()))
    at, added = structure.index(ends), np.zeros_like(structure.stiffness)
    added[at, at] = springs * EI / LENGTH
    return structure.modes(added).eigenvalues[:count]


def closed_form(force, springs, rigidity=EI, mass=MASS, count=3):
    """The same of an Euler-Bernoulli beam, its ends at rest and held by equal rotational springs; inf clamps them.

    v = cosh αx/cosh(αL/2) − cos βx/cos(βL/2), or with sines, from mid-length, where α² − β² = N/EI.
    """
    bend, turn = (1.0, springs / LENGTH) if np.isfinite(springs) else (0.0, 1.0)
    over = force * EULER / rigidity
    found = []
    for n in range(1, count + 1):

        def slope(half, n=n):
            beta = 2 * half / LENGTH
            alpha = np.sqrt(beta**2 + over)
            odd = n % 2 == 0
            held = bend * (alpha**2 + beta**2) + turn * alpha * np.tanh(alpha * LENGTH / 2) ** (-1 if odd else 1)
            c, s = np.cos(half), np.sin(half)
            return held * (s if odd else c) + turn * beta * (-c if odd else s)

        ends = max(n * np.pi / 2, np.sqrt(max(-over, 0.0)) * LENGTH / 2 * (1 + 1e-12)), (n + 1) * np.pi / 2
        beta = 2 / LENGTH * optimize.brentq(slope, *ends, xtol=1e-14, rtol=1e-14)
        found.append((beta**2 + over) * beta**2 * rigidity / mass)
    return np.array(found)


@pytest.mark.parametrize("element", ["converged", "paper"])
@pytest.mark.parametrize("force", [-1.5, -0.5, 1e-3, 1.0, 30.0, 1e3, 1e4])
def test_pinned_ends_have_the_frequencies_of_the_closed_form(force, element):
    n = np.arange(1, 4)
    exact = (n * np.pi / LENGTH) ** 4 * EI / MASS * (1 + force / n**2)  # negative where it has buckled
    assert_allclose(eigenvalues(wire(force, element)), exact, rtol=2e-6)
    if force >= 1e4:
        string = n / (2 * LENGTH) * np.sqrt(force * EULER / MASS)
        assert_allclose(np.sqrt(exact) / (2 * np.pi), string, rtol=1e-3)


@pytest.mark.parametrize("springs", [0.3, 3.0, 100.0])
@pytest.mark.parametrize("force", [-0.9, 2.0, 50.0])
def test_rotational_springs_at_both_ends_have_those_of_the_transcendental_equation(force, springs):
    assert_allclose(eigenvalues(wire(force), springs), closed_form(force, springs), rtol=2e-6)


@pytest.mark.parametrize("force", [-3.5, -1.0, 0.0, 20.0, 1e3])
def test_clamped_ends_have_those_of_the_transcendental_equation(force):
    assert_allclose(eigenvalues(wire(force, supports=CLAMPED)), closed_form(force, np.inf), rtol=4e-6)


def test_both_planes_of_a_member_in_any_direction_are_stiffened():
    section = jb.Section.rectangle(2e-4, 1.4e-4)
    end = LENGTH * np.array([0.48, 0.6, 0.64])
    bar = jb.Member(("a", "b"), section, STEEL, axial_force=40 * EULER)
    held = tuple(f"{point}:{way}" for point in "ab" for way in ("x", "y", "z", "rx", "ry", "rz"))
    recipe = jb.FrameRecipe(jb.FrameBody({"a": (0, 0, 0), "b": tuple(end)}, (bar,)), LAW, supports=held)
    found = recipe.structure({}, recipe.mesh(())).modes().eigenvalues[:6]
    planes = [
        closed_form(40, np.inf, STEEL.youngs_modulus * inertia, STEEL.density * section.area)
        for inertia in (section.inertia_y, section.inertia_z)
    ]
    assert_allclose(found, np.sort(np.concatenate(planes)), rtol=4e-6)


@pytest.mark.parametrize("field", ["xy", "xz"])
def test_the_papers_element_works_the_force_through_its_own_stubby_shapes(field):
    bare = Stretch(0.1, STEEL, jb.Section.rectangle(0.05, 0.08), jb.Section.rectangle(0.05, 0.08))
    taut = replace(bare, axial_force=1e7)
    (paper, mass), (bare_paper, bare_mass) = (part_matrices(stretch, 0, field) for stretch in (taut, bare))
    (fine, _), (stiffness, _) = (part_matrices(stretch, 5, field) for stretch in (taut, bare))
    ends, inner = [0, 1, 10, 11], list(range(2, 10))
    shapes = np.zeros((12, 4))
    shapes[ends] = np.eye(4)
    shapes[inner] = -np.linalg.solve(stiffness[np.ix_(inner, inner)], stiffness[np.ix_(inner, ends)])
    expected = shapes.T @ (fine - stiffness) @ shapes
    assert_allclose(paper - bare_paper, expected, atol=1e-12 * np.abs(expected).max())
    assert np.array_equal(mass, bare_mass)


STOUT = jb.Section.circle(0.012)


def test_a_free_body_under_a_force_is_held_by_its_joints_alone():
    """A force that keeps its direction turns a free body, or rights it: no motion of its own, but of its joints'."""
    joint = joints_of(jb.Joint((end,), name=name) for end, name in zip(PINNED, "ab", strict=True))
    for force in (-0.5, 5.0):
        floating = wire(force, section=STOUT, supports=())
        held = NaturalFrequencies(jb.BeamFamily(floating, {}), joint, 3).frequency_hz(np.eye(2) * 1e18)[0]
        pinned = replace(floating, supports=PINNED)
        assert_allclose(held, pinned.structure({}, pinned.mesh(())).modes().frequency_hz[:3], rtol=1e-6)
    assert floating.structure({}, floating.mesh(())).rigid_motions(np.arange(2)).shape[1] == 1


def test_forces_of_bodies_and_members_are_their_own():
    def body(*forces):
        members = [jb.Member((a, b), STOUT, STEEL, axial_force=f) for a, b, f in zip("ab", "bc", forces, strict=True)]
        return jb.FrameBody({"a": (0, 0, 0), "b": (0.4, 0, 0), "c": (0.4, 0.5, 0)}, tuple(members))

    ways = ("x", "y", "rz")
    bodies = jb.FrameRecipe({"rod": body(4e3, 500.0), "other": body(0.0, 0.0)}, LAW, ways)
    doubled = jb.FrameRecipe({"rod": body(8e3, 1000.0), "other": body(0.0, 0.0)}, LAW, ways)
    exact = doubled.structure({}, doubled.mesh((), 2000.0)).modes().frequency_hz[:20]
    for name in ("axial_force", "rod.axial_force"):
        found = bodies.structure({name: 2.0}, bodies.mesh((), 2000.0)).modes().frequency_hz[:20]
        assert_allclose(found, exact, rtol=1e-7, atol=1e-6)
    family = jb.FrameFamily(bodies, {"rod.axial_force": (-0.5, 0.5)})
    joint = jb.Joint(tuple(f"rod.a:{way}" for way in ways), tuple(f"other.a:{way}" for way in ways))
    found = NaturalFrequencies(family, joint, 6).frequency_hz(np.diag([1e8, 1e8, 1e5]), np.array([1.4]))
    scaled = family.reference().structure(np.array([1.4]))
    assert_allclose(found, NaturalFrequencies(scaled, joint, 6).frequency_hz(np.diag([1e8, 1e8, 1e5])), rtol=1e-7)


@pytest.mark.parametrize(
    ("held", "critical"), [(PINNED, 1.0), (CLAMPED, 4.0), (("1:y", "1:rz"), 0.25), (("1:y", "1:rz", "11:y"), 2.045748)]
)
def test_compression_beyond_what_rigid_joints_hold_is_refused_with_the_critical_force(held, critical):
    require_unbuckled(wire(-0.999 * critical, supports=()), held)
    require_unbuckled(wire(1e3, supports=()), held)
    with pytest.raises(jb.ModelError) as refused:
        require_unbuckled(wire(-1.001 * critical, supports=()), held)
    (told,) = re.findall(r"below the critical (\S+) N; lower", str(refused.value))
    assert float(told) == pytest.approx(critical * EULER, rel=3e-6)
