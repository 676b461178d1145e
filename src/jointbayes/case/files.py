"""From the measurement files that a case names to its data."""

import difflib
import hashlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointbayes.case.records import FrfsOfRecords, frfs_of_records
from jointbayes.case.schema import case as schema
from jointbayes.case.schema.measured import MeasuredSpec
from jointbayes.case.variance import as_accelerance, variance_of
from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet, NaturalFrequencies
from jointbayes.joint import RIGID, Joint, joint_matrix
from jointbayes.measurement.accelerometer import without_accelerometers
from jointbayes.measurement.channels import Channel, ChannelMap, ChannelUse, MappedRecords, map_records
from jointbayes.measurement.data import FrequencyMeasurement, FrfMeasurement
from jointbayes.measurement.measured import MeasuredFile, MeasuredTest, NotedDoubt, Provenance
from jointbayes.measurement.modal.fit import MeasuredMode, identify_modes
from jointbayes.measurement.records import FrfRecord, Record, TimeRecord
from jointbayes.measurement.rotations import Rotation, at_joint, with_rotations
from jointbayes.structure import BeamFamily, BeamRecipe

__all__ = ["read_test", "require_lowest", "with_estimated_variance", "with_measured_damping"]

Array = NDArray[np.float64]
_MM, _G = 1e-3, 1e-3
_ABOVE_RIGID = 1.15  # a measured mode so far above that of a rigid joint cannot be the same mode
_NEARLY_GAUSSIAN = 400  # degrees of freedom: the mean square is half a per cent off
_DAMPING_FACTOR = 3.0  # either way, about damping ratios that were taken from the data


@dataclass(frozen=True)
class _Read:
    """FRFs between DOFs of the model, with their variance, and what is to be said of them."""

    frf: FrfSet
    variance: Array | None
    words: str
    notes: tuple[str, ...]
    doubts: tuple[NotedDoubt, ...]
    dof: int | None


def read_test(spec: schema.CaseSpec, base: Path) -> MeasuredTest:
    """Read the measurement files of a case.

    Parameters
    ----------
    spec
        Case with data of kind ``"measured_frf"`` or ``"measured_frequencies"``.
    base
        Directory from which file names count.

    Raises
    ------
    MeasurementError
        If a file is missing or wrong, or does not hold what the case says.
    """
    data = spec.data
    assert isinstance(data, schema.MeasuredFrfSpec | schema.MeasuredFrequenciesSpec)
    files = [_file(base / name, name) for name in data.file]
    where = ", ".join(data.file)
    made = _made_of_records(base, data, where)
    stored = (r for r in _records(base, data.file) if isinstance(r, FrfRecord))
    mapped = map_records(made.frfs if made else stored, _channels(data), where)
    read = _assembled(data, mapped, where, made or FrfsOfRecords(()))
    modes, modal_note = _modes(read, required=isinstance(data, schema.MeasuredFrequenciesSpec))
    provenance = Provenance(
        tuple(files),
        read.frf.quantity,
        read.frf.n_lines,
        (float(read.frf.frequency_hz[0]), float(read.frf.frequency_hz[-1])),
        read.frf.averages,
        mapped.uses,
        mapped.left_out,
        read.words,
        read.notes + modal_note,
        read.doubts,
        modes,
        variance_dof=read.dof,
        loaded=tuple(output for output in read.frf.outputs if ":r" not in output),
    )
    if isinstance(data, schema.MeasuredFrequenciesSpec):
        return MeasuredTest(_frequencies(data, modes, where), None, provenance)
    assert isinstance(data, schema.MeasuredFrfSpec)
    return _frf_test(spec, data, read, provenance)


