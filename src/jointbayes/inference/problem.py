"""Everything that defines an inference: structure, joint, data and prior."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf import NaturalFrequencies
from jointbayes.inference.likelihood import likelihood_of
from jointbayes.inference.log_posterior import LogPosterior
from jointbayes.inference.prior import JointPrior
from jointbayes.joint import Joint, Parametrisation, joint_matrix
from jointbayes.measurement import Measurement
from jointbayes.structure import Structure

__all__ = ["Problem"]


@dataclass(frozen=True)
class Problem:
    """A joint to be identified from a measurement.

    Parameters
    ----------
    structure
        Structure without the joint.
    joint
        Where the joint acts.
    measurement
        FRFs or natural frequencies with their noise.
    prior
        Prior over the joint's coordinates; carries the parametrisation.
    """

    structure: Structure
    joint: Joint
    measurement: Measurement
    prior: JointPrior

    @cached_property
    def log_posterior(self) -> LogPosterior:
        """Posterior density over θ.

        Raises
        ------
        ModelError
            If the measurement names a DOF that the structure does not have.
        """
        return LogPosterior(self.prior, likelihood_of(self.structure, self.joint, self.measurement))

    @property
    def parametrisation(self) -> Parametrisation:
        """How θ and (k11, k12, k22) belong together."""
        return self.prior.parametrisation

    def natural_frequencies_hz(self, stiffness: ArrayLike, count: int) -> NDArray[np.float64]:
        """Lowest natural frequencies, shape (n, count), Hz, for stiffness (n, 3) or (3,)."""
        model = NaturalFrequencies(self.structure, self.joint, count)
        return model.frequency_hz(joint_matrix(stiffness))
