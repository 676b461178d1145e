"""From the set-ups of a case to its problem: what they share once, what each has for itself with its name before it.

A case of one test is that of one set-up without a name.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jointbayes.case.case_text import CaseText
from jointbayes.case.spec.joint_table import JointSpec
from jointbayes.case.spec.prior_tables import FactorPriorSpec
from jointbayes.case.spec.structure_table import StructureBase
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.errors import MeasurementError, ModelError
from jointbayes.frf import AnyStructure, MeasuredBody, NaturalFrequencies, Substructures, rigid_body_modes
from jointbayes.identification.resonances import resonances_hz
from jointbayes.inference import (
    AssemblyScatter,
    JointPrior,
    Level,
    Marginal,
    NoiseModel,
    Nuisance,
    Problem,
    Test,
    Uniform,
)
from jointbayes.joint import COUPLED, RIGID, AnyJoint, Coordinate, Parametrisation, blocks_of
from jointbayes.joint.quantities import is_rotation_unit, prefixed
from jointbayes.structure import Body, StructureRecipe, family_of_recipe
from vibrecords import Data
from vibrecords.arrays import Array

#: Bounds of the default prior, and the default first guess of k11, relative to the beam's own stiffnesses. At its lower
#: one no spring moves an elastic frequency further from that without it than a model's usual error, at the upper ones
#: all are that near those of a rigid joint, so that both are inside: 0.1 EI/L would raise that of a free beam by 0.7 %.
DEFAULT_PRIOR_FACTORS = 0.1, 1e6
DEFAULT_ROTATION_FACTORS = 0.01, 1e6
DEFAULT_GUESS_FACTOR = 1e3
#: Bounds of the default priors of a loss factor, and of a dashpot relative to the beam's own stiffness times a second.
DEFAULT_LOSS = 1e-4, 1.0
DEFAULT_DASHPOT_FACTORS = 1e-6, 100.0

#: How well material and length are known in a workshop, where the case takes them as exactly known.
WORKSHOP_SD_PERCENT = {"youngs_modulus": 3.0, "density": 1.0, "length": 0.5}
_ACCELEROMETER_SD_PERCENT = 5.0
_ABOVE_RIGID = 1.15  # a measured mode so far above that of a rigid joint cannot be the same mode


@dataclass(frozen=True, eq=False)
class CaseSetup:
    """One set-up of a case, built as far as it stands alone.

    Parameters
    ----------
    name
        Name; empty of a case of one test.
    source, spec
        Its tables: the rest of the file with what the set-up changes.
    recipe, bodies
        The structure, and bodies of it that are given by their measured FRFs.
    joint, data
        Where the joints act, and the data.
    noise, of_noise
        How the residuals are distributed, and the priors of its parameters.
    apart
        Data that are left out of the estimate and predicted, if any.
    """

    name: str
    source: CaseText
    spec: CaseSpec
    recipe: StructureRecipe
    bodies: tuple[MeasuredBody, ...]
    joint: AnyJoint
    data: Data
    noise: NoiseModel
    of_noise: tuple[Nuisance, ...]
    apart: Data | None = None

    @cached_property
    def structure(self) -> AnyStructure:
        """The structures that its priors think possible."""
        ranges = {n.name: n.range for n, _ in quantities_of(self.spec) if self.recipe.has_quantity(n.name)}
        family = family_of_recipe(self.recipe, ranges)
        if not self.bodies:
            return family
        return Substructures(family, self.bodies, next(iter(self.spec.bodies.values())).propagate)

    @property
    def level(self) -> Level | None:
        """Level of the test, if it has one."""
        stated, of = self.spec.setups.get(self.name), self.spec.level
        if of is None or stated is None or stated.level is None:
            return None
        return Level(stated.level, of.name, of.unit)

    def with_workshop_uncertainty(self, largest: float) -> "CaseSetup":
        """The same with material, length and damping uncertain as well, where the case takes them as exactly known.

        Parameters
        ----------
        largest
            Largest damping ratio of all set-ups.
        """
        spec = self.spec
        uncertain = spec.uncertain.model_copy(update=workshop_priors(spec, self.data, largest))
        return replace(self, spec=spec.model_copy(update={"uncertain": uncertain}))

    def named_nuisances(self) -> tuple[list[Nuisance], list[Nuisance]]:
        """Uncertain quantities, and those of the noise, by their names in the prior."""
        rest = [
            replace(nuisance, name=prefixed(self.name, nuisance.name)) if of_setup else nuisance
            for nuisance, of_setup in quantities_of(self.spec)
        ]
        owner = self.name if self.spec.noise.own else ""
        return rest, [replace(nuisance, name=prefixed(owner, nuisance.name)) for nuisance in self.of_noise]


def prior_of(setups: Sequence[CaseSetup]) -> tuple[JointPrior, Array]:
    """Priors on the joints' coordinates and on all else that is uncertain; and the first guess of the joints, (q,).

    Raises
    ------
    ModelError
        If set-ups share a quantity of which they state other priors.
    """
    kinds: dict[str, Parametrisation | str] = {}
    marginals: list[Marginal] = []
    guesses: list[Array] = []
    for setup in setups:
        for name, joint in setup.spec.all_joints.items():
            named, owner = setup.spec.joint_of_setup(setup.name, name)
            if named in kinds:
                continue
            kinds[named] = owner if named != owner else joint.parametrisation_object
            if named == owner:
                sizes = own_stiffnesses(joint, setup.spec.structure, family_of_recipe(setup.recipe), setup.data)
                extent = setup.recipe.extent
                priors = setup.spec.priors_of(name)
                of_joint = [
                    getattr(priors, axis.name).marginal() if priors else _default_marginal(axis, sizes, extent)
                    for axis in joint.coordinates
                ]
                marginals += of_joint
                guesses.append(guess_of(joint, sizes, of_joint))
    nuisances: dict[str, Nuisance] = {}
    of_noise: dict[str, Nuisance] = {}
    for setup in setups:
        for named_here, among in zip(setup.named_nuisances(), (nuisances, of_noise), strict=True):
            for nuisance in named_here:
                among[nuisance.name] = _shared(among.get(nuisance.name, nuisance), nuisance, setup.name)
    every = sorted(nuisances.values(), key=lambda n: n.name.rpartition(".")[2] == "gain")
    prior = JointPrior(blocks_of(kinds), tuple(marginals), (*every, *of_noise.values()), _scatters(setups))
    return prior, np.concatenate([[], *guesses])


def _scatters(setups: Sequence[CaseSetup]) -> tuple[AssemblyScatter, ...]:
    """What scatters between assemblies: each stiffness of a joint that is each set-up's own, about a mean a level."""
    groups: dict[str, dict[float | None, list[str]]] = {}
    stated = setups[0].spec.assembly
    for setup in setups if stated is not None else ():
        for name, joint in setup.spec.stating_joints.items():
            named, _ = setup.spec.joint_of_setup(setup.name, name)
            level = None if setup.level is None else setup.level.value
            for axis in joint.coordinates if joint.own else ():
                if axis.logarithmic:
                    of_level = groups.setdefault(prefixed(name, axis.name), {}).setdefault(level, [])
                    of_level.append(prefixed(named, axis.name))
    several = {name: [tuple(g) for g in by_level.values() if len(g) > 1] for name, by_level in groups.items()}
    return tuple(
        AssemblyScatter(name, tuple(among), stated.scatter, stated.scatter_factor)
        for name, among in several.items()
        if stated is not None and among
    )


