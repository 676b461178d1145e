"""From the records of measurement files to a measurement: FRFs between DOFs of the model, and their noise.

One way for all data from files: FRFs of the records, channels to DOFs, band and lines, variance, masses of
accelerometers, modes, rotations.
"""

import difflib
import hashlib
import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vibrecords.accelerometer import remove_accelerometers
from vibrecords.data import Data, FrequencyData, FrfData
from vibrecords.errors import MeasurementError, placed, refusal
from vibrecords.formats.channel_units import restate_history
from vibrecords.formats.grid import cut_to_band, excluded_lines, join_frfs, measured_lines
from vibrecords.formats.read import iter_records
from vibrecords.formats.units import two_readings
from vibrecords.frf_set import FrfSet
from vibrecords.measurement_plan import MeasurementPlan, VarianceSource, find_channel, map_records, require_channels
from vibrecords.modal_fit import fit_modes, modes_and_doubtful
from vibrecords.provenance import MeasuredFile, MeasuredMode, MeasurementWarning, Provenance
from vibrecords.records import FrfRecord, Record, TimeRecord
from vibrecords.rotations import joint_frf_set, replace_stations
from vibrecords.signals.impact import frfs_of_hits, line_step_of, settings_of, without_window
from vibrecords.signals.spectra import MadeFrfs, ShakerSettings, frfs_of_shaker
from vibrecords.variance import RelativeNoise, coherence_variance
from vibrecords.virtual_points import at_virtual_points
from vibrecords.warnings.collector import find_warnings
from vibrecords.warnings.kinds import warn

#: χ² per degree of freedom up to which a modal fit is close enough to the FRFs to tell how large they are.
_EXPLAINED = 10.0


def estimate_variance(sets: Sequence[FrfSet], choice: VarianceSource | None, where: str) -> tuple[FrfData, str]:
    """FRFs with their variance, and where that comes from, in words.

    Parameters
    ----------
    sets
        FRFs; more than one where measurements were repeated, of which the mean is taken.
    choice
        Where the variance comes from; None leaves it open: the same everywhere.
    where
        The files, for messages.

    Raises
    ------
    MeasurementError
        If the FRFs do not tell what is to be taken from them.
    """
    frf = sets[0]
    if choice is None:
        return FrfData(frf, np.ones(frf.values.shape)), "estimated from what the modal fit leaves"
    if choice.averages is not None:
        frf = replace(frf, averages=choice.averages)
    law = choice.law
    least = f", but at least a standard deviation of {100 * law.relative:g} % of |H| in each part" if law else ""
    if choice.source == "repeats":
        words = f"from the scatter of {len(sets)} repeated measurements, whose mean is used{least}"
        return mean_of_repeats(sets, law), words
    if law and (choice.source == "relative" or (frf.averages == 1 and choice.law_for_one_average)):
        alone = "" if choice.source == "relative" else " (of one average coherence says nothing)"
        floor = f" and {100 * law.floor:g} % of the median accelerance" if law.floor else ""
        words = f"as stated: {100 * law.relative:g} % of |H|{floor}{alone}"
        smooth = _smooth(frf, law)
        how = "; |H| is that of a modal fit, without the noise" if smooth else ""
        return FrfData(frf, law.variance_of_accelerance(smooth or frf)), words + how
    with placed(where):
        variance = coherence_variance(frf)
    if law:
        variance = np.maximum(variance, law.variance_of_accelerance(frf))
    assert frf.averages is not None
    measured = FrfData(frf, variance, variance_dof=2 * (frf.averages - 1))
    return measured, f"from the coherence of {frf.averages} averages{least}"


