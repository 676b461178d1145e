"""Measured bodies of a case: from their files to receptances at the DOFs that joints and data name."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

from jointbayes.case.files import plan_of_files, require_inside
from jointbayes.case.schema.bodies import MeasuredBodySpec
from jointbayes.case.schema.case import CaseSpec
from jointbayes.errors import MeasurementError
from jointbayes.frf import MeasuredBody
from jointbayes.measurement.data import FrfMeasurement
from jointbayes.measurement.rotations import Rotation

_MM = 1e-3


def measured_bodies(
    spec: CaseSpec,
    used: Iterable[str],
    directory: Path,
    allow_outside: bool,
    place: Callable[[tuple[str, ...]], str],
) -> tuple[MeasuredBody, ...]:
    """Read the bodies of a case.

    Parameters
    ----------
    spec
        The case.
    used
        DOFs that joints and data name: others of a body are left out.
    directory
        From which the names of files count.
    allow_outside
        Whether files may lie outside of it.
    place
        Start of a message for a key, with file and line.

    Raises
    ------
    CaseError
        If a file lies outside.
    MeasurementError
        If a file is missing or wrong, or lacks an FRF.
    """
    wanted, found = frozenset(used), []
    for name, body in spec.bodies.items():
        key = f"bodies.{name}"
        if not allow_outside:
            require_inside(directory, body.file, partial(_at, place(("bodies", name, "file"))), f"{key}.file")
        try:
            found.append(_body(name, body, wanted, directory))
        except MeasurementError as error:
            # messages of the files name the table of the data
            raise MeasurementError(str(error).replace("data.", f"{key}.")) from error
    return tuple(found)


def _at(where: str, _number: int) -> str:
    return where


def _body(name: str, spec: MeasuredBodySpec, wanted: frozenset[str], directory: Path) -> MeasuredBody:
    from jointbayes.measurement.assemble import read_measurement  # with all formats, which others do not need

    measured = read_measurement(spec.file, directory, plan_of_files(spec))
    assert isinstance(measured, FrfMeasurement)
    assert measured.provenance is not None  # as of all that is read
    whole = MeasuredBody.of(measured.frf, measured.variance, name)
    motions = {label: {label: 1.0} for label in whole.dofs if label in wanted}
    for label, rotation in spec.rotations.items():
        if label in wanted:
            assert rotation.spacing_mm is not None  # as its table asks
            spacing = rotation.spacing_mm * _MM
            weights = Rotation(label, rotation.stations, spacing, rotation.scheme, axis=rotation.axis).weights
            motions[label] = dict(zip(rotation.stations, weights.tolist(), strict=True))
    if not motions:
        raise MeasurementError(
            f"measured body {name}: found no joint, output or input at its DOFs {', '.join(spec.labels)}; expected a "
            "joint to one of them; name its DOF in the joint, or remove the body"
        )
    return replace(whole.seen_at(motions), files=measured.provenance.files)