def _frf_test(spec: schema.CaseSpec, data: schema.MeasuredFrfSpec, read: _Read, provenance: Provenance) -> MeasuredTest:
    """The FRFs that the likelihood sees, and those at the joint."""
    assert read.variance is not None
    rotations = [_rotation(label, rotation, spec.structure) for label, rotation in data.rotations.items()]
    frf, variance = with_rotations(read.frf, read.variance, rotations)
    derived = {r.dof for r in rotations if r.in_likelihood}
    outputs = tuple(o for o in frf.outputs if not data.outputs or o in data.outputs or o in derived)
    inputs = tuple(i for i in frf.inputs if not data.inputs or i in data.inputs)
    for key, stated, present in (("outputs", data.outputs, frf.outputs), ("inputs", data.inputs, frf.inputs)):
        for label in stated:
            if label not in present:
                replaced = key == "outputs" and label in read.frf.outputs
                taken = ", which a rotation in the likelihood replaces" if replaced else ""
                raise MeasurementError(
                    f"data.{key}: found {label}{taken}; expected one of {', '.join(present)} of "
                    f"{', '.join(data.file)}; remove it"
                )
    rows, columns = [frf.outputs.index(o) for o in outputs], [frf.inputs.index(i) for i in inputs]
    used = FrfMeasurement(frf.select(outputs, inputs), variance[:, rows][:, :, columns])
    joint_frf, missing = None, ""
    try:
        chosen = read.frf.select(read.frf.outputs, inputs)
        joint_frf = at_joint(chosen, rotations, outputs, spec.joint.dofs + spec.joint.against)
    except MeasurementError as error:
        missing = str(error)
    return MeasuredTest(used, joint_frf, replace(provenance, iteration=missing))


def _file(path: Path, name: str) -> MeasuredFile:
    """Size and fingerprint of a file."""
    if not path.is_file():
        near = difflib.get_close_matches(path.name, [p.name for p in path.parent.glob("*")], 1, 0.6)
        found = "a directory" if path.is_dir() else "no such file"
        remedy = f'did you mean "{near[0]}"?' if near else "names count from the directory of the case file"
        raise MeasurementError(f"data.file: {name}: found {found}; expected a measurement file; {remedy}")
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return MeasuredFile(name, path.stat().st_size, digest)


def _made_of_records(base: Path, data: MeasuredSpec, where: str) -> FrfsOfRecords | None:
    """FRFs made of the time histories of all files, where the case asks for it."""
    if data.records is None:
        return None
    channels = ChannelMap(_channels(data))
    times = [r for r in _records(base, data.file) if isinstance(r, TimeRecord)]
    channels.require_all([record.channel for record in times], where)
    return frfs_of_records([r for r in times if channels.find(r.channel)], data, where)


def _records(base: Path, names: Sequence[str]) -> Iterator[Record]:
    """All records of all files, one after the other."""
    from jointbayes.measurement.formats import iter_records

    for name in names:
        for record in iter_records(base / name):
            yield record if len(names) == 1 else replace(record, where=f"{name}, {record.where}".rstrip(", "))


def _channels(data: MeasuredSpec) -> dict[str, Channel]:
    return {name: Channel(c.label, c.sign, c.gain, c.accelerometer_mass_g * _G) for name, c in data.channels.items()}


def _assembled(
    data: "schema.MeasuredFrfSpec | schema.MeasuredFrequenciesSpec",
    mapped: MappedRecords,
    where: str,
    made: FrfsOfRecords,
) -> _Read:
    """One set of FRFs from all records, with variance, without the masses that are to be taken out."""
    from jointbayes.measurement.formats import assemble

    records, notes = _with_quantity(mapped.records, data.quantity, where)
    notes = [*made.notes, *dict.fromkeys(note for record in mapped.records for note in record.notes), *notes]
    notes += [_turned(use) for use in mapped.uses if use.reversed_direction]
    stated = data.variance
    groups = _repeats(records, where, allowed=stated is not None and stated.source == "repeats")
    sets = [assemble(group, where, f_min_hz=data.f_min_hz, f_max_hz=data.f_max_hz) for group in groups]
    thin = data.thin or made.step
    if thin > 1:
        why = "" if data.thin else ", since with the window that was used neighbouring lines depend on each other"
        notes.append(f"Of {thin} lines one was kept{why}.")
    sets = [frf.at_lines(slice(None, None, thin)) for frf in sets]
    frf, variance, words, dof = variance_of(sets, stated, where)
    masses = {use.dof: use.accelerometer_mass for use in mapped.uses if use.accelerometer_mass > 0}
    if masses:
        roving = data.accelerometers == "roving"
        spread = np.ones(frf.values.shape) if variance is None else variance
        frf, spread = without_accelerometers(frf, spread, masses, roving=roving)
        variance = None if variance is None else spread
        each = ", ".join(f"{1e3 * mass:g} g at {dof}" for dof, mass in masses.items())
        notes.append(f"The mass of the accelerometers was taken out of the FRFs: {each}.")
    return _Read(frf, variance, words, tuple(notes), _doubts(records, data), dof)


