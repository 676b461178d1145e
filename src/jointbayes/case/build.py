"""From the tables of a case file to the objects they describe: beam, priors, noise model, data."""

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np

from jointbayes.arrays import Array
from jointbayes.case.mode_data import modes_of
from jointbayes.case.schema.case import CaseSpec
from jointbayes.case.schema.damping import ModalDampingSpec
from jointbayes.case.schema.data import DataSpec, NaturalFrequenciesSpec, NoiseSpec, SyntheticFrfSpec, TruthSpec
from jointbayes.case.schema.joint import JointSpec, NamedJointSpec, StiffnessSpec
from jointbayes.case.schema.modes import ModesSpec
from jointbayes.case.schema.noise import NoiseModelSpec
from jointbayes.case.schema.priors import (
    DecadesPriorSpec,
    FactorPriorSpec,
    LengthPriorSpec,
    LogNormalPriorSpec,
    LogUniformPriorSpec,
    NormalStiffnessPriorSpec,
    OffsetPriorSpec,
    PriorSpec,
    UniformPriorSpec,
    UniformStiffnessPriorSpec,
)
from jointbayes.case.schema.structure import StructureSpec
from jointbayes.case.structures import metres, structure_recipe
from jointbayes.frf import NaturalFrequencies, Ports, rigid_body_modes
from jointbayes.identification.resonances import resonances_hz
from jointbayes.inference import (
    JointPrior,
    Marginal,
    NoiseModel,
    Normal,
    Nuisance,
    OfStiffness,
    Uniform,
)
from jointbayes.inference.noise.base import NoiseChoice
from jointbayes.joint import (
    COUPLED,
    RIGID,
    AnyJoint,
    Coordinate,
    Damped,
    Joint,
    Parametrisation,
    as_joints,
    blocks_of,
    parametrisation_named,
)
from jointbayes.measurement import (
    CoherenceNoise,
    FrequencyMeasurement,
    FrfMeasurement,
    Measurement,
    ModalMeasurement,
    NoiseLaw,
    RelativeNoise,
    synthesise_frf,
)
from jointbayes.structure import StructureFamily, StructureRecipe, family_of_recipe

#: Bounds of the default prior, and the default first guess of k11, relative to the beam's own stiffnesses.
DEFAULT_PRIOR_FACTORS = 0.1, 1e6
DEFAULT_GUESS_FACTOR = 1e3
#: Bounds of the default priors of a loss factor, and of a dashpot relative to the beam's own stiffness times a second.
DEFAULT_LOSS = 1e-4, 1.0
DEFAULT_DASHPOT_FACTORS = 1e-6, 100.0
#: Units of stiffnesses.
_UNITS = [quantity.unit for quantity in COUPLED]
_MOST_MODES = 30  # whose frequencies may be uncertain one by one

#: How well material and length are known in a workshop, where the case takes them as exactly known.
WORKSHOP_SD_PERCENT = {"youngs_modulus": 2.0, "density": 1.0, "length": 0.5}


def recipe_of(spec: StructureSpec, data: DataSpec, measurement: Measurement | None = None) -> StructureRecipe:
    """The structure of a case; accelerometers sit where translations are measured, as files or the case say."""
    loaded = data.outputs if isinstance(data, SyntheticFrfSpec) else data.dofs if isinstance(data, ModesSpec) else ()
    if measurement is not None and measurement.provenance is not None:
        loaded = tuple(label for label in measurement.provenance.loaded if spec.absent(label) is None)
    return structure_recipe(spec, loaded)


@dataclass(frozen=True, slots=True)
class OwnStiffness:
    """A structure's stiffness by itself where one of a joint acts, and the softest joint that default priors expect."""

    size: float
    softest: float


def own_stiffnesses(
    joint: JointSpec, structure: StructureSpec, recipe: StructureRecipe, measurement: Measurement
) -> dict[str, OwnStiffness]:
    """The structure's stiffness by itself where each stiffness and dashpot of a joint acts, by their names.

    A structure may hang on a joint far softer than itself. The spring on which its inertia m has the lowest measured
    natural frequency is then m ω²: the softest joint is expected there where the default range would not reach so far.
    Where nothing holds a mass that spring is its stiffness as well. Empty where both sides are measured bodies.
    """
    sides = [side for side in (joint.dofs, joint.against) if side and structure.absent(side[0]) is None]
    if not sides:
        return {}
    shown = resonances_hz(measurement)
    lines = measurement.frf.frequency_hz if isinstance(measurement, FrfMeasurement) else shown
    lowest = float((shown if shown.size else lines).min())
    found = {}
    for quantity in joint.quantities:
        if quantity.unit == "1":
            continue
        i, j = quantity.places[0]
        springs = [
            math.sqrt(recipe.own_inertia(side[i]) * recipe.own_inertia(side[j])) * (2 * math.pi * lowest) ** 2
            for side in sides
        ]
        size = recipe.own_stiffness(sides[0][i], sides[0][j]) or min(springs)
        beyond = shown.size and min(springs) < DEFAULT_PRIOR_FACTORS[0] * size
        found[quantity.name] = OwnStiffness(size, min(springs) if beyond else size)
    return found


