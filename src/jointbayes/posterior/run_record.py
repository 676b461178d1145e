"""How the draws of a posterior came about, of which case and data they are, and by what a run that goes on is known."""

import hashlib
import json
import platform
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from importlib.metadata import version
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.frf import MeasuredBody
from jointbayes.inference import Problem
from jointbayes.joint.quantities import prefixed
from jointbayes.posterior.stored_problem import described
from jointbayes.reproducibility import code_version
from jointbayes.sampling import Chains, Proposal, SamplerSettings

#: Settings that change no draw, and tables of a case that are only shown or compared with the result.
_NO_MATTER = frozenset({"processes"})
_ONLY_SHOWN = frozenset({"title", "reference", "sampling", "compare", "plan", "virtual_test", "setups"})
_SHOWN = 60  # characters; of longer values a digest
_PACKAGES = ("numpy", "scipy", "numba", "emcee")


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
    seed: int
    converged: bool
    reason: str
    sampler: Mapping[str, Any]
    r_hat: Mapping[str, float]
    versions: Mapping[str, str]


class SampledCase(Protocol):
    """What a report says of the case that was sampled, besides the posterior."""

    @property
    def title(self) -> str:
        """Title for people."""
        ...

    @property
    def stated(self) -> Problem | None:
        """The problem that its text states."""
        ...

    @property
    def setups(self) -> Sequence[Any]:
        """Its set-ups as they were built, each with `name` and `spec`, a pydantic model; empty if built of no text."""
        ...

    @property
    def reference(self) -> Array | None:
        """Published (k11, k12, k22), shape (3,), if any."""
        ...

    @property
    def reference_source(self) -> str:
        """Where these are from."""
        ...

    @property
    def measured_frequencies_hz(self) -> tuple[float, ...] | None:
        """Measured natural frequencies, if any, Hz."""
        ...

    @property
    def workshop_problem(self) -> Problem | None:
        """The same problem with more quantities uncertain."""
        ...

    @property
    def default_priors(self) -> Collection[str]:
        """Coordinates whose prior nobody stated."""
        ...

    @property
    def warnings(self) -> Sequence[object]:
        """What is probably a slip."""
        ...


def bodies_of(problem: Problem) -> dict[str, MeasuredBody]:
    """Measured bodies of all set-ups by their names; of several set-ups with the name of each before it."""
    return {prefixed(part.test.name, body.name): body for part in problem.parts for body in part.test.measured_bodies}


def data_sha256(problem: Problem) -> str:
    """Fingerprint of the numbers that were analysed: data and measured bodies of all set-ups."""
    arrays: list[NDArray[Any]] = [array for part in problem.parts for array in part.test.data.arrays.values()]
    for body in bodies_of(problem).values():
        arrays += body.arrays
    return _sha256(arrays)


def _sha256(arrays: Iterable[NDArray[Any]]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def sampler_figures(
    settings: SamplerSettings, chains: Chains, proposal: Proposal, names: Sequence[str]
) -> dict[str, Any]:
    """Settings and figures of a run of the ensembles, as the record has them; `names` are those of the coordinates."""
    ess = chains.ess
    return {
        "ensembles": settings.ensembles,
        "walkers": settings.walkers,
        "steps": chains.discarded + chains.steps,
        "max_steps": settings.max_steps,
        "burn_in": chains.discarded + chains.burn_in,
        "thin": chains.thin,
        "processes": settings.processes,
        "acceptance": float(chains.acceptance.mean()),
        "move_acceptance": dict(chains.move_acceptance),
        "proposal_efficiency": proposal.efficiency,
        "tau": dict(zip(names, chains.tau.tolist(), strict=True)),
        "ess": dict(zip(names, ess.tolist(), strict=True)),
        "evaluations": chains.evaluations,
        "singular": chains.singular,
        "seconds": chains.seconds,
        "ess_per_second": float(ess.min() / chains.seconds),
    }


def package_versions() -> dict[str, str]:
    """Version of Python, of every package that numbers depend on, and of this one as `code_version` has it."""
    numbers = ("numpy", "scipy", "numba", "emcee", "dynesty", "arviz", "xarray")
    packages = (*numbers, "corner", "matplotlib", "typst")
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
        "jointbayes": code_version(),
    }


def run_fingerprint(problem: Problem, case: SampledCase | None, seed: int, settings: SamplerSettings) -> dict[str, str]:
    """Parts of a run by name: seed, settings, versions, data, and the keys of the case or the parts of the problem.

    Parameters
    ----------
    problem
        What is sampled.
    case
        The case that states it, if one does.
    seed, settings
        Of the run.
    """
    parts = {"seed": str(seed), "data": "".join(_sha256(test.data.arrays.values())[:16] for test in problem.tests)}
    for part in problem.parts:
        if (joint_frf := part.test.data.joint_frf) is not None:
            values = np.ascontiguousarray(joint_frf.values)
            name = f"data at the joint in {part.test.name}" if part.test.name else "data at the joint"
            parts[name] = hashlib.sha256(values.tobytes()).hexdigest()[:16]
    for name, body in bodies_of(problem).items():
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in body.arrays))
        parts[f"measured body {name}"] = digest.hexdigest()[:16]
    parts |= {
        f"sampling.{setting.name}": str(getattr(settings, setting.name))
        for setting in fields(settings)
        if setting.name not in _NO_MATTER
    }
    if case is not None and case.stated is problem and case.setups:
        for setup in case.setups:
            tables = json.loads(setup.spec.model_dump_json(exclude=set(_ONLY_SHOWN)))
            parts |= _flat(tables, f"setups.{setup.name}." if setup.name else "")
    else:
        parts |= {name: _short(plain) for name, plain in described(problem).items() if name != "name"}
    versions = {
        "python": platform.python_version(),
        **{name: version(name) for name in _PACKAGES},
        "jointbayes": code_version(),
    }
    return parts | {f"version of {name}": number for name, number in versions.items()}


def _flat(table: Mapping[str, Any], above: str = "") -> dict[str, str]:
    """Values by dotted key."""
    flat: dict[str, str] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{above}{key}.")
        elif value is not None:
            flat[f"{above}{key}"] = _short(value)
    return flat


def _short(value: object) -> str:
    """A value as a message may show it; of a long one its digest."""
    text = json.dumps(value, ensure_ascii=False, sort_keys=True)
    return text if len(text) <= _SHOWN else hashlib.sha256(text.encode()).hexdigest()[:16]
