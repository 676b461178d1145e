"""Space frames against closed forms and exact transfer matrices."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from jointbayes.structure import BeamMaterial, FrameBody, FrameRecipe, LossFactor, Member, PointMass, Section
from tests.conftest import STEEL
from tests.structure.other_frames import Rod, dynamic_stiffness

ALUMINIUM = BeamMaterial(7e10, 0.33, 2700.0)
LAW = LossFactor(0.01)
FLAT = Section.rectangle(0.04, 0.012)
TURNS = [np.eye(3), *Rotation.random(2, random_state=7).as_matrix()]
SIX = ("x", "y", "z", "rx", "ry", "rz")


def constants(section, material, kappa=None):
    """What `other_frames` takes, from formulas of its own."""
    e, g, rho = material.youngs_modulus, material.shear_modulus, material.density
    ky, kz = kappa or section.shear_coefficient(material.poissons_ratio)
    a, iy, iz = section.area, section.inertia_y, section.inertia_z
    return e * a, g * section.torsion, e * iy, e * iz, ky * g * a, kz * g * a, rho * a, rho * iy, rho * iz


def turned(vector, turn):
    return tuple((turn @ np.array(vector)).tolist())


def bent_frame(turn=TURNS[0], element="converged", law=LAW):
    """Two members of different sections with offsets, at an angle, and a rigid body of full inertia at one end."""
    inertia = turn @ np.array([[2e-3, 3e-4, 0], [3e-4, 1e-3, -1e-4], [0, -1e-4, 2.5e-3]]) @ turn.T
    six = (*np.diag(inertia), inertia[0, 1], inertia[1, 2], inertia[0, 2])
    points = {"a": (0.1, 0.2, 0), "corner": (0.4, 0.35, 0.1), "b": (0.4, 0.3, 0.45)}
    offsets = tuple(turned(o, turn) for o in ((0.0, 0.01, 0.02), (0.01, 0.0, -0.015)))
    members = (
        Member(("a", "corner"), FLAT, STEEL, up=turned((0, 1, 0.3), turn)),
        Member(("corner", "b"), Section.tube(0.03, 0.02), ALUMINIUM, up=turned((1, 0, 0), turn), offsets=offsets),
    )
    masses = (PointMass("b", 0.4, six, turned((0.0, 0.02, 0.03), turn)),)
    body = FrameBody({name: turned(place, turn) for name, place in points.items()}, members, masses)
    return FrameRecipe(body, law, element=element)


# sections


def test_the_torsion_constant_of_round_sections_is_polar_and_of_rectangles_that_of_the_tables():
    assert_allclose(Section.circle(0.03).torsion, np.pi * 0.03**4 / 32)
    assert_allclose(Section.tube(0.03, 0.02).torsion, np.pi * (0.03**4 - 0.02**4) / 32)
    # Timoshenko & Goodier, table in art. 109: J = k a b³
    for ratio, k in [(1.0, 0.1406), (1.5, 0.196), (2.0, 0.229), (3.0, 0.263), (10.0, 0.312)]:
        assert_allclose(Section.rectangle(0.01, 0.01 * ratio).torsion, k * 0.01**4 * ratio, rtol=3e-3)
    assert Section.rectangle(0.03, 0.01).torsion == Section.rectangle(0.01, 0.03).torsion
    # a square box of thin walls: t a³
    assert_allclose(Section.box(0.051, 0.051, 0.001).torsion, 0.001 * 0.05**3)
    assert_allclose(Section.box(0.051, 0.031, 0.001).torsion, 4 * (0.05 * 0.03) ** 2 * 0.001 / (2 * (0.05 + 0.03)))


def test_every_dimension_of_a_taper_changes_linearly():
    half = Section.box(0.04, 0.02, 0.002).between(Section.box(0.06, 0.04, 0.004), 0.5)
    assert half == Section.box(0.05, 0.03, 0.003)
    middle = Section.circle(0.02).scaled(2.0).between(Section.circle(0.06), 0.5)
    assert middle.area == pytest.approx(Section.circle(0.05).area)


# static patch tests: tip loads on a cantilever of uneven pieces


@pytest.mark.parametrize("element", ["paper", "converged"])
@pytest.mark.parametrize("turn", TURNS, ids=["along x", "turned", "turned again"])
def test_constant_strain_twist_moment_and_shear_are_exact_on_uneven_elements(element, turn):
    places = [0.0, 0.1, 0.17, 0.5]
    points = {str(i): turned((x, 0, 0), turn) for i, x in enumerate(places)}
    member = Member(("0", "1", "2", "3"), FLAT, STEEL, up=turned((0, 1, 0), turn))
    supports = tuple(f"0:{d}" for d in SIX)
    recipe = FrameRecipe(FrameBody(points, (member,)), LAW, supports=supports, element=element)
    frame = recipe.structure({}, recipe.mesh(None, 100.0))
    ea, gj, eiy, eiz, kya, kza, *_ = constants(FLAT, STEEL)
    whole = np.kron(np.eye(2), turn)  # from local to global
    tip, length = frame.index([f"3:{d}" for d in SIX]), places[-1]
    for i in range(6):
        load = np.zeros(frame.n_dofs)
        load[tip] = whole[:, i]
        motion = np.linalg.solve(frame.stiffness, load)
        for name, x in zip("123", places[1:], strict=True):
            found = whole.T @ motion[frame.index([f"{name}:{d}" for d in SIX])]
            bend = length * x**2 / 2 - x**3 / 6, length * x - x**2 / 2
            expected = [
                [x / ea, 0, 0, 0, 0, 0],
                [0, bend[0] / eiz + x / kya, 0, 0, 0, bend[1] / eiz],
                [0, 0, bend[0] / eiy + x / kza, 0, -bend[1] / eiy, 0],
                [0, 0, 0, x / gj, 0, 0],
                [0, 0, -(x**2) / 2 / eiy, 0, x / eiy, 0],
                [0, x**2 / 2 / eiz, 0, 0, 0, x / eiz],
            ][i]
            assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max(), rtol=1e-8)


# rigid motion and turning


@pytest.mark.parametrize("element", ["paper", "converged"])
@pytest.mark.parametrize("turn", TURNS, ids=["as drawn", "turned", "turned again"])
def test_a_free_frame_has_six_modes_at_zero_which_move_its_whole_mass(element, turn):
    recipe = bent_frame(turn, element)
    frame, places = recipe.structure(), recipe.positions
    frequency = frame.modes().frequency_hz
    assert (frequency[:6] < 1e-3).all()
    assert frequency[6] > 10
    # total mass, from a unit translation of the points and what follows for inner nodes by the stiffness
    rigid = frame.modes().shapes[:, :6]
    at = frame.index([f"a:{d}" for d in SIX])
    motion = rigid @ np.linalg.solve(rigid[at], np.eye(6)[:, :3])  # unit translations
    beams = 7800 * FLAT.area * np.linalg.norm(np.subtract(places["corner"], places["a"]))
    tilt = np.linalg.norm(np.array([0.4, 0.3, 0.45]) - (0.4, 0.35, 0.1) + (0.01, -0.01, -0.035))
    total = beams + 2700 * Section.tube(0.03, 0.02).area * tilt + 0.4
    assert_allclose(motion.T @ frame.mass @ motion, total * np.eye(3), atol=1e-6 * total)


def test_frequencies_and_receptances_do_not_depend_on_the_axes_of_the_drawing():
    lines = 2 * np.pi * np.array([90.0, 400.0, 1500.0])
    first = None
    for turn in TURNS:
        recipe = bent_frame(turn)
        frame = recipe.structure({}, recipe.mesh(None, 3000.0))
        frequency = frame.modes().frequency_hz[6:16]
        unit = np.eye(frame.n_dofs)
        out, into = (unit[:, frame.index([f"{p}:{d}" for d in SIX])] for p in ("corner", "b"))
        both = np.kron(np.eye(2), turn)
        receptance = both.T @ frame.solve_lines(lines, out, into) @ both
        first = first or (frequency, receptance)
        assert_allclose(frequency, first[0], rtol=1e-9)
        assert_allclose(receptance, first[1], atol=1e-9 * np.abs(first[1]).max())


# closed forms


@pytest.mark.parametrize("section", [Section.circle(0.02), FLAT, Section.box(0.04, 0.03, 0.002)], ids=lambda s: s.shape)
@pytest.mark.parametrize("direction", ["x", "rx"])
def test_axial_and_torsional_frequencies_of_rods_are_those_of_the_wave_equation(section, direction):
    e, g, rho = STEEL.youngs_modulus, STEEL.shear_modulus, STEEL.density
    polar = section.inertia_y + section.inertia_z
    speed = np.sqrt(e / rho) if direction == "x" else np.sqrt(g * section.torsion / (rho * polar))
    body = FrameBody({"1": (0, 0, 0), "2": (0.7, 0, 0)}, (Member(("1", "2"), section, STEEL),))
    for supports, expected in (((), np.arange(7)), ((f"1:{direction}",), np.arange(6) + 0.5)):
        rod = FrameRecipe(body, LAW, (direction,), supports=supports)
        found = rod.structure({}, rod.mesh(None, 6 * speed / 1.4)).modes().frequency_hz[: len(expected)]
        assert_allclose(found, expected * speed / 1.4, rtol=1e-9)


@pytest.mark.parametrize("direction", ["x", "rx"])
def test_a_mass_at_the_end_of_a_rod_satisfies_its_frequency_equation(direction):
    section, length = Section.circle(0.02), 0.7
    rho, along = STEEL.density, direction == "x"
    speed = np.sqrt((STEEL.youngs_modulus if along else STEEL.shear_modulus) / rho)
    mass = PointMass("2", 1.3) if along else PointMass("2", 0.0, (3e-4, 0, 0))
    ratio = 1.3 / (rho * section.area * length) if along else 3e-4 / (rho * section.torsion * length)
    body = FrameBody({"1": (0, 0, 0), "2": (length, 0, 0)}, (Member(("1", "2"), section, STEEL),), (mass,))
    recipe = FrameRecipe(body, LAW, (direction,), supports=(f"1:{direction}",))
    number = recipe.structure({}, recipe.mesh(None, 2e4)).modes().frequency_hz[:4] * 2 * np.pi * length / speed
    assert_allclose(number * np.tan(number) * ratio, 1.0, rtol=1e-7)


# other routes


def other_model():
    """`bent_frame` for `other_frames`: members by hand, and the mass at its end."""
    places = [np.array(p) for p in ((0.1, 0.2, 0), (0.4, 0.35, 0.1), (0.4, 0.3, 0.45))]
    first = constants(FLAT, STEEL)
    second = constants(Section.tube(0.03, 0.02), ALUMINIUM)
    offsets = np.array([0.0, 0.01, 0.02]), np.array([0.01, 0.0, -0.015])
    rods = [
        Rod((0, 1), (places[0], places[1]), np.array([0, 1, 0.3]), lambda _x: first),
        Rod((1, 2), (places[1], places[2]), np.array([1.0, 0, 0]), lambda _x: second, offsets),
    ]
    # rigid body at node 2: kinetic energy as a sum over small masses that have its mass, centre and inertia
    inertia = np.array([[2e-3, 3e-4, 0], [3e-4, 1e-3, -1e-4], [0, -1e-4, 2.5e-3]])
    second_moment = np.trace(inertia) / 2 * np.eye(3) - inertia  # ∫ r rᵀ dm
    values, vectors = np.linalg.eigh(second_moment)
    heavy, centre = np.zeros((6, 6)), np.array([0.0, 0.02, 0.03])
    for value, axis in zip(values, vectors.T, strict=True):
        for side in (-1, 1):
            x, y, z = centre + side * axis * np.sqrt(3 * abs(value) / 0.4) * np.sign(value)
            row = np.array([[1, 0, 0, 0, z, -y], [0, 1, 0, -z, 0, x], [0, 0, 1, y, -x, 0]])
            heavy += 0.4 / 6 * row.T @ row
    assert (values > 0).all()
    return rods, heavy


def over_drive_points(error, exact):
    """Largest error over the roots of both drive points' receptances."""
    return np.abs(error / np.sqrt(np.abs(np.outer(np.diag(exact), np.diag(exact))))).max()


