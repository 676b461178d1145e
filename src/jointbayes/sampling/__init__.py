"""Draws from a posterior of which nothing but the log-density is known."""

from jointbayes.sampling.adapted import run_adapted
from jointbayes.sampling.chains import Chains, Draws, Progress
from jointbayes.sampling.checkpoint import UnfinishedRun
from jointbayes.sampling.coordinates import ComposedCoordinates, Coordinates, Identity, NormalScores, ProductCoordinates
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.diagnostics import (
    autocorrelation_time,
    effective_sample_size,
    quantile_error,
    quantile_spread,
    split_r_hat,
)
from jointbayes.sampling.proposal.each_mode import fit_each_mode
from jointbayes.sampling.proposal.fit import Proposal, Start, fit_proposal
from jointbayes.sampling.proposal.student import StudentMixture, StudentT
from jointbayes.sampling.proposal.weights import drawn_without_replacement, importance_efficiency, truncated
from jointbayes.sampling.run import run_ensembles
from jointbayes.sampling.settings import SamplerSettings
from jointbayes.sampling.several_modes import SeveralModes
from jointbayes.sampling.starting import replace_far_walkers, starting_walkers
from jointbayes.sampling.stopping import INTERVAL, Check, Quantities

__all__ = [
    # Run
    "LogDensity",
    "Quantities",
    "SamplerSettings",
    "UnfinishedRun",
    "run_adapted",
    "replace_far_walkers",
    "run_ensembles",
    "starting_walkers",
    # Coordinates and proposal
    "NormalScores",
    "Coordinates",
    "ComposedCoordinates",
    "Identity",
    "ProductCoordinates",
    "Proposal",
    "Start",
    "StudentMixture",
    "StudentT",
    "SeveralModes",
    "drawn_without_replacement",
    "fit_each_mode",
    "fit_proposal",
    "truncated",
    # Results
    "Chains",
    "Check",
    "Draws",
    "Progress",
    # Diagnostics
    "INTERVAL",
    "autocorrelation_time",
    "effective_sample_size",
    "importance_efficiency",
    "quantile_error",
    "quantile_spread",
    "split_r_hat",
]