def joint_marginals(spec: CaseSpec, joint: JointSpec, own: Mapping[str, OwnStiffness], length: float) -> list[Marginal]:
    """Priors on the coordinates of one joint of a case: as stated, or from the structure's own stiffnesses and size."""
    priors = joint.prior if isinstance(joint, NamedJointSpec) else spec.prior
    if priors is None:
        return [_default_marginal(axis, own, length) for axis in joint.coordinates]
    return [_marginal(getattr(priors, axis.name)) for axis in joint.coordinates]


def joints_of(spec: CaseSpec) -> Joint | tuple[Joint, ...]:
    """Where the joints of a case act; a lone one without a name by itself."""
    joints = tuple(
        Joint(
            one.dofs,
            one.against,
            name,
            one.axes,
            one.offset_mm and metres(one.offset_mm),
            one.offset_against_mm and metres(one.offset_against_mm),
        )
        for name, one in spec.all_joints.items()
    )
    return joints[0] if spec.joint is not None else joints


def parametrisation_of(spec: CaseSpec) -> Parametrisation:
    """Coordinates of all joints of a case, or of one set-up."""
    return blocks_of({**{name: kind_of(one) for name, one in spec.all_joints.items()}, **spec.sharing})


def kind_of(joint: JointSpec) -> Parametrisation:
    """Coordinates of one joint."""
    kind = parametrisation_named(joint.parametrisation if joint.kind == "coupled" else joint.kind, joint.directions)
    return Damped(kind, joint.viscous, joint.loss_factors) if joint.damping else kind


def true_stiffness(spec: CaseSpec, truth: TruthSpec) -> Array:
    """Quantities of the joints that make the data, shape (q,)."""
    return np.array([truth.by_name[name] for name in spec.all_quantities])


def _default_marginal(axis: Coordinate, own: Mapping[str, OwnStiffness], length: float) -> Marginal:
    """Prior of a case that states none: far softer than the beam to far stiffer, any coupling, an arm on the beam."""
    if axis.logarithmic and axis.unit not in _UNITS:  # a loss factor, or a dashpot
        ends = DEFAULT_LOSS if axis.unit == "1" else [end * own[axis.quantity].size for end in DEFAULT_DASHPOT_FACTORS]
        return Uniform(*np.log(ends))
    if axis.logarithmic:
        low, high = DEFAULT_PRIOR_FACTORS
        return Uniform(*np.log([low * own[axis.quantity].softest, high * own[axis.quantity].size]))
    return Uniform(*axis.bounds) if axis.bounded else Uniform(-length, length)


def guess_of(joint: JointSpec, own: Mapping[str, OwnStiffness], marginals: Sequence[Marginal]) -> Array:
    """First guess of the quantities of a joint, (q,): as stated, or of a coupled pair a translational spring alone.

    Joints of other kinds begin far stiffer than the structure; those between measured bodies in the middle of their
    priors.
    """
    if joint.quantities and not own:
        guess = kind_of(joint).middle(np.array([marginal.mean for marginal in marginals]))
        return guess if joint.initial is None else np.concatenate([stiffness_of(joint.initial), guess[len(COUPLED) :]])
    if joint.initial is not None:
        guess = stiffness_of(joint.initial)
    else:
        yielding = [not q.may_be_negative for q in joint.stiffnesses]
        if joint.kind == "coupled":
            yielding[1:] = [False, False]
        springs = [own[q.name].size if yields else 0.0 for q, yields in zip(joint.stiffnesses, yielding, strict=True)]
        guess = DEFAULT_GUESS_FACTOR * np.array(springs)
    damping = [
        math.sqrt(math.prod(DEFAULT_LOSS if q.unit == "1" else DEFAULT_DASHPOT_FACTORS))
        * (1.0 if q.unit == "1" else own[q.name].size)
        for q in joint.damping
    ]
    return np.concatenate([guess, damping])


