"""Figures of a run, fingerprints of its data, and versions of its packages."""

import hashlib
import platform
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf import MeasuredBody
from jointbayes.inference import Problem
from jointbayes.joint.quantities import prefixed
from jointbayes.posterior.sampled import SamplerFigures
from jointbayes.reproducibility import code_version
from jointbayes.sampling import Chains, SamplerSettings


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
