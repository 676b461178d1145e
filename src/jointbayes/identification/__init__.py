"""Point estimates of a joint: the paper's iteration, a start without a guess, the posterior mode."""

from jointbayes.identification.compliance_fit import compliance_start
from jointbayes.identification.effort import first_starts, search_further
from jointbayes.identification.images import Images
from jointbayes.identification.map_estimate import LocalMode, MapEstimate, SearchEffort, StartOutcome
from jointbayes.identification.mode_search import ModeSearch
from jointbayes.identification.paper_iteration import (
    IterationHistory,
    SensitivityKind,
    missing_for_iteration,
    part_to_iterate,
    sensitivity_iteration,
    why_not_iterated,
)
from jointbayes.identification.reconstruction import reconstructed_starts
from jointbayes.identification.refine import refine, refine_where_possible
from jointbayes.identification.resonances import resonances_hz
from jointbayes.identification.starts import frequency_starts, screened_draws

__all__ = [
    "Images",
    "IterationHistory",
    "LocalMode",
    "MapEstimate",
    "ModeSearch",
    "SearchEffort",
    "SensitivityKind",
    "StartOutcome",
    "compliance_start",
    "first_starts",
    "frequency_starts",
    "missing_for_iteration",
    "part_to_iterate",
    "reconstructed_starts",
    "refine",
    "refine_where_possible",
    "resonances_hz",
    "screened_draws",
    "search_further",
    "sensitivity_iteration",
    "why_not_iterated",
]
