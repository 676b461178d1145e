"""Taking the mass of accelerometers out of measured FRFs: exact where the file has the FRFs this needs.

References
----------
Ashory, M. R. (1999). High quality modal testing methods. PhD thesis, Imperial College London, chapter 3 (mass
cancellation).
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from vibrecords.arrays import Array, ComplexArray, Indices, quantity_factor
from vibrecords.data import FrfData
from vibrecords.errors import refusal
from vibrecords.frf_set import FrfSet

_STEP = 1e-6  # of the largest receptance of a line, in differences of a function that is smooth


def remove_accelerometers(measured: FrfData, masses: Mapping[str, float], *, roving: bool = False) -> FrfData:
    """FRFs of the structure without its accelerometers.

    With masses m at sensors S the structure measured has the dynamic stiffness Z − ω²M; taking the masses away leaves
    H − H_oS (1/(ω²m) + H_SS)⁻¹ H_Si, in receptances H as measured. That is exact, but only as good as the FRFs: it
    needs a force at each sensor (or by reciprocity a sensor at the force).

    Parameters
    ----------
    measured
        FRFs as measured; outputs and inputs are DOFs.
    masses
        Mass in kg by DOF, all of them outputs.
    roving
        Whether one sensor moved from output to output, so that each FRF has the mass at its own output only; otherwise
        all sensors were on the structure all the time.

    Returns
    -------
    FrfData
        Without coherence, which is that of the measured FRFs. The variance is that to first order in independent
        errors; those of different FRFs are correlated where the correction is large.

    Raises
    ------
    MeasurementError
        If an FRF that the correction needs was not measured.

    Examples
    --------
    >>> import numpy as np
    >>> from vibrecords import FrfSet, quantity_factor
    >>> f = np.array([10.0])
    >>> mass = -1 / (2 * np.pi * f[:, None, None]) ** 2 / 1.002  # a free mass of 1 kg with 2 g on it
    >>> loaded = FrfData(FrfSet(f, mass, ("1:y",), ("1:y",)), np.ones((1, 1, 1)))
    >>> bool(np.isclose(remove_accelerometers(loaded, {"1:y": 0.002}).frf.values, mass * 1.002))
    True
    """
    given = {dof: mass for dof, mass in masses.items() if mass > 0}
    if not given:
        return measured
    frf = measured.frf.converted("receptance")
    factor = np.abs(quantity_factor(frf.frequency_hz, measured.frf.quantity))[:, None, None]
    values, variance = frf.values, measured.variance / factor**2
    clean, clean_variance = values.copy(), variance.copy()
    groups = [((dof,), (dof,)) for dof in given] if roving else [(tuple(given), frf.outputs)]
    for sensors, outputs in groups:
        correction = _correction(frf, sensors, np.array([given[s] for s in sensors]), outputs)
        rows = [frf.outputs.index(output) for output in outputs]
        clean[:, rows] = here = correction(values)
        # the variance to first order, by differences
        step, total = _STEP * np.abs(values).max(axis=(1, 2)), np.zeros(here.shape)
        for o, i in np.ndindex(values.shape[1:]):
            moved = values.copy()
            moved[:, o, i] += step
            slope = (correction(moved) - here) / step[:, None, None]
            total += np.abs(slope) ** 2 * variance[:, o, i, None, None]
        clean_variance[:, rows] = total
    corrected = replace(frf, values=clean, coherence=None).converted(measured.frf.quantity)
    return replace(measured, frf=corrected, variance=clean_variance * factor**2)


def _correction(
    frf: FrfSet, sensors: tuple[str, ...], masses: Array, outputs: tuple[str, ...]
) -> Callable[[ComplexArray], ComplexArray]:
    """Receptances of some outputs without masses at sensors, as an analytic function of all that were measured."""
    rows, at_sensors = ([frf.outputs.index(label) for label in labels] for labels in (outputs, sensors))
    # index of the response of an output, or of a sensor, to a force at each sensor
    to_output, to_sensor = (np.array([[_place(frf, o, s) for s in sensors] for o in few]) for few in (outputs, sensors))
    flexibility = np.eye(len(sensors)) / ((2 * np.pi * frf.frequency_hz)[:, None, None] ** 2 * masses)

    def corrected(values: ComplexArray) -> ComplexArray:
        """Corrected receptances, shape (lines, outputs, inputs)."""
        load = np.linalg.solve(flexibility + _take(values, to_sensor), values[:, at_sensors])
        return values[:, rows] - _take(values, to_output) @ load

    return corrected


def _take(values: ComplexArray, places: Indices) -> ComplexArray:
    """Values at places of an array (lines, outputs, inputs), shape (lines, rows of places, columns)."""
    return values[:, places[..., 0], places[..., 1]]


def _place(frf: FrfSet, output: str, input_: str) -> tuple[int, int]:
    """Row and column of an FRF or, where it was not measured, of its reciprocal."""
    for row, column in ((output, input_), (input_, output)):
        if row in frf.outputs and column in frf.inputs:
            return frf.outputs.index(row), frf.inputs.index(column)
    found = f"no FRF of {output} over a force at {input_}"
    remedy = "measure it, or put the mass into the model: structure.accelerometer_mass_g"
    raise refusal("accelerometer mass", found, f"it, to take the mass at {input_} out of the data", remedy)