def mean_of_repeats(frfs: Sequence[FrfSet], least: RelativeNoise | None = None) -> FrfData:
    """Mean of repeated measurements of the same FRFs, and its variance from their scatter.

    σ² = Σ|H_i − H̄|²/(m(m − 1)) for m repetitions, line by line. It counts all that differs from one to the next,
    also what no coherence shows: a sensor taken off and mounted again, a joint tightened again. But it is the variance
    of the *mean*: what all repetitions have in common, such as a calibration, it does not see. Residuals over it are
    Student-t with 2(m − 1) degrees of freedom: three repetitions leave four of them.

    Parameters
    ----------
    frfs
        At least two sets with the same lines, DOFs and quantity.
    least
        Law of the accelerance's noise that no line falls below.

    Returns
    -------
    FrfData
        The mean with its variance. Without coherence: none belongs to a mean of FRFs. Averages are those of all sets
        together, where all tell.

    Raises
    ------
    MeasurementError
        If there are fewer than two, they do not match, or all are the same.
    """
    where = "noise from repeats"
    if len(frfs) < 2:
        raise refusal(where, f"{len(frfs)} measurement", "two or more", "repeat it, or state the noise")
    first = frfs[0]
    for number, other in enumerate(frfs[1:], 2):
        others = {
            "lines": not np.array_equal(first.frequency_hz, other.frequency_hz),
            "DOFs": (first.outputs, first.inputs) != (other.outputs, other.inputs),
            "quantity": first.quantity != other.quantity,
        }
        if any(others.values()):
            what = " and ".join(what for what, differs in others.items() if differs)
            found = f"other {what} in measurement {number} than in the first"
            raise refusal(where, found, "the same", "leave it out or bring it to the same")
    values = np.stack([frf.values for frf in frfs])
    m, mean = len(frfs), values.mean(axis=0)
    scatter = np.sum(np.abs(values - mean) ** 2, axis=0) / (m * (m - 1))
    if not scatter.any():
        found = f"{m} measurements that are the same to the last digit"
        raise refusal(where, found, "independent ones, which differ by their noise", "do not repeat one file")
    counts = [frf.averages for frf in frfs if frf.averages is not None]
    combined = replace(first, values=mean, coherence=None, averages=sum(counts) if len(counts) == m else None)
    variance = scatter if least is None else np.maximum(scatter, least.variance_of_accelerance(combined))
    return FrfData(combined, variance, variance_dof=2 * (m - 1))


def _smooth(frf: FrfSet, law: RelativeNoise) -> FrfSet | None:
    """FRFs of a modal fit, without the noise of the measured ones; None where none comes close to them.

    A variance in proportion to the *measured* |H|² favours lines that the noise made small, so that everything fitted
    comes out too small by the variance relative to |H|², which many lines do not average away.
    """
    accelerance = FrfData(frf, law.variance_of_accelerance(frf)).converted("accelerance")
    try:
        fit = fit_modes(accelerance.frf, accelerance.variance)
    except MeasurementError:
        return None
    if not fit.modes or fit.misfit > _EXPLAINED:
        return None
    return replace(accelerance.frf, values=fit.values, coherence=None).converted(frf.quantity)


def read_measurement(names: Sequence[str], directory: Path, plan: MeasurementPlan) -> Data:
    """Read measurement files and assemble what they hold.

    Parameters
    ----------
    names
        Of the files, relative to the directory.
    directory
        From which the names count.
    plan
        What is asked for.

    Raises
    ------
    MeasurementError
        If a file is missing or wrong, or does not hold what the plan says.
    """
    files = tuple(_fingerprint(directory / name, name) for name in names)
    return assemble_measurement(_records(directory, names, plan.layout), plan, files)


