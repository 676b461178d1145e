"""A search for the mode that goes on by itself where its result does not explain the data, and what it says then."""

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from jointbayes.identification.map_estimate import GAIN, LEAST_AGREEING, SearchEffort
from jointbayes.identification.mode_search import MANY_MOVED, Images, ModeSearch
from jointbayes.identification.reconstruction import reconstructed_starts
from jointbayes.identification.starting_points import frequency_starts, screened_draws
from jointbayes.inference import Problem
from jointbayes.inference.climb import MANY_UNKNOWNS, PosteriorSquares, climb_all
from jointbayes.progress import Progress, ProgressCallback, tell_nobody
from vibrecords.arrays import Array

#: Squared residuals this many standard deviations above their expectation are far more than the noise allows.
FAR = 8.0
#: The search ends after so many further rounds.
ROUNDS = 3
#: Starts of which this share end at one mode agree.
AGREED = 0.8
_POINTS = 4  # times as many frequencies are compared as in the first search
_SCREENED, _KEPT = 4000, 12
#: Of the first search: draws looked at where natural frequencies gave some starts, and starts taken from them.
_FEW_SCREENED, _FEW_KEPT = 500, 6
#: Each line's noise is first taken for so large a fraction of its |H|, which makes false summits flat.
_TEMPERED = (1.0, 0.3, 0.1)
#: Of all lines so many are added at a time, or a half or a quarter of them, with so many steps of a climb each time.
_ADDED, _HALVED, _STEPS = 1 / 12, 2, 15
#: The name of the start that they lead to, and climbs from places next to the mode where it is that start's.
_LOWEST, _FEW_MOVED = "lowest lines first", 24


def largest_squares(count: int) -> float:
    """Mean of so many squared residuals, relative to the noise, that noise alone hardly exceeds."""
    return 1 + FAR * math.sqrt(2 / count)


def lowest_lines_first(problem: Problem) -> Array:
    """End of a climb from the middle of the prior that sees more and more lines of FRFs, shape (1, d); or (0, d).

    The lowest lines show the structure's compliance, which no resonance hides, and each further one moves few
    resonances past few lines. None where the lines seen so far are not explained, or unknowns are few.

    References
    ----------
    Bunks, C., Saleck, F. M., Zaleski, S., Chavent, G. (1995). Multiscale seismic waveform inversion. Geophysics
    60(5), 1457-1473. DOI 10.1190/1.1443880
    """
    theta, seen, halved = problem.prior.mean, 0.0, 0
    none = np.empty((0, theta.size))
    frfs = [test.data.frfs for test in problem.tests if not test.measured_bodies]
    few = len(problem.parametrisation.names) < MANY_UNKNOWNS
    if few or len(frfs) < len(problem.tests) or None in frfs or not problem.prior.feasible(theta):
        return none
    while seen < 1:
        more = min(1.0, seen + _ADDED / 2**halved)
        density = _on_lowest_lines(problem, more).log_posterior
        (end,), _ = climb_all(PosteriorSquares(density), theta[None], _STEPS)
        total, count = density.typical_squares(end)
        if total <= count * largest_squares(count):
            theta, seen, halved = end, more, max(0, halved - 1)
        elif halved < _HALVED:
            halved += 1
        else:
            return none
    return theta[None]


def _on_lowest_lines(problem: Problem, share: float) -> Problem:
    """The problem with the lowest lines of each test."""
    tests = []
    for test in problem.tests:
        assert test.data.frfs is not None
        lines = slice(None, math.ceil(share * test.data.frfs.frf.n_lines))
        tests.append(replace(test, data=test.data.frfs.at_lines(lines)))
    return replace(problem, tests=tuple(tests))


def first_starts(problem: Problem, seed: int) -> dict[str, Array]:
    """Points to climb from first, each shape (d,), by name.

    From natural frequencies and screened draws, and of many unknowns from reconstructed motions of the joints as well:
    either kind alone misses the mode of some structures. Many unknowns that explain line after line from the lowest on
    need only screened draws in addition.

    Parameters
    ----------
    problem
        The problem.
    seed
        Of the search.
    """
    rng = np.random.default_rng([seed, 1])
    lowest = lowest_lines_first(problem)
    if len(lowest):
        return {_LOWEST: lowest[0]} | _named(
            [], [], screened_draws(problem.log_posterior, rng, _FEW_SCREENED, _FEW_KEPT)
        )
    reconstructed = reconstructed_starts(problem, np.random.default_rng([seed, 4]))
    matched = frequency_starts(problem, np.random.default_rng([seed, 2]))
    count = _FEW_SCREENED if len(reconstructed) or len(matched) else _SCREENED
    screened = screened_draws(problem.log_posterior, rng, count, _FEW_KEPT)
    return _named(reconstructed, matched, screened)