def _marginal(spec: PriorSpec | UniformPriorSpec) -> Marginal:
    match spec:
        case LogUniformPriorSpec():
            return Uniform(math.log(spec.low), math.log(spec.high))
        case LogNormalPriorSpec():
            return Normal(math.log(spec.median), spec.sd_log)
        case DecadesPriorSpec():
            return Normal.from_decades(spec.guess, spec.decades)
        case UniformPriorSpec():
            return Uniform(spec.low, spec.high)
        case UniformStiffnessPriorSpec():
            return OfStiffness(Uniform(spec.low, spec.high))
        case NormalStiffnessPriorSpec():
            return OfStiffness(Normal(spec.mean, spec.sd))


def largest_ratio(spec: CaseSpec) -> float:
    """The largest damping ratio that a case, or one set-up, states; 0 without any."""
    damping = spec.structure.damping
    return max(damping.ratio, default=0.0) if isinstance(damping, ModalDampingSpec) else 0.0


def workshop_priors(spec: CaseSpec, measurement: Measurement, largest: float) -> dict[str, FactorPriorSpec]:
    """Priors on material, length and damping as in a workshop, where the case takes them as exactly known.

    One factor is on the damping ratios of all set-ups, and leaves the `largest` of them below 1.
    """
    known, stated = spec.structure.stated, spec.uncertain.given
    usual = {name: FactorPriorSpec(sd_percent=sd) for name, sd in WORKSHOP_SD_PERCENT.items() if name in known}
    if "length_offset" in stated:  # the error of the length is stated
        usual.pop("length", None)
    damping = spec.structure.damping
    if isinstance(damping, ModalDampingSpec) and min(damping.ratio) > 0 and isinstance(measurement, FrfMeasurement):
        widest = min(10.0, 0.9 / largest)
        usual["damping_ratio"] = FactorPriorSpec(low_factor=0.1, high_factor=max(widest, 1.0))
    return {name: prior for name, prior in usual.items() if name not in stated}


def quantities_of(spec: CaseSpec, recipe: StructureRecipe, measurement: Measurement) -> list[tuple[Nuisance, bool]]:
    """Uncertain quantities of structure and measurement, those of the structure first; and whether a set-up's own."""
    structure = spec.structure
    stated = structure.stated | {"gain": ("1", 1.0)}
    found: list[tuple[Nuisance, bool]] = []
    for name, prior in spec.uncertain.given.items():
        if name == "damping_ratio" and isinstance(structure.damping, ModalDampingSpec):
            ratios = structure.damping.ratio
            labels = [name] if len(ratios) == 1 else [f"{name}_{i + 1}" for i in range(len(ratios))]
            each = [Nuisance(n, "1", r, factor_prior(prior)) for n, r in zip(labels, ratios, strict=True)]
        elif name == "mode_frequencies":
            count = _modes_in_band(spec, recipe, measurement)
            labels = [f"mode_frequency_{i + 1}" for i in range(count)]
            each = [Nuisance(label, "× predicted", 1.0, factor_prior(prior)) for label in labels]
        else:
            unit, value = stated[name]
            each = [Nuisance(name, unit, value, factor_prior(prior, value))]
        found += [(nuisance, prior.own) for nuisance in each]
    return sorted(found, key=lambda one: one[0].name == "gain")


def _modes_in_band(spec: CaseSpec, recipe: StructureRecipe, measurement: Measurement) -> int:
    """Number of natural frequencies with a rigid joint up to a tenth above the highest line, or as many as measured."""
    if isinstance(measurement, ModalMeasurement):
        return max(measurement.numbers)
    rigid = rigid_frequencies_hz(recipe, as_joints(joints_of(spec)), _MOST_MODES)
    return max(1, int((rigid < 1.1 * measurement.frf.frequency_hz[-1]).sum()))


def rigid_frequencies_hz(recipe: StructureRecipe, joint: AnyJoint, most: int) -> Array:
    """Lowest natural frequencies of a structure with a rigid joint, Hz: no more than `most`, nor than it has."""
    family = family_of_recipe(recipe)
    count = min(most, family.nominal.n_dofs - rigid_body_modes(family.nominal, joint) - joint.size)
    if count < 1:  # nothing moves where the joint does not
        return np.empty(0)
    rigid = np.eye(joint.size) * RIGID
    return NaturalFrequencies(family, joint, count).frequency_hz(rigid)[0]


