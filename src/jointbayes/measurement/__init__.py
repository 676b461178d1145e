"""Measurements and their noise."""

from jointbayes.measurement.data import Data, FrequencyData, FrfData, ModalData
from jointbayes.measurement.mode_data import ModeData, ModeShapes, ModeValue, Observed, split_modes
from jointbayes.measurement.simulated import synthesise_frf
from jointbayes.measurement.variance import CoherenceNoise, NoiseLaw, RelativeNoise

__all__ = [
    "CoherenceNoise",
    "Data",
    "FrequencyData",
    "FrfData",
    "ModalData",
    "ModeData",
    "ModeShapes",
    "ModeValue",
    "NoiseLaw",
    "Observed",
    "RelativeNoise",
    "split_modes",
    "synthesise_frf",
]
