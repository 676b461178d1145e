"""Run ensembles until they agree."""

import time
from collections.abc import Callable

import numpy as np

from jointbayes.arrays import Array
from jointbayes.sampling.chains import Chains, Progress
from jointbayes.sampling.checkpoint import UnfinishedRun, require_same_density
from jointbayes.sampling.coordinates import Coordinates
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.ensemble import initial_states, mixture
from jointbayes.sampling.interrupts import finished_first
from jointbayes.sampling.proposal.fit import Proposal
from jointbayes.sampling.settings import SamplerSettings
from jointbayes.sampling.stage import Slow, Stage
from jointbayes.sampling.stopping import Quantities
from jointbayes.sampling.streams import Streams
from jointbayes.sampling.workers import mover


def run_ensembles(
    log_density: LogDensity,
    start: Array,
    rng: np.random.Generator,
    settings: SamplerSettings,
    progress: Callable[[Progress], None] | None = None,
    *,
    coordinates: Coordinates | None = None,
    proposal: Proposal | None = None,
    quantities: Quantities | None = None,
) -> Chains:
    """Run the ensembles side by side until the stop rule is met or the step limit is reached.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density, (n, d) array to (n,) array; −inf where the density is zero.
    start : ndarray, shape (ensembles, walkers, d)
        Where the walkers start: at finite log-density, spanning the space in each ensemble.
    rng : numpy.random.Generator
        Source of all randomness: one child is spawned from it, and from that a seed for each ensemble and block.
    settings : SamplerSettings
        Size, length, stop rule and number of processes. The draws do not depend on the latter.
    progress : callable, optional
        Called with a :class:`Progress` after each block.
    coordinates : Coordinates, optional
        Coordinates in which the density is closer to a Gaussian: most moves are then made in these.
    proposal : Proposal, optional
        Approximation of the density in coordinates of its own, from :func:`fit_proposal`; the better it is, the
        more of the steps are proposed from it.
    quantities : Quantities, optional
        What the stop rule's bound on the errors of interval ends is applied to; by default each coordinate of θ.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the start is of another shape, not finite, in a subspace or somewhere of zero density, or if the
        log-density returns NaN, +inf or an array of another shape, or cannot be sent to the processes.

    References
    ----------
    J. Goodman, J. Weare, Ensemble samplers with affine invariance (2010), DOI 10.2140/camcos.2010.5.65.
    C. J. F. ter Braak, Differential evolution MCMC (2006), DOI 10.1007/s11222-006-8769-1.
    D. Foreman-Mackey et al., emcee: the MCMC hammer (2013), DOI 10.1086/670067.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> settings = SamplerSettings(walkers=8, max_steps=2000)
    >>> run_ensembles(lambda x: -0.5 * x[:, 0] ** 2, rng.normal(size=(4, 8, 1)), rng, settings).converged
    True
    """
    return run_stage(
        log_density,
        start,
        Streams.of(rng),
        settings,
        progress,
        coordinates=coordinates,
        proposal=proposal,
        quantities=quantities,
    )


def run_stage(
    log_density: LogDensity,
    start: Array,
    streams: Streams,
    settings: SamplerSettings,
    progress: Callable[[Progress], None] | None,
    *,
    coordinates: Coordinates | None,
    proposal: Proposal | None,
    quantities: Quantities | None,
    slow: Slow | None = None,
    keeper: UnfinishedRun | None = None,
) -> Chains:
    """Run the ensembles as :func:`run_ensembles` does, as one stage of several.

    Parameters
    ----------
    log_density, start, settings, progress, coordinates, proposal, quantities
        As for :func:`run_ensembles`.
    streams : Streams
        Seeds of this stage.
    slow : Slow, optional
        When the stage ends before its limit because it mixes slowly; by default never.
    keeper : UnfinishedRun, optional
        Where the steps are kept while they are made, and from where the stage goes on.
    """
    import jointbayes.sampling.moves  # noqa: F401  (emcee's import is no part of the sampling that is timed)

    states, stage = initial_states(log_density, start, settings), Stage()
    verdict = stage.verdict(settings)
    number = streams.stage
    began = time.perf_counter() - (keeper.seconds(number) if keeper is not None else 0.0)

    def is_done() -> bool:
        return verdict.converged or stage.step >= settings.max_steps or bool(slow and stage.is_slow(slow))

    def keep(*, now: bool) -> None:
        if keeper is not None:
            keeper.keep(number, stage, time.perf_counter() - began, now=now)

    try:
        with mover(log_density, mixture(coordinates, proposal), min(settings.processes, settings.ensembles)) as move_on:
            while not is_done():
                with finished_first(wait=keeper is not None) as asked_to_stop:
                    states = stage.extend(move_on, states, streams, settings, keeper)
                    if keeper is not None and keeper.ends_with(number, stage.rows):
                        require_same_density(log_density, states)
                    stage.check_if_due(settings, quantities, proposal.modes if proposal else None)
                    verdict = stage.verdict(settings)
                    keep(now=bool(asked_to_stop) or is_done())
                    stage.condense(stage.rows if keeper is None else keeper.rows_on_disk(number))
                if progress is not None:
                    progress(stage.report(settings, verdict, time.perf_counter() - began))
    except KeyboardInterrupt:
        keep(now=True)
        raise
    return stage.chains(settings, verdict, time.perf_counter() - began)
