"""Whether the draws and the record of a posterior file belong to its problem.

Each part of a file may be right by itself and yet not belong to the others: after a repair by hand, or where a later
version of the program computes another density.
"""

from collections.abc import Callable

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError, ModelError
from jointbayes.inference import Problem
from jointbayes.posterior.draws import PosteriorDraws
from jointbayes.posterior.file_record import REMEDY, EstimateRecord, FileRecord

_COMPARED = 16  # draws at which the problem must have the density that is stored
#: How far ln p of a rebuilt problem may be from the one stored, as a part of it and absolutely: other versions of the
#: libraries round otherwise, and stiffnesses near the edge of possible joints have lost digits.
_RTOL, _ATOL = 1e-6, 1e-2
_FAR = 100.0  # standard deviations of its prior: no draw is so far away


def require_agreement(problem: Problem, record: FileRecord, where: str) -> None:
    """Refuse a record whose names or shapes are not those of the problem.

    Raises
    ------
    MeasurementError
        If anything has another shape or other names: which.
    """
    names, d = problem.names, len(problem.names)
    expected: dict[str, tuple[object, object]] = {"mode.theta": (len(record.mode.theta), d)}
    for name, given in (
        ("r_hat", record.record.r_hat),
        ("sampler.tau", record.record.sampler.tau),
        ("sampler.ess", record.record.sampler.ess),
    ):
        expected[f"record.{name}"] = (sorted(given), sorted(names))
    if record.knowledge is not None:
        known = sorted(quantity.name for quantity in problem.quantities)
        for i, row in enumerate(record.knowledge.freed):
            expected[f"knowledge.freed.{i}.known"] = (sorted(row.known), known if row.known else [])
        for i, profile in enumerate(record.knowledge.profiles):
            expected[f"knowledge.profiles.{i}.theta"] = ({len(theta) for theta in profile.theta}, {d})
    _require(expected, where)
    require_estimate(problem, record.map, where)


def require_estimate(problem: Problem, found: EstimateRecord, where: str) -> None:
    """Refuse a MAP estimate whose shapes are not those of the problem, as `require_agreement` does."""
    d, stiffnesses = len(problem.names), len(problem.quantities)
    expected: dict[str, tuple[object, object]] = {
        "map.theta": (len(found.theta), d),
        "map.stiffness": (len(found.stiffness), stiffnesses),
    }
    for i, start in enumerate(found.starts):
        expected[f"map.starts.{i}"] = ((len(start.start), len(start.stiffness)), (stiffnesses, stiffnesses))
    for i, mode in enumerate(found.modes):
        expected[f"map.modes.{i}.theta"] = (len(mode.theta), d)
        if mode.inside is not None:
            expected[f"map.modes.{i}.inside"] = (len(mode.inside[0]), d)
    _require(expected, where)
    covariances = {"map": found.covariance} | {f"map.modes.{i}": m.covariance for i, m in enumerate(found.modes)}
    covariances |= {f"map.modes.{i}.inside": m.inside[1] for i, m in enumerate(found.modes) if m.inside is not None}
    for place, matrix in covariances.items():
        if not _is_covariance(matrix, d):
            raise MeasurementError(
                f"{where}: record, {place}.covariance: found none; expected a covariance of {d} numbers; {REMEDY}"
            )


def _require(expected: dict[str, tuple[object, object]], where: str) -> None:
    for place, (there, wanted) in expected.items():
        if there != wanted:
            raise MeasurementError(f"{where}: record, {place}: found {there}; expected {wanted}; {REMEDY}")


def _is_covariance(rows: tuple[tuple[float, ...], ...], dimension: int) -> bool:
    if len(rows) != dimension or any(len(row) != dimension for row in rows):
        return False
    matrix = np.array(rows).reshape(dimension, dimension)
    if not dimension:
        return True
    sd = np.sqrt(np.maximum(np.diag(matrix), 0))
    if not (sd > 0).all():
        return False
    correlation = matrix / sd / sd[:, None]
    return bool(np.allclose(correlation, correlation.T, atol=1e-6) and np.linalg.eigvalsh(correlation).min() > -1e-6)


def require_same_density(posterior: PosteriorDraws, where: str, *, passed: bool) -> None:
    """Refuse draws that are not of the problem's density: far outside its prior, or with another ln p.

    Parameters
    ----------
    posterior
        With its problem.
    where
        The file, for messages.
    passed
        Whether the caller passed the problem; it is then his own, on the same machine, and must agree closely.

    Raises
    ------
    ModelError
        If the density is another one.
    """
    problem = posterior.problem
    theta = _coordinates(posterior, posterior.stiffness, posterior.values, where, "draws")
    _coordinates(posterior, posterior.prior_stiffness, posterior.prior_values, where, "draws of the prior")
    with np.errstate(all="ignore"):
        if not np.isfinite(problem.prior.log_density(theta)).all():
            raise ModelError(f"{where}: found draws that its prior excludes; expected draws of its problem; {REMEDY}")
    rows = np.linspace(0, len(theta) - 1, _COMPARED).round().astype(int)
    stored = posterior.log_density.ravel()[rows]
    points = theta[rows]
    if not passed:
        points = np.concatenate([points, posterior.mode_theta[None], posterior.estimate.theta[None]])
        stored = np.append(stored, [posterior.mode_log_density, posterior.estimate.log_posterior])
    with np.errstate(all="ignore"):  # a damaged mode may lie anywhere
        computed = problem.log_posterior(points)
    rtol, atol = (1e-9, 1e-6) if passed else (_RTOL, _ATOL)
    if not np.allclose(computed, stored, rtol=rtol, atol=atol):
        finite = np.where(np.isfinite(computed), computed, -1e300)  # outside the prior, or not a number
        worst = int(np.argmax(np.abs(finite - stored)))
        given = "the problem passed" if passed else "its problem"
        raise ModelError(
            f"{where}: found draws of another density than that of {given}: ln p is "
            f"{stored[worst]:.6g} in the file and {computed[worst]:.6g} by the problem; expected the problem "
            f"that was sampled; {'pass that one' if passed else REMEDY}"
        )


def _coordinates(
    posterior: PosteriorDraws, stiffness: Array, values: Callable[[str], Array], where: str, what: str
) -> Array:
    """θ of draws, shape (n, d); refused where nobody can have drawn them, which arithmetic may not survive."""
    prior = posterior.problem.prior
    low, high = prior.support
    low = np.where(np.isfinite(low), low, prior.mean - _FAR * prior.sd) - prior.sd
    high = np.where(np.isfinite(high), high, prior.mean + _FAR * prior.sd) + prior.sd
    with np.errstate(all="ignore"):
        if not prior.parametrisation.describes(stiffness).all():
            raise ModelError(f"{where}: found {what} that are no joint; expected joints of its problem; {REMEDY}")
        rest = [n.coordinate(values(n.name).ravel())[:, None] for n in prior.nuisances]
        theta = np.concatenate([prior.parametrisation.coordinates(stiffness), *rest], axis=1)
        inside = (theta >= low) & (theta <= high)
    if not inside.all():
        raise ModelError(f"{where}: found {what} that its prior excludes; expected draws of its problem; {REMEDY}")
    return theta
