"""A posterior file as it is read, and checked before anything is made of it.

Each part of a file may be right by itself and yet not belong to the others: after a repair by hand, or where a later
version of the program computes another density.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jointbayes.errors import JointBayesError, MeasurementError, ModelError
from jointbayes.inference import Problem
from jointbayes.posterior.storage import (
    PROBLEM_GROUP,
    RECORD,
    FileRecord,
    parse_record,
    problem_from,
    require_same_problem,
    value_units,
    values_tree,
)
from jointbayes.stored_values import REMEDY
from vibrecords.arrays import Array
from vibrecords.formats.array_files import read_groups

_EXPECTED = "expected a posterior.nc written by jointbayes"
_LEAST = 2  # draws of a chain, and of the prior: one has no spread
_COMPARED = 16  # draws at which the problem must have the density that is stored
#: How far ln p of a rebuilt problem may be from the one stored, as a part of it and absolutely: other versions of the
#: libraries round otherwise, and stiffnesses near the edge of possible joints have lost digits.
_RTOL, _ATOL = 1e-6, 1e-2
_FAR = 100.0  # standard deviations of its prior: no draw is so far away


@dataclass(frozen=True, slots=True, eq=False)
class StoredFile:
    """What a posterior file holds: its record, checked, and its arrays by group and name, still to be asked for.

    Parameters
    ----------
    where
        The file, for messages.
    record
        Everything but the arrays.
    groups
        Arrays by name, of each group.
    """

    where: str
    record: FileRecord
    groups: Mapping[str, Mapping[str, NDArray[Any]]]

    def draws(self, problem: Problem) -> tuple[Array, Array, NDArray[np.int64], Array]:
        """Values, ln p and ensembles of the draws of a problem, and draws of its prior: as `values_tree` takes them.

        Raises
        ------
        MeasurementError
            If a quantity of it is missing, shapes differ, or numbers are not finite.
        """
        names = tuple(value_units(problem))
        values = np.stack([self.numbers("posterior", name, 2) for name in names], axis=-1)
        before = np.stack([self.numbers("prior", name, 2) for name in names], axis=-1)
        log_density, ensemble = self.numbers("sample_stats", "lp", 2), self.numbers("posterior", "ensemble", 1)
        for name, shape, expected_shape in (
            ("sample_stats/lp", log_density.shape, values.shape[:2]),
            ("posterior/ensemble", ensemble.shape, values.shape[:1]),
            ("prior", before.shape[:1], (1,)),
        ):
            if shape != expected_shape:
                raise self._fault(f"{name}: found shape {shape}; expected {expected_shape}")
        if min(values.shape[1], before.shape[1]) < _LEAST:
            raise self._fault(
                f"posterior, prior: found {values.shape[1]} and {before.shape[1]} draws; expected {_LEAST} or more"
            )
        sizes = np.unique(ensemble, return_counts=True)[1]
        if (np.diff(ensemble) < 0).any() or len(set(sizes.tolist())) != 1:
            raise self._fault("posterior/ensemble: expected ensembles of as many chains each, one after the other")
        return values, log_density, ensemble.astype(np.int64), before

    def require_same_density(
        self, problem: Problem, values: Array, log_density: Array, before: Array, *, passed: bool
    ) -> None:
        """Refuse draws that are not of the problem's density: far outside its prior, or with another ln p.

        Parameters
        ----------
        problem
            The problem that was sampled.
        values, log_density, before
            What `draws` gave.
        passed
            Whether the caller passed the problem; it is then his own, on the same machine, and must agree closely.

        Raises
        ------
        ModelError
            If the density is another one.
        """
        theta = _coordinates(problem, values, self.where, "draws")
        _coordinates(problem, before, self.where, "draws of the prior")
        with np.errstate(all="ignore"):
            if not np.isfinite(problem.prior.log_density(theta)).all():
                raise ModelError(
                    f"{self.where}: found draws that its prior excludes; expected draws of its problem; {REMEDY}"
                )
        rows = np.linspace(0, len(theta) - 1, _COMPARED).round().astype(int)
        stored, points = log_density.ravel()[rows], theta[rows]
        if not passed:
            mode, estimate = self.record.mode, self.record.map
            points = np.concatenate([points, mode.theta[None], estimate.theta[None]])
            stored = np.append(stored, [mode.log_density, estimate.log_posterior])
        with np.errstate(all="ignore"):  # a damaged mode may lie anywhere
            computed = problem.log_posterior(points)
        rtol, atol = (1e-9, 1e-6) if passed else (_RTOL, _ATOL)
        if not np.allclose(computed, stored, rtol=rtol, atol=atol):
            finite = np.where(np.isfinite(computed), computed, -1e300)  # outside the prior, or not a number
            worst = int(np.argmax(np.abs(finite - stored)))
            given = "the problem passed" if passed else "its problem"
            raise ModelError(
                f"{self.where}: found draws of another density than that of {given}: ln p is "
                f"{stored[worst]:.6g} in the file and {computed[worst]:.6g} by the problem; expected the problem "
                f"that was sampled; {'pass that one' if passed else REMEDY}"
            )

    def numbers(self, group: str, name: str, dimensions: int | None = None) -> Array:
        """An array of finite numbers.

        Raises
        ------
        MeasurementError
            If there is none, or it has not so many dimensions.
        """
        values = self.array(group, name)
        if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
            raise self._fault(f"{group}/{name}: found what is no finite number; expected such")
        if dimensions is not None and values.ndim != dimensions:
            raise self._fault(f"{group}/{name}: found shape {values.shape}; expected {dimensions} dimensions")
        return values.astype(np.float64, copy=False)

    def array(self, group: str, name: str) -> NDArray[Any]:
        """An array of a group.

        Raises
        ------
        MeasurementError
            If there is none.
        """
        values = self.groups.get(group, {}).get(name)
        if values is None:
            raise self._fault(f"found no variable {group}/{name}; {_EXPECTED}")
        return values

    def problem_array(self, name: str) -> NDArray[Any]:
        """An array of the stored problem, of real or complex numbers.

        Raises
        ------
        MeasurementError
            If there is none, or its real and imaginary parts are of different shapes.
        """
        is_real = name in self.groups.get(PROBLEM_GROUP, {})
        parts = [self.array(PROBLEM_GROUP, part) for part in ([name] if is_real else [f"{name}_real", f"{name}_imag"])]
        if any(values.dtype.kind not in "iufb" or values.shape != parts[0].shape for values in parts):
            raise self._fault(f"{PROBLEM_GROUP}/{name}: found what is no number; expected numbers, parts of one shape")
        if is_real:
            return parts[0]
        values = np.empty(parts[0].shape, np.complex128)
        values.real, values.imag = parts
        return values

    def _fault(self, found: str) -> MeasurementError:
        return MeasurementError(f"{self.where}: {found}; {REMEDY}")


def read_posterior(
    path: str | os.PathLike[str], problem: Problem | None = None
) -> tuple[Problem, xr.DataTree, FileRecord]:
    """Read a posterior file; its case is for the caller to add.

    Parameters
    ----------
    path
        The file.
    problem
        The problem that was sampled, where it has parts that no file can hold.

    Returns
    -------
    problem : Problem
        That which is stored with the draws, or the one passed.
    tree : xarray.DataTree
        The draws.
    record : FileRecord
        All else.

    Raises
    ------
    MeasurementError, ModelError
        As `jointbayes.load_posterior` says.
    """
    stored, passed = read_stored(path), problem is not None
    where, record = stored.where, stored.record
    with one_line_of(where):
        if problem is not None:
            require_same_problem(problem, record.problem, where)
        if problem is None or record.problem["description"]["premises"]["reason"]:
            problem = problem_from(stored.problem_array, record.problem, where, problem)
        _require_agreement(problem, record, where)
        values, log_density, ensemble, before = stored.draws(problem)
        if not passed:
            stored.require_same_density(problem, values, log_density, before, passed=False)
    if passed:
        stored.require_same_density(problem, values, log_density, before, passed=True)
    tree = values_tree(problem, values, log_density, ensemble, before)
    return problem, tree, record


def read_stored(path: str | os.PathLike[str]) -> StoredFile:
    """Read a posterior file.

    Raises
    ------
    MeasurementError
        If it is missing, holds no posterior or a damaged one, or is of a later version: what was found.
    """
    where = os.fspath(path)
    try:
        there = Path(path).is_file()
    except OSError:  # a name too long for any file
        there = False
    if not there:
        raise MeasurementError(f"{where}: no such file; {_EXPECTED}; give the path of one")
    try:
        groups = read_groups(Path(path))
    except MeasurementError as error:
        raise MeasurementError(f"{where}: found no posterior in it: {error}") from None
    text = groups.get("", {}).get(RECORD)
    if text is None or text.dtype.kind != "U" or text.ndim:
        raise MeasurementError(f"{where}: found no posterior in it; {_EXPECTED}; give the path of one")
    with one_line_of(where):
        return StoredFile(where, parse_record(str(text), where), groups)


@contextmanager
def one_line_of(where: str) -> Iterator[None]:
    """Turn any error of a damaged file into one line that begins with the file.

    Its record is typed, but a problem is made of hundreds of numbers, and mathematics refuses them in its own ways.
    """
    try:
        yield
    except JointBayesError as error:
        if str(error).startswith(where):
            raise
        raise MeasurementError(f"{where}: found a problem in it that is none: {error}") from error
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise MeasurementError(
            f"{where}: found a problem in it that cannot be evaluated ({type(error).__name__}: {reason}); expected "
            "that of its draws; sample again, or take another copy of the file"
        ) from error


def _require_agreement(problem: Problem, record: FileRecord, where: str) -> None:
    """Refuse a record whose names or shapes are not those of the problem.

    Raises
    ------
    MeasurementError
        If anything has another shape or other names: which.
    """
    d, q, estimate, sampler = len(problem.names), len(problem.quantities), record.map, record.record.sampler
    names = {"r_hat": record.record.r_hat, "sampler.tau": sampler["tau"], "sampler.ess": sampler["ess"]}
    expected: dict[str, tuple[object, object]] = {
        f"record.{name}": (sorted(values), sorted(problem.names)) for name, values in names.items()
    }
    expected["record.versions"] = ([name for name in record.record.versions if name == "jointbayes"], ["jointbayes"])
    shapes = {"mode.theta": (record.mode.theta, d), "map.theta": (estimate.theta, d)}
    shapes["map.stiffness"], covariances = (estimate.values, q), {"map": estimate.covariance}
    for i, start in enumerate(estimate.starts):
        shapes |= {f"map.starts.{i}.start": (start.start, q), f"map.starts.{i}.stiffness": (start.stiffness, q)}
    for i, mode in enumerate(estimate.modes):
        shapes[f"map.modes.{i}.theta"], covariances[f"map.modes.{i}"] = (mode.theta, d), mode.covariance
        if mode.inside is not None:
            shapes[f"map.modes.{i}.inside"], covariances[f"map.modes.{i}.inside"] = (mode.inside[0], d), mode.inside[1]
    expected |= {place: (array.shape, (size,)) for place, (array, size) in shapes.items()}
    quantities = sorted(quantity.name for quantity in problem.quantities)
    for i, row in enumerate(record.found.get("rows_of", ())):
        expected[f"rows_of.{i}.known"] = (sorted(row.known), quantities if row.known else [])
    for i, profile in enumerate(record.found.get("profiles_of", ())):
        n = max(1, profile.log_ratio.size)
        of_arrays = [array.shape for array in (profile.value, profile.log_ratio, profile.theta)]
        expected[f"profiles_of.{i}.value, log_ratio, theta"] = (of_arrays, [(n,), (n,), (n, d)])
    if (diagnoses := record.found.get("diagnoses_of")) is not None:
        zero = [mode for each in diagnoses for mode in each.modes if not mode.measured_hz]
        expected["diagnoses_of"] = (len(diagnoses), len(problem.tests))
        expected["diagnoses_of.modes"] = (zero, [])
    for place, (there, wanted) in expected.items():
        if there != wanted:
            raise MeasurementError(f"{where}: record.{place}: found {there}; expected {wanted}; {REMEDY}")
    for place, matrix in covariances.items():
        if not _is_covariance(matrix, d):
            raise MeasurementError(
                f"{where}: record.{place}.covariance: found none; expected a covariance of {d} numbers; {REMEDY}"
            )


def _is_covariance(matrix: Array, dimension: int) -> bool:
    if matrix.shape != (dimension, dimension) or not (np.diag(matrix) > 0).all():
        return not dimension and not matrix.size
    sd = np.sqrt(np.diag(matrix))
    correlation = matrix / sd / sd[:, None]
    return bool(np.allclose(correlation, correlation.T, atol=1e-6) and np.linalg.eigvalsh(correlation).min() > -1e-6)


def _coordinates(problem: Problem, values: Array, where: str, what: str) -> Array:
    """θ of draws, shape (n, d); refused where they cannot be draws: arithmetic may not survive them."""
    prior, flat = problem.prior, values.reshape(-1, values.shape[-1])
    stiffness, rest = np.split(flat, [len(problem.quantities)], axis=1)
    low, high = prior.support
    low = np.where(np.isfinite(low), low, prior.mean - _FAR * prior.sd) - prior.sd
    high = np.where(np.isfinite(high), high, prior.mean + _FAR * prior.sd) + prior.sd
    with np.errstate(all="ignore"):
        if not prior.parametrisation.describes(stiffness).all():
            raise ModelError(f"{where}: found {what} that are no joint; expected joints of its problem; {REMEDY}")
        columns = [n.coordinate(column)[:, None] for n, column in zip(prior.nuisances, rest.T, strict=True)]
        theta = np.concatenate([prior.parametrisation.coordinates(stiffness), *columns], axis=1)
        inside = (theta >= low) & (theta <= high)
    if not inside.all():
        raise ModelError(f"{where}: found {what} that its prior excludes; expected draws of its problem; {REMEDY}")
    return theta