def _place(record: FrfRecord, where: str) -> str:
    return f"{where}: {record.where}" if record.where else where


def _doubts(records: Iterable[FrfRecord], data: MeasuredSpec) -> tuple[NotedDoubt, ...]:
    """What is doubtful about the FRFs as they are used: in the band, with signs and quantity as the case has them."""
    from jointbayes.measurement.warnings.warnings import find_doubts

    found = find_doubts(_cut(record, data.f_min_hz, data.f_max_hz) for record in records)
    return tuple(NotedDoubt(doubt.where, doubt.sentence, doubt.remedy) for doubt in found)


def _cut(record: FrfRecord, f_min_hz: float | None, f_max_hz: float | None) -> FrfRecord:
    f = record.frequency_hz
    inside = (f >= (f_min_hz or -np.inf)) & (f <= (f_max_hz or np.inf))
    return record.at_lines(inside)


def _turned(use: ChannelUse) -> str:
    return (
        f"Channel {use.channel} points the other way than the mapped one: it was taken for {use.dof} with a factor "
        f"{use.factor:g}."
    )


def _with_quantity(records: Iterable[FrfRecord], stated: str | None, where: str) -> tuple[list[FrfRecord], list[str]]:
    """Records with the quantity that the case states, if any, and what contradicts it."""
    known, notes = [], {}
    for record in records:
        if stated is None and record.quantity is None:
            raise MeasurementError(
                f'{_place(record, where)}: found an FRF that does not say what it is (unit "{record.unit}"); expected '
                'receptance, mobility or accelerance; write for example quantity = "accelerance" in [data]'
            )
        if stated is not None and record.quantity not in (None, stated):
            unit = f" in {record.unit}" if record.unit else ""
            notes[f"The file says {record.quantity}{unit}; the case says {stated}, and was followed."] = True
        known.append(record if stated is None else replace(record, quantity=stated))  # type: ignore[arg-type]
    return known, list(notes)


def _repeats(records: Iterable[FrfRecord], where: str, *, allowed: bool) -> list[list[FrfRecord]]:
    """Records apart by repetition: the first FRF of each pair of DOFs, the second, and so on."""
    by_pair: dict[tuple[str, str], list[FrfRecord]] = defaultdict(list)
    for record in records:
        by_pair[record.response, record.reference].append(record)
    counts = {pair: len(group) for pair, group in by_pair.items()}
    most = max(counts.values())
    if most > 1 and not allowed:
        pair = max(counts, key=lambda p: counts[p])
        raise MeasurementError(
            f"{_place(by_pair[pair][1], where)}: found another FRF of {pair[0]} over {pair[1]}; expected each once; "
            'leave one out, or write source = "repeats" in [data.variance] if they are repeated measurements'
        )
    for pair, count in counts.items():
        if count != most:
            raise MeasurementError(
                f"{where}: found {count} FRFs of {pair[0]} over {pair[1]} and {most} of others; expected as many "
                "repetitions of each; leave the surplus out"
            )
    return [[group[k] for group in by_pair.values()] for k in range(most)]


def _modes(read: _Read, *, required: bool) -> tuple[tuple[MeasuredMode, ...], tuple[str, ...]]:
    """Modes that the FRFs show."""
    try:
        return identify_modes(*as_accelerance(read.frf, read.variance)), ()
    except MeasurementError as error:
        if required:
            raise
        return (), (f"Natural frequencies were not looked for: {error}.",)


def _frequencies(
    data: schema.MeasuredFrequenciesSpec, modes: tuple[MeasuredMode, ...], where: str
) -> FrequencyMeasurement:
    wanted = data.modes or max(len(modes), 1)
    if len(modes) < wanted:
        raise MeasurementError(
            f"{where}: found {len(modes)} modes; expected at least {wanted}; lower data.modes or widen the band"
        )
    frequency = np.array([mode.frequency_hz for mode in modes[:wanted]])
    fitted = np.array([mode.frequency_sd_hz for mode in modes[:wanted]])
    return FrequencyMeasurement(frequency, np.sqrt(fitted**2 + (data.sd_relative * frequency) ** 2 + data.sd_hz**2))


