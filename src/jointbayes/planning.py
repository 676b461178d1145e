"""What to measure next: the plan of a case."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
from jointbayes.posterior.planning_check import Confirmation, confirm, weighted_posterior
from jointbayes.workflow import chart_of, find_map

__all__ = ["Plan", "plan"]

Array = NDArray[np.float64]

#: Candidates that nested Monte Carlo is asked about, beside the chosen set.
CONFIRMED = 3
_DRAWS, _MORE = 4000, 5
_LEAST = 400.0  # effective draws of the present posterior
_KEPT = 4000


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
        Why nothing was confirmed; empty otherwise.
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
        """What the best measurement does, by Fisher information, and what simulated measurements make of it."""
        best = self.best
        said = plan_sentence(best.words, self.parameter, best.sd_before, best.sd_after)
        if said.endswith("."):
            said = f"{said[:-1]} by Fisher information at the mode."
        found = self.confirmations.get(best.names)
        if found is None or not found.valid:
            return f"{said} Not confirmed{': ' + self.note if self.note else ' by simulated measurements.'}"
        low, high = found.sd_range
        return (
            f"{said} Simulated measurements: from {spread_in_words(found.sd_before)} to "
            f"{spread_in_words(found.sd_after)}, in 80 % of them between {spread_in_words(low)} and "
            f"{spread_in_words(high)}."
        )

    def verdict_after(self, names: tuple[str, ...]) -> Verdict:
        """Verdict on the parameter after a set: by simulated measurements where they were made, else by Fisher."""
        found = self.confirmations.get(names)
        if found is not None and found.valid:
            return verdict_on(self.fisher, self.parameter, found.sd_after)
        return next(f.verdict_after for f in self._asked if f.names == names)

    def summary(self) -> dict[str, Any]:
        """The plan as one JSON-ready dictionary: `plan.json`, described in docs/planning.md."""
        return {
            "schema_version": 1,
            "case": self.case_name,
            "title": self.title,
            "seed": self.seed,
            "parameter": self.parameter,
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
    """
    tell = progress or (lambda line: None)
    candidates = {c.name: c for c in candidates_of(case)}
    if not candidates:
        raise CaseError(f"{case.name}: found no further measurement to rank; expected one; name DOFs in [plan]")
    if posterior is not None and posterior.problem.names != case.problem.names:
        raise CaseError(f"{case.name}: found a posterior over other parameters; expected one of this case")
    seed = case.spec.sampling.seed if seed is None else seed
    rng = np.random.default_rng([seed, 7])
    if posterior is None:
        tell("finding the mode")
        theta = find_map(case, seed=seed).theta
    else:
        theta = posterior.mode_theta
    settings = case.spec.plan
    parameter: str = settings.parameter
    fisher = fisher_information(case.problem, theta)
    information = {name: measurement_information(c, case.problem, theta) for name, c in candidates.items()}

    def looked_at(names: tuple[str, ...]) -> Forecast:
        return forecast(fisher, information, [candidates[name] for name in names], parameter)

    singles = sorted((looked_at((name,)) for name in candidates), key=lambda f: (f.sd_after, -f.gain_nats))
    count = settings.max_measurements
    best = looked_at(choose(fisher, information, count, parameter))
    by_gain = looked_at(choose(fisher, information, count, parameter, by="gain"))
    found: dict[tuple[str, ...], Confirmation] = {}
    draws, note = None, "no measurements were simulated."
    if simulations:
        draws, note = _present_draws(case, posterior, fisher, rng)
    if draws is not None:
        for names in dict.fromkeys([*(f.names for f in singles[:CONFIRMED]), best.names]):
            tell(f"simulating {' + '.join(names)}")
            chosen: list[Candidate] = [candidates[name] for name in names]
            found[names] = confirm(
                case.problem, chosen, parameter, draws, chart_of(case.problem), rng, simulations=simulations
            )
    return Plan(case.name, case.title, seed, parameter, fisher, tuple(singles), best, by_gain, found, note)


def _present_draws(
    case: Case, posterior: Posterior | None, fisher: FisherInformation, rng: np.random.Generator
) -> tuple[Array | None, str]:
    """Draws of θ from the present posterior, shape (n, d); or none, and why."""
    if posterior is not None:
        return posterior.theta, ""
    covariance = np.linalg.inv(fisher.total() + np.diag(fisher.prior_sd**-2.0))
    for count in (_DRAWS, _MORE * _DRAWS):
        theta, log_weight = weighted_posterior(
            case.problem.log_posterior, fisher.theta, covariance, chart_of(case.problem), rng, count
        )
        weight = np.exp(log_weight - log_weight.max())
        effective = float(weight.sum() ** 2 / (weight**2).sum())
        if effective >= _LEAST:
            return theta[rng.choice(len(theta), _KEPT, p=weight / weight.sum())], ""
    return None, (
        f"importance sampling left {effective:.0f} effective draws of the present posterior; sample the case and give "
        "the posterior to plan"
    )


