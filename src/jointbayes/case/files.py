"""From the tables of a case on measurement files to the plan by which they are read, and back: what the data decide."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from jointbayes.case.build import joints_of, rigid_frequencies_hz
from jointbayes.case.schema.bodies import MeasuredBodySpec
from jointbayes.case.schema.case import CaseSpec
from jointbayes.case.schema.damping import ModalDampingSpec
from jointbayes.case.schema.measured import (
    MeasuredFrequenciesSpec,
    MeasuredFrfSpec,
    MeasuredSpec,
    RotationSpec,
    VarianceSpec,
)
from jointbayes.case.schema.priors import FactorPriorSpec
from jointbayes.case.schema.structure import BeamSpec, StructureSpec
from jointbayes.errors import CaseError, MeasurementError
from jointbayes.joint import AnyJoint, as_joints
from jointbayes.measurement.channels import Channel
from jointbayes.measurement.data import FrfMeasurement
from jointbayes.measurement.mode_data import Measurement
from jointbayes.measurement.plan import FrequencyPlan, MeasurementPlan, VarianceSource
from jointbayes.measurement.rotations import Rotation
from jointbayes.measurement.signals.hits import HitSettings
from jointbayes.measurement.signals.impact import ImpactSettings
from jointbayes.measurement.signals.spectra import ShakerSettings
from jointbayes.measurement.variance import RelativeNoise
from jointbayes.structure import StructureRecipe

_MM, _G = 1e-3, 1e-3
_ABOVE_RIGID = 1.15  # a measured mode so far above that of a rigid joint cannot be the same mode
_NEARLY_GAUSSIAN = 400  # degrees of freedom: the mean square is half a per cent off
_DAMPING_FACTOR = 3.0  # either way, about damping ratios that were taken from the data


def plan_of(spec: CaseSpec) -> MeasurementPlan:
    """What a case with data of kind ``"measured_frf"`` or ``"measured_frequencies"`` asks for of its files."""
    data = spec.data
    assert isinstance(data, MeasuredFrfSpec | MeasuredFrequenciesSpec)
    frf = data if isinstance(data, MeasuredFrfSpec) else None
    frequencies = data if isinstance(data, MeasuredFrequenciesSpec) else None
    return replace(
        plan_of_files(data),
        outputs=frf.outputs if frf else (),
        inputs=frf.inputs if frf else (),
        rotations=tuple(_rotation(label, one, spec.structure) for label, one in frf.rotations.items()) if frf else (),
        joint_dofs=as_joints(joints_of(spec)).labels,
        frequencies=(
            FrequencyPlan(frequencies.modes, frequencies.sd_relative, frequencies.sd_hz) if frequencies else None
        ),
    )


def plan_of_files(data: MeasuredFrfSpec | MeasuredFrequenciesSpec | MeasuredBodySpec) -> MeasurementPlan:
    """What all tables of measurement files ask for of these."""
    return MeasurementPlan(
        {name: Channel(c.label, c.sign, c.gain, c.accelerometer_mass_g * _G) for name, c in data.channels.items()},
        _variance(data.variance) if data.variance else None,
        data.quantity,
        data.f_min_hz,
        data.f_max_hz,
        data.thin,
        data.accelerometers == "roving",
        _signals(data) if data.records else None,
        exclude_hz=data.exclude_hz,
        conjugate=data.conjugate,
    )


def _variance(spec: VarianceSpec) -> VarianceSource:
    law = RelativeNoise(spec.relative, spec.floor) if spec.relative + spec.floor > 0 else None
    return VarianceSource(spec.source, law, spec.averages, "relative" in spec.model_fields_set)


def _signals(data: MeasuredSpec) -> ImpactSettings | ShakerSettings:
    spec, band = data.records, (data.f_min_hz, data.f_max_hz)
    assert spec is not None
    if spec.method == "shaker":
        assert spec.block_s is not None
        return ShakerSettings(spec.block_s, spec.overlap, spec.window, spec.estimator, *band)
    hits = HitSettings(spec.block_s, spec.pretrigger_s, force_range_n=spec.force_range_n)
    return ImpactSettings(hits, spec.force_window_s, spec.exponential_end, spec.estimator, *band)


def _rotation(label: str, spec: RotationSpec, structure: StructureSpec) -> Rotation:
    """A rotation with the distance of its stations, negative where they run backwards."""
    first, second, *_ = (int(station.split(":")[0]) for station in spec.stations)
    assert isinstance(structure, BeamSpec)  # as the rules of the tables ask
    spacing = (second - first) * structure.length_mm / structure.elements
    if spec.spacing_mm is not None:
        spacing = float(np.copysign(spec.spacing_mm, spacing))
    return Rotation(label, spec.stations, spacing * _MM, spec.scheme, spec.in_likelihood, spec.axis)


def require_inside(directory: Path, names: Sequence[str], place: Callable[[int], str], key: str = "data.file") -> None:
    """Refuse measurement files outside the directory of their case: a case of somebody else may name any file.

    Parameters
    ----------
    directory
        Of the case.
    names
        Of the files, as the case has them; where they lead by ``..`` or by links is what counts.
    place
        Start of the message for the file of that number: where its name stands.
    key
        That names it.

    Raises
    ------
    CaseError
        If one lies elsewhere.
    """
    home = directory.resolve()
    for number, name in enumerate(names):
        try:
            inside = (directory / name).resolve().is_relative_to(home)
        except (OSError, RuntimeError, ValueError):  # links in a circle, a null byte: found again on reading
            inside = True
        if not inside:
            shown = f'"{name}"' if name.isprintable() else json.dumps(name)
            raise CaseError(
                f"{place(number)} {key}: found {shown}, which leads out of the directory of the case file; "
                "expected a measurement file in it or below; move the file there, or allow it: --allow-outside, in "
                "Python allow_outside=True"
            )


def require_lowest(spec: CaseSpec, recipe: StructureRecipe, joint: AnyJoint, measured: Measurement) -> None:
    """Refuse measured modes that cannot be the model's lowest ones, where the case takes them for these.

    No joint is stiffer than a rigid one, so that a mode far above that of a rigid joint is a later one.

    Raises
    ------
    MeasurementError
        If natural frequencies, or damping ratios mode by mode, are taken from the data and a lower mode was missed.
    """
    damping = spec.structure.damping
    ratios = isinstance(damping, ModalDampingSpec) and damping.measured
    modes = measured.provenance.modes if measured.provenance else ()
    if not modes or not (ratios or isinstance(spec.data, MeasuredFrequenciesSpec)):
        return
    rigid = rigid_frequencies_hz(recipe, joint, len(modes))
    for number, (mode, highest) in enumerate(zip(modes, rigid, strict=False), 1):
        if mode.frequency_hz > _ABOVE_RIGID * highest:
            raise MeasurementError(
                f"data: found mode {number} at {mode.frequency_hz:.4g} Hz; expected it at {highest:.4g} Hz at most, "
                "where a rigid joint puts it, so that a lower mode was missed; lower f_min_hz, or measure where that "
                "mode moves"
            )


def as_measured(spec: CaseSpec, measured: Measurement) -> CaseSpec:
    """The case with what it leaves to its data: damping ratios, and the distribution of residuals.

    Raises
    ------
    MeasurementError
        If the data show no mode with a damping ratio between 0 and 1, and the case asks for them.
    """
    return _with_estimated_variance(_with_measured_damping(spec, measured), measured)


def _with_estimated_variance(spec: CaseSpec, measured: Measurement) -> CaseSpec:
    """The case with Student-t residuals where the variance of FRFs was estimated line by line from few data.

    A residual over an estimated standard deviation is not Gaussian: with dof degrees of freedom its square is
    dof/(dof − 2) on average, not 1. Only where the case does not choose a distribution itself, and nothing else
    forbids it.
    """
    dof = measured.variance_dof if isinstance(measured, FrfMeasurement) else None
    noise = spec.noise
    free = "distribution" not in noise.model_fields_set and noise.discrepancy is None and noise.scale != "integrated"
    if dof is None or dof >= _NEARLY_GAUSSIAN or not free or noise.residuals != "complex":
        return spec
    chosen = noise.model_copy(update={"distribution": "student_t", "dof": float(dof)})
    return spec.model_copy(update={"noise": chosen})


def _with_measured_damping(spec: CaseSpec, measured: Measurement) -> CaseSpec:
    """The case with the damping ratios that the data show, where it asks for them.

    For FRFs each ratio stays uncertain by a factor of 3 either way, unless the case says otherwise: the same data are
    in the likelihood, and a prior as narrow as the modal fit would count them twice.

    Raises
    ------
    MeasurementError
        If the data show no mode with a damping ratio between 0 and 1.
    """
    damping = spec.structure.damping
    if not (isinstance(damping, ModalDampingSpec) and damping.measured):
        return spec
    assert measured.provenance is not None
    ratios = tuple(float(mode.damping_ratio) for mode in measured.provenance.modes)
    if not ratios or not all(0 < ratio < 1 for ratio in ratios):
        raise MeasurementError(
            f"structure.damping.ratio: found the ratios {list(ratios)} in the data; expected some between 0 and 1; "
            "state a ratio"
        )
    structure = spec.structure.model_copy(update={"damping": damping.model_copy(update={"ratio": ratios})})
    uncertain = spec.uncertain
    if uncertain.damping_ratio is None and isinstance(measured, FrfMeasurement):
        high = max(min(_DAMPING_FACTOR, 0.9 / max(ratios)), 1.0)
        prior = FactorPriorSpec(low_factor=1 / _DAMPING_FACTOR, high_factor=high, own=True)
        uncertain = uncertain.model_copy(update={"damping_ratio": prior})
    return spec.model_copy(update={"structure": structure, "uncertain": uncertain})
