"""Everything that defines an inference: structure, joint, data and prior."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.frf import (
    AnyStructure,
    FrfSet,
    MeasuredBody,
    NaturalFrequencies,
    Ports,
    ReceptanceModel,
    receptance_model,
    rigid_body_modes,
)
from jointbayes.frf.measured_body import substructures
from jointbayes.inference.likelihood import likelihood_of
from jointbayes.inference.likelihood_base import Likelihood, ResidualKind
from jointbayes.inference.log_posterior import ExtraLogLikelihood, LogPosterior
from jointbayes.inference.noise.base import NoiseModel
from jointbayes.inference.prior import JointPrior
from jointbayes.inference.setup import (
    Setup,
    SetupsLikelihood,
    Term,
    arranged,
    columns_of_names,
    own_name,
    require_own_bodies,
)
from jointbayes.joint import AnyJoint, Joint, Parametrisation, Quantity, as_joints
from jointbayes.measurement import FrfMeasurement, Measurement
from jointbayes.structure import StructureFamily, is_mode_frequency


@dataclass(frozen=True, eq=False)
class Problem:
    """A joint to be identified from a measurement.

    Parameters
    ----------
    structure
        Structure without the joint, a family of them where its quantities are uncertain, or `Substructures` where
        bodies of it are given by their measured FRFs.
    joint
        Where the joint acts; several in a sequence, each with a name.
    measurement
        FRFs, natural frequencies or modes with their noise.
    prior
        Prior over all that is uncertain; carries the parametrisation of the joint, or of all, see
        `jointbayes.joint.blocks_of`.
    noise
        How residuals of FRFs are distributed; None is Gaussian noise of the measurement's variance.
    residual_kind
        What is compared: ``"complex"`` FRFs or their ``"log_magnitude"``.
    initial
        First guess of the joint's quantities, shape (q,); by default the middle of the prior.
    extra_log_likelihood
        A further term of the log likelihood: a function of θ, shape (n, d) with the coordinates `names`, that gives
        shape (n,), −inf where impossible. For what else is known of the joint: a static test, another set-up.
    name
        Short name, by which its results are known.
    setups
        Several tests of the same joints, each a `Setup`, in place of structure, joint, measurement, noise and kind of
        residual: these are then those of the first. Quantities whose names begin with that of a set-up are its own.
    setup
        Of a problem that is one of several, see `parts`: the name of its set-up.

    Raises
    ------
    ModelError
        If joints and parametrisation do not belong together, a set-up has a name twice or a quantity of the prior no
        set-up, or the first guess is not positive semidefinite.
    """

    structure: AnyStructure = None  # type: ignore[assignment]  # of the first set-up, if there are several
    joint: AnyJoint | Sequence[Joint] = None  # type: ignore[assignment]
    measurement: Measurement = None  # type: ignore[assignment]
    prior: JointPrior = None  # type: ignore[assignment]
    noise: NoiseModel | None = None
    residual_kind: ResidualKind = "complex"
    initial: ArrayLike | None = None
    extra_log_likelihood: ExtraLogLikelihood | None = None
    name: str = "problem"
    setups: tuple[Setup, ...] = ()
    setup: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "setups", tuple(self.setups))
        if self.setups:
            self._take_first_setup()
            require_own_bodies(self.setups)
        missing = [name for name in ("structure", "joint", "measurement", "prior") if getattr(self, name) is None]
        if missing:
            raise ModelError(
                f"problem: found no {', '.join(missing)}; expected all four, or set-ups and a prior; pass them"
            )
        object.__setattr__(self, "joint", as_joints(self.joint))
        places = [(test.name, as_joints(test.joint)) for test in self.setups] or [(self.setup, self.joints)]
        parametrisation = arranged(self.prior.parametrisation, places)
        if parametrisation != self.prior.parametrisation:
            object.__setattr__(self, "prior", replace(self.prior, parametrisation=parametrisation))
        if self.initial is not None:
            parametrisation.check(self.initial)

    def _take_first_setup(self) -> None:
        names = [setup.name for setup in self.setups]
        if len(set(names)) != len(names) or "" in names:
            raise ModelError(
                f"problem: found set-ups named {', '.join(map(repr, names))}; expected a name for each; rename them"
            )
        for name in ("structure", "joint", "measurement", "noise", "residual_kind"):
            object.__setattr__(self, name, getattr(self.setups[0], name))

    def __repr__(self) -> str:
        tests = [
            f"{'' if part is self else f'{part.setup}: '}{part.structure!r}; {part.measurement!r}"
            for part in self.parts
        ]
        return f"Problem(joint {self.joint}; unknown: {', '.join(self.names)}; {'; '.join(tests)})"

    def __str__(self) -> str:
        priors = zip(self.prior.labels, self.prior.all_marginals, strict=True)
        lines = (
            *(line for part in self.parts for line in part._lines()),
            *(f"prior of {label}: {marginal!r}" for label, marginal in priors),
            *(["further term of the log likelihood: a function of one's own"] if self.extra_log_likelihood else []),
        )
        return "\n".join(lines)

    def _lines(self) -> tuple[str, ...]:
        """What distinguishes a set-up, in words."""
        return (
            *([f"set-up: {self.setup}"] if self.setup else []),
            f"structure: {self.structure!r}",
            f"joint: {self.joint}",
            f"data: {self.measurement!r}",
            f"noise: {'Gaussian' if self.noise is None else type(self.noise).__name__}, residuals {self.residual_kind}",
        )

    @cached_property
    def parts(self) -> tuple["Problem", ...]:
        """A problem of the same unknowns for each set-up, with its data alone; this one itself if it is of one."""
        if not self.setups:
            return (self,)
        return tuple(
            replace(
                self,
                structure=setup.structure,
                joint=setup.joint,
                measurement=setup.measurement,
                noise=setup.noise,
                residual_kind=setup.residual_kind,
                extra_log_likelihood=None,
                setups=(),
                setup=setup.name,
            )
            for setup in self.setups
        )

    def part(self, setup: str | None) -> "Problem":
        """The problem of one set-up by its name; of the first, or the only one, by None.

        Raises
        ------
        ModelError
            If there is no such set-up.
        """
        for test in self.parts:
            if setup in (None, test.setup):
                return test
        names = ", ".join(test.setup for test in self.parts) or "one without a name"
        raise ModelError(f"{self.name}: found set-up {setup!r}; expected one of {names}; correct the name")

    @cached_property
    def log_posterior(self) -> LogPosterior:
        """Posterior density over θ.

        Raises
        ------
        ModelError
            If a measurement names a DOF that its structure does not have, or a quantity of the prior is that of none.
        """
        alone = not (self.setups or self.setup)
        likelihood = self._own_likelihood if alone else SetupsLikelihood(self._nuisances, self._terms())
        return LogPosterior(self.prior, likelihood, self.extra_log_likelihood)

    @cached_property
    def _own_likelihood(self) -> Likelihood:
        """Likelihood of a lone set-up, over its own quantities alone."""
        gain = own_name(self.setup, "gain", self._nuisances) is not None
        return likelihood_of(
            self.structure, self.joints, self.measurement, gain=gain, noise=self.noise, kind=self.residual_kind
        )

    def _terms(self) -> list[Term]:
        terms, row = [], 0
        for part in self.parts:
            likelihood, size = part._own_likelihood, part.joints.size
            columns = columns_of_names(part.setup, likelihood.names, self._nuisances)
            terms.append(Term(likelihood, slice(row, row + size), columns))
            row += size
        used = {int(column) for term in terms for column in term.columns}
        idle = [name for i, name in enumerate(self._nuisances) if i not in used]
        if idle and self.setups:
            raise ModelError(
                f"{self.name}: found priors of {', '.join(idle)}, on which no set-up depends; expected quantities of "
                "the set-ups; correct the names or leave them out"
            )
        return terms

    @cached_property
    def _nuisances(self) -> tuple[str, ...]:
        return tuple(nuisance.name for nuisance in self.prior.nuisances)

    @property
    def joints(self) -> AnyJoint:
        """Where the joints act."""
        return as_joints(self.joint)

    @cached_property
    def structures(self) -> StructureFamily:
        """The modelled structures without the joint."""
        return substructures(self.structure).family

    @property
    def joint_frf(self) -> FrfSet | None:
        """FRFs at the joint for the paper's iteration, which needs a structure that is modelled throughout, or None."""
        return None if self.measured_bodies else self.measurement.joint_frf

    def with_reference(self, *, solved: bool) -> "Problem":
        """The same problem with much richer elements in every set-up, see `StructureFamily.reference`."""
        richer = [part._among_bodies(part.structures.reference(solved=solved)) for part in self.parts]
        if not self.setups:
            return replace(self, structure=richer[0])
        setups = (replace(setup, structure=structure) for setup, structure in zip(self.setups, richer, strict=True))
        return replace(self, setups=tuple(setups))

    def _among_bodies(self, family: StructureFamily) -> AnyStructure:
        whole = substructures(self.structure)
        return replace(whole, modelled=family) if whole.measured else family

    @property
    def measured_bodies(self) -> tuple[MeasuredBody, ...]:
        """Bodies given by their measured FRFs; where there are any the assembled structure has no modes."""
        return substructures(self.structure).measured

    @property
    def ignores_noise_of_bodies(self) -> bool:
        """Whether measured bodies are taken for exact in any set-up, so that intervals are too narrow."""
        structures = (substructures(part.structure) for part in self.parts)
        return any(whole.measured and not whole.propagate for whole in structures)

    @cached_property
    def structures_of_data(self) -> StructureFamily:
        """The same, exact at the joint and the measured DOFs up to the highest frequency of the data."""
        joint, measured = self.joints.labels, self.measurement
        if isinstance(measured, FrfMeasurement):
            dofs = (*joint, *measured.frf.outputs, *measured.frf.inputs)
            return substructures(self.structure).at(dofs, measured.top_hz).family
        return self.structures.at((*joint, *measured.dofs), self.structures.reach_hz(max(measured.numbers)))

    @property
    def most_modes(self) -> int:
        """Natural frequencies that the model of the data has whatever the joint, also a rigid one; 0 without modes."""
        if self.measured_bodies:
            return 0
        free = self.structures_of_data.nominal
        return free.n_dofs - rigid_body_modes(free, self.joints) - self.joints.size

    @property
    def first_guess(self) -> Array:
        """Quantities of the joint, shape (q,), from which a search starts: `initial`, or the middle of the prior."""
        if self.initial is not None:
            return np.asarray(self.initial, dtype=float)
        return self.parametrisation.middle(self.prior.joint(self.prior.mean))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all coordinates: the joint's, then those of what else is uncertain."""
        return self.prior.names

    @property
    def parametrisation(self) -> Parametrisation:
        """How θ, quantities and K^J belong together."""
        return self.prior.parametrisation

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """The joint's stiffnesses: names, units and places in K^J, in the order of `JointPrior.values`."""
        return self.parametrisation.quantities

    def receptance_model(self, ports: Ports) -> ReceptanceModel:
        """Forward model for other lines and DOFs.

        Raises
        ------
        ModelError
            If a DOF does not exist.
        """
        return receptance_model(self.structure, self.joints, ports)

    def structural(self, factors: ArrayLike) -> Array:
        """Those of the nuisances' factors (..., q) that concern the structure, shape (..., f)."""
        return np.asarray(factors, dtype=float)[..., self.structural_columns]

    @cached_property
    def structural_columns(self) -> NDArray[np.intp]:
        """Which nuisances concern the structure, in the order of its quantities."""
        return columns_of_names(self.setup, self.structures.names, self._nuisances)

    def gain(self, factors: ArrayLike) -> Array:
        """Factor on measured FRFs, shape (...), at factors of the nuisances, shape (..., q); 1 where it is certain."""
        rows, name = np.asarray(factors, dtype=float), own_name(self.setup, "gain", self._nuisances)
        return np.ones(rows.shape[:-1]) if name is None else rows[..., self._nuisances.index(name)]

    def natural_frequencies_hz(
        self, stiffness: ArrayLike, count: int, factors: ArrayLike | None = None, *, of_model: bool = False
    ) -> Array:
        """Lowest natural frequencies, shape (n, count), Hz, for quantities of the joint (n, q) or (q,).

        At the nominal structure, or at factors (n, q) of the nuisances; `of_model` without the errors that natural
        frequencies themselves are given by ``mode_frequency_1`` and so on. Shape (n, 0) where a body is given by its
        FRFs: the assembled structure then has no modes that anybody knows.

        Raises
        ------
        ModelError
            If the last axis is not that of the joint's quantities.
        """
        if self.setups:
            return self.part(None).natural_frequencies_hz(stiffness, count, factors, of_model=of_model)
        if np.shape(stiffness)[-1:] != (len(self.quantities),):
            raise ModelError(
                f"natural frequencies: found an array of shape {np.shape(stiffness)}; expected the joint's quantities "
                f"along its last axis: {', '.join(quantity.name for quantity in self.quantities)}"
            )
        if self.measured_bodies:
            return np.empty((len(np.atleast_2d(np.asarray(stiffness, dtype=float))), 0))
        model = NaturalFrequencies(self.structures, self.joints, count)
        if factors is None:
            return model.frequency_hz(self.parametrisation.matrix(stiffness))
        structural = self.structural(factors)
        if of_model:
            named = np.array([is_mode_frequency(name) for name in self.structures.names], dtype=bool)
            structural = np.where(named, 1.0, structural)
        return model.frequency_hz(self.parametrisation.matrix(stiffness), structural)
