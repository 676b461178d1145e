"""Everything that defines an inference: structure, joint, data and prior."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf import NaturalFrequencies, Ports, ReceptanceModel, receptance_model
from jointbayes.inference.likelihood import likelihood_of
from jointbayes.inference.log_posterior import ExtraLogLikelihood, LogPosterior
from jointbayes.inference.noise.base import NoiseModel
from jointbayes.inference.prior import JointPrior
from jointbayes.inference.residuals import ResidualKind
from jointbayes.joint import (
    Joint,
    Parametrisation,
    Quantity,
    check_positive_semidefinite,
    is_positive_semidefinite,
    joint_matrix,
)
from jointbayes.measurement import FrfMeasurement, Measurement
from jointbayes.structure import Structure, StructureFamily, as_family, is_mode_frequency

__all__ = ["Problem"]


@dataclass(frozen=True, eq=False)
class Problem:
    """A joint to be identified from a measurement.

    Parameters
    ----------
    structure
        Structure without the joint, or a family of them where its quantities are uncertain.
    joint
        Where the joint acts.
    measurement
        FRFs or natural frequencies with their noise.
    prior
        Prior over all that is uncertain; carries the parametrisation of the joint.
    noise
        How residuals of FRFs are distributed; None is Gaussian noise of the measurement's variance.
    residual_kind
        What is compared: ``"complex"`` FRFs or their ``"log_magnitude"``.
    initial
        First guess of (k11, k12, k22), shape (3,); by default the middle of the prior.
    extra_log_likelihood
        A further term of the log likelihood: a function of θ, shape (n, d) with the coordinates `names`, that gives
        shape (n,), −inf where impossible. For what else is known of the joint: a static test, another set-up.
    name
        Short name, by which its results are known.

    Raises
    ------
    ModelError
        If the first guess is not positive semidefinite.
    """

    structure: Structure | StructureFamily
    joint: Joint
    measurement: Measurement
    prior: JointPrior
    noise: NoiseModel | None = None
    residual_kind: ResidualKind = "complex"
    initial: ArrayLike | None = None
    extra_log_likelihood: ExtraLogLikelihood | None = None
    name: str = "problem"

    def __post_init__(self) -> None:
        if self.initial is not None:
            check_positive_semidefinite(self.initial)

    def __repr__(self) -> str:
        other_side = ", ".join(self.joint.against) or "ground"
        return (
            f"Problem(joint {', '.join(self.joint.dofs)} to {other_side}; unknown: {', '.join(self.names)}; "
            f"{self.structure!r}; {self.measurement!r})"
        )

    def __str__(self) -> str:
        other_side = ", ".join(self.joint.against) or "ground"
        priors = zip(self.prior.labels, self.prior.all_marginals, strict=True)
        lines = (
            f"structure: {self.structure!r}",
            f"joint: {', '.join(self.joint.dofs)} to {other_side}",
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
            self.structures,
            self.joint,
            self.measurement,
            gain="gain" in self.prior.names,
            noise=self.noise,
            kind=self.residual_kind,
        )
        return LogPosterior(self.prior, likelihood, self.extra_log_likelihood)

    @cached_property
    def structures(self) -> StructureFamily:
        """The structures without the joint that forward models are made of."""
        return as_family(self.structure)

    @cached_property
    def structures_of_data(self) -> StructureFamily:
        """The same, exact at the joint and the measured DOFs up to the highest frequency of the data."""
        joint, measured = self.joint.dofs + self.joint.against, self.measurement
        if isinstance(measured, FrfMeasurement):
            return self.structures.at((*joint, *measured.frf.outputs, *measured.frf.inputs), measured.top_hz)
        return self.structures.at(joint, self.structures.reach_hz(measured.frequency_hz.size))

    @property
    def most_modes(self) -> int:
        """Natural frequencies that the model of the data has whatever the joint, also a rigid one."""
        return self.structures_of_data.nominal.n_dofs - len(self.joint.dofs)

    @property
    def first_guess(self) -> NDArray[np.float64]:
        """(k11, k12, k22), shape (3,), from which a search starts: `initial`, or the middle of the prior."""
        if self.initial is not None:
            return np.asarray(self.initial, dtype=float)
        middle = self.prior.stiffness(self.prior.mean)
        # independent priors may have their middle where no joint is: an uncoupled one of these springs is possible
        return middle if is_positive_semidefinite(middle) else middle * np.array([1.0, 0.0, 1.0])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all coordinates: the joint's, then those of what else is uncertain."""
        return self.prior.names

    @property
    def parametrisation(self) -> Parametrisation:
        """How θ and (k11, k12, k22) belong together."""
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
        return receptance_model(self.structures, self.joint, ports)

    def structural(self, factors: ArrayLike) -> NDArray[np.float64]:
        """Those of the nuisances' factors (..., q) that concern the structure, shape (..., f)."""
        count = len(self.structures.names)
        return np.asarray(factors, dtype=float)[..., :count]

    def natural_frequencies_hz(
        self, stiffness: ArrayLike, count: int, factors: ArrayLike | None = None, *, of_model: bool = False
    ) -> NDArray[np.float64]:
        """Lowest natural frequencies, shape (n, count), Hz, for stiffness (n, 3) or (3,).

        At the nominal structure, or at factors (n, q) of the nuisances; `of_model` without the errors that natural
        frequencies themselves are given by ``mode_frequency_1`` and so on.
        """
        model = NaturalFrequencies(self.structures, self.joint, count)
        if factors is None:
            return model.frequency_hz(joint_matrix(stiffness))
        structural = self.structural(factors)
        if of_model:
            named = np.array([is_mode_frequency(name) for name in self.structures.names], dtype=bool)
            structural = np.where(named, 1.0, structural)
        return model.frequency_hz(joint_matrix(stiffness), structural)
