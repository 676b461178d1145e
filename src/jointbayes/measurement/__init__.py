"""Measurements and their noise."""

from jointbayes.measurement.data import Data as Data
from jointbayes.measurement.data import FrequencyData as FrequencyData
from jointbayes.measurement.data import FrfData as FrfData
from jointbayes.measurement.data import ModalData as ModalData
from jointbayes.measurement.modal_ratios import MotionRatio as MotionRatio
from jointbayes.measurement.mode_data import ModeData as ModeData
from jointbayes.measurement.mode_data import split_modes as split_modes
from jointbayes.measurement.mode_values import Antiresonances as Antiresonances
from jointbayes.measurement.mode_values import ModalConstants as ModalConstants
from jointbayes.measurement.mode_values import ModeShapes as ModeShapes
from jointbayes.measurement.mode_values import Observed as Observed
from jointbayes.measurement.simulated import synthesise_frf as synthesise_frf
from jointbayes.measurement.variance import CoherenceNoise as CoherenceNoise
from jointbayes.measurement.variance import NoiseLaw as NoiseLaw
from jointbayes.measurement.variance import RelativeNoise as RelativeNoise