def default_priors_of(specs: Mapping[str, CaseSpec]) -> frozenset[str]:
    """Coordinates of joints whose prior no one stated, by their names in the prior of all set-ups."""
    return frozenset(
        prefixed(spec.joint_of_setup(setup, name)[0], axis.name)
        for setup, spec in specs.items()
        for name, joint in spec.stating_joints.items()
        if spec.priors_of(name) is None
        for axis in joint.coordinates
    )


def _shared(first: Nuisance, other: Nuisance, setup: str) -> Nuisance:
    """A quantity that set-ups share; where they state other values for it, one factor on each of these."""
    if first.prior != other.prior:
        raise ModelError(
            f"{other.name}: found another prior in set-up {setup} than in those before it; expected one for all; add "
            "own = true, or state one"
        )
    if (first.unit, first.nominal) == (other.unit, other.nominal):
        return first
    return Nuisance(first.name, "× stated", 1.0, first.prior)


def problem_of(setups: Sequence[CaseSetup], name: str) -> Problem:
    """The problem of a case.

    Raises
    ------
    ModelError
        If set-ups share a quantity of which they state other priors.
    """
    prior, guess = prior_of(setups)
    prior.log_density(prior.mean[None])  # that there is a joint at all, before all lines are computed with
    tests: list[Test] = []
    left_out: list[Test] = []
    for setup in setups:
        test = Test(
            setup.name,
            setup.structure,
            setup.joint,
            setup.data,
            setup.noise,
            setup.spec.noise.residuals,
            setup.level,
        )
        (left_out if setup.spec.leaves_out(setup.name) else tests).append(test)
        if setup.apart is not None:
            noise = setup.noise.fitted_to(setup.apart, setup.noise.parts)  # type: ignore[arg-type]  # of its kind
            left_out.append(replace(test, data=setup.apart, noise=noise))
    return Problem(tests, prior, guess, name=name, left_out=left_out)