def assemble_measurement(records: Iterable[Record], plan: MeasurementPlan, files: Sequence[MeasuredFile] = ()) -> Data:
    """Assemble a measurement from records.

    Parameters
    ----------
    records
        Of all files, one after the other.
    plan
        What is asked for.
    files
        Where they come from, for provenance and messages.

    Returns
    -------
    FrfData or FrequencyData
        Natural frequencies where ``plan.frequencies`` is set.

    Raises
    ------
    MeasurementError
        If the records do not hold what the plan says.
    """
    where = ", ".join(file.name for file in files) or "records"
    histories, stored = _histories_and_frfs(records, plan)
    made = _frfs_of_histories(histories, plan, where) if histories or plan.signals else MadeFrfs(())
    mapped = map_records(made.frfs or stored, plan.channels, where)
    stated, contradicted = _apply_quantity(mapped.records, plan, where)
    notes = [*made.notes, *dict.fromkeys(note for record in stated for note in record.notes)]
    if plan.conjugate:
        stated = [record.conjugate for record in stated]
        notes.append("The complex conjugates of the FRFs were taken, as conjugate = true asks.")
    notes += [
        f"Channel {use.channel} points the other way than the mapped one: it was taken for {use.dof} with a factor "
        f"{use.factor:g}."
        for use in mapped.uses
        if use.reversed_direction
    ]
    cut = [cut_to_band(record, where, plan.f_min_hz, plan.f_max_hz) for record in stated]
    source = "" if plan.variance is None else plan.variance.source
    used, left_out = measured_lines(cut, where, plan.exclude_hz, needs_coherence=source == "coherence")
    notes += left_out
    if plan.window_tau_s is not None:
        used = [replace(record, window_rate=1 / plan.window_tau_s) for record in used]
    sets = [join_frfs(group, where) for group in _repetitions(used, where, allowed=source == "repeats")]
    step = plan.line_step or max(made.line_step, line_step_of(sets[0]))
    if sets[0].window_rate:
        corrected = [without_window(frf) for frf in sets]
        sets, note = [frf for frf, _ in corrected], corrected[0][1]
        notes.append(f"{note[0].upper()}{note[1:]}.")
    if step > 1:
        why = "" if plan.line_step else ", since with the window that was used neighbouring lines depend on each other"
        notes.append(f"Of {step} lines one was kept{why}.")
    sets = [frf.at_lines(slice(None, None, step)) for frf in sets]
    measured, words = estimate_variance(sets, plan.variance, where)
    masses = {use.dof: use.accelerometer_mass for use in mapped.uses if use.accelerometer_mass > 0}
    if masses:
        measured = remove_accelerometers(measured, masses, roving=plan.roving)
        each = ", ".join(f"{1e3 * mass:g} g at {dof}" for dof, mass in masses.items())
        notes.append(f"The mass of the accelerometers was taken out of the FRFs: {each}.")
    measured, loose, of_points = at_virtual_points(measured, plan.virtual_points)
    notes += of_points
    modes, without_modes = _modes(measured, plan)
    frf = measured.frf
    about = (frf.quantity, frf.n_lines, measured.band_hz, frf.averages, mapped.uses, mapped.left_out, words)
    # what is doubtful in the lines that are used, and in those that hold no number; not what the plan answers
    answered = {"uneven_lines"} if plan.exclude_hz else set()
    answered |= {"exponential_window"} if plan.window_tau_s is not None else set()
    if source not in ("", "coherence"):
        answered |= {"coherence_missing", "coherence_one", "averages_missing"}
    seen = find_warnings(r.at_lines(~excluded_lines(r.frequency_hz, plan.exclude_hz)) for r in cut)
    doubts = (*contradicted, *(warning for warning in seen if warning.key not in answered), *loose)
    loaded = tuple(o for o in frf.outputs if ":r" not in o)
    noted, freedom = (*notes, *without_modes), measured.variance_dof
    provenance = Provenance(tuple(files), *about, noted, doubts, modes, loaded, variance_dof=freedom)
    if (asked := plan.frequencies) is not None:
        wanted = asked.modes or max(len(modes), 1)
        if len(modes) < wanted:
            raise refusal(where, f"{len(modes)} modes", f"at least {wanted}", "lower data.modes or widen the band")
        frequency, fitted = np.array([(mode.frequency_hz, mode.frequency_sd_hz) for mode in modes[:wanted]]).T
        sd = np.sqrt(fitted**2 + (asked.sd_relative * frequency) ** 2 + asked.sd_hz**2)
        return FrequencyData(frequency, sd, provenance)
    return _select(replace(measured, provenance=provenance), plan, where)