def _rotation(label: str, spec: schema.RotationSpec, structure: schema.StructureSpec) -> Rotation:
    """A rotation with the distance of its stations, negative where they run backwards."""
    first, second, *_ = (int(station.split(":")[0]) for station in spec.stations)
    spacing = (second - first) * structure.length_mm / structure.elements
    if spec.spacing_mm is not None:
        spacing = float(np.copysign(spec.spacing_mm, spacing))
    return Rotation(label, spec.stations, spacing * _MM, spec.scheme, spec.in_likelihood)


def require_lowest(spec: schema.CaseSpec, recipe: BeamRecipe, joint: Joint, modes: Sequence[MeasuredMode]) -> None:
    """Refuse measured modes that cannot be the model's lowest ones, where the case takes them for these.

    No joint is stiffer than a rigid one, so that a mode far above that of a rigid joint is a later one.

    Raises
    ------
    MeasurementError
        If natural frequencies, or damping ratios mode by mode, are taken from the data and a lower mode was missed.
    """
    damping = spec.structure.damping
    ratios = isinstance(damping, schema.ModalDampingSpec) and damping.measured
    if not modes or not (ratios or isinstance(spec.data, schema.MeasuredFrequenciesSpec)):
        return
    family = BeamFamily(recipe, {})
    count = min(len(modes), recipe.dofs_per_node * recipe.elements)
    rigid = NaturalFrequencies(family, joint, count).frequency_hz(joint_matrix([RIGID, 0.0, RIGID]))[0]
    for number, (mode, highest) in enumerate(zip(modes, rigid, strict=False), 1):
        if mode.frequency_hz > _ABOVE_RIGID * highest:
            raise MeasurementError(
                f"data: found mode {number} at {mode.frequency_hz:.4g} Hz; expected it at {highest:.4g} Hz at most, "
                "where a rigid joint puts it, so that a lower mode was missed; lower f_min_hz, or measure where that "
                "mode moves"
            )


def with_estimated_variance(spec: schema.CaseSpec, test: MeasuredTest) -> schema.CaseSpec:
    """The case with Student-t residuals where the variance of FRFs was estimated line by line from few data.

    A residual over an estimated standard deviation is not Gaussian: with dof degrees of freedom its square is
    dof/(dof − 2) on average, not 1. Only where the case does not choose a distribution itself, and nothing else
    forbids it.
    """
    dof, noise = test.provenance.variance_dof, spec.noise
    free = "distribution" not in noise.model_fields_set and noise.discrepancy is None and noise.scale != "integrated"
    if dof is None or dof >= _NEARLY_GAUSSIAN or not free or noise.residuals != "complex":
        return spec
    if not isinstance(test.measurement, FrfMeasurement):
        return spec
    chosen = noise.model_copy(update={"distribution": "student_t", "dof": float(dof)})
    return spec.model_copy(update={"noise": chosen})


def with_measured_damping(spec: schema.CaseSpec, test: MeasuredTest) -> schema.CaseSpec:
    """The case with the damping ratios that the data show, where it asks for them.

    For FRFs each ratio stays uncertain by a factor of 3 either way, unless the case says otherwise: the same data are
    in the likelihood, and a prior as narrow as the modal fit would count them twice.

    Raises
    ------
    MeasurementError
        If the data show no mode with a damping ratio between 0 and 1.
    """
    damping = spec.structure.damping
    if not (isinstance(damping, schema.ModalDampingSpec) and damping.measured):
        return spec
    ratios = tuple(float(mode.damping_ratio) for mode in test.provenance.modes)
    if not ratios or not all(0 < ratio < 1 for ratio in ratios):
        raise MeasurementError(
            f"structure.damping.ratio: found the ratios {list(ratios)} in the data; expected some between 0 and 1; "
            "state a ratio"
        )
    structure = spec.structure.model_copy(update={"damping": damping.model_copy(update={"ratio": ratios})})
    uncertain = spec.uncertain
    if uncertain.damping_ratio is None and isinstance(test.measurement, FrfMeasurement):
        high = max(min(_DAMPING_FACTOR, 0.9 / max(ratios)), 1.0)
        prior = schema.FactorPriorSpec(low_factor=1 / _DAMPING_FACTOR, high_factor=high)
        uncertain = uncertain.model_copy(update={"damping_ratio": prior})
    return spec.model_copy(update={"structure": structure, "uncertain": uncertain})
