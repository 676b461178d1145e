"""Point estimates of a joint: the paper's iteration, the posterior mode."""

from jointbayes.identification.effort import first_starts as first_starts
from jointbayes.identification.effort import largest_squares as largest_squares
from jointbayes.identification.effort import search_further as search_further
from jointbayes.identification.map_estimate import LocalMode as LocalMode
from jointbayes.identification.map_estimate import MapEstimate as MapEstimate
from jointbayes.identification.map_estimate import SearchEffort as SearchEffort
from jointbayes.identification.mode_search import Images as Images
from jointbayes.identification.mode_search import ModeSearch as ModeSearch
from jointbayes.identification.paper_iteration import IterationHistory as IterationHistory
from jointbayes.identification.paper_iteration import missing_for_iteration as missing_for_iteration
from jointbayes.identification.paper_iteration import part_to_iterate as part_to_iterate
from jointbayes.identification.paper_iteration import sensitivity_iteration as sensitivity_iteration
from jointbayes.identification.paper_iteration import why_not_iterated as why_not_iterated
from jointbayes.identification.refine import refine as refine
from jointbayes.identification.refine import refine_where_possible as refine_where_possible
from jointbayes.identification.resonances import on_fewer_lines as on_fewer_lines
from jointbayes.identification.resonances import with_lines_in_groups as with_lines_in_groups