@dataclass(frozen=True, slots=True)
class OwnStiffness:
    """A structure's stiffness by itself where one of a joint acts, and the softest joint that default priors expect."""

    size: float
    softest: float


def own_stiffnesses(joint: JointSpec, structure: StructureBase, body: Body, data: Data) -> dict[str, OwnStiffness]:
    """The structure's stiffness by itself where each stiffness and dashpot of a joint acts, by their names.

    A structure may hang on a joint far softer than itself. The spring on which its inertia m has the lowest measured
    natural frequency is then m ω²: the softest joint is expected there where the default range would not reach so far.
    Where nothing holds a mass that spring is its stiffness as well. Empty where both sides are measured bodies.
    """
    sides = [side for side in (joint.dofs, joint.against) if side and structure.absent(side[0]) is None]
    if not sides:
        return {}
    shown = resonances_hz(data)
    lowest = float(shown.min()) if shown.size else data.band_hz[0]
    sizes = {}
    for quantity in joint.quantities:
        if quantity.unit == "1":
            continue
        i, j = quantity.places[0]
        springs = [
            math.sqrt(body.own_inertia(side[i]) * body.own_inertia(side[j])) * (2 * math.pi * lowest) ** 2
            for side in sides
        ]
        size = body.own_stiffness(sides[0][i], sides[0][j]) or min(springs)
        beyond = shown.size and min(springs) < _prior_factors(quantity.unit)[0] * size
        sizes[quantity.name] = OwnStiffness(size, min(springs) if beyond else size)
    return sizes


def _prior_factors(unit: str) -> tuple[float, float]:
    return DEFAULT_ROTATION_FACTORS if is_rotation_unit(unit) else DEFAULT_PRIOR_FACTORS


def _default_marginal(axis: Coordinate, sizes: Mapping[str, OwnStiffness], length: float) -> Marginal:
    """Prior of a case that states none: far softer than the beam to far stiffer, any coupling, an arm on the beam."""
    if axis.logarithmic and axis.unit not in [quantity.unit for quantity in COUPLED]:  # a loss factor, or a dashpot
        if axis.unit == "1":
            return Uniform(*np.log(DEFAULT_LOSS))
        return Uniform(*np.log([end * sizes[axis.quantity].size for end in DEFAULT_DASHPOT_FACTORS]))
    if axis.logarithmic:
        low, high = _prior_factors(axis.unit)
        return Uniform(*np.log([low * sizes[axis.quantity].softest, high * sizes[axis.quantity].size]))
    return Uniform(*axis.bounds) if axis.bounded else Uniform(-length, length)


def guess_of(joint: JointSpec, sizes: Mapping[str, OwnStiffness], marginals: Sequence[Marginal]) -> Array:
    """First guess of the quantities of a joint, (q,): as stated, or of a coupled pair a translational spring alone.

    Joints of other kinds begin far stiffer than the structure; those between measured bodies in the middle of their
    priors.
    """
    if joint.quantities and not sizes:
        guess = joint.parametrisation_object.middle(np.array([marginal.mean for marginal in marginals]))
        return guess if joint.initial is None else np.concatenate([joint.initial.values(), guess[len(COUPLED) :]])
    if joint.initial is not None:
        guess = joint.initial.values()
    else:
        yielding = joint.stiffnesses[:1] if joint.kind == "coupled" else joint.stiffnesses
        springs = [sizes[q.name].size if q in yielding and not q.may_be_negative else 0.0 for q in joint.stiffnesses]
        guess = DEFAULT_GUESS_FACTOR * np.array(springs)
    damping = [
        math.sqrt(math.prod(DEFAULT_LOSS if q.unit == "1" else DEFAULT_DASHPOT_FACTORS))
        * (1.0 if q.unit == "1" else sizes[q.name].size)
        for q in joint.damping
    ]
    return np.concatenate([guess, damping])