def factor_prior(spec: FactorPriorSpec | OffsetPriorSpec, value: float = 1.0) -> Marginal:
    """Prior on the logarithm of a factor on a value, of a length in mm; or on an offset in m, that is `value` mm."""
    if isinstance(spec, OffsetPriorSpec):
        if spec.sd_mm is not None:
            return Normal(0.0, spec.sd_mm / value)
        assert spec.low_mm is not None
        assert spec.high_mm is not None
        return Uniform(spec.low_mm / value, spec.high_mm / value)
    if isinstance(spec, LengthPriorSpec) and spec.sd_mm is not None:
        return Normal(0.0, spec.sd_mm / value)
    if spec.sd_percent is not None:
        return Normal(0.0, spec.sd_percent / 100)
    assert spec.low_factor is not None
    assert spec.high_factor is not None
    return Uniform(math.log(spec.low_factor), math.log(spec.high_factor))


def noise_of(spec: NoiseModelSpec, measurement: Measurement) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """Distribution of the residuals, and the priors of its parameters; its module has the name of the distribution."""
    complex_frf = isinstance(measurement, FrfMeasurement) and spec.residuals == "complex"
    d = spec.discrepancy
    choice = NoiseChoice(
        spec.scale,
        (spec.scale_low_factor, spec.scale_high_factor),
        spec.scale_dof,
        spec.scale_guess,
        spec.dof,
        None if d is None else ((d.scale_low, d.scale_high), (d.length_low_hz, d.length_high_hz)),
    )
    module = import_module(f"jointbayes.inference.noise.{spec.distribution}")
    return module.noise_of(choice, 2 if complex_frf else 1, measurement)


def family_of(recipe: StructureRecipe, prior: JointPrior) -> StructureFamily:
    """Structures that the prior thinks possible."""
    return family_of_recipe(recipe, {n.name: n.range for n in prior.nuisances if recipe.has_quantity(n.name)})


def measurement_of(case: CaseSpec, joint: AnyJoint, setup: str = "") -> Measurement:
    """The data that a case states or makes; FRFs with those at the joint, which the paper's iteration needs.

    Of several set-ups each has noise of its own, by its name.
    """
    spec = case.data
    assert isinstance(spec, SyntheticFrfSpec | NaturalFrequenciesSpec | ModesSpec)
    if isinstance(spec, ModesSpec):
        return modes_of(spec)
    if isinstance(spec, NaturalFrequenciesSpec):
        frequency = np.array(spec.frequencies_hz)
        return FrequencyMeasurement(frequency, np.hypot(spec.sd_relative * frequency, spec.sd_hz))
    parametrisation, truth = parametrisation_of(case), true_stiffness(case, spec.truth)
    parametrisation.check(truth)
    # one virtual test: the joint's own DOFs come last, so that they leave the noise of the others as it is
    at_joint = tuple(dof for dof in joint.labels if dof not in spec.outputs)
    ports = Ports(np.array(spec.lines_hz()), spec.outputs + at_joint, spec.inputs)
    rng = generator_of(spec.noise.seed, setup) if spec.noise.added else None
    measured = synthesise_frf(
        true_family(case),
        joint,
        parametrisation.matrix(truth),
        ports,
        noise_law(spec.noise),
        spec.quantity,
        rng,
        gain=spec.truth.gain,
    )
    return replace(measured.select(spec.outputs, spec.inputs), joint_frf=measured.frf)


def generator_of(seed: int, setup: str) -> np.random.Generator:
    """Random numbers of a set-up: independent of those of others, and the same whatever others there are."""
    if not setup:
        return np.random.default_rng(seed)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(setup.encode()),)))


def true_family(spec: CaseSpec) -> StructureFamily:
    """The structure that makes the data: as analysed, but for what the truth states otherwise."""
    assert isinstance(spec.data, SyntheticFrfSpec)
    return family_of_recipe(recipe_of(spec.structure.of_truth(spec.data.truth), spec.data))


def noise_law(spec: NoiseSpec) -> NoiseLaw:
    """Law of the noise of synthetic data."""
    if spec.coherence is not None and spec.averages is not None:
        return CoherenceNoise(spec.coherence, spec.averages, spec.floor)
    return RelativeNoise(spec.relative, spec.floor)


def stiffness_of(spec: StiffnessSpec) -> Array:
    """(k11, k12, k22), shape (3,)."""
    return np.array([getattr(spec, quantity.name) for quantity in COUPLED])
