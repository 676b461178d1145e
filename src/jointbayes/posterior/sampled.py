"""Draws of a posterior, how they came about, and what studies found in them.

A study is a function of a `Sampled`. It stands in the file of its subject and is decorated by `once`, so that a
posterior is studied once however often somebody asks; by `kept` where it takes so long that files keep the finding.
"""

import math
from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, wraps
from typing import Annotated, Any, Concatenate, ParamSpec, Protocol, TypeVar

import numpy as np
import xarray as xr
from pydantic import ConfigDict, Field, with_config
from typing_extensions import TypedDict

from jointbayes.errors import ModelError, require_count, require_probability
from jointbayes.identification import MapEstimate
from jointbayes.inference import Premises, Problem
from jointbayes.phrases import NO_VERDICT_NO_USE
from jointbayes.stored_values import StoredArray
from jointbayes.verdict_rule import VerdictRule
from vibrecords.arrays import Array

_Count = Annotated[int, Field(ge=0, le=2**63)]


@with_config(ConfigDict(extra="allow"))
class SamplerFigures(TypedDict):
    """Settings and figures of the sampler; NaN where a chain was too short for one."""

    ensembles: _Count
    walkers: _Count
    steps: _Count
    max_steps: _Count
    burn_in: _Count
    thin: Annotated[int, Field(ge=1, le=2**31)]
    acceptance: Annotated[float, Field(ge=0, le=1)]
    move_acceptance: Mapping[str, float]
    proposal_efficiency: float
    tau: Mapping[str, float]
    ess: Mapping[str, float]
    evaluations: _Count
    singular: _Count
    seconds: Annotated[float, Field(ge=0, le=1e12)]
    ess_per_second: float


@dataclass(frozen=True, slots=True)
class RunRecord:
    """How the draws came about.

    Parameters
    ----------
    case_name, case_text
        Name of the case, or the problem, and the case's TOML text; empty where there was no case.
    seed
        Seed of all random numbers of the run.
    converged, reason
        Whether the stop rule was met, and a sentence with its figures.
    sampler
        Settings and figures of the sampler: walkers, steps, ensembles, tau, seconds and so on.
    r_hat
        R̂ over the ensembles by coordinate name.
    versions
        Version of every package that numbers depend on.
    """

    case_name: str
    case_text: str
    seed: Annotated[int, Field(ge=0, le=2**128)]
    converged: bool
    reason: str
    sampler: SamplerFigures
    r_hat: Mapping[str, float]
    versions: Mapping[str, str]

    @property
    def state(self) -> str:
        """Whether the calculation has converged, in one short sentence; its figures are in `reason`."""
        if not self.converged:
            steps = f" after {self.sampler['steps']} steps" if self.sampler["steps"] else ""
            return f"Not converged{steps}: {NO_VERDICT_NO_USE}."
        fewest = float(f"{min(self.sampler['ess'].values(), default=math.nan):.2g}")
        return f"Converged: {fewest:,.0f} independent draws.".replace(",", " ")

    @property
    def limit_to_raise(self) -> str:
        """Key of ``[sampling]`` that ended a run which has not converged."""
        return "max_steps" if self.sampler["steps"] >= self.sampler["max_steps"] else "max_evaluations"


class SampledCase(Protocol):
    """What a report says of the case that was sampled, besides the posterior."""

    @property
    def title(self) -> str:
        """Title for people."""

    @property
    def about(self) -> Mapping[str, str]:
        """Title, specimen, date of the test, operator and instruments, as far as they are stated."""

    @property
    def stated(self) -> Problem | None:
        """The problem that its text states."""

    @property
    def tests(self) -> Sequence[Any]:
        """Its tests as they were built, each with `name` and `spec`, a pydantic model; empty if built of no text."""

    @property
    def reference(self) -> Array | None:
        """Published (k11, k12, k22), shape (3,), if any."""

    @property
    def reference_source(self) -> str:
        """Where these are from."""

    @property
    def measured_frequencies_hz(self) -> tuple[float, ...] | None:
        """Measured natural frequencies, if any, Hz."""

    @property
    def workshop_problem(self) -> Problem | None:
        """The same problem with more quantities uncertain."""

    @property
    def freed_problem(self) -> Problem | None:
        """The same, also of a case that came with draws from a file."""

    @property
    def default_priors(self) -> Collection[str]:
        """Coordinates whose prior is not stated."""

    @property
    def verdict_rules(self) -> Mapping[str, VerdictRule]:
        """Thresholds of verdicts that it states, by the stiffness."""

    @property
    def warnings(self) -> Sequence[object]:
        """What is probably a slip."""


