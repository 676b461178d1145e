"""Frequency response functions: measured sets, the forward models that predict them."""

from jointbayes.frf.coupling import LowRankCoupling as LowRankCoupling
from jointbayes.frf.coupling import NoisePropagation as NoisePropagation
from jointbayes.frf.coupling import ReceptanceModel as ReceptanceModel
from jointbayes.frf.coupling import receptance_model as receptance_model
from jointbayes.frf.measured_body import AnyStructure as AnyStructure
from jointbayes.frf.measured_body import MeasuredBody as MeasuredBody
from jointbayes.frf.measured_body import Substructures as Substructures
from jointbayes.frf.modal import AssembledModes as AssembledModes
from jointbayes.frf.modal import NaturalFrequencies as NaturalFrequencies
from jointbayes.frf.modal import least_reach_hz as least_reach_hz
from jointbayes.frf.modal import rigid_body_modes as rigid_body_modes
from jointbayes.frf.mode_shapes import AssembledShapes as AssembledShapes
from jointbayes.frf.mode_shapes import Modal as Modal
from jointbayes.frf.mode_shapes import held_at as held_at
from jointbayes.frf.ports import Ports as Ports
from jointbayes.frf.synthetic import DirectSolve as DirectSolve
from jointbayes.frf.synthetic import synthesise_frf as synthesise_frf
