"""From the set-ups of a case to its problem: what they share once, what each has for itself with its name before it.

A case of one test is that of one set-up without a name.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jointbayes.arrays import Array
from jointbayes.case.build import guess_of, joint_marginals, kind_of, own_stiffnesses, quantities_of, workshop_priors
from jointbayes.case.case_text import CaseText
from jointbayes.case.schema.case import CaseSpec
from jointbayes.case.schema.joint import NamedJointSpec
from jointbayes.case.schema.setups import joint_of_setup
from jointbayes.errors import ModelError
from jointbayes.frf import AnyStructure, MeasuredBody, Substructures
from jointbayes.inference import JointPrior, Level, Marginal, NoiseModel, Nuisance, Problem, Setup
from jointbayes.joint import AnyJoint, Parametrisation, blocks_of
from jointbayes.joint.quantities import prefixed
from jointbayes.measurement import Measurement
from jointbayes.structure import StructureRecipe, family_of_recipe


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
    joint, measurement
        Where the joints act, and the data.
    noise, of_noise
        How the residuals are distributed, and the priors of its parameters.
    """

    name: str
    source: CaseText
    spec: CaseSpec
    recipe: StructureRecipe
    bodies: tuple[MeasuredBody, ...]
    joint: AnyJoint
    measurement: Measurement
    noise: NoiseModel
    of_noise: tuple[Nuisance, ...]

    @cached_property
    def quantities(self) -> tuple[Nuisance, ...]:
        """Uncertain quantities of structure and measurement, by the names that its structure has for them."""
        return tuple(nuisance for nuisance, _ in quantities_of(self.spec, self.recipe, self.measurement))

    @cached_property
    def structure(self) -> AnyStructure:
        """The structures that its priors think possible."""
        ranges = {n.name: n.range for n in self.quantities if self.recipe.has_quantity(n.name)}
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
        uncertain = spec.uncertain.model_copy(update=workshop_priors(spec, self.measurement, largest))
        return replace(self, spec=spec.model_copy(update={"uncertain": uncertain}))

    def named_nuisances(self) -> tuple[list[Nuisance], list[Nuisance]]:
        """Uncertain quantities, and those of the noise, by their names in the prior."""
        rest = [
            replace(one, name=prefixed(self.name, one.name)) if own else one
            for one, own in quantities_of(self.spec, self.recipe, self.measurement)
        ]
        own = self.name if self.spec.noise.own else ""
        return rest, [replace(one, name=prefixed(own, one.name)) for one in self.of_noise]


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
    for one in setups:
        for name, joint in one.spec.all_joints.items():
            named, owner = joint_of_setup(one.name, name, one.spec)
            if named in kinds:
                continue
            kinds[named] = owner if named != owner else kind_of(joint)
            if named == owner:
                own = own_stiffnesses(joint, one.spec.structure, one.recipe, one.measurement)
                priors = joint_marginals(one.spec, joint, own, one.recipe.extent)
                marginals += priors
                guesses.append(guess_of(joint, own, priors))
    nuisances: dict[str, Nuisance] = {}
    of_noise: dict[str, Nuisance] = {}
    for one in setups:
        for found, among in zip(one.named_nuisances(), (nuisances, of_noise), strict=True):
            for nuisance in found:
                among[nuisance.name] = _shared(among.get(nuisance.name, nuisance), nuisance, one.name)
    every = sorted(nuisances.values(), key=lambda n: n.name.rpartition(".")[2] == "gain")
    return JointPrior(blocks_of(kinds), tuple(marginals), (*every, *of_noise.values())), np.concatenate(guesses)


def default_priors_of(specs: Mapping[str, CaseSpec]) -> frozenset[str]:
    """Coordinates of joints whose prior no one stated, by their names in the prior of all set-ups."""
    return frozenset(
        prefixed(joint_of_setup(setup, name, spec)[0], axis.name)
        for setup, spec in specs.items()
        for name, joint in spec.all_joints.items()
        if name not in spec.sharing and (joint.prior if isinstance(joint, NamedJointSpec) else spec.prior) is None
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
    if [one.name for one in setups] == [""]:
        (alone,) = setups
        return Problem(
            alone.structure,
            alone.joint,
            alone.measurement,
            prior,
            alone.noise,
            alone.spec.noise.residuals,
            guess,
            name=name,
        )
    each = [
        Setup(one.name, one.structure, one.joint, one.measurement, one.noise, one.spec.noise.residuals, one.level)
        for one in setups
    ]
    return Problem(setups=tuple(each), prior=prior, initial=guess, name=name)