def _fingerprint(path: Path, name: str) -> MeasuredFile:
    if not path.is_file():
        near = difflib.get_close_matches(path.name, [p.name for p in path.parent.glob("*") if p.is_file()], 1, 0.6)
        actual = "a directory" if path.is_dir() else "no such file"
        remedy = f'did you mean "{near[0]}"?' if near else "names of files count from the directory of the case file"
        raise refusal(f"data.file: {name}", actual, "a measurement file", remedy)
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return MeasuredFile(name, path.stat().st_size, digest)


def _records(directory: Path, names: Sequence[str], layout: Mapping[str, str]) -> Iterator[Record]:
    """All records of all files, one after the other."""
    for name in names:
        for record in iter_records(directory / name, layout):
            yield record if len(names) == 1 else replace(record, where=f"{name}, {record.where}".rstrip(", "))


def _histories_and_frfs(records: Iterable[Record], plan: MeasurementPlan) -> tuple[list[TimeRecord], Iterable[Record]]:
    """The time histories where FRFs are made of them, as the plan says, or because there is no FRF; and the rest."""
    stream = iter(records)
    histories: list[TimeRecord] = []
    apart: list[Record] = []
    for record in stream:
        if isinstance(record, FrfRecord) and plan.signals is None:
            return [], itertools.chain(apart, [record], stream)
        if isinstance(record, TimeRecord):
            histories.append(record)
        else:
            apart.append(record)
    return histories, apart


def _frfs_of_histories(histories: list[TimeRecord], plan: MeasurementPlan, where: str) -> MadeFrfs:
    """FRFs made of the time histories of the mapped channels."""
    require_channels(plan.channels, [record.channel for record in histories], where)
    mapped = ((record, find_channel(plan.channels, record.channel)) for record in histories)
    with placed(where):
        histories = [restate_history(record, found[0].unit) for record, found in mapped if found]
        if isinstance(plan.signals, ShakerSettings):
            return frfs_of_shaker(histories, plan.signals)
        settings = plan.signals or settings_of(histories, plan.f_min_hz, plan.f_max_hz)
        made = frfs_of_hits(histories, settings)
    if plan.signals is not None:
        return made
    block = settings.hits.block_s
    cut = f"blocks of {block:g} s about each hit" if block else "each record is the block of one hit"
    return replace(made, notes=(f"FRFs were made of the hits of a hammer, H1, {cut}.", *made.notes))


def _apply_quantity(
    records: Iterable[FrfRecord], plan: MeasurementPlan, where: str
) -> tuple[list[FrfRecord], list[MeasurementWarning]]:
    """Records with the quantity that the plan states, if any, and warnings of files that say another."""
    stated, contradicted = [], {}
    for record in records:
        if plan.quantity is None and record.quantity is None:
            raise MeasurementError(
                f"{_place(record, where)}: found an FRF that does not say what it is (unit "
                f"{' or '.join(two_readings(record.unit) or [repr(record.unit)])}); expected "
                'receptance, mobility or accelerance; write for example quantity = "accelerance" in [data]'
            )
        if plan.quantity is not None and record.quantity not in (None, plan.quantity):
            says = f"the file says {record.quantity}" + (f" in {record.unit}" if record.unit else "")
            warning = warn("quantity_stated", says=says, stated=plan.quantity)
            contradicted[record.quantity, record.unit] = replace(warning, key="quantity", where=record.where)
        stated.append(record if plan.quantity is None else replace(record, quantity=plan.quantity))
        if record.factor is None and plan.frequencies is None and not plan.free_gain:
            readings = " or ".join(two_readings(record.unit) or ())
            what = f"which can be {readings}" if readings else "no motion over a force in SI units"
            expected = 'the units of response and force: unit = "g" and, of volts, sensitivity in [data.channels]'
            remedy = 'or kind = "measured_frequencies", or [uncertain.gain]'
            raise refusal(_place(record, where), f'the unit "{record.unit}", {what}', expected, remedy)
    return stated, list(contradicted.values())


