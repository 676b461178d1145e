"""What is asked for of measurement files: which channels, lines, variance, masses, windows and rotations."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from jointbayes.frf import Quantity
from jointbayes.measurement.channels import Channel
from jointbayes.measurement.rotations import Rotation
from jointbayes.measurement.signals.impact import ImpactSettings
from jointbayes.measurement.signals.spectra import ShakerSettings
from jointbayes.measurement.variance import RelativeNoise


@dataclass(frozen=True, slots=True)
class VarianceSource:
    """Where the variance of FRFs comes from.

    Parameters
    ----------
    source
        ``"coherence"`` and averages, ``"repeats"`` of the same measurement, or ``"relative"``: the law alone.
    law
        Law of the accelerance's noise: all of it, or the least that is believed; None where nothing is too little.
    averages
        Number of averages, where the file does not say or is wrong.
    law_for_one_average
        Whether the law is also all of the noise of FRFs of one average, of which coherence says nothing.
    """

    source: Literal["coherence", "repeats", "relative"]
    law: RelativeNoise | None
    averages: int | None = None
    law_for_one_average: bool = False


@dataclass(frozen=True, slots=True)
class FrequencyPlan:
    """Natural frequencies in place of FRFs: how many, the lowest ones, and what is added to the sd of the fit."""

    modes: int | None = None
    sd_relative: float = 0.0
    sd_hz: float = 0.0


@dataclass(frozen=True, slots=True)
class MeasurementPlan:
    """How a measurement is assembled from records.

    Parameters
    ----------
    channels
        What each channel stands for, by its label in the file.
    variance
        None leaves it open; FRFs that are data need it.
    quantity
        What the FRFs are, whatever the file says; None takes the file's word.
    f_min_hz, f_max_hz
        Band of the lines that are used.
    exclude_hz
        Bands, lowest and highest frequency each, whose lines are left out.
    conjugate
        Whether the files hold complex conjugates: FRFs with the time factor exp(−iωt).
    line_step
        Every how many lines one is kept; None keeps all, or with windows those that are independent.
    roving
        Whether one accelerometer moved from output to output; otherwise all stayed on.
    signals
        How FRFs are made of time histories; None takes the FRFs of the files.
    outputs, inputs
        DOFs that are used; empty: all.
    rotations
        Rotations from translations at stations.
    joint_dofs
        DOFs of the joint on both of its sides, at which the paper's iteration needs FRFs.
    frequencies
        Set where natural frequencies are the data.
    """

    channels: Mapping[str, Channel]
    variance: VarianceSource | None
    quantity: Quantity | None = None
    f_min_hz: float | None = None
    f_max_hz: float | None = None
    line_step: int | None = None
    roving: bool = False
    signals: ImpactSettings | ShakerSettings | None = None
    outputs: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    rotations: tuple[Rotation, ...] = ()
    joint_dofs: tuple[str, ...] = ()
    frequencies: FrequencyPlan | None = None
    exclude_hz: tuple[tuple[float, float], ...] = ()
    conjugate: bool = False
