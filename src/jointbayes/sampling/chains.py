"""What a run of the ensembles leaves behind."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.sampling.diagnostics import effective_sample_size
from jointbayes.sampling.stopping import Check


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a run stands after a block of steps.

    Parameters
    ----------
    steps, max_steps : int
        Steps made by each ensemble, and their limit.
    expected_steps : int
        Estimate of the step at which the run will stop; ``steps`` itself in the last report.
    tau : float
        τ of the slowest parameter in steps, at the last check.
    r_hat : float
        Largest R̂ at the last check.
    elapsed_seconds : float
        Wall time since the run began.
    """

    steps: int
    max_steps: int
    expected_steps: int
    tau: float
    r_hat: float
    elapsed_seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Draws:
    """Draws after burn-in, one chain per walker.

    Parameters
    ----------
    theta : ndarray, shape (ensembles * walkers, n_draw, d)
        Draws; the chains of one ensemble follow each other.
    log_density : ndarray, shape (ensembles * walkers, n_draw)
        Log-density of each draw.
    ensemble : ndarray of int, shape (ensembles * walkers,)
        Ensemble to which each chain belongs, counted from zero.
    """

    theta: Array
    log_density: Array
    ensemble: NDArray[np.intp]

    def __post_init__(self) -> None:
        for array in (self.theta, self.log_density, self.ensemble):
            array.setflags(write=False)


@dataclass(frozen=True, slots=True, eq=False)
class Chains:
    """All steps of all ensembles with the figures of the last check; the arrays are made read-only.

    Parameters
    ----------
    theta : ndarray, shape (ensembles, held, walkers, d)
        Positions after each step, or after every so many of a long run; the start is not among them.
    log_density : ndarray, shape (ensembles, held, walkers)
        Log-density at ``theta``.
    acceptance : ndarray, shape (ensembles,)
        Mean fraction of accepted proposals of each ensemble, over all steps.
    move_acceptance : mapping of str to float
        Mean fraction of accepted proposals of each move that was made, by its name.
    thin : int
        Distance of thinned draws in steps, half the smallest τ.
    converged : bool
        Whether the stop rule was met.
    reason : str
        One sentence with the figures that met the rule, or that did not.
    evaluations : int
        Number of points at which the log-density was computed, starts included.
    singular : int
        Number of those at which the density had no finite value although its prior is above zero.
    seconds : float
        Wall time of the run.
    history : tuple of Check
        Every check of the stop rule; the last one is that of the last step.
    discarded : int
        Steps of earlier stages, which are not among these.
    every : int
        Distance of the positions in steps: 1 in a run of no more steps than are held.
    """

    theta: Array
    log_density: Array
    acceptance: Array
    move_acceptance: Mapping[str, float]
    thin: int
    converged: bool
    reason: str
    evaluations: int
    singular: int
    seconds: float
    history: tuple[Check, ...]
    discarded: int = 0
    every: int = 1

    def __post_init__(self) -> None:
        for array in (self.theta, self.log_density, self.acceptance):
            array.setflags(write=False)

    @property
    def steps(self) -> int:
        """Number of steps each ensemble made."""
        return self.history[-1].step

    @property
    def burn_in(self) -> int:
        """Number of first steps left out of τ, R̂ and the draws."""
        return self.history[-1].burn_in

    @property
    def held_burn_in(self) -> int:
        """Number of first positions left out."""
        return self.burn_in // self.every

    @property
    def tau(self) -> Array:
        """Integrated autocorrelation time in steps, shape (d,)."""
        return self.history[-1].tau

    @property
    def r_hat(self) -> Array:
        """Rank-normalised split R̂ over the ensembles, shape (d,)."""
        return self.history[-1].r_hat

    @property
    def ess(self) -> Array:
        """Effective sample size of all steps after burn-in, shape (d,)."""
        ensembles, held, walkers, _ = self.theta.shape
        return effective_sample_size(ensembles * (held - self.held_burn_in) * walkers, self.tau / self.every)

    def draws(self, *, thinned: bool = True) -> Draws:
        """Return the draws after burn-in.

        Parameters
        ----------
        thinned : bool
            Keep every ``thin``-th step only (the default), or all of them.

        Returns
        -------
        Draws
            Copies in chain order, walkers of one ensemble together.
        """
        ensembles, _, walkers, dimension = self.theta.shape
        kept = slice(self.held_burn_in, None, max(1, self.thin // self.every) if thinned else 1)
        theta = np.swapaxes(self.theta[:, kept], 1, 2)
        log_density = np.swapaxes(self.log_density[:, kept], 1, 2)
        return Draws(
            theta=theta.reshape(ensembles * walkers, -1, dimension).copy(),
            log_density=log_density.reshape(ensembles * walkers, -1).copy(),
            ensemble=np.repeat(np.arange(ensembles), walkers),
        )
