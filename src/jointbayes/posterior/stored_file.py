"""A posterior file as it is read: in a process of its own, then checked, before anything is made of it.

Damaged bytes can end the process in which the HDF5 library reads them; there that is an error of one line. Names of the
arrays are known, so nothing else in a file is looked at.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import JointBayesError, MeasurementError
from jointbayes.frf import FrfSet
from jointbayes.inference import Problem
from jointbayes.measurement import (
    FrequencyMeasurement,
    FrfMeasurement,
    Measurement,
    ModeMeasurement,
    ModeShapes,
    Observed,
)
from jointbayes.measurement.formats.array_files import read_arrays
from jointbayes.measurement.provenance import Provenance
from jointbayes.posterior.file_record import REMEDY, FileRecord, parse_record, provenance_from
from jointbayes.posterior.storage import JOINT_FRF, RECORD, value_units
from jointbayes.posterior.stored_problem import PROBLEM_GROUP

_EXPECTED = "expected a posterior.nc written by jointbayes"
_LEAST = 2  # draws of a chain, and of the prior: one has no spread


@dataclass(frozen=True, slots=True, eq=False)
class StoredDraws:
    """Arrays of the draws, as `jointbayes.posterior.storage.values_tree` takes them."""

    values: Array
    log_density: Array
    ensemble: NDArray[np.int64]
    before: Array


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

    @property
    def measurement(self) -> Measurement:
        """The data that were analysed; with their provenance where they come from files.

        Raises
        ------
        MeasurementError
            If arrays of them are missing, of other shapes than each other, or hold impossible numbers.
        """
        given = self.record.record.provenance
        known = None if given is None else provenance_from(given, self.where)
        observed = self.groups.get("observed_data", {})
        try:
            if "natural_frequency" in observed:
                hz, sd = (self.numbers("observed_data", f"natural_frequency{end}") for end in ("", "_sd"))
                return FrequencyMeasurement(hz, sd, known)
            if "mode_frequency" in observed:
                return self._modes(known)
            frf, variance = self._frf("observed_data"), self.numbers("observed_data", "frf_variance")
            if known is None:
                return FrfMeasurement(frf, variance, "synthetic" not in observed or bool(observed["synthetic"].any()))
            joint_frf = self._frf(JOINT_FRF) if JOINT_FRF in self.groups else None
            return FrfMeasurement(frf, variance, False, known.variance_dof, joint_frf, known)
        except MeasurementError as error:
            if str(error).startswith(self.where):
                raise
            raise MeasurementError(f"{self.where}: observed_data: {error}") from None

    def draws(self, problem: Problem) -> StoredDraws:
        """Draws of a problem.

        Raises
        ------
        MeasurementError
            If a quantity of it is missing, shapes differ, or numbers are not finite.
        """
        names = tuple(value_units(problem))
        values = np.stack([self.numbers("posterior", name, 2) for name in names], axis=-1)
        before = np.stack([self.numbers("prior", name, 2) for name in names], axis=-1)
        log_density, ensemble = self.numbers("sample_stats", "lp", 2), self.numbers("posterior", "ensemble", 1)
        for name, found, expected in (
            ("sample_stats/lp", log_density.shape, values.shape[:2]),
            ("posterior/ensemble", ensemble.shape, values.shape[:1]),
            ("prior", before.shape[:1], (1,)),
        ):
            if found != expected:
                raise self._fault(f"{name}: found shape {found}; expected {expected}")
        if min(values.shape[1], before.shape[1]) < _LEAST:
            raise self._fault(
                f"posterior, prior: found {values.shape[1]} and {before.shape[1]} draws; expected {_LEAST} or more"
            )
        sizes = np.unique(ensemble, return_counts=True)[1]
        if (np.diff(ensemble) < 0).any() or len(set(sizes.tolist())) != 1:
            raise self._fault("posterior/ensemble: expected ensembles of as many chains each, one after the other")
        return StoredDraws(values, log_density, ensemble.astype(np.int64), before)

    def numbers(self, group: str, name: str, dimensions: int | None = None) -> Array:
        """An array of finite numbers.

        Raises
        ------
        MeasurementError
            If there is none, or it has not so many dimensions.
        """
        found = self.array(group, name)
        if found.dtype.kind not in "iuf" or not np.isfinite(found).all():
            raise self._fault(f"{group}/{name}: found what is no finite number; expected such")
        if dimensions is not None and found.ndim != dimensions:
            raise self._fault(f"{group}/{name}: found shape {found.shape}; expected {dimensions} dimensions")
        return found.astype(np.float64, copy=False)

    def array(self, group: str, name: str) -> NDArray[Any]:
        """An array of a group.

        Raises
        ------
        MeasurementError
            If there is none.
        """
        found = self.groups.get(group, {}).get(name)
        if found is None:
            raise self._fault(f"found no variable {group}/{name}; {_EXPECTED}")
        return found

    def problem_array(self, name: str) -> NDArray[Any]:
        """An array of the stored problem, of real or complex numbers.

        Raises
        ------
        MeasurementError
            If there is none, or its real and imaginary parts are of different shapes.
        """
        if name in self.groups.get(PROBLEM_GROUP, {}):
            return self._any_numbers(PROBLEM_GROUP, name)
        return self._complex(PROBLEM_GROUP, name)

    def _any_numbers(self, group: str, name: str) -> NDArray[Any]:
        found = self.array(group, name)
        if found.dtype.kind not in "iufb":
            raise self._fault(f"{group}/{name}: found what is no number; expected numbers")
        return found

    def _complex(self, group: str, name: str) -> NDArray[np.complex128]:
        real, imaginary = (self._any_numbers(group, f"{name}_{part}") for part in ("real", "imag"))
        if real.shape != imaginary.shape:
            raise self._fault(f"{group}/{name}: found parts of {real.shape} and {imaginary.shape}; expected one shape")
        values = np.empty(real.shape, np.complex128)
        values.real, values.imag = real, imaginary
        return values

    def _frf(self, group: str) -> FrfSet:
        outputs, inputs = (tuple(map(str, self.array(group, side).ravel())) for side in ("output", "input"))
        quantity: Any = str(self.array(group, "quantity"))  # judged by the set
        return FrfSet(self.numbers(group, "frequency"), self._complex(group, "frf"), outputs, inputs, quantity)

    def _modes(self, known: Provenance | None) -> ModeMeasurement:
        group = "observed_data"
        here = self.groups[group]

        def part(name: str) -> Observed | None:
            if name not in here:
                return None
            return Observed(self._any_numbers(group, name), self._any_numbers(group, f"{name}_sd"))

        frequency, components = part("mode_frequency"), part("mode_shape")
        assert frequency is not None
        shapes = None
        if components is not None:
            dofs, references = (
                tuple(map(str, self.array(group, name).ravel())) for name in ("shape_dof", "reference_dof")
            )
            shapes = ModeShapes(dofs, references[0] if len(set(references)) == 1 else references, components)
        match: Any = str(self.array(group, "match"))  # judged by the measurement
        numbers = tuple(map(int, self._any_numbers(group, "mode").ravel()))
        eigenvalues = bool(self._any_numbers(group, "eigenvalues").any())
        return ModeMeasurement(frequency, part("damping_ratio"), shapes, numbers, match, eigenvalues, known)

    def _fault(self, found: str) -> MeasurementError:
        return MeasurementError(f"{self.where}: {found}; {REMEDY}")


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
        groups = {place.strip("/"): block for place, block in read_arrays(Path(path), "hdf5")}
    except MeasurementError as error:
        raise MeasurementError(f"{where}: found no posterior in it: {error}") from None
    text = groups.get("", {}).get(RECORD)
    if text is None or text.dtype.kind != "U" or text.ndim:
        raise MeasurementError(f"{where}: found no posterior in it; {_EXPECTED}; give the path of one")
    return StoredFile(where, parse_record(str(text), where), groups)


@contextmanager
def one_line_of(where: str) -> Iterator[None]:
    """Turn whatever a damaged file leads to into one line that begins with the file.

    Its record is typed, but a problem is made of hundreds of numbers, and mathematics refuses them in its own ways.
    """
    try:
        yield
    except JointBayesError as error:
        if str(error).startswith(where):
            raise
        raise MeasurementError(f"{where}: found a problem in it that is none: {error}") from error
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        said = " ".join(str(error).split())[:120]
        raise MeasurementError(
            f"{where}: found a problem in it that cannot be evaluated ({type(error).__name__}: {said}); expected that "
            "of its draws; sample again, or take another copy of the file"
        ) from error
