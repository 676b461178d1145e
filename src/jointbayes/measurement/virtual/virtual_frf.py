"""FRFs as an analyser writes them after a test with a known truth: noise, coherence, averages; no time histories."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet
from jointbayes.measurement.formats.units import si_frf_unit
from jointbayes.measurement.records import FrfRecord
from jointbayes.measurement.virtual.synthetic import NoiseLaw

__all__ = ["channel_label", "frf_records", "noisy_frf"]


def channel_label(dof: str) -> str:
    """Label of a DOF as files of universal format have it.

    Examples
    --------
    >>> channel_label("11:y"), channel_label("1:rz")
    ('Point:11:Y+', 'Point:1:RZ+')
    """
    node, direction = dof.split(":")
    return f"Point:{node}:{direction.upper()}+"


def noisy_frf(true: FrfSet, law: NoiseLaw, averages: int, rng: np.random.Generator) -> FrfSet:
    """H1 estimates and their coherence from `averages` averages with noise at the output.

    The noise of each average is n times that of the result, the input the same in each, as for a hammer. Then the mean
    and the sum of squares about it are independent (Cochran), so that the averages themselves need not be drawn:
    H1 = H + noise of variance σ², and γ² = |H1|²/(|H1|² + r) with r/σ² from a gamma distribution of shape n − 1.

    Parameters
    ----------
    true
        Exact FRFs.
    law
        Law of the noise that is left after averaging; its σ² is taken at the exact FRF.
    averages
        Number n of averages; a single one has no coherence that says anything, and gets none.
    rng
        Source of the noise.

    Returns
    -------
    FrfSet
        With coherence and averages.

    Raises
    ------
    MeasurementError
        If there is not at least one average.

    References
    ----------
    Bendat, J. S., Piersol, A. G. (2010). Random Data, 4th ed., section 9.2. DOI 10.1002/9781118032428
    """
    if averages < 1:
        raise MeasurementError(f"virtual test: found {averages} averages; expected 1 or more; correct it")
    variance = law.variance(true.values)
    real, imag = rng.standard_normal((2, *true.values.shape))
    values = true.values + np.sqrt(variance / 2) * (real + 1j * imag)
    coherence = None
    if averages > 1:
        rest = variance * rng.standard_gamma(averages - 1, true.values.shape)
        coherence = np.abs(values) ** 2 / (np.abs(values) ** 2 + rest)
    return FrfSet(true.frequency_hz, values, true.outputs, true.inputs, true.quantity, coherence, averages)


def frf_records(frf: FrfSet, notes: tuple[str, ...] = ()) -> list[FrfRecord]:
    """One record for each pair of a set, channels labelled ``Point:11:Y+`` for the DOF ``11:y``.

    Parameters
    ----------
    frf
        FRFs whose outputs and inputs are DOF labels.
    notes
        Passed on to each record.
    """
    coherence: NDArray[np.float64] | None = frf.coherence
    return [
        FrfRecord(
            channel_label(output),
            channel_label(input_),
            frf.frequency_hz,
            frf.values[:, i, j],
            frf.quantity,
            si_frf_unit(frf.quantity),
            None if coherence is None else coherence[:, i, j],
            frf.averages,
            "virtual test",
            notes,
        )
        for j, input_ in enumerate(frf.inputs)
        for i, output in enumerate(frf.outputs)
    ]
