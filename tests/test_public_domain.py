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
from hypothesis import HealthCheck, example, given, settings
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
SHAPES = arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4)
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
    "circle": (jb.Section.circle, 1),
    "tube": (jb.Section.tube, 2),
    "rectangle": (jb.Section.rectangle, 2),
    "box": (jb.Section.box, 3),
    "BeamMaterial": (jb.BeamMaterial, 3),
    "LossFactor": (jb.LossFactor, 1),
    "Rayleigh": (Rayleigh, 2),
    "ModalDamping": (lambda *ratios: jb.ModalDamping(ratios), 3),
    "Normal": (jb.Normal, 2),
    "from_decades": (jb.Normal.from_decades, 2),
    "Uniform": (jb.Uniform, 2),
    "of_logarithm": (jb.Uniform.of_logarithm, 2),
    "OfStiffness of Normal": (lambda mean, sd: jb.OfStiffness(jb.Normal(mean, sd)), 2),
    "OfStiffness of Uniform": (lambda low, high: jb.OfStiffness(jb.Uniform(low, high)), 2),
    "Nuisance": (lambda nominal: jb.Nuisance("gain", "1", nominal, jb.Normal(0.0, 1.0)), 1),
    "StudentNoise": (jb.StudentNoise, 1),
}


@pytest.mark.parametrize("name", OF_NUMBERS)
@EASY
@given(data=st.data())
def test_numbers_make_something_finite_or_an_error(name, data):
    function, count = OF_NUMBERS[name]
    given_numbers = [data.draw(ANY) for _ in range(count)]
    found = made(function, *given_numbers)
    assert_sound(found)
    if found is not None and hasattr(found, "log_density"):
        with np.errstate(all="ignore"):
            density = found.log_density(np.array([float(found.mean)]))
        assert np.isfinite(density).all()
        assert not np.isnan(found.log_density(np.array([0.0, 1.0]))).any()


@EASY
@given(stiffness=ANY_ARRAY, mass=ANY_ARRAY, dofs=LABELS)
def test_any_assembled_matrices_are_a_structure_or_an_error(stiffness, mass, dofs):
    assert_sound(made(jb.Structure, stiffness, mass, DAMPING, dofs))


@EASY
@given(dofs=LABELS, against=LABELS)
def test_any_labels_are_a_joint_or_an_error(dofs, against):
    found = made(jb.Joint, dofs, against)
    assert found is None or len(found.dofs) >= 1


@EASY
@given(
    lines=ANY_ARRAY,
    values=ANY_ARRAY,
    outputs=LABELS,
    inputs=LABELS,
    coherence=st.none() | ANY_ARRAY,
    averages=st.none() | ANY,
)
def test_any_arrays_are_frfs_or_an_error(lines, values, outputs, inputs, coherence, averages):
    found = made(jb.FrfSet, lines, values, outputs, inputs, "receptance", coherence, averages)
    assert_sound(found)


@EASY
@given(variance=ANY_ARRAY)
def test_any_variance_is_that_of_frfs_or_an_error(variance):
    frf = jb.FrfSet([10.0, 20.0], np.ones((2, 1, 1)), ["2:y"], ["2:y"])
    assert_sound(made(jb.FrfData, frf, variance))


@EASY
@given(lines=ANY_ARRAY, sd=ANY_ARRAY)
def test_any_arrays_are_natural_frequencies_or_an_error(lines, sd):
    assert_sound(made(jb.FrequencyData, lines, sd))


@EASY
@given(values=ANY_ARRAY, sd=ANY_ARRAY, dofs=LABELS)
def test_any_arrays_are_modes_or_an_error(values, sd, dofs):
    shapes = made(jb.ModeShapes, dofs, "9:x", jb.Observed(values, sd))
    for found in (
        made(lambda: jb.ModeData(jb.Observed(values, sd))),
        made(lambda: jb.ModeData(jb.Observed([10.0], 0.1), jb.Observed(values, sd))),
        made(lambda: jb.ModeData(jb.Observed([10.0], 0.1), shapes=shapes)),
        made(lambda: jb.ModeData(jb.Observed([10.0], 0.1), zeros=jb.Antiresonances(dofs, jb.Observed(values, sd)))),
        made(
            lambda: jb.ModeData(
                jb.Observed([10.0], 0.1), constants=jb.ModalConstants(dofs, dofs, jb.Observed(values, sd))
            )
        ),
    ):
        if found is not None:
            assert repr(found).isprintable()
            assert np.isfinite([*found.values, *found.sd, *found.frequency_hz, *found.sd_hz]).all()


@EASY
@given(lines=ANY_ARRAY, values=ANY_ARRAY, coherence=st.none() | ANY_ARRAY)
def test_any_arrays_are_a_record_or_an_error(lines, values, coherence):
    made(FrfRecord, "a", "b", lines, values, coherence=coherence)
    made(TimeRecord, "a", 100.0, values)


@EASY
@given(coherence=ANY_ARRAY, averages=st.none() | ANY)
def test_coherence_variance_is_positive_or_an_error(coherence, averages):
    frf = made(jb.FrfSet, [10.0, 20.0], np.ones((2, 1, 1)), ["2:y"], ["2:y"], "receptance", coherence, averages)
    if frf is not None:
        variance = made(jb.coherence_variance, frf)
        assert variance is None or (np.isfinite(variance).all() and (variance >= 0).all())


