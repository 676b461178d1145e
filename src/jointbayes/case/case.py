"""A case: the TOML file turned into structure, joint, data and prior, with the settings of the run."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointbayes.case.build import (
    family_of,
    first_guess,
    joints_of,
    measurement_of,
    noise_of,
    prior_of,
    recipe_of,
    stiffness_of,
    with_workshop_uncertainty,
)
from jointbayes.case.case_text import CaseText, case_text, read_case_text
from jointbayes.case.files import (
    plan_of,
    require_inside,
    require_lowest,
    with_estimated_variance,
    with_measured_damping,
)
from jointbayes.case.matrix_files import with_matrices
from jointbayes.case.plausibility import InputWarning, input_warnings, stated_band_hz, truth_warnings
from jointbayes.case.schema.case import CaseSpec, parse_case
from jointbayes.case.schema.measured import MeasuredSpec
from jointbayes.case.toml_text import KeyPath, fault_start
from jointbayes.errors import CaseError, JointBayesError, MeasurementError
from jointbayes.frf import AnyStructure, Substructures
from jointbayes.inference import Problem
from jointbayes.joint import as_joints
from jointbayes.measurement import FrfMeasurement, Measurement, ModalMeasurement
from jointbayes.sampling import SamplerSettings

__all__ = ["Case", "case_around", "case_from_text", "load_case"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """One identification job.

    Parameters
    ----------
    name
        Short name: the file's, without its ending.
    source
        The TOML text, together with that of the files it builds on.
    spec
        The same, checked and typed.
    problem
        Structure, joint, data and prior; `replace` may put another one in its place.
    stated
        The problem that the text states; None where it was not built.
    """

    name: str
    source: CaseText
    spec: CaseSpec
    problem: Problem
    stated: Problem | None = None

    def __repr__(self) -> str:
        return f"Case({self.name!r}: {self.title}; {self.problem!r})"

    @property
    def text(self) -> str:
        """TOML text that needs no other case file."""
        return self.source.text

    @property
    def title(self) -> str:
        """Title for people; without one in the file, the case's name."""
        return self.spec.title or self.name

    @property
    def reference(self) -> Array | None:
        """Published (k11, k12, k22), shape (3,), if the case names any."""
        return stiffness_of(self.spec.reference) if self.spec.reference else None

    @property
    def reference_source(self) -> str:
        """Where the published stiffnesses are from; empty without any."""
        return self.spec.reference.source if self.spec.reference else ""

    @property
    def paper_audit(self) -> bool:
        """Whether the report compares the paper's tables with the results and audits them."""
        return bool(self.spec.reference and self.spec.reference.paper_audit)

    @property
    def measured_frequencies_hz(self) -> tuple[float, ...] | None:
        """Measured natural frequencies, if the case holds any, Hz."""
        measured = self.problem.measurement
        if isinstance(measured, ModalMeasurement):
            return tuple(measured.frequency_hz.tolist()) if measured.lowest else None
        reference = self.spec.reference
        return reference.natural_frequencies_hz if reference else None

    @cached_property
    def warnings(self) -> tuple[InputWarning, ...]:
        """What in the case is possible and yet probably a slip, such as a length in m in place of mm."""
        measured = self.problem.measurement
        lines = measured.frequency_hz if isinstance(measured, ModalMeasurement) else measured.frf.frequency_hz
        usual = input_warnings(self.spec, self.source, (float(lines.min()), float(lines.max())))
        # of the problem that the text states: another prior may be put in its place to a purpose
        return usual + truth_warnings(self.spec, self.source, self.stated.prior) if self.stated else usual

    @cached_property
    def workshop_problem(self) -> Problem | None:
        """The same problem, but with material, length and damping as uncertain as in a workshop.

        E to 2 %, density to 1 %, length to 0.5 %, damping free within a decade either way; what the case itself calls
        uncertain stays as it says. None where the problem is not the text's.
        """
        if self.problem is not self.stated:
            return None
        recipe = recipe_of(self.spec.structure, self.spec.data, self.problem.measurement)
        prior = with_workshop_uncertainty(self.problem.prior, self.spec, recipe, self.problem.measurement)
        return replace(self.problem.with_structures(family_of(recipe, prior)), prior=prior)

    @cached_property
    def sampler(self) -> SamplerSettings:
        """Sampler settings."""
        spec = self.spec.sampling
        return SamplerSettings(
            ensembles=spec.ensembles, walkers=spec.walkers, max_steps=spec.max_steps, processes=spec.processes
        )


def load_case(path: str | os.PathLike[str], allow_outside: bool = False) -> Case:
    """Read a case file.

    Parameters
    ----------
    path
        TOML file; see docs/case-file.md.
    allow_outside
        Whether measurement files, and case files that it builds on, may lie outside the directory of the case file.

    Raises
    ------
    CaseError
        If the file cannot be read or anything in it is wrong: file, line, key, what is expected; or if a measurement
        file, or one it builds on, lies outside the directory of the case file and that is not allowed.

    Examples
    --------
    >>> import jointbayes as jb
    >>> jb.load_case("configs/clamped_beam.toml").name  # doctest: +SKIP
    'clamped_beam'
    """
    file = Path(path)
    source = read_case_text(file, allow_outside)
    return _build(file.stem, source, parse_case(source), file.parent, None, allow_outside)


