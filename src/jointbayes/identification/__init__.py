"""Point estimates of a joint: the paper's iteration, a start without a guess, the posterior mode."""

from jointbayes.identification.equation_error import compliance_start
from jointbayes.identification.map_estimate import LocalMode, MapEstimate, StartOutcome, maximise_posterior, refine
from jointbayes.identification.screening import screened_draws
from jointbayes.identification.sensitivity import IterationHistory, SensitivityKind, sensitivity_iteration

__all__ = [
    "IterationHistory",
    "LocalMode",
    "MapEstimate",
    "SensitivityKind",
    "StartOutcome",
    "compliance_start",
    "maximise_posterior",
    "refine",
    "screened_draws",
    "sensitivity_iteration",
]