@dataclass(frozen=True, slots=True, eq=False)
class BestDraw:
    """The best draw refined, shape (d,), and its log density."""

    theta: StoredArray
    log_density: float


@dataclass(frozen=True, eq=False)
class Sampled:
    """Draws from the posterior of a joint's stiffnesses, as studies see them.

    Parameters
    ----------
    problem
        Structure, joint, data and prior.
    tree
        Groups ``posterior``, ``sample_stats`` (log density), ``prior`` and ``observed_data``, of several tests one of
        the last for each, ``observed_data_long``; draws have dimensions chain × draw, one chain per walker, with the
        walker's ensemble as a coordinate.
    estimate
        MAP with Laplace covariance.
    best
        Joint mode: the best draw refined, and its log density.
    record
        How the draws came about.
    case
        The case that was sampled, for its report; None where there was none.
    """

    problem: Problem
    tree: xr.DataTree
    estimate: MapEstimate
    best: BestDraw
    record: RunRecord
    case: SampledCase | None = None
    #: What studies found, by name and arguments.
    _found: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False)

    def __getitem__(self, name: str) -> xr.DataArray:
        """Draws of one stiffness or other uncertain quantity, chain × draw, in its unit.

        Raises
        ------
        ModelError
            If there is no such quantity.
        """
        return _named(self.draws, name)

    def __contains__(self, name: object) -> bool:
        return name in self.draws.data_vars

    def __iter__(self) -> Iterator[str]:
        return iter(map(str, self.draws))

    @property
    def draws(self) -> xr.Dataset:
        """Draws in physical units, chain × draw: the quantities of the joint and what else is uncertain."""
        return self.tree["posterior"].to_dataset()

    @property
    def converged(self) -> bool:
        """Whether the sampler met its stop rule."""
        return self.record.converged

    @property
    def reason(self) -> str:
        """Why the sampler stopped, with figures."""
        return self.record.reason

    @property
    def mode(self) -> dict[str, float]:
        """Joint posterior mode (of the density over θ) in physical units, by name."""
        prior = self.problem.prior
        stiffness = dict(zip(self.stiffness_names, prior.values(self.best.theta).tolist(), strict=True))
        names = (n.name for n in prior.nuisances)
        return stiffness | dict(zip(names, prior.nuisance_values(self.best.theta).tolist(), strict=True))

    @property
    def stiffness_names(self) -> tuple[str, ...]:
        """Names of the joint's stiffnesses, in the order of `stiffness`."""
        return tuple(quantity.name for quantity in self.problem.quantities)

    def unit(self, name: str) -> str:
        """Unit of one stiffness or other quantity."""
        return str(_named(self.draws, name).attrs.get("units", ""))

    def values(self, name: str) -> Array:
        """All draws of one stiffness or other quantity, shape (chains, draws).

        Raises
        ------
        ModelError
            If there is no such quantity.
        """
        return _variable(self.draws, name)

    def prior_values(self, name: str) -> Array:
        """Draws of one stiffness from the prior, shape (1, draws)."""
        return _variable(self.tree["prior"].to_dataset(), name)

    @cached_property
    def stiffness(self) -> Array:
        """All draws of the joint's quantities, shape (n, q), chain after chain."""
        return np.stack([self.values(name).ravel() for name in self.stiffness_names], axis=-1)

    @cached_property
    def theta(self) -> Array:
        """All draws of θ, shape (n, d), chain after chain."""
        prior = self.problem.prior
        rest = [n.coordinate(self.values(n.name).ravel()) for n in prior.nuisances]
        joint = prior.parametrisation.coordinates(self.stiffness)
        return np.concatenate([joint, *(column[:, None] for column in rest)], axis=1)

    @property
    def log_density(self) -> Array:
        """Log density over θ of each draw, up to the evidence, shape (chains, draws)."""
        return _variable(self.tree["sample_stats"].to_dataset(), "lp")

    def interval(self, name: str, probability: float = 0.95) -> tuple[float, float]:
        """Equal-tailed credible interval of one stiffness, in its unit.

        Raises
        ------
        ModelError
            If there is no such stiffness or the probability is not inside (0, 1).
        """
        require_probability(probability, "interval")
        return equal_tailed(self.values(name), probability)

    def thinned(self, most: int) -> Array:
        """At most so many draws of θ, evenly spaced over all chains, shape (n, d)."""
        require_count(most, "max_draws: found")
        rows = np.linspace(0, len(self.theta) - 1, min(most, len(self.theta))).round().astype(int)
        return self.theta[rows]

    def predict_natural_frequencies(self, count: int = 3, max_draws: int = 4000, *, test: str | None = None) -> Array:
        """Natural frequencies of posterior draws, shape (draws, count), Hz.

        Those of the model: its own error, see ``[uncertain.model_error]``, is not in them. Of the test of that name,
        by default the first.
        """
        theta, prior = self.thinned(max_draws), self.problem.prior
        return self.problem.part(test).natural_frequencies_hz(prior.values(theta), count, prior.factors(theta))

    @property
    def premises(self) -> Premises:
        """What the answer takes for granted."""
        return self.problem.premises


