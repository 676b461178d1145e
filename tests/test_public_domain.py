"""Whatever numbers and arrays the public names are given: an error of the package, or a result that is finite.

Types are those of the documentation; sizes, shapes, kinds of array and values are anything.
"""

import math
import os
from dataclasses import fields, is_dataclass
from functools import cache
from unicodedata import category

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import jointbayes as jb
from jointbayes.joint import ElasticCentre
from jointbayes.structure import PointMass, Rayleigh, ViscousMatrix
from tests.conftest import cheap_text
from vibrecords.formats import iter_records
from vibrecords.records import FrfRecord, TimeRecord

EXAMPLES = int(os.environ.get("JOINTBAYES_EXAMPLES", "60"))  # of each test; `make science` takes more
ANY = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from(
        [0.0, -0.0, 1.0, -1.0, 0.3, 1e308, -1e308, 5e-324, 1e-308, 1e155, 1e-155, math.nan, math.inf, -math.inf]
    ),
    st.floats(1e-3, 1e3),
    st.integers(-3, 10**25),
)
SMALL = st.floats(1e-3, 10.0)
#: As often as not shapes that fit each other: of two lines, and of an FRF at two lines.
SHAPES = st.sampled_from([(2,), (2, 1, 1)]) | arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4)
KINDS = st.sampled_from(
    [np.float64, np.float32, np.complex128, np.int64, np.bool_, np.uint8, np.dtype("U3"), np.dtype("O")]
)
ANY_ARRAY = st.one_of(
    KINDS.flatmap(lambda kind: arrays.arrays(kind, SHAPES, elements=st.none() if kind == np.dtype("O") else None)),
    arrays.arrays(np.float64, SHAPES, elements=st.floats(0.5, 2.0)),
    st.lists(st.one_of(ANY, st.lists(ANY, max_size=3)), max_size=3),
    ANY,
)
LABEL = st.sampled_from(["1:y", "1:rz", "2:y", "2:rz", "3:y", "", "x", "1:y\n"])
LABELS = st.lists(LABEL, max_size=4).map(tuple)
EASY = settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))


def made(function, *arguments, **named):
    """The result, or None where the package refuses in one line."""
    try:
        return function(*arguments, **named)
    except jb.JointBayesError as error:
        message = str(error)
        assert message
        assert "\n" not in message
        return None


def message_of(function, *arguments):
    """The message of the package's error; empty where there is none."""
    try:
        function(*arguments)
    except jb.JointBayesError as error:
        return str(error)
    return ""


def numbers_of(value):
    """All numbers in a result: its fields, those of its parts, and the entries of its arrays."""
    if isinstance(value, np.ndarray):
        return value.ravel().tolist() if value.dtype.kind in "fciub" else [math.nan]
    if isinstance(value, int | float | complex) and not isinstance(value, bool):
        return [value]
    if isinstance(value, tuple):
        return [number for part in value for number in numbers_of(part)]
    own = fields(value) if is_dataclass(value) else ()  # constants of a class, such as a normal's support, are none
    return [number for field in own for number in numbers_of(getattr(value, field.name))]


def assert_sound(value):
    if value is not None:
        assert repr(value).isprintable()
        assert all(np.isfinite(complex(number)) for number in numbers_of(value)), value


MATERIAL = jb.BeamMaterial(2.1e11, 0.3, 7800.0)
CIRCLE = jb.Section.circle(0.025)
DAMPING = jb.ModalDamping((0.01,))

#: Names that take numbers alone, each with how many.
OF_NUMBERS = {
    "circle": (jb.Section.circle, 1), "tube": (jb.Section.tube, 2), "rectangle": (jb.Section.rectangle, 2),
    "box": (jb.Section.box, 3), "BeamMaterial": (jb.BeamMaterial, 3), "LossFactor": (jb.LossFactor, 1),
    "Rayleigh": (Rayleigh, 2), "ModalDamping": (lambda *ratios: jb.ModalDamping(ratios), 3), "Normal": (jb.Normal, 2),
    "from_decades": (jb.Normal.from_decades, 2), "Uniform": (jb.Uniform, 2),
    "of_logarithm": (jb.Uniform.of_logarithm, 2), "StudentNoise": (jb.StudentNoise, 1),
    "OfStiffness of Normal": (lambda mean, sd: jb.OfStiffness(jb.Normal(mean, sd)), 2),
    "OfStiffness of Uniform": (lambda low, high: jb.OfStiffness(jb.Uniform(low, high)), 2),
    "Nuisance": (lambda nominal: jb.Nuisance("gain", "1", nominal, jb.Normal(0.0, 1.0)), 1),
}  # fmt: skip
#: Names that are given arrays, labels and choices: how they are called, what with, and what is sound if not all of it.
MAYBE, TRIPLE = st.none() | ANY, st.tuples(ANY, ANY, ANY)
ELEMENT, NODES, ENDS = st.sampled_from(["paper", "converged"]), st.sampled_from("123"), st.sampled_from("12g")
ONE, UNIT = jb.Observed([10.0], 0.1), np.ones((2, 1, 1))
SETTINGS = ("ensembles", "walkers", "max_steps", "check_every", "tau_factor", "tau_tolerance", "r_hat_max",
            "end_tolerance")  # fmt: skip
