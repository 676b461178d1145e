"""Draws from a posterior of which nothing but the log-density is known."""

from jointbayes.sampling.chains import Chains, Draws
from jointbayes.sampling.checkpoint import UnfinishedRun
from jointbayes.sampling.coordinate_maps import ComposedCoordinates, Coordinates, NormalScores, ProductCoordinates
from jointbayes.sampling.density import LogDensity, SeveralModes
from jointbayes.sampling.diagnostics import quantile_error, quantile_spread
from jointbayes.sampling.distributions import (
    StudentT,
    WeightedDraws,
    drawn_without_replacement,
    importance_efficiency,
    truncated,
)
from jointbayes.sampling.ensemble import SamplerSettings
from jointbayes.sampling.proposal import Proposal, Start, fit_each_mode, fit_proposal
from jointbayes.sampling.released import END_TOLERANCE, Restraint, independent_chains, released_draws
from jointbayes.sampling.sampler import run_adapted, run_ensembles
from jointbayes.sampling.starting import replace_far_walkers, starting_walkers
from jointbayes.sampling.stopping import INTERVAL, Quantities

__all__ = [
    # Run
    "LogDensity",
    "Quantities",
    "Restraint",
    "SamplerSettings",
    "UnfinishedRun",
    "independent_chains",
    "run_adapted",
    "released_draws",
    "replace_far_walkers",
    "run_ensembles",
    "starting_walkers",
    # Coordinates and proposal
    "NormalScores",
    "Coordinates",
    "ComposedCoordinates",
    "ProductCoordinates",
    "Proposal",
    "Start",
    "StudentT",
    "SeveralModes",
    "drawn_without_replacement",
    "fit_each_mode",
    "fit_proposal",
    "truncated",
    # Results
    "Chains",
    "Draws",
    "WeightedDraws",
    # Diagnostics
    "END_TOLERANCE",
    "INTERVAL",
    "importance_efficiency",
    "quantile_error",
    "quantile_spread",
]
