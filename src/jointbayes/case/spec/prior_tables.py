"""The tables of joints and of what is known before: `[joint]`, `[joints.NAME]`, `[prior]`, `[uncertain]`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field, Strict, create_model

import jointbayes.joint as joints
from jointbayes.case.spec.fields import (
    OWN,
    Finding,
    Labels,
    Later,
    ListOf,
    Positive,
    Spec,
    Vector,
    ascii_unit,
    either,
    key_field,
    metres,
    not_negative,
    positive,
    table_field,
)
from jointbayes.joint import (
    COORDINATES,
    COUPLED,
    DIRECTIONS,
    KINDS,
    Coordinate,
    Quantity,
    damping_quantities,
    full_coordinates,
    full_stiffnesses,
    spring_stiffnesses,
)

if TYPE_CHECKING:
    from jointbayes import inference
    from vibrecords.arrays import Array
else:
    inference = Later("jointbayes.inference")

_DISTRIBUTION = key_field(
    'the kind of prior, "log_uniform", "log_normal", "decades", "uniform" or "normal"', "log_uniform"
)
#: Every coordinate that a joint may have, by name.
_AXES = {axis.name: axis for axes in COORDINATES.values() for axis in axes}
_SPRINGS = {quantity.name: Coordinate.logarithm_of(quantity) for quantity in spring_stiffnesses(DIRECTIONS)}
_FULL = {axis.name: axis for axis in full_coordinates(DIRECTIONS)}
_DAMPING = {
    damping.name: Coordinate.logarithm_of(damping)
    for stiffnesses in (spring_stiffnesses(DIRECTIONS), full_stiffnesses(DIRECTIONS))
    for springs in [[quantity.name for quantity in stiffnesses if not quantity.may_be_negative]]
    for damping in (*damping_quantities(stiffnesses, springs, springs), *damping_quantities(stiffnesses, [], ["all"]))
}
_COORDINATES = _AXES | {name: axis for name, axis in (_SPRINGS | _FULL | _DAMPING).items() if name not in _AXES}
_UNITS = ", ".join(f"{axis.name}: {ascii_unit(axis.unit)}" for axis in _AXES.values() if axis.logarithmic)
_UNIT = f"in the unit of the parameter ({_UNITS})"


_K11, _K12, _K22 = COUPLED
_IN = {quantity.name: f"{quantity.words} in {ascii_unit(quantity.unit)}" for quantity in COUPLED}


K11_FIELD = not_negative(_IN[_K11.name], 1e8)
K12_FIELD = key_field(f"{_IN[_K12.name]}, a number with k12² ≤ k11·k22", 0.0)
K22_FIELD = not_negative(_IN[_K22.name], 1e6)


def _require_pair(*stiffnesses: float) -> None:
    joints.parametrisation_named(next(iter(COORDINATES)), ("y", "rz")).check(stiffnesses)


class StiffnessSpec(Spec):
    """A positive semidefinite joint matrix [[k11, k12], [k12, k22]]."""

    k11: Annotated[float, K11_FIELD]
    k12: Annotated[float, K12_FIELD]
    k22: Annotated[float, K22_FIELD]

    def try_objects(self) -> None:
        """The joint."""
        _require_pair(self.k11, self.k12, self.k22)

    def values(self) -> Array:
        """(k11, k12, k22), shape (3,)."""
        import numpy as np

        return np.array([self.k11, self.k12, self.k22])


_STIFFNESS = Field(description="the stiffnesses of joints of other kinds or of several: by name, or by joint and name")


class NamedStiffnessSpec(Spec):
    """Stiffnesses of a coupled pair, or those of other joints by their names."""

    k11: Annotated[float | None, K11_FIELD] = None
    k12: Annotated[float | None, K12_FIELD] = None
    k22: Annotated[float | None, K22_FIELD] = None
    stiffness: Annotated[dict[str, float | dict[str, float]] | None, _STIFFNESS] = None

    @property
    def stiffness_by_name(self) -> dict[str, float]:
        """Stiffness by its full name: ``"k11"``, ``"left.k11"``."""
        if self.stiffness is None:
            return {name: getattr(self, name) for name in ("k11", "k12", "k22")}
        by_name: dict[str, float] = {}
        for name, given in self.stiffness.items():
            by_name |= {f"{name}.{key}": k for key, k in given.items()} if isinstance(given, dict) else {name: given}
        return by_name

    def values(self, names: Iterable[str]) -> Array:
        """Stiffnesses in this order, shape (q,)."""
        import numpy as np

        by_name = self.stiffness_by_name
        return np.array([by_name[name] for name in names])

    def _findings(self) -> Iterator[Finding]:
        pair = {"k11": self.k11, "k12": self.k12, "k22": self.k22}
        given = {name: value for name, value in pair.items() if value is not None}
        if self.stiffness is not None:
            for name in given:
                yield Finding(
                    (name,), "given together with a table stiffness", "one of the two", "remove one of the two"
                )
        else:
            yield from (Finding((name,), missing=True) for name in pair if name not in given)

    def try_objects(self) -> None:
        """The joint, if the table states a coupled pair."""
        if self.k11 is not None and self.k12 is not None and self.k22 is not None:
            _require_pair(self.k11, self.k12, self.k22)


class _PriorSpec(Spec):
    """A prior, which refuses impossible constants itself: its kind, and the constants of that kind in their order."""

    distribution: Annotated[str, _DISTRIBUTION]

    def marginal(self) -> inference.Marginal:
        """The prior on the coordinate, which is the logarithm of a stiffness."""
        make: dict[str, Callable[..., inference.Marginal]] = {
            "log_uniform": inference.Uniform.of_logarithm,
            "log_normal": lambda median, sd: inference.Normal(math.log(median), sd),
            "decades": inference.Normal.from_decades,
            "uniform": lambda low, high: inference.OfStiffness(inference.Uniform(low, high)),
            "normal": lambda mean, sd: inference.OfStiffness(inference.Normal(mean, sd)),
        }
        kind, *constants = dict(self).values()
        return make[kind](*constants)

    def try_objects(self) -> None:
        """The prior."""
        self.marginal()


class LogUniformPriorSpec(_PriorSpec):
    """Every order of magnitude between two bounds is equally probable."""

    distribution: Annotated[Literal["log_uniform"], _DISTRIBUTION]
    low: float = positive(f"the lower bound {_UNIT}", 1e6)
    high: float = positive(f"the upper bound {_UNIT}", 1e11)


class LogNormalPriorSpec(_PriorSpec):
    """The logarithm of the stiffness is normal about the logarithm of the median."""

    distribution: Annotated[Literal["log_normal"], _DISTRIBUTION]
    median: float = positive(f"the median {_UNIT}", 1e9)
    sd_log: float = positive("the standard deviation of the natural logarithm", 1.0)


class DecadesPriorSpec(_PriorSpec):
    """A guess that is good to so many decades either way with 95 % probability."""

    distribution: Annotated[Literal["decades"], _DISTRIBUTION]
    guess: float = positive(f"the guess {_UNIT}", 1e9)
    decades: float = positive("the decades the guess may be off, 95 % inside", 1.0)


class UniformStiffnessPriorSpec(_PriorSpec):
    """Every value of the stiffness itself is equally probable between two bounds."""

    distribution: Annotated[Literal["uniform"], _DISTRIBUTION]
    low: float = not_negative(f"the lower bound {_UNIT}", 1e6)
    high: float = positive(f"the upper bound {_UNIT}", 1e8)


class NormalStiffnessPriorSpec(_PriorSpec):
    """The stiffness itself is normal, cut off at zero."""

    distribution: Annotated[Literal["normal"], _DISTRIBUTION]
    mean: float = positive(f"the mean {_UNIT}", 1e8)
    sd: float = positive(f"the standard deviation {_UNIT}", 2e7)


_StiffnessPrior = (
    LogUniformPriorSpec | LogNormalPriorSpec | DecadesPriorSpec | UniformStiffnessPriorSpec | NormalStiffnessPriorSpec
)
PriorSpec = Annotated[_StiffnessPrior, Field(discriminator="distribution")]


def _uniform_prior(axis: Coordinate) -> type[Spec]:
    """The table of the prior of a coordinate that is no logarithm, within its bounds."""
    least, most = axis.bounds
    within = f"from {least:g} to {most:g}" if axis.bounded else f"in {ascii_unit(axis.unit)}"
    kind = f'"uniform", the only kind of prior for {axis.name}'

    class BoundedPriorSpec(_PriorSpec):
        # every value of the coordinate is equally probable between two bounds
        distribution: Literal["uniform"] = key_field(kind, "uniform")
        low: Annotated[float, Field(ge=least, le=most)] = key_field(f"the lower bound, a number {within}", -1.0)
        high: Annotated[float, Field(ge=least, le=most)] = key_field(f"the upper bound, a number {within}", 1.0)

        def marginal(self) -> inference.Marginal:
            """The prior on the coordinate."""
            return inference.Uniform(self.low, self.high)

    return BoundedPriorSpec


if TYPE_CHECKING:

    class PriorsSpec(Spec):
        """The priors, one for each of `JointSpec.coordinates`."""

else:
    _priors = {}
    for _axis in _COORDINATES.values():
        _text = f"the prior of {_axis.name}, {_axis.words} ({ascii_unit(_axis.unit)}): its distribution and constants"
        _kinds = PriorSpec if _axis.logarithmic else _uniform_prior(_axis)
        _priors[_axis.name] = Annotated[_kinds | None, Field(description=_text)], None
    PriorsSpec = create_model("PriorsSpec", __base__=Spec, **_priors)


_SD_PERCENT = key_field("the standard deviation in percent of the value, a number greater than 0", 2.0)
_LOW_FACTOR = key_field("the lowest factor on the value, a number above 0 and at most 1", 0.1, gt=0, le=1)
_SD_MM = Field(description="the standard deviation in mm, a number greater than 0", examples=[0.1])
_LOW_MM = Field(le=0, description="the lowest offset in mm, a number of at most 0", examples=[-5.0])
_HIGH_MM = Field(ge=0, description="the highest offset in mm, a number of at least 0", examples=[5.0])
_HIGH_FACTOR = Field(ge=1, description="the highest factor on the value, a number of at least 1", examples=[10.0])


class _SpreadSpec(Spec):
    """A prior that is normal about the stated value, in one of some units, or even between two ends."""

    _spreads: ClassVar[tuple[str, ...]]
    _ends: ClassVar[tuple[str, str]]
    _examples: ClassVar[str]

    own: Annotated[bool, OWN] = False

    def _findings(self) -> Iterator[Finding]:
        spreads = [key for key in self._spreads if getattr(self, key) is not None]
        given = [*spreads, *(key for key in self._ends if getattr(self, key) is not None)]
        forms = f"{', '.join(self._spreads)}, or {' and '.join(self._ends)}"
        if spreads:
            if len(given) > 1:
                fault = f"given together with {' and '.join(given[1:])}"
                yield Finding((given[0],), fault, f"{forms}, not both", "remove one of the two")
        elif not given:
            yield Finding((), "no prior", forms, f"add {self._examples}")
        else:
            yield from (Finding((key,), missing=True) for key in self._ends if key not in given)

    def marginal(self, value: float = 1.0) -> inference.Marginal:
        """Prior on the logarithm of a factor on a value, a length in mm; or on an offset in m, that is `value` mm."""
        sd_percent, sd_mm = getattr(self, "sd_percent", None), getattr(self, "sd_mm", None)
        if sd_percent is not None:
            return inference.Normal(0.0, sd_percent / 100)
        if sd_mm is not None:
            return inference.Normal(0.0, sd_mm / value)
        ends = [getattr(self, key) for key in self._ends]
        if isinstance(self, OffsetPriorSpec):
            return inference.Uniform(*(end / value for end in ends))
        return inference.Uniform.of_logarithm(*ends)

    def try_objects(self) -> None:
        """The prior."""
        self.marginal()


class FactorPriorSpec(_SpreadSpec):
    """The prior of a positive quantity about its stated value: normal in the logarithm, or log-uniform."""

    _spreads: ClassVar[tuple[str, ...]] = ("sd_percent",)
    _ends = ("low_factor", "high_factor")
    _examples = "sd_percent = 2.0, or low_factor = 0.1 and high_factor = 10.0"

    sd_percent: Annotated[Positive | None, _SD_PERCENT] = None
    low_factor: Annotated[float | None, _LOW_FACTOR] = None
    high_factor: Annotated[float | None, _HIGH_FACTOR] = None


class LengthPriorSpec(FactorPriorSpec):
    """The prior of a length, whose standard deviation may be one in mm of that length."""

    _spreads = ("sd_percent", "sd_mm")

    sd_mm: Annotated[Positive | None, _SD_MM] = None


class OffsetPriorSpec(_SpreadSpec):
    """The prior of what is added to all lengths alike: normal about 0, or even between two ends."""

    _spreads = ("sd_mm",)
    _ends = ("low_mm", "high_mm")
    _examples = "sd_mm = 2.0, or low_mm = -5.0 and high_mm = 5.0"

    sd_mm: Annotated[Positive | None, _SD_MM] = None
    low_mm: Annotated[float | None, _LOW_MM] = None
    high_mm: Annotated[float | None, _HIGH_MM] = None


def _uncertain(what: str, **default: Any) -> Any:  # noqa: ANN401
    return Field(**default, description=f"the prior of {what}: sd_percent, or low_factor and high_factor")


class BodyUncertainSpec(Spec):
    """Uncertain quantities of one body of a frame, or part of an imported model, in addition to those of the whole."""

    youngs_modulus: FactorPriorSpec | None = _uncertain("Young's modulus of the body", default=None)
    density: FactorPriorSpec | None = _uncertain("the density of the body", default=None)
    length: LengthPriorSpec | None = _uncertain("the length of a straight body", default=None)
    section_size: FactorPriorSpec | None = _uncertain("one factor on all dimensions of its sections", default=None)
    shear_coefficient: FactorPriorSpec | None = _uncertain("the shear coefficients of the body", default=None)
    thickness: FactorPriorSpec | None = _uncertain("the thickness of a part of an imported model", default=None)
    axial_force: FactorPriorSpec | None = _uncertain("the axial forces in the body", default=None)


_BODIES = Field(description="a table for each body of a frame, as [uncertain.bodies.tool.density]", max_length=100)
_Usual = Literal["model", "youngs_modulus", "density", "length", "damping_ratio", "accelerometer_mass"]
_EXACT = key_field(f"a list of what is exactly known indeed, of {', '.join(get_args(_Usual))}", ["density"])


_OF_EACH = "as a fraction of it, a number above 0"
_ERROR_FACTOR = Field(gt=1, description="the factor by which that may be wrong, a number above 1", examples=[3.0])


_EDGE_ERROR = "the error of the place of a clamp's edge as a fraction of the overhang"
_SPRING_ERROR = "the usual effect on the lowest frequency of springs to ground that are not modelled, as a fraction"


class ModelErrorSpec(Spec):
    """Errors of the model in modes, shared by tests of one structure; those of frequencies and springs are unknown."""

    frequency_error: float = positive(f"the usual error of a frequency {_OF_EACH}", 0.003, 0.003)
    error_factor: Annotated[float, _ERROR_FACTOR] = 3.0
    damping_error: float = positive(f"the error of a damping ratio {_OF_EACH}", 0.3, 0.3)
    shape_error: float = positive("the error of a component of a shape, 1 at its reference", 0.05, 0.05)
    constant_error: float = positive(f"the error of a modal constant {_OF_EACH}", 0.1, 0.1)
    edge_error: float = not_negative(_EDGE_ERROR, 0.01, 0.01)
    spring_error: float = not_negative(_SPRING_ERROR, 0.003, 0.003)
    spring_factor: Annotated[float, _ERROR_FACTOR] = 10.0
    own: Annotated[bool, OWN] = False

    def built(self) -> inference.ErrorSizes:
        """The sizes of the errors."""
        single = self.frequency_error, self.error_factor, self.damping_error, self.shape_error, self.constant_error
        return inference.ErrorSizes(*single, self.edge_error, self.spring_error, self.spring_factor)


_MODEL_ERROR = "errors of the model in modes: of each for itself, of a clamp's edge, of springs that are not modelled"


class UncertainSpec(Spec):
    """What is uncertain besides the joint, each quantity with its prior, and the model itself; and what is exact."""

    youngs_modulus: FactorPriorSpec | None = _uncertain("Young's modulus", default=None)
    density: FactorPriorSpec | None = _uncertain("the density", default=None)
    length: LengthPriorSpec | None = _uncertain("the length of the beam", default=None)
    length_offset: OffsetPriorSpec | None = table_field(
        "the prior of what is added to the length where a joint acts: sd_mm, or low_mm and high_mm", None
    )
    section_size: FactorPriorSpec | None = _uncertain("one factor on all dimensions of the section", default=None)
    shear_coefficient: FactorPriorSpec | None = _uncertain("the shear coefficient", default=None)
    axial_force: FactorPriorSpec | None = _uncertain("the axial force", default=None)
    damping_ratio: FactorPriorSpec | None = _uncertain("each damping ratio", default=None)
    loss_factor: FactorPriorSpec | None = _uncertain("the loss factor", default=None)
    accelerometer_mass: FactorPriorSpec | None = _uncertain("the mass of the accelerometers", default=None)
    gain: FactorPriorSpec | None = _uncertain("the gain of the measurement, 1 by itself", default=None)
    bodies: Annotated[dict[str, BodyUncertainSpec], _BODIES] = {}  # noqa: RUF012 (pydantic copies it)
    model_error: ModelErrorSpec | None = table_field(_MODEL_ERROR, None)
    exact: Annotated[ListOf[_Usual], _EXACT] = ()

    def _findings(self) -> Iterator[Finding]:
        stated = {**dict.fromkeys(self.given, "prior"), **({"model_error": "errors"} if self.model_error else {})}
        for i, name in enumerate(self.exact):
            if (key := "model_error" if name == "model" else name) in stated:
                fault = f'found "{name}", whose {stated[key]} [uncertain.{key}] states'
                yield Finding(("exact", i), fault, "one of the two", "remove one")

    @property
    def given(self) -> dict[str, FactorPriorSpec | OffsetPriorSpec]:
        """Priors that the file states, in the order of the fields and of the coordinates."""
        priors = _stated(self, "")
        for body, of_body in self.bodies.items():
            priors |= _stated(of_body, f"{body}.")
        return priors


def quantity_table(name: str) -> tuple[str, ...]:
    """Key of the table of an uncertain quantity, also of one body's."""
    body, _, quantity = name.rpartition(".")
    return ("uncertain", "bodies", body, quantity) if body else ("uncertain", name)


