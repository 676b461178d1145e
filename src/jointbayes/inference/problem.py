"""Everything that defines an inference: structure, joint, data and prior."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf import (
    AnyStructure,
    FrfSet,
    MeasuredBody,
    NaturalFrequencies,
    Ports,
    ReceptanceModel,
    Substructures,
    receptance_model,
)
from jointbayes.frf.measured_body import substructures
from jointbayes.inference.likelihood import likelihood_of
from jointbayes.inference.log_posterior import ExtraLogLikelihood, LogPosterior
from jointbayes.inference.noise.base import NoiseModel
from jointbayes.inference.prior import JointPrior
from jointbayes.inference.residuals import ResidualKind
from jointbayes.joint import AnyJoint, Joint, Parametrisation, Quantity, as_joints
from jointbayes.measurement import FrfMeasurement, Measurement
from jointbayes.structure import StructureFamily, is_mode_frequency

__all__ = ["Problem"]


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
        FRFs or natural frequencies with their noise.
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

    Raises
    ------
    ModelError
        If the parametrisation is of another number of DOFs than the joints have, or the first guess is not positive
        semidefinite.
    """

    structure: AnyStructure
    joint: AnyJoint | Sequence[Joint]
    measurement: Measurement
    prior: JointPrior
    noise: NoiseModel | None = None
    residual_kind: ResidualKind = "complex"
    initial: ArrayLike | None = None
    extra_log_likelihood: ExtraLogLikelihood | None = None
    name: str = "problem"

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint", as_joints(self.joint))
        joint, parametrisation = self.joints, self.parametrisation
        if parametrisation.size != joint.size:
            raise ModelError(
                f"problem: found a prior of joints with {parametrisation.size} DOFs and joints with {joint.size}; "
                "expected a parametrisation of each joint; make it with as many DOFs"
            )
        if self.initial is not None:
            parametrisation.check(self.initial)

    def __repr__(self) -> str:
        return (
            f"Problem(joint {self.joint}; unknown: {', '.join(self.names)}; {self.structure!r}; {self.measurement!r})"
        )

    def __str__(self) -> str:
        priors = zip(self.prior.labels, self.prior.all_marginals, strict=True)
        lines = (
            f"structure: {self.structure!r}",
            f"joint: {self.joint}",
            f"data: {self.measurement!r}",
            f"noise: {'Gaussian' if self.noise is None else type(self.noise).__name__}, residuals {self.residual_kind}",
            *(f"prior of {label}: {marginal!r}" for label, marginal in priors),
            *(["further term of the log likelihood: a function of one's own"] if self.extra_log_likelihood else []),
        )
        return "\n".join(lines)

    @cached_property
    def log_posterior(self) -> LogPosterior:
        """Posterior density over θ.

        Raises
        ------
        ModelError
            If the measurement names a DOF that the structure does not have.
        """
        likelihood = likelihood_of(
            self.structure,
            self.joints,
            self.measurement,
            gain="gain" in self.prior.names,
            noise=self.noise,
            kind=self.residual_kind,
        )
        return LogPosterior(self.prior, likelihood, self.extra_log_likelihood)

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

    def with_structures(self, family: StructureFamily) -> "Problem":
        """The same problem with other modelled structures."""
        whole = substructures(self.structure)
        return replace(self, structure=replace(whole, modelled=family) if whole.measured else family)

    @property
    def measured_bodies(self) -> tuple[MeasuredBody, ...]:
        """Bodies given by their measured FRFs; where there are any the assembled structure has no modes."""
        return substructures(self.structure).measured

    @property
    def ignores_noise_of_bodies(self) -> bool:
        """Whether measured bodies are taken for exact, so that intervals are too narrow."""
        return isinstance(self.structure, Substructures) and not self.structure.propagate

    @cached_property
    def structures_of_data(self) -> StructureFamily:
        """The same, exact at the joint and the measured DOFs up to the highest frequency of the data."""
        joint, measured = self.joints.labels, self.measurement
        if isinstance(measured, FrfMeasurement):
            dofs = (*joint, *measured.frf.outputs, *measured.frf.inputs)
            return substructures(self.structure).at(dofs, measured.top_hz).family
        return self.structures.at(joint, self.structures.reach_hz(measured.frequency_hz.size))

    @property
    def most_modes(self) -> int:
        """Natural frequencies that the model of the data has whatever the joint, also a rigid one; 0 without modes."""
        if self.measured_bodies:
            return 0
        return self.structures_of_data.nominal.n_dofs - self.joints.size

    @property
    def first_guess(self) -> NDArray[np.float64]:
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
        """The joint's stiffnesses: names, units and places in K^J, in the order of `JointPrior.stiffness`."""
        return self.parametrisation.quantities

    def receptance_model(self, ports: Ports) -> ReceptanceModel:
        """Forward model for other lines and DOFs.

        Raises
        ------
        ModelError
            If a DOF does not exist.
        """
        return receptance_model(self.structure, self.joints, ports)

    def structural(self, factors: ArrayLike) -> NDArray[np.float64]:
        """Those of the nuisances' factors (..., q) that concern the structure, shape (..., f)."""
        count = len(self.structures.names)
        return np.asarray(factors, dtype=float)[..., :count]

    def gain(self, factors: ArrayLike) -> NDArray[np.float64]:
        """Factor on all measured FRFs, shape (...), among the nuisances' factors (..., q); ones where it is certain."""
        known, names = np.asarray(factors, dtype=float), [nuisance.name for nuisance in self.prior.nuisances]
        return known[..., names.index("gain")] if "gain" in names else np.ones(known.shape[:-1])

    def natural_frequencies_hz(
        self, stiffness: ArrayLike, count: int, factors: ArrayLike | None = None, *, of_model: bool = False
    ) -> NDArray[np.float64]:
        """Lowest natural frequencies, shape (n, count), Hz, for quantities of the joint (n, q) or (q,).

        At the nominal structure, or at factors (n, q) of the nuisances; `of_model` without the errors that natural
        frequencies themselves are given by ``mode_frequency_1`` and so on. Shape (n, 0) where a body is given by its
        FRFs: the assembled structure then has no modes that anybody knows.
        """
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
