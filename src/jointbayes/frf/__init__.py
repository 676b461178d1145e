"""Frequency response functions: measured sets, the forward models that predict them."""

from jointbayes.frf.coupling import LowRankCoupling, receptance_model
from jointbayes.frf.direct import DirectSolve
from jointbayes.frf.frf_set import FrfSet, Quantity, quantity_factor
from jointbayes.frf.modal import AssembledModes, NaturalFrequencies
from jointbayes.frf.ports import Ports, ReceptanceModel

__all__ = [
    # data
    "FrfSet",
    "Quantity",
    "quantity_factor",
    # forward models
    "AssembledModes",
    "DirectSolve",
    "LowRankCoupling",
    "NaturalFrequencies",
    "Ports",
    "ReceptanceModel",
    "receptance_model",
]
