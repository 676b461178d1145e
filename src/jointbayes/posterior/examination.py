"""Find what the data say beyond the draws."""

from contextlib import suppress

from jointbayes.errors import ModelError
from jointbayes.posterior.directions import name_directions
from jointbayes.posterior.excluded import simpler_joints
from jointbayes.posterior.knowledge import (
    KeptKnowledge,
    Knowledge,
    assumed_beyond,
    known_in_workshop,
    uncertain_quantities,
)
from jointbayes.posterior.limits import ProfileLikelihood
from jointbayes.posterior.next_step import next_step
from jointbayes.posterior.posterior import Posterior
from jointbayes.posterior.verdicts import MOST_UNKNOWNS
from jointbayes.posterior.what_decides import WhatDecides, what_decides
from vibrecords.arrays import Array


def gather_knowledge(posterior: Posterior) -> Knowledge:
    """Check and examine a posterior; the seed of its run also replicates the data of the check.

    What a workshop does not know exactly, for the table of what freeing it does, is that of its case, if it has one.
    """
    kept: KeptKnowledge | None = posterior._kept_knowledge
    steps = kept.next_steps if kept else None
    freed = posterior.case.workshop_problem if steps is None and posterior.case is not None else None
    rows = posterior.rows
    assessments = {name: posterior.verdict(name) for name in posterior.stiffness_names}
    simpler = None if kept is None else kept.simpler
    if steps is None and all(check.explains for check in posterior.checks):
        workshop = known_in_workshop(rows)
        step = next_step(posterior, freed if workshop else None, workshop or assessments)
    else:
        step = next(iter(steps or ()), None)
    return Knowledge(
        posterior.check,
        name_directions(
            posterior.stiffness,
            posterior.prior_stiffness,
            assessments,
            _wider_prior_draws(posterior),
            posterior.problem.parametrisation,
        ),
        kept.profiles if kept else _profiles(posterior),
        rows,
        kept.assumed if kept else assumed_beyond(posterior.problem, freed),
        simpler_joints(posterior) if simpler is None else simpler,
        step,
        _what_decides(posterior),
    )


def _what_decides(posterior: Posterior) -> WhatDecides | None:
    """Each input alone; None of fewer than two, and where the model does not explain the data."""
    rows = [row for row in posterior.rows if row.known]
    exact = next((row for row in rows if not row.uncertain), None)
    inputs = max((row.uncertain for row in rows), key=len, default=())
    if exact is None or len(inputs) < 2 or not all(check.explains for check in posterior.checks):
        return None
    freed = None if posterior.case is None else posterior.case.workshop_problem
    problem = next(
        p for p in (posterior.problem, freed) if p is not None and set(inputs) <= set(uncertain_quantities(p))
    )
    together = next(row.known for row in rows if row.uncertain == inputs)
    run = posterior.problem
    return what_decides(problem, inputs, run.names, posterior.mode_theta, exact.known, together)


def _wider_prior_draws(posterior: Posterior) -> tuple[Array, Array] | None:
    """Posterior and prior draws of the stiffnesses under wider priors; None where these change nothing.

    Where no draws were found that may be trusted the prior stands for the posterior: nothing is then known.
    """
    wide = posterior.widened
    return None if wide is None else (wide.prior.values(wide.theta), wide.prior.values(wide.prior_theta))


def _profiles(posterior: Posterior) -> tuple[ProfileLikelihood, ...]:
    profiles: list[ProfileLikelihood] = []
    if len(posterior.problem.names) > MOST_UNKNOWNS:
        return ()
    for name in posterior.problem.parametrisation.names:
        with suppress(ModelError):  # no residual depends on it: its prior is all there is, and the verdict says so
            profiles.append(posterior.likelihood_region.profile(name))
    return tuple(profiles)