def test_receptances_are_those_of_exact_transfer_matrices():
    rods, heavy = other_model()
    recipe = bent_frame(law=LossFactor(0.0))
    lines = np.array([77.0, 311.0, 1234.0, 2000.0])
    frame = recipe.structure({}, recipe.mesh((), 3000.0))
    unit = np.eye(frame.n_dofs)[:, frame.index([f"{p}:{d}" for p in ("a", "corner", "b") for d in SIX])]
    found = frame.solve_lines(2 * np.pi * lines, unit, unit).real
    for f, one in zip(lines, found, strict=True):
        z = dynamic_stiffness(3, rods, 2 * np.pi * f)
        z[12:18, 12:18] -= (2 * np.pi * f) ** 2 * heavy
        expected = np.linalg.inv(z)
        assert over_drive_points(one - expected, expected) < 1e-8


@pytest.mark.parametrize(
    ("start", "end"),
    [
        (Section.circle(0.02), Section.circle(0.05)),
        (Section.tube(0.06, 0.03), Section.tube(0.03, 0.01)),
        (Section.rectangle(0.03, 0.012), Section.rectangle(0.05, 0.03)),
        (Section.box(0.06, 0.04, 0.003), Section.box(0.03, 0.03, 0.002)),
    ],
    ids=lambda section: section.shape,
)
def test_a_tapered_beam_is_that_of_its_differential_equation(start, end):
    lines = np.array([150.0, 1700.0, 6000.0])
    body = FrameBody({"a": (0, 0, 0), "b": (0.3, 0, 0)}, (Member(("a", "b"), start, STEEL, end),))
    recipe = FrameRecipe(body, LossFactor(0.0))
    frame = recipe.structure({}, recipe.mesh((), 6000.0))
    unit = np.eye(frame.n_dofs)[:, frame.index([f"{p}:{d}" for p in "ab" for d in SIX])]
    found = frame.solve_lines(2 * np.pi * lines, unit, unit).real
    ends = np.zeros(3), np.array([0.3, 0, 0])
    rod = Rod((0, 1), ends, np.array([0.0, 1, 0]), lambda x: constants(start.between(end, float(x)), STEEL))
    for f, one in zip(lines, found, strict=True):
        expected = np.linalg.inv(dynamic_stiffness(2, [rod], 2 * np.pi * f, uniform=False))
        assert over_drive_points(one - expected, expected) < 1e-8