KINDS_OF_JOINT = [jb.LogStiffness(), jb.SignedCoupling(), ElasticCentre(), jb.FullStiffness(("y", "rz")),
                  jb.blocks_of({"only": jb.SignedCoupling()})]  # fmt: skip


@cache
def cheap_problem():
    """Not a fixture: hypothesis would print all of it."""
    return jb.case_from_text("cheap", cheap_text()).problem


def nominal(family, top):
    return (family if top is None else family.at(("1:y", "2:y"), top)).nominal


def beam(length, elements, kappa, mass, supports, element, top):
    more = {"accelerometer_mass": mass, "accelerometer_dofs": ("2:y",), "element": element, "supports": supports}
    recipe = jb.BeamRecipe(length, CIRCLE, MATERIAL, DAMPING, elements=elements, shear_coefficient=kappa, **more)
    return nominal(jb.BeamFamily(recipe, {}), top)


def frame(place, up, kappa, size, mass, inertia, top, supports, element):
    end = None if kappa is None else jb.Section.circle(size)
    member = jb.Member(("1", "2"), CIRCLE, MATERIAL, end, kappa, up, (place, place))
    body = jb.FrameBody({"1": (0, 0, 0), "2": place}, (member,), (PointMass("2", mass, inertia, place),))
    return nominal(jb.FrameFamily(jb.FrameRecipe(body, DAMPING, supports=supports, element=element), {}), top)


def matrices(stiffness, mass, damping, labels):
    law = made(ViscousMatrix, damping) or DAMPING
    return jb.MatrixFamily(jb.MatrixRecipe(stiffness, mass, labels, law), {}).nominal


def chain(masses, springs, dampers):
    springs, dampers = ([(a, "ground" if b == "g" else b, k) for a, b, k in each] for each in (springs, dampers))
    return jb.MatrixFamily(jb.chain(masses, springs, None if dampers else DAMPING, dampers=dampers), {}).nominal


def are_sound_modes(modes):
    numbers = [*modes.values, *modes.sd, *modes.frequency_hz, *modes.sd_hz]
    return repr(modes).isprintable() and np.isfinite(numbers).all()


def is_finite(values):
    return np.isfinite(values).all()


