"""Mixture of Student-t distributions, to propose from where one bell does not do."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import SamplingError
from jointbayes.sampling.proposal.student_t import StudentT

__all__ = ["StudentMixture"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StudentMixture:
    """Several Student-t distributions, each with a weight.

    Parameters
    ----------
    components : tuple of StudentT
        Of one dimension.
    weights : ndarray, shape (components,)
        Probability of each; above 0 and 1 in sum.

    Raises
    ------
    jointbayes.errors.SamplingError
        If there is no component, their dimensions differ, or the weights are no probabilities.

    Examples
    --------
    >>> bell = StudentT(np.zeros(1), np.eye(1), 1.0)
    >>> StudentMixture((bell, bell), np.array([0.25, 0.75])).log_density(np.zeros((1, 1)))
    array([-1.14472989])
    """

    components: tuple[StudentT, ...]
    weights: Array
    _means: Array = field(init=False, repr=False)
    _factors: Array = field(init=False, repr=False)
    _dof: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        weights = np.array(self.weights, dtype=np.float64)
        sizes = {component.mean.size for component in self.components}
        if len(sizes) != 1 or weights.shape != (len(self.components),):
            raise SamplingError(
                f"Student-t mixture: found {len(self.components)} components of dimensions {sorted(sizes)} and weights "
                f"of shape {weights.shape}; expected one dimension and a weight for each; correct them"
            )
        if not ((weights > 0).all() and abs(weights.sum() - 1.0) < 1e-9):
            raise SamplingError(
                f"Student-t mixture: found weights {weights.tolist()}; expected all above 0 and 1 in sum; correct them"
            )
        derived = {
            "weights": weights / weights.sum(),
            "_means": np.array([c.mean for c in self.components]),
            "_factors": np.array([np.linalg.cholesky(c.scale) for c in self.components]),
            "_dof": np.array([c.dof for c in self.components]),
        }
        for name, array in derived.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def draw(self, random: "np.random.Generator | np.random.RandomState", n: int) -> Array:
        """Independent draws, shape (n, d), by either kind of generator; their order says nothing of the components."""
        which = random.choice(len(self.weights), n, p=self.weights)
        normal = random.standard_normal((n, self._means.shape[1]))
        stretch = np.sqrt(self._dof[which] / random.chisquare(self._dof[which]))
        draws: Array = self._means[which] + np.einsum("nij,nj->ni", self._factors[which], normal) * stretch[:, None]
        return draws

    def log_densities(self, x: Array) -> Array:
        """Log of weight times density of each component, shape (n, components), at x, shape (n, d)."""
        each = np.stack([component.log_density(x) for component in self.components], axis=1)
        weighted: Array = each + np.log(self.weights)
        return weighted

    def log_density(self, x: Array) -> Array:
        """Log of the normalised density, shape (n,), at x, shape (n, d)."""
        each = self.log_densities(x)
        top = each.max(axis=1)
        density: Array = top + np.log(np.exp(each - top[:, None]).sum(axis=1))
        return density