def workshop_priors(spec: CaseSpec, data: Data, largest: float) -> dict[str, FactorPriorSpec]:
    """Priors on material, length, damping and accelerometers as in a workshop, where the case takes them as exact.

    One factor is on the damping ratios of all set-ups, and leaves the `largest` of them below 1.
    """
    offered, stated = spec.structure.stated, spec.uncertain.given
    usual = {name: FactorPriorSpec(sd_percent=sd) for name, sd in WORKSHOP_SD_PERCENT.items() if name in offered}
    if "length_offset" in stated:  # the error of the length is stated
        usual.pop("length", None)
    if data.frfs is not None and offered.get("accelerometer_mass", ("g", 0.0))[1] > 0:
        usual["accelerometer_mass"] = FactorPriorSpec(sd_percent=_ACCELEROMETER_SD_PERCENT)
    if data.frfs is not None and min(spec.structure.damping.values.get("damping_ratio", [0.0])) > 0:
        usual["damping_ratio"] = FactorPriorSpec(low_factor=0.1, high_factor=max(min(10.0, 0.9 / largest), 1.0))
    return {name: prior for name, prior in usual.items() if name not in (*stated, *spec.uncertain.exact)}


def quantities_of(spec: CaseSpec) -> list[tuple[Nuisance, bool]]:
    """Uncertain quantities of structure and measurement, those of the structure first; and whether a set-up's own."""
    stated = spec.structure.stated | {"gain": ("1", 1.0)}
    quantities: list[tuple[Nuisance, bool]] = []
    for name, prior in spec.uncertain.given.items():
        if name == "damping_ratio":
            ratios = spec.structure.damping.values[name]
            labels = [name] if len(ratios) == 1 else [f"{name}_{i + 1}" for i in range(len(ratios))]
            each = [Nuisance(n, "1", r, prior.marginal()) for n, r in zip(labels, ratios, strict=True)]
        else:
            unit, value = stated[name]
            each = [Nuisance(name, unit, value, prior.marginal(value))]
        quantities += [(nuisance, prior.own) for nuisance in each]
    return sorted(quantities, key=lambda quantity: quantity[0].name == "gain")


def require_lowest(spec: CaseSpec, recipe: StructureRecipe, joint: AnyJoint, measured: Data) -> None:
    """Refuse measured modes that cannot be the model's lowest ones, where the case takes them for these.

    No joint is stiffer than a rigid one, so that a mode far above that of a rigid joint is a later one.

    Raises
    ------
    MeasurementError
        If natural frequencies, or damping ratios mode by mode, are taken from the data and a lower mode was missed.
    """
    modes = measured.provenance.modes if measured.provenance else ()
    if not modes or not (spec.structure.damping.measured or measured.modes is not None):
        return
    if measured.modes is not None and measured.shown_frfs is not None:  # a run read them off FRFs, and counted them
        return
    family = family_of_recipe(recipe)
    count = min(len(modes), family.n_dofs - rigid_body_modes(family, joint) - joint.size)
    if count < 1:  # nothing moves where the joint does not
        return
    rigid = NaturalFrequencies(family, joint, count).frequency_hz(np.eye(joint.size) * RIGID)[0]
    for number, (mode, highest) in enumerate(zip(modes, rigid, strict=False), 1):
        if mode.frequency_hz > _ABOVE_RIGID * highest:
            raise MeasurementError(
                f"found mode {number} at {mode.frequency_hz:.4g} Hz; expected {highest:.4g} Hz at most "
                f"({'rigid joint' if joint.size else 'free structure'}); correct Young's modulus, density, length or "
                "section, or lower f_min_hz if a mode was missed"
            )
