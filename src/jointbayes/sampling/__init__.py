"""Draws from a posterior of which nothing but the log-density is known."""

from jointbayes.sampling.chains import Chains as Chains
from jointbayes.sampling.chains import Draws as Draws
from jointbayes.sampling.coordinate_maps import ComposedCoordinates as ComposedCoordinates
from jointbayes.sampling.coordinate_maps import Coordinates as Coordinates
from jointbayes.sampling.coordinate_maps import NormalScores as NormalScores
from jointbayes.sampling.coordinate_maps import ProductCoordinates as ProductCoordinates
from jointbayes.sampling.density import LogDensity as LogDensity
from jointbayes.sampling.diagnostics import quantile_error as quantile_error
from jointbayes.sampling.diagnostics import quantile_spread as quantile_spread
from jointbayes.sampling.distributions import StudentT as StudentT
from jointbayes.sampling.distributions import importance_efficiency as importance_efficiency
from jointbayes.sampling.ensemble import SamplerSettings as SamplerSettings
from jointbayes.sampling.proposal import Proposal as Proposal
from jointbayes.sampling.proposal import fit_proposal as fit_proposal
from jointbayes.sampling.sampler import draw as draw
from jointbayes.sampling.sampler import run_ensembles as run_ensembles
from jointbayes.sampling.stopping import ALONE as ALONE
from jointbayes.sampling.stopping import END_TOLERANCE as END_TOLERANCE
from jointbayes.sampling.stopping import INTERVAL as INTERVAL
from jointbayes.sampling.stopping import Quantities as Quantities