def _stated(spec: Spec, prefix: str) -> dict[str, FactorPriorSpec | OffsetPriorSpec]:
    each = ((name, getattr(spec, name)) for name in type(spec).model_fields)
    return {f"{prefix}{name}": prior for name, prior in each if isinstance(prior, FactorPriorSpec | OffsetPriorSpec)}


_DOFS = key_field("the translation and then the rotation, two DOF labels", ["1:y", "1:rz"])
_AGAINST = key_field("no DOF (joint to ground) or as many as dofs, those of the other side", ["9:y", "9:rz"])
_LOG, *_ = COORDINATES
_COUPLED, *_ = KINDS
_OFFSET = key_field("the way from the DOFs' point to the joint's in mm, three numbers x, y, z", [25.0, 0.0, 0.0])
_IN_TEXT = {key: ", ".join("ln " * a.logarithmic + a.name for a in axes) for key, axes in COORDINATES.items()}
_PARAMETRISATION = key_field(either(f'"{key}" ({axes})' for key, axes in _IN_TEXT.items()), _LOG)
_PARAMETRISATIONS = tuple(COORDINATES)
ParametrisationName = Literal[_PARAMETRISATIONS]  # type: ignore[valid-type]
KindName = Literal[KINDS]  # type: ignore[valid-type]

