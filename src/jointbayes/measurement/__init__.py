"""Measurements and their noise."""

from jointbayes.measurement.data import FrequencyMeasurement, FrfMeasurement, Measurement
from jointbayes.measurement.variance import CoherenceNoise, NoiseLaw, RelativeNoise
from jointbayes.measurement.virtual.synthetic import synthesise_frf

__all__ = [
    "CoherenceNoise",
    "FrequencyMeasurement",
    "FrfMeasurement",
    "Measurement",
    "NoiseLaw",
    "RelativeNoise",
    "synthesise_frf",
]
