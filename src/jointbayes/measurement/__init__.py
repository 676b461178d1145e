"""Measurements and their noise."""

from jointbayes.measurement.data import FrequencyMeasurement, FrfMeasurement, Measurement
from jointbayes.measurement.virtual.synthetic import CoherenceNoise, NoiseLaw, RelativeNoise, synthesise_frf

__all__ = [
    "CoherenceNoise",
    "FrequencyMeasurement",
    "FrfMeasurement",
    "Measurement",
    "NoiseLaw",
    "RelativeNoise",
    "synthesise_frf",
]