def _place(record: FrfRecord, where: str) -> str:
    return f"{where}: {record.where}" if record.where else where


def _repetitions(records: Iterable[FrfRecord], where: str, *, allowed: bool) -> list[tuple[FrfRecord, ...]]:
    """Records apart by repetition: the first FRF of each pair of DOFs, the second, and so on."""
    by_pair: dict[tuple[str, str], list[FrfRecord]] = defaultdict(list)
    for record in records:
        by_pair[record.response, record.reference].append(record)
    pair, repeated = max(by_pair.items(), key=lambda item: len(item[1]))
    if len(repeated) > 1 and not allowed:
        remedy = 'leave one out, or write source = "repeats" in [data.variance] if they are repeated measurements'
        raise refusal(_place(repeated[1], where), f"another FRF of {pair[0]} over {pair[1]}", "each once", remedy)
    for pair, group in by_pair.items():
        if len(group) != len(repeated):
            found = f"{len(group)} FRFs of {pair[0]} over {pair[1]} and {len(repeated)} of others"
            raise refusal(where, found, "as many repetitions of each", "leave the surplus out")
    return list(zip(*by_pair.values(), strict=True))


def _modes(measured: FrfData, plan: MeasurementPlan) -> tuple[tuple[MeasuredMode, ...], tuple[str, ...]]:
    """Modes that the FRFs show, and notes on what was left out, or why they cannot be looked for.

    They are fitted to the accelerance, so that they do not depend on the quantity of a file.
    """
    accelerance = measured.converted("accelerance")
    try:
        modes, doubtful = modes_and_doubtful(accelerance.frf, accelerance.variance if plan.variance else None)
    except MeasurementError as error:
        if plan.frequencies is not None:
            raise
        return (), (f"Natural frequencies were not looked for: {error}.",)
    return modes, tuple(f"Not counted as a mode: {doubt.frequency_hz:.6g} Hz, {doubt.reason}." for doubt in doubtful)


def _select(measured: FrfData, plan: MeasurementPlan, where: str) -> FrfData:
    """The FRFs that the likelihood sees, with those at the joint."""
    assert measured.provenance is not None
    used = replace_stations(measured, plan.rotations)
    derived = {rotation.dof for rotation in plan.rotations if rotation.in_likelihood}
    for key, stated, present in (("outputs", plan.outputs, used.frf.outputs), ("inputs", plan.inputs, used.frf.inputs)):
        for i, label in enumerate(stated):
            if label not in present:
                replaced = key == "outputs" and label in measured.frf.outputs
                taken = ", which a rotation in the likelihood replaces" if replaced else ""
                found, expected = f"found {label}{taken}", f"one of {', '.join(present)}"
                raise MeasurementError.of(where, (key, i), found, expected, "map its channel or remove it")
    outputs = tuple(o for o in used.frf.outputs if not plan.outputs or o in plan.outputs or o in derived)
    inputs = tuple(i for i in used.frf.inputs if not plan.inputs or i in plan.inputs)
    joint_frf, missing = None, ""
    try:
        every = measured.frf.select(measured.frf.outputs, inputs)
        joint_frf = joint_frf_set(every, plan.rotations, outputs, plan.joint_dofs)
    except MeasurementError as error:
        missing = str(error)
    provenance = replace(measured.provenance, iteration=missing)
    return replace(used.select(outputs, inputs), joint_frf=joint_frf, provenance=provenance)