MODES = (ANY_ARRAY, ANY_ARRAY, LABELS)
WHATEVER = {
    "assembled matrices": (lambda k, m, dofs: jb.Structure(k, m, DAMPING, dofs), (ANY_ARRAY, ANY_ARRAY, LABELS)),
    "labels of a joint": (jb.Joint, (LABELS, LABELS), lambda joint: len(joint.dofs) >= 1),
    "FRFs": (
        lambda *given: jb.FrfSet(*given[:4], "receptance", *given[4:]),
        (ANY_ARRAY, ANY_ARRAY, LABELS, LABELS, st.none() | ANY_ARRAY, MAYBE),
    ),
    "variance": (lambda variance: jb.FrfData(jb.FrfSet([10.0, 20.0], UNIT, ["2:y"], ["2:y"]), variance), (ANY_ARRAY,)),
    "frequencies": (jb.FrequencyData, (ANY_ARRAY, ANY_ARRAY)),
    "modes": (lambda values, sd, _: jb.ModeData(jb.Observed(values, sd)), MODES, are_sound_modes),
    "damping": (lambda values, sd, _: jb.ModeData(ONE, jb.Observed(values, sd)), MODES, are_sound_modes),
    "shapes": (
        lambda values, sd, dofs: jb.ModeData(ONE, shapes=jb.ModeShapes(dofs, "9:x", jb.Observed(values, sd))),
        MODES,
        are_sound_modes,
    ),
    "zeros": (
        lambda values, sd, dofs: jb.ModeData(ONE, zeros=jb.Antiresonances(dofs, jb.Observed(values, sd))),
        MODES,
        are_sound_modes,
    ),
    "constants": (
        lambda values, sd, dofs: jb.ModeData(ONE, constants=jb.ModalConstants(dofs, dofs, jb.Observed(values, sd))),
        MODES,
        are_sound_modes,
    ),
    "record of an FRF": (
        lambda lines, values, coherence: FrfRecord("a", "b", lines, values, coherence=coherence),
        (ANY_ARRAY, ANY_ARRAY, st.none() | ANY_ARRAY),
        bool,
    ),
    "record of a time history": (lambda values: TimeRecord("a", 100.0, values), (ANY_ARRAY,), bool),
    "coherence": (
        lambda *given: jb.coherence_variance(jb.FrfSet([10.0, 20.0], UNIT, ["2:y"], ["2:y"], "receptance", *given)),
        (ANY_ARRAY, MAYBE),
        lambda variance: is_finite(variance) and (variance >= 0).all(),
    ),
    "beam": (beam, (ANY | SMALL, st.integers(-2, 12), MAYBE | SMALL, ANY, LABELS, ELEMENT, MAYBE)),
    "frame": (
        frame,
        (st.tuples(ANY | SMALL, ANY, ANY), st.none() | TRIPLE, MAYBE | SMALL, ANY | SMALL, ANY, TRIPLE, MAYBE, LABELS,
         ELEMENT),
    ),
    "matrices": (matrices, (ANY_ARRAY, ANY_ARRAY, ANY_ARRAY, LABELS)),
    "chain": (
        chain,
        (st.lists(ANY | SMALL, max_size=4), st.lists(st.tuples(NODES, ENDS, ANY | SMALL), max_size=4),
         st.lists(st.tuples(NODES, ENDS, ANY), max_size=2)),
    ),
    **{f"stiffness, {type(joint).__name__}": (joint.coordinates, (TRIPLE,), is_finite) for joint in KINDS_OF_JOINT},
    "settings": (lambda *given: jb.SamplerSettings(**dict(zip(SETTINGS, given, strict=True))), (ANY,) * len(SETTINGS)),
    "theta": (
        lambda theta: cheap_problem().log_posterior(theta),
        (ANY_ARRAY,),
        lambda density: not (np.isnan(density).any() or (density == np.inf).any()),
    ),
    "first guess": (
        lambda initial: jb.Problem(cheap_problem().tests, cheap_problem().prior, initial=initial).first_guess,
        (ANY_ARRAY,),
        is_finite,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OF_NUMBERS)
@EASY
@given(data=st.data())
def test_numbers_make_something_finite_or_an_error(name, data):
    function, count = OF_NUMBERS[name]
    found = made(function, *(data.draw(ANY) for _ in range(count)))
    assert_sound(found)
    if found is not None and hasattr(found, "log_density"):
        with np.errstate(all="ignore"):
            density = found.log_density(np.array([float(found.mean)]))
        assert np.isfinite(density).all()
        assert not np.isnan(found.log_density(np.array([0.0, 1.0]))).any()


@pytest.mark.parametrize("name", WHATEVER)
@EASY
@given(data=st.data())
def test_whatever_a_public_name_is_given_it_makes_something_sound_or_an_error(name, data):
    function, given_values, *sound = WHATEVER[name]
    found = made(function, *map(data.draw, given_values))
    if sound:
        assert found is None or sound[0](found)
    else:
        assert_sound(found)


def test_a_beam_of_one_element_that_hardly_shears_is_sound_or_an_error():
    assert_sound(made(beam, 514.0, 1, 0.001, 0.0, (), "converged", 513.0))


READERS = [jb.load_case, jb.load_posterior, jb.read_frf, jb.inspect_file, lambda path: list(iter_records(path))]


@EASY
@given(name=st.text(max_size=30))
def test_any_path_is_an_error_of_one_line(tmp_path_factory, name):
    folder = tmp_path_factory.getbasetemp()
    for function in READERS:
        message = message_of(function, f"{folder}/nowhere/{name}")
        assert "".join(" " if category(sign) == "Zs" else sign for sign in message).isprintable()
