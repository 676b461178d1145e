"""Measurements and their noise."""

from jointbayes.measurement.data import FrequencyMeasurement, FrfMeasurement, Measurement
from jointbayes.measurement.synthetic import RelativeNoise, synthesise_frf

__all__ = ["FrequencyMeasurement", "FrfMeasurement", "Measurement", "RelativeNoise", "synthesise_frf"]
