"""What the elements of the model do to a result: its predictions beside those of much richer elements."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointbayes.inference import FrfLikelihood, Problem
from jointbayes.joint import STIFFNESS_NAMES, joint_matrix

__all__ = ["LARGEST_ERROR_OF_PEAK", "LARGEST_ERROR_SD", "LARGEST_SHIFT_SD", "MeshCheck", "check_mesh"]

Array = NDArray[np.float64]

#: Largest error of a prediction that noise hides, in standard deviations of that line.
LARGEST_ERROR_SD = 0.05
#: The same for exact data, over the largest value of the FRF.
LARGEST_ERROR_OF_PEAK = 1e-7
#: A mesh that moves a stiffness by more than this many posterior standard deviations leaves no verdict on it.
LARGEST_SHIFT_SD = 0.5

_PRIOR_DRAWS = 16
_EXACT = 1e-3  # of the stated noise: data with smaller residuals have none


@dataclass(frozen=True, slots=True)
class MeshCheck:
    """Predictions of the model's elements against those of much richer ones.

    Parameters
    ----------
    kind
        ``"converged"`` or ``"paper"``, see `jointbayes.structure.ElementKind`.
    elements, order
        Number of elements and their highest polynomial order.
    error_sd
        Largest error of any predicted value at the MAP and at draws of the prior, in standard deviations of the data.
    error_of_peak
        Largest error at the MAP over the largest value of the same FRF; for natural frequencies over the frequency.
    shift_sd
        How far the elements move each stiffness, in its posterior standard deviations, to first order.
    exact_data
        Whether the data are so much closer to the model than their stated noise that they have none.
    """

    kind: str
    elements: int
    order: int
    error_sd: float
    error_of_peak: float
    shift_sd: Mapping[str, float]
    exact_data: bool

    @property
    def within(self) -> bool:
        """Whether the error stays under its bound: 1/20 of a standard deviation, 1e-7 of the peak for exact data."""
        if self.exact_data:
            return self.error_of_peak <= LARGEST_ERROR_OF_PEAK
        return self.error_sd <= LARGEST_ERROR_SD

    def moves(self, name: str) -> bool:
        """Whether the mesh moves a stiffness by more than half a posterior standard deviation."""
        return abs(self.shift_sd.get(name, 0.0)) > LARGEST_SHIFT_SD

    @property
    def sentence(self) -> str:
        """The finding in plain words, with its figures."""
        what = "of the paper's two-node elements" if self.kind == "paper" else f"elements of order {self.order} or less"
        error = (
            f"{self.error_of_peak:.1g} of the peak of the FRF"
            if self.exact_data
            else f"{self.error_sd:.1g} standard deviations of the data"
        )
        moved = ", ".join(f"{name} by {shift:+.1g}" for name, shift in self.shift_sd.items())
        sentence = f"Mesh: {self.elements} {what}; no predicted value is off by more than {error}."
        if moved:
            sentence += f" It moves {moved} posterior standard deviations."
        if not self.within:
            limit = f"{LARGEST_ERROR_OF_PEAK:.0e} of the peak" if self.exact_data else f"{LARGEST_ERROR_SD:g}"
            sentence += f" More than {limit} shows in the data."
            sentence += " Remove structure.element from the case." if self.kind == "paper" else ""
        return sentence


def check_mesh(problem: Problem, theta: Array, covariance: Array, draws: Array, seed: int) -> MeshCheck | None:
    """Compare a model's predictions with those of much richer elements.

    Parameters
    ----------
    problem
        The problem that was analysed.
    theta, covariance
        MAP, shape (d,), and its Laplace covariance, shape (d, d).
    draws
        Posterior draws of (k11, k12, k22), shape (n, 3), for their standard deviations.
    seed
        For the draws from the prior.

    Returns
    -------
    MeshCheck, or None where the structure is given by matrices, which have no mesh
    """
    found = problem.discretisation
    if found is None:
        return None
    reference = replace(problem, family=problem.structures.reference())
    prior = problem.prior.sample(np.random.default_rng([seed, 3]), _PRIOR_DRAWS)
    here, there = (_standardised(p, np.concatenate([theta[None], prior])) for p in (problem, reference))
    residual = there[0]
    return MeshCheck(
        found.kind,
        found.elements,
        found.order,
        float(np.abs(here - there).max()),
        _error_of_peak(problem, reference, theta),
        _shifts(problem, reference, theta, covariance, draws),
        bool(np.sqrt(np.mean(np.abs(residual) ** 2)) < _EXACT),
    )


def _standardised(problem: Problem, theta: Array) -> NDArray[np.inexact]:
    """Residuals in standard deviations of one part, shape (n, lines, pairs) or (n, frequencies)."""
    prior, likelihood = problem.prior, problem.log_posterior.likelihood
    z = likelihood.standardised(joint_matrix(prior.stiffness(theta)), prior.factors(theta))
    return z * np.sqrt(2) if np.iscomplexobj(z) else z


def _error_of_peak(problem: Problem, reference: Problem, theta: Array) -> float:
    """Largest error at θ over the largest value of the same FRF, or over the frequency."""
    likelihoods = [p.log_posterior.likelihood for p in (problem, reference)]
    matrix = joint_matrix(problem.prior.stiffness(theta))[None]
    factors = problem.prior.factors(theta)[None]
    here, there = (likelihood.predicted(matrix, factors)[0] for likelihood in likelihoods)
    peak = np.abs(there).max(axis=0) if isinstance(likelihoods[0], FrfLikelihood) else there
    return float((np.abs(here - there) / peak).max())


def _shifts(problem: Problem, reference: Problem, theta: Array, covariance: Array, draws: Array) -> dict[str, float]:
    """Change of each stiffness by the mesh, to first order, over its posterior standard deviation."""
    residual, jacobian = problem.log_posterior.residuals(theta)
    exact, _ = reference.log_posterior.residuals(theta)
    # where the richer elements have residual e + δ, this model's mode has moved by −Σ Jᵀ(−δ)
    moved = covariance @ (jacobian.T @ (exact - residual))
    joint = problem.prior.joint(theta)
    parametrisation = problem.parametrisation
    change = parametrisation.derivative(joint) @ moved[: joint.size]
    stiffness = parametrisation.stiffness(joint)
    shifts = {}
    for i, name in enumerate(STIFFNESS_NAMES):
        values = draws[:, i]
        one_sign = bool((values > 0).all() or (values < 0).all())
        sd = np.log(np.abs(values)).std() * abs(stiffness[i]) if one_sign else values.std()
        if sd > 0:
            shifts[name] = float(change[i] / sd)
    return shifts
