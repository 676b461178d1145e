"""Several set-ups of one joint: the checked table of what each brings, and sampled spreads beside linearised ones."""

import functools

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import DirectSolve, FrfSet, Ports
from jointbayes.inference import JointPrior, Normal, Nuisance, Uniform
from jointbayes.joint import LogStiffness
from jointbayes.measurement import FrfMeasurement
from jointbayes.posterior.information.fisher import fisher_information
from jointbayes.structure import BeamFamily, BeamMaterial, BeamRecipe, ModalDamping, Section
from tests.conftest import CLAMP, TABLE_3, pair_matrix

LINES = np.arange(10.0, 2501.0, 2.0)
TIP, MID = "25:y", "13:y"
#: Bounds of the priors of configs/clamped_beam.toml.
BOUNDS = ((1e6, 1e11), (1e4, 1e10), (1e3, 1e8))
OWN_MM, EDGE_MM = 0.1, 1.9
#: Overhang in mm, responses, and mass at the tip in kg.
LONG, SHORT, HEAVY, BOTH = (383, (TIP,), 0.0), (200, (TIP,), 0.0), (383, (TIP,), 2.0), (383, (TIP, MID), 0.0)
OTHERS = tuple((length, (TIP,), 0.0) for length in (300, 200, 150, 100))
#: sd of (ln k11, ln k12, ln k22) after the tests of a row, as an independent prototype has it.
TABLE = {
    "383 mm alone": ((LONG,), (0.671, 1.640, 1.022)),
    "200 mm alone": ((SHORT,), (1.135, 1.360, 0.859)),
    "383 mm, and with 2 kg at the tip": ((LONG, HEAVY), (0.663, 1.640, 1.022)),
    "383 + 200 mm": ((LONG, SHORT), (0.475, 1.158, 0.768)),
    "383 + 300 + 200 + 150 + 100 mm": ((LONG, *OTHERS), (0.414, 1.150, 0.764)),
    "383 mm with mid-span": ((BOTH,), (0.286, 0.157, 0.017)),
    "383 mm with mid-span, + 150 mm": ((BOTH, (150, (TIP,), 0.0)), (0.260, 0.111, 0.017)),
}


def beam(length_mm, mass, youngs_modulus=1.0, density=1.0, damping_ratio=1.0):
    """A bar of the paper's section with factors on its quantities, 24 spans."""
    steel = BeamMaterial(2.1e11 * youngs_modulus, 0.3, 7800.0 * density)
    law = ModalDamping((0.01 * damping_ratio,))
    loaded = (TIP,) if mass else ()
    return BeamRecipe(
        length_mm / 1000, Section.circle(0.025), steel, law, elements=24, added_mass=mass, accelerometer_dofs=loaded
    )


def receptance(length_mm, outputs, mass, stiffness=TABLE_3, **factors):
    """Receptances by dense solves, shape (lines, outputs, 1)."""
    recipe = beam(length_mm, mass, **factors)
    structure = recipe.structure(mesh=recipe.mesh((*CLAMP.labels, TIP, MID), LINES[-1]))
    return DirectSolve(structure, CLAMP, Ports(LINES, outputs, (TIP,))).receptance(pair_matrix(stiffness))[0]


def part_sd(values):
    """3 % of |H|, and one floor for all channels of a test: 1 % of the median of |H| over lines and responses."""
    return 0.03 * np.abs(values) + 0.01 * np.median(np.abs(values))


@functools.cache
def setup(length_mm, outputs, mass):
    """One test of exact data."""
    values = receptance(length_mm, outputs, mass)
    ranges = dict.fromkeys(("youngs_modulus", "length", "density"), (-0.1, 0.1))
    ranges |= {"damping_ratio": (-2.4, 2.4), "length_offset": (-0.02, 0.02)}
    data = FrfMeasurement(FrfSet(LINES, values, outputs, (TIP,)), 2 * part_sd(values) ** 2)
    return jb.Setup(f"l{length_mm}m{mass:g}", BeamFamily(beam(length_mm, mass), ranges), CLAMP, data)


def problem_of(tests):
    """E, ρ, ζ and the clamp's edge are shared by the set-ups, an error of the overhang is each one's own."""
    setups = [setup(*one) for one in tests]
    lengths = (
        Nuisance(f"{one.name}.length", "mm", float(length), Normal(0.0, OWN_MM / length))
        for one, (length, _, _) in zip(setups, tests, strict=True)
    )
    nuisances = (
        Nuisance("youngs_modulus", "GPa", 210.0, Normal(0.0, 0.02)),
        Nuisance("density", "kg/m³", 7800.0, Normal(0.0, 0.01)),
        Nuisance("damping_ratio", "1", 0.01, Uniform.of_logarithm(0.1, 10.0)),
        Nuisance("length_offset", "mm", 1000.0, Normal(0.0, EDGE_MM / 1000)),
        *lengths,
    )
    priors = tuple(Uniform.of_logarithm(low, high) for low, high in BOUNDS)
    return jb.Problem(setups=setups, prior=JointPrior(LogStiffness(), priors, nuisances))


def spreads(tests):
    """Linearised sd of ln k11, ln k12, ln k22."""
    problem = problem_of(tests)
    point = np.concatenate([np.log(TABLE_3), np.zeros(len(problem.names) - 3)])
    spread = fisher_information(problem, point).with_bounds().stiffness_sd()
    return [spread[name] for name in ("k11", "k12", "k22")]


@pytest.mark.parametrize("row", TABLE)
def test_the_linearised_table_of_what_set_ups_bring_is_reproduced(row):
    tests, printed = TABLE[row]
    np.testing.assert_allclose(spreads(tests), printed, rtol=0.05)


@pytest.mark.science
def test_the_information_of_set_ups_is_that_of_central_differences_of_dense_solves():
    tests = (BOTH, SHORT)
    names = problem_of(tests).names

    def standardised(theta):
        at = dict(zip(names, theta, strict=True))
        stiffness = [np.exp(at.pop(name)) for name in ("k11", "k12", "k22")]
        parts = []
        for length, outputs, mass in tests:
            shared = {name: np.exp(at[name]) for name in ("youngs_modulus", "density", "damping_ratio")}
            own = length * np.exp(at[f"l{length}m{mass:g}.length"]) + 1000 * at["length_offset"]
            sd = part_sd(setup(length, outputs, mass).measurement.frf.values)
            parts.append((receptance(own, outputs, mass, stiffness, **shared) / sd).ravel())
        joined = np.concatenate(parts)
        return np.concatenate([joined.real, joined.imag])

    point = np.concatenate([np.log(TABLE_3), np.zeros(len(names) - 3)])
    steps = 1e-5 * np.eye(len(names))
    jacobian = np.stack([(standardised(point + h) - standardised(point - h)) / 2e-5 for h in steps], axis=-1)
    expected = jacobian.T @ jacobian
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    found = fisher_information(problem_of(tests), point).data
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-5)