_Names = ListOf[str]
_Share = Annotated[float, Field(ge=-1, le=1)]
_Unit = Annotated[tuple[_Share, _Share, _Share], Strict(False)]


# What must be the same in joints that share their quantities.
_ALIKE = ("kind", "directions", "parametrisation", "viscous", "loss_factors")


def joint_table(name: str) -> tuple[str, ...]:
    """Key of the table of a joint; of a lone one, which has no name, the key of all."""
    return ("joints", name) if name else ("joint",)


def prior_table(name: str) -> tuple[str, ...]:
    """Key of the table of the priors of a joint."""
    return ("joints", name, "prior") if name else ("prior",)


class JointSpec(Spec):
    """A joint: where it acts, of which kind it is, how it is parametrised, and the first guess of the iteration."""

    kind: KindName = key_field("the kind of joint, " + either(f'"{kind}"' for kind in KINDS), _COUPLED, _COUPLED)
    dofs: Annotated[Labels, Field(min_length=1, max_length=len(DIRECTIONS)), _DOFS]
    against: Annotated[Labels, _AGAINST] = ()
    axes: Annotated[tuple[_Unit, _Unit, _Unit], Strict(False)] | None = key_field(
        "the joint's own x, y and z, three lists of three numbers", [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0, 0, 1]], None
    )
    offset_mm: Annotated[Vector | None, _OFFSET] = None
    offset_against_mm: Vector | None = key_field(
        "the way from the other side's point to the joint's in mm, three numbers", [-25.0, 0.0, 0.0], None
    )
    parametrisation: Annotated[ParametrisationName, _PARAMETRISATION] = _LOG
    viscous: _Names = key_field("a list of springs of the joint that have a dashpot beside them", ["k11", "k22"], ())
    loss_factors: _Names = key_field('a list of springs of the joint that have a loss factor, or ["all"]', ["all"], ())
    initial: StiffnessSpec | None = table_field("the first guess: k11, k12, k22", None)
    own: Annotated[bool, OWN] = False

    @property
    def directions(self) -> tuple[str, ...]:
        """Directions of its DOFs."""
        return tuple(label.split(":")[1] for label in self.dofs)

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """Its parameters, each of which needs a prior."""
        return self.parametrisation_object.axes

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Its stiffnesses, then its damping."""
        return self.parametrisation_object.quantities

    @property
    def damping(self) -> tuple[Quantity, ...]:
        """Dashpots and loss factors."""
        return self.quantities[len(self.stiffnesses) :]

    @property
    def stiffnesses(self) -> tuple[Quantity, ...]:
        """Its stiffnesses."""
        return self._undamped.quantities

    def unlike(self, other: JointSpec) -> list[str]:
        """What keeps it from sharing its quantities with another joint."""
        return [what for what in _ALIKE if getattr(self, what) != getattr(other, what)]

    def built(self, name: str = "") -> joints.Joint:
        """Where it acts."""
        offsets = [mm and metres(mm) for mm in (self.offset_mm, self.offset_against_mm)]
        return joints.Joint(self.dofs, self.against, name, self.axes, *offsets)

    @property
    def parametrisation_object(self) -> joints.Parametrisation:
        """Its coordinates."""
        kind = self._undamped
        return joints.Damped(kind, self.viscous, self.loss_factors) if self.viscous or self.loss_factors else kind

    @property
    def _undamped(self) -> joints.Parametrisation:
        return joints.parametrisation_named(
            self.parametrisation if self.kind == _COUPLED else self.kind, self.directions
        )

    def try_objects(self) -> None:
        """Where it acts, and its coordinates."""
        self.built()
        _ = self.parametrisation_object

    def _findings(self) -> Iterator[Finding]:
        for key in ("initial", "parametrisation"):
            if self.kind != _COUPLED and key in self.model_fields_set:
                yield Finding((key,), f'found it with kind = "{self.kind}"', f'kind = "{_COUPLED}"', "remove it")
        if self.offset_against_mm is not None and not self.against:
            yield Finding(("offset_against_mm",), "found an offset of no side", "against, the other side", "remove it")


class NamedJointSpec(JointSpec):
    """One of several joints: as `[joint]`, with its own priors, or the quantities of another one."""

    prior: PriorsSpec | None = table_field("a table for the prior of each parameter, as [joints.left.prior.k11]", None)
    shared: str | None = key_field("the name of the joint whose quantities are those of this one", "left", None)
