"""The variance of measured FRFs: from their coherence, from repeated measurements, or as a law states it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrecords.data import FrfData
from vibrecords.errors import MeasurementError
from vibrecords.frf_set import FrfSet
from vibrecords.measurement_plan import VarianceSource
from vibrecords.modal_fit import fit_modes
from vibrecords.variance import RelativeNoise, coherence_variance

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
    try:
        variance = coherence_variance(frf)
    except MeasurementError as error:
        raise MeasurementError(f"{where}: {error}") from error
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
        raise MeasurementError(
            f"{where}: found {len(frfs)} measurement; expected two or more; measure again, or state the noise"
        )
    first = frfs[0]
    for number, other in enumerate(frfs[1:], 2):
        for what, same in (
            ("lines", np.array_equal(first.frequency_hz, other.frequency_hz)),
            ("DOFs", (first.outputs, first.inputs) == (other.outputs, other.inputs)),
            ("quantity", first.quantity == other.quantity),
        ):
            if not same:
                raise MeasurementError(
                    f"{where}: found other {what} in measurement {number} than in the first; expected the same; "
                    "leave it out or bring it to the same"
                )
    values = np.stack([frf.values for frf in frfs])
    m, mean = len(frfs), values.mean(axis=0)
    scatter = np.sum(np.abs(values - mean) ** 2, axis=0) / (m * (m - 1))
    if not scatter.any():
        raise MeasurementError(
            f"{where}: found {m} measurements that are the same to the last digit; expected independent ones, which "
            "differ by their noise; do not repeat one file"
        )
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