def case_from_text(
    name: str,
    text: str,
    *,
    directory: str | os.PathLike[str] = ".",
    measurement: Measurement | None = None,
    allow_outside: bool = False,
) -> Case:
    """Build a case from TOML text; errors as for `load_case`, with `name` for the file.

    Parameters
    ----------
    name, text
        Name of the case, and its text.
    directory
        Where measurement files, and case files that it builds on, are looked for.
    measurement
        Data of a case with measurement files, as they were read before; the files are then not needed.
    allow_outside
        Whether such files may lie outside that directory.
    """
    source = case_text(text, name, Path(directory) / f"{name}.toml", allow_outside)
    return _build(name, source, parse_case(source), Path(directory), measurement, allow_outside)


def case_around(problem: Problem, text: str) -> Case:
    """A case whose problem is not the one that its text states: for what the text says of title and reference."""
    source = case_text(text, problem.name)
    return Case(problem.name, source, parse_case(source), problem)


def _build(
    name: str,
    source: CaseText,
    spec: CaseSpec,
    directory: Path,
    measurement: Measurement | None,
    allow_outside: bool,
) -> Case:
    def place(path: KeyPath) -> str:
        return fault_start(*source.place(path))

    spec = with_matrices(spec, directory, allow_outside, lambda path: f"{place(path)} {'.'.join(path)}:")
    stated = spec
    with _told_of(source, spec) as tell:
        joints = "joints" if spec.joints else "joint"
        tell(joints)
        joint = as_joints(joints_of(spec))
        if isinstance(spec.data, MeasuredSpec):
            from jointbayes.measurement.assemble import read_measurement  # with all formats, which others do not need

            tell("data")
            if measurement is None and not allow_outside:
                require_inside(directory, spec.data.file, lambda number: place(("data", "file", number)))
            measurement = measurement or read_measurement(spec.data.file, directory, plan_of(spec))
            spec = with_estimated_variance(with_measured_damping(spec, measurement), measurement)
            tell("structure")
            recipe = recipe_of(spec.structure, spec.data, measurement)
        else:
            tell("structure")
            recipe = recipe_of(spec.structure, spec.data)
            tell(joints)
            joint.require_one_place(lambda label: recipe.positions.get(label.rpartition(":")[0]))
            tell("data")
            measurement = measurement_of(spec, joint)
        tell("noise")
        noise, of_noise = noise_of(spec.noise, measurement)
        tell("prior")
        prior = prior_of(spec, recipe, measurement, of_noise)
        prior.log_density(prior.mean[None])  # that there is a joint at all, before all lines are computed with
        family = family_of(recipe, prior)
        structure: AnyStructure = family
        if spec.bodies:
            from jointbayes.case.bodies import measured_bodies

            tell("bodies")
            named = (*joint.labels, *_ports(measurement))
            bodies = measured_bodies(spec, named, directory, allow_outside, place)
            structure = Substructures(family, bodies, next(iter(spec.bodies.values())).propagate)
        tell("structure")
        problem = Problem(
            structure,
            joint,
            measurement,
            prior,
            noise,
            spec.noise.residuals,
            first_guess(spec, recipe),
            name=name,
        )
        require_lowest(stated, recipe, joint, measurement)
        problem.log_posterior  # noqa: B018 (built here so that a DOF that does not exist is found now)
    return Case(name, source, spec, problem, problem)


def _ports(measurement: Measurement) -> tuple[str, ...]:
    """DOFs of the data."""
    return measurement.frf.outputs + measurement.frf.inputs if isinstance(measurement, FrfMeasurement) else ()


@contextmanager
def _told_of(source: CaseText, spec: CaseSpec) -> Iterator[Callable[[str], None]]:
    """Name file, line and key in errors of what is built from a case, yielding what is called with each table's turn.

    The key is the one that looks like a slip, where one does, and else the table, where the file has it.
    """
    table = "file"

    def tell(name: str) -> None:
        nonlocal table
        table = name

    try:
        yield tell
    except CaseError:
        raise
    except (JointBayesError, ArithmeticError, np.linalg.LinAlgError, MemoryError) as error:
        place, key = source.place((table,)), table if (table,) in source.places else "file"
        slips = () if isinstance(error, MeasurementError) else input_warnings(spec, source, stated_band_hz(spec))
        if slips:
            place, key = (slips[0].file, slips[0].line), slips[0].key
        message = str(error)
        if isinstance(error, MemoryError):
            message = "found too little memory; expected room for the matrices; use fewer lines, DOFs or elements"
        elif not isinstance(error, JointBayesError):
            message = (
                f"found numbers that are too far apart to be computed with ({error}); expected those of one machine; "
                "check sizes, material and stiffnesses"
            )
        raise CaseError(f"{fault_start(*place)} {key}: {message}") from error
