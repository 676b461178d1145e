"""What is asked of a posterior by the functions beside it, which `jointbayes.posterior.posterior.Posterior` calls."""

from collections.abc import Mapping
from typing import Protocol

from jointbayes.posterior.checks import PredictiveCheck
from jointbayes.posterior.diagnosis import Diagnosis
from jointbayes.posterior.identifiability import Identifiability
from jointbayes.posterior.limits import LikelihoodRegion
from jointbayes.posterior.model_errors import InferredError, MeshCheck, NoiseOfBodies
from jointbayes.posterior.prediction import LeftOut
from jointbayes.posterior.solutions import CheckedDraws, Solutions
from jointbayes.posterior.widened import WidenedPosterior
from vibrecords.arrays import Array


class AnyPosterior(CheckedDraws, Protocol):
    """Draws with what is computed and found of them; each member is described by the class."""

    @property
    def mode_log_density(self) -> float:
        """Log density of the best draw refined."""

    @property
    def mode(self) -> Mapping[str, float]:
        """Joint posterior mode (of the density over θ) in physical units, by name."""

    @property
    def mode_distance(self) -> float:
        """Largest distance of joint mode and MAP in Laplace standard deviations: 0 where they agree."""

    @property
    def mode_agrees(self) -> bool:
        """Whether joint mode and MAP are one point: within 0.01 standard deviations, or equal in density to 0.001."""

    @property
    def at_prior_edge(self) -> tuple[str, ...]:
        """Coordinates whose mode lies on an edge of the prior's support: there the prior decides, not the data."""

    @property
    def checks(self) -> tuple[PredictiveCheck, ...]:
        """The check of each test, at a level that allows for the tests of all."""

    @property
    def diagnosis(self) -> Diagnosis:
        """How far the MAP is from the data in an engineer's measure, and what its residuals point to."""

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """The diagnosis of each test."""

    @property
    def model_error(self) -> InferredError | None:
        """The model's error in natural frequencies as it was inferred; None where there is no place for one."""

    @property
    def mesh(self) -> MeshCheck | None:
        """What the elements of the model do to the result; None where the structure is given by its matrices."""

    @property
    def noise_of_bodies(self) -> NoiseOfBodies | None:
        """What the errors of measured bodies do to the result; None where the structure is modelled throughout."""

    @property
    def solutions(self) -> Solutions:
        """What each of several modes says; of one mode itself."""

    @property
    def widened(self) -> WidenedPosterior | None:
        """The posterior with every prior of the joint a decade wider; None where that changes nothing."""

    @property
    def likelihood_region(self) -> LikelihoodRegion:
        """Joints that fit nearly as well as the best, for likelihood-ratio limits, which it keeps once found."""

    def prior_values(self, name: str) -> Array:
        """Draws of one stiffness from the prior, shape (1, draws)."""

    def by_ensemble(self, name: str) -> Array:
        """All draws of one quantity with walkers of an ensemble together, shape (ensembles, draws, walkers)."""

    def interval(self, name: str, probability: float = 0.95) -> tuple[float, float]:
        """Equal-tailed credible interval of one stiffness, in its unit."""

    def thinned(self, most: int) -> Array:
        """At most so many draws of θ, evenly spaced over all chains, shape (n, d)."""

    def predict_natural_frequencies(self, count: int = 3, max_draws: int = 4000, *, test: str | None = None) -> Array:
        """Natural frequencies of posterior draws, shape (draws, count), Hz."""

    def predict_left_out(self) -> tuple[LeftOut, ...]:
        """What was left out of the data, and what the draws predict a measurement of it to show."""

    def has_default_prior(self, name: str) -> bool:
        """Whether the range of a quantity is the default one, which the case does not state."""

    def verdict(self, name: str) -> Identifiability:
        """Median, 95 % interval with errors, verdict with its reason and what it takes as exact."""
