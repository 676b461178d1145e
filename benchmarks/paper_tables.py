"""What Cao, Li and He print, beside what their own inputs give: an audit.

``python -m benchmarks.paper_tables`` prints it.

References
----------
Cao, H., Li, B., He, Z. A joint stiffness identification method based on finite element modeling and frequency
response functions, Tables 1 to 4.
"""

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from jointbayes.frf import NaturalFrequencies
from jointbayes.joint import Joint, parametrisation_named
from jointbayes.rounding import signed
from jointbayes.structure import BeamMaterial, ModalDamping, Section, Structure, beam
from vibrecords.arrays import Array


@dataclass(frozen=True, slots=True)
class FrequencyTable:
    """Natural frequencies as the paper prints them: experiment and simulation in Hz, relative error in %."""

    experiment: tuple[float, float, float]
    simulation: tuple[float, float, float]
    printed_error: tuple[float, float, float]

    @property
    def error(self) -> Array:
        """Relative error of the simulation recomputed from the printed frequencies, %."""
        return 100 * (np.array(self.simulation) / np.array(self.experiment) - 1)


TABLE_2 = FrequencyTable((120.0, 762.0, 2101.0), (140.0, 862.0, 2357.0), (16.7, 13.1, 12.2))
TABLE_4 = FrequencyTable((120.0, 762.0, 2101.0), (123.0, 761.0, 2088.0), (2.5, -0.1, 0.6))
#: Identified stiffness (k11, k12, k22) in N/m, N, N·m/rad.
TABLE_3 = (5.05e9, 3.44e7, 1.52e6)
_TABLE_1 = BeamMaterial(2.1e11, 0.3, 7800.0)
_DIAMETER = 0.025
_PRINTED_LENGTH, _LENGTH_OF_TABLE_2 = 0.383, 0.360
_JOINT = Joint(("1:y", "1:rz"))
_K_J = parametrisation_named("log").matrix  # of the paper's (k11, k12, k22)


@dataclass(frozen=True, slots=True)
class Finding:
    """One place where the paper does not add up.

    Parameters
    ----------
    claim
        What the paper says.
    found
        What its own inputs give, in a sentence with numbers.
    head, rows
        The numbers side by side, formatted.
    values
        The computed numbers, unformatted: Hz, or % for the last finding.
    """

    claim: str
    found: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    values: Array


def _rod(length: float, shear_coefficient: float | None) -> Structure:
    section = Section.circle(_DIAMETER)
    return beam(length, section, _TABLE_1, ModalDamping((0.01,)), shear_coefficient=shear_coefficient)


def clamped_frequencies_hz(length: float, shear_coefficient: float | None = None, count: int = 3) -> Array:
    """Frequencies of Table 1's rod, rigidly clamped, of another length in m; κ by Cowper's formula if None."""
    return _rod(length, shear_coefficient).fixed(_JOINT.dofs).modes().frequency_hz[:count]


def audit() -> tuple[Finding, ...]:
    """Compute the four findings."""
    return _length_of_table_2(), _frequencies_of_table_3(), _two_springs(), _sign_in_table_4()


def _length_of_table_2() -> Finding:
    printed = clamped_frequencies_hz(_PRINTED_LENGTH, 0.9)
    shorter = clamped_frequencies_hz(_LENGTH_OF_TABLE_2, 0.9)
    return Finding(
        "Table 2 gives the frequencies of Table 1's beam, 383 mm long, with a rigid clamp.",
        f"They are those of a beam of 360 mm with shear coefficient 0.9 ({_list(shorter)} Hz, to the last printed "
        f"digit; Cowper's coefficient gives {_list(clamped_frequencies_hz(_LENGTH_OF_TABLE_2))} Hz); the 383 mm of "
        f"Table 1 give {_list(printed)} Hz. About 23 mm of the beam seem to sit in the vise.",
        ("Mode", "Table 2 (Hz)", "383 mm, rigid (Hz)", "360 mm, rigid (Hz)"),
        _rows(TABLE_2.simulation, printed, shorter),
        shorter,
    )


