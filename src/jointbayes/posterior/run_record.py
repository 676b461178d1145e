"""How the draws of a posterior came about, and of which case and data they are."""

import hashlib
import math
import platform
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, with_config
from typing_extensions import TypedDict

from jointbayes.frf import MeasuredBody
from jointbayes.inference import Problem
from jointbayes.joint.quantities import prefixed
from jointbayes.phrases import DO_NOT_USE
from jointbayes.reproducibility import code_version
from jointbayes.sampling import Chains, SamplerSettings
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
            return f"Not converged{steps}: {DO_NOT_USE}."
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
    def default_priors(self) -> Collection[str]:
        """Coordinates whose prior nobody stated."""

    @property
    def verdict_rules(self) -> Mapping[str, VerdictRule]:
        """Thresholds of verdicts that it states, by the stiffness."""

    @property
    def warnings(self) -> Sequence[object]:
        """What is probably a slip."""


def bodies_of(problem: Problem) -> dict[str, MeasuredBody]:
    """Measured bodies of all tests by their names; of several tests with the name of each before it."""
    return {prefixed(part.test.name, body.name): body for part in problem.parts for body in part.test.measured_bodies}


def data_sha256(problem: Problem) -> str:
    """Fingerprint of the numbers that were analysed: data and measured bodies of all tests."""
    measured = [part.test.data.shown_frfs or part.test.data for part in problem.parts]
    arrays: list[NDArray[Any]] = [array for data in measured for array in data.arrays.values()]
    for body in bodies_of(problem).values():
        arrays += body.arrays
    return sha256_of(arrays)


def sha256_of(arrays: Iterable[NDArray[Any]]) -> str:
    """Digest of the numbers in arrays, the same on every machine."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def sampler_figures(
    settings: SamplerSettings, chains: Chains, efficiency: float, names: Sequence[str]
) -> SamplerFigures:
    """Settings and figures of a run of the ensembles, as the record has them; `names` are those of the coordinates."""
    ess = chains.ess
    return {
        "ensembles": settings.ensembles,
        "walkers": settings.walkers,
        "steps": chains.discarded + chains.steps,
        "max_steps": settings.max_steps,
        "burn_in": chains.discarded + chains.burn_in,
        "thin": chains.thin,
        "acceptance": float(chains.acceptance.mean()),
        "move_acceptance": dict(chains.move_acceptance),
        "proposal_efficiency": efficiency,
        "tau": dict(zip(names, chains.tau.tolist(), strict=True)),
        "ess": dict(zip(names, ess.tolist(), strict=True)),
        "evaluations": chains.evaluations,
        "singular": chains.singular,
        "seconds": chains.seconds,
        "ess_per_second": float(ess.min() / chains.seconds),
    }


def package_versions() -> dict[str, str]:
    """Version of Python, of every package that numbers depend on, and of this one as `code_version` has it."""
    packages = ("numpy", "scipy", "numba", "emcee", "dynesty", "arviz", "xarray", "corner", "matplotlib", "typst")
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
        "jointbayes": code_version(),
    }
