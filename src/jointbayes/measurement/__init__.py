"""Measurements and their noise."""

from jointbayes.measurement.data import Data, FrequencyData, FrfData, ModalData
from jointbayes.measurement.mode_data import ModeData, split_modes
from jointbayes.measurement.mode_values import Antiresonances, ModalConstants, ModeShapes, ModeValue, Observed
from jointbayes.measurement.simulated import synthesise_frf
from jointbayes.measurement.variance import CoherenceNoise, NoiseLaw, RelativeNoise

__all__ = [
    "Antiresonances",
    "CoherenceNoise",
    "Data",
    "FrequencyData",
    "FrfData",
    "ModalConstants",
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