def _frequencies_of_table_3() -> Finding:
    model = NaturalFrequencies(_rod(_PRINTED_LENGTH, None), _JOINT, 3)
    predicted = model.frequency_hz(_K_J(TABLE_3))[0]
    return Finding(
        "Table 4 gives the frequencies with the stiffnesses of Table 3.",
        f"Table 3's stiffnesses in Table 1's beam give {_list(predicted)} Hz, not {_list(TABLE_4.simulation, 0)} Hz: "
        f"Table 4 does not follow from Tables 1 and 3.",
        ("Mode", "Table 4 (Hz)", "Table 3 in Table 1's beam (Hz)", "Difference (%)"),
        tuple(
            (str(i), f"{t:.0f}", f"{f:.1f}", signed(100 * (f / t - 1)))
            for i, (t, f) in enumerate(zip(TABLE_4.simulation, predicted, strict=True), 1)
        ),
        predicted,
    )


def _two_springs() -> Finding:
    model = NaturalFrequencies(_rod(_LENGTH_OF_TABLE_2, None), _JOINT, 3)
    measured = np.array(TABLE_2.experiment)

    def stiffness(log_k: Array) -> Array:
        k11, k22 = np.exp(log_k)
        return np.array([k11, 0.0, k22])

    def error(log_k: Array) -> Array:
        return model.frequency_hz(_K_J(stiffness(log_k)))[0] / measured - 1

    fit = optimize.least_squares(error, np.log([1e9, 1e6]))
    k11, _, k22 = stiffness(fit.x)
    predicted = model.frequency_hz(_K_J(stiffness(fit.x)))[0]
    worst = 100 * np.abs(predicted / measured - 1).max()
    paper = np.abs(TABLE_4.error).max()
    ratio = np.array([TABLE_3[0] / k11, TABLE_3[2] / k22])
    return Finding(
        "The identified joint with coupling reproduces the measured frequencies to 2.5 %.",
        f"With 360 mm and two plain springs, no coupling (k11 = {k11:.3e} N/m, k22 = {k22:.3e} N·m/rad), the measured "
        f"frequencies are met within {worst:.2f} %, where the paper reaches {paper:.1f} %. These springs are "
        f"{ratio[0]:.0f} and {ratio[1]:.0f} times softer than Table 3's.",
        ("Mode", "Measured (Hz)", "Two springs, 360 mm (Hz)", "Error (%)", "Paper's error (%)"),
        tuple(
            (str(i), f"{m:.0f}", f"{f:.2f}", signed(100 * (f / m - 1)), signed(e, 1))
            for i, (m, f, e) in enumerate(zip(measured, predicted, TABLE_4.error, strict=True), 1)
        ),
        predicted,
    )


def _sign_in_table_4() -> Finding:
    error = TABLE_4.error
    return Finding(
        "Table 4 prints relative errors of 2.5, -0.1 and 0.6 %.",
        f"From its own frequencies the third is {error[2]:.1f} %: 2088 Hz lie below 2101 Hz, the sign is lost.",
        ("Mode", "Printed (%)", "Recomputed (%)"),
        tuple(
            (str(i), signed(p, 1), signed(e))
            for i, (p, e) in enumerate(zip(TABLE_4.printed_error, error, strict=True), 1)
        ),
        error,
    )


def _rows(*columns: tuple[float, ...] | Array) -> tuple[tuple[str, ...], ...]:
    printed, *computed = columns
    return tuple(
        (str(i), f"{row[0]:.0f}", *(f"{value:.2f}" for value in row[1:]))
        for i, row in enumerate(zip(printed, *computed, strict=True), 1)
    )


def _list(values: tuple[float, ...] | Array, digits: int = 1) -> str:
    return " / ".join(f"{value:.{digits}f}" for value in values)


if __name__ == "__main__":
    for finding in audit():
        print(finding.claim, finding.found, sep="\n", end="\n\n")