def _named(
    reconstructed: Iterable[Array], matched: Iterable[Array], screened: Iterable[Array], before: str = ""
) -> dict[str, Array]:
    kinds = {"reconstructed joint motion": reconstructed, "natural frequencies": matched, "screened draw": screened}
    return {f"{before}{kind} {i}": theta for kind, few in kinds.items() for i, theta in enumerate(few, 1)}


def search_further(
    search: ModeSearch, problem: Problem, seed: int, progress: ProgressCallback = tell_nobody
) -> SearchEffort:
    """Go on searching while the best mode does not explain the data and starts disagree, at most three rounds.

    First, and after each round, climbs begin at the images of the modes found so far, see `Images`, and of many
    unknowns on which few starts agree at the best mode with one spring moved elsewhere. Each round matches
    more natural frequencies, screens more draws, and lets all starts, and the modes known so far, climb first on a
    density that is flattened. Of many unknowns each reconstructs the joints' motions from more and
    other points as well, and what the last round gained says nothing of the next.

    Parameters
    ----------
    search
        The search so far; its starts and modes grow.
    problem
        The problem.
    seed
        Of the further starts.
    progress
        Called before each round.
    """
    log_posterior = problem.log_posterior
    first, rounds, last_gain, many, images = search.best[1], 0, 0.0, False, Images.from_problem(problem)
    many_unknowns = len(problem.parametrisation.names) >= MANY_UNKNOWNS
    while True:
        # 1. images of the modes, and the best mode with one spring moved
        search.climb_images(images)
        arrived = search.reached()
        if many_unknowns and sum(arrived.values()) < LEAST_AGREEING:
            search.climb_moved(_FEW_MOVED if arrived.get(_LOWEST) else MANY_MOVED)
        # 2. is that enough?
        theta, density = search.best
        total, count = log_posterior.typical_squares(theta)
        squares, limit = total / count, largest_squares(count)
        reached = list(search.reached().values())
        effort = SearchEffort(squares, limit, len(reached), sum(reached), rounds, density - first, last_gain)
        agreed = effort.agreeing >= max(AGREED * effort.starts, LEAST_AGREEING)
        in_vain = rounds > 0 and last_gain < GAIN and not many
        if search.is_spent():
            progress(Progress("searching for the best fit", str(search.budget)))
        if effort.explains or agreed or rounds == ROUNDS or in_vain or search.is_spent():
            return effort
        rounds += 1
        text = (
            f"the best mode so far does not explain the data ({squares:.3g} times the expected noise), and "
            f"{effort.starts - effort.agreeing} of {effort.starts} starts disagree: searching further, round {rounds} "
            f"of at most {ROUNDS}"
        )
        progress(Progress("searching for the best fit", text))
        # 3. climb from more starts, and from the modes known so far; reconstructed motions need no flattened density
        rng, before, weights = np.random.default_rng([seed, 3, rounds]), f"round {rounds}: ", _weights(problem)
        reconstructed = reconstructed_starts(problem, rng, 2**rounds)
        matched = frequency_starts(problem, rng, _POINTS)
        screened = screened_draws(log_posterior, rng, _SCREENED, _KEPT)
        search.climb(_named(reconstructed, [], [], before))
        search.climb(_named([], matched, screened, before), weights)
        search.climb_on(weights)
        many = bool(len(reconstructed))
        last_gain = search.best[1] - density


def _weights(problem: Problem) -> list[Array]:
    """Factors on white residuals, shape (m,), by which noise becomes 1, 0.3 and 0.1 of |H| where it is smaller.

    They are 1 for a test without FRFs; none if no test has FRFs.
    """
    ratios: list[Array] = []
    for part in problem.parts:
        measured = part.test.data.frfs
        if measured is not None:
            ratios.append(np.repeat((np.abs(measured.frf.values) ** 2 / measured.variance).ravel(), 2))
        else:
            ratios.append(np.zeros(part.log_posterior.likelihood.n_data))
    ratio = np.concatenate(ratios)
    return [1 / np.sqrt(1 + share**2 * ratio) for share in _TEMPERED] if ratio.any() else []
