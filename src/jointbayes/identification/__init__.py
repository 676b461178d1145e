"""Point estimates of a joint: the paper's iteration, a start without a guess, the posterior mode."""

from jointbayes.identification.compliance_fit import compliance_start
from jointbayes.identification.effort import first_starts, search_further
from jointbayes.identification.map_estimate import LocalMode, MapEstimate, SearchEffort, StartOutcome
from jointbayes.identification.mode_search import Images, ModeSearch
from jointbayes.identification.paper_iteration import (
    IterationHistory,
    missing_for_iteration,
    part_to_iterate,
    sensitivity_iteration,
    why_not_iterated,
)
from jointbayes.identification.refine import refine, refine_where_possible

__all__ = [
    "Images",
    "IterationHistory",
    "LocalMode",
    "MapEstimate",
    "ModeSearch",
    "SearchEffort",
    "StartOutcome",
    "compliance_start",
    "first_starts",
    "missing_for_iteration",
    "part_to_iterate",
    "refine",
    "refine_where_possible",
    "search_further",
    "sensitivity_iteration",
    "why_not_iterated",
]
