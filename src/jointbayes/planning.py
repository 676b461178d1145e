"""What to measure next: the plan of a case."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.case import Case
from jointbayes.case_candidates import candidates_of
from jointbayes.errors import CaseError
from jointbayes.posterior import Posterior
from jointbayes.posterior.candidates import Candidate
from jointbayes.posterior.directions import spread_in_words
from jointbayes.posterior.fisher import FisherInformation, fisher_information
from jointbayes.posterior.identifiability import Verdict
from jointbayes.posterior.planning import (
    Forecast,
    choose,
    forecast,
    measurement_information,
    plan_sentence,
    verdict_on,
)
from jointbayes.posterior.planning_check import Confirmation, assumed_truth, confirm, weighted_posterior
from jointbayes.report.plan import candidate_table
from jointbayes.sampling import SamplerSettings
from jointbayes.workflow import charts, find_map, sample

__all__ = ["Plan", "plan", "present_draws"]

Array = NDArray[np.float64]

#: Candidates that nested Monte Carlo is asked about, beside the chosen set.
CONFIRMED = 3
#: Fisher's standard deviation is confirmed if the expected one of simulated measurements lies within this factor.
AGREE = 1.25
_DRAWS, _MORE = 4000, 5
_LEAST = 400.0  # effective draws of the present posterior
_KEPT = 4000
#: Good enough for truths to simulate, not for figures to quote.
_SHORT = SamplerSettings(
    walkers=32, max_steps=3000, tau_factor=20.0, tau_tolerance=0.1, r_hat_max=1.05, end_tolerance=0.1
)


@dataclass(frozen=True, eq=False)
class Plan:
    """Further measurements of a case, ranked.

    Parameters
    ----------
    case_name, title
        Of the case.
    seed
        Seed of the one random generator.
    parameter
        The stiffness to be known best.
    fisher
        Present information, at the mode.
    forecasts
        Each candidate alone, the one that leaves the least standard deviation of ln of the parameter first.
    best_set, best_by_gain
        The sets of at most `max_measurements` that leave the least standard deviation, and that tell most about the
        joint.
    confirmations
        What simulated measurements say, by names of a set.
    note
        What is wrong with the simulations, if anything is.
    assumed
        Whether the joint was assumed, rather than taken from the present posterior.
    """

    case_name: str
    title: str
    seed: int
    parameter: str
    fisher: FisherInformation
    forecasts: tuple[Forecast, ...]
    best_set: Forecast
    best_by_gain: Forecast
    confirmations: Mapping[tuple[str, ...], Confirmation]
    note: str
    assumed: bool = False

    @property
    def best(self) -> Forecast:
        """The set to measure: of those that simulated measurements confirm, the one with the least expected spread."""
        valid = [f for f in self._asked if (c := self.confirmations.get(f.names)) is not None and c.valid]
        full = [f for f in valid if len(f.names) == len(self.best_set.names)]
        return min(full, key=lambda f: self.confirmations[f.names].sd_after, default=self.best_set)

    @property
    def _asked(self) -> tuple[Forecast, ...]:
        sets = (*self.forecasts, self.best_set, self.best_by_gain)
        return tuple({f.names: f for f in sets}.values())

    @property
    def sentence(self) -> str:
        """What the best measurement does; see `sentence_of`."""
        return self.sentence_of(self.best)

    def sentence_of(self, one: Forecast) -> str:
        """What a set does by Fisher information, and what simulated measurements make of it, in plain words."""
        said = plan_sentence(one.words, self.parameter, one.sd_before, one.sd_after)
        where = "at the assumed joint" if self.assumed else "at the mode"
        said = f"{said[:-1]} by Fisher information {where}."
        found = self.confirmations.get(one.names)
        if found is None or not found.valid:
            return f"{said} No simulated measurements stand behind this."
        low, high = found.sd_range
        heard = "bear this out" if self.confirmed(one) else "say otherwise"
        return (
            f"{said} Simulated measurements {heard}: from {spread_in_words(found.sd_before)} to "
            f"{spread_in_words(found.sd_after)}, in 80 % of them between {spread_in_words(low)} and "
            f"{spread_in_words(high)}."
        )

    def confirmed(self, one: Forecast) -> bool | None:
        """Whether simulated measurements say the same as Fisher information, within a factor of 1.25; None if unasked.

        A confirmation whose posteriors were not found confirms nothing.
        """
        found = self.confirmations.get(one.names)
        if found is None:
            return None
        return found.valid and 1 / AGREE <= found.sd_after / one.sd_after <= AGREE

    def verdict_after(self, names: tuple[str, ...]) -> Verdict:
        """Verdict on the parameter after a set: by simulated measurements where they were made, else by Fisher."""
        found = self.confirmations.get(names)
        if found is not None and found.valid:
            return verdict_on(self.fisher, self.parameter, found.sd_after)
        return next(f.verdict_after for f in self._asked if f.names == names)

    def text(self) -> list[str]:
        """The plan as lines of text: table, then a sentence for each set that was asked about."""
        table = candidate_table(self.summary())
        rows = [table.head, *table.rows]
        widths = [max(len(row[i]) for row in rows) for i in range(len(table.head))]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
        asked = [f for f in self._asked if f.names in self.confirmations and f.names != self.best.names]
        lines += ["", self.sentence, *(self.sentence_of(f) for f in asked)]
        if len(self.best_set.names) > 1 or self.best_by_gain.names != self.best_set.names:
            lines.append(f"Least spread by Fisher information: {' + '.join(self.best_set.names)}; most information "
                         f"about the joint: {' + '.join(self.best_by_gain.names)}.")  # fmt: skip
        return [*lines, self.note] if self.note else lines

    def summary(self) -> dict[str, Any]:
        """The plan as one JSON-ready dictionary: `plan.json`, described in docs/planning.md."""
        return {
            "schema_version": 1,
            "case": self.case_name,
            "title": self.title,
            "seed": self.seed,
            "parameter": self.parameter,
            "assumed": self.assumed,
            "theta": dict(zip(self.fisher.names, self.fisher.theta.tolist(), strict=True)),
            "candidates": [self._entry(f) for f in self.forecasts],
            "best_set": self._entry(self.best_set),
            "best_by_gain": self._entry(self.best_by_gain),
            "best": list(self.best.names),
            "sentence": self.sentence,
            "note": self.note,
        }

    def _entry(self, one: Forecast) -> dict[str, Any]:
        found = self.confirmations.get(one.names)
        return {
            "names": list(one.names),
            "words": list(one.words),
            "gain_bits": one.gain_bits,
            "sd_before": _finite(one.sd_before),
            "sd_after": _finite(one.sd_after),
            "verdict_before": one.verdict_before,
            "verdict_after": self.verdict_after(one.names),
            "confirmed": self.confirmed(one),
            "simulated": None if found is None else _confirmed(found),
        }


def _confirmed(found: Confirmation) -> dict[str, Any]:
    return {
        "valid": found.valid,
        "sd_before": found.sd_before,
        "sd_after": _finite(found.sd_after),
        "sd_after_error": _finite(found.sd_after_error),
        "sd_range80": [_finite(value) for value in found.sd_range],
        "gain_bits": _finite(found.gain_bits),
        "gain_bits_error": _finite(found.gain_bits_error),
        "simulated": found.simulated,
        "lost": found.lost,
        "efficiency": found.efficiency,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def plan(
    case: Case,
    posterior: Posterior | None = None,
    seed: int | None = None,
    *,
    assume: ArrayLike | None = None,
    simulations: int = 12,
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """Rank the further measurements that a case could be given.

    Parameters
    ----------
    case
        Case with FRF data; its `[plan]` names the stiffness to be known best and the candidates.
    posterior
        Posterior of the case. Without one the mode is found and the posterior is drawn by importance sampling.
    seed
        Seed of the one random generator; by default the case's.
    assume
        (k11, k12, k22), shape (3,), of the joint that makes the simulated measurements, and about which the information
        is taken. By default the mode for the information, and draws of the present posterior for the simulations.
    simulations
        Measurements to simulate of each of the best three candidates and of the best set; 0 for Fisher alone.
    progress
        Called with a line of text at each step.

    Returns
    -------
    Plan
        ``.forecasts``, ``.best``, ``.sentence``, ``.confirmations``, ``.summary()``.

    Raises
    ------
    CaseError
        If the data are natural frequencies, the posterior is of another case, or there is nothing to choose from.
    ModelError
        If the prior thinks the assumed joint impossible.
    """
    tell = progress or (lambda line: None)
    candidates = {c.name: c for c in candidates_of(case)}
    if posterior is not None and posterior.problem.names != case.problem.names:
        raise CaseError(f"{case.name}: found a posterior over other parameters; expected one of this case")
    seed = case.spec.sampling.seed if seed is None else seed
    rng = np.random.default_rng([seed, 7])
    problem = case.problem
    if posterior is None:
        tell("finding the mode")
        mode = find_map(case, seed=seed).theta
    else:
        mode = posterior.mode_theta
    truth = None if assume is None else assumed_truth(problem, mode, assume)
    fisher = fisher_information(problem, mode if truth is None else truth)
    ranking = _ranked(case, candidates, fisher)
    found: dict[tuple[str, ...], Confirmation] = {}
    note = "No measurement was simulated."
    if simulations:
        tell("drawing from the present posterior")
        draws, note = present_draws(case, mode, rng) if posterior is None else (posterior.theta, "")
        parameter, coordinates = case.spec.plan.parameter, charts(problem)
        for names in dict.fromkeys([*(f.names for f in ranking.singles[:CONFIRMED]), ranking.best.names]):
            tell(f"simulating {' + '.join(names)}")
            chosen = [candidates[name] for name in names]
            found[names] = confirm(
                problem, chosen, parameter, draws, coordinates, rng, truth=truth, simulations=simulations
            )
    return Plan(
        case.name,
        case.title,
        seed,
        case.spec.plan.parameter,
        fisher,
        ranking.singles,
        ranking.best,
        ranking.by_gain,
        found,
        note,
        assumed=truth is not None,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Ranking:
    """Candidates alone, and the best sets by spread and by information."""

    singles: tuple[Forecast, ...]
    best: Forecast
    by_gain: Forecast


def _ranked(case: Case, candidates: Mapping[str, Candidate], fisher: FisherInformation) -> _Ranking:
    settings = case.spec.plan
    parameter, count = settings.parameter, settings.max_measurements
    information = {name: measurement_information(c, case.problem, fisher.theta) for name, c in candidates.items()}

    def looked_at(names: tuple[str, ...]) -> Forecast:
        return forecast(fisher, information, [candidates[name] for name in names], parameter)

    singles = sorted((looked_at((name,)) for name in candidates), key=lambda f: (f.sd_after, -f.gain_nats))
    best = looked_at(choose(fisher, information, count, parameter))
    return _Ranking(tuple(singles), best, looked_at(choose(fisher, information, count, parameter, by="gain")))


def present_draws(case: Case, mode: Array, rng: np.random.Generator) -> tuple[Array, str]:
    """Draws of θ from the present posterior, shape (n, d), equally weighted, and what is wrong with them, if anything.

    By importance sampling about the mode; where that finds too few, by a short run of the sampler.
    """
    fisher, coordinates = fisher_information(case.problem, mode), charts(case.problem)
    information: Array = fisher.total() + np.diag(1 / np.square(fisher.prior_sd))
    covariance: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
    for count in (_DRAWS, _MORE * _DRAWS):
        theta, log_weight = weighted_posterior(case.problem.log_posterior, mode, covariance, coordinates, rng, count)
        if len(theta) == 0:
            break
        weight = np.exp(log_weight - log_weight.max())
        if weight.sum() ** 2 / (weight**2).sum() >= _LEAST:
            return theta[rng.choice(len(theta), _KEPT, p=weight / weight.sum())], ""
    sampled = sample(case, int(rng.integers(2**31)), settings=_SHORT)
    if sampled.converged:
        return sampled.theta, ""
    return sampled.theta, (
        "The present posterior was found neither by importance sampling nor by a short run of the sampler, which had "
        "not converged: what stands as known now, and the truths simulated, are rough. Sample the case and give the "
        "posterior to plan."
    )
