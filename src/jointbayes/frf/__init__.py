"""Frequency response functions: measured sets, the forward models that predict them."""

from jointbayes.frf.coupling import LowRankCoupling, NoisePropagation, receptance_model
from jointbayes.frf.direct import DirectSolve
from jointbayes.frf.frf_set import FrfSet, Quantity, quantity_factor
from jointbayes.frf.measured_body import AnyStructure, MeasuredBody, MeasuredFile, Substructures
from jointbayes.frf.modal import AssembledModes, NaturalFrequencies, least_reach_hz, rigid_body_modes
from jointbayes.frf.mode_shapes import AssembledShapes, HeldFrequencies, Modal
from jointbayes.frf.ports import Ports, ReceptanceModel

__all__ = [
    # data
    "FrfSet",
    "MeasuredBody",
    "MeasuredFile",
    "Quantity",
    "Substructures",
    "quantity_factor",
    # forward models
    "AnyStructure",
    "AssembledModes",
    "AssembledShapes",
    "DirectSolve",
    "HeldFrequencies",
    "LowRankCoupling",
    "Modal",
    "NaturalFrequencies",
    "NoisePropagation",
    "Ports",
    "ReceptanceModel",
    "least_reach_hz",
    "receptance_model",
    "rigid_body_modes",
]
