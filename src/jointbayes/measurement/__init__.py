"""Measurements and their noise."""

from jointbayes.measurement.data import FrequencyMeasurement, FrfMeasurement, ModalMeasurement
from jointbayes.measurement.mode_data import Measurement, ModeMeasurement, ModeShapes, ModeValue, Observed
from jointbayes.measurement.simulated import synthesise_frf
from jointbayes.measurement.variance import CoherenceNoise, NoiseLaw, RelativeNoise

__all__ = [
    "CoherenceNoise",
    "FrequencyMeasurement",
    "FrfMeasurement",
    "Measurement",
    "ModalMeasurement",
    "ModeMeasurement",
    "ModeShapes",
    "ModeValue",
    "NoiseLaw",
    "Observed",
    "RelativeNoise",
    "synthesise_frf",
]