Subject = TypeVar("Subject", bound=Sampled)
Asked = ParamSpec("Asked")
Finding = TypeVar("Finding")
Study = Callable[Concatenate[Subject, Asked], Finding]
#: Studies whose findings a posterior file keeps, by name.
KEPT: dict[str, Callable[..., Any]] = {}


def once(study: Study[Subject, Asked, Finding]) -> Study[Subject, Asked, Finding]:
    """Decorate a study so that what it finds in a posterior is found once."""

    @wraps(study)
    def found(posterior: Subject, /, *args: Asked.args, **kwargs: Asked.kwargs) -> Finding:
        key = (study.__name__, *args, *kwargs.items())
        if key not in posterior._found:
            posterior._found[key] = study(posterior, *args, **kwargs)
        finding: Finding = posterior._found[key]
        return finding

    return found


def kept(study: Callable[[Subject], Finding]) -> Callable[[Subject], Finding]:
    """Decorate a study as `once` does; files of posteriors hold its finding, which is of the type that is annotated."""
    KEPT[study.__name__] = study
    return once(study)


def is_found(posterior: Sampled, study: Callable[..., Any]) -> bool:
    """Whether a study without further arguments was made, or its finding read from a file."""
    return (study.__name__,) in posterior._found


def kept_findings(posterior: Sampled) -> dict[str, Any]:
    """What was found by studies that are kept, by their names."""
    return {name: posterior._found[name,] for name in KEPT if (name,) in posterior._found}


def recall(posterior: Sampled, findings: Mapping[str, Any]) -> None:
    """Take findings of an earlier look at the same draws, by the names of their studies."""
    posterior._found.update({(name,): finding for name, finding in findings.items()})


def equal_tailed(values: Array, probability: float) -> tuple[float, float]:
    """Ends of the equal-tailed interval of values, any shape, with a probability inside."""
    tail = (1 - probability) / 2
    low, high = np.quantile(values, [tail, 1 - tail])
    return float(low), float(high)


def by_ensemble(posterior: Sampled, name: str) -> Array:
    """All draws of one quantity with walkers of an ensemble together, shape (ensembles, draws, walkers).

    Raises
    ------
    ModelError
        If there is no such quantity.
    """
    values = posterior.values(name)
    ensembles = len(np.unique(posterior.draws["ensemble"].values))
    return values.reshape(ensembles, -1, values.shape[1]).swapaxes(1, 2)


def prior_stiffness(posterior: Sampled) -> Array:
    """Draws of the joint's quantities from the prior, shape (m, q)."""
    return np.stack([posterior.prior_values(name).ravel() for name in posterior.stiffness_names], axis=-1)


def _named(dataset: xr.Dataset, name: str) -> xr.DataArray:
    if name not in dataset.data_vars:
        raise ModelError(f"posterior: found parameter {name!r}; expected one of {', '.join(map(str, dataset))}")
    return dataset[name]


def _variable(dataset: xr.Dataset, name: str) -> Array:
    return np.asarray(_named(dataset, name).transpose("chain", "draw").values, dtype=float)
