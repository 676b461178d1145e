"""The posterior density of FRFs of many lines from a few of their lines: reduced-order quadrature.

Standardised residuals z(θ) = (H(θ) − Hˣ)/σ of the joints that a posterior holds differ from one another in few ways,
however many lines there are. With an orthonormal basis B of the differences z(θ) − z₀ and coefficients c,

    Σ|z|² = |z₀|² + 2 cᵀ Bᵀz₀ + |c|²,

and c follows by least squares from the residuals at a few lines, the nodes. There are more values at the nodes than
coefficients: what the fit leaves there says how far z(θ) is from the basis, and joints for which that is too much are
computed on all lines. The last line is always a node: a model keeps the modes that its highest frequency asks for.

References
----------
Antil, H., Field, S. E., Herrmann, F., Nochetto, R. H., Tiglio, M. (2013). Two-step greedy algorithm for reduced order
quadratures. Journal of Scientific Computing 57, 604-637. DOI 10.1007/s10915-013-9722-z
Canizares, P. et al. (2015). Accelerated gravitational wave parameter estimation with reduced order modeling. Physical
Review Letters 114, 071104. DOI 10.1103/PhysRevLett.114.071104
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from jointbayes.inference.likelihood_base import Likelihood, Term, TestsLikelihood
from jointbayes.inference.log_posterior import LogPosterior
from jointbayes.inference.noise.base import columns_of
from jointbayes.inference.problem import Problem
from jointbayes.inference.test import Test, likelihood_of
from jointbayes.joint import AnyJointMatrix
from vibrecords.arrays import Array, Flags, Indices

#: Values of a test's FRFs below which all lines are as fast.
LEAST_VALUES = 20_000
#: Largest estimated error of ln L at a joint that is not computed on all lines, and largest error there may be at
#: joints that are.
ESTIMATED, TOLERATED = 0.02, 0.01
_FITTED, _FITTED_EACH = 40, 16  # joints that the basis is of: so many, and for each unknown
_MOST_BYTES = 400_000_000  # of their residuals
_CHECKED, _LEAST_SHARE = 32, 0.5  # joints kept aside, and of these share for which the nodes have to do
_DEEP, _DEEP_EACH = 15.0, 1.0  # below the best in ln L lies no draw: so far, and for each unknown
_LEAST_SIZE = 3e-5  # of a direction of the basis, root mean square of its coefficient
_MOST_RANK = 0.6  # of the joints of a basis: with more directions the next joint has another one
_EQUATIONS, _FEWEST_NODES = 4, 12  # values at the nodes for each coefficient, and nodes
_CANDIDATES = 100_000  # values at the lines of which nodes are chosen
_UNKNOWN = 1e-6  # information on each coefficient before there is a node
_CAUTION = 4.0  # times the error that what is left at the nodes would usually make
_AT_ONCE = 65_536  # columns of residuals whose products are summed in double precision together


@dataclass(frozen=True, slots=True, eq=False)
class Quadrature:
    """Σ|z|² of a test's FRFs from their residuals at the nodes.

    Parameters
    ----------
    at_nodes
        Likelihood of the same FRFs at the nodes alone.
    reference
        Real and imaginary parts of z₀ there, shape (m,).
    basis
        The basis there, shape (m, r).
    inverse
        Least squares: coefficients from differences at the nodes, shape (r, m).
    squares, slope, curvature
        |z₀|² on all lines, 2 Bᵀz₀, shape (r,), and BᵀB, shape (r, r).
    share, size
        Of the norm of what lies outside the basis, on all lines over at the nodes; and root mean square of z₀ over that
        of noise, 1 or more.
    """

    at_nodes: Likelihood
    reference: Array
    basis: Array
    inverse: Array
    squares: float
    slope: Array
    curvature: Array
    share: float
    size: float

    def __call__(self, matrices: AnyJointMatrix, factors: Array) -> tuple[Array, Flags]:
        """Σ|z|², shape (n,), of joint matrices (n, r, r) and factors (n, q), and whether it may be relied on."""
        away = _columns(self.at_nodes, matrices, factors) - self.reference
        c = away @ self.inverse.T
        left = away - c @ self.basis.T
        outside = self.share * np.sqrt(np.einsum("ni,ni->n", left, left))
        # twice its product with z₀, as if that were white, and its square
        error = _CAUTION * (math.sqrt(2) * self.size * outside + outside**2)
        chi2 = self.squares + c @ self.slope + np.einsum("ni,ni->n", c @ self.curvature, c)
        return chi2, error < ESTIMATED  # not where it is not finite


def on_nodes(problem: Problem, theta: Array, least_values: int = LEAST_VALUES) -> LogPosterior:
    """The posterior density of a problem, of FRFs of many lines by quadrature where that is as good as all lines.

    Parameters
    ----------
    problem
        Any; where no test has so many values, or residuals count otherwise than by the sum of their squares, its own
        density is the answer.
    theta
        Some hundred joints about where the draws will be and a little beyond, shape (n, d).
    least_values
        Values of a test's FRFs from which on it is tried.
    """
    exact = problem.log_posterior
    whole = exact.likelihood
    assert isinstance(whole, TestsLikelihood)
    chosen = [_is_long(term, test, least_values) for term, test in zip(whole.terms, problem.tests, strict=True)]
    if not any(chosen):
        return exact
    value = exact(theta)
    high = np.flatnonzero(value > value.max() - _DEEP - _DEEP_EACH * theta.shape[1])
    theta = theta[np.append(np.argmax(value), high)]
    tried = zip(whole.terms, problem.tests, chosen, strict=True)
    terms = [_reduced(term, test, exact, theta) if is_long else term for term, test, is_long in tried]
    if all(new is old for new, old in zip(terms, whole.terms, strict=True)):
        return exact
    return LogPosterior(exact.prior, TestsLikelihood(whole.names, terms, whole.sharing), exact.extra)


def _is_long(term: Term, test: Test, least_values: int) -> bool:
    return test.data.frfs is not None and term.likelihood.sums_squares and term.likelihood.n_data >= least_values


def _reduced(term: Term, test: Test, exact: LogPosterior, theta: Array) -> Term:
    """The term by quadrature, or as it is where the basis needs too many directions or misses joints kept aside.

    Differences are from the first of θ, shape (n, d).
    """
    likelihood, values = term.likelihood, term.likelihood.noise.parts * term.likelihood.n_data
    matrices, factors = term.select(exact.prior.matrix(theta), exact.prior.factors(theta))
    fitted = min(_FITTED + _FITTED_EACH * theta.shape[1], _MOST_BYTES // (4 * values), len(theta) - _CHECKED)
    if fitted < 2:
        return term
    z0 = _columns(likelihood, matrices[:1], factors[:1])[0]
    away = np.empty((fitted, values), dtype=np.float32)
    for i, row in enumerate(away, 1):  # one after the other: residuals of all in double precision fill the memory
        row[:] = _columns(likelihood, matrices[i : i + 1], factors[i : i + 1])[0] - z0
    basis = _basis(away)
    if not 0 < basis.shape[1] <= _MOST_RANK * fitted:
        return term
    del away
    frfs = test.data.frfs
    assert frfs is not None
    by_line = basis.reshape(frfs.frf.n_lines, -1, basis.shape[1])
    lines = _nodes(by_line)
    there = by_line[lines].reshape(-1, basis.shape[1]).astype(float)
    if len(there) <= basis.shape[1]:
        return term
    quadrature = Quadrature(
        likelihood_of(frfs.at_lines(lines), test, gain="gain" in likelihood.names),
        z0.reshape(frfs.frf.n_lines, -1)[lines].ravel(),
        there,
        np.linalg.pinv(there),
        float(z0 @ z0),
        2 * _product(basis, z0),
        _product(basis, basis),
        math.sqrt(values / (len(there) - basis.shape[1])),
        max(1.0, math.sqrt(z0 @ z0 / likelihood.n_data)),
    )
    aside, reduced = slice(-_CHECKED, None), likelihood.with_squares(quadrature)
    kept_aside = matrices[aside], factors[aside]
    wrong = reduced.log_likelihood(*kept_aside) - likelihood.log_likelihood(*kept_aside)
    pays = quadrature(*kept_aside)[1].mean() >= _LEAST_SHARE
    return replace(term, likelihood=reduced) if pays and np.abs(wrong).max() <= TOLERATED else term


def _columns(likelihood: Likelihood, matrices: AnyJointMatrix, factors: Array) -> Array:
    """Real and imaginary parts of residuals, shape (n, values), those of a line together."""
    z = columns_of(likelihood.standardised(matrices, factors), likelihood.noise.parts)
    return z.reshape(len(z), -1)


def _parts(values: int) -> list[slice]:
    return [slice(first, first + _AT_ONCE) for first in range(0, values, _AT_ONCE)]


def _product(first: Array, second: Array) -> Array:
    """firstᵀ second over all values, in double precision.

    Entries are good to seven digits; summed as they are they would leave the smallest directions three.
    """
    total = np.zeros((first.shape[1], *second.shape[1:]))
    for part in _parts(len(first)):
        total += first[part].T.astype(float) @ second[part].astype(float)
    return total


def _basis(away: Array) -> Array:
    """Orthonormal directions of some differences (n, values), shape (values, r), from their Gram matrix."""
    squares, mixtures = np.linalg.eigh(_product(away.T, away.T))
    large = squares > len(away) * _LEAST_SIZE**2
    mixed = mixtures[:, large] / np.sqrt(squares[large])
    basis = np.empty((away.shape[1], mixed.shape[1]), dtype=np.float32)
    for part in _parts(away.shape[1]):
        basis[part] = away[:, part].T @ mixed
    return basis


def _nodes(by_line: Array) -> Indices:
    """Lines, rising, that tell most of the coefficients of a basis (lines, values of each, r): greedily chosen."""
    lines, each, rank = by_line.shape
    every = max(1, lines * each // _CANDIDATES)
    candidates = by_line[::every].astype(float)
    known, chosen = _UNKNOWN * np.eye(rank), np.zeros(len(candidates), dtype=bool)
    for _ in range(min(len(candidates), max(_FEWEST_NODES, -(-_EQUATIONS * rank // each)))):
        root = np.linalg.cholesky(np.linalg.inv(known))
        told = ((candidates.reshape(-1, rank) @ root) ** 2).reshape(len(candidates), -1).sum(axis=1)
        best = int(np.argmax(np.where(chosen, -1.0, told)))
        chosen[best] = True
        known += candidates[best].T @ candidates[best]
    return np.unique(np.append(every * np.flatnonzero(chosen), lines - 1))
