"""Measurements and their noise."""

from jointbayes.measurement.data import FrequencyData, FrfData, ModalData
from jointbayes.measurement.mode_data import Data, ModeData, ModeShapes, ModeValue, Observed
from jointbayes.measurement.simulated import synthesise_frf
from jointbayes.measurement.variance import CoherenceNoise, NoiseLaw, RelativeNoise

__all__ = [
    "CoherenceNoise",
    "FrequencyData",
    "FrfData",
    "Data",
    "ModalData",
    "ModeData",
    "ModeShapes",
    "ModeValue",
    "NoiseLaw",
    "Observed",
    "RelativeNoise",
    "synthesise_frf",
]