@EASY
@given(
    length=ANY | SMALL, elements=st.integers(-2, 12), kappa=st.none() | ANY | SMALL, mass=ANY, supports=LABELS,
    element=st.sampled_from(["paper", "converged"]), top=st.none() | ANY,
)  # fmt: skip
@example(length=514.0, elements=1, kappa=0.001, mass=0.0, supports=(), element="converged", top=513.0)
def test_any_beam_has_finite_modes_or_is_an_error(length, elements, kappa, mass, supports, element, top):
    recipe = made(
        jb.BeamRecipe, length, CIRCLE, MATERIAL, DAMPING, elements=elements, shear_coefficient=kappa, supports=supports,
        accelerometer_mass=mass, accelerometer_dofs=("2:y",), element=element,
    )  # fmt: skip
    if recipe is None:
        return
    family = made(jb.BeamFamily, recipe, {})
    if family is not None and top is not None:
        family = made(family.at, ("1:y", "2:y"), top)
    structure = None if family is None else made(lambda: family.nominal)
    assert_sound(structure)


@EASY
@given(
    place=st.tuples(ANY | SMALL, ANY, ANY), up=st.none() | st.tuples(ANY, ANY, ANY), kappa=st.none() | ANY | SMALL,
    size=ANY | SMALL, mass=ANY, inertia=st.tuples(ANY, ANY, ANY), top=st.none() | ANY, supports=LABELS,
    element=st.sampled_from(["paper", "converged"]),
)  # fmt: skip
def test_any_frame_has_finite_modes_or_is_an_error(place, up, kappa, size, mass, inertia, top, supports, element):
    def frame():
        end = None if kappa is None else jb.Section.circle(size)
        member = jb.Member(("1", "2"), CIRCLE, MATERIAL, end, kappa, up, (place, place))
        body = jb.FrameBody({"1": (0, 0, 0), "2": place}, (member,), (PointMass("2", mass, inertia, place),))
        recipe = jb.FrameRecipe(body, DAMPING, supports=supports, element=element)
        return jb.FrameFamily(recipe, {})

    family = made(frame)
    if family is not None and top is not None:
        family = made(family.at, ("1:y", "2:y"), top)
    assert_sound(None if family is None else made(lambda: family.nominal))


@EASY
@given(stiffness=ANY_ARRAY, mass=ANY_ARRAY, damping=ANY_ARRAY, labels=LABELS)
def test_any_matrices_are_a_structure_or_an_error(stiffness, mass, damping, labels):
    law = made(ViscousMatrix, damping) or DAMPING
    recipe = made(jb.MatrixRecipe, stiffness, mass, labels, law)
    assert_sound(None if recipe is None else made(lambda: jb.MatrixFamily(recipe, {}).nominal))


@EASY
@given(
    masses=st.lists(ANY | SMALL, max_size=4),
    springs=st.lists(st.tuples(st.sampled_from("123"), st.sampled_from(["1", "2", "ground"]), ANY | SMALL), max_size=4),
    dampers=st.lists(st.tuples(st.sampled_from("123"), st.sampled_from(["1", "2", "ground"]), ANY), max_size=2),
)
def test_any_chain_is_a_structure_or_an_error(masses, springs, dampers):
    recipe = made(jb.chain, masses, springs, None if dampers else DAMPING, dampers=dampers)
    assert_sound(None if recipe is None else made(lambda: jb.MatrixFamily(recipe, {}).nominal))


@cache
def cheap_problem():
    """Not a fixture: hypothesis would print all of it."""
    return jb.case_from_text("cheap", cheap_text()).problem


KINDS_OF_JOINT = [
    jb.LogStiffness(),
    jb.SignedCoupling(),
    ElasticCentre(),
    jb.FullStiffness(("y", "rz")),
    jb.blocks_of({"only": jb.SignedCoupling()}),
]


@pytest.mark.parametrize("joint", KINDS_OF_JOINT, ids=lambda joint: type(joint).__name__)
@EASY
@given(stiffness=st.tuples(ANY, ANY, ANY))
def test_any_stiffness_has_finite_coordinates_or_is_an_error(joint, stiffness):
    theta = made(joint.coordinates, stiffness)
    assert theta is None or np.isfinite(theta).all()


@EASY
@given(
    ensembles=ANY, walkers=ANY, steps=ANY, every=ANY, factor=ANY, tolerance=ANY, r_hat=ANY, end=ANY,
)  # fmt: skip
def test_any_sampler_settings_are_possible_or_an_error(ensembles, walkers, steps, every, factor, tolerance, r_hat, end):
    found = made(
        jb.SamplerSettings, ensembles=ensembles, walkers=walkers, max_steps=steps, check_every=every, tau_factor=factor,
        tau_tolerance=tolerance, r_hat_max=r_hat, end_tolerance=end,
    )  # fmt: skip
    assert_sound(found)


@EASY
@given(theta=ANY_ARRAY)
def test_any_theta_has_a_density_or_is_an_error(theta):
    found = made(cheap_problem().log_posterior, theta)
    assert found is None or not (np.isnan(found).any() or (found == np.inf).any())


@EASY
@given(initial=ANY_ARRAY)
def test_any_first_guess_is_taken_or_is_an_error(initial):
    problem = cheap_problem()
    found = made(jb.Problem, problem.tests, problem.prior, initial=initial)
    assert found is None or np.isfinite(found.first_guess).all()


@EASY
@given(text=st.text(max_size=200) | st.binary(max_size=200).map(lambda raw: raw.decode("latin-1")))
def test_any_text_is_a_case_or_an_error(text):
    assert all(line.isprintable() for line in message_of(jb.case_from_text, "case", text).split("\n"))


READERS = [jb.load_case, jb.load_posterior, jb.read_frf, jb.inspect_file, lambda path: list(iter_records(path))]


@EASY
@given(name=st.text(max_size=30))
def test_any_path_is_an_error_of_one_line(tmp_path_factory, name):
    folder = tmp_path_factory.getbasetemp()
    for function in READERS:
        message = message_of(function, f"{folder}/nowhere/{name}")
        assert "".join(" " if category(sign) == "Zs" else sign for sign in message).isprintable()
