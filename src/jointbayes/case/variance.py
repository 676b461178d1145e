"""The variance that a case states for the FRFs of its files, whatever quantity these are kept in."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointbayes.case.schema import case as schema
from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet, quantity_factor
from jointbayes.measurement.modal.fit import fit_modes
from jointbayes.measurement.variance import coherence_variance, mean_of_repeats

__all__ = ["as_accelerance", "variance_of"]

Array = NDArray[np.float64]

#: χ² per degree of freedom up to which a modal fit is close enough to the FRFs to tell how large they are.
_EXPLAINED = 10.0


def as_accelerance(frf: FrfSet, variance: Array | None) -> tuple[FrfSet, Array | None]:
    """FRFs and variance as accelerance, so that what is fitted to them does not depend on the quantity of a file."""
    factor = np.abs(quantity_factor(frf.frequency_hz, "accelerance", frf.quantity))[:, None, None]
    return frf.converted("accelerance"), None if variance is None else variance * factor**2


def variance_of(
    sets: Sequence[FrfSet], spec: schema.VarianceSpec | None, where: str
) -> tuple[FrfSet, Array | None, str, int | None]:
    """FRFs with their variance.

    Parameters
    ----------
    sets
        FRFs; more than one where measurements were repeated.
    spec
        `[data.variance]`; None leaves the variance open.
    where
        The files, for messages.

    Returns
    -------
    frf : FrfSet
        The FRFs, or the mean of repeated ones.
    variance : ndarray, shape (lines, outputs, inputs), or None
    words : str
        Where the variance comes from.
    dof : int or None
        Degrees of freedom from which each line's variance was estimated; None where it was not.

    Raises
    ------
    MeasurementError
        If the FRFs do not tell what the case wants to take from them.
    """
    frf = sets[0]
    if spec is None:
        return frf, None, "estimated from what the modal fit leaves", None
    if spec.averages is not None:
        frf = replace(frf, averages=spec.averages)
    if spec.source == "repeats":
        frf, variance = mean_of_repeats(sets, floor=0.0)
        words = f"from the scatter of {len(sets)} repeated measurements, whose mean is used, {_least_words(spec)}"
        return frf, np.maximum(variance, _stated(frf, spec)), words, 2 * (len(sets) - 1)
    if spec.source == "relative" or (frf.averages == 1 and "relative" in spec.model_fields_set):
        alone = "" if spec.source == "relative" else " (of one average coherence says nothing)"
        words = f"as stated: {100 * spec.relative:g} % of |H| and {100 * spec.floor:g} % of the median accelerance"
        variance, smooth = _stated_of_fit(frf, spec)
        return frf, variance, words + alone + smooth, None
    try:
        variance = coherence_variance(frf, floor=0.0)
    except MeasurementError as error:
        raise MeasurementError(f"{where}: {error}") from error
    words = f"from the coherence of {frf.averages} averages, {_least_words(spec)}"
    assert frf.averages is not None
    return frf, np.maximum(variance, _stated(frf, spec)), words, 2 * (frf.averages - 1)


def _stated_of_fit(frf: FrfSet, spec: schema.VarianceSpec) -> tuple[Array, str]:
    """Variance by the law, of |H| without its noise where a modal fit tells it; and what was done, in words.

    A variance in proportion to the *measured* |H|² favours lines that the noise made small, so that everything fitted
    comes out too small by the variance relative to |H|², which many lines do not average away.
    """
    first = _stated(frf, spec)
    try:
        fit = fit_modes(*as_accelerance(frf, first))
    except MeasurementError:
        return first, ""
    if not fit.modes or fit.misfit > _EXPLAINED:
        return first, ""
    smooth = replace(frf.converted("accelerance"), values=fit.values, coherence=None)
    return _stated(smooth.converted(frf.quantity), spec), "; |H| is that of a modal fit, without the noise"


def _least_words(spec: schema.VarianceSpec) -> str:
    return f"but at least a standard deviation of {100 * spec.relative:g} % of |H| in each part"


def _stated(frf: FrfSet, spec: schema.VarianceSpec) -> Array:
    """Variance by the law of relative and floor, of accelerance: it must not depend on how a file keeps its FRFs."""
    factor = np.abs(quantity_factor(frf.frequency_hz, "accelerance", frf.quantity))[:, None, None]
    magnitude = np.abs(frf.values) * factor
    sd_of_part = spec.relative * magnitude + spec.floor * np.median(magnitude, axis=0)
    variance: Array = 2 * (sd_of_part / factor) ** 2
    return variance
