"""The lights of page one: green for right data, and for each wrong model and each wrong sensor what they show.

Data are made by another route than the product's: modes of dense matrices, summed.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import linalg

import jointbayes as jb
from jointbayes.case.case_objects import recipe_of
from jointbayes.posterior.compared_frfs import compared_frfs_of
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.sections.lead import lights_of
from tests.conftest import CONFIGS, TABLE_3, edited

TEXT = edited(
    (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8"),
    ("f_step_hz = 1.0", "f_step_hz = 4.0"),
    ('outputs = ["11:y"]', 'outputs = ["11:y", "8:y", "6:y"]'),
)
TIP, THIRD, MIDDLE = range(3)  # places of the sensors


def of(**factors):
    """The beam with other values of these quantities."""
    return {"model": lambda recipe: recipe.structure(factors)}


def longer(share):
    return {"model": lambda recipe: replace(recipe, length=recipe.length * (1 + share)).structure()}


def added(matrix, value, dof="6:y"):
    """The beam with a mass, kg, or a spring to ground, N/m, that the model lacks."""

    def model(recipe):
        body = recipe.structure()
        changed, place = getattr(body, matrix).copy(), body.index((dof,))[0]
        changed[place, place] += value
        return replace(body, **{matrix: changed})

    return {"model": model}


def turned(place, factor):
    """A sensor whose FRF has this factor, a number or a function of the frequency."""

    def sensor(values, hz):
        values[:, place] *= factor(hz) if callable(factor) else factor
        return values

    return {"sensor": sensor}


#: Wrong models, and whether the light of the model or of the data is to show them.
WRONG_MODELS = {
    "length 1 % more": (longer(0.01), False),  # within what a workshop does not know
    "Young's modulus 5 % less": (of(youngs_modulus=0.95), False),  # the same
    "length 7 % more": (longer(0.07), True),
    "length 5 % less": (longer(-0.05), True),
    "Young's modulus 20 % less": (of(youngs_modulus=0.8), True),
    "Young's modulus 20 % more": (of(youngs_modulus=1.2), True),
    "density 10 % more": (of(density=1.1), False),
    "20 g at mid-span": (added("mass", 0.02), False),
    "300 g at mid-span": (added("mass", 0.3), True),
    "a weak spring to ground": (added("stiffness", 3e5), True),
    "a strong spring to ground": (added("stiffness", 3e6), True),
    "damping 3 times": ({"damping": 0.03}, False),  # it is read from the FRFs
}
#: Wrong sensors, and the FRFs that the light of the data is to name.
WRONG_SENSORS = {
    "gain 2": (turned(THIRD, 2.0), ("8:y/11:y",)),
    "gain 4.6": (turned(MIDDLE, 4.6), ("6:y/11:y",)),
    "sign": (turned(THIRD, -1.0), ("8:y/11:y",)),
    "swapped channels": ({"sensor": lambda values, _: values[:, [TIP, MIDDLE, THIRD]]}, ("8:y/11:y", "6:y/11:y")),
    "wrong unit, g for m/s²": (turned(MIDDLE, 1 / 9.80665), ("6:y/11:y",)),
    "delay of 0.2 ms": (turned(THIRD, lambda hz: np.exp(-2j * np.pi * hz * 2e-4)[:, None]), ("8:y/11:y",)),
    "38 mm beside its place": ({"places": ("11:y", "8:y", "5:y")}, ("6:y/11:y",)),
    "all in mm": ({"sensor": lambda values, _: 1000 * values}, ("11:y/11:y", "8:y/11:y", "6:y/11:y")),
}


@dataclass(frozen=True)
class Seen:
    """Colours of calculation, model and data, what the light of the data says, and FRFs with faults."""

    colours: tuple[str, ...]
    said: str
    off: tuple[str, ...]


def frfs_of(structure, stiffness, hz, places, damping):
    """Receptances, shape (lines, outputs, 1), by the modes of the clamped beam."""
    clamped, joint = structure.stiffness.copy(), structure.index(("1:y", "1:rz"))
    clamped[np.ix_(joint, joint)] += stiffness
    squares, shapes = linalg.eigh(clamped, structure.mass)
    omega, turn = np.sqrt(squares), 2 * np.pi * hz[:, None]
    force, below = shapes[structure.index(("11:y",))[0]], omega**2 - turn**2 + 2j * damping * omega * turn
    return np.stack([(shapes[at] * force / below).sum(axis=1) for at in structure.index(places)], axis=1)[..., None]


def seen(seed, model=None, damping=0.01, sensor=None, places=("11:y", "8:y", "6:y")):
    """The lights of one data set: a joint of its own, 1 % noise, one wrong thing."""
    case = jb.case_from_text("lights", TEXT)
    rng, data = np.random.default_rng(seed), case.problem.test.data
    k11, k12, k22 = np.array(TABLE_3) * np.exp(rng.uniform(-1.0, 0.5, 3))
    k12, hz = min(k12, 0.6 * np.sqrt(k11 * k22)), data.frf.frequency_hz
    structure = (model or (lambda recipe: recipe.structure()))(recipe_of(case.spec.structure, case.spec.data))
    values = frfs_of(structure, np.array([[k11, k12], [k12, k22]]), hz, places, damping)
    sd = 0.01 * np.abs(values) + 0.003 * np.median(np.abs(values), axis=0)
    values = values + sd * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
    shown = values.copy() if sensor is None else sensor(values.copy(), hz)
    sd = sd * np.median(np.abs(shown), axis=0) / np.median(np.abs(values), axis=0)
    measured = replace(data, frf=replace(data.frf, values=shown), variance=2 * sd**2, joint_frf=None, synthetic=False)
    problem = case.problem.with_test(data=measured)
    return seen_of(jb.sample(replace(case, problem=problem, stated=problem, tests=()), seed=seed))


def seen_of(posterior):
    """The lights of a posterior, without what takes longer: knowledge, profiles and the next step."""
    inputs = SimpleNamespace(posterior=posterior, summary=posterior.summary(), computed="")
    inputs.tests = ReportInputs.tests.fget(inputs)
    lights = lights_of(inputs).lights
    off = (f"{frf.output}/{frf.input}" for frfs in compared_frfs_of(posterior).values() for frf in frfs if frf.faults)
    return Seen(tuple(light.kind for light in lights), lights[2].text, tuple(off))


def right(seed):
    """Right data: material, length and damping as far off as those of a workshop usually are."""
    rng = np.random.default_rng([seed, 1])
    modulus, density, length = 1 + rng.normal(0.0, [0.01, 0.005, 0.0025])

    def model(recipe):
        body = replace(recipe, length=recipe.length * length)
        return body.structure({"youngs_modulus": modulus, "density": density})

    return seen(seed, model, damping=rng.uniform(0.005, 0.02))


GREEN = ("good", "good", "good")


def row(name, seed, found):
    """A line of the table that `pytest -s` prints."""
    print(f"{name:28} {seed:2} {' '.join(f'{colour:8}' for colour in found.colours)} {' '.join(found.off)}", flush=True)
    return found


@pytest.mark.science
@pytest.mark.parametrize("seed", range(1, 13))
def test_right_data_are_green(seed):
    assert row("right", seed, right(seed)).colours == GREEN


@pytest.mark.science
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("wrong", WRONG_SENSORS)
def test_each_wrong_sensor_is_named(wrong, seed):
    change, named = WRONG_SENSORS[wrong]
    found = row(wrong, seed, seen(seed, **change))
    assert found.off == named
    assert found.colours[2] == "caution"
    if wrong in ("gain 4.6", "sign"):  # which nothing else of the answer feels
        assert found.colours == ("good", "good", "caution")
        assert found.said.startswith(f"FRF {named[0]} ")


@pytest.mark.science
@pytest.mark.parametrize("wrong", WRONG_MODELS)
def test_wrong_models_show_as_they_are_listed(wrong):
    change, shown = WRONG_MODELS[wrong]
    assert (row(wrong, 1, seen(1, **change)).colours[1:] != GREEN[1:]) == shown


@pytest.mark.science
@pytest.mark.long
def test_a_rotation_by_differences_is_named_though_the_answer_rests_on_modes():
    found = seen_of(jb.sample(jb.load_case(CONFIGS / "measured_rotation.toml")))
    assert found.off == ("1:rz/11:y",)
    assert found.colours == ("good", "good", "caution")
    assert found.said.startswith("FRF 1:rz/11:y is 4.6 times the predicted one: check its sensor")
